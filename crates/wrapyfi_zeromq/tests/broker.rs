//! The broker against raw sockets such as Python Wrapyfi opens.

use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use crate::common::{Cable, MONITOR, any_ports, bound, is_free, peer, subscriber, wait_for_count};
use wrapyfi_conformance::until;
use wrapyfi_data::Limits;
use wrapyfi_zeromq::{Broker, BrokerError, PortHolder, ZeroMq, ZeroMqConfig, ZeroMqError};

#[test]
fn counts_reach_publishers_that_come_late() {
    let broker = Broker::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let _listener = subscriber(&context, broker.pub_port(), "/a");
    let first = subscriber(&context, broker.pub_port(), MONITOR);
    wait_for_count(&first, "/a", 1);
    // Nothing changes any more; still a newcomer and an old one hear it.
    let late = subscriber(&context, broker.pub_port(), MONITOR);
    wait_for_count(&late, "/a", 1);
    wait_for_count(&first, "/a", 1);
    assert_eq!(broker.status().subscriptions.get("/a"), Some(&1));
    assert!(!broker.status().subscriptions.contains_key(MONITOR));
}

#[test]
fn traffic_does_not_delay_counts() {
    let broker = Broker::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let monitor = subscriber(&context, broker.pub_port(), MONITOR);
    let flooded = subscriber(&context, broker.pub_port(), "/flood");
    let publisher = peer(&context, zmq::PUB, broker.sub_port());
    let stop = Arc::new(AtomicBool::new(false));
    let flood = std::thread::spawn({
        let stop = Arc::clone(&stop);
        move || {
            while !stop.load(Relaxed) {
                publisher.send_multipart(["/flood", "x"], 0).unwrap();
            }
        }
    });
    flooded.recv_multipart(0).unwrap();
    let _listener = subscriber(&context, broker.pub_port(), "/a");
    wait_for_count(&monitor, "/a", 1);
    stop.store(true, Relaxed);
    flood.join().unwrap();
    assert!(broker.status().messages > 0);
}

#[test]
fn the_last_listener_gone_is_told_however_it_went() {
    let broker = Broker::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let monitor = subscriber(&context, broker.pub_port(), MONITOR);
    // An XPUB shows what publishers hear: one subscription, one unsubscription.
    let publisher = peer(&context, zmq::XPUB, broker.sub_port());
    let [one, two, three] = [(); 3].map(|()| subscriber(&context, broker.pub_port(), "/a"));
    wait_for_count(&monitor, "/a", 3);
    one.set_unsubscribe(b"/a").unwrap();
    wait_for_count(&monitor, "/a", 2);
    drop(two); // no unsubscription: the connection just ends
    wait_for_count(&monitor, "/a", 1);
    assert_eq!(broker.status().subscriptions.get("/a"), Some(&1));
    drop(three);
    wait_for_count(&monitor, "/a", 0);
    let _other = subscriber(&context, broker.pub_port(), "/b");
    for heard in [b"\x01/a", b"\x00/a", b"\x01/b"] {
        assert_eq!(publisher.recv_bytes(0).unwrap(), heard);
    }
}

/// A listener as Python has it, which sends no heartbeats of its own, behind a cable that is cut: nothing closes, and
/// only its silence tells.
/// What a publisher keeps of subscriptions is its own memory and time; libzmq takes a frame of the stack for each byte, too.
#[test]
fn publishers_are_told_the_beginnings_of_long_subscriptions() {
    let broker = Broker::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let publisher = peer(&context, zmq::XPUB, broker.sub_port());
    let topics = ["a", "b"].map(|end| "x".repeat(2000) + end);
    let listeners = topics.each_ref().map(|topic| subscriber(&context, broker.pub_port(), topic));
    assert_eq!(publisher.recv_bytes(0).unwrap(), ["\u{1}", &"x".repeat(256)].concat().as_bytes());
    // As long as one is left, they go on; and each listener gets its own alone.
    let [one, other] = listeners;
    for round in ["1", "2"] {
        until("its own message", || {
            let sent = topics.iter().map(|topic| publisher.send_multipart([&**topic, round], 0));
            sent.for_each(Result::unwrap);
            let heard = other.poll(zmq::POLLIN, 100).unwrap() > 0;
            heard && other.recv_multipart(0).unwrap() == [topics[1].as_bytes(), round.as_bytes()]
        });
        one.set_unsubscribe(topics[0].as_bytes()).unwrap();
    }
    drop(other);
    assert_eq!(publisher.recv_bytes(0).unwrap(), ["\0", &"x".repeat(256)].concat().as_bytes());
}

#[test]
fn a_listener_behind_a_cut_cable_is_given_up_and_found_again() {
    let broker = Broker::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let cable = Cable::to(broker.pub_port());
    let listener = subscriber(&context, cable.port, "/a");
    let publisher = peer(&context, zmq::XPUB, broker.sub_port());
    assert_eq!(publisher.recv_bytes(0).unwrap(), b"\x01/a");
    cable.cut(true);
    assert_eq!(publisher.recv_bytes(0).unwrap(), b"\x00/a", "nobody listens any more");
    cable.cut(false);
    until("the subscription", || {
        // libzmq subscribes again once its user looks for messages.
        assert!(listener.recv_bytes(zmq::DONTWAIT).is_err(), "nothing was sent yet");
        publisher.recv_bytes(zmq::DONTWAIT).is_ok_and(|heard| heard == b"\x01/a")
    });
    publisher.send_multipart(["/a", "1"], 0).unwrap();
    assert_eq!(listener.recv_multipart(0).unwrap()[1], b"1");
}

