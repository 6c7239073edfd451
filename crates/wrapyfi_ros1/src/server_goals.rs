//! Goals that an action of this node has: their states as actionlib's clients see them, without sockets.
//!
//! ```text
//!   goal ─▶ PENDING ─┬▶ ACTIVE ──▶ SUCCEEDED, ABORTED         kept for 5 s after the end
//!                    │    └▶ PREEMPTING ──▶ PREEMPTED, …
//!                    ├▶ RECALLING ──▶ RECALLED, …
//!                    └▶ REJECTED
//!   cancel before its goal ─▶ RECALLING, kept for 5 s
//! ```

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use super::action_messages::{GoalId, GoalState, RosTime, StampedId};
use wrapyfi_endpoint::{GoalNumber, GoalOutcome};

/// Time for which a goal that has ended is in status arrays.
const KEPT: Duration = Duration::from_secs(5);
/// Largest number of goals in a status array that have ended: of more the oldest go.
const MAX_KEPT: usize = 10_000;

/// A goal in status arrays.
#[derive(Debug, Clone)]
pub(super) struct Goal {
    pub(super) id: StampedId,
    pub(super) state: GoalState,
    pub(super) text: String,
    /// Time of the end, or of a cancel that came before its goal.
    over_at: Option<Instant>,
    /// Its cancellation waits for an answer.
    is_cancel_asked: bool,
}

/// Fate of a goal that has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Arrived {
    /// It is new, and waits to be accepted.
    Pending(GoalNumber),
    /// It was cancelled before it came.
    Recalled(GoalNumber),
    /// No room is left for it.
    TooMany(GoalNumber),
    /// Its id is that of another goal.
    Known,
}

/// The goals of one server.
#[derive(Debug)]
pub(super) struct ServerGoals {
    goals: BTreeMap<GoalNumber, Goal>,
    numbers: BTreeMap<GoalId, GoalNumber>,
    /// Goals that are over, the oldest first.
    over: VecDeque<(Instant, GoalNumber)>,
    last_cancel: RosTime,
    next: u64,
    /// Largest number of goals under way.
    limit: usize,
}

impl ServerGoals {
    pub(super) fn new(limit: usize) -> Self {
        Self {
            goals: BTreeMap::new(),
            numbers: BTreeMap::new(),
            over: VecDeque::new(),
            last_cancel: RosTime::default(),
            next: 0,
            limit,
        }
    }

    pub(super) fn goals(&self) -> impl ExactSizeIterator<Item = &Goal> {
        self.goals.values()
    }

    pub(super) fn get(&self, number: GoalNumber) -> Option<&Goal> {
        self.goals.get(&number)
    }

    /// Goals under way.
    pub(super) fn under_way(&self) -> Vec<GoalNumber> {
        let mut under_way = self.goals.iter().filter(|(_, goal)| goal.over_at.is_none());
        under_way.by_ref().map(|(number, _)| *number).collect()
    }

    fn enter(&mut self, id: StampedId, state: GoalState) -> GoalNumber {
        self.next += 1;
        let number = GoalNumber(self.next);
        self.numbers.insert(id.id.clone(), number);
        let (text, over_at, is_cancel_asked) = (String::new(), None, false);
        self.goals.insert(number, Goal { id, state, text, over_at, is_cancel_asked });
        number
    }

    /// Takes a goal.
    pub(super) fn arrive(&mut self, id: StampedId, now: Instant) -> Arrived {
        if let Some(number) = self.numbers.get(&id.id).copied() {
            let known = self.goals.get(&number);
            let is_early =
                |goal: &Goal| goal.state == GoalState::Recalling && goal.over_at.is_some();
            if !known.is_some_and(is_early) {
                return Arrived::Known;
            }
            self.end(number, GoalState::Recalled, "it was cancelled before it came", now);
            return Arrived::Recalled(number);
        }
        let is_before_cancel = !id.stamp.is_zero() && id.stamp <= self.last_cancel;
        let is_full = self.goals.len().saturating_sub(self.over.len()) >= self.limit;
        let number = self.enter(id, GoalState::Pending);
        if is_before_cancel {
            let text = "its stamp is not after that of the last cancel";
            self.end(number, GoalState::Recalled, text, now);
            Arrived::Recalled(number)
        } else if is_full {
            let text = format!("{} goals are under way, which is the limit", self.limit);
            self.end(number, GoalState::Rejected, &text, now);
            Arrived::TooMany(number)
        } else {
            Arrived::Pending(number)
        }
    }

