//! The server of an action as one of a function.
//!
//! ```text
//!   goal ─▶ accepted ─▶ waiting ── take ─▶ executing ── reply ─▶ succeeded, aborted, canceled
//!   cancel ─────────────▶ canceled           └ is_canceled, where the body has Feedback; else refused
//! ```
//!
//! The library's thread takes goals and wishes to cancel them, so that their clients are answered while the body runs.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use super::feedback::FeedbackError;
use super::runtime::Watched;
use wrapyfi_data::returned::PayloadError;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::codec::requests::{asked_message, returned_message};
use wrapyfi_endpoint::{
    ActionServer, ActionSpec, Context, GoalNumber, GoalOutcome, GoalRequest, GoalUpdate,
    IncomingRequest, Link, Mutex, Refusal, Request, RequestId, ServeError, ServeResult, Server,
};

/// Goals of one method, shared by its server, the feedback of its goals and the library's thread.
pub(super) struct ServedGoals {
    state: Mutex<ServedGoalsState>,
    context: Context,
}

struct ServedGoalsState {
    server: Box<dyn ActionServer>,
    spec: ActionSpec,
    /// True when the body hears that its goal is cancelled.
    has_feedback: bool,
    /// Accepted goals, for which no body runs yet.
    waiting: VecDeque<IncomingRequest>,
    running: BTreeMap<GoalNumber, RunningGoal>,
    /// Last fault of a request.
    fault: Option<ServeError>,
}

/// A goal for which a body runs.
#[derive(Default)]
struct RunningGoal {
    /// True when a client wants its end.
    is_unwanted: bool,
    /// True when the body was told so.
    is_told: bool,
    /// Reason of the body for giving the goal up.
    aborted: Option<String>,
}

impl ServedGoals {
    /// Goals of `server`, whose method waits for the bell of `context`.
    pub(super) fn new(
        server: Box<dyn ActionServer>,
        spec: ActionSpec,
        has_feedback: bool,
        context: &Context,
    ) -> Arc<Self> {
        let state = Mutex::new(ServedGoalsState {
            server,
            spec,
            has_feedback,
            waiting: VecDeque::new(),
            running: BTreeMap::new(),
            fault: None,
        });
        Arc::new(Self { state, context: context.clone() })
    }

    /// Sends feedback of a goal for which a body runs.
    pub(super) fn feedback(
        &self,
        number: GoalNumber,
        payload: &Payload,
    ) -> Result<(), FeedbackError> {
        let mut state = self.state.lock();
        let ServedGoalsState { server, spec, running, .. } = &mut *state;
        if running.contains_key(&number) {
            let message =
                returned_message(payload, spec.kind.feedback(), spec.limits.message_bytes)
                    .map_err(PayloadError::from)?;
            let update = GoalUpdate::Feedback(message.into());
            update.event().into_iter().for_each(|event| self.context.counters.goal_event(event));
            server.update(number, update)?;
        }
        Ok(())
    }

    /// Tells the body whether its goal is to end or has ended.
    pub(super) fn is_canceled(&self, number: GoalNumber) -> bool {
        let mut state = self.state.lock();
        self.step(&mut state);
        state.running.get_mut(&number).is_none_or(|goal| {
            goal.is_told |= goal.is_unwanted;
            goal.is_unwanted
        })
    }

    /// Makes a goal end as aborted, for this reason.
    pub(super) fn abort(&self, number: GoalNumber, reason: String) {
        if let Some(goal) = self.state.lock().running.get_mut(&number) {
            goal.aborted = Some(reason);
        }
    }

    /// Takes goals and wishes to cancel them; true when a method has something to take.
    fn step(&self, state: &mut ServedGoalsState) -> bool {
        let mut is_news = false;
        loop {
            match state.server.take() {
                Ok(None) => return is_news,
                Ok(Some(GoalRequest::Goal { number, goal, wire_bytes })) => {
                    is_news |= self.receive(state, number, &goal, wire_bytes);
                }
                Ok(Some(GoalRequest::Cancel(number))) => self.cancel(state, number),
                // Each goal of this server was asked for before.
                Ok(Some(GoalRequest::CancelAll)) => {}
                // The server has counted the request.
                Err(fault) => {
                    state.fault = Some(fault);
                    is_news = true;
                }
            }
        }
    }