#[test]
fn messages_pass_and_forged_counts_do_not() {
    let broker = Broker::start(&any_ports()).unwrap();
    let context = zmq::Context::new();
    let monitor = subscriber(&context, broker.pub_port(), MONITOR);
    let listener = subscriber(&context, broker.pub_port(), "/a");
    let publisher = peer(&context, zmq::XPUB, broker.sub_port());
    assert_eq!(publisher.recv_bytes(0).unwrap(), b"\x01/a");
    // Publishers filter by subscription, and the broker asks for no counts: a program has to want
    // everything before forged counts leave their sender.
    let _everything = subscriber(&context, broker.pub_port(), "");
    assert_eq!(publisher.recv_bytes(0).unwrap(), b"\x01");
    publisher.send_multipart([MONITOR, r#"{"/a": 99}"#], 0).unwrap();
    publisher.send_multipart(["/a", "{}", "3"], 0).unwrap();
    let frames = listener.recv_multipart(0).unwrap();
    assert_eq!(frames, [b"/a".to_vec(), b"{}".to_vec(), b"3".to_vec()]);
    wait_for_count(&monitor, "/a", 1);
    until("its counts", || {
        let status = broker.status();
        (status.messages, status.bytes, status.forged) == (1, 5, 1)
    });
}

#[test]
fn it_ends_at_once_and_frees_its_ports() {
    let broker = Broker::start(&any_ports()).unwrap();
    let (pub_port, sub_port) = (broker.pub_port(), broker.sub_port());
    let context = zmq::Context::new();
    let listener = subscriber(&context, pub_port, "/a");
    let publisher = peer(&context, zmq::PUB, sub_port);
    until("the subscription", || broker.status().subscriptions.contains_key("/a"));
    let start = Instant::now();
    drop(broker);
    assert!(start.elapsed() < 2 * Limits::SHUTDOWN, "{:?}", start.elapsed());
    drop((listener, publisher));
    let again = ZeroMqConfig { pub_port, sub_port, ..ZeroMqConfig::default() };
    let again = Broker::start(&again).unwrap();
    assert_eq!(again.pub_port(), pub_port);
}

#[test]
fn addresses_others_can_reach_are_refused() {
    let config = ZeroMqConfig { ip: "0.0.0.0".to_owned(), ..any_ports() };
    let error = Broker::start(&config).unwrap_err();
    assert!(matches!(error, BrokerError::NotLoopback { .. }));
    assert!(error.to_string().contains("insecure: true"), "{error}");
    Broker::start(&ZeroMqConfig { insecure: true.into(), ..config }).unwrap();
    let elsewhere = ZeroMqConfig {
        ip: "192.0.2.1".to_owned(),
        insecure: true.into(),
        ..ZeroMqConfig::default()
    };
    assert!(matches!(Broker::start(&elsewhere), Err(BrokerError::NotHere { .. })));
}

fn start_on(pub_port: u16, sub_port: u16) -> Result<ZeroMq, ZeroMqError> {
    ZeroMq::start(&ZeroMqConfig { pub_port, sub_port, ..ZeroMqConfig::default() })
}

#[test]
fn a_silent_program_on_the_port_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let error = start_on(port, 0).unwrap_err();
    let ZeroMqError::PortTaken { port: named, answer, .. } = &error else { panic!("{error}") };
    assert_eq!((*named, answer), (port, &PortHolder::Silent));
    assert!(error.to_string().contains(&port.to_string()), "{error}");
    let who = format!("process {}, ", std::process::id());
    assert!(error.to_string().contains(&who), "{error}");
}

#[test]
fn another_zeromq_program_on_the_port_is_named() {
    let context = zmq::Context::new();
    let (_rep, port) = bound(&context, zmq::REP);
    let error = start_on(0, port).unwrap_err();
    let ZeroMqError::PortTaken { port: named, answer, .. } = &error else { panic!("{error}") };
    assert_eq!((*named, answer), (port, &PortHolder::Socket("REP".into())));
    assert!(error.to_string().contains("REP"), "{error}");
}

#[test]
fn a_foreign_broker_is_used_and_replaced_when_it_dies() {
    let context = zmq::Context::new();
    let (front, pub_port) = bound(&context, zmq::XPUB);
    let (back, sub_port) = bound(&context, zmq::XSUB);
    let ours = start_on(pub_port, sub_port).unwrap();
    assert_eq!(ours.broker_status(), None);
    drop((front, back));
    until("the take-over", || ours.broker_status().is_some());
    let listener = subscriber(&context, pub_port, "/a");
    let publisher = peer(&context, zmq::XPUB, sub_port);
    assert_eq!(publisher.recv_bytes(0).unwrap(), b"\x01/a");
    publisher.send_multipart(["/a", "1"], 0).unwrap();
    assert_eq!(listener.recv_multipart(0).unwrap()[1], b"1");
    drop(ours);
    drop((listener, publisher));
    until("free ports", || is_free(pub_port) && is_free(sub_port));
}

#[test]
fn two_instances_share_one_broker() {
    let first = ZeroMq::start(&any_ports()).unwrap();
    let second = start_on(first.pub_port(), first.sub_port()).unwrap();
    assert!(first.broker_status().is_some());
    assert!(second.broker_status().is_none());
    drop(first);
    until("the take-over", || second.broker_status().is_some());
}
