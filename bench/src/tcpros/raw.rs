//! Bare ends of a topic of ROS 1: a node whose only skill is to send bytes, or to receive them.
//!
//! ```text
//!   master ◀─ register ─ RawPublisher: slave API, listener ══ u32 │ message ══▶ RawSubscriber
//! ```
//!
//! Sockets of the standard library, which block, and one buffer at either end: nothing of what is
//! measured is in them but the forms of headers and of XML-RPC.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use wrapyfi_core::middleware::ros1::header::Header;
use wrapyfi_core::middleware::ros1::xmlrpc::{self, Reply, Value, text};
use wrapyfi_interfaces::ros1::{Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

/// Longest time that a publisher may take to appear, and any answer to come.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Pause between two questions.
const LOOK: Duration = Duration::from_millis(10);

/// Header by which both ends describe a topic.
fn header(node: &str, topic: &str, ros1_type: &str) -> Result<Header> {
    let definition = Types::new(Rules::built_in(), TypeStore::empty()).definition(ros1_type)?;
    Ok(Header::new()
        .with("callerid", node)
        .with("topic", topic)
        .with("type", ros1_type)
        .with("md5sum", definition.md5sum())
        .with("message_definition", definition.text())
        .with("tcp_nodelay", "1"))
}

/// The body of a request or of an answer over HTTP.
fn read_http(stream: &mut TcpStream) -> Result<Vec<u8>> {
    stream.set_read_timeout(Some(TIMEOUT))?;
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte)?;
        head.extend(byte);
    }
    let head = String::from_utf8(head)?.to_ascii_lowercase();
    let length = head.lines().find_map(|line| line.strip_prefix("content-length:"));
    let mut body = vec![0; length.context("no length")?.trim().parse()?];
    stream.read_exact(&mut body)?;
    Ok(body)
}

/// Calls a method of the node or master at `uri`.
fn call(uri: &str, method: &str, params: Vec<Value>) -> Result<Value> {
    let address = uri.trim_start_matches("http://").trim_end_matches('/');
    let mut stream = TcpStream::connect(address).with_context(|| uri.to_owned())?;
    let body = xmlrpc::encode_call(method, params)?;
    let length = body.len();
    let head = format!("POST / HTTP/1.1\r\nHost: {address}\r\nContent-Type: text/xml\r\n");
    stream.write_all(format!("{head}Content-Length: {length}\r\n\r\n{body}").as_bytes())?;
    let Reply { status, text, value } = xmlrpc::decode_reply(&read_http(&mut stream)?)?;
    ensure!(status == xmlrpc::SUCCESS, "{method} at {uri}: {text}");
    Ok(value)
}

/// Answers every call with the way to the data, until the process ends; where it is asked.
fn slave(data_port: u16) -> Result<String> {
    let api = TcpListener::bind(("127.0.0.1", 0))?;
    let uri = format!("http://127.0.0.1:{}/", api.local_addr()?.port());
    std::thread::spawn(move || {
        for mut stream in api.incoming().map_while(Result::ok) {
            if read_http(&mut stream).is_err() {
                continue;
            }
            let way = vec![text("TCPROS"), text("127.0.0.1"), Value::Integer(data_port.into())];
            let reply = Reply::success("", Value::Array(way));
            let Ok(body) = xmlrpc::encode_reply(reply) else { continue };
            let length = body.len();
            let head = "HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nConnection: close";
            let answer = format!("{head}\r\nContent-Length: {length}\r\n\r\n{body}");
            // The master may have given up.
            _ = stream.write_all(answer.as_bytes());
        }
    });
    Ok(uri)
}

/// Reads a header with its size.
fn read_header(stream: &mut TcpStream) -> Result<Header> {
    let mut size = [0; 4];
    stream.read_exact(&mut size)?;
    let mut body = vec![0; Header::declared_size(size)?];
    stream.read_exact(&mut body)?;
    let header = Header::decode(&body)?;
    match header.get("error") {
        Some(error) => bail!("refused: {error}"),
        None => Ok(header),
    }
}

