//! The relay of a service route, which offers a service on another middleware than its server's.
//!
//! ```text
//!   caller ──▶ Server at `as` ── take ──▶ send ── Client at `service` ──▶ the real server
//!          ◀──────────────────── reply ◀── take ◀─────────────────────────
//! ```
//!
//! Requests and replies go in the form in which they come: between ROS 1 and ROS 2 as bytes, by
//! compiled plans.
//!
//! Many calls may be under way; each ends with its reply, or with an error. The relay has no
//! threads, as [`super::Relay`].

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use super::end::RouteEnd;
use super::route::Route;
use super::route_status::RouteState;
use super::work::{
    DEGRADED_FOR, Progress, REST_REVIEW_EVERY, REVIEW_EVERY, UNWANTED_FOR, Work, not_begun,
};
use wrapyfi_data::DecodeError;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Absent, CallError, Cause, Client, Context, DropReason, Qos, Refusal, Registry, RequestId, Role,
    ServeError, Server, Throttle, Ticket,
};

/// Largest number of requests and replies moved in one step.
const BATCH: usize = 16;

/// One service route at work.
pub(crate) struct ServiceRelay {
    spec: Route,
    /// Bell and counters of the offered service, which are the route's.
    front: Context,
    back: Context,
    /// Conversion to the type that the offered service carries.
    conversion: Option<Conversion>,
    offered: RouteEnd<dyn Server>,
    called: RouteEnd<dyn Client>,
    backoff: Backoff,
    /// Calls under way, each with the request that it is for.
    calls: BTreeMap<Ticket, RequestId>,
    state: RouteState,
    has_source: bool,
    /// Instant of the last request or reply.
    moved_at: Option<Instant>,
    last_loss: Option<(Instant, Cause)>,
    losses: Throttle,
}

impl ServiceRelay {
    /// A route that has opened nothing yet. `seed` spreads its back-off; the counters of `front`, which count requests
    /// as received and replies as sent, may be those of an earlier route with these ends.
    pub(super) fn new(spec: Route, registry: &Registry, seed: u64, front: Context) -> Self {
        // One bell for both sides.
        let back = Context { counters: Arc::default(), ..front.clone() };
        Self {
            conversion: spec.service_spec(&spec.to).conversion(),
            offered: RouteEnd::new(registry, &spec.to.middleware),
            called: RouteEnd::new(registry, &spec.from.middleware),
            front,
            back,
            backoff: Backoff::new(seed),
            calls: BTreeMap::new(),
            state: not_begun(),
            has_source: false,
            moved_at: None,
            last_loss: None,
            losses: Throttle::default(),
            spec,
        }
    }

    /// True when no client calls, and no client has called for [`UNWANTED_FOR`].
    pub(super) fn is_at_rest(&self, now: Instant) -> bool {
        let is_quiet = |at: Instant| now.saturating_duration_since(at) >= UNWANTED_FOR;
        self.calls.is_empty() && self.moved_at.is_none_or(is_quiet)
    }

    /// Opens what is to be open, the client of the real server first, so that a request finds it
    /// open.
    fn reconcile(&mut self, now: Instant) {
        let Self { spec, front, back, offered, called, backoff, .. } = self;
        called.open_with(now, backoff, |middleware| {
            middleware.open_client(&spec.service_spec(&spec.from), back)
        });
        if called.open.is_some() {
            offered.open_with(now, backoff, |middleware| {
                middleware.open_server(&spec.service_spec(&spec.to), front)
            });
        }
        if called.open.is_some() && offered.open.is_some() {
            backoff.reset();
        }
    }

