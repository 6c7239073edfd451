//! Our ends on ZeroMQ with CURVE: who is taken, who is refused, and how that is counted.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::common::{any_ports, foreign, peer};
use wrapyfi_conformance::until;
use wrapyfi_data::types::{MessageType, Payload, ServiceKind, Value};
use wrapyfi_endpoint::{
    Cause, CauseCode, Context, Listener, Middleware as _, PublishError, Publisher, Request,
    ServiceSpec, TopicSpec,
};
use wrapyfi_zeromq::{
    Broker, BrokerError, CurveClient, CurveConfig, CurveError, ServiceBroker, ZeroMq, ZeroMqConfig,
    ZeroMqError,
};

/// Two pairs of keys: those of libzmq's manual.
const SERVER: (&str, &str) =
    ("rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7", "JTKVSB%%)wK0E.X)V>+}o?pNmC{O&4W4b!Ni{Lh6");
const CLIENT: (&str, &str) =
    ("Yne@$w-vo<fVvi]a<NY6T1ed:M$fCG*[IaLV{hID", "D:)Q[IlAW!ahhC2ac:9*A}h:p?([4%wOTJ%JR%cs");

/// A folder with the secrets of both, which ends with the test.
struct Files(PathBuf);

impl Files {
    fn new(test: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("{test}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let files = Self(folder);
        for (name, (_, secret)) in [("server", SERVER), ("client", CLIENT)] {
            std::fs::write(files.0.join(name), format!("{secret}\n")).unwrap();
            files.set_mode(name, 0o600);
        }
        files
    }

    fn set_mode(&self, name: &str, mode: u32) {
        std::fs::set_permissions(self.0.join(name), Permissions::from_mode(mode)).unwrap();
    }

    fn curve(&self, name: &str) -> CurveConfig {
        let secret_key_file = Some(self.0.join(name));
        CurveConfig { secret_key_file, ..CurveConfig::default() }
    }

    fn client(&self) -> CurveConfig {
        CurveConfig { server_key: Some(SERVER.0.to_owned()), ..self.curve("client") }
    }

    fn broker(&self, clients: Option<Vec<CurveClient>>) -> Broker {
        let curve = Some(CurveConfig { clients, ..self.curve("server") });
        Broker::start(&ZeroMqConfig { curve, ..any_ports() }).unwrap()
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        _ = std::fs::remove_dir_all(&self.0);
    }
}

fn allowed(publish: &[&str], subscribe: &[&str]) -> CurveClient {
    let texts = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
    CurveClient {
        key: CLIENT.0.to_owned(),
        publish: texts(publish),
        subscribe: texts(subscribe),
        ..CurveClient::default()
    }
}

fn connected(broker: &Broker, curve: Option<CurveConfig>) -> ZeroMq {
    let config = ZeroMqConfig { curve, ..foreign(broker.pub_port(), broker.sub_port()) };
    ZeroMq::start(&config).unwrap()
}

fn publisher(zeromq: &ZeroMq, topic: &str) -> Box<dyn Publisher> {
    let spec = TopicSpec::new(topic, MessageType::NativeObject);
    zeromq.open_publisher(&spec, &Context::default()).unwrap()
}

fn listener(zeromq: &ZeroMq, topic: &str) -> Box<dyn Listener> {
    let spec = TopicSpec::new(topic, MessageType::NativeObject);
    zeromq.open_listener(&spec, &Context::default()).unwrap()
}

fn text(size: usize) -> Payload {
    Payload::from(Value::Str("x".repeat(size)))
}

/// Sends until it is heard.
fn passes(publisher: &mut dyn Publisher, listener: &mut dyn Listener, payload: &Payload) {
    until("a message", || {
        _ = publisher.publish(payload);
        listener.take().unwrap().is_some_and(|sample| sample.payload == *payload)
    });
}

fn cut(broker: &Broker, reason: &str) -> u64 {
    broker.status().cut.get(reason).copied().unwrap_or_default()
}

#[test]
fn messages_of_any_size_pass_between_ends_with_keys() {
    let files = Files::new("curve_sizes");
    let broker = files.broker(None);
    let (theirs, ours) =
        (connected(&broker, Some(files.client())), connected(&broker, Some(files.client())));
    let mut listener = listener(&theirs, "/a");
    let mut publisher = publisher(&ours, "/a");
    for size in [1, 300, 70_000, 3_000_000] {
        passes(&mut *publisher, &mut *listener, &text(size));
    }
    assert!(broker.status().cut.is_empty(), "{:?}", broker.status());
    assert_eq!(listener.link().waiting_for, None);
}

/// A socket of libzmq with the client's keys.
fn raw(context: &zmq::Context, kind: zmq::SocketType) -> zmq::Socket {
    let socket = context.socket(kind).unwrap();
    socket.set_linger(0).unwrap();
    socket.set_rcvtimeo(30_000).unwrap();
    let key = |text: &str| zmq::z85_decode(text).unwrap();
    socket.set_curve_serverkey(&key(SERVER.0)).unwrap();
    socket.set_curve_publickey(&key(CLIENT.0)).unwrap();
    socket.set_curve_secretkey(&key(CLIENT.1)).unwrap();
    socket
}

#[test]
fn sockets_of_libzmq_pass_messages_of_any_size() {
    let files = Files::new("curve_libzmq");
    let broker = files.broker(None);
    let context = zmq::Context::new();
    let (listener, publisher) = (raw(&context, zmq::SUB), raw(&context, zmq::XPUB));
    listener.set_subscribe(b"/a").unwrap();
    listener.connect(&format!("tcp://127.0.0.1:{}", broker.pub_port())).unwrap();
    publisher.connect(&format!("tcp://127.0.0.1:{}", broker.sub_port())).unwrap();
    assert_eq!(publisher.recv_bytes(0).unwrap(), b"\x01/a");
    for size in [0, 1, 200, 300, 70_000, 3_000_000] {
        let frames = [b"/a".to_vec(), vec![7; size], vec![8; size / 2]];
        publisher.send_multipart(&frames, 0).unwrap();
        assert_eq!(listener.recv_multipart(0).unwrap(), frames);
    }
    // Heartbeats go both ways.
    assert!(broker.status().cut.is_empty());
}

#[test]
fn our_publisher_has_a_broker_of_libzmq() {
    let files = Files::new("curve_their_broker");
    let context = zmq::Context::new();
    let bound = context.socket(zmq::XSUB).unwrap();
    bound.set_rcvtimeo(30_000).unwrap();
    bound.set_curve_server(true).unwrap();
    bound.set_curve_secretkey(&zmq::z85_decode(SERVER.1).unwrap()).unwrap();
    bound.bind("tcp://127.0.0.1:*").unwrap();
    let endpoint = bound.get_last_endpoint().unwrap().unwrap();
    let port = endpoint.rsplit(':').next().unwrap().parse().unwrap();
    let config = ZeroMqConfig { curve: Some(files.client()), ..foreign(port, port) };
    let zeromq = ZeroMq::start(&config).unwrap();
    let mut publisher = publisher(&zeromq, "/a");
    bound.send(b"\x01/a".as_slice(), 0).unwrap();
    until("the subscription", || {
        // libzmq sends what it has to say when its owner calls it.
        _ = bound.get_events().unwrap();
        publisher.publish(&text(100_000)).is_ok()
    });
    assert_eq!(bound.recv_multipart(0).unwrap().concat().len(), 100_004);
}

#[test]
fn one_process_is_broker_and_both_ends() {
    let files = Files::new("curve_embedded");
    let config = |broker| {
        let curve = Some(files.curve("server"));
        ZeroMqConfig { curve, pub_port: 0, sub_port: 0, broker, ..ZeroMqConfig::default() }
    };
    let ours = ZeroMq::start(&config(ZeroMqConfig::default().broker)).unwrap();
    // A second one with the same key finds it.
    let second = ZeroMq::start(&ZeroMqConfig {
        pub_port: ours.pub_port(),
        sub_port: ours.sub_port(),
        ..config(ZeroMqConfig::default().broker)
    })
    .unwrap();
    assert!(second.broker_status().is_none());
    passes(&mut *publisher(&ours, "/a"), &mut *listener(&second, "/a"), &text(5));
    assert_eq!(ours.broker_status().unwrap().cut.len(), 0);
    drop(ours);
    until("the take-over", || second.broker_status().is_some());
}

#[test]
fn who_has_no_keys_is_refused_and_counted() {
    let files = Files::new("curve_null");
    let broker = files.broker(None);
    let context = zmq::Context::new();
    let _raw = peer(&context, zmq::SUB, broker.pub_port());
    until("a refusal", || cut(&broker, "mechanism") > 0);
    let without = connected(&broker, None);
    let (publisher, listener) = (publisher(&without, "/a"), listener(&without, "/a"));
    until("the reasons", || {
        let links = [publisher.link(), listener.link()];
        let reason = |why: Cause| why.code() == CauseCode::Security;
        links.into_iter().all(|link| link.waiting_for.is_some_and(reason))
    });
    // And keys at a broker without.
    let open = Broker::start(&any_ports()).unwrap();
    let with = connected(&open, Some(files.client()));
    let listener = self::listener(&with, "/a");
    until("the reason", || {
        let waits = listener.link().waiting_for;
        waits.is_some_and(|why| why.code() == CauseCode::Security)
    });
}

#[test]
fn another_server_key_is_refused() {
    let files = Files::new("curve_server_key");
    let broker = files.broker(None);
    let server_key = Some(CLIENT.0.to_owned());
    let wrong = connected(&broker, Some(CurveConfig { server_key, ..files.client() }));
    let (publisher, listener) = (publisher(&wrong, "/a"), listener(&wrong, "/a"));
    until("the reasons", || {
        let links = [publisher.link(), listener.link()];
        let reason = |why: Cause| why.to_string().contains("`server_key` must be its public key");
        links.into_iter().all(|link| link.waiting_for.is_some_and(reason))
    });
    until("both are counted", || cut(&broker, "curve") > 1);
}

#[test]
fn a_key_that_is_not_listed_is_refused() {
    let files = Files::new("curve_unknown");
    let broker = files.broker(Some(Vec::new()));
    let unknown = connected(&broker, Some(files.client()));
    let (publisher, listener) = (publisher(&unknown, "/a"), listener(&unknown, "/a"));
    until("the reasons", || {
        let links = [publisher.link(), listener.link()];
        let reason = |why: Cause| why.to_string().contains("does not take our CURVE keys");
        links.into_iter().all(|link| link.waiting_for.is_some_and(reason))
    });
    until("both are counted", || cut(&broker, "unknown_key") > 1);
}

#[test]
fn a_listed_key_has_its_topics_alone() {
    let files = Files::new("curve_topics");
    let broker = files.broker(Some(vec![allowed(&["/cmd/(.*)"], &["/camera", "/cmd/a"])]));
    let client = connected(&broker, Some(files.client()));
    // The broker's own key may everything.
    let all = connected(&broker, Some(files.curve("server")));
    // One instance does not hear itself.
    let hears = connected(&broker, Some(files.curve("server")));
    let mut heard = listener(&client, "/camera");
    passes(&mut *publisher(&all, "/camera"), &mut *heard, &text(1));
    // Its subscription is the beginning of this one, too.
    let mut longer = publisher(&all, "/camera/secret");
    let mut own = listener(&hears, "/camera/secret");
    passes(&mut *longer, &mut *own, &text(2));
    let _refused = listener(&client, "/secret");
    until("a refusal", || broker.status().denied == 1);
    assert!(!broker.status().subscriptions.contains_key("/secret"));

    passes(&mut *publisher(&client, "/cmd/a"), &mut *listener(&hears, "/cmd/a"), &text(3));
    let mut all_of_it = listener(&hears, "/camera");
    let mut forged = publisher(&client, "/camera");
    until("refusals", || {
        _ = forged.publish(&text(4));
        broker.status().denied > 3
    });
    let told = forged.publish(&text(4)).unwrap_err();
    assert!(matches!(told, PublishError::Refused { .. }), "{told}");
    assert!(told.to_string().contains("does not let our CURVE key publish \"/camera\""), "{told}");
    passes(&mut *publisher(&all, "/camera"), &mut *all_of_it, &text(5));
    assert!(broker.status().cut.is_empty(), "{:?}", broker.status());
    let texts: Vec<_> = std::iter::from_fn(|| heard.take().unwrap()).map(|it| it.payload).collect();
    // The first was sent until it was heard.
    assert!(texts.iter().all(|it| [text(1), text(5)].contains(it)), "{texts:?}");
}

#[test]
fn services_pass_and_are_refused_by_key() {
    let files = Files::new("curve_services");
    let broker = |call, serve| {
        let clients = Some(vec![CurveClient { call, serve, ..allowed(&[], &[]) }]);
        let curve = Some(CurveConfig { clients, ..files.curve("server") });
        let config = ZeroMqConfig { rep_port: 0, req_port: 0, curve, ..Default::default() };
        ServiceBroker::start(&config).unwrap()
    };
    let connected = |broker: &ServiceBroker, curve| {
        let (rep_port, req_port) = (broker.rep_port(), broker.req_port());
        let config = ZeroMqConfig { rep_port, req_port, curve: Some(curve), ..foreign(1, 1) };
        let service_broker = config.broker;
        ZeroMq::start(&ZeroMqConfig { service_broker, ..config }).unwrap()
    };
    let spec = ServiceSpec::new("/x", ServiceKind::NativeObject);
    let services = broker(true, false);
    let (own, client) =
        (connected(&services, files.curve("server")), connected(&services, files.client()));
    let mut server = own.open_server(&spec, &Context::default()).unwrap();
    let mut caller = client.open_client(&spec, &Context::default()).unwrap();
    until("the broker", || {
        caller.link().waiting_for.is_none() && server.link().waiting_for.is_none()
    });
    let ticket = caller.send(&Request::new([7.into()]), Duration::from_secs(30)).unwrap();
    let mut reply = None;
    until("a reply", || {
        if let Some(asked) = server.take().unwrap() {
            let answer = Value::List(asked.request.into_call().unwrap().args).into();
            server.reply(asked.id, Ok(answer)).unwrap();
        }
        reply = caller.take_only(ticket);
        reply.is_some()
    });
    assert_eq!(reply.unwrap().unwrap().payload, Value::List(vec![7.into()]).into());
    let _refused = client.open_server(&spec, &Context::default()).unwrap();
    until("a refusal", || services.status().cut.contains_key("not_allowed"));
}

#[test]
fn faults_of_the_keys_stop_the_start() {
    let files = Files::new("curve_faults");
    files.set_mode("server", 0o644);
    let start = |curve| Broker::start(&ZeroMqConfig { curve: Some(curve), ..any_ports() });
    let path = Path::new(&files.0).join("server");
    let open = CurveError::OpenToOthers { path, mode: 0o644 };
    assert_eq!(start(files.curve("server")).unwrap_err(), BrokerError::Curve(open));
    let none = start(CurveConfig::default()).unwrap_err();
    assert_eq!(none, BrokerError::Curve(CurveError::NoSecretKey));
    let embedded = ZeroMqConfig { pub_port: 0, sub_port: 0, ..ZeroMqConfig::default() };
    let other = ZeroMq::start(&ZeroMqConfig { curve: Some(files.client()), ..embedded });
    let error = other.err().unwrap();
    assert!(matches!(
        error,
        ZeroMqError::Broker(BrokerError::Curve(CurveError::OtherServer { .. }))
    ));
    assert!(error.is_hopeless());
}

#[test]
fn a_list_of_clients_permits_what_insecure_would() {
    let files = Files::new("curve_insecure");
    let config = |clients| {
        let curve = Some(CurveConfig { clients, ..files.curve("server") });
        ZeroMqConfig { ip: "0.0.0.0".to_owned(), curve, ..any_ports() }
    };
    let refused = Broker::start(&config(None)).unwrap_err();
    assert!(matches!(refused, BrokerError::NotLoopback(_)), "{refused}");
    assert!(Broker::start(&config(Some(Vec::new()))).is_ok());
}
