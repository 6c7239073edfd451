//! The client of an action as one of a function.
//!
//! ```text
//!   call ─▶ goal               succeeded ─▶ reply
//!   dropped, time-out ─▶ cancel    rejected, aborted, canceled ─▶ error
//!                              feedback ─▶ the call's Feedback
//! ```
//!
//! The library's thread takes the updates, so that feedback goes on and a goal is cancelled whatever its caller does.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::feedback::Feedback;
use super::runtime::Watched;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::types::{Payload, Stamp, Value};
use wrapyfi_endpoint::calls::{Calls, Stage};
use wrapyfi_endpoint::{
    ActionClient, CallError, Client, Clock, Context, GoalEvent, GoalOutcome, GoalUpdate, Link,
    Mutex, Reply, Request, Ticket, Wake,
};

/// Longest time for which a client that is closed waits for servers to hear that goals are cancelled.
const LINGER: Duration = Duration::from_secs(1);
/// Time between two looks meanwhile.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Goals of one method, shared by its client and the library's thread.
pub(super) struct GoalCalls {
    state: Mutex<GoalCallsState>,
    context: Context,
}

struct GoalCallsState {
    client: Box<dyn ActionClient>,
    conversion: Conversion,
    calls: Calls<(Request, Feedback)>,
    goals: BTreeMap<Ticket, SentGoal>,
    /// Number of the next goal that is sent.
    next: i64,
    /// Feedback of the next call.
    feedback: Feedback,
}

/// A goal that has not ended.
struct SentGoal {
    sequence: i64,
    feedback: Feedback,
    is_cancelled: bool,
}

impl GoalCalls {
    /// Calls of `action` by `client`, at most `limit` at once, whose callers wait for the bell of `context`.
    pub(super) fn new(
        client: Box<dyn ActionClient>,
        action: &str,
        limit: usize,
        conversion: Conversion,
        context: &Context,
    ) -> Arc<Self> {
        // The client counts what it receives.
        let own = Context { counters: Arc::default(), ..context.clone() };
        let state = Mutex::new(GoalCallsState {
            client,
            conversion,
            calls: Calls::new(action, limit, &own),
            goals: BTreeMap::new(),
            next: 0,
            feedback: Feedback::default(),
        });
        Arc::new(Self { state, context: context.clone() })
    }

    /// Sets the feedback of the next call.
    pub(super) fn set_feedback(&self, feedback: Option<&Feedback>) {
        self.state.lock().feedback = feedback.cloned().unwrap_or_default();
    }

    /// Moves everything on and rings when a call has ended.
    fn with<T>(&self, with: impl FnOnce(&mut GoalCallsState, Instant) -> T) -> T {
        let mut state = self.state.lock();
        let now = self.context.clock.now();
        let result = with(&mut state, now);
        let has_ended = state.step(now, &self.context);
        drop(state);
        if has_ended {
            self.context.wake.ring();
        }
        result
    }
}

impl GoalCallsState {
    /// True when a call has ended.
    fn step(&mut self, now: Instant, context: &Context) -> bool {
        let mut has_ended = false;
        if self.calls.deadline().is_some_and(|at| at <= now) {
            let missing = self.client.link().waiting_for;
            self.calls.expire(now, |stage| match (stage, &missing) {
                (Stage::Waiting, Some(what)) => format!("still waiting for {what}"),
                (Stage::Waiting, None) => "no server of it was there".to_owned(),
                (Stage::Sent, _) => "its goal was under way, and is cancelled".to_owned(),
            });
            has_ended = true;
        }
        for (ticket, goal) in &mut self.goals {
            // Its caller has gone or its time is over.
            if !goal.is_cancelled && !self.calls.is_sent(goal.sequence) {
                goal.is_cancelled = true;
                self.client.cancel(*ticket);
            }
        }
        while self.calls.next_to_send().is_some() && self.client.link().has_peers() {
            let sequence = self.next;
            self.next += 1;
            let Some((request, feedback)) = self.calls.send(sequence) else { break };
            match self.client.send(&request) {
                Ok(ticket) => {
                    self.goals.insert(ticket, SentGoal { sequence, feedback, is_cancelled: false });
                }
                Err(error) => {
                    self.calls.failed(sequence, error);
                    has_ended = true;
                }
            }
        }
        while let Some((ticket, update)) = self.client.take() {
            if let Some(event) = update.event() {
                context.counters.goal_event(event);
            }
            has_ended |= update.is_end();
            self.hear(ticket, update, now);
        }
        has_ended
    }

