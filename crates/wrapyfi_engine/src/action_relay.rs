//! The relay of an action route, which offers an action on another middleware than its server's.
//!
//! ```text
//!   client ──▶ ActionServer at `as` ── goal, cancel ──▶ ActionClient at `action` ──▶ the real server
//!          ◀── state, feedback, result ◀── updates ────                          ◀──
//! ```
//!
//! The action is shown while its real server is there, so that a client that waits for a server waits for the real
//! one. A goal is one entry that ends once: by what the real server says, or as aborted when that server has gone.

use std::sync::Arc;
use std::time::Instant;

use super::call_relay::{CallRelay, Calls};
use super::route::{Route, RouteTypes};
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, Context, DropReason, EndpointAddress, GoalEvent,
    GoalNumber, GoalRequest, GoalUpdate, Link, Middleware, OpenError, OpenResult, Opened, Role,
};

/// One action route at work.
pub(crate) type ActionRelay = CallRelay<Actions>;

/// Actions.
pub(crate) enum Actions {}

impl Calls for Actions {
    type Server = dyn ActionServer;
    type Client = dyn ActionClient;
    type Id = GoalNumber;
    const REAL: Role = Role::ActionServer;
    const FOLLOWS: bool = true;

    fn open_server(on: &dyn Middleware, at: &Route, with: &Context) -> Opened<dyn ActionServer> {
        on.open_action_server(&spec(at, &at.to)?, with)
    }

    fn open_client(on: &dyn Middleware, at: &Route, with: &Context) -> Opened<dyn ActionClient> {
        on.open_action_client(&spec(at, &at.from)?, with)
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

    fn hide(server: &mut Self::Server) -> bool {
        server.hide()
    }

    fn show(server: &mut Self::Server, on: &dyn Middleware) -> OpenResult<()> {
        server.show(on)
    }

    fn ask(relay: &mut ActionRelay, now: Instant) -> bool {
        let absent = relay.absent();
        let (Some(server), Some(client)) = (&mut relay.offered.open, &mut relay.called.open) else {
            return false;
        };
        match server.take() {
            Ok(None) => return false,
            Ok(Some(GoalRequest::Goal { number, goal, .. })) => {
                let sent = match absent {
                    None => client.send(&goal).map_err(|it| (it.drop_reason(), it.to_string())),
                    Some(absent) => Err((DropReason::NoConsumer, absent.to_string())),
                };
                match sent {
                    Ok(ticket) => _ = relay.calls.insert(ticket, number),
                    Err((reason, text)) => {
                        relay.front.counters.dropped(reason);
                        relay.note(now, "a goal was not sent", reason, text.clone());
                        relay.tell(now, number, GoalUpdate::Rejected(text));
                    }
                }
            }
            Ok(Some(GoalRequest::Cancel(number))) => {
                relay.front.counters.goal_event(GoalEvent::CancelAsked);
                if let Some((ticket, _)) = relay.calls.iter().find(|(_, it)| **it == number) {
                    client.cancel(*ticket);
                }
            }
            Ok(Some(GoalRequest::CancelAll)) => {
                if let Err(error) = client.cancel_all() {
                    tracing::debug!(route = relay.spec.name, "goals of others go on: {error}");
                }
            }
            // The server has counted the request.
            Err(error) => relay.note(now, "refused a goal", error.drop_reason(), error.to_string()),
        }
        true
    }

    fn answer(relay: &mut ActionRelay, now: Instant) -> bool {
        let Some(client) = &mut relay.called.open else { return false };
        let Some((ticket, update)) = client.take() else { return false };
        let number = match update.is_end() {
            true => relay.calls.remove(&ticket),
            false => relay.calls.get(&ticket).copied(),
        };
        if let Some(number) = number {
            relay.tell(now, number, update);
        }
        true
    }
}

/// Action of a route, at one of its ends.
fn spec(route: &Route, at: &EndpointAddress) -> OpenResult<ActionSpec> {
    match route.types {
        RouteTypes::Action(Some(kind)) => Ok(route.action_spec(at, kind)),
        _ => Err(OpenError::transport("the route", &at.name, "its type is not known".to_owned())),
    }
}

impl ActionRelay {
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
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::store::ResolvedType;

    use super::super::route_status::RouteState;
    use super::super::work::Work as _;
    use super::*;
    use wrapyfi_data::types::{Map, RosAction, Value};
    use wrapyfi_endpoint::memory::Memory;
    use wrapyfi_endpoint::{CountersSnapshot, GoalOutcome, Registry, Request};

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
        assert!(bench.relay.calls.is_empty());
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
        assert_eq!(bench.relay.calls.len(), 1);
    }

    /// Goals that a killed bridge has sent are stopped so.
    #[test]
    fn a_wish_to_cancel_all_reaches_goals_of_other_clients() {
        let mut bench = Bench::new();
        let mut server = bench.server();
        let mut other = {
            let spec = ActionSpec::new("/real", count());
            bench.bus.open_action_client(&spec, &Context::default()).unwrap()
        };
        other.send(&goal(3)).unwrap();
        let number = taken(&mut *server);
        bench.step();
        bench.client().cancel_all().unwrap();
        bench.step();
        assert_eq!(server.take().unwrap(), Some(GoalRequest::Cancel(number)));
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

    /// A goal that could not be sent while a server had too many is no fault of the server that has come.
    #[test]
    fn a_server_that_comes_back_ends_the_complaint_about_the_one_before() {
        let mut bench = Bench::new();
        let server = bench.server();
        bench.step();
        let mut clients = [bench.client(), bench.client()];
        for (client, to) in clients.iter_mut().zip([1, 2]) {
            for _ in 0..ActionSpec::GOALS {
                client.send(&goal(to)).unwrap();
            }
        }
        let now = Instant::now();
        while bench.relay.step(now).moved > 0 {}
        assert!(matches!(bench.relay.state, RouteState::Degraded(_)), "{}", bench.relay.state);
        drop(server);
        while bench.relay.step(now).moved > 0 {}
        assert!(matches!(bench.relay.state, RouteState::Waiting(_)), "{}", bench.relay.state);
        let _again = bench.server();
        bench.relay.step(now);
        assert_eq!(bench.relay.state, RouteState::Active);
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
