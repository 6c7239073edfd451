//! Actions between two nodes of ours, and what others may do to them.

use std::collections::VecDeque;
use std::time::Instant;

use crate::common::{Master, RawPublisher, framed, node};
use wrapyfi_conformance::TIMEOUT;
use wrapyfi_data::types::{Map, Payload, RosAction, Value};
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, Context, DropReason, GoalNumber, GoalOutcome,
    GoalRequest, GoalUpdate, Middleware as _, Request, Ticket,
};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;
use wrapyfi_ros1::Ros1;
use wrapyfi_ros1::header::Header;

/// An action whose fields are called as its parts.
pub(crate) fn count() -> RosAction {
    let name = TypeName::parse(Dialect::Ros2, "demo/action/Count").unwrap();
    let text = "int32 goal\n---\nint32 result\n---\nint32 feedback\n";
    RosAction::new(&ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap()).unwrap()
}

/// A client and a server in two nodes at one master.
pub(crate) struct Scene {
    pub(crate) client: Box<dyn ActionClient>,
    /// Contexts of the client and of the server.
    pub(crate) contexts: [Context; 2],
    pub(crate) server: Option<Box<dyn ActionServer>>,
    /// Requests that the server gave while it looked around.
    pub(crate) requests: VecDeque<GoalRequest>,
    pub(crate) near: Ros1,
    pub(crate) far: Ros1,
    pub(crate) master: Master,
}

impl Scene {
    pub(crate) fn new() -> Self {
        Self::with(&ActionSpec::new("/count", count()))
    }

    fn with(spec: &ActionSpec) -> Self {
        Self::with_contexts(spec, [Context::default(), Context::default()])
    }

    pub(crate) fn with_contexts(spec: &ActionSpec, contexts: [Context; 2]) -> Self {
        let master = Master::start();
        let (near, far) = (node(&master, "near"), node(&master, "far"));
        let client = near.open_action_client(spec, &contexts[0]).unwrap();
        let server = far.open_action_server(spec, &contexts[1]).unwrap();
        let mut scene = Self {
            client,
            contexts,
            server: Some(server),
            requests: VecDeque::new(),
            near,
            far,
            master,
        };
        scene.until("the server is found", |scene| scene.client.link().peers == Some(1));
        scene
    }

    /// Steps both ends until something is so.
    pub(crate) fn until(&mut self, what: &str, mut is_so: impl FnMut(&mut Self) -> bool) {
        let deadline = Instant::now() + TIMEOUT;
        while !is_so(self) {
            assert!(Instant::now() < deadline, "never: {what}; {:?}", self.client.link());
            std::thread::sleep(std::time::Duration::from_millis(2));
            // The ends look around, though nothing is to be taken.
            if let Some(server) = &mut self.server
                && server.deadline().is_some_and(|at| at <= Instant::now())
            {
                self.requests.extend(server.take().unwrap());
            }
        }
    }

    pub(crate) fn request(&mut self) -> GoalRequest {
        let mut taken = None;
        self.until("a request", |scene| {
            let server = scene.server.as_mut().unwrap();
            taken = scene.requests.pop_front().or_else(|| server.take().unwrap());
            taken.is_some()
        });
        taken.unwrap()
    }

    pub(crate) fn goal(&mut self) -> (GoalNumber, Request) {
        match self.request() {
            GoalRequest::Goal { number, goal, .. } => (number, goal),
            other => panic!("{other:?}"),
        }
    }

    fn update(&mut self) -> (Ticket, GoalUpdate) {
        let mut taken = None;
        self.until("an update", |scene| {
            taken = scene.client.take();
            taken.is_some()
        });
        taken.unwrap()
    }

    pub(crate) fn tell(&mut self, number: GoalNumber, update: GoalUpdate) {
        self.server.as_mut().unwrap().update(number, update).unwrap();
    }
}

pub(crate) fn goal(to: i32) -> Request {
    Request::default().with(Map::from([("goal", Value::from(to))]))
}

fn payload(field: &str, value: i32) -> Payload {
    Value::from(Map::from([(field, Value::from(value))])).into()
}

fn field(payload: &Payload, name: &str) -> Value {
    let Payload::RosMessage(message) = payload else { panic!("{payload:?}") };
    message.to_value(1 << 20).unwrap().get(name).unwrap().clone()
}

fn ended(outcome: GoalOutcome) -> GoalUpdate {
    GoalUpdate::Ended { outcome, result: Some(payload("result", 7)), text: "so".to_owned() }
}

