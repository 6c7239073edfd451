//! Datagrams of udp and mcast, and of the search for a name server.
//!
//! ```text
//!   u32 CRC-32 of the rest │ i32 counter 0, 1, 2, … (-1: nothing, only wakes) │ bytes
//!                                                     all of one message in a row ─▶ index …
//! ```

use bytes::BytesMut;

use super::command::Incoming;
use super::message::{Found, MessageReader};
use super::{Fault, Progress, i32_at};
use crate::WireLimits;

/// Bytes in front of the content.
pub const PREFIX: usize = 8;
/// Largest datagram that YARP sends, prefix included.
pub const MAX_DATAGRAM: usize = 65_499;

/// A datagram with its prefix.
pub fn seal(counter: i32, content: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(PREFIX + content.len());
    bytes.extend([0; 4]);
    bytes.extend(counter.to_le_bytes());
    bytes.extend(content);
    let crc = bytes.get(PREFIX..).map(crc32fast::hash).unwrap_or_default();
    if let Some(start) = bytes.first_chunk_mut::<4>() {
        *start = crc.to_le_bytes();
    }
    bytes
}

/// Counter and content of a datagram.
///
/// # Errors
/// When it is too short, or damaged.
pub fn open(datagram: &[u8]) -> Result<(i32, &[u8]), Fault> {
    let damaged = || Fault::BadDatagram(datagram.len());
    let crc = i32_at(datagram, 0).ok_or_else(damaged)?.cast_unsigned();
    let counter = i32_at(datagram, 4).ok_or_else(damaged)?;
    let content = datagram.get(PREFIX..).ok_or_else(damaged)?;
    match crc32fast::hash(content) == crc {
        true => Ok((counter, content)),
        false => Err(damaged()),
    }
}

/// A message in datagrams of at most `largest` bytes.
pub fn split(head: &[u8], payload: &[u8], largest: usize) -> Vec<Vec<u8>> {
    let room = largest.clamp(PREFIX + 1, MAX_DATAGRAM) - PREFIX;
    let mut datagrams = Vec::with_capacity((head.len() + payload.len()).div_ceil(room));
    let mut content = Vec::with_capacity(room.min(head.len() + payload.len()));
    let mut counter = 0_i32;
    for mut part in [head, payload] {
        while !part.is_empty() {
            let (now, later) = part.split_at(part.len().min(room - content.len()));
            content.extend_from_slice(now);
            part = later;
            if content.len() == room {
                datagrams.push(seal(counter, &content));
                counter = counter.wrapping_add(1);
                content.clear();
            }
        }
    }
    if !content.is_empty() {
        datagrams.push(seal(counter, &content));
    }
    datagrams
}

/// Puts messages together again.
#[derive(Debug, Clone)]
pub struct Assembler {
    limits: WireLimits,
    /// Counter that is due; 0 while no message is open.
    due: i32,
    reader: MessageReader,
    stream: BytesMut,
}

impl Assembler {
    /// An assembler that refuses messages beyond `limits`.
    pub fn new(limits: &WireLimits) -> Self {
        let (reader, limits) = (MessageReader::new(limits), limits.clone());
        Self { limits, due: 0, reader, stream: BytesMut::new() }
    }

