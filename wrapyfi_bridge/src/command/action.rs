//! `wrapyfi action`: goals, their feedback and results, of any middleware.
//!
//! ```text
//!   send    --value ─▶ ActionClient ══▶ server elsewhere       printed ◀─ state, feedback, result
//!   serve   goals elsewhere ══▶ ActionServer ─▶ printed        --feedback, --value ─▶ their clients
//!   cancel  asks a server to give up all its goals
//! ```

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Payload, RosAction, RosMessage, RosType, fields_of_return};
use wrapyfi_endpoint::codec::requests::asked_message;
use wrapyfi_endpoint::{
    ActionClient, ActionServer, ActionSpec, Context, EndpointAddress, GoalNumber, GoalOutcome,
    GoalRequest, GoalUpdate, Interaction, Link, Middleware, Request, Role,
};

use super::announced::Announced;
use super::echo::Waiting;
use super::service::{as_text, call, value, wait};
use super::{definitions, list};
use crate::cli::{ActionCommand, ActionEndpoint, ActionSendArgs, ActionServeArgs, ServicePorts};
use crate::exit::{Failure, Result};
use crate::middlewares::{carries, for_service, is_ros};
use crate::output;
use crate::own_address::OwnAddress;
use crate::shutdown::Shutdown;

/// Time for which a cancelled goal is waited for once the command is asked to end.
const CANCEL_TIMEOUT: Duration = Duration::from_millis(1500);

/// Runs a subcommand of `action`.
///
/// # Errors
/// Exit code 3 when there was no server in time, 2 when type or goal is wrong, 1 when the goal did not succeed.
pub fn run(command: &ActionCommand, shutdown: &Shutdown) -> Result<()> {
    match command {
        ActionCommand::List(args) => list::of(args, Some(Interaction::Action), None, shutdown),
        ActionCommand::Info { endpoint, args } => {
            let args = args.of(&endpoint.middleware);
            list::of(&args, Some(Interaction::Action), Some(&endpoint.name), shutdown)
        }
        ActionCommand::Send(args) => send(args, shutdown),
        ActionCommand::Serve(args) => serve(args, shutdown),
        ActionCommand::Cancel { at, timeout } => cancel(at, *timeout, shutdown),
    }
}

/// Middleware, which ends its endpoints with it, and a client of an action there, with its context; `None` when asked to end
/// before there was a server.
type Opened = Option<(Arc<dyn Middleware>, Box<dyn ActionClient>, Context)>;

fn client(
    at: &ActionEndpoint,
    timeout: Duration,
    check: impl FnOnce(RosAction) -> Result<()>,
    shutdown: &Shutdown,
) -> Result<Opened> {
    let options = at.options.of(&at.endpoint.middleware)?;
    let begin = Instant::now();
    let role = if is_ros(&at.endpoint) { Role::ActionClient } else { Role::Client };
    let middleware = for_service(&at.endpoint, role, &at.ports, at.options.own)?;
    let context = Context::default();
    let kind = match &at.action_type {
        Some(name) => Some(given(name, &at.definitions)?),
        None if !carries(&at.endpoint.middleware, Interaction::Action) => {
            let text = "--type is needed: a function does not tell the type of an action";
            return Err(Failure::Usage(format!("{}: {text}", at.endpoint)));
        }
        None => servers(&at.endpoint, &at.definitions, timeout).learned(
            &*middleware,
            &context.wake,
            shutdown,
        )?,
    };
    let Some(kind) = kind else { return Ok(None) };
    check(kind)?;
    let spec = ActionSpec { options, ..ActionSpec::new(&at.endpoint.name, kind) };
    let client = middleware.open_action_client(&spec, &context).map_err(Failure::usage)?;
    let mut waiting = Waiting::new(&at.endpoint);
    while !client.link().has_peers() {
        if shutdown.requested() {
            return Ok(None);
        }
        let left = timeout.saturating_sub(begin.elapsed());
        let Link { waiting_for, .. } = client.link();
        let what = waiting_for.map_or_else(|| "a server".to_owned(), |what| what.to_string());
        if left.is_zero() {
            return Err(Failure::TimedOut(format!(
                "{}: time-out, waiting for {what}",
                at.endpoint
            )));
        }
        waiting.say(&what);
        wait(&context.wake, Some(Instant::now() + left));
    }
    Ok(Some((middleware, client, context)))
}

/// Type of an action as its servers tell it, which are waited for at most `timeout`. `None` when asked to end before.
///
/// # Errors
/// As [`run`].
pub fn type_of(
    endpoint: &EndpointAddress,
    timeout: Duration,
    shutdown: &Shutdown,
) -> Result<Option<RosAction>> {
    let (ports, own) = (ServicePorts::default(), OwnAddress::default());
    let middleware = for_service(endpoint, Role::ActionClient, &ports, own)?;
    let context = Context::default();
    servers(endpoint, &[], timeout).learned(&*middleware, &context.wake, shutdown)
}

