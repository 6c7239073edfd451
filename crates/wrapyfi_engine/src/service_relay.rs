//! The relay of a service route, which offers a service on another middleware than its server's.
//!
//! Requests and replies go in the form in which they come: between ROS 1 and ROS 2 as bytes, by
//! compiled plans.
//!
//! Many calls may be under way; each ends with its reply, or with an error.

use std::time::Instant;

use super::call_relay::{CallRelay, Calls};
use super::route::Route;
use wrapyfi_data::DecodeError;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{
    CallError, Client, Context, DropReason, Link, Middleware, Opened, Refusal, RequestId, Role,
    ServeError, Server,
};

/// One service route at work.
pub(crate) type ServiceRelay = CallRelay<Services>;

/// Services.
pub(crate) enum Services {}

impl Calls for Services {
    type Server = dyn Server;
    type Client = dyn Client;
    type Id = RequestId;
    const REAL: Role = Role::Server;
    const FOLLOWS: bool = false;

    fn open_server(on: &dyn Middleware, at: &Route, with: &Context) -> Opened<dyn Server> {
        on.open_server(&at.service_spec(&at.to), with)
    }

    fn open_client(on: &dyn Middleware, at: &Route, with: &Context) -> Opened<dyn Client> {
        on.open_client(&at.service_spec(&at.from), with)
    }

    fn look_at_server(server: &Self::Server) -> (Link, Option<Instant>) {
        (server.link(), server.deadline())
    }

    fn look_at_client(client: &Self::Client) -> (Link, Option<Instant>) {
        (client.link(), client.deadline())
    }

    fn kept(server: &Self::Server) -> usize {
        server.kept()
    }

    fn ask(relay: &mut ServiceRelay, now: Instant) -> bool {
        let (Some(server), Some(client)) = (&mut relay.offered.open, &mut relay.called.open) else {
            return false;
        };
        match server.take() {
            Ok(None) => return false,
            Ok(Some(asked)) => {
                // The call gets 95 % of the time left, so that its error still reaches the caller.
                let age = relay.front.clock.age(asked.received_at);
                let left = relay.spec.policy.answer_within().saturating_sub(age);
                match client.send(&asked.request, left / 20 * 19) {
                    Ok(ticket) => _ = relay.calls.insert(ticket, asked.id),
                    Err(error) => relay.end(now, asked.id, Err(error)),
                }
            }
            // The server has counted the request.
            Err(error) => {
                relay.note(now, "refused a request", error.drop_reason(), error.to_string());
            }
        }
        true
    }

    fn answer(relay: &mut ServiceRelay, now: Instant) -> bool {
        let Some(client) = &mut relay.called.open else { return false };
        let Some((ticket, result)) = client.take() else { return false };
        if let Some(id) = relay.calls.remove(&ticket) {
            let result = result.and_then(|reply| relay.converted(reply.payload));
            relay.end(now, id, result);
        }
        true
    }
}

impl ServiceRelay {
    /// Converts the value that a function returned to the type that the offered service carries.
    fn converted(&self, payload: Payload) -> Result<Payload, CallError> {
        let Some(conversion) = self.conversion else { return Ok(payload) };
        conversion.convert(payload, || self.front.clock.ros_now().stamp).map_err(|error| {
            let fault = DecodeError::mismatch(conversion.to.to_string(), error.to_string());
            CallError::Reply { service: self.spec.from.name.clone(), fault }
        })
    }

    fn end(&mut self, now: Instant, id: RequestId, result: Result<Payload, CallError>) {
        let Some(server) = &mut self.offered.open else { return };
        let why = result.as_ref().err().map(|error| (error.drop_reason(), error.to_string()));
        let answer = result
            .map_err(|error| Refusal { text: error.to_string(), reason: error.drop_reason() });
        // A server that gave a request up has counted it.
        let untold = match server.reply(id, answer) {
            Ok(_) | Err(ServeError::NotWaiting { .. }) => None,
            Err(error) => Some(error.to_string()),
        };
        if let Some((reason, why)) = why {
            self.note(now, "a call failed", reason, why);
        }
        if let Some(untold) = untold {
            self.note(now, "an answer was not sent", DropReason::SendFailed, untold);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use wrapyfi_interfaces::store::TypeStore;

    use super::super::route_status::{RouteState, RouteStatus};
    use super::super::work::Work as _;
    use super::*;
    use wrapyfi_data::types::{RosMessage, RosService, ServiceKind, Value};
    use wrapyfi_endpoint::memory::Memory;
    use wrapyfi_endpoint::{Registry, Request, ServiceSpec};

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
            let [service, offered] =
                ["memory:/real", "memory:/shown"].map(|at| at.parse().unwrap());
            let mut spec = Route::service(service, offered, kind);
            spec.policy.timeout = Some(Duration::from_millis(50));
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
        let mut client =
            bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
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
        let mut client =
            bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
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
        let mut client =
            bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
        let open =
            |bus: &Memory| bus.open_server(&Bench::spec("/real"), &Context::default()).unwrap();
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
        let mut client =
            bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
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
        let mut client =
            bench.bus.open_client(&Bench::spec("/shown"), &Context::default()).unwrap();
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
}
