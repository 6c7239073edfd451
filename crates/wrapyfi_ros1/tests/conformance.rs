//! The suite against ROS 1: two nodes at one master.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use crate::common::{Master, RawPublisher, framed, greet, node};
use wrapyfi_conformance::{Capabilities, TIMEOUT, Testbed, WireEnd, conformance_tests};
use wrapyfi_data::types::{DataType, MessageType};
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{Middleware, ServiceSpec, TopicSpec};
use wrapyfi_ros1::Ros1;
use wrapyfi_ros1::header::Header;
use wrapyfi_ros1::xmlrpc::{Value, text};

struct Roscore {
    near: Option<Ros1>,
    far: Option<Ros1>,
    raw: BTreeMap<String, RawPublisher>,
    asking: Vec<TcpStream>,
    master: Master,
}

impl Testbed for Roscore {
    const CAPABILITIES: Capabilities = Capabilities {
        // One connection joins two nodes, whatever publishes there.
        listener_counts_publishers: false,
        // Wrapyfi insists on floats.
        integer_sound: false,
        ..Capabilities::FULL
    };

    fn start() -> Self {
        let master = Master::start();
        let (near, far) = (node(&master, "near"), node(&master, "far"));
        let (raw, asking) = (BTreeMap::new(), Vec::new());
        Self { near: Some(near), far: Some(far), raw, asking, master }
    }

    fn side(&self, side: WireEnd) -> &dyn Middleware {
        match side {
            WireEnd::Near => self.near.as_ref().unwrap(),
            WireEnd::Far => self.far.as_ref().unwrap(),
        }
    }

    fn restart(&mut self, side: WireEnd) {
        let (place, name) = match side {
            WireEnd::Near => (&mut self.near, "near"),
            WireEnd::Far => (&mut self.far, "far"),
        };
        *place = None;
        *place = Some(node(&self.master, name));
    }

    fn type_name(message_type: MessageType) -> String {
        Ros1Type::of(message_type).unwrap().name
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let master = &self.master;
        let raw = self.raw.entry(spec.topic.clone()).or_insert_with(|| {
            let Ros1Type { name, md5, .. } = Ros1Type::of(spec.message_type).unwrap();
            let fields = Header::new().with("type", name).with("md5sum", md5);
            let raw = RawPublisher::start(master, "/raw", &spec.topic, &fields);
            let deadline = Instant::now() + TIMEOUT;
            while raw.subscribers() == 0 {
                assert!(Instant::now() < deadline, "nobody subscribed");
                std::thread::sleep(Duration::from_millis(2));
            }
            raw
        });
        let content = match spec.message_type {
            // Any text is a text: what is broken is the message around it.
            MessageType::Text => body.to_vec(),
            // So is one that is no JSON, also where its bytes are no UTF-8.
            MessageType::NativeObject | MessageType::StringJson
                if body == b"{" || std::str::from_utf8(body).is_err() =>
            {
                body.to_vec()
            }
            other if other.data_type() == DataType::NativeObject => framed(body),
            _ => body.to_vec(),
        };
        raw.send(&framed(&content));
    }

    fn inject_request(&mut self, spec: &ServiceSpec, body: &[u8]) {
        let found = self.master.ask("lookupService", vec![text("/raw"), text(&spec.service)]);
        let Value::String(address) = found.value else { panic!("{found:?}") };
        let own = Header::new()
            .with("callerid", "/raw")
            .with("service", &spec.service)
            .with("md5sum", "*");
        let (mut stream, header) = greet(address.trim_start_matches("rosrpc://"), &own);
        assert_eq!(header.get("error"), None);
        stream.write_all(&framed(&framed(body))).unwrap();
        self.asking.push(stream);
    }

    fn invalid_names() -> Vec<String> {
        ["", "/", "/a b", "/a:b", "/a//b", "/a\n", "~"]
            .map(str::to_owned)
            .into_iter()
            .chain(["x".repeat(1025)])
            .collect()
    }
}

conformance_tests!(Roscore);
