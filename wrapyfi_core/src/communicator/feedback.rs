//! Feedback of goals: what the body of an action tells while it runs, and the caller hears.
//!
//! ```text
//!   mode reply      body ── send ─▶ Feedback ─▶ ServedGoals ─▶ client elsewhere
//!                        ◀─ is_canceled ─┘
//!   mode request    server elsewhere ─▶ GoalCalls ─▶ Feedback ─▶ FeedbackReceiver
//! ```

use std::fmt;
use std::future::poll_fn;
use std::sync::{Arc, Weak};
use std::task::Poll;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::goal_server::ServedGoals;
use wrapyfi_data::returned::PayloadError;
use wrapyfi_data::types::{Value, to_value};
use wrapyfi_endpoint::{
    self as endpoint, Context, GoalNumber, Overflow, QueueSpec, ServeError, Waits, calls::ends,
};

/// Largest number of messages that wait at a receiver.
const DEPTH: usize = 64;

/// Error of sending feedback.
///
/// See [`Feedback::send`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FeedbackError {
    /// The value has no form as feedback of the action.
    #[error("the value is no feedback of the action: {0}")]
    Unfit(#[from] PayloadError),
    /// The feedback was not sent.
    #[error(transparent)]
    Serve(#[from] ServeError),
}

/// The way of the feedback of one goal: the argument `#[feedback]` of a method that is an action.
///
/// A body sends through it what its caller hears. In mode `request` the caller makes a pair by [`Feedback::channel`],
/// or passes `&Feedback::default()`, which nobody hears.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, Feedback, Mode, communicator};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{Map, Value};
/// # use wrapyfi_interfaces::{parser::{Dialect, TypeName}, store::TypeStore};
/// # let mut types = TypeStore::generated();
/// # let name = TypeName::parse(Dialect::Ros2, "demo/action/Count")?;
/// # types.add_definition(&name, "int32 to\n---\nint32 reached\n---\nint32 at\n")?;
///
/// struct Counter;
/// #[communicator]
/// impl Counter {
///     #[register(Action, "$mware", "/count", action_type = "demo/action/Count")]
///     fn count(&self, mware: &str, to: i32, #[feedback] progress: &Feedback) -> i32 {
///         _ = mware;
///         (1..=to).take_while(|at| {
///             progress.send(&Map::from([("at", Value::from(*at))])).is_ok() && !progress.is_canceled()
///         }).count() as i32
///     }
/// }
///
/// # let memory = Arc::new(Memory::new("memory"));
/// # let context = CommunicatorContext::builder().only(memory).types(types).build();
/// let mut robot = Counter.communicator_in(&context);
/// robot.activate(CounterMethod::Count, Mode::Reply)?;
/// let mut caller = Counter.communicator_in(&context);
/// caller.activate(CounterMethod::Count, Mode::Request)?;
/// std::thread::scope(|scope| {
///     scope.spawn(move || robot.count("memory", 0, &Feedback::default()));
///     let (feedback, mut receiver) = Feedback::channel();
///     assert_eq!(caller.count("memory", 3, &feedback)?, Some(3));
///     drop(feedback);
///     let heard: Vec<_> = std::iter::from_fn(|| receiver.try_recv()).collect();
///     assert_eq!(heard.last().and_then(|last| last.get("at")), Some(&Value::from(3)));
///     Ok::<(), Box<dyn std::error::Error>>(())
/// })
/// # ?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Default)]
pub struct Feedback(FeedbackTarget);

#[derive(Clone, Default)]
enum FeedbackTarget {
    /// Nobody hears the feedback.
    #[default]
    None,
    Channel(Arc<ChannelSender>),
    Goal(Weak<ServedGoals>, GoalNumber),
}

struct FeedbackMessage(Value);

impl Waits for FeedbackMessage {
    fn bytes(&self) -> usize {
        self.0.size_hint()
    }
}

struct ChannelSender(endpoint::Sender<FeedbackMessage>);

/// Wakes the receiver, which finds that no sender is left.
impl Drop for ChannelSender {
    fn drop(&mut self) {
        self.0.context().wake.ring();
    }
}

impl Feedback {
    /// A pair of a call in mode `request`. The receiver holds the 64 latest messages; older ones are dropped and
    /// counted.
    #[must_use]
    pub fn channel() -> (Self, FeedbackReceiver) {
        let context = Context::default();
        let queue = QueueSpec { depth: DEPTH, overflow: Overflow::DropOldest };
        let (sender, queue) = endpoint::inbox(queue, &context);
        let sender = Arc::new(ChannelSender(sender));
        let receiver = FeedbackReceiver { queue, context, sender: Arc::downgrade(&sender) };
        (Self(FeedbackTarget::Channel(sender)), receiver)
    }

    pub(super) fn of_goal(goals: &Arc<ServedGoals>, number: GoalNumber) -> Self {
        Self(FeedbackTarget::Goal(Arc::downgrade(goals), number))
    }

    /// Sends feedback: a dict or struct of its fields, or the value of its first field. It is lost where nobody hears
    /// it, and where the goal has ended.
    ///
    /// # Errors
    /// When the value is no feedback of the action's type, or the middleware does not send it.
    pub fn send<T: Serialize + ?Sized>(&self, value: &T) -> Result<(), FeedbackError> {
        let value = to_value(value).map_err(PayloadError::from)?;
        match &self.0 {
            FeedbackTarget::None => {}
            // A receiver that is gone does not want it.
            FeedbackTarget::Channel(sender) => drop(sender.0.push(FeedbackMessage(value))),
            FeedbackTarget::Goal(goals, number) => {
                if let Some(goals) = goals.upgrade() {
                    goals.feedback(*number, &value.into())?;
                }
            }
        }
        Ok(())
    }

    /// True when a client wants the goal to end, and when it has ended. A body that was told so ends soon; what it
    /// returns is the result of a cancelled goal.
    pub fn is_canceled(&self) -> bool {
        match &self.0 {
            FeedbackTarget::None | FeedbackTarget::Channel(_) => false,
            FeedbackTarget::Goal(goals, number) => {
                goals.upgrade().is_none_or(|goals| goals.is_canceled(*number))
            }
        }
    }

    /// Makes the goal one that was aborted, for this reason: what the body returns is its result. Does nothing where
    /// there is no goal.
    pub fn abort(&self, reason: impl Into<String>) {
        if let FeedbackTarget::Goal(goals, number) = &self.0
            && let Some(goals) = goals.upgrade()
        {
            goals.abort(*number, reason.into());
        }
    }
}

impl fmt::Debug for Feedback {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Feedback")
    }
}

