//! Errors of registered methods, each with the method and the remedy.

use std::time::Duration;

use super::mode::{Mode, ParseModeError};
use wrapyfi_data::returned::PayloadError;
use wrapyfi_endpoint::{self as endpoint, OpenError, PublishError};

/// Error of choosing a mode.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, communicator};
/// use wrapyfi_core::middleware::memory::Memory;
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "memory", "/msg", should_wait = false)]
///     fn read(&self) -> String { "hello".to_owned() }
/// }
///
/// # let context = CommunicatorContext::builder().only(Arc::new(Memory::new("memory"))).build();
/// let mut mirror = Mirror.communicator_in(&context);
/// let error = mirror.activate("raed", "listen").unwrap_err().to_string();
/// assert!(error.starts_with("Mirror has no registered method \"raed\"; did you mean `read`? "));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ActivateError {
    /// The type has no registered method of this name.
    #[error("{class} has no registered method {name:?}; {hint}methods are {known}")]
    UnknownMethod {
        /// Type.
        class: &'static str,
        /// Name that was given.
        name: String,
        /// `did you mean …? `, or nothing.
        hint: String,
        /// Names of the methods that exist.
        known: String,
    },
    /// No mode has this name.
    #[error(transparent)]
    Mode(#[from] ParseModeError),
    /// A list by instance ends before this instance.
    #[error(
        "modes of {method} are listed for {length} instances, and this is instance {number} \
         (counted from 1): list one for each, or write one mode for all"
    )]
    ListTooShort {
        /// `Class::method`.
        method: String,
        /// Length of the list.
        length: usize,
        /// Number of this instance, from 1.
        number: usize,
    },
    /// The mode gives received values to the body, which has no argument for them.
    #[error(
        "mode {mode} gives {method} what it receives, which it cannot take: add an argument \
         `#[received] prev: Option<…>` of what it returns"
    )]
    NothingReceived {
        /// `Class::method`.
        method: String,
        /// Mode that was chosen.
        mode: Mode,
    },
    /// The mode publishes or listens, and the method is an action.
    #[error("{method} is an action, which mode {mode} does not carry: choose request or reply")]
    NoTopic {
        /// `Class::method`.
        method: String,
        /// Mode that was chosen.
        mode: Mode,
    },
    /// The configuration names a method that the type does not have.
    #[error("{place}: {fault}")]
    Configured {
        /// File and line.
        place: String,
        /// Fault of the entry at that place.
        fault: Box<ActivateError>,
    },
}