    fn receive(
        &self,
        state: &mut ServedGoalsState,
        number: GoalNumber,
        goal: &Request,
        bytes: usize,
    ) -> bool {
        let ActionSpec { kind, limits, goals, .. } = &state.spec;
        let rejected = match asked_message(goal, kind.goal(), limits.message_bytes) {
            Ok(message) if state.waiting.len() < *goals => {
                self.tell(state, number, GoalUpdate::Accepted);
                state.waiting.push_back(IncomingRequest {
                    id: RequestId(number.0),
                    request: Request::Message(message),
                    wire_bytes: bytes,
                    received_at: self.context.clock.now(),
                });
                return true;
            }
            Ok(_) => format!("{goals} goals wait, which is the limit"),
            Err(error) => error.to_string(),
        };
        self.tell(state, number, GoalUpdate::Rejected(rejected));
        false
    }

    fn cancel(&self, state: &mut ServedGoalsState, number: GoalNumber) {
        if let Some(at) = state.waiting.iter().position(|one| one.id.0 == number.0) {
            state.waiting.remove(at);
            self.tell(state, number, GoalUpdate::Canceling);
            let (outcome, text) = (GoalOutcome::Canceled, String::new());
            self.tell(state, number, GoalUpdate::Ended { outcome, result: None, text });
        } else if let Some(goal) = state.running.get_mut(&number) {
            if !state.has_feedback {
                let text = "the method goes on until it ends: it has no #[feedback] to hear of it";
                self.tell(state, number, GoalUpdate::CancelRefused(text.to_owned()));
            } else if !std::mem::replace(&mut goal.is_unwanted, true) {
                self.tell(state, number, GoalUpdate::Canceling);
            }
        }
    }

    fn tell(&self, state: &mut ServedGoalsState, number: GoalNumber, update: GoalUpdate) {
        if let Err(error) = self.told(state, number, update) {
            tracing::debug!("{}: {error}", state.spec.action);
        }
    }

    fn told(
        &self,
        state: &mut ServedGoalsState,
        number: GoalNumber,
        update: GoalUpdate,
    ) -> ServeResult<usize> {
        if let Some(event) = update.event() {
            self.context.counters.goal_event(event);
        }
        state.server.update(number, update)
    }
}

impl Watched for ServedGoals {
    fn look(&self, _: Instant) -> Option<Instant> {
        let mut state = self.state.lock();
        let (is_news, next) = (self.step(&mut state), state.server.deadline());
        drop(state);
        if is_news {
            self.context.wake.ring();
        }
        next
    }
}

/// The server of [`ServedGoals`].
pub(super) struct GoalServer(pub(super) Arc<ServedGoals>);

impl Server for GoalServer {
    fn take(&mut self) -> ServeResult<Option<IncomingRequest>> {
        let mut state = self.0.state.lock();
        self.0.step(&mut state);
        if let Some(fault) = state.fault.take() {
            return Err(fault);
        }
        let Some(goal) = state.waiting.pop_front() else { return Ok(None) };
        let number = GoalNumber(goal.id.0);
        state.running.insert(number, RunningGoal::default());
        self.0.tell(&mut state, number, GoalUpdate::Executing);
        Ok(Some(goal))
    }

    fn reply(&mut self, id: RequestId, answer: Result<Payload, Refusal>) -> ServeResult<usize> {
        let mut state = self.0.state.lock();
        let number = GoalNumber(id.0);
        let service = state.spec.action.clone();
        let Some(RunningGoal { is_told, aborted, .. }) = state.running.remove(&number) else {
            return Err(ServeError::Ended(service));
        };
        let (kind, most) = (state.spec.kind, state.spec.limits.message_bytes);
        let result = match answer {
            Ok(payload) => returned_message(&payload, kind.result(), most),
            Err(refusal) => {
                return self.0.told(&mut state, number, GoalUpdate::aborted(refusal.text));
            }
        };
        match result {
            Ok(result) => {
                let outcome = match (&aborted, is_told) {
                    (Some(_), _) => GoalOutcome::Aborted,
                    (None, true) => GoalOutcome::Canceled,
                    (None, false) => GoalOutcome::Succeeded,
                };
                let (result, text) = (Some(result.into()), aborted.unwrap_or_default());
                self.0.told(&mut state, number, GoalUpdate::Ended { outcome, result, text })
            }
            Err(fault) => {
                self.0.tell(&mut state, number, GoalUpdate::aborted(fault.to_string()));
                Err(ServeError::Reply { service, fault })
            }
        }
    }

    fn deadline(&self) -> Option<Instant> {
        self.0.state.lock().server.deadline()
    }

    fn link(&self) -> Link {
        self.0.state.lock().server.link()
    }

    /// Number of results that may still be asked for.
    fn kept(&self) -> usize {
        let state = self.0.state.lock();
        state.server.kept().saturating_sub(state.waiting.len() + state.running.len())
    }

    fn flush(&mut self) {
        let mut state = self.0.state.lock();
        self.0.step(&mut state);
    }
}