/// Receiver of the feedback of calls in mode `request`.
///
/// See [`Feedback`]. A message is the dict of its fields; [`types::from_value`](crate::types::from_value) makes a struct
/// of it.
pub struct FeedbackReceiver {
    queue: endpoint::Receiver<FeedbackMessage>,
    context: Context,
    sender: Weak<ChannelSender>,
}

impl FeedbackReceiver {
    /// Takes the next message, if there is one.
    pub fn try_recv(&mut self) -> Option<Value> {
        self.queue.pop().map(|FeedbackMessage(value)| value)
    }

    /// Waits for the next message; `None` when none came in time, or every [`Feedback`] of the pair was dropped.
    pub fn recv_timeout(&mut self, timeout: Duration) -> Option<Value> {
        let end = ends(Instant::now(), timeout);
        loop {
            // Asked before the look, so that the last message is not missed.
            let is_over = self.is_over();
            let found = self.try_recv();
            let left = end.saturating_duration_since(Instant::now());
            if found.is_some() || is_over || left.is_zero() {
                return found;
            }
            self.context.wake.wait(left);
        }
    }

    /// Waits for the next message; `None` when every [`Feedback`] of the pair was dropped.
    pub async fn recv(&mut self) -> Option<Value> {
        poll_fn(|task| {
            self.context.wake.notify(task.waker());
            let is_over = self.is_over();
            match self.try_recv() {
                None if !is_over => Poll::Pending,
                found => Poll::Ready(found),
            }
        })
        .await
    }

    /// Number of messages that were dropped because the receiver held as many as it can.
    pub fn dropped(&self) -> u64 {
        self.context.counters.snapshot().dropped()
    }

    fn is_over(&self) -> bool {
        self.sender.strong_count() == 0
    }
}

impl fmt::Debug for FeedbackReceiver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FeedbackReceiver").field("waiting", &self.queue.len()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::super::notifier::at_once;
    use super::*;

    #[test]
    fn the_latest_feedback_is_kept_and_the_end_is_told() {
        let (feedback, mut receiver) = Feedback::channel();
        for at in 0..DEPTH + 2 {
            feedback.send(&at).unwrap();
        }
        assert_eq!(receiver.dropped(), 2);
        assert_eq!(receiver.try_recv(), Some(Value::from(2)));
        assert_eq!(receiver.recv_timeout(Duration::ZERO), Some(Value::from(3)));
        assert!(!feedback.is_canceled());
        drop(feedback);
        let left = std::iter::from_fn(|| at_once(receiver.recv())).count();
        assert_eq!((left, receiver.recv_timeout(Duration::from_secs(60))), (DEPTH - 2, None));
    }
}