fn servers<'a>(
    endpoint: &'a EndpointAddress,
    definitions: &'a [PathBuf],
    timeout: Duration,
) -> Announced<'a, RosAction> {
    Announced {
        endpoint,
        role: Role::ActionServer,
        definitions,
        timeout,
        learn: |middleware, one, types| middleware.learn_action(one, types),
    }
}

fn given(name: &str, folders: &[PathBuf]) -> Result<RosAction> {
    RosAction::resolve(name, &mut definitions::of_command(folders)?)
        .map_err(|error| Failure::Usage(format!("{error} (--definitions DIR)")))
}

/// Sends one goal and prints what becomes of it.
fn send(args: &ActionSendArgs, shutdown: &Shutdown) -> Result<()> {
    let goal: Request = call::call_of(args.value.as_deref(), None, args.args.as_deref())?.into();
    let check = |kind: RosAction| {
        let most = Limits::default().message_bytes;
        asked_message(&goal, kind.goal(), most)
            .map(drop)
            .map_err(|error| Failure::Usage(format!("the value is no goal of {kind}: {error}")))
    };
    let Some((_middleware, mut client, context)) = client(&args.at, args.timeout, check, shutdown)?
    else {
        return Err(interrupted(&args.at.endpoint));
    };
    let ticket = client.send(&goal).map_err(Failure::usage)?;
    let mut cancelled: Option<Instant> = None;
    loop {
        while let Some((_, update)) = client.take() {
            if let GoalUpdate::Feedback(_) = update
                && args.no_feedback
            {
                continue;
            }
            output::line(&shown(&update, args.json)?)?;
            match update {
                GoalUpdate::Ended { outcome: GoalOutcome::Succeeded, .. } => return Ok(()),
                GoalUpdate::Ended { outcome, text, .. } => {
                    return Err(not_reached(&args.at.endpoint, &outcome.to_string(), &text));
                }
                GoalUpdate::Rejected(text) => {
                    return Err(not_reached(&args.at.endpoint, "rejected", &text));
                }
                _ => {}
            }
        }
        match cancelled {
            None if shutdown.requested() => {
                client.cancel(ticket);
                cancelled = Some(Instant::now() + CANCEL_TIMEOUT);
                continue;
            }
            Some(until) if Instant::now() >= until => return Err(interrupted(&args.at.endpoint)),
            _ => wait(&context.wake, client.deadline()),
        }
    }
}

fn interrupted(endpoint: &EndpointAddress) -> Failure {
    anyhow!("{endpoint}: interrupted before the goal had ended").into()
}

fn not_reached(endpoint: &EndpointAddress, how: &str, text: &str) -> Failure {
    let why = if text.is_empty() { String::new() } else { format!(": {text}") };
    anyhow!("{endpoint}: the goal was {how}{why}").into()
}

/// An update as a line of JSON, or as a person reads it.
fn shown(update: &GoalUpdate, as_json: bool) -> Result<String> {
    let (word, text, payload) = match update {
        GoalUpdate::Accepted => ("accepted", "", None),
        GoalUpdate::Rejected(text) => ("rejected", text.as_str(), None),
        GoalUpdate::Executing => ("executing", "", None),
        GoalUpdate::Canceling => ("canceling", "", None),
        GoalUpdate::CancelRefused(text) => ("cancel_refused", text.as_str(), None),
        GoalUpdate::Feedback(payload) => ("feedback", "", Some(payload)),
        GoalUpdate::Ended { outcome, result, text } => {
            let word = match outcome {
                GoalOutcome::Succeeded => "succeeded",
                GoalOutcome::Canceled => "canceled",
                GoalOutcome::Aborted => "aborted",
            };
            (word, text.as_str(), result.as_ref())
        }
    };
    let message = match payload {
        Some(Payload::RosMessage(message)) => Some(message),
        _ => None,
    };
    if as_json {
        let mut line = format!("{{\"goal\":\"{word}\"");
        if !text.is_empty() {
            line += &format!(",\"text\":{}", serde_json::Value::from(text));
        }
        if let Some(message) = message {
            let fields = message.fields(message.cdr.len()).map_err(anyhow::Error::new)?;
            // The message itself keeps the order of its fields; a JSON value would sort them.
            line += &format!(
                ",\"value\":{}",
                serde_json::to_string(&fields).map_err(anyhow::Error::new)?
            );
        }
        return Ok(line + "}");
    }
    let mut shown = word.replace('_', " ");
    if !text.is_empty() {
        shown += &format!(": {text}");
    }
    if let Some(message) = message {
        shown += ":";
        for line in as_text(message, false)?.lines().filter(|line| *line != "---") {
            shown += &format!("\n  {line}");
        }
    }
    Ok(shown)
}

