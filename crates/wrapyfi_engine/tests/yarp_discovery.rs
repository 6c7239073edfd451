//! Questions that discovery puts to the ports of a robot, and the connections that they cost.
//!
//! ```text
//!   tree: 250 ports that count their connections ── name server ── Yarp ── engine, patterns, memory
//! ```

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::Deserialize;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use wrapyfi_conformance::until;
use wrapyfi_data::types::{self, MessageType};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{Cause, Context, LearnError, Middleware, Registry, TopicSpec};
use wrapyfi_engine::{Available, Config, Engine, Plan};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp::name::{NameClient, NameServerConf};
use wrapyfi_yarp::port::names::NameRequest;
use wrapyfi_yarp::port::{
    Answer, Message, Network, NetworkOptions, Port, PortOptions, PortPayload,
};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::sig::{Sound, Vector};
use wrapyfi_yarp::{Bottle, Dialect};
use wrapyfi_yarp_endpoint::{Yarp, YarpConfig};

struct YarpNetwork {
    runtime: Runtime,
    server: NameServer,
}

impl YarpNetwork {
    fn new() -> Self {
        let mut threads = tokio::runtime::Builder::new_multi_thread();
        let runtime = threads.worker_threads(2).enable_all().build().unwrap();
        let server = runtime
            .block_on(NameServer::start(NameServerOptions {
                port: 0,
                ..NameServerOptions::default()
            }))
            .unwrap();
        Self { runtime, server }
    }

    fn yarp(&self) -> Yarp {
        let name_server = Some(self.server.address().into());
        Yarp::start(&YarpConfig { name_server, ..YarpConfig::default() }).unwrap()
    }

    fn names(&self) -> NameClient {
        let address = self.server.address();
        NameClient::new(NameServerConf { host: address.ip().to_string(), port: address.port() })
    }

    /// Network of ports of another program.
    fn network(&self) -> Network {
        let (names, listen) = (Arc::new(self.names()), self.server.address().ip());
        Network::new(NetworkOptions { names, listen, ..NetworkOptions::default() })
    }

    /// A port that a program may read, behind a relay that counts who connects.
    fn output(&self, name: &str, counts: &Counts) -> Port {
        let network = self.network();
        let options = unregistered();
        let port = self.runtime.block_on(network.open_output(name, &options)).unwrap();
        self.runtime.block_on(self.relay(name, port.address(), counts));
        port
    }

    fn port(&self, name: &str, kind: Kind, counts: &Counts) -> Port {
        let network = self.network();
        if matches!(kind, Kind::Output) {
            return self.output(name, counts);
        }
        let options = unregistered();
        let port = network.serve(name, &options, async |_, _| Answer::Nothing);
        let port = self.runtime.block_on(port).unwrap();
        self.runtime.block_on(self.relay(name, port.address(), counts));
        port
    }

    /// Registers a relay to `back` as the port of this name.
    async fn relay(&self, name: &str, back: SocketAddr, counts: &Counts) {
        let front = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let at = front.local_addr().unwrap();
        let request = NameRequest {
            name: name.to_owned(),
            host: Some(at.ip().to_string()),
            port: Some(at.port()),
            ..NameRequest::default()
        };
        self.names().register(&request).await.unwrap();
        let (name, counts) = (name.to_owned(), Arc::clone(counts));
        tokio::spawn(async move {
            while let Ok((mut near, _)) = front.accept().await {
                *counts.lock().unwrap().entry(name.clone()).or_default() += 1;
                tokio::spawn(async move {
                    if let Ok(mut far) = TcpStream::connect(back).await {
                        tokio::io::copy_bidirectional(&mut near, &mut far).await.ok();
                    }
                });
            }
        });
    }
}

fn unregistered() -> PortOptions {
    PortOptions { register: false, ..PortOptions::default() }
}

#[derive(Clone, Copy)]
enum Kind {
    Output,
    Served,
}

/// Connections that each port has had.
type Counts = Arc<Mutex<BTreeMap<String, usize>>>;

fn send(port: &Port, message: &Message) {
    let _sent = port.write(message.clone());
}

#[derive(Debug, Default, Deserialize)]
struct NoEndpoints {}

