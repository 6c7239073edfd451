//! Header of a connection: eight bytes choose the carrier, then the sender says its name.
//!
//! ```text
//!   tcp, fast_tcp, udp    "YA" 7777+s "RP"  i32 length  name NUL        ◀─ "YA" port "RP"
//!   unix_stream           "UNIX_STR" | "UNIX_ACK"  i32 length  name NUL       (no answer: the socket)
//!   mcast                 the same, then 4 bytes group, 2 bytes port, big endian
//!   text, text_ack        "CONNECT " | "CONNACK "  name  \n             ◀─ "Welcome name\r\n"
//!   name server           "NAME_SER"  rest of the line
//!   browsers, cameras     "GET /…" | "POST /fo…"
//! ```

use std::net::{Ipv4Addr, SocketAddrV4};

use bytes::{Bytes, BytesMut};

use super::http::{self, HttpRequest};
use super::text::{self, Lines};
use super::{Carrier, Fault, Progress, Sender, i32_at, number};
use crate::WireLimits;

/// Added to the specifier of a binary carrier.
const BASE: i32 = 7777;
/// Bytes that choose the carrier.
const MAGIC: usize = 8;
/// Bytes of a multicast group: address and port.
const GROUP: usize = 6;

/// Opening of a connection, by its header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Opening {
    /// A connection for messages.
    Messages {
        /// Carrier of the messages.
        carrier: Carrier,
        /// Sender of the messages.
        sender: Sender,
        /// Multicast group of the messages, on mcast.
        group: Option<SocketAddrV4>,
    },
    /// A request to a name server, without the line's end and without `NAME_SERVER`; more lines
    /// may follow ([`text::Lines`]).
    Names(Bytes),
    /// A request over HTTP.
    Http(HttpRequest),
}

impl Opening {
    /// Reads the beginning of a connection that a program opened to us; what it leaves in the buffer
    /// are messages.
    ///
    /// # Errors
    /// A [`Fault`] when the bytes begin no carrier, or exceed `limits`. For an unknown header there
    /// is a text to send before closing: [`UNKNOWN_HEADER_HELP`].
    pub fn poll(buffer: &mut BytesMut, limits: &WireLimits) -> Result<Progress<Self>, Fault> {
        let Some(magic) = buffer.get(..MAGIC) else {
            return Ok(Progress::Need(MAGIC - buffer.len()));
        };
        match magic {
            b"CONNECT " => Self::text(buffer, Carrier::Text, limits),
            b"CONNACK " => Self::text(buffer, Carrier::TextAck, limits),
            b"NAME_SER" => Ok(Lines::new(limits).poll_request(buffer)?.map(Self::Names)),
            b"LOCALITY" => Err(Fault::UnsupportedCarrier("local")),
            b"UNIX_STR" => Self::binary(buffer, Carrier::UnixStream, limits),
            b"UNIX_ACK" => Self::binary(buffer, Carrier::UnixStreamAck, limits),
            b"HUMANITY" => Err(Fault::UnsupportedCarrier("human")),
            b"GET /?ws" => Err(Fault::UnsupportedCarrier("websocket")),
            _ if magic.starts_with(b"GET /") || magic == b"POST /fo" => {
                Ok(http::request(buffer)?.map(Self::Http))
            }
            _ => {
                let unknown = || Fault::UnknownHeader(String::from_utf8_lossy(magic).into_owned());
                let specifier = number::decode(magic).ok_or_else(unknown)?;
                let carrier = binary(specifier.wrapping_sub(BASE)).ok_or_else(unknown)??;
                Self::binary(buffer, carrier, limits)
            }
        }
    }

    fn binary(
        buffer: &mut BytesMut,
        carrier: Carrier,
        limits: &WireLimits,
    ) -> Result<Progress<Self>, Fault> {
        let Some(length) = i32_at(buffer, MAGIC) else {
            return Ok(Progress::Need(MAGIC + 4 - buffer.len()));
        };
        let limit = limits.max_name_bytes + 1;
        let allowed = usize::try_from(length).ok().filter(|length| (1..=limit).contains(length));
        let length = allowed.ok_or(Fault::NameLength { length: i64::from(length), limit })?;
        let start = MAGIC + 4;
        let end = start + length + if carrier == Carrier::Mcast { GROUP } else { 0 };
        if buffer.len() < end {
            return Ok(Progress::Need(end - buffer.len()));
        }
        let head = buffer.split_to(end);
        let name = head.get(start..start + length).unwrap_or_default();
        let name = name.split(|&byte| byte == 0).next().unwrap_or_default();
        let group = match *head.get(start + length..).unwrap_or_default() {
            [a, b, c, d, high, low] => {
                Some(SocketAddrV4::new(Ipv4Addr::new(a, b, c, d), u16::from_be_bytes([high, low])))
            }
            _ => None,
        };
        Ok(Progress::Event(Self::Messages { carrier, sender: Sender::parse(name), group }))
    }

