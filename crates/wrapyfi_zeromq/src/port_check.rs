//! Finds out what has a port: the first bytes of ZMTP 3, spoken over plain TCP.
//!
//! ```text
//!   we:   greeting (64 bytes) ─▶   READY Socket-Type=SUB ─▶  close
//!   peer: ◀─ greeting (64 bytes)   ◀─ READY Socket-Type=XPUB
//! ```
//!
//! A ZeroMQ socket cannot tell this: it reports neither the peer's type nor why a handshake failed.

use std::fmt;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::zmtp::{self, Breach, Frame, GREETING, ready, short_text, socket_type, split_frame};

/// Time for the whole conversation.
pub(super) const TIMEOUT: Duration = Duration::from_secs(1);

/// A READY command is a few properties; no program is believed who announces more.
const MAX_COMMAND: usize = 4096;

/// Kind of program that answers on a port.
///
/// ```
/// use wrapyfi_zeromq::PortHolder;
/// let answer = PortHolder::Socket("REP".into());
/// assert_eq!(answer.to_string(), "a ZeroMQ socket of type REP");
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PortHolder {
    /// A ZeroMQ socket of this type (`XPUB`, `REP`, …).
    Socket(String),
    /// A ZeroMQ socket that wants this security mechanism, of which no type is known.
    Secured(String),
    /// A ZeroMQ socket that refused us, with its words.
    Refused(String),
    /// Something that is not ZeroMQ, or older than ZMTP 3.
    NotZeroMq,
    /// A program that accepts connections and sends nothing.
    Silent,
    /// No connection at all, for this reason.
    Nobody(String),
}

impl fmt::Display for PortHolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socket(kind) => write!(f, "a ZeroMQ socket of type {kind}"),
            Self::Secured(mechanism) if mechanism == zmtp::NULL => {
                f.write_str("a ZeroMQ socket without CURVE, which is configured here")
            }
            Self::Secured(mechanism) => {
                write!(f, "a ZeroMQ socket that wants {mechanism} security")
            }
            Self::Refused(reason) => write!(f, "a ZeroMQ socket that refuses us ({reason})"),
            Self::NotZeroMq => f.write_str("something that does not speak ZeroMQ (ZMTP 3)"),
            Self::Silent => write!(f, "something that does not answer within {TIMEOUT:?}"),
            Self::Nobody(reason) => write!(f, "nothing that accepts connections ({reason})"),
        }
    }
}

impl PortHolder {
    /// Remedy where this is not the broker that is looked for; `settings` have its ports.
    pub(crate) fn remedy(&self, settings: &[&str; 2]) -> String {
        match self {
            Self::Secured(mechanism) if mechanism == zmtp::NULL => {
                "if it is one, it has to start with keys, too, or this program without".to_owned()
            }
            Self::Secured(mechanism) if mechanism == zmtp::CURVE => {
                "if it is one, set WRAPYFI_ZEROMQ_CURVE_SERVER_KEY to its public key and \
                 WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE to a key among its clients (or `endpoints: zeromq: curve`)"
                    .to_owned()
            }
            _ => format!("stop that program, or choose other ports ({})", settings.join(", ")),
        }
    }
}

/// Asks `address`, in the role of a socket of type `ours` with that mechanism.
pub(super) fn ask_port(address: SocketAddr, ours: &str, mechanism: &str) -> PortHolder {
    let deadline = Instant::now() + TIMEOUT;
    let mut stream = match TcpStream::connect_timeout(&address, TIMEOUT) {
        Ok(stream) => Limited { stream, deadline },
        Err(error) => return PortHolder::Nobody(error.to_string()),
    };
    ask(&mut stream, ours, mechanism)
}

/// The answer on a connection, to a socket of type `ours` with that mechanism.
pub(super) fn ask(stream: &mut (impl Read + Write), ours: &str, mechanism: &str) -> PortHolder {
    talk(stream, ours, mechanism).unwrap_or_else(|error| match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => PortHolder::Silent,
        _ => PortHolder::NotZeroMq,
    })
}

