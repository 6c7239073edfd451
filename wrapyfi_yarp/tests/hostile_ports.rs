//! Peers that break the rules, and what it costs a port: a counter.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)]

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use wrapyfi_yarp::port::names::NameTable;
use wrapyfi_yarp::port::{
    CallError, InputOptions, InputPort, Message, Network, NetworkBuilder, OutputOptions, Payload,
    PortOptions, Timeouts,
};
use wrapyfi_yarp::wire::number;
use wrapyfi_yarp::{Bottle, Limits};

const PATIENCE: Duration = Duration::from_secs(20);

fn builder() -> NetworkBuilder {
    Network::builder().listen([127, 0, 0, 1].into())
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, future).await.expect("in time")
}

async fn port(network: &Network) -> InputPort {
    network.open_input("/port", &InputOptions::default()).await.unwrap()
}

/// Sends `bytes` and waits until the port has counted what is wrong with them.
async fn offend(port: &InputPort, bytes: &[u8], counted: &str) -> TcpStream {
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    // The port may close before all is written.
    stream.write_all(bytes).await.ok();
    within(async {
        while port.counters().get(counted) == 0 {
            tokio::task::yield_now().await;
        }
    })
    .await;
    stream
}

async fn is_closed(mut stream: TcpStream) {
    let mut rest = Vec::new();
    within(stream.read_to_end(&mut rest)).await.ok();
}

/// The port still serves.
async fn serves(port: &InputPort, network: &Network) {
    assert!(network.exists(port.name()).await);
}

const HEADER: &[u8] = b"YA\xe4\x1e\0\0RP\x05\0\0\0/x/y\0";

fn index(lengths: &[i32]) -> Vec<u8> {
    let mut bytes = [HEADER, b"YA\x0a\0\0\0RP"].concat();
    bytes.extend([u8::try_from(lengths.len()).unwrap(), 1]);
    bytes.extend([0xff; 8]);
    for length in lengths.iter().chain(&[0]) {
        bytes.extend(length.to_le_bytes());
    }
    bytes
}

#[tokio::test]
async fn what_cannot_be_trusted_is_closed_and_counted() {
    let limits = Limits { max_line_bytes: 4096, ..Limits::default() };
    let network = builder().limits(limits).build();
    let endless = [b"CONNECT x\nd\n".to_vec(), vec![b'('; 10_000]].concat();
    let name = [b"CONNECT ".to_vec(), vec![b'x'; 2000]].concat();
    let cases: [(&[u8], &str); 9] = [
        (&index(&[8, -1]), "negative_length"),
        (&index(&[8, i32::MAX]), "message_too_large"),
        (&index(&[i32::MAX; 255]), "message_too_large"),
        (&endless, "line_too_long"),
        (&name, "name_length"),
        (b"YA\xe4\x1e\0\0RP\xff\xff\xff\x7f", "name_length"),
        (b"YA\xe4\x1e\0\0RP\0\0\0\0", "name_length"),
        (b"\0\0\0\0\0\0\0\0", "unknown_header"),
        (b"YA\xff\xff\xff\x7fRP", "unknown_header"),
    ];
    for (bytes, counted) in cases {
        let port = port(&network).await;
        is_closed(offend(&port, bytes, counted).await).await;
        serves(&port, &network).await;
        within(port.close()).await;
    }
}

#[tokio::test]
async fn half_open_connections_end() {
    let handshake = Duration::from_millis(50);
    let network = builder().timeouts(Timeouts { handshake, ..Timeouts::default() }).build();
    let port = port(&network).await;
    for start in [&b""[..], b"YA\xe4", HEADER.split_at(14).0, b"CONNECT me", b"GET / HTTP/1.1\r\n"]
    {
        let before = port.counters().get("handshake_timeout");
        let mut stream = TcpStream::connect(port.address()).await.unwrap();
        stream.write_all(start).await.unwrap();
        is_closed(stream).await;
        assert_eq!(port.counters().get("handshake_timeout"), before + 1, "{start:?}");
    }
    // Closing without a word is how tools look whether a port lives.
    let silent = TcpStream::connect(port.address()).await.unwrap();
    drop(silent);
    serves(&port, &network).await;
    assert_eq!(port.counters().all().len(), 1);
}

