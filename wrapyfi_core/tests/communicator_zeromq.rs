//! Registered methods over ZeroMQ, through our broker: what every middleware must do, and what the
//! options of ZeroMQ do.

use std::mem::ManuallyDrop;
use std::net::TcpListener;
use std::sync::Arc;

use crate::communicator_common as common;
use wrapyfi_conformance::{reserve_port, until};
use wrapyfi_core::communicator::{CommunicatorContext, MethodError, Mode, communicator};
use wrapyfi_zeromq::{BrokerMode, ServiceBroker, ZeroMq, ZeroMqConfig};

const MWARE: &str = "zeromq";

/// A side on this broker.
fn side(broker: BrokerMode, pub_port: u16, sub_port: u16) -> ZeroMqConfig {
    ZeroMqConfig { broker, pub_port, sub_port, ..ZeroMqConfig::default() }
}

/// A side with the broker, and one that uses it.
fn contexts() -> (CommunicatorContext, CommunicatorContext) {
    let any_ports = ZeroMqConfig { rep_port: 0, req_port: 0, ..ZeroMqConfig::default() };
    let services = ServiceBroker::start(&any_ports).unwrap();
    let (rep_port, req_port) = (services.rep_port(), services.req_port());
    let with_services = |config| {
        let service_broker = BrokerMode::Foreign;
        let config = ZeroMqConfig { rep_port, req_port, service_broker, ..config };
        ZeroMq::start(&config).unwrap()
    };
    let one = with_services(side(BrokerMode::Embedded, 0, 0));
    let other = with_services(side(BrokerMode::Foreign, one.pub_port(), one.sub_port()));
    // Runs until the process ends: each test has a process of its own.
    std::mem::forget(services);
    let context = |zeromq| CommunicatorContext::builder().only(Arc::new(zeromq)).build();
    (context(one), context(other))
}

#[test]
fn what_is_published_is_heard() {
    let (here, there) = contexts();
    common::what_is_published_is_heard(MWARE, &here, &there);
}

#[test]
fn transceive_meets_reemit() {
    let (here, there) = contexts();
    common::transceive_meets_reemit(MWARE, &here, &there);
}

#[test]
fn modes_change() {
    let (here, there) = contexts();
    common::modes_change(MWARE, &here, &there);
}

#[test]
fn a_request_is_replied() {
    let (here, there) = contexts();
    common::a_request_is_replied(MWARE, &here, &there);
}

#[test]
fn a_wait_ends_in_time() {
    common::a_wait_ends_in_time(MWARE, &contexts().0);
}

struct Speaker;

#[communicator]
impl Speaker {
    #[register(
        NativeObject,
        "zeromq",
        "/speaker",
        timeout_ms = 30000,
        socket_pub_port = "$pub_port",
        socket_sub_port = "$sub_port"
    )]
    fn say(&self, pub_port: u16, sub_port: u16) -> String {
        format!("{pub_port} {sub_port}")
    }

    #[register(
        NativeObject,
        "zeromq",
        "/nobody",
        timeout_ms = 30000,
        socket_rep_port = "$0",
        socket_req_port = "$1"
    )]
    fn ask(&self, rep_port: u16, req_port: u16) -> u16 {
        rep_port ^ req_port
    }
}

/// Two ports that are this test's until its process ends: each test has a process of its own.
fn free_ports() -> (u16, u16) {
    let port = || ManuallyDrop::new(reserve_port()).number;
    (port(), port())
}

/// The standard context: the publisher runs the broker, and both instances of one process hear each
/// other although a ZeroMQ instance does not hear itself.
#[test]
fn the_standard_context_needs_nothing_else() {
    let (pub_port, sub_port) = free_ports();
    let context = CommunicatorContext::builder().build();
    let mut instances = [Speaker.communicator_in(&context), Speaker.communicator_in(&context)];
    for instance in &mut instances {
        instance.activate(SpeakerMethod::Say, ["publish", "listen"]).unwrap();
        instance.activate(SpeakerMethod::Ask, ["reply", "request"]).unwrap();
    }
    let [speaker, hearer] = &instances;
    std::thread::scope(|scope| {
        let heard = scope.spawn(|| hearer.say(pub_port, sub_port).unwrap());
        let said = speaker.say(pub_port, sub_port).unwrap();
        assert_eq!(heard.join().unwrap(), said);
    });
    let (rep_port, req_port) = free_ports();
    std::thread::scope(|scope| {
        let served = scope.spawn(|| speaker.ask(rep_port, req_port).unwrap());
        assert_eq!(hearer.ask(rep_port, req_port).unwrap(), Some(rep_port ^ req_port));
        assert!(served.join().unwrap().is_some());
    });
    // The broker ends with the last instance.
    drop(instances);
    until("the ports to be free", || {
        [pub_port, sub_port].iter().all(|&port| TcpListener::bind(("127.0.0.1", port)).is_ok())
    });
}

