//! Actions between two nodes over loopback, in both mappings of services; `rmw` runs them over an installed ROS 2.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use wrapyfi_data::types::{Map, Payload, RosAction, Value};
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, Context, GoalNumber, GoalOutcome, GoalRequest,
    GoalUpdate, Middleware as _, Request, Ticket,
};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;
use wrapyfi_ros2::graph::{Graph, ServiceMapping, wait_until};
use wrapyfi_ros2::{CycloneConfig, CycloneGraph, Ros2};

use crate::common::{TIMEOUT, far_config, near_config};

const FIBONACCI: &str = "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n";

fn fibonacci() -> RosAction {
    let name = TypeName::parse(Dialect::Ros2, "example_interfaces/action/Fibonacci").unwrap();
    RosAction::new(&ResolvedType::from_text(Dialect::Ros2, &name, FIBONACCI).unwrap()).unwrap()
}

pub fn ros2(config: &CycloneConfig, mapping: ServiceMapping) -> Ros2 {
    let config = CycloneConfig { services: Some(mapping), ..config.clone() };
    on(CycloneGraph::new(&config).unwrap())
}

pub fn on(graph: impl Graph + 'static) -> Ros2 {
    Ros2::new(std::sync::Arc::new(graph), |name| Ok(name.to_owned()))
}

/// An end of an action, and the bell that it rings. A server also has the requests that came while a client waited.
struct Server(Box<dyn ActionServer>, Context, VecDeque<GoalRequest>);
struct Client(Box<dyn ActionClient>, Context);

impl Server {
    fn open(ros2: &Ros2) -> Self {
        let context = Context::default();
        let spec = ActionSpec::new("fibonacci", fibonacci());
        Self(ros2.open_action_server(&spec, &context).unwrap(), context, VecDeque::new())
    }

    /// Answers what needs no owner, such as requests for results, which may come later than others.
    fn turn(&mut self) {
        self.2.extend(self.0.take().unwrap());
    }

    fn next(&mut self) -> GoalRequest {
        let wake = self.1.wake.clone();
        let came = wait_until(&wake, TIMEOUT, || {
            self.turn();
            !self.2.is_empty()
        });
        assert!(came, "no request");
        self.2.pop_front().unwrap()
    }

    fn goal(&mut self) -> (GoalNumber, i64) {
        match self.next() {
            GoalRequest::Goal { number, goal, .. } => {
                (number, goal.call().unwrap().kwargs.get("order").unwrap().as_i64().unwrap())
            }
            other => panic!("{other:?}"),
        }
    }

    fn tell(&mut self, number: GoalNumber, update: GoalUpdate) {
        self.0.update(number, update).unwrap();
    }
}

impl Client {
    fn open(ros2: &Ros2) -> Self {
        let context = Context::default();
        let spec = ActionSpec::new("/robot/fibonacci", fibonacci());
        Self(ros2.open_action_client(&spec, &context).unwrap(), context)
    }

    fn waits_for(&mut self, servers: usize) {
        let Self(client, context) = self;
        assert!(
            wait_until(&context.wake, TIMEOUT, || {
                assert_eq!(client.take(), None);
                client.link().peers == Some(servers)
            }),
            "{:?}",
            client.link()
        );
    }

    fn send(&mut self, order: i64) -> Ticket {
        let goal = Request::default().with(Map::from([("order", order)]));
        self.0.send(&goal).unwrap()
    }

    /// Waits for the next update, while `turn` lets the server go on.
    fn next(&mut self, mut turn: impl FnMut()) -> (Ticket, GoalUpdate) {
        let mut next = None;
        let Self(client, context) = self;
        let came = wait_until(&context.wake, TIMEOUT, || {
            turn();
            next = client.take();
            next.is_some()
        });
        assert!(came, "no update, link {:?}", client.link());
        next.unwrap()
    }

    fn hears(&mut self, wanted: &[GoalUpdate], mut turn: impl FnMut()) {
        for update in wanted {
            assert_eq!(&self.next(&mut turn).1, update);
        }
    }
}

fn sequence(numbers: &[i64]) -> Payload {
    let numbers: Vec<Value> = numbers.iter().map(|&number| number.into()).collect();
    Value::from(Map::from([("sequence", Value::from(numbers))])).into()
}

/// Numbers of a result or of feedback.
fn numbers(payload: &Payload) -> Vec<i64> {
    let Payload::RosMessage(message) = payload else { panic!("{payload:?}") };
    let value = message.to_value(1 << 20).unwrap();
    let Value::Tensor(numbers) = value.get("sequence").unwrap() else { panic!("{value:?}") };
    let cells = numbers.data().chunks_exact(4);
    cells.map(|cell| i64::from(i32::from_le_bytes(cell.try_into().unwrap()))).collect()
}