    /// Takes a datagram; the message that it completes.
    ///
    /// # Errors
    /// A [`Fault`] to count; the next message is read again.
    pub fn push(&mut self, datagram: &[u8]) -> Result<Option<Incoming>, Fault> {
        let (counter, content) = match open(datagram) {
            Ok((counter, _)) if counter < 0 => return Ok(None),
            Ok(opened) => opened,
            Err(fault) => {
                self.restart();
                return Err(fault);
            }
        };
        let due = self.due;
        if counter == 0 {
            self.restart();
        } else if counter != due || due == 0 {
            // Counted once a message: the rest of a message whose beginning is lost is silent.
            self.restart();
            return match due {
                0 => Ok(None),
                expected => Err(Fault::LostDatagram { expected, found: counter }),
            };
        }
        self.stream.extend_from_slice(content);
        self.due = counter.wrapping_add(1);
        match self.reader.poll(&mut self.stream) {
            Ok(Progress::Need(more)) => {
                self.stream.reserve(more.min(self.limits.max_message_bytes));
                // A new message always begins a new one, so an unfinished one was cut short.
                let lost = Fault::LostDatagram { expected: due, found: 0 };
                if counter == 0 && due != 0 { Err(lost) } else { Ok(None) }
            }
            Ok(Progress::Event(Found::Message(message))) => {
                self.restart();
                Ok(Some(message))
            }
            Ok(Progress::Event(Found::Left(fault))) | Err(fault) => {
                self.restart();
                Err(fault)
            }
        }
    }

    /// True when a message has begun.
    pub fn has_begun(&self) -> bool {
        self.due > 0
    }

    /// Bytes of a begun message that have come.
    pub fn begun(&self) -> usize {
        self.stream.len()
    }

    /// Gives a begun message up.
    pub fn restart(&mut self) {
        self.due = 0;
        self.reader = MessageReader::new(&self.limits);
        self.stream = BytesMut::new();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::command::{Body, Command};
    use crate::wire::message;

    fn message(payload: &[u8]) -> (Vec<u8>, Command) {
        let command = Command::Data { reply: false, envelope: None };
        (message::head(&command, &[payload.len()]).unwrap(), command)
    }

    #[test]
    fn a_message_in_many_datagrams_comes_together() {
        let payload: Vec<u8> = (0..200_u8).collect();
        let (head, command) = message(&payload);
        let datagrams = split(&head, &payload, 50);
        assert!(datagrams.iter().all(|datagram| datagram.len() <= 50));
        let mut assembler = Assembler::new(&WireLimits::default());
        for _ in 0..2 {
            let mut whole = None;
            for datagram in &datagrams {
                assert_eq!(whole, None);
                whole = assembler.push(datagram).unwrap();
            }
            let body = Body::Binary(payload.clone().into());
            assert_eq!(whole, Some(Incoming { command: command.clone(), body }));
        }
    }

    #[test]
    fn a_missing_datagram_loses_one_message() {
        let (head, _) = message(&[7; 100]);
        let datagrams = split(&head, &[7; 100], 40);
        let mut assembler = Assembler::new(&WireLimits::default());
        assert_eq!(assembler.push(&datagrams[0]), Ok(None));
        let lost = Fault::LostDatagram { expected: 1, found: 2 };
        assert_eq!(assembler.push(&datagrams[2]), Err(lost));
        assert_eq!(assembler.push(&datagrams[3]), Ok(None), "told once");
        assert_eq!(assembler.push(&datagrams[0]), Ok(None));
        let cut = Fault::LostDatagram { expected: 1, found: 0 };
        assert_eq!(assembler.push(&datagrams[0]), Err(cut), "the first one never ended");
        let rest = &datagrams[1..];
        let last = rest.iter().map(|datagram| assembler.push(datagram).unwrap()).last();
        assert!(last.unwrap().is_some());
    }

    #[test]
    fn damage_is_seen() {
        let mut datagram = seal(0, b"hello");
        assert_eq!(open(&datagram), Ok((0, &b"hello"[..])));
        datagram[9] ^= 1;
        assert_eq!(open(&datagram), Err(Fault::BadDatagram(13)));
        assert_eq!(open(&[1, 2, 3]), Err(Fault::BadDatagram(3)));
        let wake = seal(-1, &[0; 10]);
        assert_eq!(wake[..8], [0x76, 0x68, 0x8a, 0xe3, 0xff, 0xff, 0xff, 0xff]);
        assert_eq!(Assembler::new(&WireLimits::default()).push(&wake), Ok(None));
    }
}