    fn text(
        buffer: &mut BytesMut,
        carrier: Carrier,
        limits: &WireLimits,
    ) -> Result<Progress<Self>, Fault> {
        let limit = limits.max_name_bytes + MAGIC;
        let too_long = |length| {
            let length = i64::try_from(length).unwrap_or(i64::MAX);
            Fault::NameLength { length, limit: limits.max_name_bytes + 1 }
        };
        let Some(end) = buffer.iter().position(|&byte| byte == b'\n') else {
            return match buffer.len() {
                // The line's end may have two bytes.
                length if length > limit + 2 => Err(too_long(length - MAGIC)),
                _ => Ok(Progress::Need(1)),
            };
        };
        let line = text::cut_line(buffer, end);
        if line.len() > limit {
            return Err(too_long(line.len() - MAGIC));
        }
        let sender = Sender::parse(line.get(MAGIC..).unwrap_or_default());
        Ok(Progress::Event(Self::Messages { carrier, sender, group: None }))
    }
}

/// The carrier of a specifier: only bit 7 and the lowest four count.
fn binary(specifier: i32) -> Option<Result<Carrier, Fault>> {
    // 131 is the highest that any carrier has.
    if !(0..=255).contains(&specifier) {
        return None;
    }
    match specifier % 16 {
        3 if specifier & 0x80 != 0 => Some(Ok(Carrier::Tcp)),
        3 => Some(Ok(Carrier::FastTcp)),
        0 => Some(Ok(Carrier::Udp)),
        1 => Some(Ok(Carrier::Mcast)),
        14 => Some(Err(Fault::UnsupportedCarrier("shmem"))),
        _ => None,
    }
}

/// The beginning of a connection that we open, without the group of mcast; empty for mjpeg, which
/// begins with [`super::mjpeg::request`].
///
/// # Errors
/// When the name with its qualifiers is longer than receivers read.
pub fn encode(carrier: Carrier, sender: &Sender, limits: &WireLimits) -> Result<Vec<u8>, Fault> {
    let name = sender.to_string();
    let limit = limits.max_name_bytes;
    let length = name.len() + 1;
    let declared = i32::try_from(length).ok().filter(|_| (2..=limit + 1).contains(&length));
    let Some(declared) = declared else {
        let length = i64::try_from(length).unwrap_or(i64::MAX);
        return Err(Fault::NameLength { length, limit: limit + 1 });
    };
    let magic = match carrier {
        Carrier::Tcp => number::encode(BASE + 131),
        Carrier::FastTcp => number::encode(BASE + 3),
        Carrier::Udp => number::encode(BASE),
        Carrier::Mcast => number::encode(BASE + 1),
        Carrier::UnixStream => *b"UNIX_STR",
        Carrier::UnixStreamAck => *b"UNIX_ACK",
        Carrier::Text => return Ok(format!("CONNECT {name}\r\n").into_bytes()),
        Carrier::TextAck => return Ok(format!("CONNACK {name}\r\n").into_bytes()),
        Carrier::Mjpeg => return Ok(Vec::new()),
    };
    let mut bytes = magic.to_vec();
    bytes.extend(declared.to_le_bytes());
    bytes.extend(name.as_bytes());
    bytes.push(0);
    Ok(bytes)
}

/// The bytes that follow the name on mcast.
pub fn encode_group(group: SocketAddrV4) -> [u8; 6] {
    let [a, b, c, d] = group.ip().octets();
    let [high, low] = group.port().to_be_bytes();
    [a, b, c, d, high, low]
}

/// The answer to a header: a number with a port on the binary carriers, a line on the text ones.
pub fn answer(carrier: Carrier, sender: &Sender, port: u16) -> Vec<u8> {
    match carrier {
        Carrier::Tcp | Carrier::FastTcp | Carrier::Udp => number::encode(i32::from(port)).to_vec(),
        Carrier::Text | Carrier::TextAck => format!("Welcome {}\r\n", sender.name).into_bytes(),
        Carrier::Mcast | Carrier::Mjpeg | Carrier::UnixStream | Carrier::UnixStreamAck => {
            Vec::new()
        }
    }
}

/// Reads the answer to a header that we sent: the number of binary carriers (0 when it is
/// malformed, which YARP overlooks too), 0 for the line of the text ones.
///
/// # Errors
/// When the line does not end.
pub fn read_answer(
    carrier: Carrier,
    buffer: &mut BytesMut,
    limits: &WireLimits,
) -> Result<Progress<i32>, Fault> {
    match carrier {
        Carrier::Mcast | Carrier::Mjpeg | Carrier::UnixStream | Carrier::UnixStreamAck => {
            Ok(Progress::Event(0))
        }
        Carrier::Tcp | Carrier::FastTcp | Carrier::Udp => {
            Ok(match super::take(buffer, number::SIZE) {
                Some(bytes) => Progress::Event(number::decode(&bytes).unwrap_or(0)),
                None => Progress::Need(number::SIZE - buffer.len()),
            })
        }
        Carrier::Text | Carrier::TextAck => Ok(Lines::new(limits).poll(buffer)?.map(|_welcome| 0)),
    }
}

/// Text that a port sends to bytes that begin no carrier, before it closes.
pub const UNKNOWN_HEADER_HELP: &str = "\
* Error. Protocol not found.\r
* Hello. You appear to be trying to communicate with a YARP Port.\r
* The first 8 bytes sent to a YARP Port are critical for identifying the\r
* protocol you wish to speak.\r
* The first 8 bytes you sent were not associated with any particular protocol.\r
* If you are a human, try typing \"CONNECT foo\" followed by a <RETURN>.\r
* The 8 bytes \"CONNECT \" correspond to a simple text-mode protocol.\r
* Goodbye.\r
";
