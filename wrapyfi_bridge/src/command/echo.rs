//! `wrapyfi echo`: prints the messages of an endpoint.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use wrapyfi_data::types::{Map, MessageType, Payload};
use wrapyfi_endpoint::{
    Context, DropReason, EndpointAddress, LearnError, Learned, Link, Middleware, Overflow, Qos,
    QueueSpec, Role, Throttle, TopicSpec,
};

use super::other_types::OtherTypes;
use super::{definitions, yaml};
use crate::cli::{EchoArgs, TypeName};
use crate::describe::{describe, describe_message, summary};
use crate::exit::{Failure, Result};
use crate::middlewares::{LearnTopicError, check_topic, for_endpoint, of_topic};
use crate::node::GRAPH;
use crate::output;
use crate::own_address::OwnAddress;
use crate::shutdown::Shutdown;

/// Runs until `count` messages were printed, the time is out, or the process is asked to end.
///
/// # Errors
/// Exit code 3 when a message did not come in time, 2 when the endpoint is wrong.
pub fn run(args: &EchoArgs, shutdown: &Shutdown) -> Result<()> {
    // Before anything starts.
    check_topic(&args.endpoint)?;
    let options = args.options.of(&args.endpoint.middleware)?;
    let named = match &args.message_type {
        Some(TypeName::Known(message_type)) => Some(*message_type),
        Some(TypeName::Ros(name)) => Some(definitions::message_type(name, &args.definitions)?),
        None => None,
    };
    let middleware = for_endpoint(&args.endpoint, Role::Listener, args.options.own)?;
    let message_type = match named {
        Some(message_type) => message_type,
        None => match learned(&topic(args), &options, middleware.as_ref(), shutdown)? {
            Some(message_type) => message_type,
            None => return Ok(()),
        },
    };
    print_all(args, (message_type, options), middleware.as_ref(), shutdown)
}

/// A topic whose type is asked for.
struct Untyped<'a> {
    endpoint: &'a EndpointAddress,
    definitions: &'a [PathBuf],
    timeout: Option<Duration>,
}

fn topic(args: &EchoArgs) -> Untyped<'_> {
    let EchoArgs { endpoint, definitions, timeout, .. } = args;
    Untyped { endpoint, definitions, timeout: *timeout }
}

/// The type that the publishers of `endpoint` tell, or those who listen there; `None` when asked to end.
///
/// # Errors
/// As [`run`].
pub fn type_of(
    endpoint: &EndpointAddress,
    timeout: Option<Duration>,
    shutdown: &Shutdown,
) -> Result<Option<MessageType>> {
    check_topic(endpoint)?;
    let middleware = for_endpoint(endpoint, Role::Listener, OwnAddress::default())?;
    let topic = Untyped { endpoint, definitions: &[], timeout };
    learned(&topic, &Map::default(), middleware.as_ref(), shutdown)
}

fn learned(
    asked: &Untyped<'_>,
    options: &Map,
    middleware: &dyn Middleware,
    shutdown: &Shutdown,
) -> Result<Option<MessageType>> {
    let EndpointAddress { middleware: name, name: topic } = asked.endpoint;
    let is_ros2 = name == GRAPH;
    let mut types = definitions::of_command(asked.definitions)?;
    let deadline = asked.timeout.map(|timeout| Instant::now() + timeout);
    let mut waiting = Waiting::new(asked.endpoint);
    let is_over = |why: &LearnTopicError| {
        // Publishers on ROS 1 and YARP show their definitions.
        if is_ros2 && matches!(why, LearnTopicError::Untold(LearnError::Undefined { .. })) {
            return true;
        }
        waiting.say(&awaited(why));
        shutdown.requested() || deadline.is_some_and(|deadline| Instant::now() >= deadline)
    };
    match of_topic(middleware, topic, &mut types, is_over, Ok) {
        // As ROS 2 shows it: what the text means is unknown.
        Ok(Learned::Ros(text)) if is_ros2 && text.name() == MessageType::Text.ros_type() => {
            Ok(Some(MessageType::Ros(text)))
        }
        Ok(learned) => Ok(Some(middleware.received_as(learned.message_type(false), options))),
        Err(_) if shutdown.requested() => Ok(None),
        Err(LearnTopicError::Untold(LearnError::Untold(_))) => Err(Failure::Usage(format!(
            "--type is needed for {}, whose type {name} does not tell: {}",
            asked.endpoint,
            MessageType::ALL.map(|known| known.to_string()).join(", ")
        ))),
        Err(LearnTopicError::Untold(LearnError::Undefined { type_name, .. })) if is_ros2 => {
            definitions::message_type(&type_name, asked.definitions).map(Some)
        }
        Err(LearnTopicError::Discover(error)) => Err(Failure::usage(error)),
        Err(other) => Err(Failure::TimedOut(format!(
            "{}: still waiting for {}; give --type, or see `wrapyfi list {name}`",
            asked.endpoint,
            awaited(&other)
        ))),
    }
}

fn awaited(why: &LearnTopicError) -> String {
    match why {
        LearnTopicError::Nobody => "somebody who announces the topic and its type".to_owned(),
        other => other.to_string(),
    }
}