fn talk(stream: &mut (impl Read + Write), ours: &str, wanted: &str) -> std::io::Result<PortHolder> {
    stream.write_all(&zmtp::greeting(wanted, false))?;
    // The first ten bytes decide: who does not start so will not send sixty-four.
    let mut signature = [0; 10];
    stream.read_exact(&mut signature)?;
    if !matches!(signature, [0xff, .., 0x7f]) {
        return Ok(PortHolder::NotZeroMq);
    }
    let mut rest = [0; GREETING - 10];
    stream.read_exact(&mut rest)?;
    let [major, _minor, mechanism @ ..] = &rest;
    if *major < 3 {
        return Ok(PortHolder::NotZeroMq);
    }
    let mechanism: Vec<u8> = mechanism.iter().copied().take(20).take_while(|&b| b != 0).collect();
    if wanted != zmtp::NULL || mechanism != zmtp::NULL.as_bytes() {
        return Ok(PortHolder::Secured(printable(&mechanism)));
    }
    stream.write_all(&ready(ours))?;
    read_ready(stream)
}

fn read_ready(stream: &mut impl Read) -> std::io::Result<PortHolder> {
    let (mut bytes, mut next) = (Vec::new(), [0; 1]);
    loop {
        stream.read_exact(&mut next)?;
        bytes.extend(next);
        match split_frame(&bytes, MAX_COMMAND) {
            Ok(None) => {}
            Ok(Some((Frame { is_command: true, body, .. }, _))) => {
                return Ok(understand(body).unwrap_or(PortHolder::NotZeroMq));
            }
            Ok(Some(_)) | Err(Breach) => return Ok(PortHolder::NotZeroMq),
        }
    }
}

/// Reads the body of a READY or ERROR command.
fn understand(body: &[u8]) -> Option<PortHolder> {
    let (name, properties) = short_text(body)?;
    if name == b"ERROR" {
        let (reason, _) = short_text(properties)?;
        return Some(PortHolder::Refused(printable(reason)));
    }
    if name != b"READY" {
        return None;
    }
    socket_type(properties).map(|kind| PortHolder::Socket(printable(kind)))
}

/// Foreign bytes, fit for a line of log.
fn printable(bytes: &[u8]) -> String {
    bytes.escape_ascii().to_string().chars().take(64).collect()
}

/// A stream with one deadline for everything.
struct Limited {
    stream: TcpStream,
    deadline: Instant,
}

impl Limited {
    fn left(&self) -> std::io::Result<Duration> {
        match self.deadline.saturating_duration_since(Instant::now()) {
            Duration::ZERO => Err(ErrorKind::TimedOut.into()),
            left => Ok(left),
        }
    }
}

impl Read for Limited {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(buffer)
    }
}

impl Write for Limited {
    fn write(&mut self, buffer: &[u8]) -> std::io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(buffer)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.stream.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    fn ask_socket(socket_type: zmq::SocketType, ours: &str) -> PortHolder {
        let context = zmq::Context::new();
        let socket = context.socket(socket_type).unwrap();
        socket.bind("tcp://127.0.0.1:*").unwrap();
        let endpoint = socket.get_last_endpoint().unwrap().unwrap();
        ask_port(endpoint.trim_start_matches("tcp://").parse().unwrap(), ours, zmtp::NULL)
    }

    #[test]
    fn zeromq_sockets_tell_their_type() {
        assert_eq!(ask_socket(zmq::XPUB, "SUB"), PortHolder::Socket("XPUB".into()));
        assert_eq!(ask_socket(zmq::XSUB, "PUB"), PortHolder::Socket("XSUB".into()));
        assert_eq!(ask_socket(zmq::REP, "SUB"), PortHolder::Socket("REP".into()));
    }

    #[test]
    fn other_programs_are_told_apart() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        assert_eq!(ask_port(address, "SUB", zmtp::NULL), PortHolder::Silent);

        let server = std::thread::spawn(move || {
            let (_first, _) = listener.accept().unwrap();
            let (mut second, _) = listener.accept().unwrap();
            second.write_all(b"SSH-2.0-OpenSSH_9.6\r\n").unwrap();
        });
        assert_eq!(ask_port(address, "SUB", zmtp::NULL), PortHolder::NotZeroMq);
        server.join().unwrap();
        assert!(matches!(ask_port(address, "SUB", zmtp::NULL), PortHolder::Nobody(_)));
    }

    #[test]
    fn broken_commands_are_not_zeromq() {
        for bytes in [
            &b"\x05READY"[..],
            b"\x05READY\x0bSocket-Type\xff\xff\xff\xffX",
            b"\x05READY\xff",
            b"\x04PING",
            b"",
        ] {
            assert_eq!(understand(bytes), None, "{bytes:?}");
        }
        assert_eq!(understand(b"\x05ERROR\x02no"), Some(PortHolder::Refused("no".into())));
        let endless = [6, 0xff, 0, 0, 0, 0, 0, 0, 0];
        assert_eq!(read_ready(&mut &endless[..]).unwrap(), PortHolder::NotZeroMq);
    }
}
