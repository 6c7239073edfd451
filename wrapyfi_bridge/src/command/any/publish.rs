//! `wrapyfi pub ros2:/topic` of any type.

use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_core::Limits;
use wrapyfi_core::endpoint::{Durability, Middleware as _, Qos, Wake};
use wrapyfi_core::middleware::ros2::AnyPublisher;
use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::{Strangers, resolve};
use crate::cli::PubArgs;
use crate::command::WAIT_SLICE;
use crate::exit::Failure;
use crate::middlewares::Middlewares;
use crate::shutdown::Shutdown;

/// Waits for a subscription, then publishes until `count` is reached or the process is asked to end.
///
/// # Errors
/// Exit code 3 when no subscription came in time, 2 when type, endpoint or value is wrong.
pub fn run(args: &PubArgs, name: &str, shutdown: &Shutdown) -> Result<(), Failure> {
    let resolved = resolve(name, &args.definitions)?;
    let limit = Limits::default().message_bytes;
    let plan = resolved.plan().map_err(Failure::usage)?;
    let json = json(args).map_err(|error| Failure::usage(format!("{error:#}")))?;
    let message = plan
        .from_json(&json, limit)
        .map_err(|error| Failure::Usage(format!("the value is no {name}: {error}")))?;
    let ros2 = Middlewares::ros2_of_command()?;
    let wake = Wake::new();
    let qos = Qos::from(args.qos);
    let mut publisher =
        AnyPublisher::open(&ros2, &args.endpoint.name, &resolved, qos, limit, &wake)
            .map_err(Failure::usage)?;
    let mut strangers = Strangers::new(ros2.discover().context("ros2")?);
    let keeps_last = qos.durability == Durability::TransientLocal;
    if !keeps_last && !wait_for_listener(args, &publisher, &mut strangers, &wake, shutdown)? {
        return Ok(());
    }
    let sent = publish(args, &mut publisher, &message, &mut strangers, &wake, shutdown)?;
    tracing::info!("published {sent} {name} to {}", args.endpoint);
    Ok(())
}

fn json(args: &PubArgs) -> anyhow::Result<serde_json::Value> {
    match (&args.value, &args.file) {
        (Some(text), _) => serde_json::from_str(text).context("--value"),
        (None, Some(file)) => {
            let name = file.display();
            let limit = Limits::default().message_bytes as u64;
            let size = std::fs::metadata(file).with_context(|| format!("{name}"))?.len();
            if size > limit {
                return Err(anyhow!("{name} has {size} bytes, the limit is {limit}"));
            }
            let text = std::fs::read_to_string(file).with_context(|| format!("{name}"))?;
            serde_json::from_str(&text).with_context(|| format!("{name}"))
        }
        (None, None) => Err(anyhow!("give --value or --file")),
    }
}

/// False when asked to end.
fn wait_for_listener(
    args: &PubArgs,
    publisher: &AnyPublisher,
    strangers: &mut Strangers,
    wake: &Wake,
    shutdown: &Shutdown,
) -> Result<bool, Failure> {
    let deadline = args.timeout.map(|timeout| Instant::now() + timeout);
    let mut told = false;
    while !shutdown.requested() {
        if publisher.listeners() > 0 {
            return Ok(true);
        }
        strangers.look(publisher.topic());
        if deadline.is_some_and(|at| Instant::now() >= at) {
            let why = match publisher.incompatible() {
                Some(policy) => format!("; one asks for another {policy}: give --qos"),
                None => String::new(),
            };
            let text =
                format!("time-out while waiting for a subscription on {}{why}", args.endpoint);
            return Err(Failure::TimedOut(text));
        }
        if !std::mem::replace(&mut told, true) {
            tracing::info!("waiting for a subscription on {}", args.endpoint);
        }
        wake.wait(WAIT_SLICE);
    }
    Ok(false)
}

fn publish(
    args: &PubArgs,
    publisher: &mut AnyPublisher,
    message: &DynamicMessage,
    strangers: &mut Strangers,
    wake: &Wake,
    shutdown: &Shutdown,
) -> Result<u64, Failure> {
    let interval = Duration::from_secs_f64(1.0 / args.rate);
    // Peers that are matched now were discovered before.
    strangers.look_now(publisher.topic());
    let start = Instant::now();
    let mut sent = 0_u64;
    while args.count.is_none_or(|count| sent < count) && !shutdown.requested() {
        publisher.publish(message).map_err(anyhow::Error::new)?;
        sent += 1;
        if args.count == Some(sent) {
            break;
        }
        let due = start + interval.mul_f64(sent as f64);
        while Instant::now() < due && !shutdown.requested() {
            strangers.look(publisher.topic());
            wake.wait(due.saturating_duration_since(Instant::now()).min(WAIT_SLICE));
        }
    }
    Ok(sent)
}
