//! `wrapyfi echo`: prints the messages of an endpoint.

use std::time::{Duration, Instant};

use wrapyfi_core::endpoint::{
    Context, EndpointAddress, LearnError, Overflow, Qos, QueueSpec, TopicSpec,
};
use wrapyfi_core::types::{Map, MessageType, Payload};

use super::any;
use crate::cli::{EchoArgs, TypeName};
use crate::describe::{describe, summary};
use crate::exit::Failure;
use crate::middlewares::{LearnTopicError, Middlewares, Role, of_topic};
use crate::output;
use crate::shutdown::Shutdown;

/// Runs until `count` messages were printed, the time is out, or the process is asked to end.
///
/// # Errors
/// Exit code 3 when a message did not come in time, 2 when the endpoint is wrong.
pub fn run(args: &EchoArgs, shutdown: &Shutdown) -> Result<(), Failure> {
    // Before anything starts.
    let options = args.options.of(&args.endpoint.middleware)?;
    let start = || Middlewares::for_endpoint(&args.endpoint, Role::Listener, args.options.own);
    match (&args.message_type, args.endpoint.middleware.as_str()) {
        (Some(TypeName::Known(message_type)), _) => {
            known(args, (*message_type, options), Qos::default(), &start()?, shutdown)
        }
        (named, "ros2") => any::echo::run(args, named.as_ref(), options, shutdown),
        (Some(TypeName::Ros(name)), _) => {
            let message_type = any::message_type(name, &args.definitions)?;
            known(args, (message_type, options), Qos::default(), &start()?, shutdown)
        }
        (None, _) => {
            let middlewares = start()?;
            let message_type = learned(args, &options, &middlewares, shutdown)?;
            known(args, (message_type, options), Qos::default(), &middlewares, shutdown)
        }
    }
}

/// The type that the topic's publishers tell, or those who listen there.
fn learned(
    args: &EchoArgs,
    options: &Map,
    middlewares: &Middlewares,
    shutdown: &Shutdown,
) -> Result<MessageType, Failure> {
    let EndpointAddress { middleware, name } = &args.endpoint;
    let known = middlewares.registry().get(middleware).map_err(Failure::usage)?;
    let mut types = any::definitions(&args.definitions)
        .map_err(|failure| Failure::Usage(format!("--definitions {failure}")))?;
    let deadline = args.timeout.map(|timeout| Instant::now() + timeout);
    let mut waiting = Waiting::new(&args.endpoint);
    let is_over = |why: &LearnTopicError| {
        waiting.say(&awaited(why));
        shutdown.requested() || deadline.is_some_and(|deadline| Instant::now() >= deadline)
    };
    of_topic(known.as_ref(), name, &mut types, is_over, Ok)
        .map(|learned| known.received_as(learned.message_type(false), options))
        .map_err(|error| match error {
            LearnTopicError::Untold(LearnError::Untold { .. }) => Failure::Usage(format!(
                "--type is needed for {}, whose type {middleware} does not tell: {}",
                args.endpoint,
                MessageType::ALL.map(|known| known.to_string()).join(", ")
            )),
            LearnTopicError::Discover(error) => Failure::usage(error),
            other => Failure::TimedOut(format!(
                "{}: still waiting for {}",
                args.endpoint,
                awaited(&other)
            )),
        })
}

fn awaited(why: &LearnTopicError) -> String {
    match why {
        LearnTopicError::Nobody => "a publisher".to_owned(),
        other => other.to_string(),
    }
}

/// Tells the log what an endpoint waits for.
pub(super) struct Waiting<'a> {
    endpoint: &'a EndpointAddress,
    since: Instant,
    said: String,
}

impl<'a> Waiting<'a> {
    /// Time before a wait gets a line: endpoints that are there at once need none, nor those that
    /// change all the time.
    const SAY_AFTER: Duration = Duration::from_secs(1);

    pub(super) fn new(endpoint: &'a EndpointAddress) -> Self {
        Self { endpoint, since: Instant::now(), said: String::new() }
    }

    /// Says so once, and again when it is something else.
    pub(super) fn say(&mut self, what: &str) {
        if self.since.elapsed() >= Self::SAY_AFTER && self.said != what {
            tracing::warn!("{}: waiting for {what}", self.endpoint);
            what.clone_into(&mut self.said);
            self.since = Instant::now();
        }
    }
}

/// Prints the messages of a type that routes carry, with the options of their endpoint. Without `--qos` the publishers' quality of
/// service is followed, beginning with `start`.
pub(super) fn known(
    args: &EchoArgs,
    (message_type, options): (MessageType, Map),
    start: Qos,
    middlewares: &Middlewares,
    shutdown: &Shutdown,
) -> Result<(), Failure> {
    let context = Context::default();
    let spec = TopicSpec {
        qos: args.qos.map_or(start, Qos::from),
        match_peers: args.qos.is_none(),
        queue: QueueSpec { depth: 100, overflow: Overflow::DropOldest },
        options,
        ..TopicSpec::new(&args.endpoint.name, message_type)
    };
    let middleware =
        middlewares.registry().get(&args.endpoint.middleware).map_err(Failure::usage)?;
    let mut listener = middleware.open_listener(&spec, &context).map_err(Failure::usage)?;
    let (mut printed, mut waiting) = (0, Waiting::new(&args.endpoint));
    let mut deadline = args.timeout.map(|timeout| Instant::now() + timeout);
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
                let line =
                    if args.json { describe(&sample.payload) } else { summary(&sample.payload) };
                output::line(&line.to_string())?;
                printed += 1;
                deadline = args.timeout.map(|timeout| Instant::now() + timeout);
            }
            Ok(None) => {
                if let Some(at) = deadline
                    && Instant::now() >= at
                {
                    return Err(timed_out(args, printed, &listener.link(), &context));
                }
                if let Some(what) = listener.link().waiting_for {
                    waiting.say(&what);
                }
                context.wake.wait(super::WAIT_SLICE);
            }
            Err(error) => {
                context.counters.dropped(error.drop_reason());
                tracing::warn!("{}: dropped a message: {error}", args.endpoint);
            }
        }
    }
    report_drops(&context);
    Ok(())
}

fn timed_out(
    args: &EchoArgs,
    printed: u64,
    link: &wrapyfi_core::endpoint::Link,
    context: &Context,
) -> Failure {
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