#[tokio::test]
async fn more_connections_than_allowed_are_closed() {
    let limits = Limits { max_connections: 4, ..Limits::default() };
    let network = builder().limits(limits).build();
    let port = port(&network).await;
    let mut held = Vec::new();
    for count in 0..4 {
        let mut stream = TcpStream::connect(port.address()).await.unwrap();
        stream.write_all(format!("CONNECT peer{count}\n").as_bytes()).await.unwrap();
        held.push(stream);
    }
    within(port.wait_for_inputs(4)).await;
    let stream = TcpStream::connect(port.address()).await.unwrap();
    is_closed(stream).await;
    assert_eq!(port.counters().get("too_many_connections"), 1);
    held.pop();
    let mut connected = port.connected();
    within(connected.wait_for(|now| now.inputs == 3)).await.unwrap();
    // The place is free a moment after the connection has left the list.
    within(async { while !network.exists("/port").await {} }).await;
}

#[tokio::test]
async fn bottles_that_cannot_be_are_left_to_their_reader() {
    let network = builder().build();
    let port = port(&network).await;
    let mut bytes = index(&[8, 12]);
    bytes.extend(b"\0\0\0\0~D\0\x01");
    bytes.extend([0, 1, 0, 0, 0xff, 0xff, 0xff, 0x7f, 1, 2, 3, 4]);
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    stream.write_all(&bytes).await.unwrap();
    let message = within(port.recv()).await.unwrap();
    assert!(message.bottle().is_err());
    assert_eq!(message.payload.bytes.len(), 12);
    let mut answer = [0; 16];
    within(stream.read_exact(&mut answer)).await.unwrap();
    assert_eq!(answer[8..], number::ACK);
}

/// A listener in our hands, under the name `/peer`.
async fn peer() -> (TcpListener, Network) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/peer", listener.local_addr().unwrap());
    let timeouts = Timeouts {
        connect: Duration::from_millis(200),
        close: Duration::from_millis(200),
        ..Timeouts::default()
    };
    (listener, builder().names(names).timeouts(timeouts).build())
}

#[tokio::test]
async fn a_receiver_that_says_nothing_stalls_nobody() {
    let (listener, network) = peer().await;
    let writer = network.open_output("/writer", &OutputOptions::default()).await.unwrap();
    // Accepted by the system, answered by nobody.
    let error = within(writer.connect("/peer")).await.unwrap_err();
    assert_eq!(error.to_string(), "Cannot connect to /peer");
    drop(listener.accept().await.unwrap());
    // Answered, and never acknowledged: the queue drops, and closing ends in time.
    let accepting = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        stream.write_all(&number::encode(1)).await.unwrap();
        (listener, stream)
    });
    within(writer.connect("/peer")).await.unwrap();
    let held = within(accepting).await.unwrap();
    for count in 0..100 {
        writer.write_bottle(&Bottle::from(vec![count.into()])).unwrap();
    }
    assert!(writer.status()[0].dropped >= 100 - 17);
    within(writer.close()).await;
    drop(held);
}

#[tokio::test]
async fn replies_that_are_none_are_errors_with_a_name() {
    for (answer, what) in [
        (&b"garbage!garbage!"[..], "none of YARP's"),
        (b"\0\x01\0\0\xff\xff\xff\x7f", "more than"),
        (b"", "closed"),
    ] {
        let (listener, network) = peer().await;
        let client = network.open_rpc_client("/client", &PortOptions::default()).await.unwrap();
        let server = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            stream.write_all(&number::encode(1)).await.unwrap();
            let mut request = [0; 20 + 50]; // header and message
            stream.read_exact(&mut request).await.unwrap();
            stream.write_all(answer).await.unwrap();
            if answer.is_empty() {
                return None;
            }
            Some(stream)
        });
        within(client.connect("/peer")).await.unwrap();
        let asked = client.call(&Bottle::from(vec![1.into()]), Duration::from_secs(5)).await;
        let Err(error @ (CallError::Link { .. } | CallError::Reply { .. })) = asked else {
            panic!("{what}: {asked:?}")
        };
        assert!(error.to_string().contains(what), "{error}");
        server.abort();
    }
}

#[tokio::test]
async fn what_has_no_form_on_a_carrier_is_counted() {
    let network = builder().build();
    let port = port(&network).await;
    let writer = network.open_output("/writer", &OutputOptions::default()).await.unwrap();
    writer.connect("text_ack://port").await.unwrap();
    writer.write(Message::new(Payload::object(&b"no bottle"[..])));
    writer.write_bottle(&Bottle::from(vec![1.into()])).unwrap();
    within(writer.flush()).await;
    let status = &writer.status()[0];
    assert_eq!((status.messages, status.unsendable), (1, 1));
    assert_eq!(within(port.recv()).await.unwrap().bottle().unwrap().to_text(), "1");
}
