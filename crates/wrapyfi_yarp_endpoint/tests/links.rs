//! Connections of YARP endpoints that outlive everybody else: peers and name servers that end and
//! come back, names that are taken, ports that others connect.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use wrapyfi_conformance::{TIMEOUT, until, wait_until};
use wrapyfi_data::types::{Map, MessageType, Payload, RosMessage, ServiceKind, Tensor, Value};
use wrapyfi_endpoint::{
    Cause, CauseCode, Context, DropReason, Link, Listener, Middleware, PublishError, Publisher,
    Request, Role, ServiceSpec, TopicSpec,
};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp::bottle::Vocab;
use wrapyfi_yarp::name::{NameClient, NameServerConf};
use wrapyfi_yarp::port::names::NameRequest;
use wrapyfi_yarp::port::{
    Answer, Message, Network, NetworkOptions, Port, PortOptions, PortPayload, Received,
};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::sig::{Image, PixelCode, Stamp};
use wrapyfi_yarp::{Bottle, Dialect, Value as Element, WireLimits};
use wrapyfi_yarp_endpoint::{Yarp, YarpConfig};

mod calls;
mod devices;

/// A YARP network whose name server can be ended and started again.
struct YarpNetwork {
    runtime: Runtime,
    server: Option<NameServer>,
    address: SocketAddr,
}

impl YarpNetwork {
    fn new() -> Self {
        let mut threads = tokio::runtime::Builder::new_multi_thread();
        let runtime = threads.worker_threads(1).enable_all().build().unwrap();
        let server = runtime.block_on(start(0));
        let address = server.address();
        Self { runtime, server: Some(server), address }
    }

    fn end(&mut self) {
        self.runtime.block_on(self.server.take().unwrap().stop());
    }

    fn begin(&mut self) {
        self.server = Some(self.runtime.block_on(start(self.address.port())));
    }

    fn yarp(&self) -> Yarp {
        let name_server = Some(self.address.into());
        Yarp::start(&YarpConfig { name_server, ..YarpConfig::default() }).unwrap()
    }

    /// Network of ports of another program.
    fn network(&self) -> Network {
        let (names, listen) = (Arc::new(self.names()), self.address.ip());
        Network::new(NetworkOptions { names, listen, ..NetworkOptions::default() })
    }

    fn names(&self) -> NameClient {
        let host = self.address.ip().to_string();
        NameClient::new(NameServerConf { host, port: self.address.port() })
    }
}

async fn start(port: u16) -> NameServer {
    NameServer::start(NameServerOptions { port, ..NameServerOptions::default() }).await.unwrap()
}

/// A port that is sent to, and what comes.
async fn input(network: &Network, name: &str) -> (Port, mpsc::UnboundedReceiver<Received>) {
    let (sender, messages) = mpsc::unbounded_channel();
    let handler = move |message, _wants_reply| {
        sender.send(message).ok();
        std::future::ready(Answer::Nothing)
    };
    (network.serve(name, &PortOptions::default(), handler).await.unwrap(), messages)
}

/// Waits until a port writes to a reader.
async fn connected(port: &Port) {
    port.connected().wait_for(|now| now.outputs > 0).await.unwrap();
}

fn topic(name: &str, options: Map) -> TopicSpec {
    TopicSpec { options, ..TopicSpec::new(name, MessageType::NativeObject) }
}

fn number(n: i64) -> Payload {
    Value::from(n).into()
}

#[track_caller]
fn open_way(context: &Context, link: impl Fn() -> Link) {
    wait_until(&context.wake, "the way is open", || {
        link().peers > Some(0) && link().waiting_for.is_none()
    });
}

#[track_caller]
fn flows(
    source: &mut dyn Publisher,
    (sink, context): (&mut dyn Listener, &Context),
    numbers: std::ops::Range<i64>,
) {
    for n in numbers {
        source.publish(&number(n)).unwrap();
        let mut came = None;
        wait_until(&context.wake, "the message", || {
            came = sink.take().unwrap();
            came.is_some()
        });
        assert_eq!(came.unwrap().payload, number(n));
    }
}

