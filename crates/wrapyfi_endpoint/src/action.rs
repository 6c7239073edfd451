//! Goals, their feedback and their results: the interface for actions.
//!
//! ```text
//!   engine, command line, communicator
//!        │ send()      ▲ take()                      take() ▲      │ update()
//!   ┌────▼─────────────┴───┐                        ┌───────┴──────▼───┐
//!   │ ActionClient: goals, │ ── goal, cancel ─────▶ │ ActionServer:    │
//!   │ each with its ticket │ ◀─ GoalUpdate ──────── │ goals by number  │
//!   └──────────────────────┘                        └──────────────────┘
//!
//!   sent ─┬▶ accepted ─▶ executing ─┬──────────────▶ succeeded, aborted
//!         │      └───────────┬──────┴▶ canceling ──▶ canceled, succeeded, aborted
//!         └▶ rejected        └ feedback, in any of these three
//! ```
//!
//! A client gives the updates of a goal in an order that this picture allows, and a server may be given them as
//! they come from any client: what is missing between two states is sent before the later one. A goal ends once, with
//! [`GoalUpdate::Rejected`] or [`GoalUpdate::Ended`].
//!
//! Nothing here waits: [`Context::wake`](super::Context::wake) rings when something can be taken, and `deadline` is
//! the time to look without a ring.

use std::fmt;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::calls::Ticket;
use super::service_error::{CallError, ServeResult};
use super::{BridgeMark, GoalEvent, Link, Middleware, OpenResult, Request};
use wrapyfi_data::Limits;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Encoding, Map, Payload, RosAction};

/// An action to call or to offer, with its type and the settings of the endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types}; }
/// # use wrapyfi_interfaces::{parser::{Dialect, TypeName}, store::ResolvedType};
/// use wrapyfi_core::endpoint::ActionSpec;
/// use wrapyfi_core::types::RosAction;
/// # let name = TypeName::parse(Dialect::Ros2, "demo/action/Count")?;
/// # let count = ResolvedType::from_text(Dialect::Ros2, &name, "int32 to\n---\nint32 reached\n---\nint32 at\n")?;
/// let spec = ActionSpec::new("/count", RosAction::new(&count)?);
/// assert_eq!((spec.action.as_str(), spec.goals), ("/count", ActionSpec::GOALS));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ActionSpec {
    /// Name of the action in that middleware, for instance `/move_base`.
    pub action: String,
    /// Type of the action.
    pub kind: RosAction,
    /// Largest number of goals under way at once: 256.
    pub goals: usize,
    /// Channel order of three-channel images on Wrapyfi's side; [`Encoding::Bgr8`] by custom.
    pub color_order: Encoding,
    /// Bounds on every goal, result and feedback.
    pub limits: Limits,
    /// Plug-ins that read and write objects inside native objects.
    pub plugins: Plugins,
    /// Time within which a goal has to end where a function stands for the server; `None`: all that it needs. Servers of
    /// actions say themselves when a goal has ended, or are seen to be gone.
    pub timeout: Option<Duration>,
    /// Settings that only some middlewares have, by name, such as `feedback`.
    pub options: Map,
    /// Mark of the bridge that makes the server by pattern; announced where the wire has room for it.
    #[doc(hidden)]
    pub mark: Option<BridgeMark>,
}

impl ActionSpec {
    /// Largest number of goals under way at once unless said otherwise.
    pub const GOALS: usize = 256;

    /// An action with the default limits.
    pub fn new(action: impl Into<String>, kind: RosAction) -> Self {
        Self {
            action: action.into(),
            kind,
            goals: Self::GOALS,
            color_order: Encoding::Bgr8,
            limits: Limits::default(),
            plugins: wrapyfi_plugins::standard(),
            timeout: None,
            options: Map::default(),
            mark: None,
        }
    }
}

/// Number of a goal among those that one server has taken.
///
/// See [`ActionServer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct GoalNumber(pub u64);

/// A goal, or the wish to cancel one, as a server takes it.
///
/// See [`ActionServer`].
#[derive(Debug, Clone, PartialEq)]
pub enum GoalRequest {
    /// A goal that waits to be accepted or rejected.
    Goal {
        /// Number by which [`ActionServer::update`] is told of the goal.
        number: GoalNumber,
        /// The goal: a message of type [`RosAction::goal`], or a call whose keyword arguments are its fields.
        goal: Request,
        /// Size on the wire in bytes.
        wire_bytes: usize,
    },
    /// A client wants the goal to end. It may have ended by itself, and may be asked for again.
    Cancel(GoalNumber),
    /// A client wants all goals of the server to end. Those that this end has taken were asked for one by one before; a
    /// server that stands for another one, as that of a route does, passes the wish on, because that one may have goals
    /// of other clients, and of a bridge that was there before.
    CancelAll,
}

/// State in which an accepted goal ends.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// assert_eq!(wrapyfi_core::endpoint::GoalOutcome::Canceled.to_string(), "canceled");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GoalOutcome {
    /// The server reached the goal.
    Succeeded,
    /// The goal was given up because a client asked for that.
    Canceled,
    /// The goal was given up for another reason.
    Aborted,
}

impl fmt::Display for GoalOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// News of one goal.
///
/// See [`ActionClient`].
#[derive(Debug, Clone, PartialEq)]
pub enum GoalUpdate {
    /// The server has taken the goal and will end it.
    Accepted,
    /// The server does not want the goal, which has ended. The text says why, where the wire has room for it.
    Rejected(String),
    /// The server works on the goal.
    Executing,
    /// The server is about to give the goal up.
    Canceling,
    /// The server goes on with a goal that was to be cancelled, and why, as far as it is known.
    CancelRefused(String),
    /// Progress of the goal, of type [`RosAction::feedback`].
    Feedback(Payload),
    /// The goal has ended.
    Ended {
        /// State in which it ended.
        outcome: GoalOutcome,
        /// Result, of type [`RosAction::result`]; `None` where the server gave none.
        result: Option<Payload>,
        /// Reason, where the server or the wire gave one.
        text: String,
    },
}