    /// Hands requests on to the server.
    fn ask(&mut self, now: Instant) -> usize {
        let mut moved = 0;
        while moved < BATCH {
            let (Some(server), Some(client)) = (&mut self.offered.open, &mut self.called.open)
            else {
                break;
            };
            let asked = match server.take() {
                Ok(None) => break,
                Ok(Some(asked)) => asked,
                Err(error) => {
                    // The server has counted the request.
                    moved += 1;
                    let reason = match &error {
                        ServeError::Request { reason, .. } => *reason,
                        _ => DropReason::SendFailed,
                    };
                    self.note(now, "refused a request", reason, error.to_string());
                    continue;
                }
            };
            moved += 1;
            // The call gets 95 % of the time left, so that its error still reaches the caller.
            let age = self.front.clock.age(asked.received_at);
            let left = self.spec.policy.answer_within().saturating_sub(age);
            match client.send(&asked.request, left / 20 * 19) {
                Ok(ticket) => {
                    self.calls.insert(ticket, asked.id);
                }
                Err(error) => self.end(now, asked.id, Err(error)),
            }
        }
        moved
    }

    /// Hands replies back to the callers.
    fn answer(&mut self, now: Instant) -> usize {
        let mut moved = 0;
        while moved < BATCH {
            let Some(client) = &mut self.called.open else { break };
            let Some((ticket, result)) = client.take() else { break };
            moved += 1;
            if let Some(id) = self.calls.remove(&ticket) {
                let result = result.and_then(|reply| self.converted(reply.payload));
                self.end(now, id, result);
            }
        }
        moved
    }

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

    fn note(&mut self, now: Instant, what: &str, reason: DropReason, error: String) {
        if let Some(unlogged_before) = self.losses.pass(now) {
            tracing::warn!(route = self.spec.name, unlogged_before, "{what}: {error}");
        }
        self.last_loss = Some((now, Cause::Lost { reason, error }));
    }

    fn judge(&mut self, now: Instant) -> RouteState {
        self.has_source = false;
        if let Some(trouble) = self.called.trouble.as_ref().or(self.offered.trouble.as_ref()) {
            return trouble.clone();
        }
        let (Some(server), Some(client)) = (&self.offered.open, &self.called.open) else {
            return self.state.clone();
        };
        let (server, client) = (server.link(), client.link());
        self.has_source = client.peers > Some(0);
        let is_alone = client.peers == Some(0);
        let alone = || is_alone.then(|| Absent::at(Role::Server, &self.spec.from).into());
        if let Some(what) = client.waiting_for.or(server.waiting_for).or_else(alone) {
            // What failed for want of it is over once it is there.
            self.last_loss = None;
            return RouteState::Waiting(what);
        }
        match &self.last_loss {
            Some((at, text)) if now.saturating_duration_since(*at) < DEGRADED_FOR => {
                RouteState::Degraded(text.clone())
            }
            _ => RouteState::Active,
        }
    }
}

impl Work for ServiceRelay {
    fn step(&mut self, now: Instant) -> Progress {
        self.reconcile(now);
        for refused in self.back.counters.take_refused() {
            // The counters of the route are those of its other end.
            self.front.counters.refused_peer(refused);
        }
        let moved = self.ask(now).saturating_add(self.answer(now));
        if moved > 0 {
            self.moved_at = Some(now);
        }
        self.state = self.judge(now);
        let next = match (moved >= BATCH, self.is_at_rest(now)) {
            (true, _) => now,
            (false, true) => now + REST_REVIEW_EVERY,
            (false, false) => now + REVIEW_EVERY,
        };
        let due = [
            self.offered.retry_at,
            self.called.retry_at,
            self.offered.open.as_ref().and_then(|server| server.deadline()),
            self.called.open.as_ref().and_then(|client| client.deadline()),
        ];
        Progress { moved, next: due.into_iter().flatten().fold(next, Instant::min).max(now) }
    }

    fn state(&self) -> (&RouteState, [Option<Qos>; 2], bool) {
        (&self.state, [None, None], self.has_source)
    }

    fn is_open(&self) -> bool {
        self.called.open.is_some() && self.offered.open.is_some()
    }

    fn close(&mut self) {
        self.calls.clear();
        self.offered.close();
        self.called.close();
    }
}

#[cfg(test)]
mod tests {
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