    /// Takes a wish to cancel: one goal by its id, those up to a stamp, or all. Gives the goals for which it is news.
    pub(super) fn cancel(&mut self, wanted: &StampedId, now: Instant) -> Vec<GoalNumber> {
        let StampedId { stamp, id } = wanted;
        let named = self.numbers.get(id).copied();
        let meant: Vec<GoalNumber> = if stamp.is_zero() && !id.0.is_empty() {
            named.into_iter().collect()
        } else {
            let is_meant = |(number, goal): &(&GoalNumber, &Goal)| {
                stamp.is_zero() || goal.id.stamp <= *stamp || named == Some(**number)
            };
            self.goals.iter().filter(is_meant).map(|(number, _)| *number).collect()
        };
        let mut asked = Vec::new();
        for number in meant {
            let Some(goal) = self.goals.get_mut(&number) else { continue };
            if matches!(goal.state, GoalState::Pending | GoalState::Active)
                && !std::mem::replace(&mut goal.is_cancel_asked, true)
            {
                asked.push(number);
            }
        }
        if !id.0.is_empty() && named.is_none() {
            let number = self.enter(wanted.clone(), GoalState::Recalling);
            self.keep(number, now);
        }
        self.last_cancel = self.last_cancel.max(*stamp);
        asked
    }

    /// Notes that a goal goes on though it was to be cancelled.
    pub(super) fn refuse_cancel(&mut self, number: GoalNumber) {
        if let Some(goal) = self.goals.get_mut(&number) {
            goal.is_cancel_asked = false;
        }
    }

    /// Passes a goal to ACTIVE, or to PREEMPTING or RECALLING; true where that is news.
    pub(super) fn go_on(&mut self, number: GoalNumber, is_canceling: bool) -> bool {
        let goal = self.goals.get_mut(&number).filter(|goal| goal.over_at.is_none());
        let Some(goal) = goal else { return false };
        let state = match (goal.state, is_canceling) {
            (GoalState::Pending, false) => GoalState::Active,
            (GoalState::Pending, true) => GoalState::Recalling,
            (GoalState::Active, true) | (GoalState::Recalling, false) => GoalState::Preempting,
            _ => return false,
        };
        goal.state = state;
        true
    }

    /// State in which a goal under way ends; `None` outcome is a rejection.
    pub(super) fn end_state(
        &self,
        number: GoalNumber,
        outcome: Option<GoalOutcome>,
    ) -> Option<GoalState> {
        let goal = self.goals.get(&number).filter(|goal| goal.over_at.is_none())?;
        let was_active = matches!(goal.state, GoalState::Active | GoalState::Preempting);
        Some(match outcome {
            None if !was_active => GoalState::Rejected,
            Some(GoalOutcome::Succeeded) => GoalState::Succeeded,
            Some(GoalOutcome::Canceled) if was_active => GoalState::Preempted,
            Some(GoalOutcome::Canceled) => GoalState::Recalled,
            Some(GoalOutcome::Aborted) | None => GoalState::Aborted,
        })
    }

    /// Ends a goal.
    pub(super) fn end(&mut self, number: GoalNumber, state: GoalState, text: &str, now: Instant) {
        if let Some(goal) = self.goals.get_mut(&number) {
            (goal.state, goal.text) = (state, text.to_owned());
            self.keep(number, now);
        }
    }

    /// Keeps a goal that is over for a while.
    fn keep(&mut self, number: GoalNumber, now: Instant) {
        let Some(goal) = self.goals.get_mut(&number) else { return };
        if goal.over_at.replace(now).is_some() {
            self.over.retain(|(_, over)| *over != number);
        }
        self.over.push_back((now, number));
        while self.over.len() > MAX_KEPT {
            self.forget_oldest();
        }
    }

    fn forget_oldest(&mut self) {
        let Some((_, number)) = self.over.pop_front() else { return };
        if let Some(goal) = self.goals.remove(&number) {
            self.numbers.remove(&goal.id.id);
        }
    }

    /// Forgets what was kept for long enough.
    pub(super) fn forget(&mut self, now: Instant) {
        let is_old = |at: &Instant| now.saturating_duration_since(*at) >= KEPT;
        while self.over.front().is_some_and(|(at, _)| is_old(at)) {
            self.forget_oldest();
        }
    }
}

#[cfg(test)]
#[path = "server_goals_tests.rs"]
mod tests;