impl GoalUpdate {
    /// End of a goal whose server has gone or cannot be understood.
    pub fn aborted(text: impl Into<String>) -> Self {
        Self::Ended { outcome: GoalOutcome::Aborted, result: None, text: text.into() }
    }

    /// Event under which the update is counted, if it is.
    pub fn event(&self) -> Option<GoalEvent> {
        match self {
            Self::Accepted => Some(GoalEvent::Accepted),
            Self::Rejected(_) => Some(GoalEvent::Rejected),
            Self::Executing | Self::Canceling => None,
            Self::CancelRefused(_) => Some(GoalEvent::CancelRefused),
            Self::Feedback(_) => Some(GoalEvent::Feedback),
            Self::Ended { outcome, .. } => Some(match outcome {
                GoalOutcome::Succeeded => GoalEvent::Succeeded,
                GoalOutcome::Canceled => GoalEvent::Canceled,
                GoalOutcome::Aborted => GoalEvent::Aborted,
            }),
        }
    }

    /// True for the last update of a goal.
    pub fn is_end(&self) -> bool {
        matches!(self, Self::Rejected(_) | Self::Ended { .. })
    }
}

/// The calling end of an action.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// # use wrapyfi_interfaces::{parser::{Dialect, TypeName}, store::ResolvedType};
/// use wrapyfi_core::endpoint::{
///     ActionSpec, Context, GoalRequest, GoalUpdate, Middleware, Request,
/// };
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{Map, RosAction};
/// # let name = TypeName::parse(Dialect::Ros2, "demo/action/Count")?;
/// # let count = ResolvedType::from_text(Dialect::Ros2, &name, "int32 to\n---\nint32 reached\n---\nint32 at\n")?;
/// let (bus, context) = (Memory::new("memory"), Context::default());
/// let spec = ActionSpec::new("/count", RosAction::new(&count)?);
/// let mut server = bus.open_action_server(&spec, &context)?;
/// let mut client = bus.open_action_client(&spec, &context)?;
/// let ticket = client.send(&Request::default().with(Map::from([("to", 3)])))?;
/// let Some(GoalRequest::Goal { number, .. }) = server.take()? else { panic!("no goal") };
/// server.update(number, GoalUpdate::Accepted)?;
/// assert_eq!(client.take(), Some((ticket, GoalUpdate::Accepted)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Dropping it forgets its goals, which go on where their server works on them.
pub trait ActionClient: Send {
    /// Sends a goal. [`ActionClient::take`] gives its updates, the last of which is an end, whatever becomes of the
    /// server.
    ///
    /// # Errors
    /// When the goal has no form on this wire, or too many goals are under way: nothing is sent.
    fn send(&mut self, goal: &Request) -> Result<Ticket, CallError>;

    /// Asks the server to give a goal up, now or as soon as it has accepted the goal. The next update after it is
    /// [`GoalUpdate::Canceling`], [`GoalUpdate::CancelRefused`] or an end, besides feedback. Does nothing for a goal
    /// that has ended.
    fn cancel(&mut self, ticket: Ticket);

    /// Asks the server to give up all its goals, those of other clients too. Their own clients hear of it.
    ///
    /// # Errors
    /// When the wire has no word for it, or the server cannot be asked.
    fn cancel_all(&mut self) -> Result<(), CallError>;

    /// Takes the next update of any goal, if there is one.
    fn take(&mut self) -> Option<(Ticket, GoalUpdate)>;

    /// Instant at which [`ActionClient::take`] should be called again though nothing rang.
    fn deadline(&self) -> Option<Instant>;

    /// Connection of the client now; its peers are servers all of whose parts were found.
    fn link(&self) -> Link;
}

/// The serving end of an action.
///
/// Every goal ends once. Dropping the server ends those that go on as aborted, where the wire has a word for it.
pub trait ActionServer: Send {
    /// Takes the next goal or wish to cancel one, if there is one. It also answers clients that ask for results, so call
    /// it whenever the bell has rung, and at [`ActionServer::deadline`].
    ///
    /// # Errors
    /// When the next request cannot be used. It is refused and counted; the one after it can be taken.
    fn take(&mut self) -> ServeResult<Option<GoalRequest>>;

    /// Tells the clients of a goal what has become of it. Updates of a goal that has ended are ignored. Number of bytes
    /// of the message that carries it.
    ///
    /// # Errors
    /// The update was not sent, and why. An end that has no form on this wire ends the goal as aborted.
    fn update(&mut self, number: GoalNumber, update: GoalUpdate) -> ServeResult<usize>;

    /// Number of goals that have not ended, or whose results may still be asked for.
    fn kept(&self) -> usize;

    /// Instant at which [`ActionServer::take`] should be called again though nothing rang.
    fn deadline(&self) -> Option<Instant>;

    /// Connection of the server now; its peers are clients.
    fn link(&self) -> Link;

    /// Hides the action from clients that look for a server, while goals that come all the same are still taken. False
    /// where the wire has no way to: the action is there until its server is dropped.
    fn hide(&mut self) -> bool {
        false
    }

    /// Shows an action that was hidden again, on the middleware that it was opened on; does nothing with one that is
    /// shown.
    ///
    /// # Errors
    /// As those of opening it.
    fn show(&mut self, on: &dyn Middleware) -> OpenResult<()> {
        _ = on;
        Ok(())
    }
}
