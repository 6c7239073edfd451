//! Our ports with each other, over every carrier.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;

use crate::hostile_ports::Fates;
use crate::input::{Connections, InputPort, input, open_input};
use crate::names::NameTable;
use crate::queued::queued;
use wrapyfi_yarp::name::Environment;
use wrapyfi_yarp::port::{
    Answer, Inspection, Loss, Message, Modes, Network, NetworkOptions, Overflow, PayloadKind,
    PortOptions, PortPayload, RpcError,
};
use wrapyfi_yarp::{Bottle, Value, WireLimits};

const TIMEOUT: Duration = Duration::from_secs(20);

fn options() -> NetworkOptions {
    let names = Arc::new(NameTable::new());
    NetworkOptions { names, listen: [127, 0, 0, 1].into(), ..NetworkOptions::default() }
}

fn network() -> Network {
    // Sockets are gone from there as soon as both ends have met.
    let sockets = Environment::default().with("YARP_RUNTIME_DIR", env!("CARGO_TARGET_TMPDIR"));
    Network::new(NetworkOptions { environment: sockets, ..options() })
}

fn bottle(text: &str) -> Bottle {
    Bottle::from_text(text.as_bytes(), &WireLimits::default()).unwrap()
}

async fn within<T>(future: impl Future<Output = T>) -> T {
    tokio::time::timeout(TIMEOUT, future).await.expect("in time")
}

async fn next(port: &InputPort) -> wrapyfi_yarp::port::Received {
    within(port.recv()).await.expect("the port is open")
}

#[tokio::test]
async fn messages_arrive_over_every_push_carrier() {
    for carrier in
        ["tcp", "fast_tcp", "text", "text_ack", "udp", "mcast", "unix_stream", "unix_stream+ack"]
    {
        let network = network();
        let reader = input(&network, "/reader", 16).await;
        let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
        writer.connect(&format!("{carrier}://reader")).await.unwrap();
        within(reader.wait_for_inputs(1)).await;
        let text = "1 (a 2 (0.5)) \"end of it\"";
        writer.write_bottle(&bottle("42")).unwrap();
        let payload = PortPayload::bottle(&bottle(text), network.dialect()).unwrap();
        let envelope = Some(Bytes::from_static(b"42 1700000000.5"));
        let written =
            writer.write(Message { payload, envelope: envelope.clone(), ..Message::default() });
        assert_eq!((written.targets, written.dropped), (1, 0), "{carrier}");
        writer.write_bottle(&bottle("")).unwrap();
        let first = next(&reader).await;
        assert_eq!(first.bottle().unwrap(), bottle("42"), "{carrier}");
        assert_eq!((first.envelope.clone(), &*first.from), (None, "/writer"), "{carrier}");
        let second = next(&reader).await;
        assert_eq!(second.bottle().unwrap().to_text(), text, "{carrier}");
        assert_eq!(second.envelope, envelope, "{carrier}");
        let third = next(&reader).await;
        assert!(third.bottle().unwrap().is_empty(), "{carrier}");
        assert_eq!(third.envelope, envelope, "{carrier}: envelopes stay");
        assert_eq!(writer.status()[0].carrier, carrier);
        // The writer goes first: the reader learns it, on udp and mcast by a connection of its own.
        within(writer.close()).await;
        let mut connected = reader.connected();
        within(connected.wait_for(|now| now.inputs == 0)).await.unwrap();
        assert_eq!(reader.fault_counts().all(), [].into(), "{carrier}");
        within(reader.close()).await;
    }
}

#[tokio::test]
async fn a_reader_that_closes_first_ends_the_output() {
    for carrier in ["tcp", "fast_tcp", "text_ack", "udp", "unix_stream", "unix_stream+ack"] {
        let network = network();
        let reader = input(&network, "/reader", 16).await;
        let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
        reader.subscribe(&network, "/writer", carrier).await.unwrap();
        within(writer.wait_for_outputs(1)).await;
        within(reader.wait_for_inputs(1)).await;
        within(reader.close()).await;
        let mut connected = writer.connected();
        within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
        assert_eq!(writer.write_bottle(&bottle("1")).unwrap().targets, 0, "{carrier}");
        assert!(network.query("/reader").await.unwrap().is_none());
    }
}