/// An engine with patterns from `yarp` to a bus called `b`.
fn engine(yarp: &Arc<Yarp>, routes: &[&str]) -> (Engine, Arc<Memory>) {
    let bus = Arc::new(Memory::new("b"));
    let mut registry = Registry::new();
    registry.register(Arc::clone(yarp) as _);
    registry.register(Arc::clone(&bus) as _);
    let text: String = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect();
    let config: Config<NoEndpoints> =
        Config::from_yaml(&format!("routes:\n{text}"), "bridge.yaml").unwrap();
    let known = |name| Available { name, ..Available::default() };
    let mut types = TypeStore::generated();
    let plan = Plan::new(&config, &[known("yarp"), known("b")], &mut types, "bridge.yaml").unwrap();
    (Engine::new(plan, &registry).with_types(TypeStore::generated()), bus)
}

/// Rounds of an engine whose clock runs ahead of the system's.
struct Rounds(Instant);

impl Rounds {
    fn step(&mut self, engine: &mut Engine, rounds: usize) {
        for _ in 0..rounds {
            self.0 += Duration::from_millis(500);
            engine.step(self.0);
        }
    }
}

fn type_of(engine: &Engine, port: &str) -> Option<&'static str> {
    let status = engine.status();
    let wanted = format!("yarp:{port}");
    status.iter().find(|route| route.from == wanted).map(|route| route.message_type)
}

const PORTS: usize = 250;

/// The robot of a laboratory: no program listens, and no program is bothered.
#[test]
fn each_of_250_ports_is_asked_once_and_those_that_are_not_meant_never() {
    let (net, counts) = (YarpNetwork::new(), Counts::default());
    let port = |n: usize| match n % 5 {
        0 => (format!("/icub/part{n}/state:o"), Kind::Output),
        1 => (format!("/icub/cam/camera{n}"), Kind::Output),
        2 => (format!("/icub/part{n}/command:i"), Kind::Served),
        3 => (format!("/icub/part{n}/rpc:i"), Kind::Served),
        _ => (format!("/other/part{n}/state:o"), Kind::Output),
    };
    let ports: Vec<_> = (0..PORTS)
        .map(|n| {
            let (name, kind) = port(n);
            net.port(&name, kind, &counts)
        })
        .collect();
    let yarp = Arc::new(net.yarp());
    let routes = ["from: 'yarp:/(icub/.*)', to: 'b:/$1'"];
    let (mut engine, _bus) = engine(&yarp, &routes);
    let mut rounds = Rounds(Instant::now());
    until("all routes", || {
        rounds.step(&mut engine, 1);
        let made = engine.status().iter().find_map(|route| route.pattern);
        made.is_some_and(|made| made.routes == PORTS / 5 * 2)
    });
    assert_eq!(type_of(&engine, &port(0).0), Some("sensor_msgs/msg/JointState"));
    assert_eq!(type_of(&engine, &port(1).0), Some("sensor_msgs/msg/Image"));
    // Minutes pass, more than the longest time between two questions to a port that has not answered, and a second.
    for _ in 0..100 {
        rounds.step(&mut engine, 10);
        std::thread::sleep(Duration::from_millis(10));
    }
    let asked = counts.lock().unwrap().clone();
    for n in 0..PORTS {
        let (name, _) = port(n);
        let count = asked.get(&name).copied().unwrap_or_default();
        assert_eq!(count, usize::from(n % 5 != 4), "{name}");
    }
    // A program that is started again is another one.
    let (name, kind) = port(5);
    let again = net.port(&name, kind, &counts);
    until("the port to be asked again", || {
        rounds.step(&mut engine, 1);
        counts.lock().unwrap()[&name] == 2
    });
    rounds.step(&mut engine, 200);
    assert_eq!(counts.lock().unwrap().values().sum::<usize>(), PORTS / 5 * 4 + 1);
    drop((ports, again));
}

