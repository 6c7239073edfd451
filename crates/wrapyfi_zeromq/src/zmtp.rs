//! ZMTP 3, the protocol between ZeroMQ sockets, as far as the broker's ports, topics and the check of ports need it.
//!
//! ```text
//!   greeting (64 bytes)   signature, version, mechanism
//!   command READY         Socket-Type                (with CURVE: HELLO, WELCOME, INITIATE before it)
//!   frames                flags, length (1 or 8 bytes), body
//! ```
//!
//! Version 3.0 is announced: to that libzmq sends subscriptions as messages. Those that come as commands of 3.1 are
//! understood too.

use bytes::Bytes;

use super::message::Parts;

/// Size of a greeting.
pub(super) const GREETING: usize = 64;
/// Size of what stands before the mechanism in it.
pub(super) const VERSIONED: usize = 12;

const FLAG_MORE: u8 = 0x01;
const FLAG_LONG: u8 = 0x02;
const FLAG_COMMAND: u8 = 0x04;
/// Largest frame that is copied behind its header instead of being sent from where it lies.
const COPIED: usize = 4096;

/// Header of a frame, which stands before its body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) is_command: bool,
    pub(super) more: bool,
    /// Size of the body, and of the header itself.
    pub(super) length: usize,
    pub(super) size: usize,
}

/// A frame from a peer.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Frame<'a> {
    pub(super) is_command: bool,
    pub(super) more: bool,
    pub(super) body: &'a [u8],
}

/// A peer that does not keep to the protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("it does not speak ZMTP 3 as its side does")]
pub(super) struct Breach;

/// Socket type that our end of a connection has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// Publishes, and hears subscriptions.
    Xpub,
    /// Subscribes, and hears messages.
    Xsub,
    /// Hears requests, and answers each where it came from.
    Router,
    /// Asks one after the other, and hears replies.
    Dealer,
}

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Xpub => "XPUB",
            Self::Xsub => "XSUB",
            Self::Router => "ROUTER",
            Self::Dealer => "DEALER",
        }
    }

    /// Setting of the port of the broker that has a socket of this type.
    pub(super) fn port(self) -> &'static str {
        match self {
            Self::Xpub => "pub_port",
            Self::Xsub => "sub_port",
            Self::Router => "rep_port",
            Self::Dealer => "req_port",
        }
    }

    /// Type at the broker's other port, for those whom this one does not take.
    pub(super) fn other(self) -> Self {
        match self {
            Self::Xpub => Self::Xsub,
            Self::Xsub => Self::Xpub,
            Self::Router => Self::Dealer,
            Self::Dealer => Self::Router,
        }
    }

    /// True where a socket of ours of this type may have that peer.
    pub(super) fn accepts(self, theirs: &[u8]) -> bool {
        match self {
            Self::Xpub => matches!(theirs, b"SUB" | b"XSUB"),
            Self::Xsub => matches!(theirs, b"PUB" | b"XPUB"),
            Self::Router => matches!(theirs, b"REQ" | b"DEALER" | b"ROUTER"),
            Self::Dealer => matches!(theirs, b"REP" | b"DEALER" | b"ROUTER"),
        }
    }
}

/// Result of a command of the handshake.
pub(super) enum HandshakeStep {
    /// The handshake goes on with this command.
    #[cfg_attr(not(feature = "curve"), expect(dead_code, reason = "CURVE says it"))]
    Say(Vec<u8>),
    /// The handshake is over: the last command, where it is ours, and the properties of the peer.
    Open(Option<Vec<u8>>, Vec<u8>),
}

/// A frame that was opened in place: its body begins behind what CURVE adds.
pub(super) struct Opened {
    pub(super) is_command: bool,
    pub(super) more: bool,
}

/// Mechanism of a connection without security.
pub(super) const NULL: &str = "NULL";
/// Mechanism of one whose ends have keys.
pub(super) const CURVE: &str = "CURVE";

/// Our greeting.
pub(super) fn greeting(mechanism: &str, is_server: bool) -> Vec<u8> {
    let mut greeting = vec![0xff, 0, 0, 0, 0, 0, 0, 0, 1, 0x7f, 3, 0];
    greeting.extend_from_slice(mechanism.as_bytes());
    greeting.resize(32, 0);
    greeting.push(u8::from(is_server));
    greeting.resize(GREETING, 0);
    greeting
}

