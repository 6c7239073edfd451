//! Carrier `unix_stream`: as recorded from real YARP with our ports in the place of either side, and peers
//! that break its rules.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use crate::golden::{file, hex};
use crate::input::{Connections, InputPort, input};
use crate::names::NameTable;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UnixListener, UnixStream};
use wrapyfi_yarp::name::Environment;
use wrapyfi_yarp::port::{Answer, Network, NetworkOptions, PortOptions, RpcError, Timeouts};
use wrapyfi_yarp::{Bottle, Dialect, WireLimits};

const TIMEOUT: Duration = Duration::from_secs(20);

/// Bytes that one side of a recording sends by one socket.
fn said(name: &str, direction: &str, via: &str) -> Vec<u8> {
    let stream = file(&format!("{name}.json"))["stream"].as_array().unwrap().clone();
    let meant = stream.iter().filter(|part| part["dir"] == direction && part["via"] == via);
    meant.flat_map(|part| hex(part["hex"].as_str().unwrap())).collect()
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(TIMEOUT, future).await.expect("in time")
}

fn network(folder: &Path, names: NameTable) -> Network {
    let environment = Environment::default().with("YARP_RUNTIME_DIR", folder);
    let timeouts = Timeouts {
        handshake: Duration::from_millis(300),
        close: Duration::from_millis(300),
        ..Timeouts::default()
    };
    let (listen, names) = ([127, 0, 0, 1].into(), Arc::new(names));
    let options =
        NetworkOptions { listen, names, environment, timeouts, ..NetworkOptions::default() };
    Network::new(options)
}

fn bottle(text: &str) -> Bottle {
    Bottle::from_text(text.as_bytes(), &WireLimits::default()).unwrap()
}

fn place(folder: &Path, receiver: SocketAddr, sender: SocketAddr) -> PathBuf {
    folder.join(format!("{}_{}.sock", receiver.port(), sender.port()))
}

/// A sender that has met the port at `address`.
async fn meet(folder: &Path, address: SocketAddr, header: &[u8]) -> UnixStream {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let path = place(folder, address, stream.local_addr().unwrap());
    stream.write_all(header).await.unwrap();
    within(async {
        loop {
            match UnixStream::connect(&path).await {
                Ok(stream) => return stream,
                Err(_) => tokio::task::yield_now().await,
            }
        }
    })
    .await
}

/// A receiver that meets who connects: the header that came, and its end of the socket.
async fn receive(folder: &Path, listener: &TcpListener, header: usize) -> (Vec<u8>, UnixStream) {
    let (mut stream, peer) = listener.accept().await.unwrap();
    let mut bytes = vec![0; header];
    stream.read_exact(&mut bytes).await.unwrap();
    let bound = UnixListener::bind(place(folder, listener.local_addr().unwrap(), peer)).unwrap();
    drop(stream);
    (bytes, bound.accept().await.unwrap().0)
}

async fn counted(port: &InputPort, reason: &str) {
    within(async {
        while port.fault_counts().get(reason) == 0 {
            tokio::task::yield_now().await;
        }
    })
    .await;
}