/// Publishers of one name share its port: it stays, with its readers, until the last of them has ended, and
/// the name is free for the next one then.
#[test]
fn publishers_of_one_name_share_a_port() {
    let net = YarpNetwork::new();
    let (near, far, context) = (net.yarp(), net.yarp(), Context::default());
    let spec = topic("/shared", Map::new());
    let mut first = near.open_publisher(&spec, &context).unwrap();
    let mut second = near.open_publisher(&spec, &context).unwrap();
    let mut sink = far.open_listener(&spec, &context).unwrap();
    open_way(&context, || first.link());
    open_way(&context, || second.link());
    flows(&mut *first, (&mut *sink, &context), 0..3);
    flows(&mut *second, (&mut *sink, &context), 3..6);
    drop(first);
    flows(&mut *second, (&mut *sink, &context), 6..20);
    // Opened while the last one ends: the farewell of the old port does not take the new one's name.
    drop(second);
    let mut third = near.open_publisher(&spec, &context).unwrap();
    open_way(&context, || third.link());
    open_way(&context, || sink.link());
    flows(&mut *third, (&mut *sink, &context), 20..23);
    drop(third);
    let names = net.names();
    wait_until(&context.wake, "the name is free", || {
        net.runtime.block_on(names.query("/shared")).unwrap().is_none()
    });
}

/// Messages that wait for a reader whose program is killed are lost, and none of them counts as
/// sent.
#[test]
fn what_a_killed_reader_leaves_is_counted() {
    let net = YarpNetwork::new();
    let (near, context) = (net.yarp(), Context::default());
    let mut source = near.open_publisher(&topic("/left", Map::new()), &context).unwrap();
    let reader = Runtime::new().unwrap();
    // Nothing is acknowledged as long as the program has not done with it.
    let busy = |_message, _wants_reply| std::future::pending::<Answer>();
    let network = net.network();
    let port = reader.block_on(network.serve("/killed", &PortOptions::default(), busy)).unwrap();
    wait_until(&context.wake, "it connects", || {
        reader.block_on(network.connect("/left", "/killed", Some("tcp"))).is_ok()
    });
    open_way(&context, || source.link());
    let mut publish = |n| {
        let bytes = source.publish(&number(n)).unwrap();
        context.counters.sent(bytes, Duration::ZERO);
    };
    (1..=5).for_each(&mut publish);
    reader.shutdown_timeout(Duration::ZERO);
    wait_until(&context.wake, "all is counted", || context.counters.snapshot().dropped() == 5);
    let now = context.counters.snapshot();
    assert_eq!((now.sent, now.dropped_for(DropReason::ConnectionLost)), (0, 5));
    drop(port);
}

/// Both kinds of connections flow while the name server is away, and find each other again after.
#[test]
fn a_name_server_may_end_and_come_back() {
    let mut net = YarpNetwork::new();
    let (near, far) = (net.yarp(), net.yarp());
    for persistent in [true, false] {
        let spec = topic(&format!("/kept_{persistent}"), Map::from([("persistent", persistent)]));
        let (here, there) = (Context::default(), Context::default());
        let mut sink = near.open_listener(&spec, &here).unwrap();
        let mut source = far.open_publisher(&spec, &there).unwrap();
        open_way(&here, || sink.link());
        open_way(&there, || source.link());
        flows(&mut *source, (&mut *sink, &here), 0..5);
        net.end();
        flows(&mut *source, (&mut *sink, &here), 5..10);
        net.begin();
        // Known again, without a request.
        let names = net.names();
        let registered = || {
            let found = net.runtime.block_on(names.list("")).unwrap();
            let of_topic = found.iter().filter(|port| port.name.starts_with(&spec.topic));
            of_topic.count() == 2
        };
        wait_until(&here.wake, "both are registered again", registered);
        drop(source);
        wait_until(&here.wake, "the publisher is gone", || sink.link().peers == Some(0));
        let mut source = far.open_publisher(&spec, &there).unwrap();
        open_way(&here, || sink.link());
        open_way(&there, || source.link());
        flows(&mut *source, (&mut *sink, &here), 10..15);
        assert_eq!(here.counters.snapshot().received, 15, "each of them once");
    }
}