#[tokio::test]
async fn one_multicast_datagram_reaches_all_targets() {
    let network = network();
    let first = input(&network, "/first", 4).await;
    let second = input(&network, "/second", 4).await;
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    writer.connect("mcast://first").await.unwrap();
    writer.connect("mcast://second").await.unwrap();
    within(first.wait_for_inputs(1)).await;
    within(second.wait_for_inputs(1)).await;
    assert_eq!(writer.write_bottle(&bottle("7")).unwrap().targets, 1);
    assert_eq!(next(&first).await.bottle().unwrap(), bottle("7"));
    assert_eq!(next(&second).await.bottle().unwrap(), bottle("7"));
    assert_eq!(first.received(), 1);
    network.disconnect("/writer", "/first").await.unwrap();
    let mut connected = first.connected();
    within(connected.wait_for(|now| now.inputs == 0)).await.unwrap();
    writer.write_bottle(&bottle("8")).unwrap();
    assert_eq!(next(&second).await.bottle().unwrap(), bottle("8"));
    assert_eq!(first.received(), 1);
    within(writer.close()).await;
    let group = network.query("/tmp/port/1").await.unwrap();
    assert_eq!(group, None, "the group is free again");
}

#[tokio::test]
async fn large_messages_pass_in_datagrams_and_in_streams() {
    let bytes: Vec<u8> = (0..300_000_u32).map(|at| (at % 251) as u8).collect();
    let big = Bottle::from(vec![Value::blob(bytes)]);
    for carrier in ["tcp", "fast_tcp", "text_ack", "udp", "mcast"] {
        let network = network();
        let reader = input(&network, "/reader", 4).await;
        let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
        writer.connect(&format!("{carrier}://reader")).await.unwrap();
        within(reader.wait_for_inputs(1)).await;
        writer.write_bottle(&big).unwrap();
        assert_eq!(next(&reader).await.bottle().unwrap(), big, "{carrier}");
    }
}

#[tokio::test]
async fn pictures_are_pulled() {
    let network = network();
    let reader = input(&network, "/view", 4).await;
    let writer = network.open_output("/cam", &PortOptions::default()).await.unwrap();
    network.connect("/cam", "/view", Some("mjpeg")).await.unwrap();
    within(writer.wait_for_outputs(1)).await;
    let jpeg: &[u8] = &[0xff, 0xd8, 0xff, 0xe0, 0, 2, 0xff, 0xda, 0, 2, 1, 2, 3, 0xff, 0xd9];
    let fates = Arc::new(Fates::default());
    let object = PortPayload::bottle(&bottle("no picture"), network.dialect()).unwrap();
    writer.write(Message { fate: Some(fates.clone()), ..Message::new(object) });
    let envelope = Some(Bytes::from_static(b"1 2.5"));
    writer.write(Message {
        payload: PortPayload::raw(jpeg),
        envelope: envelope.clone(),
        ..Message::default()
    });
    writer.write(Message::new(PortPayload::raw(jpeg)));
    let first = next(&reader).await;
    assert_eq!((first.payload.kind, first.envelope), (PayloadKind::Raw, envelope));
    assert_eq!(&*first.from, "/cam");
    assert_eq!(next(&reader).await.payload.bytes, jpeg);
    assert_eq!(*fates.0.lock().unwrap(), [Loss::Unsendable]);
    assert_eq!(reader.status()[0].carrier, "mjpeg");
    // The program that is connected otherwise gets the objects, and no files.
    let other = input(&network, "/other", 4).await;
    writer.connect("tcp://other").await.unwrap();
    writer.write(Message::new(PortPayload::raw(jpeg)));
    writer.write_bottle(&bottle("an object")).unwrap();
    assert_eq!(next(&other).await.bottle().unwrap().to_text(), "an object");
    within(other.close()).await;
    let answer = network.admin("/view", &bottle("[list] [in] /cam")).await.unwrap();
    assert_eq!(answer.to_text(), "(from \"/cam\") (to \"/view\") (carrier mjpeg) (push 0)");
    within(reader.close()).await;
    let mut connected = writer.connected();
    within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
}

