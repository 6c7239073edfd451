//! Peers that break the rules, and what it costs a port: a counter.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::input::{Connections, InputPort, input};
use crate::names::NameTable;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use wrapyfi_yarp::port::{
    Answer, Fate, Loss, Message, Network, NetworkOptions, PortOptions, PortPayload, Room, Rooms,
    RpcError, Timeouts, Written,
};
use wrapyfi_yarp::wire::{mjpeg, number};
use wrapyfi_yarp::{Bottle, WireLimits};

const TIMEOUT: Duration = Duration::from_secs(20);

fn options() -> NetworkOptions {
    let names = Arc::new(NameTable::new());
    NetworkOptions { names, listen: [127, 0, 0, 1].into(), ..NetworkOptions::default() }
}

fn waiting(timeouts: Timeouts) -> Network {
    Network::new(NetworkOptions { timeouts, ..options() })
}

fn narrow(names: NameTable) -> Network {
    let names = Arc::new(names);
    let rooms: Rooms = || Box::new(Narrow(AtomicUsize::new(0)));
    Network::new(NetworkOptions { names, rooms, ..options() })
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(TIMEOUT, future).await.expect("in time")
}

async fn port(network: &Network) -> InputPort {
    input(network, "/port", 1000).await
}

/// Sends `bytes` and waits until the port has counted what is wrong with them.
async fn offend(port: &InputPort, bytes: &[u8], counted: &str) -> TcpStream {
    offend_once_more(port, bytes, counted, 1).await
}

