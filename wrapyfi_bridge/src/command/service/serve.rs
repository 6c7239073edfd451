//! `wrapyfi serve`; here `ros2:/service`.

use std::time::{Duration, Instant};

use wrapyfi_core::endpoint::{ServeError, Wake};
use wrapyfi_core::middleware::ros2::{AnyServer, ServiceOptions};
use wrapyfi_core::types::RosService;
use wrapyfi_core::{Limits, Throttle};
use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::native::{self, Convention};
use super::{function, no_type, shown};
use crate::cli::{ServeArgs, ServiceName};
use crate::command::{WAIT_SLICE, any};
use crate::exit::Failure;
use crate::middlewares::Middlewares;
use crate::shutdown::Shutdown;
use crate::{input, output};

/// Serves until `count` requests were answered or the process is asked to end.
///
/// # Errors
/// Exit code 2 when type, service or reply is wrong.
pub fn run(args: &ServeArgs, shutdown: &Shutdown) -> Result<(), Failure> {
    let options = args.options.of(&args.endpoint.middleware)?;
    // A function returns a payload, which any kind of file holds.
    let is_function = |name: &ServiceName| Convention::of(&name.0).is_some();
    let is_payload = args.file.is_some() && args.service_type.as_ref().is_some_and(is_function);
    if args.endpoint.middleware != "ros2" || is_payload || args.ports.any() {
        return function::serve(args, options, shutdown);
    }
    let Some(ServiceName(name)) = &args.service_type else {
        return Err(no_type(&args.endpoint));
    };
    let resolved = any::resolve(name, &args.definitions)?;
    let service = RosService::new(&resolved).map_err(Failure::usage)?;
    let ros2 = Middlewares::ros2_of_command()?;
    let (wake, options) = (Wake::new(), ServiceOptions::default());
    let mut server = AnyServer::open(&ros2, &args.endpoint.name, service, &options, &wake)
        .map_err(Failure::usage)?;
    let constant = match (&args.value, &args.file) {
        (Some(text), _) => Some(constant(&server, name, "--value", text)?),
        (None, Some(file)) => {
            let text = input::json_text(file, &Limits::default()).map_err(|error| {
                Failure::Usage(format!(
                    "{error:#}; a reply of {name} is a .json file of its fields"
                ))
            })?;
            Some(constant(&server, name, &file.display().to_string(), &text)?)
        }
        (None, None) => None,
    };
    tracing::info!("serving {name} at {}", server.name());
    let mut answered = 0_u64;
    let mut refusals = Throttle::default();
    while !shutdown.requested() && args.count.is_none_or(|count| answered < count) {
        match server.take() {
            Ok(Some(request)) => {
                let reply = match (&constant, Convention::of(name)) {
                    (Some(constant), _) => constant.clone(),
                    (None, None) => echoed(&request.fields, server.response()),
                    (None, Some(convention)) => returned(convention, &request.fields, &mut server),
                };
                answered += 1;
                let told = answer_first(
                    || server.reply(request.id, &reply),
                    answered,
                    || output::line(&shown(&request.fields, args.json)?),
                );
                if told.is_err() {
                    finish(&mut server, &wake);
                    return told;
                }
            }
            Ok(None) => {
                let until =
                    server.deadline().map(|at| at.saturating_duration_since(Instant::now()));
                wake.wait(until.unwrap_or(WAIT_SLICE).min(WAIT_SLICE));
            }
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
    finish(&mut server, &wake);
    Ok(())
}

/// Replies, then prints the request: a client does not wait for whoever reads our output. What
/// `print` returns.
fn answer_first(
    reply: impl FnOnce() -> Result<(), ServeError>,
    request: u64,
    print: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    // One client that cannot be answered does not end the others' service.
    if let Err(error) = reply() {
        tracing::warn!("request {request} got no reply: {error}");
    }
    print()
}

/// Gives kept replies the time to go out, and says what was not served.
fn finish(server: &mut AnyServer, wake: &Wake) {
    /// Longest wait: longer than discovery takes; the process must end within two seconds.
    const TIMEOUT: Duration = Duration::from_secs(1);
    let end = Instant::now() + TIMEOUT;
    while server.kept() > 0 && Instant::now() < end {
        wake.wait(WAIT_SLICE);
        server.flush();
    }
    for (reason, count) in server.counters().drops {
        tracing::warn!("{}: {count} requests or replies dropped: {reason}", server.name());
    }
}

/// The reply whose fields `text` has, which came from `source`.
fn constant(
    server: &AnyServer,
    name: &str,
    source: &str,
    text: &str,
) -> Result<DynamicMessage, Failure> {
    let json = native::json(source, text)?;
    let mut reply = server.response();
    if let Some(convention) = Convention::of(name)
        && !native::is_fields(&json, &reply)
    {
        let filled = convention.fill_reply(&mut reply, &json);
        return filled
            .map(|()| reply)
            .map_err(|error| Failure::Usage(format!("{source}: {error}")));
    }
    server
        .response_plan()
        .from_json(&json, Limits::default().message_bytes)
        .map_err(|error| Failure::Usage(format!("{source} is no reply of {name}: {error}")))
}

/// The reply that returns the argument of a function, or says why it does not.
fn returned(
    convention: Convention,
    request: &DynamicMessage,
    server: &mut AnyServer,
) -> DynamicMessage {
    let mut reply = server.response();
    if let Err(reason) = convention.echo(request, &mut reply) {
        tracing::warn!("{reason}");
        return server.error_reply(&reason).unwrap_or_else(|| server.response());
    }
    reply
}

/// The reply with the fields of the request that it has too; `success` where it has that.
fn echoed(request: &DynamicMessage, mut reply: DynamicMessage) -> DynamicMessage {
    let own: Vec<String> = reply.fields().map(|(name, _)| name.to_owned()).collect();
    for name in own {
        let asked = request.get(&name).cloned();
        let value = asked.or_else(|| (name == "success").then(|| true.into()));
        if let Some(value) = value
            && let Err(error) = reply.set(&name, value)
        {
            tracing::debug!("{name} keeps its default: {error}");
        }
    }
    reply
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;

    #[test]
    fn the_reply_goes_before_the_request_is_printed() {
        let too_late = ServeError::NotWaiting { service: "/add".into(), timeout_ms: 5 };
        for replied in [Ok(()), Err(too_late)] {
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
}
