//! The relay of an action route, which offers an action on another middleware than its server's.
//!
//! ```text
//!   client ──▶ ActionServer at `as` ── goal, cancel ──▶ ActionClient at `action` ──▶ the real server
//!          ◀── state, feedback, result ◀── updates ────                          ◀──
//! ```
//!
//! The action is offered while its real server is there, so that a client that waits for a server waits for the real
//! one. A goal is one entry that ends once: by what the real server says, or as aborted when that server has gone. The
//! relay has no threads, as [`super::Relay`].

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use super::end::RouteEnd;
use super::route::{Route, RouteTypes};
use super::route_status::RouteState;
use super::work::{
    DEGRADED_FOR, Progress, REST_REVIEW_EVERY, REVIEW_EVERY, UNWANTED_FOR, Work, not_begun,
};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Absent, ActionClient, ActionServer, Cause, Context, DropReason, GoalEvent, GoalNumber,
    GoalRequest, GoalUpdate, Link, Qos, Registry, Role, Throttle, Ticket,
};

/// Largest number of requests and of updates moved in one step.
const BATCH: usize = 16;

/// One action route at work.
pub(crate) struct ActionRelay {
    spec: Route,
    /// Bell and counters of the offered action, which are the route's.
    front: Context,
    back: Context,
    offered: RouteEnd<dyn ActionServer>,
    called: RouteEnd<dyn ActionClient>,
    backoff: Backoff,
    /// Goals under way, from both sides.
    numbers: BTreeMap<Ticket, GoalNumber>,
    tickets: BTreeMap<GoalNumber, Ticket>,
    state: RouteState,
    has_source: bool,
    /// Instant of the last request or update.
    moved_at: Option<Instant>,
    last_loss: Option<(Instant, Cause)>,
    losses: Throttle,
}

impl ActionRelay {
    /// A route that has opened nothing yet; the arguments are those of [`super::service_relay::ServiceRelay::new`].
    pub(super) fn new(spec: Route, registry: &Registry, seed: u64, front: Context) -> Self {
        // One bell for both sides.
        let back = Context { counters: Arc::default(), ..front.clone() };
        Self {
            offered: RouteEnd::new(registry, &spec.to.middleware),
            called: RouteEnd::new(registry, &spec.from.middleware),
            front,
            back,
            backoff: Backoff::new(seed),
            numbers: BTreeMap::new(),
            tickets: BTreeMap::new(),
            state: not_begun(),
            has_source: false,
            moved_at: None,
            last_loss: None,
            losses: Throttle::default(),
            spec,
        }
    }

    /// Opens what is to be open: the client, and while that has a server, the action that is offered. That one closes
    /// when the server has gone and its clients have heard of it. Connection of the client.
    fn reconcile(&mut self, now: Instant) -> Option<Link> {
        let Self { spec, front, back, offered, called, backoff, .. } = self;
        let RouteTypes::Action(Some(kind)) = spec.types else { return None };
        called.open_with(now, backoff, |middleware| {
            middleware.open_action_client(&spec.action_spec(&spec.from, kind), back)
        });
        let link = called.open.as_ref().map(|client| client.link());
        self.has_source = link.as_ref().is_some_and(Link::has_peers);
        if self.has_source {
            offered.open_with(now, backoff, |middleware| {
                middleware.open_action_server(&spec.action_spec(&spec.to, kind), front)
            });
            if offered.open.is_some() {
                backoff.reset();
            }
        } else if offered.open.as_ref().is_some_and(|server| server.kept() == 0) {
            offered.close();
        }
        link
    }

    /// Hands goals and cancellations on to the server.
    fn ask(&mut self, now: Instant) -> usize {
        let mut moved = 0;
        while moved < BATCH {
            let (Some(server), Some(client)) = (&mut self.offered.open, &mut self.called.open)
            else {
                break;
            };
            let request = match server.take() {
                Ok(None) => break,
                Ok(Some(request)) => request,
                Err(error) => {
                    // The server has counted the request.
                    moved += 1;
                    self.note(now, "refused a goal", error.drop_reason(), error.to_string());
                    continue;
                }
            };
            moved += 1;
            match request {
                GoalRequest::Goal { number, goal, .. } => {
                    let sent = match self.has_source {
                        true => client.send(&goal).map_err(|it| (it.drop_reason(), it.to_string())),
                        false => Err((DropReason::NoConsumer, self.absent().to_string())),
                    };
                    match sent {
                        Ok(ticket) => {
                            self.numbers.insert(ticket, number);
                            self.tickets.insert(number, ticket);
                        }
                        Err((reason, text)) => {
                            self.front.counters.dropped(reason);
                            self.note(now, "a goal was not sent", reason, text.clone());
                            self.tell(now, number, GoalUpdate::Rejected(text));
                        }
                    }
                }
                GoalRequest::Cancel(number) => {
                    self.front.counters.goal_event(GoalEvent::CancelAsked);
                    if let Some(ticket) = self.tickets.get(&number) {
                        client.cancel(*ticket);
                    }
                }
            }
        }
        moved
    }

