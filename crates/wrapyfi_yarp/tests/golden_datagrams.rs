//! Datagrams recorded from real YARP, with our ports in the place of either side.

use std::net::SocketAddrV4;
use std::sync::Arc;

use crate::golden::conversation::{Part, TIMEOUT, datagrams, expect, expect_end, parts};
use crate::input::{Connections, InputPort, input};
use crate::names::NameTable;
use bytes::Bytes;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use wrapyfi_yarp::WireLimits;
use wrapyfi_yarp::port::{Message, Network, NetworkOptions, Port, PortOptions, PortPayload};
use wrapyfi_yarp::wire::datagram::Assembler;
use wrapyfi_yarp::wire::{Body, Command, header, number};

const UDP: [&str; 4] = ["udp_basic", "udp_envelope", "wrapyfi_native_udp", "rpc_udp"];
const MCAST: [&str; 2] = ["mcast_basic", "mcast_envelope"];

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(TIMEOUT, future).await.expect("in time")
}

fn network(names: NameTable) -> Network {
    let (listen, names) = ([127, 0, 0, 1].into(), Arc::new(names));
    Network::new(NetworkOptions { listen, names, ..NetworkOptions::default() })
}

async fn reader() -> InputPort {
    input(&network(NameTable::new()), "/golden/dst", 100).await
}

/// The messages of a file: envelope and payload.
fn messages(name: &str) -> Vec<(Option<Bytes>, Bytes)> {
    let mut assembler = Assembler::new(&WireLimits::default());
    let all = datagrams(&format!("{name}.json"));
    let mut found = Vec::new();
    for datagram in all {
        let Some(incoming) = assembler.push(&datagram).unwrap() else { continue };
        let (Command::Data { envelope, .. }, Body::Binary(bytes)) =
            (incoming.command, incoming.body)
        else {
            panic!("{name}")
        };
        found.push((envelope, bytes));
    }
    assert!(!found.is_empty(), "{name}");
    found
}

fn header_of(name: &str) -> Vec<u8> {
    let Part::Client(header) = parts(&format!("{name}.json")).remove(0) else { panic!("{name}") };
    header
}

async fn has_received(port: &InputPort, name: &str) {
    for expected in messages(name) {
        let received = within(port.recv()).await.unwrap();
        assert_eq!((received.envelope, received.payload.bytes), expected, "{name}");
    }
    assert_eq!(port.fault_counts().all(), [].into(), "{name}");
}

#[tokio::test]
async fn our_reader_takes_the_datagrams_of_yarp() {
    for name in UDP {
        let port = reader().await;
        let mut stream = TcpStream::connect(port.address()).await.unwrap();
        stream.write_all(&header_of(name)).await.unwrap();
        let mut answer = [0; 8];
        within(stream.read_exact(&mut answer)).await.unwrap();
        expect_end(&mut stream, name).await;
        let to = u16::try_from(number::decode(&answer).unwrap()).unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        within(port.wait_for_inputs(1)).await;
        for datagram in datagrams(&format!("{name}.json")) {
            socket.send_to(&datagram, ("127.0.0.1", to)).await.unwrap();
        }
        has_received(&port, name).await;
    }
}

#[tokio::test]
async fn our_reader_joins_the_group_of_yarp() {
    for name in MCAST {
        let port = reader().await;
        let steps = parts(&format!("{name}.json"));
        let Part::Client(group) = &steps[1] else { panic!("{name}") };
        // The recorded group, with a number of our own: other tests may run beside this one.
        let number = UdpSocket::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap().port();
        let ip: [u8; 4] = group[..4].try_into().unwrap();
        let to = SocketAddrV4::new(ip.into(), number);
        let mut stream = TcpStream::connect(port.address()).await.unwrap();
        stream.write_all(&header_of(name)).await.unwrap();
        stream.write_all(&header::encode_group(to)).await.unwrap();
        expect_end(&mut stream, name).await;
        within(port.wait_for_inputs(1)).await;
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        for datagram in datagrams(&format!("{name}.json")) {
            socket.send_to(&datagram, to).await.unwrap();
        }
        has_received(&port, name).await;
    }
}

