//! `wrapyfi echo ros2:/topic` of any type, named or discovered.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context as _;
use serde_json::json;
use wrapyfi_core::endpoint::{
    Discovered, DropReason, EndpointAddress, Middleware as _, Qos, Role, Wake, listener_qos,
};
use wrapyfi_core::middleware::ros2::graph::GraphError;
use wrapyfi_core::middleware::ros2::{AnyError, AnyListener, AnyMessage, Ros2};
use wrapyfi_core::types::{Map, MessageType};
use wrapyfi_core::{Limits, Throttle};

use super::{Strangers, resolve, types_of, yaml};
use crate::cli::{EchoArgs, TypeName};
use crate::command::{WAIT_SLICE, echo};
use crate::describe::digest;
use crate::exit::Failure;
use crate::middlewares::Middlewares;
use crate::output;
use crate::shutdown::Shutdown;

/// Prints the messages of the type `named`, or of the one that the topic's endpoints announce.
///
/// # Errors
/// Exit code 3 when a type or a message did not come in time, 2 when type or endpoint is wrong.
pub fn run(
    args: &EchoArgs,
    named: Option<&TypeName>,
    options: Map,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let ros2 = Arc::new(Middlewares::ros2_of_command()?);
    let topic = ros2.resolve(&args.endpoint.name).map_err(Failure::usage)?;
    let asked = args.qos.map(Qos::from);
    let (name, qos) = match named {
        Some(TypeName::Known(known)) => (known.ros_type().to_owned(), asked.unwrap_or_default()),
        Some(TypeName::Ros(name)) => (name.clone(), asked.unwrap_or_default()),
        None => match discover(args, &ros2, &topic, shutdown)? {
            Some((name, offered)) => (name, asked.unwrap_or(offered)),
            None => return Ok(()),
        },
    };
    // A String that nobody called JSON is text.
    if let Ok(known) = name.parse::<MessageType>()
        && known != MessageType::StringJson
    {
        let middlewares = Middlewares::with_ros2(ros2);
        return echo::known(args, (known, options), qos, &middlewares, shutdown);
    }
    let resolved = resolve(&name, &args.definitions)?;
    let wake = Wake::new();
    let limit = Limits::default().message_bytes;
    let listener = AnyListener::open(&ros2, &args.endpoint.name, &resolved, qos, limit, &wake)
        .map_err(Failure::usage)?;
    let discovery = ros2.discover().context("ros2")?;
    print_all(args, listener, Strangers::new(discovery), &wake, shutdown)
}

/// Waits until somebody announces the topic; its type, and the quality of service that hears all
/// its publishers. `None` when asked to end.
fn discover(
    args: &EchoArgs,
    ros2: &Ros2,
    topic: &str,
    shutdown: &Shutdown,
) -> Result<Option<(String, Qos)>, Failure> {
    let mut discovery = ros2.discover().context("ros2")?;
    let deadline = args.timeout.map(|timeout| Instant::now() + timeout);
    let (wake, mut waiting) = (Wake::new(), echo::Waiting::new(&args.endpoint));
    while !shutdown.requested() {
        let found = discovery.endpoints().context("ros2")?;
        let types = types_of(&found, topic);
        match (types.first(), types.len()) {
            (Some(only), 1) => return Ok(Some(((*only).to_owned(), offered(&found, topic)))),
            (Some(_), _) => {
                let types = types.into_iter().collect::<Vec<_>>().join(", ");
                return Err(Failure::Usage(format!(
                    "{} has several types: {types}; choose one with --type",
                    args.endpoint
                )));
            }
            (None, _) => {}
        }
        if deadline.is_some_and(|at| Instant::now() >= at) {
            return Err(Failure::TimedOut(format!(
                "{}: time-out: nobody announces the topic; give --type, or see `wrapyfi list ros2`",
                args.endpoint
            )));
        }
        waiting.say("somebody who announces the topic and its type");
        wake.wait(WAIT_SLICE);
    }
    Ok(None)
}

/// Quality of service that hears all publishers of the topic.
fn offered(found: &[Discovered], topic: &str) -> Qos {
    let publishers = found.iter().filter(|e| e.name == topic && e.role == Role::Publisher);
    let all: Vec<_> = publishers.filter_map(|endpoint| endpoint.qos).collect();
    listener_qos(&all, &Qos::default()).qos
}

fn print_all(
    args: &EchoArgs,
    mut listener: AnyListener,
    mut strangers: Strangers,
    wake: &Wake,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let (mut printed, mut dropped, mut losses) = (0, 0_u64, Losses::default());
    let mut deadline = args.timeout.map(|timeout| Instant::now() + timeout);
    while !shutdown.requested() && args.count.is_none_or(|count| printed < count) {
        let taken = listener.take();
        losses.note(&args.endpoint, listener.lost());
        match taken {
            Ok(Some(message)) => {
                let line = if args.json { line(&message) } else { yaml::text(&message.fields)? };
                output::line(&line)?;
                printed += 1;
                deadline = args.timeout.map(|timeout| Instant::now() + timeout);
            }
            Ok(None) => {
                strangers.look(listener.topic());
                if deadline.is_some_and(|at| Instant::now() >= at) {
                    let why = why_nothing(&listener);
                    return Err(Failure::TimedOut(format!(
                        "{}: time-out after {printed} messages: {why}; {dropped} were dropped, {} were \
                         lost upstream",
                        args.endpoint, losses.all
                    )));
                }
                wake.wait(WAIT_SLICE);
            }
            Err(
                error @ (AnyError::Malformed { .. } | AnyError::Graph(GraphError::TooLarge { .. })),
            ) => {
                dropped += 1;
                tracing::warn!("dropped a message: {error}");
            }
            Err(error) => return Err(anyhow::Error::new(error).into()),
        }
    }
    if dropped > 0 {
        tracing::warn!("{dropped} messages dropped");
    }
    if losses.all > 0 {
        tracing::warn!("{} messages dropped: {}", losses.all, DropReason::LostUpstream);
    }
    Ok(())
}

/// Messages that DDS lost before they could be taken.
#[derive(Default)]
struct Losses {
    all: u64,
    told: Throttle,
}

impl Losses {
    fn note(&mut self, endpoint: &EndpointAddress, lost: u64) {
        self.all = self.all.saturating_add(lost);
        if lost > 0
            && let Some(unlogged_before) = self.told.pass(Instant::now())
        {
            tracing::warn!(
                lost,
                unlogged_before,
                "{endpoint}: messages were lost between their publisher and this node"
            );
        }
    }
}

fn why_nothing(listener: &AnyListener) -> String {
    match (listener.incompatible(), listener.publishers()) {
        (Some(policy), 0) => format!("a publisher offers another {policy}: give --qos"),
        (_, 0) => "no publisher is there".to_owned(),
        _ => "nothing was published".to_owned(),
    }
}

/// A message for programs.
fn line(message: &AnyMessage) -> String {
    let size = message.cdr.len();
    let head = json!({
        "type": message.fields.type_name(),
        "stamp": message.source_timestamp_ns as f64 / 1e9,
        "size": size,
        "sha256": digest(&message.cdr),
    });
    // The message itself keeps the order of its fields; a JSON value would sort them.
    let value = serde_json::to_string(&message.fields).unwrap_or_default();
    let head = head.to_string();
    format!("{},\"value\":{value}}}", head.strip_suffix('}').unwrap_or(&head))
}