/// Reads a greeting of ZMTP 3: its mechanism, and true where it is of version 3.1, which has heartbeats.
/// libzmq answers them from 4.2 on, and says 3.1 from 4.3.3 on.
pub(super) fn read_greeting(greeting: &[u8; GREETING]) -> Result<(String, bool), Breach> {
    let [0xff, _, _, _, _, _, _, _, _, 0x7f, major @ 3..=255, minor, rest @ ..] = greeting else {
        return Err(Breach);
    };
    let mechanism = rest.iter().take(20).take_while(|byte| **byte != 0).copied();
    let mechanism = mechanism.collect::<Vec<u8>>().escape_ascii().to_string();
    Ok((mechanism, (*major, *minor) >= (3, 1)))
}

/// The command READY of a socket of this type.
pub(super) fn ready(socket_type: &str) -> Vec<u8> {
    command(&[&b"\x05READY"[..], &properties(socket_type)].concat())
}

/// Properties of a socket of this type.
pub(super) fn properties(socket_type: &str) -> Vec<u8> {
    let mut properties = b"\x0bSocket-Type\0\0\0".to_vec();
    // Socket types are words of a few letters.
    properties.push(u8::try_from(socket_type.len()).unwrap_or(u8::MAX));
    properties.extend_from_slice(socket_type.as_bytes());
    properties
}

/// A subscription to a beginning of topics, or its end, as a message.
pub(super) fn subscription(is_on: bool, topic: &[u8]) -> Bytes {
    [&[u8::from(is_on)][..], topic].concat().into()
}

/// A command with this body.
pub(super) fn command(body: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(body.len() + 9);
    put_header(true, false, body.len(), &mut frame);
    frame.extend_from_slice(body);
    frame
}

/// Adds the header of a frame.
pub(super) fn put_header(is_command: bool, more: bool, length: usize, out: &mut Vec<u8>) {
    let flags = if is_command { FLAG_COMMAND } else { 0 } | if more { FLAG_MORE } else { 0 };
    match u8::try_from(length) {
        Ok(length) => out.extend([flags, length]),
        Err(_) => {
            out.push(flags | FLAG_LONG);
            out.extend((length as u64).to_be_bytes());
        }
    }
}

/// Size of the header of a frame of `length` bytes.
fn header_size(length: usize) -> usize {
    if u8::try_from(length).is_ok() { 2 } else { 9 }
}

/// Socket type in the properties of a command READY.
pub(super) fn socket_type(mut properties: &[u8]) -> Option<&[u8]> {
    while !properties.is_empty() {
        let (name, after) = short_text(properties)?;
        let (length, after) = after.split_first_chunk::<4>()?;
        let length = usize::try_from(u32::from_be_bytes(*length)).ok()?;
        let (value, after) = after.split_at_checked(length)?;
        if name.eq_ignore_ascii_case(b"Socket-Type") {
            return Some(value);
        }
        properties = after;
    }
    None
}

/// Splits off a text with its length in the first byte, such as the name of a command.
pub(super) fn short_text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (&length, rest) = bytes.split_first()?;
    rest.split_at_checked(usize::from(length))
}

/// The first frame in `bytes` and the size of all of it; `None` while it is incomplete.
///
/// # Errors
/// When it announces more than `limit` bytes.
pub(super) fn split_frame(
    bytes: &[u8],
    limit: usize,
) -> Result<Option<(Frame<'_>, usize)>, Breach> {
    let Some(Header { is_command, more, length, size }) = header(bytes) else { return Ok(None) };
    if length > limit {
        return Err(Breach);
    }
    let body = bytes.get(size..).and_then(|rest| rest.get(..length));
    Ok(body.map(|body| (Frame { is_command, more, body }, size + length)))
}

/// The header of the first frame in `bytes`; `None` while it is incomplete.
pub(super) fn header(bytes: &[u8]) -> Option<Header> {
    let (&flags, rest) = bytes.split_first()?;
    let (length, size) = if flags & FLAG_LONG == 0 {
        (u64::from(*rest.first()?), 2)
    } else {
        (u64::from_be_bytes(*rest.first_chunk::<8>()?), 9)
    };
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    let (is_command, more) = (flags & FLAG_COMMAND != 0, flags & FLAG_MORE != 0);
    Some(Header { is_command, more, length, size })
}

