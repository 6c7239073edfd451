//! Clients, servers and the broker of requests on ZeroMQ against bare sockets: what Python Wrapyfi's
//! REQ and REP see, and what hostile ones can do.

use std::time::Duration;

use crate::common::{raw_peer, send_without_end};
use wrapyfi_conformance::{TIMEOUT, wait_for};
use wrapyfi_data::types::{Encoding, Image, Payload, RawPixels, ServiceKind, Stamp, Value};
use wrapyfi_endpoint::{
    CallError, Client, Context, DropReason, Middleware, Request, Server, ServiceSpec, Wake,
};
use wrapyfi_zeromq::codec::mark::{Kind, Mark, SIZE};
use wrapyfi_zeromq::{BrokerMode, ServiceBroker, ServiceBrokerStatus, ZeroMq, ZeroMqConfig};

fn until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    wait_for(Wake::new(), what, look)
}

fn broker(pending: usize) -> ServiceBroker {
    let config = ZeroMqConfig { rep_port: 0, req_port: 0, pending, ..Default::default() };
    ServiceBroker::start(&config).unwrap()
}

fn broker_is(broker: &ServiceBroker, what: &str, is: impl Fn(&ServiceBrokerStatus) -> bool) {
    until(what, || is(&broker.status()).then_some(()));
}

fn zeromq(broker: &ServiceBroker) -> ZeroMq {
    let config = ZeroMqConfig {
        rep_port: broker.rep_port(),
        req_port: broker.req_port(),
        broker: BrokerMode::Foreign,
        service_broker: BrokerMode::Foreign,
        ..ZeroMqConfig::default()
    };
    ZeroMq::start(&config).unwrap()
}

/// A bare socket at a port; its context ends with the process.
fn bare(kind: zmq::SocketType, port: u16) -> zmq::Socket {
    let socket = zmq::Context::new().socket(kind).unwrap();
    socket.set_linger(0).unwrap();
    socket.set_rcvtimeo(30_000).unwrap();
    socket.connect(&format!("tcp://127.0.0.1:{port}")).unwrap();
    socket
}

fn native() -> ServiceSpec {
    ServiceSpec::new("/x", ServiceKind::NativeObject)
}

fn client(zeromq: &ZeroMq, spec: &ServiceSpec) -> (Box<dyn Client>, Context) {
    let context = Context::default();
    let client = zeromq.open_client(spec, &context).unwrap();
    until("the broker", || client.link().waiting_for.is_none().then_some(()));
    (client, context)
}

fn server(zeromq: &ZeroMq, spec: &ServiceSpec) -> (Box<dyn Server>, Context) {
    let context = Context::default();
    let server = zeromq.open_server(spec, &context).unwrap();
    until("the broker", || server.link().waiting_for.is_none().then_some(()));
    (server, context)
}

/// Answers everything with its arguments.
fn echo(server: &mut dyn Server) {
    while let Ok(Some(asked)) = server.take() {
        server
            .reply(asked.id, Ok(Value::List(asked.request.into_call().unwrap().args).into()))
            .unwrap();
    }
}

