//! Conversations recorded from real YARP, with our ports in the place of either side.

use std::sync::{Arc, Mutex};

use crate::golden::conversation::{
    Part, Sent, TIMEOUT, expect, expect_end, messages, parts, play_client, play_parts, play_server,
    replies, side, with_port,
};
use crate::golden::{file, hex};
use crate::input::{Connections, InputPort, Reading, both_ways, input};
use crate::names::NameTable;
use crate::queued::queued;
use bytes::Bytes;
use tokio::net::{TcpListener, TcpStream};
use wrapyfi_yarp::port::{
    Answer, Message, Network, NetworkOptions, Port, PortOptions, PortPayload, Received,
};
use wrapyfi_yarp::wire::number;
use wrapyfi_yarp::{Bottle, Dialect, Value, WireLimits};

fn network(names: NameTable, dialect: Dialect) -> Network {
    let (listen, names) = ([127, 0, 0, 1].into(), Arc::new(names));
    Network::new(NetworkOptions { listen, names, dialect, ..NetworkOptions::default() })
}

fn bottle(text: &str) -> Bottle {
    Bottle::from_text(text.as_bytes(), &WireLimits::default()).unwrap()
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(TIMEOUT, future).await.expect("in time")
}

/// Envelope and payload of a received message, to compare with the sent ones.
fn as_sent(received: &Received) -> (Option<Bytes>, Bytes) {
    (received.envelope.clone(), received.payload.bytes.clone())
}

fn with_sticky_envelopes(sent: &[Sent]) -> Vec<(Option<Bytes>, Bytes)> {
    let mut last = None;
    let stamp = |sent: &Sent| {
        last = sent.envelope.clone().or_else(|| last.clone());
        (last.clone(), sent.payload.clone())
    };
    sent.iter().map(stamp).collect()
}

async fn received(port: &InputPort, count: usize) -> Vec<(Option<Bytes>, Bytes)> {
    let mut found = Vec::new();
    for _ in 0..count {
        found.push(as_sent(&within(port.recv()).await.unwrap()));
    }
    assert_eq!(port.try_recv(), None, "nothing more");
    found
}

/// Conversations between a writer and a reader without replies, both of them YARP 3.
const STREAMS: [&str; 37] = [
    "tcp_basic",
    "tcp_all_bottles",
    "tcp_envelope",
    "tcp_recv_priority",
    "tcp_reader_closes_first",
    "tcp_yarp_write_to_yarp_read",
    "fast_tcp_basic",
    "fast_tcp_all_bottles",
    "fast_tcp_envelope",
    "fast_tcp_hand",
    "text_basic",
    "text_all_bottles",
    "text_envelope",
    "text_ack_basic",
    "text_ack_all_bottles",
    "text_ack_envelope",
    "images_tcp",
    "images_fast_tcp",
    "images_tcp_envelope",
    "sound_tcp",
    "vector_matrix_stamp_tcp",
    "wrapyfi_audio",
    "wrapyfi_image_float",
    "wrapyfi_image_jpg",
    "wrapyfi_image_mono",
    "wrapyfi_image_rgb",
    "wrapyfi_image_rgbfloat",
    "wrapyfi_native",
    "wrapyfi_native_nopersist",
    // By hand: a message as one block, bytes that a writer of ours does not send.
    "anon_sender",
    "single_block",
    "quit_cmd",
    "unknown_key",
    "lying_index",
    "bad_index",
    "bad_command",
    "bad_bottle_code",
];

/// Names of the conversations that writers wrote, not hands.
fn by_writers() -> impl Iterator<Item = &'static str> {
    let by_hand = |name: &&str| *name == "fast_tcp_hand" || *name == "anon_sender";
    STREAMS.into_iter().take(29).filter(move |name| !by_hand(name))
}

/// Reads a conversation as our reader's peer sent it, and compares the answers.
async fn read_by_us(name: &str, mut steps: Vec<Part>, dialect: Dialect) -> (InputPort, Vec<Sent>) {
    let network = network(NameTable::new(), dialect);
    let port = input(&network, "/golden/dst", 100).await;
    let sent = messages(&side(&steps, true), dialect);
    steps = with_port(steps, port.address().port());
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    stream.set_nodelay(true).unwrap();
    play_client(&mut stream, &steps, name).await;
    (port, sent)
}

