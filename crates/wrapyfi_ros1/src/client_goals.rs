//! Goals that this node has sent to an actionlib server: what their states there mean, without sockets.
//!
//! ```text
//!   begin ─▶ accepted          ACTIVE ─▶ executing      PREEMPTING, RECALLING ─▶ canceling
//!   status array without a goal that was in one ─▶ aborted
//!   an end in a status array ─▶ waits for the result ─▶ ended
//!   the result of a goal that was given up ─▶ waits for status arrays: had another client cancelled it? ─▶ ended
//! ```
//!
//! States are seen five times a second, so some are skipped: those that must stand before an end are given first.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use super::action_messages::{GoalId, GoalState, GoalStatus, Statuses, shown};
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{GoalOutcome, GoalUpdate, Ticket};

/// Time within which a server that gives a goal up says that it is about to.
const CANCELING_WITHIN: Duration = Duration::from_secs(5);
/// Time within which the result follows a status that is an end, or the status a result.
const RESULT_WITHIN: Duration = Duration::from_secs(5);
/// Time within which a server that publishes status arrays has the goal in one.
const TAKEN_WITHIN: Duration = Duration::from_secs(5);

/// State of a goal as its client was told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Told {
    Accepted,
    Executing,
    Canceling,
}

#[derive(Debug)]
struct Goal {
    ticket: Ticket,
    told: Told,
    sent_at: Instant,
    /// A status array had it.
    is_known: bool,
    /// Its client wants it to end.
    is_canceled: bool,
    /// Time at which the wish counts as refused.
    refused_at: Option<Instant>,
    end: Option<End>,
}

/// End of which a half has come.
#[derive(Debug)]
struct End {
    state: GoalState,
    text: String,
    /// `None` where a status array told the end, and the result is waited for. Where the server gave the goal up unasked,
    /// status arrays are: those until its end tell whether another client had cancelled it, and they come on another
    /// connection.
    result: Option<Payload>,
    /// Time until which the other half is waited for.
    until: Instant,
}

/// The goals under way of one client.
#[derive(Debug, Default)]
pub(super) struct ClientGoals {
    goals: BTreeMap<GoalId, Goal>,
    ids: BTreeMap<Ticket, GoalId>,
    updates: VecDeque<(Ticket, GoalUpdate)>,
    /// A goal that was given up for a newer one counts as cancelled, not as aborted.
    preempted_is_canceled: bool,
}

impl ClientGoals {
    /// No goals yet; one that is given up for a newer one counts as cancelled or as aborted.
    pub(super) fn new(preempted_is_canceled: bool) -> Self {
        Self { preempted_is_canceled, ..Self::default() }
    }

    /// Goals under way.
    pub(super) fn len(&self) -> usize {
        self.goals.len()
    }

    pub(super) fn has(&self, id: &GoalId) -> bool {
        self.goals.contains_key(id)
    }

    /// Enters a goal that was sent. It counts as accepted, because its server is there.
    pub(super) fn begin(&mut self, ticket: Ticket, id: GoalId, now: Instant) {
        let goal = Goal {
            ticket,
            told: Told::Accepted,
            sent_at: now,
            is_known: false,
            is_canceled: false,
            refused_at: None,
            end: None,
        };
        self.ids.insert(ticket, id.clone());
        self.goals.insert(id, goal);
        self.updates.push_back((ticket, GoalUpdate::Accepted));
    }

    /// Ends a goal that could not be sent.
    pub(super) fn reject(&mut self, ticket: Ticket, reason: String) {
        self.updates.push_back((ticket, GoalUpdate::Rejected(reason)));
    }

    /// Notes that a goal is to end; its id, where the server must be asked.
    pub(super) fn cancel(&mut self, ticket: Ticket, now: Instant) -> Option<GoalId> {
        let id = self.ids.get(&ticket)?;
        let goal = self.goals.get_mut(id).filter(|goal| goal.end.is_none())?;
        goal.is_canceled = true;
        match goal.told {
            // It is asked for again, and so is the answer.
            Told::Canceling => self.updates.push_back((ticket, GoalUpdate::Canceling)),
            _ => _ = goal.refused_at.get_or_insert(now + CANCELING_WITHIN),
        }
        Some(id.clone())
    }

    /// Notes that the server was asked to give up all goals.
    pub(super) fn cancel_all(&mut self) {
        self.goals.values_mut().for_each(|goal| goal.is_canceled = true);
    }

    /// Takes the states of all goals that the server has. Gives those whose cancellation came before the server knew
    /// them: it is asked again, lest it has forgotten.
    pub(super) fn statuses(&mut self, statuses: &Statuses<'_>, now: Instant) -> Vec<GoalId> {
        let Self { goals, updates, .. } = self;
        let (mut again, mut lost, mut given_up) = (Vec::new(), Vec::new(), Vec::new());
        let is_given_up = |end: &mut End| end.result.is_some();
        for (id, goal) in goals {
            let Some((state, text)) = statuses.get(&id.0[..]) else {
                let is_late = now.saturating_duration_since(goal.sent_at) >= TAKEN_WITHIN;
                if let Some(end) = goal.end.take_if(is_given_up) {
                    given_up.push((id.clone(), end));
                } else if goal.end.is_none() && (goal.is_known || is_late) {
                    lost.push(id.clone());
                }
                continue;
            };
            let is_new = !std::mem::replace(&mut goal.is_known, true);
            if is_new && goal.is_canceled && matches!(state, GoalState::Pending | GoalState::Active)
            {
                again.push(id.clone());
            }
            if state.is_end() {
                match goal.end.take_if(is_given_up) {
                    Some(end) => given_up.push((id.clone(), end)),
                    None => {
                        let (state, text, until) = (*state, shown(text), now + RESULT_WITHIN);
                        goal.end.get_or_insert(End { state, text, result: None, until });
                    }
                }
            } else {
                goal.go_on(*state, updates);
            }
        }
        for (id, End { state, text, result, .. }) in given_up {
            self.end(&id, state, text, result);
        }
        for id in lost {
            self.end(&id, GoalState::Lost, "the server has lost the goal".to_owned(), None);
        }
        again
    }