/// Tells the log what an endpoint waits for.
pub(in crate::command) struct Waiting<'a> {
    endpoint: &'a EndpointAddress,
    since: Instant,
    said: String,
}

impl<'a> Waiting<'a> {
    /// Time before a wait gets a line: endpoints that are there at once need none, nor those that
    /// change all the time.
    const SAY_AFTER: Duration = Duration::from_secs(1);

    pub(in crate::command) fn new(endpoint: &'a EndpointAddress) -> Self {
        Self { endpoint, since: Instant::now(), said: String::new() }
    }

    /// Says so once, and again when it is something else.
    pub(in crate::command) fn say(&mut self, what: &impl ToString) {
        let what = what.to_string();
        if self.since.elapsed() >= Self::SAY_AFTER && self.said != what {
            tracing::warn!("{}: waiting for {what}", self.endpoint);
            self.said = what;
            self.since = Instant::now();
        }
    }
}

/// Prints the messages of a topic. Without `--qos` the publishers' quality of service is followed.
fn print_all(
    args: &EchoArgs,
    (message_type, options): (MessageType, Map),
    middleware: &dyn Middleware,
    shutdown: &Shutdown,
) -> Result<()> {
    let context = Context::default();
    let spec = TopicSpec {
        qos: args.qos.map_or_else(Qos::default, Qos::from),
        match_peers: args.qos.is_none(),
        queue: QueueSpec { depth: 100, overflow: Overflow::DropOldest },
        options,
        ..TopicSpec::new(&args.endpoint.name, message_type)
    };
    let mut listener = middleware.open_listener(&spec, &context).map_err(Failure::usage)?;
    let mut other_types =
        OtherTypes::new(middleware, &args.endpoint.name, message_type).of_other_names();
    let (mut printed, mut waiting) = (0, Waiting::new(&args.endpoint));
    let mut deadline = args.timeout.map(|timeout| Instant::now() + timeout);
    let mut losses = Throttle::default();
    let mut lost = |reason, error: &dyn std::fmt::Display| {
        context.counters.dropped(reason);
        if let Some(unlogged_before) = losses.pass(Instant::now()) {
            // A publisher may have come back with another type.
            let learned = match (reason, &args.message_type) {
                (DropReason::Mismatch, None) => {
                    format!(
                        "; {message_type} is the type of the topic when this began: start again"
                    )
                }
                _ => String::new(),
            };
            let what = &args.endpoint;
            tracing::warn!(unlogged_before, "{what}: dropped a message: {error}{learned}");
        }
    };
    while !shutdown.requested() && args.count.is_none_or(|count| printed < count) {
        for warning in listener.review(Instant::now()).warnings {
            tracing::warn!("{}: {warning}", args.endpoint);
        }
        match listener.take() {
            Ok(Some(sample)) => {
                if let Payload::NativeObject(value) = &sample.payload {
                    for (_, reason) in value.refusals() {
                        tracing::warn!("{}: an object stays unread: {reason}", args.endpoint);
                    }
                }
                match as_text(&sample.payload, args.json) {
                    Ok(line) => {
                        output::line(&line)?;
                        printed += 1;
                        deadline = args.timeout.map(|timeout| Instant::now() + timeout);
                    }
                    Err(error) => lost(DropReason::Malformed, &error),
                }
            }
            Ok(None) => {
                other_types.look();
                if deadline.is_some_and(|at| Instant::now() >= at) {
                    return Err(timed_out(args, printed, &listener.link(), &context));
                }
                match listener.link().waiting_for {
                    Some(what) => waiting.say(&what),
                    None => waiting = Waiting::new(&args.endpoint),
                }
                context.wake.wait(super::WAIT_SLICE);
            }
            Err(error) => lost((&error).into(), &error),
        }
    }
    report_drops(&context);
    Ok(())
}

/// A message for people, or as JSON for programs.
fn as_text(payload: &Payload, as_json: bool) -> anyhow::Result<String> {
    match payload {
        Payload::RosMessage(message) => {
            let fields = message.fields(message.cdr.len())?;
            if as_json { Ok(describe_message(message, &fields)) } else { yaml::text(&fields) }
        }
        other => Ok(if as_json { describe(other) } else { summary(other) }),
    }
}

fn timed_out(args: &EchoArgs, printed: u64, link: &Link, context: &Context) -> Failure {
    let why = match (&link.waiting_for, link.peers) {
        (Some(what), _) => format!("still waiting for {what}"),
        (None, Some(0)) => "no publisher is there".to_owned(),
        (None, _) => "nothing was published".to_owned(),
    };
    report_drops(context);
    Failure::TimedOut(format!(
        "{}: time-out after {printed} messages: {why}; {} arrived, {} were dropped",
        args.endpoint,
        context.counters.snapshot().received,
        context.counters.snapshot().dropped(),
    ))
}

fn report_drops(context: &Context) {
    for (reason, count) in context.counters.snapshot().drops {
        tracing::warn!("{count} messages dropped: {reason}");
    }
}