#[tokio::test]
async fn mjpeg_is_refused_where_no_pictures_are() {
    let network = network();
    let bottles = PortOptions { pictures: false, ..PortOptions::default() };
    let view = input(&network, "/view", 4).await;
    let ears = open_input(&network, "/ears", &bottles, 4).await.unwrap();
    let talk = network.open_output("/talk", &bottles).await.unwrap();
    let cam = network.open_output("/cam", &PortOptions::default()).await.unwrap();
    let refused = network.connect("/cam", "/ears", Some("mjpeg")).await.unwrap_err();
    assert!(refused.to_string().contains("port /ears has no pictures"), "{refused}");
    let refused = network.connect("/talk", "/view", Some("mjpeg")).await.unwrap_err();
    assert!(refused.to_string().contains("Cannot connect to mjpeg://talk"), "{refused}");
    assert_eq!(talk.fault_counts().get("no_pictures"), 1);
    network.connect("/cam", "/view", Some("mjpeg")).await.unwrap();
    within(view.wait_for_inputs(1)).await;
    within(cam.wait_for_outputs(1)).await;
    // A camera's readers of both kinds.
    cam.connect("tcp://ears").await.unwrap();
    assert_eq!((cam.picture_readers(), cam.connected().borrow().outputs), (1, 2));
    let jpeg: &[u8] = &[0xff, 0xd8, 0xff, 0xe0, 0, 2, 0xff, 0xda, 0, 2, 1, 2, 3, 0xff, 0xd9];
    assert_eq!(cam.write_picture(Message::new(PortPayload::raw(jpeg))).targets, 1);
    let object = PortPayload::bottle(&bottle("pixels"), network.dialect()).unwrap();
    assert_eq!(cam.write_object(Message::new(object)).targets, 1);
    assert_eq!(next(&view).await.payload.bytes, jpeg);
    assert_eq!(next(&ears).await.bottle().unwrap(), bottle("pixels"));
}

#[tokio::test]
async fn requests_are_answered_over_every_carrier_with_replies() {
    for carrier in ["tcp", "fast_tcp", "text", "text_ack", "unix_stream", "unix_stream+ack"] {
        let network = network();
        let options = PortOptions::default();
        let (server, mut requests) = queued(&network, "/server").await;
        let client = network.open_rpc_client("/client", &options).await.unwrap();
        client.connect(&format!("{carrier}://server")).await.unwrap();
        let second = client.connect("/server").await.unwrap_err();
        assert_eq!(second.to_string(), "RPC output already connected");
        let answering = tokio::spawn(async move {
            let request = requests.recv().await.unwrap();
            assert!(request.wants_reply);
            let mut reply = request.received.bottle().unwrap();
            reply.values.insert(0, "echo".into());
            assert!(request.reply.send(Answer::Bottle(reply)).is_ok());
            drop(requests.recv().await.unwrap());
            let last = requests.recv().await.unwrap();
            last.reply.send(Answer::Bottle(Bottle::new())).unwrap();
            server
        });
        let reply = client.call(&bottle("one \"two words\" 3"), TIMEOUT).await.unwrap().unwrap();
        assert_eq!(reply.to_text(), "echo one \"two words\" 3", "{carrier}");
        let forgotten = client.call(&bottle("forget"), TIMEOUT).await.unwrap();
        assert_eq!(forgotten, Some(Bottle::new()), "{carrier}");
        let empty = client.call(&bottle("empty"), TIMEOUT).await.unwrap();
        assert_eq!(empty, Some(Bottle::new()), "{carrier}");
        let server = within(answering).await.unwrap();
        within(client.close()).await;
        within(server.close()).await;
    }
}