#[test]
fn a_goal_its_feedback_and_its_result_cross() {
    let mut scene = Scene::new();
    let ticket = scene.client.send(&goal(3)).unwrap();
    assert_eq!(scene.update(), (ticket, GoalUpdate::Accepted), "before the server says a word");
    let (number, asked) = scene.goal();
    assert_eq!(asked.call().unwrap().kwargs.get("goal"), Some(&Value::from(3)));
    scene.tell(number, GoalUpdate::Accepted);
    scene.tell(number, GoalUpdate::Executing);
    assert_eq!(scene.update(), (ticket, GoalUpdate::Executing));
    for at in 0..100 {
        scene.tell(number, GoalUpdate::Feedback(payload("feedback", at)));
    }
    for at in 0..100 {
        let (_, GoalUpdate::Feedback(feedback)) = scene.update() else { panic!("no feedback") };
        assert_eq!(field(&feedback, "feedback"), Value::from(at));
    }
    scene.tell(number, ended(GoalOutcome::Succeeded));
    let (_, GoalUpdate::Ended { outcome, result, text }) = scene.update() else { panic!() };
    assert_eq!((outcome, text.as_str()), (GoalOutcome::Succeeded, "so"));
    assert_eq!(field(&result.unwrap(), "result"), Value::from(7));
    assert_eq!(scene.server.as_ref().unwrap().kept(), 1, "for a while");
    let counted = scene.contexts[1].counters.snapshot();
    assert_eq!((counted.received, counted.sent), (1, 101), "the feedback and the result");
}

#[test]
fn a_cancel_reaches_the_goal_while_it_runs() {
    let mut scene = Scene::new();
    let ticket = scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    scene.tell(number, GoalUpdate::Executing);
    scene.update();
    assert_eq!(scene.update(), (ticket, GoalUpdate::Executing));
    scene.client.cancel(ticket);
    assert_eq!(scene.request(), GoalRequest::Cancel(number));
    scene.tell(number, GoalUpdate::Canceling);
    assert_eq!(scene.update(), (ticket, GoalUpdate::Canceling));
    scene.tell(number, ended(GoalOutcome::Canceled));
    let (_, GoalUpdate::Ended { outcome, .. }) = scene.update() else { panic!() };
    assert_eq!(outcome, GoalOutcome::Canceled);
}

/// Arrays that follow each other closely are left out, but for the one that shows PREEMPTING.
#[test]
fn a_goal_that_another_client_cancels_is_canceled_however_soon_it_ends() {
    let mut scene = Scene::new();
    let ticket = scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    let ended = ended(GoalOutcome::Canceled);
    for update in [GoalUpdate::Executing, GoalUpdate::Canceling, ended] {
        scene.tell(number, update);
    }
    assert_eq!(scene.update(), (ticket, GoalUpdate::Accepted));
    let outcome = loop {
        match scene.update() {
            (_, GoalUpdate::Ended { outcome, .. }) => break outcome,
            (_, update) => assert!(!update.is_end(), "{update:?}"),
        }
    };
    assert_eq!(outcome, GoalOutcome::Canceled);
}

#[test]
fn all_goals_are_cancelled_at_once() {
    let mut scene = Scene::new();
    let tickets = [1, 2, 3].map(|to| scene.client.send(&goal(to)).unwrap());
    let numbers = tickets.map(|_| scene.goal().0);
    scene.client.cancel_all().unwrap();
    for number in numbers {
        assert_eq!(scene.request(), GoalRequest::Cancel(number));
        scene.tell(number, ended(GoalOutcome::Canceled));
    }
    assert_eq!(scene.request(), GoalRequest::CancelAll);
    let mut ends = 0;
    while ends < 3 {
        if let (_, GoalUpdate::Ended { outcome, .. }) = scene.update() {
            assert_eq!(outcome, GoalOutcome::Canceled, "never active, and recalled");
            ends += 1;
        }
    }
}

#[test]
fn a_rejected_goal_says_why() {
    let mut scene = Scene::new();
    scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    scene.tell(number, GoalUpdate::Rejected("no map".to_owned()));
    assert_eq!(scene.update().1, GoalUpdate::Accepted);
    assert_eq!(scene.update().1, GoalUpdate::Executing);
    let (_, GoalUpdate::Ended { outcome, text, .. }) = scene.update() else { panic!() };
    assert_eq!((outcome, text.as_str()), (GoalOutcome::Aborted, "no map"));
}

#[test]
fn goals_beyond_the_limit_are_refused() {
    let mut scene = Scene::with(&ActionSpec { goals: 1, ..ActionSpec::new("/count", count()) });
    scene.client.send(&goal(1)).unwrap();
    let error = scene.client.send(&goal(2)).unwrap_err().to_string();
    assert!(error.contains("1 calls of \"/count\" are under way"), "{error}");
    let (number, _) = scene.goal();
    scene.tell(number, ended(GoalOutcome::Succeeded));
    scene.until("the goal ends", |scene| scene.client.take().is_some_and(|(_, it)| it.is_end()));
    scene.client.send(&goal(2)).unwrap();
    scene.goal();
}