async fn offend_once_more(port: &InputPort, bytes: &[u8], counted: &str, count: u64) -> TcpStream {
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    // The port may close before all is written.
    stream.write_all(bytes).await.ok();
    within(async {
        while port.fault_counts().get(counted) < count {
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
    let limits = WireLimits { max_line_bytes: 4096, ..WireLimits::default() };
    let network = Network::new(NetworkOptions { limits, ..options() });
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
    let network = waiting(Timeouts { handshake, ..Timeouts::default() });
    let port = port(&network).await;
    for start in [&b""[..], b"YA\xe4", HEADER.split_at(14).0, b"CONNECT me", b"GET / HTTP/1.1\r\n"]
    {
        let before = port.fault_counts().get("handshake_timeout");
        let mut stream = TcpStream::connect(port.address()).await.unwrap();
        stream.write_all(start).await.unwrap();
        is_closed(stream).await;
        assert_eq!(port.fault_counts().get("handshake_timeout"), before + 1, "{start:?}");
    }
    // Closing without a word is how tools look whether a port lives.
    let silent = TcpStream::connect(port.address()).await.unwrap();
    drop(silent);
    serves(&port, &network).await;
    assert_eq!(port.fault_counts().all().len(), 1);
}

#[tokio::test]
async fn what_has_begun_goes_on_or_its_connection_ends() {
    let progress = Duration::from_millis(50);
    let network = waiting(Timeouts { progress, ..Timeouts::default() });
    let port = port(&network).await;
    let mut idle = TcpStream::connect(port.address()).await.unwrap();
    idle.write_all(b"CONNECT idle\nd\n1\n").await.unwrap();
    assert_eq!(within(port.recv()).await.unwrap().bottle().unwrap().to_text(), "1");
    let message = [&index(&[8, 1000]), &b"\0\0\0\0~d\0\x01"[..]].concat();
    let cases: [&[u8]; 4] = [
        &message,
        &[&message[..], &[7; 500]].concat(),
        &message[..HEADER.len() + 5],
        b"CONNECT x\nd\n(1 2 \"so far",
    ];
    for (count, bytes) in (1..).zip(cases) {
        let stream = offend_once_more(&port, bytes, "no_progress", count).await;
        is_closed(stream).await;
    }
    idle.write_all(b"d\n2\n").await.unwrap();
    let next = within(port.recv()).await.unwrap();
    assert_eq!(next.bottle().unwrap().to_text(), "2", "between messages there is no haste");
}

/// Room for 1 MiB.
#[derive(Debug)]
struct Narrow(AtomicUsize);

impl Room for Narrow {
    fn take(&self, bytes: usize) -> bool {
        self.0.fetch_add(bytes, Relaxed) + bytes <= 1 << 20
    }

    fn give(&self, bytes: usize) {
        self.0.fetch_sub(bytes, Relaxed);
    }
}

#[tokio::test]
async fn what_has_begun_has_no_more_room_than_is_given() {
    let network = narrow(NameTable::new());
    let port = port(&network).await;
    let line = [b"CONNECT x\nd\n(".to_vec(), b"1 ".repeat(1 << 20)].concat();
    is_closed(offend(&port, &line, "over_budget").await).await;
    // Messages that fit pass, one after the other, and what is written waits in the same room.
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    writer.connect("tcp://port").await.unwrap();
    for _ in 0..5 {
        let message = Message::new(PortPayload::object(vec![0; 700_000]));
        assert_eq!(writer.write(message.clone()).dropped, 0);
        assert!(within(port.recv()).await.is_some());
        within(writer.flush()).await;
    }
    let written = writer.write(Message::new(PortPayload::object(vec![0; 2 << 20])));
    assert_eq!((written.targets, written.dropped, written.over_budget), (1, 1, 1));
}

#[tokio::test]
async fn datagrams_and_pictures_that_have_begun_have_no_more_room_than_is_given() {
    let network = narrow(NameTable::new());
    let port = port(&network).await;
    let names = NameTable::new().with("/port", port.address());
    let sender = Network::new(NetworkOptions { names: Arc::new(names), ..options() });
    let writer = sender.open_output("/writer", &PortOptions::default()).await.unwrap();
    writer.connect("udp://port").await.unwrap();
    let large = Message::new(PortPayload::object(vec![0; 2 << 20]));
    // A datagram may be lost, and its message with it.
    let written = async {
        while port.fault_counts().get("over_budget") == 0 {
            writer.write(large.clone());
            writer.flush().await;
        }
    };
    within(written).await;
    let small = Message::new(PortPayload::object(vec![0; 8]));
    let taken = async {
        while port.received() == 0 {
            writer.write(small.clone());
            writer.flush().await;
        }
    };
    within(taken).await;

    let camera = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/cam", camera.local_addr().unwrap());
    let network = narrow(names);
    let port = input(&network, "/view", 1000).await;
    let pictures = tokio::spawn(async move {
        let (mut stream, _) = camera.accept().await.unwrap();
        let head = [mjpeg::RESPONSE_HEAD.as_bytes(), &mjpeg::part_head(2 << 20)].concat();
        stream.write_all(&head).await.unwrap();
        // One that is whole at the first look has not begun to come: its last byte is missing.
        stream.write_all(&vec![0; (2 << 20) - 1]).await.ok();
        is_closed(stream).await;
    });
    let add = Bottle::from_text(b"[add] mjpeg://cam", &WireLimits::default()).unwrap();
    network.admin("/view", &add).await.unwrap();
    within(pictures).await.unwrap();
    assert_eq!(port.fault_counts().get("over_budget"), 1);
}

#[tokio::test]
async fn a_handler_that_panics_is_counted_and_its_port_serves_on() {
    let network = Network::new(options());
    let options = PortOptions::default();
    let server = network
        .serve("/server", &options, async |request, _wanted| {
            assert!(request.payload.bytes.len() < 1000, "on purpose");
            Answer::Object(request.payload.bytes)
        })
        .await
        .unwrap();
    let ask = async |client: &str, text: &str| {
        let client = network.open_rpc_client(client, &options).await.unwrap();
        client.connect("tcp://server").await.unwrap();
        client.call(&Bottle::from(vec![text.into()]), TIMEOUT).await
    };
    within(ask("/one", &"x".repeat(2000))).await.unwrap_err();
    let counted = async {
        while server.fault_counts().get("connection_panicked") == 0 {
            tokio::task::yield_now().await;
        }
    };
    within(counted).await;
    let answer = within(ask("/other", "x")).await.unwrap();
    assert_eq!(answer, Some(Bottle::from(vec!["x".into()])));
}

#[tokio::test]
async fn more_connections_than_allowed_are_closed() {
    let limits = WireLimits { max_connections: 4, ..WireLimits::default() };
    let network = Network::new(NetworkOptions { limits, ..options() });
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
    assert_eq!(port.fault_counts().get("too_many_connections"), 1);
    held.pop();
    let mut connected = port.connected();
    within(connected.wait_for(|now| now.inputs == 3)).await.unwrap();
    // The place is free a moment after the connection has left the list.
    within(async { while !network.exists("/port").await {} }).await;
}

#[tokio::test]
async fn bottles_that_cannot_be_are_left_to_their_reader() {
    let network = Network::new(options());
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
    (listener, Network::new(NetworkOptions { names: Arc::new(names), timeouts, ..options() }))
}

#[tokio::test]
async fn a_receiver_that_says_nothing_stalls_nobody() {
    let (listener, network) = peer().await;
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    // Accepted by the system, answered by no program.
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
    let write = |count: i32| writer.write_bottle(&Bottle::from(vec![count.into()])).unwrap();
    assert!((0..100).map(|count| write(count).dropped).sum::<usize>() >= 100 - 17);
    within(writer.close()).await;
    drop(held);
}

/// Losses of messages, as reported.
#[derive(Debug, Default)]
pub(crate) struct Fates(pub(crate) Mutex<Vec<Loss>>);

impl Fate for Fates {
    fn lost(&self, how: Loss) {
        self.0.lock().unwrap().push(how);
    }
}

#[tokio::test]
async fn what_a_connection_takes_with_it_is_told() {
    for (gone, expected) in [(true, Loss::Connection), (false, Loss::Closed)] {
        let (listener, network) = peer().await;
        let options = PortOptions { queue: 10, ..PortOptions::default() };
        let writer = network.open_output("/writer", &options).await.unwrap();
        let accepting = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            stream.write_all(&number::encode(1)).await.unwrap();
            (listener, stream)
        });
        within(writer.connect("tcp://peer")).await.unwrap();
        let held = within(accepting).await.unwrap();
        // One is on its way and not acknowledged, the others wait.
        let fates = Arc::new(Fates::default());
        for count in 0..5 {
            let payload = PortPayload::bottle(&Bottle::from(vec![count.into()]), network.dialect());
            let fate: Arc<dyn Fate> = fates.clone();
            let message = Message { fate: Some(fate), ..Message::new(payload.unwrap()) };
            assert_eq!(writer.write(message), Written { targets: 1, ..Written::default() });
        }
        if gone {
            drop(held);
            let mut connected = writer.connected();
            within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
        } else {
            within(writer.close()).await;
        }
        within(async {
            while fates.0.lock().unwrap().len() < 5 {
                tokio::task::yield_now().await;
            }
        })
        .await;
        assert_eq!(*fates.0.lock().unwrap(), [expected; 5]);
    }
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
        let Err(error @ (RpcError::Link { .. } | RpcError::Reply { .. })) = asked else {
            panic!("{what}: {asked:?}")
        };
        assert!(error.to_string().contains(what), "{error}");
        server.abort();
    }
}

#[tokio::test]
async fn what_has_no_form_on_a_carrier_is_told() {
    let network = Network::new(options());
    let port = port(&network).await;
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    writer.connect("text_ack://port").await.unwrap();
    let fates = Arc::new(Fates::default());
    let no_bottle = PortPayload::object(&b"no bottle"[..]);
    writer.write(Message { fate: Some(fates.clone()), ..Message::new(no_bottle) });
    writer.write_bottle(&Bottle::from(vec![1.into()])).unwrap();
    within(writer.flush()).await;
    assert_eq!(*fates.0.lock().unwrap(), [Loss::Unsendable]);
    assert_eq!(within(port.recv()).await.unwrap().bottle().unwrap().to_text(), "1");
}
