//! `wrapyfi call`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Map, MessageType, Payload, ServiceKind, Stamp, Value, fields_of_call};
use wrapyfi_endpoint::{Call, CallError, Context, EndpointAddress, Role, ServiceSpec, TopicSpec};
use wrapyfi_yarp_endpoint as yarp;

use super::{as_text, kind, value, wait};
use crate::canonical::canonical;
use crate::cli::{CallArgs, ServicePorts};
use crate::command::announced::Announced;
use crate::command::echo::Waiting;
use crate::describe::{describe, summary};
use crate::exit::{Failure, Result};
use crate::middlewares::{for_service, is_ros, option_names};
use crate::own_address::OwnAddress;
use crate::shutdown::Shutdown;
use crate::why::question::inactive_at;
use crate::words::words;
use crate::{input, output};

/// Calls once and prints the reply.
///
/// # Errors
/// Exit code 3 when there was no reply in time, 2 when type, service or request is wrong, 1 when the
/// server answered with an error.
pub fn run(args: &CallArgs, shutdown: &Shutdown) -> Result<()> {
    called(args, shutdown).map_err(|failure| match failure {
        Failure::TimedOut(text) if is_ros(&args.endpoint) => {
            let more =
                inactive_at(&args.endpoint).map(|it| format!("; {}: {}", it.what, it.remedy));
            Failure::TimedOut(text + &more.unwrap_or_default())
        }
        other => other,
    })
}

fn called(args: &CallArgs, shutdown: &Shutdown) -> Result<()> {
    let mut options = args.options.of(&args.endpoint.middleware)?;
    let begin = Instant::now();
    let named = match &args.service_type {
        Some(name) => Some(kind(name, &args.endpoint, &args.definitions)?),
        None if is_ros(&args.endpoint) => None,
        None => Some(ServiceKind::NativeObject),
    };
    let request = request(args)?;
    if let Some(kind) = named {
        check(&request, kind)?;
    }
    let has_bottles = option_names(&args.endpoint.middleware).contains(&"bottle");
    if has_bottles && options.get("bottle").is_none() {
        // A robot's port reads bottles, a function of Wrapyfi JSON; the name server tells them apart.
        options.insert("bottle", "auto");
    }
    let (own, ports) = (args.options.own, &args.ports);
    let middleware = for_service(&args.endpoint, Role::Client, ports, own)?;
    let context = Context::default();
    let kind = match named {
        Some(kind) => kind,
        None => match servers(&args.endpoint, &args.definitions, args.timeout).learned(
            &*middleware,
            &context.wake,
            shutdown,
        )? {
            Some(kind) => {
                check(&request, kind)?;
                kind
            }
            None => return Ok(()),
        },
    };
    let spec = ServiceSpec { options, ..ServiceSpec::new(&args.endpoint.name, kind) };
    let mut client = middleware.open_client(&spec, &context).map_err(Failure::usage)?;
    let left = args.timeout.saturating_sub(begin.elapsed());
    let ticket = client.send(&request.into(), left).map_err(Failure::usage)?;
    let mut waiting = Waiting::new(&args.endpoint);
    while !shutdown.requested() {
        let Some(result) = client.take_only(ticket) else {
            if let Some(what) = client.link().waiting_for {
                waiting.say(&what);
            }
            wait(&context.wake, client.deadline());
            continue;
        };
        let payload = result.map_err(|error| failed(error, args.timeout))?.payload;
        let payload = match spec.conversion() {
            Some(conversion) => {
                conversion.convert(payload, Stamp::now).map_err(anyhow::Error::new)?
            }
            None => payload,
        };
        let text = match &payload {
            Payload::RosMessage(message) => as_text(message, args.json)?,
            payload if args.json => describe(payload),
            // As `yarp rpc` shows it.
            Payload::NativeObject(object)
                if has_bottles && matches!(object.value, Value::List(_)) =>
            {
                yarp::payload::text_form(&object.value).unwrap_or_else(|| words(&object.value))
            }
            payload => summary(payload),
        };
        return output::line(&text);
    }
    Err(anyhow!("{}: interrupted before there was a reply", args.endpoint).into())
}

/// The type that the servers of `endpoint` tell; `None` when asked to end.
///
/// # Errors
/// As [`run`].
pub fn type_of(
    endpoint: &EndpointAddress,
    timeout: Duration,
    shutdown: &Shutdown,
) -> Result<Option<ServiceKind>> {
    let (ports, own) = (ServicePorts::default(), OwnAddress::default());
    let middleware = for_service(endpoint, Role::Client, &ports, own)?;
    let context = Context::default();
    servers(endpoint, &[], timeout).learned(&*middleware, &context.wake, shutdown)
}

fn servers<'a>(
    endpoint: &'a EndpointAddress,
    definitions: &'a [PathBuf],
    timeout: Duration,
) -> Announced<'a, ServiceKind> {
    Announced {
        endpoint,
        role: Role::Server,
        definitions,
        timeout,
        learn: |middleware, one, types| middleware.learn_service(one, types),
    }
}