#[test]
fn a_server_that_ends_aborts_its_goals_and_is_waited_for() {
    let mut scene = Scene::new();
    let ticket = scene.client.send(&goal(3)).unwrap();
    scene.goal();
    assert_eq!(scene.update(), (ticket, GoalUpdate::Accepted));
    scene.server = None;
    scene.until("the goal ends", |scene| scene.client.take().is_some_and(|(_, it)| it.is_end()));
    scene.until("the server is gone", |scene| scene.client.link().peers == Some(0));
    // Not the connection that has closed any more.
    scene.until("the server is waited for", |scene| {
        scene.client.link().waiting_for.is_some_and(|it| it.to_string().contains("/count"))
    });
    let ticket = scene.client.send(&goal(3)).unwrap();
    assert!(matches!(scene.update(), (same, GoalUpdate::Rejected(_)) if same == ticket));
}

pub(crate) fn status_header() -> Header {
    let types = ("actionlib_msgs/GoalStatusArray", "8b2b82f13216d0a8ea88bd3af735e619");
    Header::new().with("callerid", "/real").with("type", types.0).with("md5sum", types.1)
}

/// A second publisher of status arrays would make the goals of every client lost.
#[test]
fn nothing_is_offered_where_another_node_publishes_the_status() {
    let master = Master::start();
    let rival = RawPublisher::start(&master, "/real", "/count/status", &status_header());
    let far = node(&master, "far");
    let spec = ActionSpec::new("/count", count());
    let mut server = far.open_action_server(&spec, &Context::default()).unwrap();
    let deadline = Instant::now() + TIMEOUT;
    let named = loop {
        assert_eq!(server.take(), Ok(None));
        if let Some(cause) = server.link().waiting_for {
            break cause.to_string();
        }
        assert!(Instant::now() < deadline);
        std::thread::yield_now();
    };
    assert!(named.contains("/real offers an action"), "{named}");
    let state = master.ask("getTopicTypes", vec![wrapyfi_ros1::xmlrpc::text("/test")]);
    assert!(!format!("{state:?}").contains("/count/result"), "{state:?}");
    drop(rival);
}

#[test]
fn an_action_gives_way_to_a_node_that_publishes_the_status_later() {
    let mut scene = Scene::new();
    let ticket = scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    let _rival = RawPublisher::start(&scene.master, "/real", "/count/status", &status_header());
    assert_eq!(scene.request(), GoalRequest::Cancel(number), "the real server is to give it up");
    let mut last = None;
    scene.until("the goal ends", |scene| {
        last = scene.client.take().or(last.take());
        last.as_ref().is_some_and(|(_, update)| update.is_end())
    });
    let (ended, GoalUpdate::Ended { outcome, text, .. }) = last.unwrap() else { panic!() };
    assert_eq!((ended, outcome), (ticket, GoalOutcome::Aborted));
    assert!(text.contains("/real"), "{text}");
}

/// Feedback that the client does not take is dropped and counted, and the end of the goal comes all the same.
#[test]
fn a_flood_of_feedback_is_bounded_and_counted() {
    const FLOOD: i32 = 5000;
    let mut scene = Scene::new();
    scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    scene.tell(number, GoalUpdate::Executing);
    while scene.update().1 != GoalUpdate::Executing {}
    for at in 0..FLOOD {
        scene.tell(number, GoalUpdate::Feedback(payload("feedback", at)));
    }
    let dropped =
        |scene: &Scene| scene.contexts[0].counters.snapshot().dropped_for(DropReason::QueueFull);
    scene.until("most of it is dropped", |scene| dropped(scene) >= FLOOD as u64 - 1000);
    scene.tell(number, ended(GoalOutcome::Succeeded));
    let (mut heard, mut last) = (0, None);
    while last.is_none() {
        match scene.update().1 {
            GoalUpdate::Feedback(_) => heard += 1,
            update => last = Some(update),
        }
    }
    assert_eq!(heard + dropped(&scene), FLOOD as u64);
    assert!(last.is_some_and(|update| update.is_end()));
}

/// Bytes that are no messages of an action are dropped, and the node lives on.
#[test]
fn hostile_messages_are_dropped() {
    let mut scene = Scene::new();
    let cancel = Header::new()
        .with("callerid", "/odd")
        .with("type", "actionlib_msgs/GoalID")
        .with("md5sum", "302881f31927c1df708a2dbab0e80ee8");
    let odd = RawPublisher::start(&scene.master, "/odd", "/count/cancel", &cancel);
    scene.until("the server listens", |_| odd.subscribers() > 0);
    for body in [&b""[..], &[0xff; 12], &[0; 11]] {
        odd.send(&framed(body));
    }
    let ticket = scene.client.send(&goal(3)).unwrap();
    let (number, _) = scene.goal();
    scene.tell(number, ended(GoalOutcome::Succeeded));
    scene.until("the goal ends", |scene| {
        scene.client.take().is_some_and(|(one, update)| one == ticket && update.is_end())
    });
    assert_eq!(scene.near.node_name(), "/near");
}