    /// Hands updates back to the clients.
    fn answer(&mut self, now: Instant) -> usize {
        let mut moved = 0;
        while moved < BATCH {
            let Some(client) = &mut self.called.open else { break };
            let Some((ticket, update)) = client.take() else { break };
            moved += 1;
            let Some(&number) = self.numbers.get(&ticket) else { continue };
            if update.is_end() {
                self.numbers.remove(&ticket);
                self.tickets.remove(&number);
            }
            self.tell(now, number, update);
        }
        moved
    }

    /// Tells the clients of a goal what has become of it, and counts it.
    fn tell(&mut self, now: Instant, number: GoalNumber, update: GoalUpdate) {
        let counters = Arc::clone(&self.front.counters);
        if let Some(event) = update.event() {
            counters.goal_event(event);
        }
        if let GoalUpdate::Rejected(text) | GoalUpdate::Ended { text, .. } = &update
            && !text.is_empty()
        {
            let route = &self.spec.name;
            let how = update.event().map_or("ended", GoalEvent::as_str);
            tracing::info!(route, "goal {how}: {text}");
        }
        let Some(server) = &mut self.offered.open else { return };
        if let Err(error) = server.update(number, update) {
            let reason = error.drop_reason();
            counters.dropped(reason);
            self.note(now, "an update of a goal was not sent", reason, error.to_string());
        }
    }

    fn note(&mut self, now: Instant, what: &str, reason: DropReason, error: String) {
        if let Some(unlogged_before) = self.losses.pass(now) {
            tracing::warn!(route = self.spec.name, unlogged_before, "{what}: {error}");
        }
        self.last_loss = Some((now, Cause::Lost { reason, error }));
    }

    fn absent(&self) -> Cause {
        Absent::at(Role::ActionServer, &self.spec.from).into()
    }

    fn judge(&self, now: Instant, link: Option<Link>) -> RouteState {
        if let Some(trouble) = self.called.trouble.as_ref().or(self.offered.trouble.as_ref()) {
            return trouble.clone();
        }
        let Some(link) = link else { return self.state.clone() };
        let offered = self.offered.open.as_ref().map(|server| server.link());
        let what = link.waiting_for.or(offered.and_then(|link| link.waiting_for));
        if let Some(what) = what.or_else(|| (!self.has_source).then(|| self.absent())) {
            return RouteState::Waiting(what);
        }
        match &self.last_loss {
            Some((at, cause)) if now.saturating_duration_since(*at) < DEGRADED_FOR => {
                RouteState::Degraded(cause.clone())
            }
            _ => RouteState::Active,
        }
    }
}