fn ended(outcome: GoalOutcome, result: &[i64]) -> GoalUpdate {
    GoalUpdate::Ended { outcome, result: Some(sequence(result)), text: String::new() }
}

fn goals_go_over(ours: &Ros2, theirs: &Ros2) {
    let mut client = Client::open(theirs);
    client.waits_for(0);
    let mut server = Server::open(ours);
    client.waits_for(1);

    // Feedback is not lost, though it comes at once, and what comes of the goal stays in order.
    let sent = Instant::now();
    let ticket = client.send(5);
    let (number, order) = server.goal();
    assert_eq!(order, 5);
    server.tell(number, GoalUpdate::Accepted);
    assert_eq!(client.next(|| server.turn()), (ticket, GoalUpdate::Accepted));
    assert!(sent.elapsed() < Duration::from_secs(2), "{:?}", sent.elapsed());
    server.tell(number, GoalUpdate::Executing);
    client.hears(&[GoalUpdate::Executing], || server.turn());
    for step in 0..200 {
        server.tell(number, GoalUpdate::Feedback(sequence(&[step])));
    }
    for step in 0..200 {
        let (_, GoalUpdate::Feedback(feedback)) = client.next(|| server.turn()) else {
            panic!("{step}")
        };
        assert_eq!(numbers(&feedback), [step]);
    }
    assert_eq!(server.2.pop_front(), None);
    server.tell(number, ended(GoalOutcome::Succeeded, &[0, 1, 1, 2]));
    let (_, GoalUpdate::Ended { outcome, result: Some(result), .. }) =
        client.next(|| server.turn())
    else {
        panic!("no end")
    };
    assert_eq!((outcome, numbers(&result)), (GoalOutcome::Succeeded, vec![0, 1, 1, 2]));

    // Rejected, and cancelled before it is accepted.
    client.send(1);
    let (number, _) = server.goal();
    server.tell(number, GoalUpdate::Rejected("no".to_owned()));
    client.hears(&[GoalUpdate::Rejected(String::new())], || server.turn());
    let ticket = client.send(1);
    client.0.cancel(ticket);
    let (number, _) = server.goal();
    server.tell(number, GoalUpdate::Accepted);
    client.hears(&[GoalUpdate::Accepted], || server.turn());
    assert_eq!(server.next(), GoalRequest::Cancel(number));
    server.tell(number, GoalUpdate::Canceling);
    client.hears(&[GoalUpdate::Canceling], || server.turn());
    server.tell(number, ended(GoalOutcome::Canceled, &[]));
    let (_, GoalUpdate::Ended { outcome, .. }) = client.next(|| server.turn()) else {
        panic!("no end")
    };
    assert_eq!(outcome, GoalOutcome::Canceled);
}

/// All of them wait for their results at once, which are more requests than a service keeps.
fn fifty_goals_are_under_way_at_once(ours: &Ros2, theirs: &Ros2) {
    let mut client = Client::open(theirs);
    let mut server = Server::open(ours);
    client.waits_for(1);
    (0..50).for_each(|order| _ = client.send(order));
    let mut numbers = Vec::new();
    while numbers.len() < 50 {
        // The client sends the next when those before are answered.
        _ = client.0.take();
        if let Some(GoalRequest::Goal { number, .. }) = server.0.take().unwrap() {
            server.tell(number, GoalUpdate::Executing);
            numbers.push(number);
        }
    }
    for number in numbers.into_iter().rev() {
        _ = server.0.take().unwrap();
        server.tell(number, ended(GoalOutcome::Succeeded, &[1]));
    }
    let mut ends = 0;
    let (wake, began) = (client.1.wake.clone(), Instant::now());
    while ends < 50 {
        assert_eq!(server.0.take().unwrap(), None);
        assert!(began.elapsed() < TIMEOUT, "{ends} ended");
        match client.0.take() {
            Some((_, update)) => ends += usize::from(update.is_end()),
            None => _ = wake.wait(Duration::from_millis(5)),
        }
    }
    assert_eq!(server.0.kept(), 0);
}

fn a_server_that_goes_ends_its_goals(ours: &Ros2, theirs: &Ros2) {
    let mut client = Client::open(theirs);
    let mut server = Server::open(ours);
    client.waits_for(1);
    client.send(1);
    let (number, _) = server.goal();
    server.tell(number, GoalUpdate::Executing);
    client.hears(&[GoalUpdate::Accepted, GoalUpdate::Executing], || server.turn());
    drop(server);
    let (_, GoalUpdate::Ended { outcome, .. }) = client.next(|| ()) else { panic!("no end") };
    assert_eq!(outcome, GoalOutcome::Aborted);
    client.waits_for(0);
}

