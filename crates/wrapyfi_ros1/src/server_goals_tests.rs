//! Tests of the goals of an action that this node offers.

use super::*;

const SECOND: Duration = Duration::from_secs(1);

fn at(secs: u32) -> RosTime {
    RosTime { secs, nsecs: 0 }
}

fn id(secs: u32, id: &str) -> StampedId {
    StampedId { stamp: at(secs), id: GoalId(id.into()) }
}

/// Goals `a`, `b` and `c`, with stamps 1, 2 and 3.
fn three(now: Instant) -> (ServerGoals, [GoalNumber; 3]) {
    let mut goals = ServerGoals::new(256);
    let numbers = [(1, "a"), (2, "b"), (3, "c")].map(|(secs, name)| {
        match goals.arrive(id(secs, name), now) {
            Arrived::Pending(number) => number,
            other => panic!("{other:?}"),
        }
    });
    (goals, numbers)
}

#[test]
fn a_cancel_is_of_one_goal_of_those_up_to_a_stamp_or_of_all() {
    let now = Instant::now();
    let (mut goals, [a, b, c]) = three(now);
    assert_eq!(goals.cancel(&id(0, "b"), now), [b]);
    assert_eq!(goals.cancel(&id(2, ""), now), [a], "b was asked for before");
    assert_eq!(goals.cancel(&id(0, ""), now), [c]);
    let (mut goals, [a, _, c]) = three(now);
    assert_eq!(goals.cancel(&id(1, "c"), now), [a, c], "up to the stamp, and that goal");
}

/// The wishes to cancel one goal are one until it is answered.
#[test]
fn a_flood_of_cancels_is_one_wish_and_a_refusal_lets_the_next_through() {
    let now = Instant::now();
    let (mut goals, [a, ..]) = three(now);
    goals.go_on(a, false);
    let asked: usize = (0..10_000).map(|_| goals.cancel(&id(0, "a"), now).len()).sum();
    assert_eq!(asked, 1);
    goals.refuse_cancel(a);
    assert_eq!(goals.get(a).unwrap().state, GoalState::Active);
    assert_eq!(goals.cancel(&id(0, "a"), now), [a]);
}

#[test]
fn a_cancel_may_come_before_its_goal() {
    let now = Instant::now();
    let mut goals = ServerGoals::new(1);
    assert_eq!(goals.cancel(&id(0, "a"), now), []);
    assert_eq!(goals.goals().next().unwrap().state, GoalState::Recalling);
    let Arrived::Recalled(number) = goals.arrive(id(1, "a"), now + SECOND) else { panic!() };
    assert_eq!(goals.get(number).unwrap().state, GoalState::Recalled);
    goals.forget(now + 5 * SECOND);
    assert_eq!(goals.goals().len(), 1, "its own five seconds");
    assert_eq!(goals.arrive(id(1, "a"), now + 5 * SECOND), Arrived::Known);
    goals.forget(now + 6 * SECOND);
    assert_eq!(goals.goals().len(), 0);
}

#[test]
fn a_goal_that_is_not_newer_than_the_last_cancel_is_recalled() {
    let now = Instant::now();
    let (mut goals, _) = three(now);
    goals.cancel(&id(7, ""), now);
    assert!(matches!(goals.arrive(id(7, "old"), now), Arrived::Recalled(_)));
    assert!(matches!(goals.arrive(id(0, "unstamped"), now), Arrived::Pending(_)));
    assert!(matches!(goals.arrive(id(8, "new"), now), Arrived::Pending(_)));
}

/// Bags that are played again repeat the ids of goals.
#[test]
fn an_id_that_repeats_is_no_new_goal() {
    let now = Instant::now();
    let (mut goals, [a, ..]) = three(now);
    assert_eq!(goals.arrive(id(1, "a"), now), Arrived::Known);
    goals.end(a, GoalState::Succeeded, "", now);
    assert_eq!(goals.arrive(id(1, "a"), now), Arrived::Known);
    goals.forget(now + 5 * SECOND);
    assert!(matches!(goals.arrive(id(1, "a"), now), Arrived::Pending(_)));
}

#[test]
fn states_are_those_of_actionlib() {
    let now = Instant::now();
    let canceled = Some(GoalOutcome::Canceled);
    let (mut goals, [a, b, c]) = three(now);
    assert_eq!(goals.end_state(a, None), Some(GoalState::Rejected));
    assert_eq!(goals.end_state(a, canceled), Some(GoalState::Recalled));
    assert!(goals.go_on(a, true));
    assert_eq!(goals.get(a).unwrap().state, GoalState::Recalling, "it was never active");
    assert_eq!(goals.end_state(a, canceled), Some(GoalState::Recalled));
    assert!(goals.go_on(a, false));
    assert_eq!(goals.get(a).unwrap().state, GoalState::Preempting);
    assert!(goals.go_on(b, false));
    assert!(!goals.go_on(b, false));
    assert_eq!(goals.end_state(b, None), Some(GoalState::Aborted), "too late to reject");
    assert!(goals.go_on(b, true));
    assert!(!goals.go_on(b, false), "no state goes back");
    assert_eq!(goals.end_state(b, canceled), Some(GoalState::Preempted));
    goals.end(c, GoalState::Aborted, "", now);
    assert_eq!(goals.end_state(c, canceled), None, "a goal ends once");
    assert!(!goals.go_on(c, true));
}

/// Goals that have ended count no more, and are freed.
#[test]
fn the_limit_is_of_goals_under_way() {
    let now = Instant::now();
    let mut goals = ServerGoals::new(2);
    for round in 0..100 {
        let first = goals.arrive(id(0, &format!("{round}a")), now);
        let second = goals.arrive(id(0, &format!("{round}b")), now);
        let (Arrived::Pending(first), Arrived::Pending(second)) = (first, second) else {
            panic!("round {round}");
        };
        let third = goals.arrive(id(0, &format!("{round}c")), now);
        let Arrived::TooMany(third) = third else { panic!("{third:?}") };
        assert_eq!(goals.get(third).unwrap().state, GoalState::Rejected);
        goals.end(first, GoalState::Succeeded, "", now);
        goals.end(second, GoalState::Succeeded, "", now);
    }
    goals.forget(now + 5 * SECOND);
    assert_eq!((goals.goals().len(), goals.numbers.len(), goals.over.len()), (0, 0, 0));
}

#[test]
fn what_is_kept_is_bounded() {
    let now = Instant::now();
    let mut goals = ServerGoals::new(1);
    for number in 0..MAX_KEPT + 100 {
        goals.cancel(&id(0, &number.to_string()), now);
    }
    assert_eq!((goals.goals().len(), goals.numbers.len()), (MAX_KEPT, MAX_KEPT));
    assert!(matches!(goals.arrive(id(0, "a"), now), Arrived::Pending(_)));
}