    /// Takes feedback of a goal.
    pub(super) fn feedback(&mut self, status: &GoalStatus, feedback: Payload) {
        let Some(goal) = self.goals.get_mut(&status.goal.id) else { return };
        goal.go_on(status.state, &mut self.updates);
        self.updates.push_back((goal.ticket, GoalUpdate::Feedback(feedback)));
    }

    /// Ends a goal by its result; `Err` has the fault of one that cannot be read.
    pub(super) fn result(
        &mut self,
        status: GoalStatus,
        result: Result<Payload, String>,
        now: Instant,
    ) {
        let GoalStatus { goal, state, text } = status;
        let is_given_up = matches!(state, GoalState::Preempted | GoalState::Recalled)
            && !self.preempted_is_canceled;
        match (self.goals.get_mut(&goal.id), result) {
            (Some(one), Ok(result))
                if is_given_up
                    && one.end.is_none()
                    && !one.is_canceled
                    && one.told != Told::Canceling =>
            {
                let (result, until) = (Some(result), now + RESULT_WITHIN);
                one.end = Some(End { state, text, result, until });
            }
            (_, Ok(result)) => self.end(&goal.id, state, text, Some(result)),
            (_, Err(fault)) => self.end(&goal.id, GoalState::Lost, fault, None),
        }
    }

    /// Ends all goals: their server has gone.
    pub(super) fn lose_all(&mut self, reason: &str) {
        for id in self.goals.keys().cloned().collect::<Vec<_>>() {
            match self.goals.get_mut(&id).and_then(|goal| goal.end.take()) {
                Some(End { state, text, result: Some(result), .. }) => {
                    self.end(&id, state, text, Some(result));
                }
                _ => self.end(&id, GoalState::Lost, reason.to_owned(), None),
            }
        }
    }

    /// Looks at the time.
    pub(super) fn look(&mut self, now: Instant) {
        let mut late = Vec::new();
        for (id, goal) in &mut self.goals {
            if let Some(end) = goal.end.take_if(|end| now >= end.until) {
                late.push((id.clone(), end));
            } else if goal.end.is_none() && goal.refused_at.take_if(|at| now >= *at).is_some() {
                let seconds = CANCELING_WITHIN.as_secs();
                let text = format!("the server has not begun to within {seconds} s");
                self.updates.push_back((goal.ticket, GoalUpdate::CancelRefused(text)));
            }
        }
        for (id, End { state, text, result, .. }) in late {
            tracing::debug!("ROS 1: the other half of the end of goal {id} has not come");
            self.end(&id, state, text, result);
        }
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        let due = |goal: &Goal| goal.end.as_ref().map(|end| end.until).or(goal.refused_at);
        self.goals.values().filter_map(due).min()
    }

    pub(super) fn take(&mut self) -> Option<(Ticket, GoalUpdate)> {
        self.updates.pop_front()
    }

    fn end(&mut self, id: &GoalId, state: GoalState, text: String, result: Option<Payload>) {
        let Some(mut goal) = self.goals.remove(id) else { return };
        self.ids.remove(&goal.ticket);
        let is_wanted =
            goal.is_canceled || goal.told == Told::Canceling || self.preempted_is_canceled;
        let outcome = match state {
            GoalState::Succeeded => GoalOutcome::Succeeded,
            GoalState::Preempted | GoalState::Recalled if is_wanted => GoalOutcome::Canceled,
            _ => GoalOutcome::Aborted,
        };
        let before = match outcome {
            GoalOutcome::Canceled => Told::Canceling,
            GoalOutcome::Succeeded | GoalOutcome::Aborted => Told::Executing,
        };
        goal.tell(before, &mut self.updates);
        let text = match state {
            GoalState::Preempted | GoalState::Recalled if !is_wanted && text.is_empty() => {
                "the server gave it up, and nobody had cancelled it".to_owned()
            }
            GoalState::Rejected if text.is_empty() => "the server rejected it".to_owned(),
            _ => text,
        };
        self.updates.push_back((goal.ticket, GoalUpdate::Ended { outcome, result, text }));
    }
}

impl Goal {
    /// Takes a state that is no end.
    fn go_on(&mut self, state: GoalState, updates: &mut VecDeque<(Ticket, GoalUpdate)>) {
        match state {
            GoalState::Active => self.tell(Told::Executing, updates),
            GoalState::Preempting | GoalState::Recalling => self.tell(Told::Canceling, updates),
            _ => {}
        }
    }

    /// Tells the client of a state, unless it knows that or a later one.
    fn tell(&mut self, state: Told, updates: &mut VecDeque<(Ticket, GoalUpdate)>) {
        let update = match (self.told, state) {
            (Told::Accepted, Told::Executing) => GoalUpdate::Executing,
            (Told::Accepted | Told::Executing, Told::Canceling) => {
                self.refused_at = None;
                GoalUpdate::Canceling
            }
            _ => return,
        };
        self.told = state;
        updates.push_back((self.ticket, update));
    }
}

#[cfg(test)]
#[path = "client_goals_tests.rs"]
mod tests;