/// Appends a message as its frames go on the wire.
pub(super) fn append(frames: &[impl AsRef<[u8]>], out: &mut Vec<u8>) {
    for (index, body) in frames.iter().map(AsRef::as_ref).enumerate() {
        put_header(false, index + 1 < frames.len(), body.len(), out);
        out.extend_from_slice(body);
    }
}

/// A message as its frames go on the wire: small ones one behind the other, large ones from where they lie.
pub(super) fn encode<F: AsRef<[u8]> + Into<Bytes>>(frames: Vec<F>) -> Parts {
    let sizes = frames.iter().map(|body| body.as_ref().len());
    // `Bytes` takes over a `Vec` without room to spare, and no memory has to be had for that.
    let size = sizes.map(|size| header_size(size) + if size <= COPIED { size } else { 0 }).sum();
    let (mut head, mut parts, count) = (Vec::with_capacity(size), Parts::new(), frames.len());
    for (index, body) in frames.into_iter().enumerate() {
        let bytes = body.as_ref();
        put_header(false, index + 1 < count, bytes.len(), &mut head);
        if bytes.len() <= COPIED {
            head.extend_from_slice(bytes);
        } else {
            parts.push(std::mem::take(&mut head).into());
            parts.push(body.into());
        }
    }
    if !head.is_empty() {
        parts.push(head.into());
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(is_command: bool, more: bool, body: &[u8]) -> Frame<'_> {
        Frame { is_command, more, body }
    }

    #[test]
    fn frames_are_split_wherever_they_are_cut() {
        let mut bytes = ready("XPUB");
        bytes.extend(b"\x01\x02ab\x02\0\0\0\0\0\0\0\x03abc");
        let whole = bytes.clone();
        for end in 0..whole.len() {
            let mut rest = &whole[..end];
            while let Some((_, size)) = split_frame(rest, 100).unwrap() {
                rest = &rest[size..];
            }
            assert!(rest.len() <= end);
        }
        let (first, size) = split_frame(&bytes, 100).unwrap().unwrap();
        let (name, properties) = short_text(first.body).unwrap();
        assert_eq!((name, socket_type(properties)), (&b"READY"[..], Some(&b"XPUB"[..])));
        let rest = &bytes[size..];
        assert_eq!(split_frame(rest, 100), Ok(Some((frame(false, true, b"ab"), 4))));
        assert_eq!(split_frame(&rest[4..], 100), Ok(Some((frame(false, false, b"abc"), 12))));
        assert_eq!(split_frame(&rest[4..], 2), Err(Breach));
        assert_eq!(split_frame(b"\x02\xff\xff\xff\xff\xff\xff\xff\xff", 100), Err(Breach));
    }

    #[test]
    fn messages_are_encoded_as_they_are_split() {
        let sizes = [0, 255, 256, COPIED, COPIED + 1, 3];
        let parts = encode(sizes.iter().map(|&size| vec![7_u8; size]).collect());
        assert_eq!(parts.len(), 3, "one is sent from where it lies");
        let bytes = parts.concat();
        let mut rest = &bytes[..];
        for (index, &expected) in sizes.iter().enumerate() {
            let (frame, size) = split_frame(rest, 1 << 20).unwrap().unwrap();
            assert_eq!((frame.body.len(), frame.more), (expected, index + 1 < sizes.len()));
            rest = &rest[size..];
        }
        assert!(rest.is_empty());
    }

    #[test]
    fn other_greetings_are_refused() {
        let ours: [u8; GREETING] = greeting(CURVE, true).try_into().unwrap();
        assert_eq!(read_greeting(&ours), Ok((CURVE.to_owned(), false)));
        let mut newer = ours;
        newer[11] = 1;
        assert_eq!(read_greeting(&newer), Ok((CURVE.to_owned(), true)));
        for (at, byte) in [(0, 0), (9, 0), (10, 2)] {
            let mut other = ours;
            other[at] = byte;
            assert_eq!(read_greeting(&other), Err(Breach), "{at}");
        }
    }
}
