//! The suite against ZeroMQ: the near side runs the broker, the far side only connects. Once more behind the stand-in
//! for a middleware that starts late, which has to hand on all that the middleware does.

use std::collections::BTreeMap;
use std::sync::Arc;

use wrapyfi_conformance::{Capabilities, Testbed, TypeCheck, WireEnd, conformance_tests, wait_for};
use wrapyfi_data::types::DataType;
use wrapyfi_endpoint::{DeferredMiddleware, Middleware, ServiceSpec, StartError, TopicSpec, Wake};
use wrapyfi_zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};

struct Brokered<const LATE: bool> {
    // Endpoints and injectors end before the broker does.
    raw: BTreeMap<String, zmq::Socket>,
    far: Option<Box<dyn Middleware>>,
    near: Option<Box<dyn Middleware>>,
    /// Publishers', listeners', clients', servers'.
    ports: [u16; 4],
    asking: Vec<zmq::Socket>,
}

fn side([pub_port, sub_port, rep_port, req_port]: [u16; 4], broker: BrokerMode) -> ZeroMq {
    let default = ZeroMqConfig::default();
    let ports = ZeroMqConfig { pub_port, sub_port, rep_port, req_port, ..default };
    let config = ZeroMqConfig { broker, service_broker: broker, ..ports };
    ZeroMq::start(&config).unwrap()
}

/// WireEnd that runs both brokers.
fn near(ports: [u16; 4]) -> ZeroMq {
    let near = side(ports, BrokerMode::Embedded);
    near.start_services().unwrap();
    near
}

fn far(ports: [u16; 4]) -> ZeroMq {
    side(ports, BrokerMode::Foreign)
}

/// The middleware itself, or behind the stand-in once that has started it.
fn behind<const LATE: bool>(middleware: ZeroMq) -> Box<dyn Middleware> {
    if !LATE {
        return Box::new(middleware);
    }
    let mut middleware = Some(middleware);
    let late = DeferredMiddleware::new(
        "zeromq",
        StartError::Absent("it comes later".to_owned()),
        move || {
            let gone = || StartError::refused("it was started before");
            Ok(Arc::new(middleware.take().ok_or_else(gone)?))
        },
    );
    let late = late.unwrap();
    wait_for(Wake::new(), "the start", || late.inner().map(drop));
    Box::new(late)
}

impl<const LATE: bool> Testbed for Brokered<LATE> {
    const CAPABILITIES: Capabilities = Capabilities {
        listener_knows_peers: false,
        publisher_counts_listeners: false,
        waits_aloud: false,
        keeps_last: false,
        integer_sound: false,
        frame_id: false,
        names_encodings: false,
        types: TypeCheck::Arrival,
        ..Capabilities::FULL
    };

    fn start() -> Self {
        let first = near([0; 4]);
        let (rep_port, req_port) = first.start_services().unwrap();
        let ports = [first.pub_port(), first.sub_port(), rep_port, req_port];
        let (raw, asking) = (BTreeMap::new(), Vec::new());
        let (near, far) = (Some(behind::<LATE>(first)), Some(behind::<LATE>(far(ports))));
        Self { raw, near, far, ports, asking }
    }

    fn side(&self, side: WireEnd) -> &dyn Middleware {
        match side {
            WireEnd::Near => self.near.as_deref().unwrap(),
            WireEnd::Far => self.far.as_deref().unwrap(),
        }
    }

    fn restart(&mut self, side: WireEnd) {
        match side {
            WireEnd::Near => {
                self.near = None;
                self.near = Some(behind::<LATE>(near(self.ports)));
            }
            WireEnd::Far => {
                self.far = None;
                self.far = Some(behind::<LATE>(far(self.ports)));
            }
        }
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let topic = spec.topic.as_bytes();
        let raw = self.raw.entry(spec.topic.clone()).or_insert_with(|| {
            let socket = zmq::Context::new().socket(zmq::XPUB).unwrap();
            socket.set_linger(0).unwrap();
            socket.set_rcvtimeo(30_000).unwrap();
            socket.connect(&format!("tcp://127.0.0.1:{}", self.ports[1])).unwrap();
            let subscription = [b"\x01", topic].concat();
            while socket.recv_bytes(0).unwrap() != subscription {}
            socket
        });
        let header: &[u8] = b"{timestamp:1795214428.5}";
        let frames = match spec.message_type.data_type() {
            DataType::NativeObject => vec![topic, body],
            _ => vec![topic, header, body],
        };
        raw.send_multipart(frames, 0).unwrap();
    }

    fn inject_request(&mut self, _spec: &ServiceSpec, body: &[u8]) {
        // As Wrapyfi's clients: one that is not answered could not ask again.
        let socket = zmq::Context::new().socket(zmq::REQ).unwrap();
        socket.set_linger(0).unwrap();
        socket.connect(&format!("tcp://127.0.0.1:{}", self.ports[2])).unwrap();
        socket.send(body, 0).unwrap();
        self.asking.push(socket);
    }

    fn invalid_names() -> Vec<String> {
        ["", "ZEROMQ/CONNECTIONS", "ZEROMQ/CONNECTIONS/x", "/a\0", "/a\nb"]
            .map(str::to_owned)
            .into_iter()
            .chain(["x".repeat(1025)])
            .collect()
    }
}

conformance_tests! {
    Brokered<false>,
    lacks {
        keeps_last: "a ZeroMQ broker keeps no message for later subscribers",
        listener_knows_peers: "a ZeroMQ broker tells subscribers nothing of publishers",
    },
}

mod late {
    use super::*;

    conformance_tests! {
        Brokered<true>,
        lacks {
            keeps_last: "a ZeroMQ broker keeps no message for later subscribers",
            listener_knows_peers: "a ZeroMQ broker tells subscribers nothing of publishers",
        },
    }
}