impl Work for ActionRelay {
    fn step(&mut self, now: Instant) -> Progress {
        let link = self.reconcile(now);
        for refused in self.back.counters.take_refused() {
            // The counters of the route are those of its other end.
            self.front.counters.refused_peer(refused);
        }
        let moved = self.ask(now).saturating_add(self.answer(now));
        if moved > 0 {
            self.moved_at = Some(now);
        }
        self.state = self.judge(now, link);
        let is_quiet = |at: Instant| now.saturating_duration_since(at) >= UNWANTED_FOR;
        let at_rest = self.numbers.is_empty() && self.moved_at.is_none_or(is_quiet);
        let next = match (moved >= BATCH, at_rest) {
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
        self.called.open.is_some()
    }

    fn close(&mut self) {
        self.numbers.clear();
        self.tickets.clear();
        self.offered.close();
        self.called.close();
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::store::ResolvedType;

    use super::*;
    use wrapyfi_data::types::{Map, RosAction, Value};
    use wrapyfi_endpoint::memory::Memory;
    use wrapyfi_endpoint::{ActionSpec, CountersSnapshot, GoalOutcome, Middleware as _, Request};

    struct Bench {
        bus: Arc<Memory>,
        relay: ActionRelay,
    }

    fn count() -> RosAction {
        let name = TypeName::parse(Dialect::Ros2, "demo/action/Count").unwrap();
        let text = "int32 to\n---\nint32 reached\n---\nint32 at\n";
        RosAction::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
    }

    impl Bench {
        fn new() -> Self {
            let bus = Arc::new(Memory::new("memory"));
            let mut registry = Registry::new();
            registry.register(bus.clone());
            let [real, offered] = ["memory:/real", "memory:/shown"].map(|at| at.parse().unwrap());
            let spec = Route::action(real, offered, count());
            Self { bus, relay: ActionRelay::new(spec, &registry, 1, Context::default()) }
        }

        fn server(&self) -> Box<dyn ActionServer> {
            let spec = ActionSpec::new("/real", count());
            self.bus.open_action_server(&spec, &Context::default()).unwrap()
        }

        fn client(&self) -> Box<dyn ActionClient> {
            let spec = ActionSpec::new("/shown", count());
            self.bus.open_action_client(&spec, &Context::default()).unwrap()
        }

        fn step(&mut self) {
            self.relay.step(Instant::now());
        }

        fn counters(&self) -> CountersSnapshot {
            self.relay.front.counters.snapshot()
        }
    }

    fn goal(to: i32) -> Request {
        Request::default().with(Map::from([("to", Value::from(to))]))
    }

    fn taken(server: &mut dyn ActionServer) -> GoalNumber {
        match server.take().unwrap() {
            Some(GoalRequest::Goal { number, .. }) => number,
            other => panic!("{other:?}"),
        }
    }

    fn succeeded() -> GoalUpdate {
        let (outcome, text) = (GoalOutcome::Succeeded, String::new());
        GoalUpdate::Ended { outcome, result: Some(Value::from(3).into()), text }
    }

    #[test]
    fn a_goal_goes_through_and_everything_about_it_comes_back() {
        let mut bench = Bench::new();
        bench.step();
        assert_eq!(bench.client().link().peers, Some(0), "offered without a server");
        let mut server = bench.server();
        bench.step();
        let mut client = bench.client();
        assert_eq!(client.link().peers, Some(1));
        let ticket = client.send(&goal(3)).unwrap();
        bench.step();
        let number = taken(&mut *server);
        let feedback = GoalUpdate::Feedback(Value::from(1).into());
        let updates = [GoalUpdate::Accepted, GoalUpdate::Executing, feedback, succeeded()];
        for update in &updates {
            server.update(number, update.clone()).unwrap();
        }
        bench.step();
        for update in updates {
            assert_eq!(client.take(), Some((ticket, update)));
        }
        let goals = bench.counters().goals;
        let once = [GoalEvent::Accepted, GoalEvent::Feedback, GoalEvent::Succeeded];
        assert_eq!(goals, once.map(|event| (event, 1)));
        assert!(bench.relay.numbers.is_empty() && bench.relay.tickets.is_empty());
    }

    #[test]
    fn a_wish_to_cancel_reaches_the_server_and_its_answer_the_client() {
        let mut bench = Bench::new();
        let mut server = bench.server();
        bench.step();
        let mut client = bench.client();
        let ticket = client.send(&goal(3)).unwrap();
        client.cancel(ticket);
        bench.step();
        let number = taken(&mut *server);
        assert_eq!(server.take().unwrap(), Some(GoalRequest::Cancel(number)));
        server.update(number, GoalUpdate::CancelRefused("too late".into())).unwrap();
        bench.step();
        assert_eq!(client.take(), Some((ticket, GoalUpdate::CancelRefused("too late".into()))));
        assert_eq!(bench.relay.numbers.len(), 1);
    }

    #[test]
    fn a_server_that_goes_ends_its_goals_and_is_no_longer_offered() {
        let mut bench = Bench::new();
        let mut server = bench.server();
        bench.step();
        let mut client = bench.client();
        let ticket = client.send(&goal(3)).unwrap();
        bench.step();
        let number = taken(&mut *server);
        server.update(number, GoalUpdate::Accepted).unwrap();
        bench.step();
        drop(server);
        bench.step();
        assert_eq!(client.take(), Some((ticket, GoalUpdate::Accepted)));
        assert_eq!(client.take(), Some((ticket, GoalUpdate::aborted("the server has gone"))));
        bench.step();
        assert_eq!((client.take(), client.link().peers), (None, Some(0)));
        assert!(bench.relay.state.to_string().contains("a server of memory:/real"));
        let _again = bench.server();
        bench.step();
        assert_eq!((client.link().peers, &bench.relay.state), (Some(1), &RouteState::Active));
    }

    /// An update of a goal that the relay does not know is no fault, and a goal ends once.
    #[test]
    fn a_goal_ends_once() {
        let mut bench = Bench::new();
        let mut server = bench.server();
        bench.step();
        let mut client = bench.client();
        let ticket = client.send(&goal(1)).unwrap();
        bench.step();
        let number = taken(&mut *server);
        server.update(number, GoalUpdate::Rejected("no".into())).unwrap();
        server.update(number, succeeded()).unwrap();
        bench.step();
        assert_eq!(client.take(), Some((ticket, GoalUpdate::Rejected("no".into()))));
        assert_eq!(client.take(), None);
        assert_eq!(bench.counters().goals, [(GoalEvent::Rejected, 1)]);
    }

    #[test]
    fn a_route_that_closes_ends_its_goals() {
        let mut bench = Bench::new();
        let mut server = bench.server();
        bench.step();
        let mut client = bench.client();
        let ticket = client.send(&goal(1)).unwrap();
        bench.step();
        let number = taken(&mut *server);
        server.update(number, GoalUpdate::Accepted).unwrap();
        bench.step();
        bench.relay.close();
        assert_eq!(client.take(), Some((ticket, GoalUpdate::Accepted)));
        assert!(client.take().is_some_and(|(_, update)| update.is_end()));
    }
}
