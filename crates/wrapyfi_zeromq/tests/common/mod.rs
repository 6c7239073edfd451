//! Raw ZeroMQ peers, as Python Wrapyfi uses them, and waiting for conditions.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use wrapyfi_conformance::TIMEOUT;
use wrapyfi_zeromq::{BrokerMode, ZeroMqConfig};

pub const MONITOR: &str = "ZEROMQ/CONNECTIONS";

/// A broker on free ports, or an instance that runs it.
pub fn any_ports() -> ZeroMqConfig {
    ZeroMqConfig { pub_port: 0, sub_port: 0, ..ZeroMqConfig::default() }
}

/// An instance that uses the broker on these ports.
pub fn foreign(pub_port: u16, sub_port: u16) -> ZeroMqConfig {
    ZeroMqConfig { pub_port, sub_port, broker: BrokerMode::Foreign, ..ZeroMqConfig::default() }
}

/// A socket as pyzmq opens it: nothing set but that closing does not wait.
pub fn peer(context: &zmq::Context, kind: zmq::SocketType, port: u16) -> zmq::Socket {
    let socket = context.socket(kind).unwrap();
    socket.set_linger(0).unwrap();
    socket.set_rcvtimeo(i32::try_from(TIMEOUT.as_millis()).unwrap()).unwrap();
    socket.connect(&format!("tcp://127.0.0.1:{port}")).unwrap();
    socket
}

pub fn subscriber(context: &zmq::Context, port: u16, topic: &str) -> zmq::Socket {
    let socket = peer(context, zmq::SUB, port);
    socket.set_subscribe(topic.as_bytes()).unwrap();
    socket
}

/// A socket bound to a free port, and the port.
pub fn bound(context: &zmq::Context, kind: zmq::SocketType) -> (zmq::Socket, u16) {
    let socket = context.socket(kind).unwrap();
    socket.set_linger(0).unwrap();
    socket.bind("tcp://127.0.0.1:*").unwrap();
    let endpoint = socket.get_last_endpoint().unwrap().unwrap();
    let port = endpoint.rsplit(':').next().unwrap().parse().unwrap();
    (socket, port)
}

/// Reads counts until `topic` has `count`.
#[track_caller]
pub fn wait_for_count(monitor: &zmq::Socket, topic: &str, count: u64) {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let frames = monitor.recv_multipart(0).expect("counts are repeated");
        assert_eq!(frames.len(), 2);
        assert_eq!(frames[0], MONITOR.as_bytes());
        let counts: serde_json::Value = serde_json::from_slice(&frames[1]).unwrap();
        if counts[topic] == count {
            return;
        }
        assert!(Instant::now() < deadline, "{topic} never had {count}: {counts}");
    }
}

/// True when both ports can be bound again.
pub fn is_free(port: u16) -> bool {
    std::net::TcpListener::bind(("127.0.0.1", port)).is_ok()
}

/// A cable to a port of this machine. While it is cut, connections through it stay open and carry nothing, and no new
/// ones stand.
pub struct Cable {
    /// The port that leads to the other.
    pub port: u16,
    is_cut: Arc<AtomicBool>,
}

impl Cable {
    pub fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let cable = listener.local_addr().unwrap().port();
        let is_cut = Arc::new(AtomicBool::new(false));
        let cut = Arc::clone(&is_cut);
        std::thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                if cut.load(Relaxed) {
                    continue;
                }
                let Ok(far) = TcpStream::connect(("127.0.0.1", port)) else { continue };
                for (from, to) in [(&near, &far), (&far, &near)] {
                    let (from, to) = (from.try_clone().unwrap(), to.try_clone().unwrap());
                    let cut = Arc::clone(&cut);
                    std::thread::spawn(move || carry(from, to, &cut));
                }
            }
        });
        Self { port: cable, is_cut }
    }

    pub fn cut(&self, is_cut: bool) {
        self.is_cut.store(is_cut, Relaxed);
    }
}

/// Carries bytes until an end gives up; the other end is told, which lets it connect again.
fn carry(mut from: TcpStream, mut to: TcpStream, is_cut: &AtomicBool) {
    let mut bytes = [0; 4096];
    while let Ok(read @ 1..) = from.read(&mut bytes) {
        if !is_cut.load(Relaxed) && to.write_all(&bytes[..read]).is_err() {
            break;
        }
    }
    to.shutdown(Shutdown::Both).ok();
}

/// A connection that says of itself that it is a socket of this type.
pub fn raw_peer(port: u16, kind: &str) -> TcpStream {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let mut greeting = vec![0xff, 0, 0, 0, 0, 0, 0, 0, 1, 0x7f, 3, 0];
    greeting.extend(b"NULL");
    greeting.resize(64, 0);
    let property = [b"\x05READY\x0bSocket-Type\0\0\0", &[kind.len() as u8][..], kind.as_bytes()];
    let ready = property.concat();
    stream.write_all(&[greeting, vec![4, ready.len() as u8], ready].concat()).unwrap();
    stream
}

/// Sends frames of one message until the connection ends; number of their bytes.
pub fn send_without_end(stream: &mut TcpStream, frame: usize, most: usize) -> usize {
    let header = [&[3][..], &(frame as u64).to_be_bytes()].concat();
    let frame = [header, vec![b'x'; frame]].concat();
    let mut sent = 0;
    while sent < most && stream.write_all(&frame).is_ok() {
        sent += frame.len();
    }
    sent
}