#[tokio::test]
async fn a_late_reply_is_not_taken_for_the_next_one() {
    let network = network();
    let options = PortOptions::default();
    let (server, mut requests) = queued(&network, "/server").await;
    let client = network.open_rpc_client("/client", &options).await.unwrap();
    let none = client.call(&bottle("1"), TIMEOUT).await;
    assert!(matches!(none, Err(RpcError::NotConnected(_))), "{none:?}");
    client.connect("tcp://server").await.unwrap();
    let late = client.call(&bottle("1"), Duration::from_millis(20)).await;
    assert!(matches!(late, Err(RpcError::Timeout { .. })), "{late:?}");
    let first = within(requests.recv()).await.unwrap();
    let answering = tokio::spawn(async move {
        let second = requests.recv().await.unwrap();
        let request = second.received.bottle().unwrap();
        second.reply.send(Answer::Bottle(request)).unwrap();
        server
    });
    first.reply.send(Answer::Bottle(bottle("late"))).ok();
    let reply = client.call(&bottle("2"), TIMEOUT).await.unwrap();
    assert_eq!(reply, Some(bottle("2")));
    within(answering).await.unwrap();
}

#[tokio::test]
async fn an_input_acknowledges_and_a_client_knows_it_for_no_reply() {
    let network = network();
    let reader = input(&network, "/reader", 4).await;
    let client = network.open_rpc_client("/client", &PortOptions::default()).await.unwrap();
    for carrier in ["tcp", "text_ack"] {
        client.connect(&format!("{carrier}://reader")).await.unwrap();
        assert_eq!(client.call(&bottle("1 2"), TIMEOUT).await.unwrap(), None, "{carrier}");
        assert_eq!(next(&reader).await.bottle().unwrap(), bottle("1 2"));
        network.disconnect("/client", "/reader").await.unwrap();
    }
}

#[tokio::test]
async fn a_handler_answers_on_the_connection() {
    let network = network();
    let options = PortOptions::default();
    let server = network
        .serve("/server", &options, async |request, wanted| {
            assert!(wanted);
            Answer::Object(request.payload.bytes)
        })
        .await
        .unwrap();
    let client = network.open_rpc_client("/client", &options).await.unwrap();
    client.connect("fast_tcp://server").await.unwrap();
    for count in 0..100 {
        let request = Bottle::from(vec![count.into()]);
        assert_eq!(client.call(&request, TIMEOUT).await.unwrap(), Some(request));
    }
    drop(server);
}

#[tokio::test]
async fn a_slow_target_stalls_nobody() {
    let network = network();
    let slow = input(&network, "/slow", 1).await;
    let fast = input(&network, "/fast", 1000).await;
    for (overflow, kept) in [(Overflow::DropOldest, 99), (Overflow::DropNewest, 0)] {
        let options = PortOptions { queue: 4, overflow, ..PortOptions::default() };
        let writer = network.open_output("/writer", &options).await.unwrap();
        writer.connect("tcp://slow").await.unwrap();
        writer.connect("tcp://fast").await.unwrap();
        let mut dropped = 0;
        for count in 0..100 {
            let written = writer.write_bottle(&Bottle::from(vec![count.into()])).unwrap();
            dropped += written.dropped;
            assert_eq!(next(&fast).await.bottle().unwrap().values, [count.into()]);
        }
        // One in the reader's queue, one that waits for room there, four here.
        assert_eq!(dropped, 100 - 6);
        let mut seen = Vec::new();
        for _ in 0..6 {
            seen.push(next(&slow).await.bottle().unwrap().get(0).unwrap().as_i64().unwrap());
        }
        assert!(seen.is_sorted(), "{seen:?}");
        assert!(if kept == 99 { seen[5] == 99 } else { seen[5] < 10 }, "{seen:?}");
        within(writer.flush()).await;
        within(writer.close()).await;
    }
}