    fn hear(&mut self, ticket: Ticket, update: GoalUpdate, now: Instant) {
        let Some(SentGoal { sequence, feedback, is_cancelled }) = self.goals.get(&ticket) else {
            return;
        };
        let sequence = *sequence;
        let (how, reason) = match update {
            GoalUpdate::Accepted | GoalUpdate::Executing => return,
            GoalUpdate::Feedback(payload) => {
                if let Err(error) = self.forward(payload, feedback) {
                    tracing::debug!("{}: {error}", self.calls.service());
                }
                return;
            }
            GoalUpdate::Canceling | GoalUpdate::CancelRefused(_) => {
                if *is_cancelled {
                    self.goals.remove(&ticket);
                }
                return;
            }
            GoalUpdate::Ended { outcome: GoalOutcome::Succeeded, result, .. } => {
                let result = result.unwrap_or_else(|| Value::Null.into());
                self.goals.remove(&ticket);
                self.calls.answered(sequence, 0, now, || Ok(result));
                return;
            }
            GoalUpdate::Rejected(text) => (GoalEvent::Rejected, text),
            GoalUpdate::Ended { outcome: GoalOutcome::Canceled, text, .. } => {
                (GoalEvent::Canceled, text)
            }
            GoalUpdate::Ended { outcome: GoalOutcome::Aborted, text, .. } => {
                (GoalEvent::Aborted, text)
            }
        };
        let service = self.calls.service().to_owned();
        self.goals.remove(&ticket);
        self.calls.failed(sequence, CallError::NotReached { service, how, reason });
    }

    fn forward(
        &self,
        payload: Payload,
        feedback: &Feedback,
    ) -> Result<(), Box<dyn std::error::Error>> {
        if let Payload::NativeObject(object) = self.conversion.convert(payload, Stamp::now)? {
            feedback.send(&object.value)?;
        }
        Ok(())
    }
}

impl Watched for GoalCalls {
    fn look(&self, _: Instant) -> Option<Instant> {
        self.with(|state, _| {
            state.client.deadline().into_iter().chain(state.calls.deadline()).min()
        })
    }
}

/// The client of [`GoalCalls`].
pub(super) struct GoalClient(pub(super) Arc<GoalCalls>);

impl Client for GoalClient {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        self.0.with(|state, now| {
            let goal = (request.clone(), std::mem::take(&mut state.feedback));
            state.calls.begin((goal, request.size_hint()), now, timeout)
        })
    }

    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        self.0.with(|state, _| state.calls.take())
    }

    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        self.0.with(|state, _| state.calls.take_only(ticket))
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.0.with(|state, _| state.calls.cancel(ticket));
    }

    fn deadline(&self) -> Option<Instant> {
        let state = self.0.state.lock();
        state.client.deadline().into_iter().chain(state.calls.deadline()).min()
    }

    fn link(&self) -> Link {
        self.0.state.lock().client.link()
    }

    fn wake(&self) -> &Wake {
        &self.0.context.wake
    }

    fn clock(&self) -> &Clock {
        &self.0.context.clock
    }
}

/// Goals that were cancelled are given up by their servers, not by the client alone.
impl Drop for GoalClient {
    fn drop(&mut self) {
        let end = Instant::now() + LINGER;
        let is_unheard =
            |state: &mut GoalCallsState, _| state.goals.values().any(|goal| goal.is_cancelled);
        while self.0.with(is_unheard) && Instant::now() < end {
            std::thread::sleep(LOOK_EVERY);
        }
    }
}