struct Ears;

#[communicator]
impl Ears {
    #[register(NativeObject, "memory", "/a", timeout_ms = 30000)]
    #[register(NativeObject, "zeromq", "/b", timeout_ms = 30000)]
    #[register(NativeObject, "ros", "/c", timeout_ms = 30000)]
    fn hear(&self) -> (i64, i64, i64) {
        (1, 2, 3)
    }

    #[register(NativeObject, "zeromq", "/b", timeout_ms = 2000)]
    fn alone(&self) -> i64 {
        1
    }
}

#[test]
fn a_middleware_that_is_missing_is_none_beside_others_and_waited_for_alone() {
    let (pub_port, sub_port) = free_ports();
    let memory = Arc::new(wrapyfi_endpoint::memory::Memory::new("memory"));
    // Two sides: an instance of ZeroMQ does not hear itself.
    let [mut here, mut there] = [(); 2].map(|()| {
        let zeromq = ZeroMq::start(&side(BrokerMode::Foreign, pub_port, sub_port)).unwrap();
        let context = CommunicatorContext::builder().only(Arc::clone(&memory) as _);
        let context = context.middleware(Arc::new(zeromq));
        #[cfg(feature = "ros1")]
        let context = {
            use wrapyfi_ros1::{Ros1, Ros1Config};
            // No program has this port.
            let master_uri = "http://127.0.0.1:1".to_owned();
            let ros1 = Ros1::start(&Ros1Config { master_uri, ..Ros1Config::default() }).unwrap();
            context.middleware(Arc::new(ros1))
        };
        Ears.communicator_in(&context.build())
    });
    here.activate(EarsMethod::Hear, Mode::Publish).unwrap();
    there.activate(EarsMethod::Hear, Mode::Listen).unwrap();
    std::thread::scope(|scope| {
        let heard = scope.spawn(|| there.hear().unwrap());
        assert_eq!(here.hear().unwrap(), (Some(1), Some(2), Some(3)), "its own values");
        assert_eq!(heard.join().unwrap(), (Some(1), None, None));
    });
    here.activate(EarsMethod::Alone, Mode::Publish).unwrap();
    let error = here.alone().unwrap_err();
    assert!(matches!(error, MethodError::TimedOut { .. }), "{error}");
    // The broker comes: the value is one of the channel again.
    let broker = wrapyfi_zeromq::Broker::start(&ZeroMqConfig {
        pub_port,
        sub_port,
        ..ZeroMqConfig::default()
    });
    let _broker = broker.unwrap();
    until("both values", || {
        std::thread::scope(|scope| {
            let heard = scope.spawn(|| there.hear().unwrap());
            // A value that is published before the broker knows the subscription is heard by no listener.
            while !heard.is_finished() {
                here.hear().unwrap();
                std::thread::sleep(std::time::Duration::from_millis(10));
            }
            heard.join().unwrap() == (Some(1), Some(2), None)
        })
    });
}

#[test]
fn a_port_that_is_no_brokers_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let mut speaker = Speaker.communicator_in(&CommunicatorContext::builder().build());
    speaker.activate(SpeakerMethod::Say, Mode::Publish).unwrap();
    let error = speaker.say(port, free_ports().0).unwrap_err();
    assert!(matches!(error, MethodError::Start { .. }), "{error:?}");
    let text = error.to_string();
    assert!(
        text.starts_with("Speaker::say: zeromq did not start: ")
            && text.contains(&port.to_string())
    );
}
