//! Tests of goals at an actionlib server: each fault that other bridges had is one of them.

use super::super::action_messages::StampedId;
use super::*;

const SECOND: Duration = Duration::from_secs(1);

/// One goal with ticket 1 and id `a`.
struct Scene {
    goals: ClientGoals,
    now: Instant,
}

impl Scene {
    fn new() -> Self {
        let mut scene = Self { goals: ClientGoals::default(), now: Instant::now() };
        scene.goals.begin(Ticket::new(1), id("a"), scene.now);
        assert_eq!(scene.updates(), [GoalUpdate::Accepted]);
        scene
    }

    /// The server says this state of goal `a` in a status array.
    fn status(&mut self, state: GoalState) -> Vec<GoalUpdate> {
        let statuses = Statuses::from([(&b"a"[..], (state, &b""[..]))]);
        self.goals.statuses(&statuses, self.now);
        self.updates()
    }

    fn result(&mut self, state: GoalState, text: &str) -> Vec<GoalUpdate> {
        let goal = StampedId { id: id("a"), ..StampedId::default() };
        let status = GoalStatus { goal, state, text: text.to_owned() };
        self.goals.result(status, Ok(payload()), self.now);
        self.updates()
    }

    fn cancel(&mut self) {
        assert_eq!(self.goals.cancel(Ticket::new(1), self.now), Some(id("a")));
    }

    fn wait(&mut self, time: Duration) -> Vec<GoalUpdate> {
        self.now += time;
        self.goals.look(self.now);
        self.updates()
    }

    fn updates(&mut self) -> Vec<GoalUpdate> {
        std::iter::from_fn(|| self.goals.take()).map(|(_, update)| update).collect()
    }
}

fn id(text: &str) -> GoalId {
    GoalId(text.into())
}

fn payload() -> Payload {
    wrapyfi_data::types::Value::from(1).into()
}

fn ended(outcome: GoalOutcome, text: &str) -> GoalUpdate {
    GoalUpdate::Ended { outcome, result: Some(payload()), text: text.to_owned() }
}

#[test]
fn states_that_were_skipped_are_given_before_an_end() {
    let mut scene = Scene::new();
    let succeeded = ended(GoalOutcome::Succeeded, "");
    assert_eq!(scene.result(GoalState::Succeeded, ""), [GoalUpdate::Executing, succeeded]);
    assert_eq!(scene.goals.len(), 0);
    assert_eq!(scene.result(GoalState::Succeeded, ""), [], "a goal ends once");
}

#[test]
fn states_are_given_once() {
    let mut scene = Scene::new();
    assert_eq!(scene.status(GoalState::Pending), []);
    assert_eq!(scene.status(GoalState::Active), [GoalUpdate::Executing]);
    assert_eq!(scene.status(GoalState::Active), []);
    assert_eq!(scene.status(GoalState::Preempting), [GoalUpdate::Canceling]);
    assert_eq!(scene.status(GoalState::Active), [], "no state goes back");
    assert_eq!(scene.result(GoalState::Aborted, "no"), [ended(GoalOutcome::Aborted, "no")]);
}

/// (a): a rejection is an end like others.
#[test]
fn a_rejected_goal_is_aborted_and_says_why() {
    let mut scene = Scene::new();
    let aborted = ended(GoalOutcome::Aborted, "no map");
    assert_eq!(scene.result(GoalState::Rejected, "no map"), [GoalUpdate::Executing, aborted]);
}

/// (b): the server is asked again as soon as it knows the goal.
#[test]
fn a_cancel_before_active_is_not_forgotten() {
    let mut scene = Scene::new();
    scene.cancel();
    let pending = Statuses::from([(&b"a"[..], (GoalState::Pending, &b""[..]))]);
    assert_eq!(scene.goals.statuses(&pending, scene.now), [id("a")]);
    assert_eq!(scene.goals.statuses(&pending, scene.now), [], "once");
    let canceled = ended(GoalOutcome::Canceled, "");
    assert_eq!(scene.result(GoalState::Recalled, ""), [GoalUpdate::Canceling, canceled]);
}