#[tokio::test]
async fn our_reader_answers_as_yarp() {
    for name in STREAMS {
        let mut steps = parts(&format!("{name}.json"));
        let ack = Part::Server(number::ACK.to_vec());
        match name {
            // YARP acknowledges what it cannot decode, and is out of step from then on. The
            // declared length keeps us in step: the message behind is acknowledged, too.
            "bad_bottle_code" => steps.insert(5, ack),
            // The same after a message without a command, which is not acknowledged.
            "bad_command" => steps.insert(4, ack),
            _ => {}
        }
        let (port, mut sent) = read_by_us(name, steps, Dialect::V3).await;
        if name == "lying_index" {
            // YARP believes the payload, which is longer than declared. We cut it there, and find
            // the next message behind the rest.
            assert_eq!(sent[0].payload, Bytes::from_static(&[1, 1, 0, 0]));
            assert_eq!(port.fault_counts().get("no_index"), 1);
        }
        if name == "bad_index" {
            assert_eq!(port.fault_counts().get("no_index"), 1);
        }
        if name == "bad_command" {
            assert_eq!(port.fault_counts().get("bad_command"), 1);
        }
        if name.starts_with("text") {
            // Numbers, which text gives no type, come as our own reading of the text says.
            sent.truncate(100);
        }
        let found = received(&port, sent.len()).await;
        assert_eq!(found, with_sticky_envelopes(&sent), "{name}");
    }
}

#[tokio::test]
async fn our_reader_outlives_the_other_dialect() {
    let three_acks = |name: &str| {
        let mut steps = parts(name);
        let acks = steps.iter().filter(|step| **step == Part::Server(number::ACK.to_vec())).count();
        let messages = steps.iter().filter(|step| matches!(step, Part::Client(_))).count() - 1;
        // YARP 4 stops to acknowledge at the first double, and its writer waits for ever. Lengths
        // are enough for us: every message is acknowledged.
        for _ in acks..messages {
            let end = steps.iter().rposition(|step| matches!(step, Part::Client(_))).unwrap();
            steps.insert(end + 1, Part::Server(number::ACK.to_vec()));
        }
        steps
    };
    for (name, dialect) in [
        ("v3_writer_v4_reader.json", Dialect::V4),
        ("v4_writer_v3_reader.json", Dialect::V3),
        ("v4_tcp_basic.json", Dialect::V4),
    ] {
        let (port, sent) = read_by_us(name, three_acks(name), dialect).await;
        let found = received(&port, sent.len()).await;
        assert_eq!(found, with_sticky_envelopes(&sent), "{name}");
        assert_eq!(port.fault_counts().all(), [].into(), "{name}");
    }
}

#[tokio::test]
async fn our_reader_drops_what_is_cut_short() {
    // YARP acknowledges as soon as the bottle ends, whatever was declared. We wait for what was
    // declared, and count that it never came.
    let mut steps = parts("bad_short_payload.json");
    steps.retain(|step| *step != Part::Server(number::ACK.to_vec()));
    let (port, _) = read_by_us("bad_short_payload", steps, Dialect::V3).await;
    assert_eq!(port.fault_counts().get("truncated"), 1);
    assert_eq!(port.received(), 0);
}

#[tokio::test]
async fn our_reader_outlives_a_writer_of_a_reader_that_was_killed() {
    // Up to where the reader was killed; ours lives, so the rest is an ordinary message.
    let mut steps = parts("tcp_reader_killed.json");
    let killed = steps.iter().position(|step| *step == Part::ServerEnd).unwrap();
    steps.truncate(killed);
    let (port, _) = read_by_us("tcp_reader_killed", steps, Dialect::V3).await;
    assert_eq!(received(&port, 2).await.len(), 2);
}