/// A topic that is sent.
pub(super) struct RawPublisher {
    subscribers: Arc<Mutex<Vec<TcpStream>>>,
}

impl RawPublisher {
    pub(super) fn open(master: &str, topic: &str, ros1_type: &str) -> Result<Self> {
        let node = format!("/source{}", std::process::id());
        let own = header(&node, topic, ros1_type)?.encode()?;
        let data = TcpListener::bind(("127.0.0.1", 0))?;
        let uri = slave(data.local_addr()?.port())?;
        let subscribers = Arc::<Mutex<Vec<TcpStream>>>::default();
        let all = Arc::clone(&subscribers);
        std::thread::spawn(move || {
            for mut stream in data.incoming().map_while(Result::ok) {
                let greeted = read_header(&mut stream).is_ok()
                    && stream.set_nodelay(true).is_ok()
                    && stream.write_all(&own).is_ok();
                if greeted {
                    lock(&all).push(stream);
                }
            }
        });
        let params = vec![text(node), text(topic), text(ros1_type), text(uri)];
        call(master, "registerPublisher", params)?;
        Ok(Self { subscribers })
    }

    /// Sends a message with its size before it; how many took it.
    pub(super) fn send(&self, framed: &[u8]) -> usize {
        let mut subscribers = lock(&self.subscribers);
        subscribers.retain_mut(|stream| stream.write_all(framed).is_ok());
        subscribers.len()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A topic that is received, from its first publisher.
pub(super) struct RawSubscriber {
    stream: TcpStream,
    message: Vec<u8>,
}

impl RawSubscriber {
    /// Waits until there is a publisher.
    pub(super) fn open(master: &str, topic: &str, ros1_type: &str) -> Result<Self> {
        let node = format!("/sink{}", std::process::id());
        let uri = slave(0)?;
        let deadline = Instant::now() + TIMEOUT;
        let publisher = loop {
            let params = vec![text(&node), text(topic), text(ros1_type), text(&uri)];
            if let Value::Array(found) = call(master, "registerSubscriber", params)?
                && let Some(Value::String(publisher)) = found.first()
            {
                break publisher.clone();
            }
            ensure!(Instant::now() < deadline, "nobody publishes {topic}");
            std::thread::sleep(LOOK);
        };
        let protocols = Value::Array(vec![Value::Array(vec![text("TCPROS")])]);
        let params = vec![text(&node), text(topic), protocols];
        let way = call(&publisher, "requestTopic", params)?;
        let address = match &way {
            Value::Array(parts) => match parts.as_slice() {
                [_, Value::String(host), Value::Integer(port)] => format!("{host}:{port}"),
                other => bail!("{publisher} names no way: {other:?}"),
            },
            other => bail!("{publisher} names no way: {other:?}"),
        };
        let mut stream = TcpStream::connect(&address).context(address)?;
        stream.set_nodelay(true)?;
        // Whatever a relay calls what it passes on.
        let own = header(&node, topic, ros1_type)?.with("type", "*").with("md5sum", "*");
        stream.write_all(&own.encode()?)?;
        read_header(&mut stream)?;
        Ok(Self { stream, message: Vec::new() })
    }

    /// The next message; `None` after `patience`.
    pub(super) fn next(&mut self, patience: Duration) -> Result<Option<&[u8]>> {
        self.stream.set_read_timeout(Some(patience))?;
        match self.stream.peek(&mut [0]) {
            Ok(0) => bail!("the publisher closed the connection"),
            Ok(_) => {}
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Ok(None);
            }
            Err(error) => return Err(error.into()),
        }
        self.stream.set_read_timeout(Some(TIMEOUT))?;
        let mut size = [0; 4];
        self.stream.read_exact(&mut size)?;
        self.message.resize(usize::try_from(u32::from_le_bytes(size))?, 0);
        self.stream.read_exact(&mut self.message)?;
        Ok(Some(&self.message))
    }
}