/// The first message shows a type that the name does not; then no program listens any more.
#[test]
fn the_first_message_shows_the_type() {
    let (net, counts) = (YarpNetwork::new(), Counts::default());
    let vector = Vector(vec![1.0, 2.0]).encode(Dialect::V3).unwrap();
    let sound = Sound::from_interleaved(&[1, 2, 3, 4], 2, 44_100).unwrap();
    let words = Bottle::from(vec!["hello".into(), 1.5.into()]);
    let sends = [
        ("/imu", vector, "std_msgs/msg/Float64MultiArray"),
        ("/ears", sound.encode(Dialect::V4).unwrap(), "wrapyfi_msgs/msg/AudioChunk"),
        ("/words", words.encode(Dialect::V3).unwrap(), "wrapyfi_msgs/msg/NativeObject"),
    ];
    let sends = sends.map(|(name, bytes, wanted)| {
        (name, net.output(name, &counts), Message::new(PortPayload::object(bytes)), wanted)
    });
    let silent = net.output("/silent", &counts);
    let yarp = Arc::new(net.yarp());
    let (mut engine, _bus) = engine(&yarp, &["from: 'yarp:/(.*)', to: 'b:/$1'"]);
    let mut rounds = Rounds(Instant::now());
    until("their types", || {
        sends.iter().for_each(|(_, port, message, _)| send(port, message));
        rounds.step(&mut engine, 1);
        sends.iter().all(|(name, _, _, wanted)| type_of(&engine, name) == Some(*wanted))
    });
    until("that nobody listens any more", || {
        sends.iter().for_each(|(_, port, message, _)| send(port, message));
        sends.iter().all(|(_, port, _, _)| port.status().is_empty())
    });
    // One that is silent is waited for, with one connection, and its first message is its type.
    until("the reason", || {
        rounds.step(&mut engine, 1);
        let status = engine.status();
        let reason = status.iter().find(|route| route.from == "yarp:/silent");
        matches!(
            reason.and_then(|route| route.state.cause()),
            Some(Cause::Learn(LearnError::Silent { .. }))
        )
    });
    let asked = counts.lock().unwrap()["/silent"];
    rounds.step(&mut engine, 1000);
    assert_eq!(counts.lock().unwrap()["/silent"], asked);
    assert_eq!(silent.status().len(), 1);
    send(&silent, &sends[0].2);
    until("its type", || {
        rounds.step(&mut engine, 1);
        type_of(&engine, "/silent") == Some("std_msgs/msg/Float64MultiArray")
    });
    until("that nobody listens to it either", || silent.status().is_empty());
}

/// A name server knows who serves files over HTTP: they are shown as such, and read over that carrier,
/// whenever the name comes.
#[test]
fn a_port_under_carrier_mjpeg_has_files() {
    let net = YarpNetwork::new();
    let jpeg = [&[0xff_u8, 0xd8, 0xff, 0xe0], &b"a picture"[..], &[0xff, 0xd9]].concat();
    let options = PortOptions { pictures: true, ..unregistered() };
    let network = net.network();
    let cam = net.runtime.block_on(network.open_output("/served", &options)).unwrap();
    let register = |name: &str| {
        let request = NameRequest {
            name: name.to_owned(),
            carrier: Some("mjpeg".to_owned()),
            host: Some(cam.address().ip().to_string()),
            port: Some(cam.address().port()),
        };
        net.runtime.block_on(net.names().register(&request)).unwrap();
    };
    register("/web/early");
    let yarp = Arc::new(net.yarp());
    let (mut engine, _bus) = engine(&yarp, &["from: 'yarp:/(web/.*)', to: 'b:/$1'"]);
    let mut rounds = Rounds(Instant::now());
    for name in ["/web/early", "/web/late"] {
        until("its type", || {
            rounds.step(&mut engine, 1);
            type_of(&engine, name) == Some("sensor_msgs/msg/CompressedImage")
        });
        if name == "/web/early" {
            register("/web/late");
        }
    }
    assert_eq!(cam.status().len(), 0, "nobody has asked it anything");
    for name in ["/web/early", "/web/late"] {
        let context = Context::default();
        let spec = TopicSpec::new(name, MessageType::CompressedImage);
        let mut sink = yarp.open_listener(&spec, &context).unwrap();
        until("a file", || {
            send(&cam, &Message::new(PortPayload::raw(jpeg.clone())));
            let Some(sample) = sink.take().unwrap() else { return false };
            let types::Payload::Image(image) = sample.payload else { panic!("no picture") };
            matches!(image.pixels, types::Pixels::Compressed { data, .. } if *data == jpeg[..])
        });
    }
}