#[tokio::test]
async fn our_reader_refuses_what_it_lacks() {
    for (name, counted) in [
        ("bad_header", "unknown_header"),
        ("fast_tcp_recv_portmonitor_missing", "missing_modifier"),
        ("local_basic", "unsupported_carrier"),
        ("human_basic", "unsupported_carrier"),
        // This network has no folder for its sockets.
        ("unix_stream_basic", "unix_socket"),
        // YARP answers with a number of its shared memory; we have none, and close.
        ("shmem_basic", "unsupported_carrier"),
    ] {
        let mut steps = parts(&format!("{name}.json"));
        // YARP answers a modifier that it lacks and then closes: its `connect` says Success. Ours
        // closes at once, and `connect` says that it cannot connect.
        if ["shmem_basic", "fast_tcp_recv_portmonitor_missing"].contains(&name) {
            steps.retain(|step| !matches!(step, Part::Server(_)));
        }
        let (port, _) = {
            let network = network(NameTable::new(), Dialect::V3);
            let port = input(&network, "/golden/dst", 100).await;
            let steps = with_port(steps, port.address().port());
            let mut stream = TcpStream::connect(port.address()).await.unwrap();
            play_client(&mut stream, &steps, name).await;
            (port, ())
        };
        assert_eq!(port.fault_counts().get(counted), 1, "{name}: {:?}", port.fault_counts().all());
        assert_eq!(port.received(), 0, "{name}");
    }
}

/// Writes a conversation as our writer, to a reader that answers as recorded.
async fn written_by_us(name: &str, dialect: Dialect) {
    let steps = parts(&format!("{name}.json"));
    let sent = messages(&side(&steps, true), dialect);
    assert!(!sent.is_empty(), "{name}");
    let Part::Client(header) = &steps[0] else { panic!("{name}") };
    let (carrier, from) = match &header[..8] {
        b"CONNECT " => ("text", 8),
        b"CONNACK " => ("text_ack", 8),
        [_, _, 0xe4, ..] => ("tcp", 12),
        _ => ("fast_tcp", 12),
    };
    let writer_name = std::str::from_utf8(&header[from..]).unwrap();
    let writer_name = writer_name.trim_end_matches(['\0', '\r', '\n']);
    let writer_name = writer_name.split(' ').next().unwrap();
    let carrier = match name {
        "tcp_recv_priority" => "tcp+recv.priority",
        _ => carrier,
    };
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/golden/dst", listener.local_addr().unwrap());
    let network = network(names, dialect);
    let options = PortOptions { queue: 100, ..PortOptions::default() };
    let port = network.open_output(writer_name, &options).await.unwrap();
    let what = name.to_owned();
    let text = carrier.starts_with("text");
    let reader = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        stream.set_nodelay(true).unwrap();
        play_server(&mut stream, &steps, text, &what).await;
    });
    within(port.connect(&format!("{carrier}://golden/dst"))).await.unwrap();
    for Sent { envelope, payload, .. } in sent {
        let written = port.write(Message {
            payload: PortPayload::object(payload),
            envelope,
            ..Message::default()
        });
        assert_eq!((written.targets, written.dropped), (1, 0), "{name}");
    }
    within(port.flush()).await;
    within(port.close()).await;
    within(reader).await.unwrap();
}

#[tokio::test]
async fn our_writer_writes_as_yarp() {
    for name in by_writers() {
        written_by_us(name, Dialect::V3).await;
    }
    written_by_us("v4_tcp_basic", Dialect::V4).await;
}

#[tokio::test]
async fn our_writer_outlives_its_reader() {
    // The reader is killed after two messages: the third goes nowhere, and the output ends.
    let mut steps = parts("tcp_reader_killed.json");
    let sent = messages(&side(&steps, true), Dialect::V3);
    let killed = steps.iter().position(|step| *step == Part::ServerEnd).unwrap();
    steps.truncate(killed);
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/golden/dst", listener.local_addr().unwrap());
    let network = network(names, Dialect::V3);
    let port = network.open_output("/golden/src", &PortOptions::default()).await.unwrap();
    let reader = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        for step in steps {
            match step {
                Part::Client(bytes) => expect(&mut stream, &bytes, false, "killed").await,
                Part::Server(bytes) => {
                    tokio::io::AsyncWriteExt::write_all(&mut stream, &bytes).await.unwrap();
                }
                Part::ClientEnd | Part::ServerEnd => {}
            }
        }
    });
    within(port.connect("/golden/dst")).await.unwrap();
    for Sent { payload, .. } in &sent[..2] {
        port.write(Message::new(PortPayload::object(payload.clone())));
    }
    within(reader).await.unwrap();
    let mut connected = port.connected();
    within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
    assert_eq!(port.write(Message::default()).targets, 0);
}