#[tokio::test]
async fn names_are_chosen_taken_and_refused() {
    let network = network();
    let options = PortOptions::default();
    let anonymous = open_input(&network, "...", &options, 4).await.unwrap();
    assert_eq!(anonymous.name(), "/tmp/port/1");
    let port = open_input(&network, "/port", &options, 4).await.unwrap();
    assert!(network.exists("/port").await);
    assert!(!network.exists("/other").await);
    let error = open_input(&network, "/port", &options, 4).await.map(drop).unwrap_err();
    assert!(error.to_string().contains("lives already"), "{error}");
    for name in ["", "/", "port", "/a b", "/a/", "/a(b)"] {
        assert!(open_input(&network, name, &options, 4).await.is_err(), "{name}");
    }
    drop(port);
    while network.query("/port").await.unwrap().is_some() {
        tokio::task::yield_now().await;
    }
    open_input(&network, "/port", &options, 4).await.unwrap();
}

#[tokio::test]
async fn a_qualifier_that_we_lack_ends_the_connection() {
    let network = network();
    let reader = input(&network, "/reader", 4).await;
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    for (count, carrier) in [(1, "fast_tcp"), (2, "tcp"), (3, "text_ack"), (4, "udp")] {
        let wanted = format!("{carrier}+recv.portmonitor+type.dll+file.nosuch://reader");
        let error = writer.connect(&wanted).await.unwrap_err();
        assert_eq!(error.to_string(), format!("Cannot connect to {wanted}"));
        assert_eq!(reader.fault_counts().get("missing_modifier"), count);
        assert_eq!(writer.connected().borrow().outputs, 0);
    }
    for modifier in ["send.portmonitor", "log.in"] {
        let error = writer.connect(&format!("tcp+{modifier}://reader")).await.unwrap_err();
        assert!(error.to_string().contains(&format!("modifier {modifier} is not")), "{error}");
    }
    let error = writer.connect("shmem://reader").await.unwrap_err();
    assert!(error.to_string().contains("is unknown: use tcp"), "{error}");
    writer.connect("tcp+recv.priority://reader").await.unwrap();
    within(reader.wait_for_inputs(1)).await;
    let listed = network.admin("/reader", &bottle("[list] [in] /writer")).await.unwrap();
    let expected = "(from \"/writer\") (to \"/reader\") (carrier \"tcp+recv.priority\")";
    assert_eq!(listed.to_text(), expected);
}

#[tokio::test]
async fn graphs_of_the_network_find_what_they_ask_for() {
    let network = network();
    let reader = input(&network, "/reader", 4).await;
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    writer.connect("tcp://reader").await.unwrap();
    within(reader.wait_for_inputs(1)).await;
    let asked = async |port: &str, about: &str| {
        let request = bottle(&format!("[prop] [get] {about}"));
        network.admin(port, &request).await.unwrap()
    };
    let about = asked("/writer", "/writer").await;
    let part =
        |key: &str| about.find(key).and_then(Value::as_list).unwrap_or_else(|| panic!("{key}"));
    let process = part("process");
    assert_eq!(process.find("pid").and_then(Value::as_i64), Some(std::process::id().into()));
    assert!(process.find("name").and_then(Value::as_str).unwrap().starts_with("main"));
    assert_eq!(part("platform").find("hostname").and_then(Value::as_str), Some("127.0.0.1"));
    let port = part("port");
    assert_eq!(port.find("is_output").and_then(Value::as_i64), Some(1));
    assert_eq!(port.find("is_input").and_then(Value::as_i64), Some(0));
    let priority = bottle("[prop] [set] /reader (qos ((priority HIGH)))");
    assert_eq!(network.admin("/writer", &priority).await.unwrap(), bottle("[ok]"));
    let connection = asked("/writer", "/reader").await;
    let qos = connection.find("qos").and_then(Value::as_list).unwrap();
    assert_eq!(qos.find("tos").and_then(Value::as_i64), Some(36 << 2));
    let none = asked("/writer", "/nobody").await;
    assert_eq!(none.to_text(), "[fail] \"cannot find any connection to/from /nobody\"");
    let attached = network.admin("/reader", &bottle("[atch] \"(type dll)\"")).await.unwrap();
    assert!(attached.to_text().starts_with("[fail] \"attach command must be"), "{attached:?}");
}