#[test]
fn a_rep_server_hands_the_mark_back() {
    let broker = broker(64);
    let zeromq = zeromq(&broker);
    let (mut client, _) = client(&zeromq, &native());
    let python = bare(zmq::REP, broker.req_port());
    for n in 0..3_i64 {
        let ticket = client.send(&Request::new([n.into()]), TIMEOUT).unwrap();
        // Exactly one frame, as Wrapyfi's recv_string and the send after it need.
        let asked = python.recv_multipart(0).unwrap();
        let wanted = format!(r#"[{{"__wrapyfi__": ["tuple", [{n}]]}}, {{}}]"#);
        assert_eq!(asked, [wanted.into_bytes()]);
        python.send(format!("{{\"n\": {n}}}").as_str(), 0).unwrap();
        let reply = until("the reply", || client.take_only(ticket)).unwrap();
        let Payload::NativeObject(value) = reply.payload else { panic!() };
        assert_eq!(value.get("n"), Some(&Value::Int(n)));
    }
}

#[test]
fn a_req_client_sees_wrapyfis_form_only() {
    let broker = broker(64);
    let zeromq = zeromq(&broker);
    let spec = ServiceSpec::new("/x", ServiceKind::Image);
    let (mut server, _) = server(&zeromq, &spec);
    let python = bare(zmq::REQ, broker.rep_port());
    let raw = RawPixels::dense(1, 1, Encoding::Bgr8, vec![1, 2, 3]).unwrap();
    let payload: Payload = Image::new(Stamp { sec: 7, nanosec: 5 }, raw).into();
    let answer = |server: &mut dyn Server| {
        let asked = until("the request", || server.take().unwrap());
        assert_eq!(asked.request, Request::new([5.into()]));
        server.reply(asked.id, Ok(payload.clone())).unwrap();
    };
    for _ in 0..2 {
        python.send("[[5], {}]", 0).unwrap();
        answer(server.as_mut());
        assert_eq!(python.recv_multipart(0).unwrap(), [b"{\"img\": [[[1, 2, 3]]]}".to_vec()]);
    }
    // One of ours gets the stamp, too, which the lists have no place for.
    let (mut ours, _) = client(&zeromq, &spec);
    let ticket = ours.send(&Request::new([5.into()]), TIMEOUT).unwrap();
    answer(server.as_mut());
    let reply = until("the reply", || ours.take_only(ticket)).unwrap();
    assert_eq!(reply.payload, payload);
}

#[test]
fn a_req_client_is_told_what_went_wrong_and_may_go_on() {
    let broker = broker(64);
    let zeromq = zeromq(&broker);
    let spec = ServiceSpec { timeout: Duration::from_millis(300), ..native() };
    let (mut server, context) = server(&zeromq, &spec);
    let python = bare(zmq::REQ, broker.rep_port());
    let told = |words: &str| {
        let reply = python.recv_string(0).unwrap().unwrap();
        let error: serde_json::Value = serde_json::from_str(&reply).unwrap();
        assert!(error["error"].as_str().unwrap().contains(words), "{reply}");
        let tag = error["__wrapyfi__"].as_array().unwrap();
        assert_eq!(tag[0], "datetime");
        assert!(tag[1].as_str().unwrap().starts_with("error: "), "{reply}");
    };
    python.send("{", 0).unwrap();
    let refused = until("the refusal", || server.take().err());
    assert!(refused.to_string().contains("malformed JSON"), "{refused}");
    told("malformed JSON");
    python.send("[[], {}]", 0).unwrap();
    let asked = until("the request", || server.take().unwrap());
    server.reply(asked.id, Err("no camera".into())).unwrap();
    told("no camera");
    python.send("[[], {}]", 0).unwrap();
    until("the request", || server.take().unwrap());
    until("its end", || {
        assert!(server.take().unwrap().is_none());
        (context.counters.snapshot().dropped_for(DropReason::Expired) == 1).then_some(())
    });
    told("did not answer within 300 ms");
    python.send("[[], {}]", 0).unwrap();
    until("the request", || server.take().unwrap());
    drop(server);
    told("ended before it answered");
}

#[test]
fn servers_are_asked_in_turn() {
    let broker = broker(64);
    let zeromq = zeromq(&broker);
    let (mut client, _) = client(&zeromq, &native());
    let mut servers: Vec<_> = (0..3).map(|_| server(&zeromq, &native())).collect();
    // One more of the other kind.
    let python = bare(zmq::REP, broker.req_port());
    let mut tickets: Vec<_> =
        (0..16).map(|n| client.send(&Request::new([n.into()]), TIMEOUT).unwrap()).collect();
    until("all replies", || {
        servers.iter_mut().for_each(|(server, _)| echo(server.as_mut()));
        if python.recv_multipart(zmq::DONTWAIT).is_ok() {
            python.send("[]", 0).unwrap();
        }
        tickets.retain(|&ticket| client.take_only(ticket).map(Result::unwrap).is_none());
        tickets.is_empty().then_some(())
    });
    for (_, context) in &servers {
        assert!(context.counters.snapshot().sent >= 3, "{:?}", context.counters.snapshot());
    }
}

#[test]
fn what_waits_for_a_server_is_bounded_and_does_not_grow_old() {
    let broker = broker(2);
    let zeromq = zeromq(&broker);
    let (mut client, context) = client(&zeromq, &native());
    let short = Duration::from_millis(300);
    let old = client.send(&Request::new([1.into()]), short).unwrap();
    broker_is(&broker, "the first", |status| status.waiting == 1);
    let patient = bare(zmq::REQ, broker.rep_port());
    patient.send("[[2], {}]", 0).unwrap();
    broker_is(&broker, "the second", |status| status.waiting == 2);
    // A third is one too many: the program that asks is told.
    let third = client.send(&Request::new([3.into()]), TIMEOUT).unwrap();
    let told = until("the refusal", || client.take_only(third)).unwrap_err();
    let CallError::Refused { reason, .. } = &told else { panic!("{told:?}") };
    assert!(reason.contains("2 requests wait for a server"), "{reason}");
    let python = bare(zmq::REQ, broker.rep_port());
    python.send("[[4], {}]", 0).unwrap();
    assert!(python.recv_string(0).unwrap().unwrap().contains("2 requests wait"));
    broker_is(&broker, "both refusals to be counted", |status| status.overloaded == 2);
    let error = until("the time-out", || client.take_only(old)).unwrap_err();
    assert!(matches!(error, CallError::TimedOut { .. }), "{error:?}");
    broker_is(&broker, "the first to be dropped", |status| status.expired == 1);
    // Wrapyfi's own client waits for ever: it is served.
    let (mut server, served) = server(&zeromq, &native());
    let replied = until("the patient one", || {
        echo(server.as_mut());
        patient.recv_string(zmq::DONTWAIT).ok()
    });
    assert_eq!(replied.unwrap(), "[2]");
    assert_eq!(served.counters.snapshot().sent, 1);
    assert_eq!(context.counters.snapshot().dropped_for(DropReason::Late), 0);
}

#[test]
fn frames_that_are_no_request_are_counted_and_passed_over() {
    let broker = broker(64);
    let zeromq = zeromq(&broker);
    let (mut server, context) = server(&zeromq, &native());
    let hostile = bare(zmq::DEALER, broker.rep_port());
    let empty = Vec::new();
    let long = vec![b'x'; 2000];
    // No empty frame; nothing behind it; too many frames; too long an envelope.
    hostile.send_multipart([b"[[], {}]".to_vec()], 0).unwrap();
    hostile.send_multipart([empty.clone()], 0).unwrap();
    hostile.send_multipart([empty.clone(), b"a".to_vec(), b"b".to_vec()], 0).unwrap();
    hostile.send_multipart([long, empty.clone(), b"[[], {}]".to_vec()], 0).unwrap();
    hostile.send_multipart(vec![b"y".to_vec(); 40], 0).unwrap();
    broker_is(&broker, "the broken ones", |status| status.malformed == 5);
    // An envelope with frames that are not ours comes back as it was.
    let strange = [b"who".to_vec(), vec![7; SIZE], empty.clone(), b"[[9], {}]".to_vec()];
    hostile.send_multipart(strange.clone(), 0).unwrap();
    let asked = until("the request", || server.take().unwrap());
    assert_eq!(asked.request, Request::new([9.into()]));
    server.reply(asked.id, Ok(Value::from(1).into())).unwrap();
    let mut replies = Vec::new();
    until("the reply", || {
        replies.push(hostile.recv_multipart(0).unwrap());
        (replies.last().unwrap()[0] == b"who").then_some(())
    });
    assert_eq!(
        replies.last().unwrap()[..],
        [strange[0].clone(), strange[1].clone(), empty, b"1".to_vec()]
    );
    assert_eq!(context.counters.snapshot().dropped(), 0);
}

#[test]
fn replies_that_nobody_waits_for_are_counted() {
    let broker = broker(64);
    let zeromq = zeromq(&broker);
    let (mut client, context) = client(&zeromq, &native());
    let python = bare(zmq::DEALER, broker.req_port());
    let ticket = client.send(&Request::default(), TIMEOUT).unwrap();
    let asked = python.recv_multipart(0).unwrap();
    let mark = Mark::decode(&asked[1]).unwrap();
    assert_eq!((mark.kind, asked[2].len()), (Kind::Request, 0));
    let send = |mark: Mark, body: &[u8]| {
        let frames = [asked[0].clone(), mark.encode(), Vec::new(), body.to_vec()];
        python.send_multipart(frames, 0).unwrap();
    };
    send(Mark { number: u64::MAX, ..mark }, b"1");
    send(Mark { number: 77, ..mark }, b"1");
    // To a client that does not exist.
    python.send_multipart([b"nobody".to_vec(), Vec::new(), b"1".to_vec()], 0).unwrap();
    send(Mark { kind: Kind::Error, ..mark }, b"\xffno");
    send(mark, b"5");
    let told = until("the first answer", || client.take_only(ticket)).unwrap_err();
    assert!(
        matches!(&told, CallError::Refused { reason, .. } if reason.ends_with("no")),
        "{told:?}"
    );
    until("the others", || {
        assert!(client.take().is_none());
        let now = context.counters.snapshot();
        let expected = (2, 1);
        ((now.dropped_for(DropReason::Late), now.dropped_for(DropReason::Malformed)) == expected)
            .then_some(())
    });
    broker_is(&broker, "the lost one", |status| status.unheard == 1);
}

/// Replies that a broker has no room for are still sent when their server ends.
#[test]
fn a_server_that_ends_sends_the_replies_that_wait() {
    const REPLIES: u64 = 12;
    let broker = zmq::Context::new().socket(zmq::DEALER).unwrap();
    broker.set_linger(0).unwrap();
    broker.set_rcvtimeo(2_000).unwrap();
    // It holds little, and TCP on the way to it.
    broker.set_rcvhwm(1).unwrap();
    broker.set_rcvbuf(64 * 1024).unwrap();
    broker.bind("tcp://127.0.0.1:*").unwrap();
    let endpoint = broker.get_last_endpoint().unwrap().unwrap();
    let port = endpoint.rsplit(':').next().unwrap().parse().unwrap();
    let foreign = BrokerMode::Foreign;
    let (rep_port, req_port) = (port, port);
    let config = ZeroMqConfig { rep_port, req_port, ..ZeroMqConfig::default() };
    let zeromq =
        ZeroMq::start(&ZeroMqConfig { broker: foreign, service_broker: foreign, ..config });
    let zeromq = zeromq.unwrap();
    let (mut server, context) = server(&zeromq, &native());
    for _ in 0..REPLIES {
        broker.send_multipart([&b"client"[..], b"", b"[[], {}]"], 0).unwrap();
        let asked = until("a request", || server.take().unwrap());
        let reply = Value::Str("x".repeat(1 << 20));
        server.reply(asked.id, Ok(reply.into())).unwrap();
    }
    drop(server);
    let read = std::iter::from_fn(|| broker.recv_multipart(0).ok()).count();
    let counted = context.counters.snapshot();
    assert_eq!(
        (read as u64, counted.sent, counted.dropped()),
        (REPLIES, REPLIES, 0),
        "{counted:?}"
    );
}

#[test]
fn the_first_server_brings_the_broker_and_the_next_process_uses_it() {
    let start = |rep_port, req_port| {
        let config = ZeroMqConfig {
            broker: BrokerMode::Foreign,
            rep_port,
            req_port,
            ..ZeroMqConfig::default()
        };
        ZeroMq::start(&config).unwrap()
    };
    let first = start(0, 0);
    assert!(first.service_broker_status().is_none());
    let (mut server, _) = server(&first, &native());
    assert!(first.service_broker_status().is_some());
    let (rep_port, req_port) = first.start_services().unwrap();
    let second = start(rep_port, req_port);
    assert_eq!(second.start_services().unwrap(), (rep_port, req_port));
    assert!(second.service_broker_status().is_none());
    let (mut client, _) = client(&second, &native());
    let ticket = client.send(&Request::new([1.into()]), TIMEOUT).unwrap();
    until("the reply", || {
        echo(server.as_mut());
        client.take_only(ticket)
    })
    .unwrap();
    // It goes away: the other takes over, and a server there answers the same client.
    drop((server, first));
    until("the second to be the broker", || second.service_broker_status());
    let (mut server, _) = self::server(&second, &native());
    let ticket = client.send(&Request::new([2.into()]), TIMEOUT).unwrap();
    until("the reply of the second", || {
        echo(server.as_mut());
        client.take_only(ticket)
    })
    .unwrap();
}

/// A broker tells its clients nothing of servers, but the one of their own process.
#[test]
fn a_client_knows_whether_a_server_is_at_the_broker_of_its_process() {
    let config = ZeroMqConfig {
        broker: BrokerMode::Foreign,
        rep_port: 0,
        req_port: 0,
        ..ZeroMqConfig::default()
    };
    let zeromq = ZeroMq::start(&config).unwrap();
    let (mut client, _) = client(&zeromq, &native());
    until("nobody", || (client.link().peers == Some(0)).then_some(()));
    let ticket = client.send(&Request::new([1.into()]), Duration::from_millis(200)).unwrap();
    let error = until("the end of the call", || client.take_only(ticket)).unwrap_err().to_string();
    assert!(error.contains("no server is connected to the broker"), "{error}");
    let (_, req_port) = zeromq.start_services().unwrap();
    let python = bare(zmq::REP, req_port);
    until("the server", || (client.link().peers == Some(1)).then_some(()));
    drop(python);
    until("its end", || (client.link().peers == Some(0)).then_some(()));
}

#[test]
fn ports_that_cannot_be_are_named() {
    let start = |rep_port, req_port, ip: &str| {
        let config = ZeroMqConfig { rep_port, req_port, ip: ip.to_owned(), ..Default::default() };
        ServiceBroker::start(&config).map(drop).unwrap_err().to_string()
    };
    assert!(start(4000, 4000, "127.0.0.1").starts_with("rep_port and req_port are both 4000"));
    assert!(start(0, 0, "0.0.0.0").contains("insecure: true"));
    let taken = broker(1);
    assert!(start(taken.rep_port(), 0, "127.0.0.1").contains("is taken"));
    // A port that belongs to something else is named with what it is.
    let wrong = ZeroMqConfig {
        broker: BrokerMode::Foreign,
        rep_port: taken.req_port(),
        req_port: taken.rep_port(),
        ..ZeroMqConfig::default()
    };
    let error = ZeroMq::start(&wrong).unwrap().start_services().unwrap_err().to_string();
    assert!(error.contains("a ZeroMQ socket of type DEALER; a broker would be ROUTER"), "{error}");
    assert!(error.contains("rep_port, req_port"), "{error}");
}

#[test]
fn requests_and_replies_that_never_end_cost_their_connection_and_are_counted() {
    let limit = 8 << 20;
    let broker = ServiceBroker::start(&ZeroMqConfig {
        rep_port: 0,
        req_port: 0,
        max_frame_bytes: limit,
        ..Default::default()
    });
    let broker = broker.unwrap();
    for (times, (kind, port)) in
        (1..).zip([("DEALER", broker.rep_port()), ("REP", broker.req_port())])
    {
        let mut endless = raw_peer(port, kind);
        let sent = send_without_end(&mut endless, 1 << 20, 8 * limit);
        assert!(sent < 4 * limit, "{sent} bytes of one message were taken");
        broker_is(&broker, "the connection to be counted", |status| {
            status.cut.get("oversize") == Some(&times)
        });
    }
    // Others have noticed nothing.
    let (client, server) = (bare(zmq::REQ, broker.rep_port()), bare(zmq::REP, broker.req_port()));
    client.send("?", 0).unwrap();
    assert_eq!(server.recv_bytes(0).unwrap(), b"?");
    server.send("!", 0).unwrap();
    assert_eq!(client.recv_bytes(0).unwrap(), b"!");
}

#[test]
fn clients_beyond_the_limit_are_refused_and_counted() {
    let config =
        ZeroMqConfig { rep_port: 0, req_port: 0, max_connections: 1, ..Default::default() };
    let broker = ServiceBroker::start(&config).unwrap();
    let server = bare(zmq::REP, broker.req_port());
    let first = bare(zmq::REQ, broker.rep_port());
    first.send("1", 0).unwrap();
    assert_eq!(server.recv_bytes(0).unwrap(), b"1");
    server.send("1", 0).unwrap();
    assert_eq!(first.recv_bytes(0).unwrap(), b"1");
    let second = bare(zmq::REQ, broker.rep_port());
    broker_is(&broker, "a refusal", |status| status.cut.contains_key("too_many"));
    drop(first);
    // It goes on trying.
    second.send("2", 0).unwrap();
    assert_eq!(server.recv_bytes(0).unwrap(), b"2");
}
