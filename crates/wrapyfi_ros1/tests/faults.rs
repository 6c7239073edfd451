//! ROS 1 against peers that misbehave, and a master that goes and comes back.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::time::Duration;

use crate::common::{
    Master, RawPublisher, call, data_port, framed, greet, node, plain, read_framed, said,
};
use wrapyfi_conformance::{ClientEnd, ServerEnd, Sink, Source, wait_until};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{ServiceKind, Value as Object};
use wrapyfi_endpoint::{CallError, CauseCode, DropReason, QosPreset, ServiceSpec, WAITING, Wake};
use wrapyfi_ros1::Ros1;
use wrapyfi_ros1::header::Header;
use wrapyfi_ros1::xmlrpc::{Value, text};

const STRING: &str = "992ce8a1687cec8c8bd883ec73ca41d1";

fn strings() -> Header {
    Header::new().with("type", "std_msgs/String").with("md5sum", STRING)
}

fn subscriber(topic: &str, md5: &str) -> Header {
    let header = Header::new().with("callerid", "/raw").with("topic", topic);
    header.with("type", "std_msgs/String").with("md5sum", md5)
}

/// `u32 │ u32 │ text`
fn message(text: &str) -> Vec<u8> {
    framed(&framed(text.as_bytes()))
}

/// Whatever a peer sends instead of a header, it is told no, and others are served.
#[test]
fn hostile_headers_are_refused_and_others_served() {
    let master = Master::start();
    let node = node(&master, "near");
    let mut source = Source::open(&node, &plain("/x"));
    let port = data_port(&node, "/x");
    let mut long = Header::new().encode().unwrap();
    long[..4].copy_from_slice(&u32::MAX.to_le_bytes());
    let beyond = framed(b"\xff\xff\xff\xffab");
    let no_topic = Header::new().with("callerid", "/raw").encode().unwrap();
    let stranger = subscriber("/elsewhere", "*").encode().unwrap();
    let mismatch = subscriber("/x", "0123").encode().unwrap();
    let http = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n".to_vec();
    for (bytes, words) in [
        (long, "the limit is 1048576"),
        (beyond, "needs 4294967295 bytes"),
        (no_topic, "needs a topic or a service"),
        (stranger, "does not publish /elsewhere"),
        (mismatch, "std_msgs/String [992ce8a1687cec8c8bd883ec73ca41d1]"),
        (http, "is this TCPROS at all?"),
    ] {
        let mut stream = TcpStream::connect(&port).unwrap();
        stream.write_all(&bytes).unwrap();
        let refusal = Header::decode(&read_framed(&mut stream).unwrap()).unwrap();
        let error = refusal.get("error").unwrap();
        assert!(error.contains(words), "{error}");
        assert_eq!(stream.read(&mut [0]).unwrap_or(0), 0, "the connection ends");
    }
    let (mut stream, header) = greet(&port, &subscriber("/x", STRING));
    assert_eq!(header.get("md5sum"), Some(STRING));
    source.wait_for_listener();
    source.send(&said("still here"));
    assert_eq!(read_framed(&mut stream).unwrap(), framed(b"still here"));
}

/// Broken messages are counted, absurd sizes cut the connection, which is made anew.
#[test]
fn wrong_lengths_are_counted_and_survived() {
    let master = Master::start();
    let node = node(&master, "near");
    let mut sink = Sink::open(&node, &plain("/x"));
    let raw = RawPublisher::start(&master, "/raw", "/x", &strings());
    let wake = sink.context.wake.clone();
    let joined = |count: usize| {
        wait_until(&wake, "the subscriber", || raw.subscribers() >= count);
    };
    joined(1);
    raw.send(&framed(b"\xff\xff\xff\xffabc"));
    raw.send(&message("one"));
    assert_eq!(sink.receive(), said("one"));
    assert_eq!(sink.counters().dropped_for(DropReason::Malformed), 1);
    raw.send(b"\xff\xff\xff\xff");
    joined(2);
    raw.send(&message("two"));
    assert_eq!(sink.receive(), said("two"));
    raw.hang_up();
    joined(1);
    raw.send(&message("three"));
    assert_eq!(sink.receive(), said("three"));
}

