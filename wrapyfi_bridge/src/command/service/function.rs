//! `call` and `serve` of functions of Wrapyfi, on any middleware.
//!
//! ```text
//!   --args, --kwargs ─▶ Request ─▶ Client ══▶ Server ─▶ printed
//!   printed ◀───────── Payload ◀─ Client ◀══ Server ◀─ --echo, --value, --file
//! ```

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use bytes::Bytes;
use wrapyfi_core::Limits;
use wrapyfi_core::codec::{self, json};
use wrapyfi_core::endpoint::{
    Call, CallError, Context, EndpointAddress, Request, ServeError, Server, ServiceSpec, TopicSpec,
};
use wrapyfi_core::middleware::{ros1, yarp};
use wrapyfi_core::types::{Map, Payload, ServiceKind, Stamp, Value};

use crate::canonical::canonical;
use crate::cli::{CallArgs, ServeArgs, ServiceName};
use crate::command::{WAIT_SLICE, any};
use crate::describe::{describe, summary};
use crate::exit::Failure;
use crate::middlewares::{Middlewares, Role};
use crate::shutdown::Shutdown;
use crate::{input, output};

/// Calls once and prints what the function returned.
///
/// # Errors
/// Exit code 3 when there was no reply in time, 2 when type or arguments are wrong, 1 when the server
/// answered with an error.
pub(super) fn call(args: &CallArgs, mut options: Map, shutdown: &Shutdown) -> Result<(), Failure> {
    let kind = match &args.service_type {
        None => ServiceKind::NativeObject,
        Some(name) => kind(name, &args.endpoint, &args.definitions)?,
    };
    let request = match &args.value {
        // The one argument of a function; of any other service its fields.
        Some(text) => Request::new([value("--value", text)?]),
        None => Request::new(arguments("--args", args.args.as_deref())?)
            .with(keywords("--kwargs", args.kwargs.as_deref())?),
    };
    if args.endpoint.middleware == yarp::NAME && options.get("bottle").is_none() {
        // A robot's port reads bottles, a function of Wrapyfi JSON; the name server tells them apart.
        options.insert("bottle", "auto");
    }
    let spec = ServiceSpec { options, ..ServiceSpec::new(&args.endpoint.name, kind) };
    let context = Context::default();
    let (own, ports) = (args.options.own, &args.ports);
    let middlewares = Middlewares::for_service(&args.endpoint, Role::Client, ports, own)?;
    let middleware =
        middlewares.registry().get(&args.endpoint.middleware).map_err(Failure::usage)?;
    let mut client = middleware.open_client(&spec, &context).map_err(Failure::usage)?;
    let ticket = client.send(&request, args.timeout).map_err(Failure::usage)?;
    while !shutdown.requested() {
        let Some(result) = client.take_only(ticket) else {
            let until = client.deadline().map(left);
            context.wake.wait(until.unwrap_or(WAIT_SLICE).min(WAIT_SLICE));
            continue;
        };
        // Of a service of ROS, the fields of its reply.
        let payload = converted(result.map_err(failed)?.payload, &spec).map_err(Failure::Failed)?;
        let text = if args.json { describe(&payload) } else { summary(&payload) };
        return output::line(&text.to_string());
    }
    Err(anyhow!("{}: interrupted before there was a reply", args.endpoint).into())
}

fn failed(error: CallError) -> Failure {
    match error {
        CallError::TimedOut { .. } => Failure::TimedOut(error.to_string()),
        _ => Failure::Failed(anyhow::Error::new(error)),
    }
}

fn left(at: Instant) -> Duration {
    at.saturating_duration_since(Instant::now())
}

/// Kind of the service: a function of Wrapyfi, or on all middlewares but ZeroMQ any service.
fn kind(
    name: &ServiceName,
    endpoint: &EndpointAddress,
    folders: &[PathBuf],
) -> Result<ServiceKind, Failure> {
    if endpoint.middleware == "zeromq" {
        return name.0.parse().map_err(Failure::usage);
    }
    let mut store = any::definitions(folders)
        .map_err(|failure| Failure::Usage(format!("--definitions {failure}")))?;
    ServiceKind::resolve(&name.0, &mut store)
        .map_err(|error| Failure::Usage(format!("{error} (--definitions DIR)")))
}