/// A writer of the recorded name, and what connects it to a listener in our hands.
async fn writer(name: &str) -> (Port, TcpListener) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/golden/dst", listener.local_addr().unwrap());
    let header = header_of(name);
    let own = std::str::from_utf8(&header[12..header.len() - 1]).unwrap();
    let port = network(names).open_output(own, &PortOptions::default()).await.unwrap();
    (port, listener)
}

/// Writes what was recorded; the datagrams must be those that were recorded.
async fn write(port: &Port, socket: &UdpSocket, name: &str) {
    for (envelope, payload) in messages(name) {
        let written = port.write(Message {
            payload: PortPayload::object(payload),
            envelope,
            ..Message::default()
        });
        assert_eq!((written.targets, written.dropped), (1, 0), "{name}");
    }
    let mut buffer = vec![0; 65_536];
    for expected in datagrams(&format!("{name}.json")) {
        let size = within(socket.recv(&mut buffer)).await.unwrap();
        assert_eq!(buffer[..size], expected[..], "{name}");
    }
}

/// Asserts that a sender of datagrams says goodbye when it closes.
async fn expect_goodbye(listener: &TcpListener, port: Port, name: &str) {
    let own = port.name().to_owned();
    let closing = tokio::spawn(port.close());
    let (mut stream, _) = within(listener.accept()).await.unwrap();
    expect(&mut stream, b"CONNECT admin\r\n", false, name).await;
    stream.write_all(b"Welcome admin\r\n").await.unwrap();
    expect(&mut stream, format!("~{own}\r\nq\r\n").as_bytes(), false, name).await;
    stream.write_all(b"Removing connection from it to us\r\n").await.unwrap();
    within(closing).await.unwrap();
}

#[tokio::test]
async fn our_writer_sends_the_datagrams_of_yarp() {
    for name in ["udp_basic", "udp_envelope", "wrapyfi_native_udp"] {
        let (port, listener) = writer(name).await;
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let number = socket.local_addr().unwrap().port();
        let what = name.to_owned();
        let accepting = tokio::spawn(async move {
            let (mut stream, peer) = listener.accept().await.unwrap();
            expect(&mut stream, &header_of(&what), false, &what).await;
            stream.write_all(&number::encode(i32::from(number))).await.unwrap();
            (listener, peer)
        });
        within(port.connect("udp://golden/dst")).await.unwrap();
        let (listener, peer) = within(accepting).await.unwrap();
        socket.connect(("127.0.0.1", peer.port())).await.unwrap(); // the same number, as YARP's
        write(&port, &socket, name).await;
        expect_goodbye(&listener, port, name).await;
    }
}

#[tokio::test]
async fn our_writer_sends_to_a_group_as_yarp() {
    for name in MCAST {
        let (port, listener) = writer(name).await;
        let what = name.to_owned();
        let accepting = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            expect(&mut stream, &header_of(&what), false, &what).await;
            let mut group = [0; 6];
            stream.read_exact(&mut group).await.unwrap();
            // The table of names has groups of its own; their form is the recorded one.
            assert_eq!(group[..3], [0xe0, 1, 1]);
            let [a, b, c, d, high, low] = group;
            (listener, SocketAddrV4::new([a, b, c, d].into(), u16::from_be_bytes([high, low])))
        });
        within(port.connect("mcast://golden/dst")).await.unwrap();
        let (listener, group) = within(accepting).await.unwrap();
        let socket =
            socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None).unwrap();
        socket.set_reuse_address(true).unwrap();
        socket.set_nonblocking(true).unwrap();
        socket.bind(&std::net::SocketAddr::V4(group).into()).unwrap();
        socket.join_multicast_v4(group.ip(), &[127, 0, 0, 1].into()).unwrap();
        let socket = UdpSocket::from_std(socket.into()).unwrap();
        write(&port, &socket, name).await;
        expect_goodbye(&listener, port, name).await;
    }
}