/// The request that the command line gives: fields, or what a function is called with.
fn request(args: &CallArgs) -> Result<Call> {
    let only = |value| Call { args: vec![value], kwargs: Map::new() };
    match (&args.value, &args.file) {
        (Some(text), _) => Ok(only(value("--value", text)?)),
        (None, Some(file)) => {
            let spec = TopicSpec::new(&args.endpoint.name, MessageType::NativeObject);
            match input::from_file(file, &spec) {
                Ok(Payload::NativeObject(object)) => Ok(only(object.value)),
                Ok(_) => Err(Failure::Usage(format!("{} holds no value", file.display()))),
                Err(error) => Err(Failure::usage(format!("{error:#}"))),
            }
        }
        (None, None) => call_of(None, args.kwargs.as_deref(), args.args.as_deref()),
    }
}

/// The call that has the fields of `value`, or arguments in order and by name.
pub(in crate::command) fn call_of(
    fields: Option<&str>,
    kwargs: Option<&str>,
    args: Option<&str>,
) -> Result<Call> {
    if let Some(text) = fields {
        return Ok(Call { args: Vec::new(), kwargs: keywords("--value", Some(text))? });
    }
    Ok(Call { args: arguments("--args", args)?, kwargs: keywords("--kwargs", kwargs)? })
}

/// Refuses what is no request of a service that is no function of Wrapyfi.
fn check(Call { args, kwargs }: &Call, kind: ServiceKind) -> Result<()> {
    let ServiceKind::Ros(service) = kind else { return Ok(()) };
    let limit = Limits::default().message_bytes;
    fields_of_call(service.request(), args, kwargs, limit)
        .map(drop)
        .map_err(|error| Failure::Usage(format!("the value is no request of {kind}: {error}")))
}

/// Positional arguments: a JSON list in Wrapyfi's dialect.
fn arguments(option: &str, text: Option<&str>) -> Result<Vec<Value>> {
    match value(option, text.unwrap_or("[]"))? {
        Value::List(args) | Value::Tuple(args) => Ok(args),
        other => wrong(option, &other, "a JSON list"),
    }
}

/// Keyword arguments: a JSON object in Wrapyfi's dialect.
fn keywords(option: &str, text: Option<&str>) -> Result<Map> {
    match value(option, text.unwrap_or("{}"))? {
        Value::Map(kwargs) => Ok(kwargs),
        other => wrong(option, &other, "a JSON object"),
    }
}

fn wrong<T>(option: &str, found: &Value, wanted: &str) -> Result<T> {
    Err(Failure::Usage(format!("{option} is {}; it must be {wanted}", canonical(found))))
}

/// The failure of a call for which the user gave `timeout`; discovery had its part of it before.
fn failed(error: CallError, timeout: Duration) -> Failure {
    match error {
        CallError::TimedOut { service, why, .. } => {
            let timeout_ms = u64::try_from(timeout.as_millis()).unwrap_or(u64::MAX);
            Failure::TimedOut(CallError::TimedOut { service, timeout_ms, why }.to_string())
        }
        _ => Failure::Failed(anyhow::Error::new(error)),
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_data::types::RosService;
    use wrapyfi_interfaces::store::TypeStore;

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
    fn arguments_are_fields_in_order_by_name_or_all_in_one() {
        let checked = |name: &str, args, kwargs| {
            let resolved = TypeStore::generated().resolve_name(name).unwrap();
            let kind = ServiceKind::Ros(RosService::new(&resolved).unwrap());
            let call = Call {
                args: arguments("--args", args).unwrap(),
                kwargs: keywords("--kwargs", kwargs).unwrap(),
            };
            check(&call, kind).map_err(|failure| failure.to_string())
        };
        let set = "std_srvs/srv/SetBool";
        for (args, kwargs) in [
            (Some("[true]"), None),
            (Some(r#"[{"data": true}]"#), None),
            (None, Some(r#"{"data": true}"#)),
            (None, None),
        ] {
            assert_eq!(checked(set, args, kwargs), Ok(()), "{args:?} {kwargs:?}");
        }
        let list = "rcl_interfaces/srv/ListParameters";
        assert_eq!(checked(list, Some(r#"[["a"]]"#), Some(r#"{"depth": 1}"#)), Ok(()));
        for (args, kwargs, words) in [
            ("[true, 2]", None, "has 1: leave out 1"),
            ("[true]", Some(r#"{"data": true}"#), "data: a second value"),
            (r#"[{"dat": true}]"#, None, "did you mean \"data\"?"),
        ] {
            let error = checked(set, Some(args), kwargs).unwrap_err();
            assert!(error.contains("is no request of std_srvs/srv/SetBool"), "{error}");
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn the_time_that_the_user_gave_is_told() {
        let error = CallError::TimedOut {
            service: "/nobody".into(),
            timeout_ms: 998,
            why: "no node offers it".into(),
        };
        let Failure::TimedOut(text) = failed(error, Duration::from_secs(1)) else {
            panic!("a time-out")
        };
        assert_eq!(text, "\"/nobody\" was not answered within 1000 ms: no node offers it");
    }
}