#[tokio::test]
async fn our_reader_reads_what_yarp_wrote() {
    let folder = tempfile::tempdir().unwrap();
    let port = input(&network(folder.path(), NameTable::new()), "/dst", 8).await;
    let header = said("unix_stream_write", "c2s", "tcp");
    let mut stream = meet(folder.path(), port.address(), &header).await;
    within(port.wait_for_inputs(1)).await;
    assert_eq!(port.status()[0].carrier, "unix_stream");
    for byte in said("unix_stream_write", "c2s", "unix") {
        stream.write_all(&[byte]).await.unwrap();
    }
    for text in ["hello 1 2.5", "(1 2) foo"] {
        let received = within(port.recv()).await.unwrap();
        assert_eq!((&*received.from, received.bottle().unwrap()), ("/src", bottle(text)));
    }
    // It said goodbye: nothing comes back, and nothing is left.
    let mut rest = Vec::new();
    assert_eq!(within(stream.read_to_end(&mut rest)).await.unwrap(), 0);
    assert_eq!(port.fault_counts().all(), [].into());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[tokio::test]
async fn a_float_of_yarp_4_shows_its_dialect() {
    // A message of v4_tcp_basic without its index, twice: [3.25].
    let message =
        hex("120000007e0000014420343320313730303030303030302e350014010000010000000000000000000a40");
    let folder = tempfile::tempdir().unwrap();
    let port = input(&network(folder.path(), NameTable::new()), "/dst", 8).await;
    let header = said("unix_stream_write", "c2s", "tcp");
    let mut stream = meet(folder.path(), port.address(), &header).await;
    stream.write_all(&message.repeat(2)).await.unwrap();
    for _ in 0..2 {
        let payload = within(port.recv()).await.unwrap().payload;
        let read = payload.to_bottle(Dialect::V4, &WireLimits::default()).unwrap();
        assert_eq!(read, bottle("3.25"));
    }
}

#[tokio::test]
async fn our_writer_writes_as_yarp() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/dst", listener.local_addr().unwrap());
    let network = network(folder.path(), names);
    let writer = network.open_output("/src", &PortOptions::default()).await.unwrap();
    let header = said("unix_stream_write", "c2s", "tcp");
    let (connected, (began, mut stream)) = tokio::join!(
        writer.connect("unix_stream://dst"),
        receive(folder.path(), &listener, header.len())
    );
    connected.unwrap();
    assert_eq!(began, header);
    for text in ["hello 1 2.5", "(1 2) foo"] {
        writer.write_bottle(&bottle(text)).unwrap();
    }
    within(writer.close()).await;
    let mut written = Vec::new();
    within(stream.read_to_end(&mut written)).await.unwrap();
    assert_eq!(written, said("unix_stream_write", "c2s", "unix"));
}

#[tokio::test]
async fn requests_are_acknowledged_as_by_yarp() {
    let name = "unix_stream_ack_rpc";
    let [header, request, reply] = [("c2s", "tcp"), ("c2s", "unix"), ("s2c", "unix")]
        .map(|(direction, via)| said(name, direction, via));
    let folder = tempfile::tempdir().unwrap();
    // YARP's client, our server.
    let names = network(folder.path(), NameTable::new());
    let echo = async |request: wrapyfi_yarp::port::Received, _| {
        request.bottle().map_or(Answer::Nothing, Answer::Bottle)
    };
    let server = names.serve("/far/in", &PortOptions::default(), echo).await.unwrap();
    let mut stream = meet(folder.path(), server.address(), &header).await;
    stream.write_all(&request).await.unwrap();
    let mut answer = vec![0; reply.len()];
    within(stream.read_exact(&mut answer)).await.unwrap();
    assert_eq!(answer, reply);
    // Our client, YARP's server.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/far/in", listener.local_addr().unwrap());
    let network = network(folder.path(), names);
    let client = network.open_rpc_client("/near", &PortOptions::default()).await.unwrap();
    let (connected, (began, mut stream)) = tokio::join!(
        client.connect("unix_stream+ack://far/in"),
        receive(folder.path(), &listener, header.len())
    );
    connected.unwrap();
    assert_eq!(began, header);
    let text = Bottle::from(vec!["x".repeat(1024).into()]);
    let answered = async {
        let mut asked = vec![0; request.len()];
        stream.read_exact(&mut asked).await.unwrap();
        assert_eq!(asked, request);
        stream.write_all(&reply).await.unwrap();
        // Acknowledged, and nothing said.
        stream.read_exact(&mut asked).await.unwrap();
        stream.write_all(b"ACK\0").await.unwrap();
    };
    let asked = async {
        assert_eq!(client.call(&text, TIMEOUT).await.unwrap().as_ref(), Some(&text));
        assert_eq!(client.call(&text, TIMEOUT).await.unwrap(), None);
    };
    within(async { tokio::join!(answered, asked) }).await;
}