/// Programs of YARP do not register again: what a new name server does not know is there for as long as it
/// answers where it was, is reached there, and is the same one when it is registered again.
#[test]
fn ports_that_a_new_name_server_does_not_know_stay_while_they_live() {
    let mut net = YarpNetwork::new();
    let (yarp, network, here) = (net.yarp(), net.network(), Context::default());
    // Two programs: one of them is killed.
    let (robot, camera) = (Runtime::new().unwrap(), Runtime::new().unwrap());
    let talk = robot.block_on(network.open_output("/talk", &PortOptions::default())).unwrap();
    let heard = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&heard);
    let plain = PortOptions::default();
    let ear = network.serve("/ear/in", &plain, move |_, _| {
        count.fetch_add(1, Relaxed);
        std::future::ready(Answer::Nothing)
    });
    let ear = robot.block_on(ear).unwrap();
    let requests = PortOptions { rpc: true, ..PortOptions::default() };
    let rpc = network.serve("/rpc", &requests, async |received: Received, _| {
        Answer::Bottle(received.bottle().unwrap_or_default())
    });
    let rpc = robot.block_on(rpc).unwrap();
    let shown = camera.block_on(network.open_output("/eye", &PortOptions::default())).unwrap();
    let mut look = yarp.discover().unwrap();
    let mut found = |names: &[(&str, Role)]| {
        let found = look.endpoints().unwrap();
        let mut found: Vec<_> =
            found.iter().map(|one| (one.name.as_str(), one.role, one.count)).collect();
        // Readers and clients of ours are none of these.
        found.retain(|(name, ..)| !name.starts_with("/kept"));
        found == names.iter().map(|(name, role)| (*name, *role, 1)).collect::<Vec<_>>()
    };
    let live = [("/ear/in", Role::Listener), ("/rpc", Role::Server), ("/talk", Role::Publisher)];
    let all = [live[0], ("/eye", Role::Publisher), live[1], live[2]];
    wait_until(&here.wake, "all are found", || found(&all));
    let port = |name: &str| Map::from([("port", Value::from(name))]);
    let first_here = Context::default();
    let mut first = yarp.open_listener(&topic("/talk", port("/kept/1")), &first_here).unwrap();
    open_way(&first_here, || first.link());
    net.end();
    net.begin();
    let names = net.names();
    let is_known = |name: &str| net.runtime.block_on(names.query(name)).unwrap().is_some();
    wait_until(&here.wake, "the listener is registered again", || is_known("/kept/1"));
    assert!(!is_known("/talk") && !is_known("/rpc") && !is_known("/ear/in"));
    assert!(found(&all), "all of them live");
    camera.shutdown_timeout(Duration::ZERO);
    drop(shown);
    wait_until(&here.wake, "the port of the killed program is gone", || found(&live));

    // The program that comes now reaches them, and so does who came before.
    let second_here = Context::default();
    let mut second = yarp.open_listener(&topic("/talk", port("/kept/2")), &second_here).unwrap();
    open_way(&second_here, || second.link());
    let hello = Message::new(PortPayload::object(
        Bottle::from(vec!["\"hello\"".into()]).encode(Dialect::V3).unwrap(),
    ));
    let mut hear = |times: usize| {
        for _ in 0..times {
            assert_eq!(talk.write_object(hello.clone()).targets, 2);
            wait_until(&first_here.wake, "the first hears it", || first.take().unwrap().is_some());
            wait_until(&second_here.wake, "the second hears it", || {
                second.take().unwrap().is_some()
            });
        }
        [&first_here, &second_here].map(|context| context.counters.snapshot().received)
    };
    // The writer enters a reader after it has answered.
    wait_until(&here.wake, "it writes to both", || talk.connected().borrow().outputs == 2);
    assert_eq!(hear(3), [3, 3]);
    let mut source = yarp.open_publisher(&topic("/ear/in", Map::new()), &here).unwrap();
    open_way(&here, || source.link());
    source.publish(&number(1)).unwrap();
    wait_until(&here.wake, "it is heard", || heard.load(Relaxed) == 1);
    let options = port("/kept/3");
    let spec = ServiceSpec { options, ..ServiceSpec::new("/rpc", ServiceKind::NativeObject) };
    let mut client = yarp.open_client(&spec, &here).unwrap();
    let ticket = client.send(&Request::new([7.into()]), TIMEOUT).unwrap();
    let mut reply = None;
    wait_until(&here.wake, "the reply", || {
        reply = client.take_only(ticket);
        reply.is_some()
    });
    assert!(reply.unwrap().is_ok());
    assert!(found(&live), "what answers stays");

    // One that is registered again is the one that it was.
    let request = NameRequest {
        name: "/talk".to_owned(),
        host: Some(talk.address().ip().to_string()),
        port: Some(talk.address().port()),
        ..NameRequest::default()
    };
    net.runtime.block_on(names.register(&request)).unwrap();
    net.runtime.block_on(names.announce("/talk", true)).unwrap();
    assert_eq!(hear(5), [8, 8], "each of them once");
    assert!(found(&live));
    robot.shutdown_timeout(Duration::ZERO);
    drop((talk, ear, rpc));
    wait_until(&here.wake, "those that are not registered are gone", || found(&live[2..]));
}