/// Offers an action until `count` goals have ended or the process is asked to end: each goal is accepted, has its
/// feedback, and ends after the time that was given, or when a client cancels it.
fn serve(args: &ActionServeArgs, shutdown: &Shutdown) -> Result<()> {
    let at = &args.at;
    let options = at.options.of(&at.endpoint.middleware)?;
    let Some(name) = &at.action_type else {
        let text = format!("{}: --type is needed, as package/action/Type", at.endpoint);
        return Err(Failure::Usage(text));
    };
    let kind = given(name, &at.definitions)?;
    let result = message("--value", args.value.as_deref(), kind.result())?;
    let feedback = match &args.feedback {
        Some(text) => Some(message("--feedback", Some(text), kind.feedback())?),
        None => None,
    };
    let middleware = for_service(&at.endpoint, Role::ActionServer, &at.ports, at.options.own)?;
    let context = Context::default();
    let spec = ActionSpec { options, ..ActionSpec::new(&at.endpoint.name, kind) };
    let mut server = middleware.open_action_server(&spec, &context).map_err(Failure::usage)?;
    tracing::info!("serving {kind} at {}", at.endpoint);
    let mut goals: Vec<(GoalNumber, Instant)> = Vec::new();
    let (mut ended, mut next_feedback) = (0_u64, Instant::now());
    let mut waiting = Waiting::new(&at.endpoint);
    while !shutdown.requested() && args.count.is_none_or(|count| ended < count) {
        if let Some(what) = server.link().waiting_for {
            waiting.say(&what);
        }
        match server.take() {
            Ok(Some(GoalRequest::Goal { number, goal, .. })) => {
                let most = spec.limits.message_bytes;
                match asked_message(&goal, kind.goal(), most) {
                    Ok(message) => output::line(as_text(&message, args.json)?.trim_end())?,
                    Err(error) => tracing::warn!("{}: {error}", at.endpoint),
                }
                tell(&mut *server, number, GoalUpdate::Accepted);
                tell(&mut *server, number, GoalUpdate::Executing);
                goals.push((number, Instant::now() + args.seconds));
                continue;
            }
            Ok(Some(GoalRequest::Cancel(number))) => {
                if let Some(at) = goals.iter().position(|(one, _)| *one == number) {
                    goals.remove(at);
                    tell(&mut *server, number, GoalUpdate::Canceling);
                    tell(&mut *server, number, end(GoalOutcome::Canceled, &result));
                    ended += 1;
                }
                continue;
            }
            Ok(Some(GoalRequest::CancelAll)) => continue,
            Ok(None) => {}
            Err(error) => tracing::warn!("refused a goal: {error}"),
        }
        let now = Instant::now();
        let is_due = !goals.is_empty() && now >= next_feedback;
        if let Some(feedback) = feedback.as_ref().filter(|_| is_due) {
            for (number, _) in &goals {
                tell(&mut *server, *number, GoalUpdate::Feedback(feedback.clone().into()));
            }
            next_feedback = now + args.every;
        }
        let outcome = if args.abort { GoalOutcome::Aborted } else { GoalOutcome::Succeeded };
        for (number, _) in goals.extract_if(.., |(_, due)| now >= *due) {
            tell(&mut *server, number, end(outcome, &result));
            ended += 1;
        }
        let due = goals.iter().map(|(_, due)| *due).chain(server.deadline());
        let next = feedback.is_some().then_some(next_feedback).filter(|_| !goals.is_empty());
        wait(&context.wake, due.chain(next).min());
    }
    // Results of goals that have ended may still be asked for.
    let until = Instant::now() + CANCEL_TIMEOUT;
    while server.kept() > 0 && Instant::now() < until {
        if server.take().is_err() {
            break;
        }
        wait(&context.wake, Some(until));
    }
    Ok(())
}

fn end(outcome: GoalOutcome, result: &RosMessage) -> GoalUpdate {
    GoalUpdate::Ended { outcome, result: Some(result.clone().into()), text: String::new() }
}

fn tell(server: &mut dyn ActionServer, number: GoalNumber, update: GoalUpdate) {
    if let Err(error) = server.update(number, update) {
        tracing::warn!("an update was not sent: {error}");
    }
}

/// The message that an option gives by its fields.
fn message(option: &str, text: Option<&str>, ros_type: RosType) -> Result<RosMessage> {
    let value = value(option, text.unwrap_or("{}"))?;
    let wrong = |error: String| Failure::Usage(format!("{option} is no {ros_type}: {error}"));
    let fields = fields_of_return(ros_type, &value, Limits::default().message_bytes)
        .map_err(|error| wrong(error.to_string()))?;
    RosMessage::from_fields(ros_type, &fields).map_err(|error| wrong(error.to_string()))
}

/// Asks the server to give up all its goals.
fn cancel(at: &ActionEndpoint, timeout: Duration, shutdown: &Shutdown) -> Result<()> {
    /// Time in which a request that was handed to the transport leaves the process.
    const SENT_WITHIN: Duration = Duration::from_millis(300);
    let Some((_middleware, mut client, _)) = client(at, timeout, |_| Ok(()), shutdown)? else {
        return Err(interrupted(&at.endpoint));
    };
    client.cancel_all().map_err(|error| Failure::Failed(error.into()))?;
    let until = Instant::now() + SENT_WITHIN;
    while Instant::now() < until {
        client.take();
        std::thread::sleep(Duration::from_millis(10));
    }
    output::line("asked for the end of all goals")
}