/// Error of a call of a registered method.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::{CommunicatorContext, MethodError, Mode, communicator};
/// use wrapyfi_core::middleware::memory::Memory;
///
/// struct Mirror;
/// #[communicator]
/// impl Mirror {
///     #[register(NativeObject, "$mware", "/msg")]
///     fn read(&self, mware: &str) -> String { format!("hello on {mware}") }
/// }
///
/// # let context = CommunicatorContext::builder().only(Arc::new(Memory::new("memory"))).build();
/// let mut mirror = Mirror.communicator_in(&context);
/// mirror.activate(MirrorMethod::Read, Mode::Listen)?;
/// let error = mirror.read("memroy").unwrap_err();
/// assert!(matches!(error, MethodError::UnknownMiddleware { .. }));
/// assert!(error.to_string().starts_with("Mirror::read: \"memroy\" is no middleware; did you mean"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MethodError {
    /// The mode in the configuration cannot be chosen: see [`ActivateError`].
    #[error(transparent)]
    Activate(#[from] ActivateError),
    /// A `$` in `#[register]` names no argument.
    #[error(
        "{method}: {written:?} names no argument; arguments are {known} (also $0, $1, … in this \
         order)"
    )]
    MissingArgument {
        /// `Class::method`.
        method: String,
        /// Text of the `$` argument as written.
        written: String,
        /// Names of the arguments that exist.
        known: String,
    },
    /// An argument behind a `$`, or an argument of a request, has no form as a value.
    #[error("{method}: argument {argument} cannot be used: {reason}")]
    Argument {
        /// `Class::method`.
        method: String,
        /// Name of the argument.
        argument: String,
        /// Fault of the argument.
        reason: String,
    },
    /// An option has a value that means nothing.
    #[error("{method}: {fault}")]
    Option {
        /// `Class::method`.
        method: String,
        /// The option, its value and what may be written.
        fault: String,
    },
    /// No middleware has this name, neither one that is here nor one that Wrapyfi knows.
    #[error("{method}: {name:?} is no middleware; {hint}available: {available}")]
    UnknownMiddleware {
        /// `Class::method`.
        method: String,
        /// Name that was asked for.
        name: String,
        /// `did you mean …? `, or nothing.
        hint: String,
        /// Names of the middlewares that are here.
        available: String,
    },
    /// The middleware is here, but does not start.
    #[error("{method}: {middleware} did not start: {reason}")]
    Start {
        /// `Class::method`.
        method: String,
        /// Name of the middleware.
        middleware: String,
        /// Error of the middleware in its words, and the remedy.
        reason: String,
    },
    /// `transceive` and `reemit` on one topic would hear themselves.
    #[error(
        "{method}: mode {mode} needs a topic for each way, and {middleware}:{topic} is both: write \
         listener_kwargs(in_topic = \"…\") and publisher_kwargs(out_topic = \"…\"), the other way \
         round at the other side"
    )]
    SameTopic {
        /// `Class::method`.
        method: String,
        /// Mode that is active.
        mode: Mode,
        /// Middleware of both directions.
        middleware: String,
        /// Topic of both directions.
        topic: String,
    },
    /// The middleware refuses the topic.
    #[error("{method}: {source}")]
    Open {
        /// `Class::method`.
        method: String,
        /// Cause and remedy.
        source: Box<OpenError>,
    },
    /// The middleware has no actions, and cannot offer one.
    #[error(
        "{method}: {middleware} has no actions: register a function (NativeObject) and route it as an action"
    )]
    NoActions {
        /// `Class::method`.
        method: String,
        /// Name of the middleware.
        middleware: String,
    },
    /// The body returned a value that cannot be sent.
    #[error("{method}: what it returned cannot be sent to {endpoint}: {source}")]
    Send {
        /// `Class::method`.
        method: String,
        /// `middleware:/topic`.
        endpoint: String,
        /// Part that cannot be encoded, and its place.
        source: Box<PayloadError>,
    },
    /// The middleware cannot put the value on its wire.
    #[error("{method}: what it returned cannot be sent to {endpoint}: {source}")]
    Publish {
        /// `Class::method`.
        method: String,
        /// `middleware:/topic`.
        endpoint: String,
        /// Part that cannot be encoded, and its place.
        source: Box<PublishError>,
    },
    /// The message that arrived does not fit the type that the method returns.
    #[error("{method}: what came from {endpoint} is not what it returns: {source}")]
    WrongType {
        /// `Class::method`.
        method: String,
        /// `middleware:/topic`.
        endpoint: String,
        /// Type that was found, and its place in the message.
        source: Box<PayloadError>,
    },
    /// No message or no peer came within `timeout_ms`.
    #[error(
        "{method}: waited {} ms for {waited_for}: start the other side, raise timeout_ms, or write \
         should_wait = false", waited.as_millis()
    )]
    TimedOut {
        /// `Class::method`.
        method: String,
        /// Time waited.
        waited: Duration,
        /// Thing that the call waited for, in words.
        waited_for: String,
    },
    /// [`Control::cancel`](super::Control::cancel) ended the wait.
    #[error("{method}: the wait for {waited_for} was cancelled")]
    Cancelled {
        /// `Class::method`.
        method: String,
        /// Thing that the call waited for, in words.
        waited_for: String,
    },
    /// The method was closed, or given another mode, while it waited.
    #[error("{method}: it was closed or given another mode while it waited for {waited_for}")]
    Ended {
        /// `Class::method`.
        method: String,
        /// Thing that the call waited for, in words.
        waited_for: String,
    },
    /// A request has no reply: there is no server, the server refuses, or its reply is of another type. The goal of an
    /// action was not reached: [`CallError::NotReached`](endpoint::CallError::NotReached).
    #[error("{method}: {source}")]
    Unanswered {
        /// `Class::method`.
        method: String,
        /// Cause and remedy.
        source: Box<endpoint::CallError>,
    },
    /// The middleware cannot put a reply on its wire.
    #[error("{method}: the reply to {endpoint} cannot be sent: {source}")]
    Reply {
        /// `Class::method`.
        method: String,
        /// `middleware:/topic`.
        endpoint: String,
        /// Part that cannot be encoded, and its place.
        source: Box<endpoint::ServeError>,
    },
}