#[tokio::test]
async fn the_probe_tells_what_our_ports_speak() {
    use wrapyfi_yarp::Dialect;
    for dialect in [Dialect::V3, Dialect::V4] {
        let names = Arc::new(NameTable::new());
        let theirs = NetworkOptions { names: names.clone(), dialect, ..options() };
        let theirs = Network::new(theirs);
        let _port = input(&theirs, "/port", 4).await;
        let ours = Network::new(NetworkOptions { names, ..options() });
        assert_eq!(ours.probe_dialect("/port").await.unwrap(), dialect);
    }
}

#[tokio::test]
async fn a_second_connection_of_a_name_replaces_the_first() {
    let network = network();
    let reader = input(&network, "/reader", 4).await;
    let names = Arc::new(NameTable::new().with("/reader", reader.address()));
    let other = Network::new(NetworkOptions { names, ..options() });
    let first = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    let second = other.open_output("/writer", &PortOptions::default()).await.unwrap();
    first.connect("/reader").await.unwrap();
    within(reader.wait_for_inputs(1)).await;
    second.connect("/reader").await.unwrap();
    let mut connected = first.connected();
    within(connected.wait_for(|now| now.outputs == 0)).await.unwrap();
    second.write_bottle(&bottle("2")).unwrap();
    assert_eq!(next(&reader).await.bottle().unwrap(), bottle("2"));
    assert_eq!(reader.fault_counts().get("replaced"), 1);
}

#[tokio::test]
async fn ours_say_what_they_are() {
    let network = network();
    let plain = PortOptions::default();
    let reader = network.serve("/reader", &plain, async |_, _| Answer::Nothing).await.unwrap();
    let writer = network.open_output("/writer", &PortOptions::default()).await.unwrap();
    writer.connect("tcp://reader").await.unwrap();
    let client = network.open_rpc_client("/ask", &PortOptions::default()).await.unwrap();
    let options = PortOptions { rpc: true, ..PortOptions::default() };
    let server = network.serve("/rpc", &options, async |_, _| Answer::Nothing).await.unwrap();
    for (name, modes, inputs, outputs) in [
        ("/reader", (true, false, false), vec!["/writer".to_owned()], vec![]),
        ("/writer", (false, true, false), vec![], vec!["/reader".into()]),
        ("/ask", (false, true, true), vec![], vec![]),
        ("/rpc", (true, false, true), vec![], vec![]),
    ] {
        let (input, output, rpc) = modes;
        let wanted = Inspection {
            modes: Some(Modes { input, output, rpc }),
            type_name: None,
            inputs,
            outputs,
        };
        let contact = network.query(name).await.unwrap().unwrap().contact();
        for contact in [None, Some(contact.as_str())] {
            assert_eq!(network.inspect(name, contact, true).await.unwrap(), wanted, "{name}");
        }
    }
    let wanted = Inspection { outputs: vec!["/reader".to_owned()], ..Inspection::default() };
    assert_eq!(network.inspect("/writer", None, false).await.unwrap(), wanted);
    drop((reader, writer, client, server));
    assert!(network.inspect("/nobody", None, true).await.is_err());
}