/// An endpoint opened before there is a name server says so, and works when one comes.
#[test]
fn a_name_server_may_come_last() {
    let mut net = YarpNetwork::new();
    net.end();
    let yarp = net.yarp();
    let (here, there) = (Context::default(), Context::default());
    let spec = topic("/early", Map::new());
    let mut sink = yarp.open_listener(&spec, &here).unwrap();
    let mut far = None;
    wait_until(&here.wake, "it is said", || {
        sink.link().waiting_for.is_some_and(|what| what.code() == CauseCode::ServerAway)
    });
    net.begin();
    let mut source = far.insert(net.yarp()).open_publisher(&spec, &there).unwrap();
    open_way(&here, || sink.link());
    open_way(&there, || source.link());
    flows(&mut *source, (&mut *sink, &here), 0..3);
}

/// A listener names what it waits for, and a name that another program has is waited for.
/// A bottle of one string is JSON where a program of Wrapyfi sends it, and that string where another one does.
#[test]
fn who_sends_tells_whether_a_string_is_json() {
    let net = YarpNetwork::new();
    let (network, names, yarp) = (net.network(), net.names(), net.yarp());
    let heard = |name: &str, options: Map, yarp: &Yarp| {
        let context = Context::default();
        let mut listener = yarp.open_listener(&topic(name, options), &context).unwrap();
        let mut heard = None;
        wait_until(&context.wake, "a message", || {
            heard = heard.take().or_else(|| listener.take().unwrap());
            heard.is_some()
        });
        heard.map(|sample| sample.payload).unwrap()
    };
    let value = |text: &str| Payload::from(Value::from(text));
    let sends = |name: &str| {
        let options = PortOptions::default();
        let port = net.runtime.block_on(network.open_output(name, &options)).unwrap();
        net.runtime.spawn(async move {
            loop {
                let sent = port.write_bottle(&Bottle::from(vec![Element::from("42")]));
                assert!(sent.is_ok());
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        })
    };
    let (other, wrapyfi) = (sends("/other"), sends("/wf"));
    // As Wrapyfi's publishers do.
    net.runtime.block_on(names.subscribe("/wf", "tcp://wf:out")).unwrap();
    assert_eq!(heard("/other", Map::default(), &yarp), value("42"));
    assert_eq!(heard("/other", Map::from([("bottle", false)]), &yarp), number(42));
    assert_eq!(heard("/wf", Map::default(), &yarp), number(42));
    // Ours are told from their property.
    let ours = net.yarp();
    let context = Context::default();
    let mut publisher = ours.open_publisher(&topic("/ours", Map::default()), &context).unwrap();
    let publishing = std::sync::atomic::AtomicBool::new(true);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while publishing.load(Relaxed) {
                _ = publisher.publish(&number(7));
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        assert_eq!(heard("/ours", Map::default(), &yarp), number(7));
        publishing.store(false, Relaxed);
    });
    other.abort();
    wrapyfi.abort();
}