/// (c): not every end without success is an abort.
#[test]
fn preempted_after_a_cancel_is_canceled_and_without_one_aborted() {
    let mut scene = Scene::new();
    scene.status(GoalState::Active);
    scene.cancel();
    let canceled = ended(GoalOutcome::Canceled, "");
    assert_eq!(scene.result(GoalState::Preempted, ""), [GoalUpdate::Canceling, canceled]);
    let mut scene = Scene::new();
    scene.status(GoalState::Active);
    let newer = "the server gave it up, and nobody had cancelled it";
    assert_eq!(scene.result(GoalState::Preempted, ""), [], "another client may have cancelled it");
    assert_eq!(scene.status(GoalState::Active), [], "what came before its end");
    assert_eq!(scene.status(GoalState::Preempted), [ended(GoalOutcome::Aborted, newer)]);
    let mut scene = Scene::new();
    scene.goals.preempted_is_canceled = true;
    let canceled = ended(GoalOutcome::Canceled, "");
    assert_eq!(scene.result(GoalState::Preempted, ""), [GoalUpdate::Canceling, canceled]);
    // Another client has cancelled it.
    let mut scene = Scene::new();
    scene.status(GoalState::Preempting);
    let canceled = ended(GoalOutcome::Canceled, "");
    assert_eq!(scene.result(GoalState::Preempted, ""), [canceled]);
    // The same, where the result overtakes the status arrays.
    let mut scene = Scene::new();
    assert_eq!(scene.result(GoalState::Preempted, ""), []);
    assert_eq!(scene.status(GoalState::Preempting), [GoalUpdate::Canceling]);
    let canceled = ended(GoalOutcome::Canceled, "");
    assert_eq!(scene.status(GoalState::Preempted), [canceled]);
    // The server forgets it, or goes, before an array has its end.
    for gone in [|goals: &mut ClientGoals| goals.lose_all("gone"), forget] {
        let mut scene = Scene::new();
        assert_eq!(scene.status(GoalState::Active), [GoalUpdate::Executing]);
        assert_eq!(scene.result(GoalState::Preempted, "newer"), []);
        gone(&mut scene.goals);
        assert_eq!(scene.updates(), [ended(GoalOutcome::Aborted, "newer")]);
    }
}

/// A SimpleActionServer in C++ recalls a goal that waits when a newer one comes: nobody has cancelled it. One with a stamp
/// that is not after that of a client's cancel is recalled, too, and nothing tells the two apart.
#[test]
fn recalled_with_no_cancel_asked_is_aborted() {
    let mut scene = Scene::new();
    assert_eq!(scene.status(GoalState::Pending), []);
    assert_eq!(scene.result(GoalState::Recalled, ""), [], "another client may have cancelled it");
    let nobody = ended(GoalOutcome::Aborted, "the server gave it up, and nobody had cancelled it");
    assert_eq!(scene.status(GoalState::Recalled), [GoalUpdate::Executing, nobody]);
    let mut scene = Scene::new();
    assert_eq!(scene.result(GoalState::Recalled, "newer"), []);
    assert_eq!(scene.status(GoalState::Recalling), [GoalUpdate::Canceling]);
    let canceled = ended(GoalOutcome::Canceled, "newer");
    assert_eq!(scene.status(GoalState::Recalled), [canceled], "another client had");
    let mut scene = Scene::new();
    scene.goals.preempted_is_canceled = true;
    let canceled = ended(GoalOutcome::Canceled, "");
    assert_eq!(scene.result(GoalState::Recalled, ""), [GoalUpdate::Canceling, canceled]);
}