#[tokio::test]
async fn replies_that_are_cut_or_none_are_errors() {
    let cut = b"\x04\x01\0\0\x01\0\0\0\0\x04\0\0xx";
    for (answer, what) in [
        (&cut[..], "the peer closed the connection"),
        (b"", "the peer closed the connection"),
        (b"garbage!", "none of YARP's"),
        (b"\x04\x01\0\0\0\0\0\0NAK\0", "where an acknowledgement must"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let names = NameTable::new().with("/server", listener.local_addr().unwrap());
        let network = network(folder.path(), names);
        let client = network.open_rpc_client("/near", &PortOptions::default()).await.unwrap();
        let (connected, (_, mut stream)) = tokio::join!(
            client.connect("unix_stream+ack://server"),
            receive(folder.path(), &listener, 24)
        );
        connected.unwrap();
        let ended = async {
            let mut request = [0; 8 + 12];
            stream.read_exact(&mut request).await.unwrap();
            stream.write_all(answer).await.unwrap();
            drop(stream);
        };
        let request = bottle("1");
        let (asked, ()) = tokio::join!(client.call(&request, TIMEOUT), ended);
        let Err(error @ RpcError::Link { .. }) = asked else { panic!("{what}: {asked:?}") };
        assert!(error.to_string().contains(what), "{error}");
    }
}

#[tokio::test]
async fn what_a_reader_cannot_trust_is_closed_and_counted() {
    for (bytes, reason) in [
        (&b"\0\0\0\0!D\0\x01"[..], "bad_command"),
        (b"\0\0\0\0~D\0\x01\x01\0\0\0\0\0\0\0", "bad_payload"),
        (b"\0\0\0\0~D\0\x01\0\x01\0\0\xff\xff\xff\x7f", "bad_payload"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let port = input(&network(folder.path(), NameTable::new()), "/dst", 8).await;
        let header = said("unix_stream_write", "c2s", "tcp");
        let mut stream = meet(folder.path(), port.address(), &header).await;
        stream.write_all(bytes).await.unwrap();
        counted(&port, reason).await;
        let mut rest = Vec::new();
        within(stream.read_to_end(&mut rest)).await.ok();
        assert!(rest.is_empty() && port.received() == 0, "{reason}");
    }
}

#[tokio::test]
async fn a_sender_that_does_not_come_is_given_up_and_its_socket_removed() {
    let folder = tempfile::tempdir().unwrap();
    let port = input(&network(folder.path(), NameTable::new()), "/dst", 8).await;
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    stream.write_all(&said("unix_stream_write", "c2s", "tcp")).await.unwrap();
    counted(&port, "handshake_timeout").await;
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[tokio::test]
async fn a_place_where_ports_cannot_meet_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let taken = folder.path().join("file");
    std::fs::write(&taken, "not a folder").unwrap();
    for (place, why) in [
        (taken.as_path(), "Not a directory"),
        (Path::new(&"/x".repeat(80)), "bytes with its NUL, allowed are 108"),
    ] {
        let network = network(place, NameTable::new());
        let port = input(&network, "/dst", 8).await;
        let writer = network.open_output("/src", &PortOptions::default()).await.unwrap();
        let error = within(writer.connect("unix_stream://dst")).await.unwrap_err().to_string();
        assert!(error.contains(why) && error.contains("YARP_RUNTIME_DIR"), "{error}");
        // The program that connects to us.
        let mut stream = TcpStream::connect(port.address()).await.unwrap();
        stream.write_all(&said("unix_stream_write", "c2s", "tcp")).await.unwrap();
        counted(&port, "unix_socket").await;
        let mut rest = Vec::new();
        within(stream.read_to_end(&mut rest)).await.ok();
    }
    assert_eq!(std::fs::read_to_string(&taken).unwrap(), "not a folder");
}
