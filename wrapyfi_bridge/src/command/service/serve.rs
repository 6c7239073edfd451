//! `wrapyfi serve`.

use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    Payload, RosMessage, RosService, ServiceKind, Stamp, Value, fields_of_call, fields_of_return,
};
use wrapyfi_endpoint::{
    Call, Context, EndpointAddress, Request, Role, ServeError, ServeResult, Server, ServiceSpec,
    Throttle, TopicSpec,
};
use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::{as_text, kind, value, wait};
use crate::canonical::canonical;
use crate::cli::ServeArgs;
use crate::command::WAIT_SLICE;
use crate::exit::{Failure, Result};
use crate::middlewares::{conventions, for_service, is_ros};
use crate::shutdown::Shutdown;
use crate::{input, output};

/// Serves until `count` requests were answered or the process is asked to end.
///
/// # Errors
/// Exit code 2 when type, service or reply is wrong, 1 when the transport fails.
pub fn run(args: &ServeArgs, shutdown: &Shutdown) -> Result<()> {
    let options = args.options.of(&args.endpoint.middleware)?;
    let kind = match &args.service_type {
        Some(name) => kind(name, &args.endpoint, &args.definitions)?,
        None if is_ros(&args.endpoint) => {
            return Err(Failure::Usage(format!(
                "{}: --type is needed: NativeObject, Image, CompressedImage, AudioChunk, or any \
                 type as package/srv/Type",
                args.endpoint
            )));
        }
        None => ServiceKind::NativeObject,
    };
    let spec = ServiceSpec { options, ..ServiceSpec::new(&args.endpoint.name, kind) };
    let constant = constant(args, &spec)?;
    let context = Context::default();
    let (own, ports) = (args.options.own, &args.ports);
    let middleware = for_service(&args.endpoint, Role::Server, ports, own)?;
    let mut server = middleware.open_server(&spec, &context).map_err(|error| anyhow!("{error}"))?;
    tracing::info!("serving {kind} at {}", args.endpoint);
    if !conventions(&args.endpoint.middleware).has_service_names {
        tracing::info!("no name travels on ZeroMQ: every request to these ports is served");
    }
    let (mut answered, mut refusals) = (0_u64, Throttle::default());
    while !shutdown.requested() && args.count.is_none_or(|count| answered < count) {
        match server.take() {
            Ok(Some(asked)) => {
                let reply = match &constant {
                    Some(constant) => Ok(stamped(constant)),
                    None => returned(&asked.request, &spec),
                };
                if let Err(reason) = &reply {
                    tracing::warn!("{}: answered with an error: {reason}", args.endpoint);
                }
                answered += 1;
                let told = answer_first(
                    || server.reply(asked.id, reply.map_err(Into::into)),
                    answered,
                    || output::line(&request_shown(&asked.request, args.json)),
                );
                if told.is_err() {
                    finish(server.as_mut(), &context, &args.endpoint);
                    return told;
                }
            }
            Ok(None) => wait(&context.wake, server.deadline()),
            Err(error @ ServeError::Transport { .. }) => {
                return Err(anyhow::Error::new(error).into());
            }
            Err(error) => {
                if let Some(unlogged_before) = refusals.pass(Instant::now()) {
                    tracing::warn!(unlogged_before, "refused a request: {error}");
                }
            }
        }
    }
    finish(server.as_mut(), &context, &args.endpoint);
    Ok(())
}

/// Replies, then prints the request: a client does not wait for the program that reads our output. Returns
/// the result of `print`.
fn answer_first(
    reply: impl FnOnce() -> ServeResult<usize>,
    request: u64,
    print: impl FnOnce() -> Result<()>,
) -> Result<()> {
    // One client that cannot be answered does not end the others' service.
    if let Err(error) = reply() {
        tracing::warn!("request {request} got no reply: {error}");
    }
    print()
}

/// Reply to every request, where it is not made of the request.
fn constant(args: &ServeArgs, spec: &ServiceSpec) -> Result<Option<Payload>> {
    let ServiceKind::Ros(service) = spec.kind else {
        if let Some(file) = &args.file {
            let topic = TopicSpec::new(&spec.service, spec.kind.message_type());
            let payload = input::from_file(file, &topic).map_err(Failure::Failed)?;
            return Ok(Some(topic.conversion().convert(payload, Stamp::now).context("--file")?));
        }
        let Some(text) = &args.value else { return Ok(None) };
        let payload = convert(value("--value", text)?, spec);
        return payload.map(Some).map_err(|error| Failure::Usage(format!("--value: {error}")));
    };
    let (source, text) = match (&args.value, &args.file) {
        (Some(text), _) => ("--value".to_owned(), text.clone()),
        (None, Some(file)) => {
            let text = input::json_text(file, &Limits::default()).map_err(|error| {
                let name = service.name();
                let text = format!("{error:#}; a reply of {name} is a .json file of its fields");
                Failure::Usage(text)
            })?;
            (file.display().to_string(), text)
        }
        (None, None) => return Ok(None),
    };
    let value = value(&source, &text)?;
    let fields = fields_of_return(service.response(), &value, spec.limits.message_bytes);
    let reply = fields.map_err(|error| error.to_string()).and_then(|of| replied(service, &of));
    reply.map(Some).map_err(|error| {
        Failure::Usage(format!("{source} is no reply of {}: {error}", service.name()))
    })
}

