//! `wrapyfi pub`: publishes a value or a file to an endpoint.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_data::types::{MessageType, Payload, Stamp};
use wrapyfi_endpoint::{Absent, Context, PublishError, Publisher, Role, ServiceSpec, TopicSpec};

use super::definitions;
use super::echo::Waiting;
use super::other_types::OtherTypes;
use crate::cli::{PubArgs, TypeName};
use crate::exit::{Failure, Result};
use crate::middlewares::for_endpoint;
use crate::node::GRAPH;
use crate::shutdown::Shutdown;
use crate::{describe, input};

/// Waits for a listener, then publishes until `count` is reached or the process is asked to end.
///
/// # Errors
/// Exit code 3 when no listener came in time, 2 when endpoint or input is wrong.
pub fn run(args: &PubArgs, shutdown: &Shutdown) -> Result<()> {
    let args = &with_defaults(args);
    let options = args.options.of(&args.endpoint.middleware)?;
    let message_type = match &args.message_type {
        TypeName::Known(message_type) => *message_type,
        TypeName::Ros(name) => definitions::message_type(name, &args.definitions)?,
    };
    let spec = TopicSpec {
        qos: args.qos.into(),
        options,
        ..TopicSpec::new(&args.endpoint.name, message_type)
    };
    let payload = match (&args.value, &args.file) {
        (Some(text), _) => input::from_json(text, &spec),
        (None, Some(file)) => input::from_file(file, &spec),
        (None, None) => Err(anyhow!("give --value or --file")),
    };
    let payload = payload.and_then(|payload| Ok(spec.conversion().convert(payload, Stamp::now)?));
    let mut payload = payload.map_err(|error| Failure::usage(format!("{error:#}")))?;
    let middleware = for_endpoint(&args.endpoint, Role::Publisher, args.options.own)?;
    let context = Context::default();
    let mut publisher = middleware.open_publisher(&spec, &context).map_err(Failure::usage)?;
    let mut other_types = OtherTypes::new(middleware.as_ref(), &args.endpoint.name, message_type);
    if !wait_for_listener(args, publisher.as_ref(), &mut other_types, &context, shutdown)? {
        return Ok(());
    }
    let sent =
        publish(args, publisher.as_mut(), &mut other_types, &context, &mut payload, shutdown)?;
    tracing::info!("published {sent} to {}: {}", args.endpoint, describe::summary(&payload));
    drop(publisher); // hands over what is queued before the transport goes
    Ok(())
}

/// Parameters of a node are set once, and a node that is not there is not waited for for ever.
fn with_defaults(args: &PubArgs) -> PubArgs {
    let mut args = args.clone();
    let properties = args.message_type == TypeName::Known(MessageType::Properties);
    if properties && args.endpoint.middleware == GRAPH {
        args.count = args.count.or(Some(1));
        args.timeout = args.timeout.or(Some(ServiceSpec::TIMEOUT));
    }
    args
}

/// False when asked to end.
fn wait_for_listener(
    args: &PubArgs,
    publisher: &dyn Publisher,
    other_types: &mut OtherTypes,
    context: &Context,
    shutdown: &Shutdown,
) -> Result<bool> {
    let deadline = args.timeout.map(|timeout| Instant::now() + timeout);
    let mut waiting = Waiting::new(&args.endpoint);
    while !shutdown.requested() {
        let link = publisher.link();
        if link.waiting_for.is_none() && (link.keeps_last || link.peers != Some(0)) {
            return Ok(true);
        }
        other_types.look();
        let nobody = || Absent::at(Role::Listener, &args.endpoint).into();
        let what = link.waiting_for.unwrap_or_else(nobody);
        if deadline.is_some_and(|at| Instant::now() >= at) {
            return Err(Failure::TimedOut(format!("time-out while waiting for {what}")));
        }
        waiting.say(&what);
        context.wake.wait(super::WAIT_SLICE);
    }
    Ok(false)
}

fn publish(
    args: &PubArgs,
    publisher: &mut dyn Publisher,
    other_types: &mut OtherTypes,
    context: &Context,
    payload: &mut Payload,
    shutdown: &Shutdown,
) -> Result<u64> {
    let interval = Duration::from_secs_f64(1.0 / args.rate);
    // Peers that are matched now were discovered before.
    other_types.look_now();
    let start = Instant::now();
    let (mut sent, mut turns, mut is_told) = (0, 0_u64, false);
    while args.count.is_none_or(|count| sent < count) && !shutdown.requested() {
        input::restamp(payload, args.endpoint.middleware == GRAPH);
        match publisher.publish(payload) {
            Ok(_) => {
                sent += 1;
                is_told = false;
            }
            // The listener left in the middle, and others may come; or it stands still, and may go on:
            // then the message is tried again. Once is enough to say so.
            Err(
                error @ (PublishError::NoConsumer(_)
                | PublishError::QueueFull { .. }
                | PublishError::OverBudget(_)),
            ) => {
                if !is_told {
                    tracing::warn!("{error}");
                }
                is_told = true;
                sent += u64::from(matches!(error, PublishError::NoConsumer(_)));
            }
            // The server of the middleware is away, and may come back: then it is tried again, too.
            Err(error @ PublishError::Transport { .. })
                if publisher.link().waiting_for.is_some() =>
            {
                tracing::debug!("{error}");
                if !wait_for_listener(args, publisher, other_types, context, shutdown)? {
                    break;
                }
                continue;
            }
            Err(error) => return Err(anyhow::Error::new(error).into()),
        }
        turns += 1;
        if args.count == Some(sent) {
            break;
        }
        // From the start on, so that the rate does not drift with the cost of a send.
        let due = start + interval.mul_f64(turns as f64);
        while Instant::now() < due && !shutdown.requested() {
            other_types.look();
            let rest = due.saturating_duration_since(Instant::now());
            context.wake.wait(rest.min(super::WAIT_SLICE));
        }
    }
    Ok(sent)
}