#[test]
fn names_are_waited_for() {
    let net = YarpNetwork::new();
    let (yarp, network) = (net.yarp(), net.network());
    let (here, there) = (Context::default(), Context::default());
    let spec = topic("/taken", Map::new());
    let sink = yarp.open_listener(&spec, &here).unwrap();
    wait_until(&here.wake, "the missing port is named", || {
        sink.link()
            .waiting_for
            .is_some_and(|what| what == Cause::NotOpened("yarp:/taken".parse().unwrap()))
    });
    let options = PortOptions::default();
    let foreign = net.runtime.block_on(network.open_output("/taken", &options)).unwrap();
    open_way(&here, || sink.link());
    let mut source = yarp.open_publisher(&spec, &there).unwrap();
    wait_until(&there.wake, "the other program is named", || {
        source.link().waiting_for.is_some_and(|what| matches!(what, Cause::NameTaken { .. }))
    });
    let refused = source.publish(&number(1)).unwrap_err();
    assert!(matches!(refused, PublishError::NoConsumer(_)), "{refused}");
    net.runtime.block_on(foreign.close());
    open_way(&there, || source.link());
    // Its own instance does not hear it, and says so in its counters.
    source.publish(&number(2)).unwrap();
    wait_until(&here.wake, "the echo", || here.counters.snapshot().received == 1);
    assert_eq!(here.counters.snapshot().dropped(), 1);
}

/// A name server that holds a connection for made, as after a cable was cut, does not make it anew.
#[test]
fn a_connection_that_the_name_server_does_not_make_anew_is_made() {
    let net = YarpNetwork::new();
    let (yarp, network, names) = (net.yarp(), net.network(), net.names());
    let there = Context::default();
    let (reader, _messages) = net.runtime.block_on(input(&network, "/view/in"));
    let options = Map::from([
        ("port", Value::from("/bridge/view:o")),
        ("out_topic_connect", "/view/in".into()),
    ]);
    let source = yarp.open_publisher(&topic("/view", options), &there).unwrap();
    open_way(&there, || source.link());
    net.runtime.block_on(async {
        names.unsubscribe("/bridge/view:o", "/view/in").await.unwrap();
        network.disconnect("/bridge/view:o", "/view/in").await.unwrap();
    });
    wait_until(&there.wake, "the connection is missed", || source.link().peers != Some(1));
    open_way(&there, || source.link());
    wait_until(&there.wake, "the reader has it", || reader.connected().borrow().inputs == 1);
    drop(source);
    net.runtime.block_on(reader.close());
}

/// `port` names our port, so that others connect it; `out_topic_connect` connects it ourselves.
#[test]
fn ports_have_the_names_that_are_asked_for() {
    let net = YarpNetwork::new();
    let (yarp, network) = (net.yarp(), net.network());
    let (here, there) = (Context::default(), Context::default());
    let ((reader, mut messages), writer) = net.runtime.block_on(async {
        let reader = input(&network, "/view/in").await;
        let writer = network.open_output("/cam/out", &PortOptions::default()).await.unwrap();
        (reader, writer)
    });
    for persistent in [true, false] {
        let options = Map::from([
            ("port", Value::from("/bridge/view:o")),
            ("out_topic_connect", "/view/in".into()),
            ("persistent", persistent.into()),
            ("bottle", true.into()),
        ]);
        let mut source = yarp.open_publisher(&topic("/view", options), &there).unwrap();
        open_way(&there, || source.link());
        source.publish(&Value::List(vec![1.into(), "two".into()]).into()).unwrap();
        let heard = net.runtime.block_on(messages.recv()).unwrap();
        assert_eq!(&*heard.from, "/bridge/view:o");
        drop(source);
        wait_until(&there.wake, "the connection is gone", || {
            reader.connected().borrow().inputs == 0
        });
    }
    let options = Map::from([("port", "/bridge/cam:i")]);
    let mut sink = yarp.open_listener(&topic("/cam", options), &here).unwrap();
    // From outside, as `yarp connect` does it.
    wait_until(&here.wake, "the port is open", || {
        let open = network.connect("/cam/out", "/bridge/cam:i", Some("fast_tcp"));
        net.runtime.block_on(open).is_ok()
    });
    open_way(&here, || sink.link());
    let words = Bottle::from(vec![Element::string("\"hello\"")]);
    writer.write_bottle(&words).unwrap();
    wait_until(&here.wake, "the message", || sink.take().unwrap().is_some());
    net.runtime.block_on(async {
        reader.close().await;
        writer.close().await;
    });
}