/// Reply that is made of a request: the argument of a function, a list of them where there is not one;
/// of any other service the fields that the request has, too, and `success`.
fn returned(request: &Request, spec: &ServiceSpec) -> Result<Payload, String> {
    let ServiceKind::Ros(service) = spec.kind else {
        let call = request.call().map_err(|error| error.to_string())?;
        return convert(only(call.args.clone()), spec);
    };
    let limit = spec.limits.message_bytes;
    let asked = match request {
        Request::Message(message) => message.fields(limit).map_err(|error| error.to_string())?,
        Request::Call(Call { args, kwargs }) => {
            fields_of_call(service.request(), args, kwargs, limit)
                .map_err(|error| error.to_string())?
        }
    };
    let mut reply = service.response().plan().default_message();
    let own: Vec<String> = reply.fields().map(|(name, _)| name.to_owned()).collect();
    for name in own {
        let value = asked.get(&name).cloned();
        let value = value.or_else(|| (name == "success").then(|| true.into()));
        if let Some(value) = value
            && let Err(error) = reply.set(&name, value)
        {
            tracing::debug!("{name} keeps its default: {error}");
        }
    }
    replied(service, &reply)
}

fn replied(service: RosService, fields: &DynamicMessage) -> Result<Payload, String> {
    let message = RosMessage::from_fields(service.response(), fields);
    message.map(Payload::from).map_err(|error| error.to_string())
}

/// The one argument, or a list of them where there is not one.
fn only(mut args: Vec<Value>) -> Value {
    if args.len() == 1 { args.pop().unwrap_or_default() } else { Value::List(args) }
}

fn convert(value: Value, spec: &ServiceSpec) -> Result<Payload, String> {
    let conversion = TopicSpec::new(&spec.service, spec.kind.message_type()).conversion();
    conversion.convert(value.into(), Stamp::now).map_err(|error| error.to_string())
}

/// The payload as if it were made now.
fn stamped(payload: &Payload) -> Payload {
    let mut payload = payload.clone();
    input::restamp(&mut payload, false);
    payload
}

fn request_shown(request: &Request, as_json: bool) -> String {
    let text = match request {
        Request::Message(message) => as_text(message, as_json),
        Request::Call(call) => Ok(call_shown(call, as_json)),
    };
    text.unwrap_or_else(|error| format!("a request that cannot be read: {error}"))
}

fn call_shown(Call { args, kwargs }: &Call, as_json: bool) -> String {
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
    use std::cell::RefCell;

    use wrapyfi_data::types::Map;

    use super::*;

    #[test]
    fn the_reply_goes_before_the_request_is_printed() {
        let too_late = ServeError::NotWaiting { service: "/add".into(), timeout_ms: 5 };
        for replied in [Ok(0), Err(too_late)] {
            let done = RefCell::new(Vec::new());
            let told = answer_first(
                || {
                    done.borrow_mut().push("replied");
                    replied
                },
                1,
                || {
                    done.borrow_mut().push("printed");
                    Err(Failure::Unread)
                },
            );
            assert!(matches!(told, Err(Failure::Unread)));
            assert_eq!(*done.borrow(), ["replied", "printed"]);
        }
    }

    #[test]
    fn arguments_come_back_as_the_kind_that_is_served() {
        let returned =
            |args: Vec<Value>, kind| returned(&Request::new(args), &ServiceSpec::new("/x", kind));
        let native = returned(vec![1.into(), 2.into()], ServiceKind::NativeObject);
        assert_eq!(native, Ok(Value::List(vec![1.into(), 2.into()]).into()));
        let one = returned(vec!["a".into()], ServiceKind::NativeObject);
        assert_eq!(one, Ok(Value::from("a").into()));
        let none = returned(vec!["a".into()], ServiceKind::Image).unwrap_err();
        assert!(none.contains("expected an image"), "{none}");
    }

    #[test]
    fn requests_are_shown_in_one_line() {
        let request = Call { args: vec![1.into(), "a".into()], kwargs: Map::from([("k", 0.5)]) };
        assert_eq!(call_shown(&request, false), r#"args: [1,"a"] kwargs: {"k":0.5}"#);
        let json = r#"{"type":"Request","args":[1,"a"],"kwargs":{"k":0.5}}"#;
        assert_eq!(call_shown(&request, true), json);
    }
}