/// Requests and replies; whether the replies come in text.
const REQUESTS: [(&str, &str); 7] = [
    ("rpc_tcp_rpcclient", "tcp"),
    ("rpc_tcp_yarp_rpc", "tcp"),
    ("rpc_tcp_yarp_rpcserver", "tcp"),
    ("rpc_fast_tcp", "fast_tcp"),
    ("rpc_text_ack", "text_ack"),
    ("rpc_text", "text"),
    ("wrapyfi_native_rpc", "tcp"),
];

#[tokio::test]
async fn our_server_replies_as_yarp() {
    for (name, carrier) in REQUESTS {
        let steps = parts(&format!("{name}.json"));
        let mut recorded = replies(&side(&steps, false), carrier.starts_with("text")).into_iter();
        let network = network(NameTable::new(), Dialect::V3);
        let (server, mut requests) = queued(&network, "/golden/rpc").await;
        let steps = with_port(steps, server.address().port());
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        stream.set_nodelay(true).unwrap();
        let asked = Arc::new(Mutex::new(Vec::new()));
        let answering = async {
            while let Some(request) = requests.recv().await {
                assert!(request.wants_reply);
                asked.lock().unwrap().push(request.received.payload.bytes.clone());
                request.reply.send(Answer::Object(recorded.next().unwrap())).unwrap();
            }
        };
        tokio::select! {
            () = answering => panic!("{name}: closed"),
            () = play_client(&mut stream, &steps, name) => {}
        }
        let sent = messages(&side(&steps, true), Dialect::V3);
        let sent: Vec<_> = sent.into_iter().map(|sent| sent.payload).collect();
        assert_eq!(*asked.lock().unwrap(), sent, "{name}");
    }
}

#[tokio::test]
async fn our_client_asks_as_yarp() {
    for (name, carrier) in REQUESTS.into_iter().chain([("rpc_tcp_reply_and_drop", "tcp")]) {
        let mut steps = parts(&format!("{name}.json"));
        if name == "rpc_tcp_reply_and_drop" {
            steps.truncate(4); // the server closes then; the client of YARP had written once more
        }
        let Part::Client(header) = &steps[0] else { panic!("{name}") };
        if !header.contains(&b'/') {
            continue; // `yarp rpc` is no port; ours are
        }
        let text = carrier.starts_with("text");
        let client_name =
            if name.starts_with("wrapyfi") { "/wf/native:in14102" } else { "/golden/client" };
        let sent = messages(&side(&steps, true), Dialect::V3);
        let expected = replies(&side(&steps, false), text);
        // The client of YARP writes its first request before it reads `Welcome`; ours waits. The
        // bytes are the same.
        let steps: Vec<_> = if text {
            let split = |bytes: &[u8]| {
                let end = bytes.iter().position(|&byte| byte == b'\n').unwrap() + 1;
                let (header, rest) = bytes.split_at(end);
                (header.to_vec(), rest.to_vec())
            };
            let (header, request) = split(&side(&steps[..1], true));
            let (welcome, reply) = split(&side(&steps[1..2], false));
            let start = [
                Part::Client(header),
                Part::Server(welcome),
                Part::Client(request),
                Part::Server(reply),
            ];
            start.into_iter().chain(steps[2..].iter().cloned()).collect()
        } else {
            steps
        };
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let names = NameTable::new().with("/golden/rpc", listener.local_addr().unwrap());
        let network = network(names, Dialect::V3);
        let client = network.open_rpc_client(client_name, &PortOptions::default()).await.unwrap();
        let what = name.to_owned();
        let server = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            stream.set_nodelay(true).unwrap();
            match &*what {
                // This server reads no more: what the client says when it closes is lost.
                "rpc_tcp_reply_and_drop" => play_parts(&mut stream, &steps, text, &what).await,
                _ => play_server(&mut stream, &steps, text, &what).await,
            }
        });
        within(client.connect(&format!("{carrier}://golden/rpc"))).await.unwrap();
        for (sent, expected) in sent.iter().zip(expected) {
            let reply = client.call_bytes(&sent.payload, TIMEOUT).await.unwrap();
            assert_eq!(reply, Some(expected), "{name}");
        }
        within(client.close()).await;
        within(server).await.unwrap();
    }
}