/// Positional arguments: a JSON list in Wrapyfi's dialect.
fn arguments(option: &str, text: Option<&str>) -> Result<Vec<Value>, Failure> {
    match value(option, text.unwrap_or("[]"))? {
        Value::List(args) | Value::Tuple(args) => Ok(args),
        other => Err(Failure::Usage(format!(
            "{option} is {}; it must be a JSON list",
            canonical(&other)
        ))),
    }
}

/// Keyword arguments: a JSON object in Wrapyfi's dialect.
fn keywords(option: &str, text: Option<&str>) -> Result<Map, Failure> {
    match value(option, text.unwrap_or("{}"))? {
        Value::Map(kwargs) => Ok(kwargs),
        other => Err(Failure::Usage(format!(
            "{option} is {}; it must be a JSON object",
            canonical(&other)
        ))),
    }
}

fn value(option: &str, text: &str) -> Result<Value, Failure> {
    json::decode(&Bytes::copy_from_slice(text.as_bytes()), &Limits::default())
        .map_err(|error| Failure::Usage(format!("{option}: {error}")))
}

/// Serves until `count` requests were answered or the process is asked to end.
///
/// # Errors
/// Exit code 2 when type, service or reply is wrong, 1 when the transport fails.
pub(super) fn serve(args: &ServeArgs, options: Map, shutdown: &Shutdown) -> Result<(), Failure> {
    let kind = match (&args.service_type, args.endpoint.middleware.as_str()) {
        (Some(name), _) => kind(name, &args.endpoint, &args.definitions)?,
        (None, "ros2" | ros1::NAME) => return Err(super::no_type(&args.endpoint)),
        (None, _) => ServiceKind::NativeObject,
    };
    let spec = ServiceSpec { options, ..ServiceSpec::new(&args.endpoint.name, kind) };
    let constant = constant(args, &spec)?;
    let context = Context::default();
    let (own, ports) = (args.options.own, &args.ports);
    let middlewares = Middlewares::for_service(&args.endpoint, Role::Server, ports, own)?;
    let middleware =
        middlewares.registry().get(&args.endpoint.middleware).map_err(Failure::usage)?;
    let mut server = middleware.open_server(&spec, &context).map_err(|error| anyhow!("{error}"))?;
    tracing::info!("serving {kind} at {}", args.endpoint);
    if args.endpoint.middleware == "zeromq" {
        tracing::info!("no name travels on ZeroMQ: every request to these ports is served");
    }
    let mut answered = 0_u64;
    while !shutdown.requested() && args.count.is_none_or(|count| answered < count) {
        match server.take() {
            Ok(Some(asked)) => {
                let (id, call) = (asked.id, asked.request.into_call());
                let reply = match (&constant, &call) {
                    (_, Err(error)) => Err(error.to_string()),
                    (Some(constant), Ok(_)) => Ok(stamped(constant)),
                    (None, Ok(call)) => returned(call.args.clone(), &spec),
                };
                if let Err(reason) = &reply {
                    tracing::warn!("{}: answered with an error: {reason}", args.endpoint);
                }
                let told = output::line(&shown(&call.unwrap_or_default(), args.json));
                if let Err(error) = server.reply(id, reply.map_err(Into::into)) {
                    tracing::warn!("a reply was not sent: {error}");
                }
                answered += 1;
                if told.is_err() {
                    finish(server.as_mut(), &context, &args.endpoint);
                    return told;
                }
            }
            Ok(None) => {
                let until = server.deadline().map(left);
                context.wake.wait(until.unwrap_or(WAIT_SLICE).min(WAIT_SLICE));
            }
            Err(error @ ServeError::Transport { .. }) => {
                return Err(anyhow::Error::new(error).into());
            }
            Err(error) => tracing::warn!("refused a request: {error}"),
        }
    }
    finish(server.as_mut(), &context, &args.endpoint);
    Ok(())
}