/// A publisher that latches sends its message again with a new connection: it is no news.
#[test]
fn a_latched_message_comes_once() {
    let master = Master::start();
    let node = node(&master, "near");
    let mut sink = Sink::open(&node, &plain("/x"));
    let raw = RawPublisher::start(&master, "/raw", "/x", &strings().with("latching", "1"));
    let wake = sink.context.wake.clone();
    let joined = || wait_until(&wake, "the subscriber", || raw.subscribers() == 1);
    joined();
    raw.send(&message("kept"));
    assert_eq!(sink.receive(), said("kept"));
    raw.hang_up();
    joined();
    raw.send(&message("kept"));
    raw.send(&message("new"));
    assert_eq!(sink.receive(), said("new"));
    assert_eq!(sink.counters().dropped_for(DropReason::Duplicate), 1);
}

/// Calls to the XML-RPC port that are none, and those that no program should make.
#[test]
fn hostile_calls_are_refused_and_others_answered() {
    let master = Master::start();
    let node = node(&master, "near");
    let uri = node.api_uri();
    let address = uri.trim_start_matches("http://").trim_end_matches('/');
    let post = |body: &str| {
        let mut stream = TcpStream::connect(address).unwrap();
        let head = format!("POST / HTTP/1.1\r\nContent-Length: {}\r\n", body.len());
        stream.write_all(format!("{head}Connection: close\r\n\r\n{body}").as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let deep = "<value><array><data>".repeat(10_000);
    let entities = "<!DOCTYPE x [<!ENTITY a \"aa\">]><methodCall>&a;</methodCall>";
    for (body, words) in [
        (deep.as_str(), "nests deeper than 64"),
        (entities, "document type"),
        ("<methodCall><methodName>rm</methodName></methodCall>", "there is no method"),
        ("no xml", "no XML-RPC call"),
    ] {
        let answer = post(body);
        assert!(answer.contains("faultString") && answer.contains(words), "{answer}");
    }
    let get = {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    assert!(get.starts_with("HTTP/1.1 405"), "{get}");
    let wrong = call(&uri, "publisherUpdate", vec![text("/m"), text("/x"), text("no list")]);
    assert_eq!(wrong.unwrap().status, -1);
    let name = call(&uri, "getName", vec![text("/raw")]).unwrap();
    assert_eq!(name.value, text("/near"));
}

/// Addresses of publishers that lead nowhere cost the others nothing.
#[test]
fn unreachable_publishers_stop_nobody() {
    let master = Master::start();
    let near = node(&master, "near");
    for (n, api) in
        ["http://127.0.0.1:9/", "http://192.0.2.1:11411/", "http://no.such.host:1/", "x"]
            .into_iter()
            .enumerate()
    {
        let who = text(format!("/gone{n}"));
        master.ask("registerPublisher", vec![who, text("/x"), text("std_msgs/String"), text(api)]);
    }
    let mut sink = Sink::open(&near, &plain("/x"));
    let far = node(&master, "far");
    let mut source = Source::open(&far, &plain("/x"));
    source.wait_for_listener();
    source.send(&said("heard"));
    assert_eq!(sink.receive(), said("heard"));
    assert_eq!(sink.listener.link().peers, Some(1));
}

/// Several latched publishers of one node on one topic: each one's last message, once each.
#[test]
fn every_latched_publisher_of_a_node_is_replayed() {
    let master = Master::start();
    let (near, far) = (node(&master, "near"), node(&master, "far"));
    let mut spec = plain("/x");
    spec.qos = QosPreset::Latched.into();
    let mut sources = [Source::open(&near, &spec), Source::open(&near, &spec)];
    for (source, text) in sources.iter_mut().zip(["first", "second"]) {
        source.send(&said("old"));
        source.send(&said(text));
    }
    let mut sink = Sink::open(&far, &spec);
    assert_eq!(sink.receive_many(2), [said("first"), said("second")]);
    drop(sources);
    sink.wait_for("nobody", |link| link.peers == Some(0));
    assert_eq!(sink.counters().received, 2);
}

/// A node that is told to shut down leaves, and says who told it.
#[test]
fn a_node_that_is_told_to_shut_down_leaves() {
    let master = Master::start();
    let near = node(&master, "near");
    let source = Source::open(&near, &plain("/x"));
    let far = node(&master, "far");
    let sink = Sink::open(&far, &plain("/x"));
    source.wait_for_listener();
    call(&near.api_uri(), "shutdown", vec![text("/master"), text("new node of the name")]).unwrap();
    source.wait_for("the reason", |link| {
        let reason = link.waiting_for.as_ref().map(ToString::to_string).unwrap_or_default();
        reason.starts_with("/master at 127.0.0.1:")
            && reason.ends_with(" told this node to shut down: new node of the name")
    });
    sink.wait_for("nobody", |link| link.peers == Some(0));
    let wake = source.context.wake.clone();
    wait_until(&wake, "the master to know", || {
        let state = master.ask("getSystemState", vec![text("/raw")]);
        !format!("{:?}", state.value).contains("/near")
    });
}

/// The master ends: connections stay. It comes back, knowing nothing: it is told everything again.
#[test]
fn a_master_that_comes_back_is_told_again() {
    let master = Master::start();
    let port = master.port();
    let (near, far) = (node(&master, "near"), node(&master, "far"));
    let mut source = Source::open(&near, &plain("/x"));
    let mut sink = Sink::open(&far, &plain("/x"));
    source.wait_for_listener();
    let idle = Source::open(&near, &plain("/idle"));
    drop(master);
    idle.wait_for("the fault", |link| {
        link.waiting_for.as_ref().is_some_and(|why| why.code() == CauseCode::ServerAway)
    });
    source.send(&said("without a master"));
    assert_eq!(sink.receive(), said("without a master"));
    let master = Master::at(port);
    let mut late = Sink::open(&far, &plain("/idle"));
    let mut idle = idle;
    idle.wait_for_listener();
    idle.send(&said("found again"));
    assert_eq!(late.receive(), said("found again"));
    source.send(&said("as ever"));
    assert_eq!(sink.receive(), said("as ever"));
    drop((source, sink, idle, late, near, far));
    let state = master.ask("getSystemState", vec![text("/raw")]);
    assert_eq!(state.value, Value::Array(vec![Value::Array(vec![]); 3]), "nothing is left");
}

/// A subscriber that does not read fills its own queue only, and that is counted.
#[test]
fn a_slow_subscriber_stalls_nobody() {
    let master = Master::start();
    let (near, far) = (node(&master, "near"), node(&master, "far"));
    let mut source = Source::open(&near, &plain("/x"));
    let (silent, _header) = greet(&data_port(&near, "/x"), &subscriber("/x", "*"));
    let mut sink = Sink::open(&far, &plain("/x"));
    source.wait_for("both", |link| link.peers == Some(2));
    let large = "x".repeat(1 << 20);
    for n in 0..40 {
        source.send(&said(&large));
        source.send(&said(&n.to_string()));
        assert_eq!(sink.receive_many(2), [said(&large), said(&n.to_string())]);
    }
    let dropped = |reason| source.context.counters.snapshot().dropped_for(reason);
    assert!(dropped(DropReason::SendQueueFull) > 0);
    assert_eq!(sink.counters().dropped(), 0);
    // Messages that wait for a subscriber when it leaves are lost, and counted.
    assert_eq!(dropped(DropReason::ConnectionLost), 0);
    drop(silent);
    source.wait_for("one", |link| link.peers == Some(1));
    assert!(dropped(DropReason::ConnectionLost) > 0);
}

/// A server of `/big`, and its address.
fn big_service(master: &Master, node: &Ros1) -> (ServerEnd, String) {
    let server = ServerEnd::open(node, &ServiceSpec::new("/big", ServiceKind::NativeObject));
    let mut address = String::new();
    wait_until(Wake::new(), "the service", || {
        let found = master.ask("lookupService", vec![text("/raw"), text("/big")]).value;
        let Value::String(uri) = found else { return false };
        address = uri.trim_start_matches("rosrpc://").trim_end_matches('/').to_owned();
        !address.is_empty()
    });
    (server, address)
}

/// A client that does not read its reply, which is more than TCP takes.
fn ask_big(server: &mut ServerEnd, address: &str) -> TcpStream {
    let own = Header::new().with("callerid", "/raw").with("service", "/big").with("md5sum", "*");
    let (mut client, _header) = greet(address, &own);
    client.write_all(&message("[[], {}]")).unwrap();
    let request = server.receive();
    server.answer(request.id, said(&"x".repeat(12 * Limits::MIB)));
    client
}

#[test]
fn a_reply_that_its_node_ends_in_the_middle_of_is_counted() {
    let master = Master::start();
    let near = node(&master, "near");
    let (mut server, address) = big_service(&master, &near);
    let mut client = ask_big(&mut server, &address);
    client.read_exact(&mut [0; 5]).unwrap();
    assert_eq!(server.counters().sent, 1, "it is on its way");
    drop(near);
    let counted = server.counters();
    assert_eq!((counted.sent, counted.dropped_for(DropReason::Closed)), (0, 1), "{counted:?}");
    drop(server);
    assert_eq!(WAITING.used(), 0);
}

/// Clients that never read their replies cost their server a quarter of what may wait; the others are told.
#[test]
fn replies_that_nobody_reads_are_bounded_in_bytes() {
    // Each test is a process of its own.
    WAITING.set_limit(128 * Limits::MIB);
    let (master, bell) = (Master::start(), Wake::new());
    let near = node(&master, "near");
    let (mut server, address) = big_service(&master, &near);
    let ask = |server: &mut ServerEnd| ask_big(server, &address);
    let silent: Vec<TcpStream> = (0..6).map(|_| ask(&mut server)).collect();
    wait_until(&bell, "replies without room", || server.dropped_for(DropReason::OverBudget) == 4);
    assert!(WAITING.used() <= 32 * Limits::MIB, "{} bytes wait", WAITING.used());
    let mut told = ask(&mut server);
    let mut success = [1];
    told.read_exact(&mut success).unwrap();
    let why = read_framed(&mut told).unwrap();
    assert_eq!(success, [0]);
    assert!(String::from_utf8_lossy(&why).contains("waiting_mib"), "{why:?}");
    drop(silent);
    wait_until(&bell, "those that are gone", || {
        server.dropped_for(DropReason::ConnectionLost) == 2
    });
    let counted = server.counters();
    assert_eq!((counted.received, counted.sent, counted.dropped()), (7, 0, 7), "{counted:?}");
    assert_eq!(WAITING.used(), 0);
}

/// Connections that a raw server has not welcomed yet: now, and at most so far.
static UNWELCOMED: AtomicUsize = AtomicUsize::new(0);
static MOST_UNWELCOMED: AtomicUsize = AtomicUsize::new(0);

/// A server of `/ask` that answers `true`; after as many connections as `welcomes` the others are not welcomed.
fn raw_server(master: &Master, welcomes: usize) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let uri = format!("rosrpc://127.0.0.1:{}", listener.local_addr().unwrap().port());
    let own = Header::new().with("type", "a/B").with("md5sum", "*").encode().unwrap();
    std::thread::spawn(move || {
        for (number, mut stream) in listener.incoming().map_while(Result::ok).enumerate() {
            MOST_UNWELCOMED.fetch_max(UNWELCOMED.fetch_add(1, SeqCst) + 1, SeqCst);
            let own = own.clone();
            std::thread::spawn(move || {
                read_framed(&mut stream)?;
                if number >= welcomes {
                    _ = stream.read(&mut [0]);
                    return Ok(());
                }
                // All the others have come meanwhile, if nothing holds them back.
                std::thread::sleep(Duration::from_millis(20));
                UNWELCOMED.fetch_sub(1, SeqCst);
                stream.write_all(&own)?;
                while read_framed(&mut stream).is_ok() {
                    stream.write_all(&[&[1][..], &message("true")].concat())?;
                }
                Ok::<_, std::io::Error>(())
            });
        }
    });
    let params = ["/raw", "/ask", uri.as_str(), "http://127.0.0.1:9/"].map(text);
    master.ask("registerService", params.to_vec());
}

#[test]
fn calls_at_once_wait_for_the_five_connections_that_a_server_holds() {
    let master = Master::start();
    let near = node(&master, "near");
    raw_server(&master, usize::MAX);
    let mut client = ClientEnd::open(&near, &ServiceSpec::new("/ask", ServiceKind::NativeObject));
    client.ready();
    let tickets: Vec<_> = (0..60).map(|n| client.ask([Object::from(n)])).collect();
    for ticket in tickets {
        let answer = client.await_with(ticket, || ());
        assert_eq!(answer, Ok(Object::from(true).into()));
    }
    let most = MOST_UNWELCOMED.load(SeqCst);
    assert!(most <= 5, "{most} connections at once");
}

#[test]
fn a_call_that_no_connection_has_come_for_says_so() {
    let master = Master::start();
    let near = node(&master, "near");
    // The question for its type is answered.
    raw_server(&master, 1);
    let mut client = ClientEnd::open(&near, &ServiceSpec::new("/ask", ServiceKind::NativeObject));
    client.ready();
    let tickets = [(); 8].map(|()| client.ask_within([], Duration::from_millis(200)));
    for ticket in tickets {
        let Err(CallError::TimedOut { why, .. }) = client.await_with(ticket, || ()) else {
            panic!("it was answered")
        };
        assert!(why.contains("5 connections to its server at 127.0.0.1:"), "{why}");
    }
}