/// A server whose status arrays stop must not keep the end from its client.
#[test]
fn a_result_that_overtakes_its_status_waits_for_it_but_not_for_ever() {
    let mut scene = Scene::new();
    scene.status(GoalState::Active);
    assert_eq!(scene.result(GoalState::Preempted, "newer"), []);
    assert_eq!(scene.goals.deadline(), Some(scene.now + 5 * SECOND));
    assert_eq!(scene.goals.cancel(Ticket::new(1), scene.now), None, "it has ended");
    assert_eq!(scene.wait(4 * SECOND), []);
    assert_eq!(scene.wait(SECOND), [ended(GoalOutcome::Aborted, "newer")]);
    assert_eq!((scene.goals.len(), scene.goals.deadline()), (0, None));
}

/// A status array without goals.
fn forget(goals: &mut ClientGoals) {
    goals.statuses(&Statuses::new(), Instant::now());
}

/// (d): RECALLING is no end.
#[test]
fn a_goal_that_is_recalled_ends_with_its_result() {
    let mut scene = Scene::new();
    scene.cancel();
    assert_eq!(scene.status(GoalState::Recalling), [GoalUpdate::Canceling]);
    assert_eq!(scene.wait(60 * SECOND), [], "its server takes its time");
    assert_eq!(scene.result(GoalState::Recalled, ""), [ended(GoalOutcome::Canceled, "")]);
}

/// (e): there is no result, and nothing that stands for one.
#[test]
fn a_goal_that_is_missing_from_a_status_array_is_lost() {
    let mut scene = Scene::new();
    scene.goals.statuses(&Statuses::new(), scene.now);
    assert_eq!(scene.updates(), [], "the server may not have it yet");
    scene.status(GoalState::Active);
    scene.goals.statuses(&Statuses::new(), scene.now);
    assert_eq!(scene.updates(), [GoalUpdate::aborted("the server has lost the goal")]);
    let mut scene = Scene::new();
    scene.now += 5 * SECOND;
    scene.goals.statuses(&Statuses::new(), scene.now);
    let lost = GoalUpdate::aborted("the server has lost the goal");
    assert_eq!(scene.updates(), [GoalUpdate::Executing, lost]);
}

/// (g): a server that ignores a cancel has refused it, and may cancel later.
#[test]
fn a_server_that_goes_on_has_refused_to_cancel() {
    let mut scene = Scene::new();
    scene.status(GoalState::Active);
    scene.cancel();
    assert_eq!(scene.goals.deadline(), Some(scene.now + 5 * SECOND));
    assert_eq!(scene.wait(4 * SECOND), []);
    let updates = scene.wait(SECOND);
    assert!(matches!(&updates[..], [GoalUpdate::CancelRefused(_)]), "{updates:?}");
    assert_eq!(scene.wait(60 * SECOND), [], "once");
    assert_eq!(scene.status(GoalState::Preempting), [GoalUpdate::Canceling]);
}

#[test]
fn an_end_waits_for_its_result_but_not_for_ever() {
    let mut scene = Scene::new();
    assert_eq!(scene.status(GoalState::Succeeded), []);
    scene.goals.statuses(&Statuses::new(), scene.now);
    assert_eq!(scene.updates(), [], "it is not lost");
    let succeeded =
        GoalUpdate::Ended { outcome: GoalOutcome::Succeeded, result: None, text: String::new() };
    assert_eq!(scene.wait(5 * SECOND), [GoalUpdate::Executing, succeeded]);
}

#[test]
fn a_server_that_goes_ends_its_goals() {
    let mut scene = Scene::new();
    scene.goals.begin(Ticket::new(2), id("b"), scene.now);
    scene.goals.lose_all("gone");
    let ends = scene.updates().iter().filter(|update| update.is_end()).count();
    assert_eq!((ends, scene.goals.len(), scene.goals.ids.len()), (2, 0, 0));
}

#[test]
fn a_result_that_cannot_be_read_ends_the_goal() {
    let mut scene = Scene::new();
    let goal = StampedId { id: id("a"), ..StampedId::default() };
    let status = GoalStatus { goal, state: GoalState::Succeeded, text: String::new() };
    scene.goals.result(status, Err("too short".to_owned()), scene.now);
    assert_eq!(scene.updates(), [GoalUpdate::Executing, GoalUpdate::aborted("too short")]);
}
