//! The suite that every middleware passes, over UDP.

#![allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]

use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicU16, Ordering::Relaxed};

use wrapyfi_conformance::{Capabilities, Testbed, TypeCheck, WireEnd, conformance_tests};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{Middleware, TopicSpec};
use wrapyfi_example_middleware::Udp;

/// Two programs in one group.
struct Group {
    port: u16,
    near: Option<Udp>,
    far: Option<Udp>,
}

/// A port that no other group of this machine has: it is bound for as long as another group looks for one.
fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 20_000 + u16::try_from(std::process::id() % 15_000).unwrap();
    loop {
        let port = first + NEXT.fetch_add(1, Relaxed);
        if UdpSocket::bind((Ipv4Addr::UNSPECIFIED, port)).is_ok() {
            return port;
        }
    }
}

impl Testbed for Group {
    const CAPABILITIES: Capabilities = Capabilities {
        waits_aloud: false,
        keeps_last: false,
        block_waits: false,
        types: TypeCheck::Arrival,
        services: false,
        ..Capabilities::FULL
    };

    fn start() -> Self {
        let port = free_port();
        let joined = || Some(Udp::join(port).unwrap());
        Self { port, near: joined(), far: joined() }
    }

    fn side(&self, side: WireEnd) -> &dyn Middleware {
        let side = match side {
            WireEnd::Near => &self.near,
            WireEnd::Far => &self.far,
        };
        side.as_ref().unwrap()
    }

    fn restart(&mut self, side: WireEnd) {
        let place = match side {
            WireEnd::Near => &mut self.near,
            WireEnd::Far => &mut self.far,
        };
        *place = None;
        *place = Some(Udp::join(self.port).unwrap());
    }

    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let body = String::from_utf8_lossy(body);
        let datagram = serde_json::json!({
            "endpoint": 1, "topic": spec.topic, "role": "publisher", "is_open": true,
            "type": spec.message_type.to_string(), "body": body,
        });
        let group = (Ipv4Addr::new(239, 255, 77, 0), self.port);
        socket.send_to(datagram.to_string().as_bytes(), group).unwrap();
    }

    fn type_name(message_type: MessageType) -> String {
        message_type.to_string()
    }

    fn invalid_names() -> Vec<String> {
        vec![String::new(), "/a\nb".to_owned()]
    }
}

conformance_tests! {
    Group,
    lacks {
        keeps_last: "a datagram is gone once it was sent",
        block_waits: "nobody can make the sender of a datagram wait",
        services: "there are topics alone",
    },
    known_faults {
        raw_images_arrive_unchanged: "65000",
    },
}
