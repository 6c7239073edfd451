//! The suite against ZeroMQ: the near side runs the broker, the far side only connects.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;

use wrapyfi_conformance::{Capabilities, Rig, Side, TypeCheck, conformance_tests};
use wrapyfi_core::endpoint::{Middleware, TopicSpec};
use wrapyfi_core::middleware::zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};
use wrapyfi_core::types::DataType;

struct Brokered {
    // Endpoints and injectors end before the broker does.
    raw: BTreeMap<String, zmq::Socket>,
    far: Option<ZeroMq>,
    near: Option<ZeroMq>,
    ports: (u16, u16),
}

fn near(ports: (u16, u16)) -> ZeroMq {
    let config = ZeroMqConfig { pub_port: ports.0, sub_port: ports.1, ..ZeroMqConfig::default() };
    ZeroMq::start(&config).unwrap()
}

fn far((pub_port, sub_port): (u16, u16)) -> ZeroMq {
    let broker = BrokerMode::Foreign;
    let config = ZeroMqConfig { pub_port, sub_port, broker, ..ZeroMqConfig::default() };
    ZeroMq::start(&config).unwrap()
}

impl Rig for Brokered {
    const CAPABILITIES: Capabilities = Capabilities {
        listener_knows_peers: false,
        publisher_counts_listeners: false,
        waits_aloud: false,
        keeps_last: false,
        integer_sound: false,
        frame_id: false,
        types: TypeCheck::Arrival,
        ..Capabilities::FULL
    };

    fn start() -> Self {
        let first = near((0, 0));
        let ports = (first.pub_port(), first.sub_port());
        Self { raw: BTreeMap::new(), near: Some(first), far: Some(far(ports)), ports }
    }

    fn side(&self, side: Side) -> &dyn Middleware {
        match side {
            Side::Near => self.near.as_ref().unwrap(),
            Side::Far => self.far.as_ref().unwrap(),
        }
    }

    fn restart(&mut self, side: Side) {
        match side {
            Side::Near => {
                self.near = None;
                self.near = Some(near(self.ports));
            }
            Side::Far => {
                self.far = None;
                self.far = Some(far(self.ports));
            }
        }
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let topic = spec.topic.as_bytes();
        let raw = self.raw.entry(spec.topic.clone()).or_insert_with(|| {
            let socket = zmq::Context::new().socket(zmq::XPUB).unwrap();
            socket.set_linger(0).unwrap();
            socket.set_rcvtimeo(30_000).unwrap();
            socket.connect(&format!("tcp://127.0.0.1:{}", self.ports.1)).unwrap();
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

    fn invalid_names() -> Vec<String> {
        ["", "ZEROMQ/CONNECTIONS", "ZEROMQ/CONNECTIONS/x", "/a\0", "/a\nb"]
            .map(str::to_owned)
            .into_iter()
            .chain(["x".repeat(1025)])
            .collect()
    }
}

conformance_tests!(Brokered);