/// Reply to every request, where it is not the request's argument.
fn constant(args: &ServeArgs, spec: &ServiceSpec) -> Result<Option<Payload>, Failure> {
    if let Some(file) = &args.file {
        let topic = TopicSpec::new(&spec.service, spec.kind.message_type());
        return input::from_file(file, &topic).map(Some).map_err(Failure::Failed);
    }
    let Some(text) = &args.value else { return Ok(None) };
    let value = value("--value", text)?;
    let payload =
        convert(value, spec).map_err(|error| Failure::Usage(format!("--value: {error}")))?;
    Ok(Some(payload))
}

/// The argument of a call as what the function returns; a list of them where there is not one.
fn returned(mut args: Vec<Value>, spec: &ServiceSpec) -> Result<Payload, String> {
    let value = if args.len() == 1 { args.pop().unwrap_or_default() } else { Value::List(args) };
    convert(value, spec)
}

fn convert(value: Value, spec: &ServiceSpec) -> Result<Payload, String> {
    converted(value.into(), spec).map_err(|error| error.to_string())
}

fn converted(payload: Payload, spec: &ServiceSpec) -> anyhow::Result<Payload> {
    let (to, color_order) = (spec.kind.message_type(), spec.color_order);
    Ok(codec::convert_payload(payload, to, color_order, &spec.limits, Stamp::now)?)
}

/// The payload as if it were made now.
fn stamped(payload: &Payload) -> Payload {
    let mut payload = payload.clone();
    match &mut payload {
        Payload::Image(image) => image.stamp = Stamp::now(),
        Payload::AudioChunk(sound) => sound.stamp = Stamp::now(),
        _ => {}
    }
    payload
}

fn shown(Call { args, kwargs }: &Call, as_json: bool) -> String {
    let args = canonical(&Value::List(args.clone()));
    let kwargs = canonical(&Value::Map(kwargs.clone()));
    if as_json {
        format!(r#"{{"type":"Request","args":{args},"kwargs":{kwargs}}}"#)
    } else {
        format!("args: {args} kwargs: {kwargs}")
    }
}

/// Gives kept replies the time to go out, and says what was not served.
fn finish(server: &mut dyn Server, context: &Context, endpoint: &EndpointAddress) {
    /// Longest wait: longer than discovery takes; the process must end within two seconds.
    const TIMEOUT: Duration = Duration::from_secs(1);
    let end = Instant::now() + TIMEOUT;
    while server.kept() > 0 && Instant::now() < end {
        context.wake.wait(WAIT_SLICE);
        server.flush();
    }
    for (reason, count) in context.counters.snapshot().drops {
        tracing::warn!("{endpoint}: {count} requests or replies dropped: {reason}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_arguments_are_named() {
        for (args, words) in
            [("{}", "--args is {}; it must be a JSON list"), ("[", "--args: malformed JSON")]
        {
            let error = arguments("--args", Some(args)).unwrap_err().to_string();
            assert!(error.starts_with(words), "{error}");
        }
        let error = keywords("--kwargs", Some("[]")).unwrap_err().to_string();
        assert_eq!(error, "--kwargs is []; it must be a JSON object");
        assert_eq!(arguments("--args", None).unwrap(), []);
        assert!(keywords("--kwargs", None).unwrap().is_empty());
    }

    #[test]
    fn arguments_come_back_as_the_kind_that_is_served() {
        let spec = |kind| ServiceSpec::new("/x", kind);
        let native = returned(vec![1.into(), 2.into()], &spec(ServiceKind::NativeObject));
        assert_eq!(native, Ok(Value::List(vec![1.into(), 2.into()]).into()));
        let one = returned(vec!["a".into()], &spec(ServiceKind::NativeObject));
        assert_eq!(one, Ok(Value::from("a").into()));
        let none = returned(vec!["a".into()], &spec(ServiceKind::Image)).unwrap_err();
        assert!(none.contains("expected an image"), "{none}");
    }

    #[test]
    fn requests_are_shown_in_one_line() {
        let request = Call { args: vec![1.into(), "a".into()], kwargs: Map::from([("k", 0.5)]) };
        assert_eq!(shown(&request, false), r#"args: [1,"a"] kwargs: {"k":0.5}"#);
        let json = r#"{"type":"Request","args":[1,"a"],"kwargs":{"k":0.5}}"#;
        assert_eq!(shown(&request, true), json);
    }
}