#[tokio::test]
async fn a_client_over_udp_is_refused() {
    // In rpc_udp.json a client of YARP waits for ever.
    let udp = file("rpc_udp.json");
    assert!(udp["datagrams"].is_array());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/golden/rpc", listener.local_addr().unwrap());
    let network = network(names, Dialect::V3);
    let client = network.open_rpc_client("/client", &PortOptions::default()).await.unwrap();
    let error = client.connect("udp://golden/rpc").await.unwrap_err();
    assert_eq!(error.to_string(), "Cannot connect to udp://golden/rpc");
}

/// A port as in the administrative captures, with a reader that it can connect to.
async fn subject(network: &Network) -> (Reading<Port>, InputPort) {
    (both_ways(network, "/golden/subj", 100).await, input(network, "/golden/dst2", 100).await)
}

#[tokio::test]
async fn administration_over_binary_tcp() {
    let network = network(NameTable::new(), Dialect::V3);
    let (port, _reader) = subject(&network).await;
    let source = network.open_output("/golden/src", &PortOptions::default()).await.unwrap();
    source.connect("/golden/subj").await.unwrap();
    within(port.wait_for_inputs(1)).await;
    let steps = with_port(parts("admin_binary_tcp.json"), port.address().port());
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    play_client(&mut stream, &steps, "admin_binary_tcp").await;
    let mut connected = source.connected();
    within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
}

#[tokio::test]
async fn administration_over_text_ack() {
    let network = network(NameTable::new(), Dialect::V3);
    let (port, _reader) = subject(&network).await;
    // An earlier session had left this behind: a property of a connection that is gone.
    network.connect("/golden/subj", "/golden/dst2", None).await.unwrap();
    let request = bottle("[prop] [set] /golden/dst2 (qos ((priority HIGH)))");
    assert_eq!(network.admin("/golden/subj", &request).await.unwrap().to_text(), "[ok]");
    network.disconnect("/golden/subj", "/golden/dst2").await.unwrap();
    let mut connected = port.connected();
    within(connected.wait_for(|now| now.inputs == 0)).await.unwrap();
    let steps = parts("admin_text_ack.json");
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    play_client(&mut stream, &steps, "admin_text_ack").await;
}

#[tokio::test]
async fn a_text_session() {
    let network = network(NameTable::new(), Dialect::V3);
    let (port, _reader) = subject(&network).await;
    let address = port.address().to_string();
    let mut steps = parts("port_text_session.json");
    for step in &mut steps {
        if let Part::Server(bytes) = step {
            let text = std::str::from_utf8(bytes).unwrap();
            *bytes = text.replace("127.0.0.1:10005", &address).into_bytes();
        }
    }
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    stream.set_nodelay(true).unwrap();
    play_client(&mut stream, &steps, "port_text_session").await;
    for expected in ["1 2 3", "4 5", "6"] {
        assert_eq!(within(port.recv()).await.unwrap().bottle().unwrap(), bottle(expected));
    }
}

#[tokio::test]
async fn a_text_peer_turns_its_connection_around() {
    let steps = parts("text_reverse.json");
    let network = network(NameTable::new(), Dialect::V3);
    let port = network.open_output("/golden/src", &PortOptions::default()).await.unwrap();
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    play_text_reader(&mut stream, &port, &steps).await;
    drop(stream);
    let mut connected = port.connected();
    within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
}

