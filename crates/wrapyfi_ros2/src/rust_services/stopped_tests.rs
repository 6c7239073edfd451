//! A process that is stopped and goes on. It is that of the test itself, so that each needs one of its own.

use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::RustServices;
use super::foreign_tests::adder;
use crate::config::CycloneConfig;
use crate::graph::{CdrClient, CdrServer, Peers};
use wrapyfi_node::NodeName;

const TIMEOUT: Duration = Duration::from_secs(30);

/// Waits until a call is answered; requests are sent again and again, as some are lost.
fn answered(client: &mut dyn CdrClient, server: &mut dyn CdrServer) {
    let deadline = Instant::now() + TIMEOUT;
    let mut sent = Vec::new();
    let mut asked_at = Instant::now();
    loop {
        assert!(Instant::now() < deadline, "no reply, {:?}", client.servers());
        if matches!(client.servers(), Peers::Ready(_)) && Instant::now() >= asked_at {
            sent.extend(client.send(&[&[0, 1, 0, 0, 7, 0, 0, 0]]));
            asked_at = Instant::now() + Duration::from_millis(200);
        }
        while let Ok(Some(request)) = server.take() {
            _ = server.reply(&request.id, &[&request.cdr]);
        }
        if let Ok(Some(reply)) = client.take() {
            assert_eq!(reply.cdr[4..], [7, 0, 0, 0]);
            if sent.contains(&reply.sequence) {
                return;
            }
        }
        std::thread::sleep(Duration::from_millis(5)); // the rate of the looks
    }
}

#[test]
fn services_answer_again_after_the_process_was_stopped() {
    let domain_id = 61 + std::process::id() % 10;
    let services = |node: &str| {
        let node = NodeName::new(node, "/").unwrap();
        RustServices::new(&CycloneConfig::loopback(node, domain_id)).unwrap()
    };
    let service = adder();
    let (ours, theirs) = (services("ours"), services("theirs"));
    let mut server = ours.server(&service, Arc::new(|| {})).unwrap();
    let mut client = theirs.client(&service, Arc::new(|| {})).unwrap();
    answered(&mut *client, &mut *server);
    for _ in 0..2 {
        let before = ours.gid();
        let script = "kill -STOP $PPID; sleep 0.3; kill -CONT $PPID";
        assert!(Command::new("sh").args(["-c", script]).status().unwrap().success());
        let deadline = Instant::now() + TIMEOUT;
        while ours.gid() == before {
            assert!(Instant::now() < deadline, "it is on the same participant");
            assert!(server.take().is_ok_and(|request| request.is_none()));
            std::thread::sleep(Duration::from_millis(5)); // the rate of the looks
        }
        answered(&mut *client, &mut *server);
        let ends = ours.endpoints();
        assert_eq!((ends.readers.len(), ends.writers.len()), (1, 1), "what is announced");
    }
}
