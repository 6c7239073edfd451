//! A service route under an invented clock, on services in memory.

use std::time::Duration;

use wrapyfi_interfaces::store::TypeStore;

use super::super::route_status::RouteStatus;
use super::*;
use wrapyfi_data::types::{Payload, RosMessage, RosService, ServiceKind, Value};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{DropReason, Middleware as _, Request, ServiceSpec};

impl ServiceRelay {
    fn status(&self) -> RouteStatus {
        let counters = self.front.counters.snapshot();
        RouteStatus { counters, ..RouteStatus::planned(&self.spec, self.state.clone()) }
    }
}

struct Bench {
    bus: Arc<Memory>,
    relay: ServiceRelay,
}

impl Bench {
    fn new() -> Self {
        Self::of(ServiceKind::NativeObject)
    }

    fn of(kind: ServiceKind) -> Self {
        let bus = Arc::new(Memory::new("memory"));
        let mut registry = Registry::new();
        registry.register(bus.clone());
        let [service, offered] = ["memory:/real", "memory:/shown"].map(|at| at.parse().unwrap());
        let mut spec = Route::service(service, offered, kind);
        spec.policy.timeout = Duration::from_millis(50);
        Self { bus, relay: ServiceRelay::new(spec, &registry, 1, Context::default()) }
    }

    fn spec(name: &str) -> ServiceSpec {
        ServiceSpec::new(name, ServiceKind::NativeObject)
    }

    fn step(&mut self) {
        self.relay.step(Instant::now());
    }
}

#[test]
fn a_call_goes_through_and_its_reply_comes_back() {
    let mut bench = Bench::new();
    bench.step();
    assert!(bench.relay.status().state.to_string().contains("a server of memory:/real"));
    let mut server = bench.bus.open_server(&Bench::spec("/real"), &Context::default()).unwrap();
    let mut client = bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
    let ticket = client.send(&Request::new([Value::from(7)]), ServiceSpec::TIMEOUT).unwrap();
    client.take();
    bench.step();
    let asked = server.take().unwrap().unwrap();
    assert_eq!(asked.request, Request::new([Value::from(7)]));
    server.reply(asked.id, Ok(Value::from("seven").into())).unwrap();
    bench.step();
    let reply = client.take_only(ticket).unwrap().unwrap();
    assert_eq!(reply.payload, Payload::from(Value::from("seven")));
    let status = bench.relay.status();
    assert_eq!((status.counters.received, status.counters.sent), (1, 1));
    assert_eq!(status.state, RouteState::Active);
}

#[test]
fn an_error_reaches_the_caller_in_words_and_is_counted() {
    let mut bench = Bench::new();
    bench.step();
    let mut server = bench.bus.open_server(&Bench::spec("/real"), &Context::default()).unwrap();
    let mut client = bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
    let ticket = client.send(&Request::default(), ServiceSpec::TIMEOUT).unwrap();
    client.take();
    bench.step();
    let asked = server.take().unwrap().unwrap();
    server.reply(asked.id, Err("the arm is off".into())).unwrap();
    bench.step();
    let error = client.take_only(ticket).unwrap().unwrap_err().to_string();
    assert!(error.contains("the arm is off"), "{error}");
    let status = bench.relay.status();
    assert!(matches!(status.state, RouteState::Degraded(_)), "{}", status.state);
    assert_eq!(status.counters.dropped_for(DropReason::Refused), 1);
}

/// A call that failed while a server was gone is no fault of the one that has come.
#[test]
fn a_server_that_comes_back_ends_the_complaint_about_the_one_before() {
    let mut bench = Bench::new();
    bench.step();
    let mut client = bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
    let open = |bus: &Memory| bus.open_server(&Bench::spec("/real"), &Context::default()).unwrap();
    let mut server = open(&bench.bus);
    client.send(&Request::default(), ServiceSpec::TIMEOUT).unwrap();
    client.take();
    bench.step();
    let asked = server.take().unwrap().unwrap();
    server.reply(asked.id, Err("the arm is off".into())).unwrap();
    bench.step();
    assert!(matches!(bench.relay.status().state, RouteState::Degraded(_)));
    drop(server);
    bench.step();
    assert!(matches!(bench.relay.status().state, RouteState::Waiting(_)));
    let _again = open(&bench.bus);
    bench.step();
    assert_eq!(bench.relay.status().state, RouteState::Active);
}

#[test]
fn a_server_that_does_not_answer_is_told_to_the_caller_in_time() {
    let mut bench = Bench::new();
    bench.step();
    let mut client = bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
    let ticket = client.send(&Request::default(), ServiceSpec::TIMEOUT).unwrap();
    client.take();
    let end = Instant::now() + Duration::from_secs(20);
    let error = loop {
        bench.step();
        if let Some(result) = client.take_only(ticket) {
            break result.unwrap_err().to_string();
        }
        assert!(Instant::now() < end, "no answer");
        std::thread::yield_now();
    };
    assert!(error.contains("/shown") && error.contains("/real"), "{error}");
}

#[test]
fn messages_of_a_service_of_ros_are_not_looked_into() {
    let resolved = TypeStore::generated().resolve_name("std_srvs/srv/SetBool").unwrap();
    let service = RosService::new(&resolved).unwrap();
    let mut bench = Bench::of(ServiceKind::Ros(service));
    bench.step();
    let mut server = bench.bus.open_server(&Bench::spec("/real"), &Context::default()).unwrap();
    let mut client = bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
    // Seven is no bool, and bytes are left behind the last field.
    let asked = RosMessage::new(service.request(), &[0, 1, 0, 0, 7, 7, 7][..]);
    let request = Request::Message(asked);
    let ticket = client.send(&request, ServiceSpec::TIMEOUT).unwrap();
    client.take();
    bench.step();
    let taken = server.take().unwrap().unwrap();
    assert_eq!(taken.request, request);
    let reply = Payload::from(RosMessage::new(service.response(), &[0, 0, 0, 0, 9][..]));
    server.reply(taken.id, Ok(reply.clone())).unwrap();
    bench.step();
    assert_eq!(client.take_only(ticket).unwrap().unwrap().payload, reply);
}