async fn play_text_reader(stream: &mut TcpStream, port: &wrapyfi_yarp::port::Port, steps: &[Part]) {
    use tokio::io::AsyncWriteExt;
    for step in steps {
        match step {
            Part::Client(bytes) => {
                stream.write_all(bytes).await.unwrap();
                if bytes == b"r\r\n" {
                    within(port.wait_for_outputs(1)).await;
                    assert_eq!(port.status()[0].name, "/golden/human");
                }
            }
            Part::Server(bytes) if bytes.starts_with(b"Welcome") => {
                expect(stream, bytes, false, "text_reverse").await;
            }
            Part::Server(bytes) => {
                let text = std::str::from_utf8(bytes).unwrap();
                let (envelope, payload) = text.split_once("\r\n").unwrap();
                let envelope = envelope.strip_prefix("D ").unwrap().to_owned();
                let payload =
                    PortPayload::bottle(&bottle(payload.trim_end()), Dialect::V3).unwrap();
                let envelope = Some(envelope.into());
                assert_eq!(
                    port.write(Message { payload, envelope, ..Message::default() }).targets,
                    1
                );
                expect(stream, bytes, false, "text_reverse").await;
            }
            Part::ClientEnd | Part::ServerEnd => break,
        }
    }
}

#[tokio::test]
async fn pictures_as_yarp_pulls_them() {
    let steps = parts("mjpeg_basic.json");
    let server = side(&steps, false);
    let start = server.windows(2).position(|two| two == [0xff, 0xd8]).unwrap();
    let end = server.windows(2).rposition(|two| two == [0xff, 0xd9]).unwrap() + 2;
    let jpeg = Bytes::copy_from_slice(&server[start..end]);
    // Ours sends.
    let network_ = network(NameTable::new(), Dialect::V3);
    let port = network_.open_output("/golden/src", &PortOptions::default()).await.unwrap();
    let mut stream = TcpStream::connect(port.address()).await.unwrap();
    let Part::Client(request) = &steps[0] else { panic!() };
    tokio::io::AsyncWriteExt::write_all(&mut stream, request).await.unwrap();
    within(port.wait_for_outputs(1)).await;
    port.write(Message::new(PortPayload::raw(jpeg.clone())));
    expect(&mut stream, &server, false, "mjpeg_basic").await;
    within(port.close()).await;
    expect_end(&mut stream, "mjpeg_basic").await;
    // Ours receives.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let names = NameTable::new().with("/golden/src", listener.local_addr().unwrap());
    let network = network(names, Dialect::V3);
    let port = input(&network, "/golden/dst", 100).await;
    let request_to_add = bottle("[add] mjpeg://golden/src");
    // It is added once the camera has answered.
    let added = network.admin("/golden/dst", &request_to_add);
    let camera = async {
        let (mut stream, _) = within(listener.accept()).await.unwrap();
        expect(&mut stream, request, false, "mjpeg_basic").await;
        tokio::io::AsyncWriteExt::write_all(&mut stream, &server).await.unwrap();
        stream
    };
    let (added, stream) = tokio::join!(added, camera);
    assert_eq!(added.unwrap().get(0).and_then(Value::as_i64), Some(0));
    let picture = within(port.recv()).await.unwrap();
    assert_eq!(picture.payload, PortPayload::raw(jpeg));
    drop(stream);
    let mut connected = port.connected();
    within(connected.wait_for(|now| now.inputs == 0)).await.unwrap();
}

#[test]
fn a_large_image_is_cut_into_datagrams_as_by_yarp() {
    use wrapyfi_yarp::wire::{Command, datagram, message};
    let recorded = file("udp_large_message_summary.json");
    let recorded = recorded["datagram_summary"].as_array().unwrap();
    // 240 rows of 300 grey pixels, each row padded to a multiple of 8.
    let image = 240 * 304;
    let mut payload = vec![0; 60 + image];
    let first = hex(recorded[0]["first_64_hex"].as_str().unwrap());
    payload[..64 - 50].copy_from_slice(&first[50..]);
    let command = Command::Data { reply: false, envelope: None };
    let head = message::head(&command, &[60, image]).unwrap();
    let datagrams = datagram::split(&head, &payload, datagram::MAX_DATAGRAM);
    assert_eq!(datagrams[0][4..64], first[4..]);
    let lengths: Vec<_> = datagrams.iter().map(Vec::len).collect();
    let expected: Vec<_> = recorded.iter().filter_map(|one| one["length"].as_u64()).collect();
    assert_eq!(lengths, expected[..2].iter().map(|&length| length as usize).collect::<Vec<_>>());
    let second = hex(recorded[1]["first_64_hex"].as_str().unwrap());
    assert_eq!(datagrams[1][4..8], second[4..8]);
}