pub fn all(ours: &Ros2, theirs: &Ros2) {
    goals_go_over(ours, theirs);
    fifty_goals_are_under_way_at_once(ours, theirs);
    a_server_that_goes_ends_its_goals(ours, theirs);
}

#[test]
fn actions_over_services_of_cyclonedds() {
    let [ours, theirs] = [near_config("near"), far_config("far")];
    all(&ros2(&ours, ServiceMapping::Cyclone), &ros2(&theirs, ServiceMapping::Cyclone));
}

#[cfg(feature = "fastdds-services")]
#[test]
fn actions_over_services_of_fast_dds() {
    let [ours, theirs] = [near_config("one"), near_config("other")];
    all(&ros2(&ours, ServiceMapping::FastDds), &ros2(&theirs, ServiceMapping::FastDds));
}

/// Actions of ros2-client, which is written by others.
#[cfg(feature = "fastdds-services")]
mod of_ros2_client {
    use ros2_client::action::{GetResultResponse, GoalStatusEnum, SendGoalResponse};
    use ros2_client::action_msgs::CancelGoalResponseEnum;
    use ros2_client::builtin_interfaces::Time;
    use wrapyfi_conformance::wait_for;

    use super::*;
    use crate::fast_common::{Order, Peer, Sequence};

    fn found<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
        wait_for(wrapyfi_endpoint::Wake::new(), what, look)
    }

    #[test]
    fn a_client_drives_our_server() {
        let ours = ros2(&near_config("ours"), ServiceMapping::FastDds);
        let mut peer = Peer::new("theirs");
        let client = peer.fibonacci_client("/robot/fibonacci");
        let mut server = Server::open(&ours);
        found("a client", || (server.0.link().peers == Some(1)).then_some(()));
        let (sent, id) = client.send_goal(Order { order: 3 }).unwrap();
        let (number, order) = server.goal();
        assert_eq!(order, 3);
        server.tell(number, GoalUpdate::Executing);
        let accepted = found("a reply", || client.receive_goal_response(sent).unwrap());
        assert!(accepted.accepted && accepted.stamp != Time::ZERO);
        let asked = client.request_result(id).unwrap();
        let feedback = found("feedback", || {
            // Until the two have found each other.
            assert_eq!(server.0.take().unwrap(), None);
            server.tell(number, GoalUpdate::Feedback(sequence(&[1, 1])));
            client.receive_feedback(id).unwrap()
        });
        assert_eq!(feedback, Sequence { sequence: vec![1, 1] });
        let canceled = client.cancel_goal(id).unwrap();
        assert_eq!(server.next(), GoalRequest::Cancel(number));
        server.tell(number, GoalUpdate::Canceling);
        let answer = found("an answer", || client.receive_cancel_response(canceled).unwrap());
        assert_eq!(answer.return_code, CancelGoalResponseEnum::None);
        assert_eq!(answer.goals_canceling.len(), 1);
        server.tell(number, ended(GoalOutcome::Canceled, &[1, 2]));
        let (status, result) = found("a result", || {
            assert_eq!(server.0.take().unwrap(), None);
            client.receive_result(asked).unwrap()
        });
        assert_eq!(status, GoalStatusEnum::Canceled);
        assert_eq!(result, Sequence { sequence: vec![1, 2] });
    }

    #[test]
    fn a_server_is_driven_by_our_client() {
        let ours = ros2(&near_config("ours"), ServiceMapping::FastDds);
        let mut peer = Peer::new("theirs");
        let server = peer.fibonacci_server("/robot/fibonacci");
        let mut client = Client::open(&ours);
        client.waits_for(1);
        client.send(3);
        let (asked, goal) = found("a goal", || server.receive_goal().unwrap());
        assert_eq!(goal.goal.order, 3);
        let accepted = SendGoalResponse { accepted: true, stamp: Time::ZERO };
        server.send_goal_response(asked, accepted).unwrap();
        client.hears(&[GoalUpdate::Accepted], || ());
        let (asked, _) = found("a request", || server.receive_result_request().unwrap());
        server.send_feedback(goal.goal_id, Sequence { sequence: vec![7] }).unwrap();
        // It tells no states: the one that feedback comes in is filled in.
        client.hears(&[GoalUpdate::Executing], || ());
        let (_, GoalUpdate::Feedback(feedback)) = client.next(|| ()) else { panic!("no feedback") };
        assert_eq!(numbers(&feedback), [7]);
        let (status, result) = (GoalStatusEnum::Succeeded, Sequence { sequence: vec![7, 8] });
        server.send_result(asked, GetResultResponse { status, result }).unwrap();
        let (_, GoalUpdate::Ended { outcome, result: Some(result), .. }) = client.next(|| ())
        else {
            panic!("no end")
        };
        assert_eq!((outcome, numbers(&result)), (GoalOutcome::Succeeded, vec![7, 8]));
    }
}