/// Lists name ports and their addresses: others are refused and counted.
#[test]
fn ports_of_a_list_are_heard_and_reached_and_no_others() {
    let net = YarpNetwork::new();
    let (yarp, network) = (net.yarp(), net.network());
    let (here, there) = (Context::default(), Context::default());
    let ((reader, mut messages), (other, _), writer, stranger) = net.runtime.block_on(async {
        let reader = input(&network, "/view/in").await;
        let other = input(&network, "/other/in").await;
        let writer = network.open_output("/cam/out", &PortOptions::default()).await.unwrap();
        let stranger = network.open_output("/stranger/out", &PortOptions::default()).await.unwrap();
        (reader, other, writer, stranger)
    });
    let connect = |from: &str, to: &str| net.runtime.block_on(network.connect(from, to, None));
    let list = |entry: &str| Value::List(vec![entry.into()]);

    let options =
        Map::from([("port", "/bridge/cam:i".into()), ("from_peers", list("/cam/*@127.0.0.1"))]);
    let mut sink = yarp.open_listener(&topic("/cam", options), &here).unwrap();
    wait_until(&here.wake, "the port is open", || connect("/cam/out", "/bridge/cam:i").is_ok());
    assert!(connect("/stranger/out", "/bridge/cam:i").is_err());
    writer.write_bottle(&Bottle::from(vec![Element::string("\"hello\"")])).unwrap();
    wait_until(&here.wake, "the message", || sink.take().unwrap().is_some());
    wait_until(&here.wake, "the refusal is counted", || {
        sink.link();
        here.counters.snapshot().dropped_for(DropReason::RefusedPeer) >= 1
    });

    let options = Map::from([("to_peers", list("/view/in")), ("bottle", true.into())]);
    let mut source = yarp.open_publisher(&topic("/view", options), &there).unwrap();
    wait_until(&there.wake, "the port is open", || connect("/view", "/view/in").is_ok());
    assert!(connect("/view", "/other/in").is_err());
    open_way(&there, || source.link());
    source.publish(&number(1)).unwrap();
    assert_eq!(&*net.runtime.block_on(messages.recv()).unwrap().from, "/view");
    net.runtime.block_on(async {
        reader.close().await;
        other.close().await;
        writer.close().await;
        stranger.close().await;
    });
}

/// Names that say nothing: the ports are asked how they are connected.
#[test]
fn ports_are_listed_by_their_connections() {
    let net = YarpNetwork::new();
    let (yarp, context) = (net.yarp(), Context::default());
    let (network, wanted) = (net.network(), PortOptions::default());
    let ((reader, _), writer) = net.runtime.block_on(async {
        let reader = input(&network, "/plain").await;
        let writer = network.open_output("/source", &wanted).await.unwrap();
        writer.connect("tcp://plain").await.unwrap();
        (reader, writer)
    });
    let mut look = yarp.discover().unwrap();
    wait_until(&context.wake, "the reader to be a listener", || {
        let found = look.endpoints().unwrap();
        let role = |name: &str| found.iter().find(|one| one.name == name).map(|one| one.role);
        role("/plain") == Some(Role::Listener) && role("/source") == Some(Role::Publisher)
    });
    net.runtime.block_on(async {
        reader.close().await;
        writer.close().await;
    });
}

#[test]
fn other_machines_do_not_reach_ports_unless_they_may() {
    let ip = Some(Ipv4Addr::UNSPECIFIED.into());
    let name_server = Some(SocketAddr::from(([127, 0, 0, 1], 1)).into());
    let config = YarpConfig { ip, name_server, ..YarpConfig::default() };
    let opened = |config: &YarpConfig| {
        // Who only looks or calls is not connected to.
        let yarp = Yarp::start(config).unwrap();
        let spec = TopicSpec::new("/x", MessageType::Image);
        yarp.open_listener(&spec, &Context::default()).map(drop).map_err(|error| error.to_string())
    };
    let refused = opened(&config).unwrap_err();
    assert!(refused.contains("insecure: true"), "{refused}");
    opened(&YarpConfig { insecure: true.into(), ..config }).unwrap();
}
