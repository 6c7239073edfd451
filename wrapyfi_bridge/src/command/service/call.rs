//! `wrapyfi call`; here `ros2:/service`.

use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_core::Limits;
use wrapyfi_core::endpoint::{CallError, Middleware as _, Role, Wake};
use wrapyfi_core::middleware::ros2::{AnyClient, Ros2, ServiceOptions, returned};
use wrapyfi_core::types::{RosService, ServiceKind};
use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::native::{self, Arguments, Convention};
use super::{function, shown};
use crate::cli::CallArgs;
use crate::command::{WAIT_SLICE, any};
use crate::describe::summary;
use crate::exit::Failure;
use crate::middlewares::Middlewares;
use crate::output;
use crate::shutdown::Shutdown;

/// Calls once and prints the reply.
///
/// # Errors
/// Exit code 3 when there was no reply in time, 2 when type, service or request is wrong.
pub fn run(args: &CallArgs, shutdown: &Shutdown) -> Result<(), Failure> {
    let options = args.options.of(&args.endpoint.middleware)?;
    if args.endpoint.middleware != "ros2" {
        return function::call(args, options, shutdown);
    }
    if args.ports.any() {
        let text = format!("{}: --rep-port and --req-port are for zeromq", args.endpoint);
        return Err(Failure::Usage(text));
    }
    let begin = Instant::now();
    let ros2 = Middlewares::ros2_of_command()?;
    let name = match &args.service_type {
        Some(name) => name.0.clone(),
        None => match announced(args, &ros2, shutdown)? {
            Some(name) => name,
            None => return Ok(()),
        },
    };
    let resolved = any::resolve(&name, &args.definitions)?;
    let service = RosService::new(&resolved).map_err(Failure::usage)?;
    let wake = Wake::new();
    let left = args.timeout.saturating_sub(begin.elapsed());
    let options = ServiceOptions { timeout: left, ..ServiceOptions::default() };
    let mut client = AnyClient::open(&ros2, &args.endpoint.name, service, &options, &wake)
        .map_err(Failure::usage)?;
    let request = request(args, &name, &client)?;
    let ticket = client.call(&request).map_err(Failure::usage)?;
    while !shutdown.requested() {
        let Some((ended, result)) = client.poll() else {
            wake.wait(wait(&client));
            continue;
        };
        debug_assert_eq!(ended, ticket);
        let reply = result.map_err(|error| failed(error, args.timeout))?;
        return output::line(&told(args, &name, &reply)?);
    }
    Err(anyhow!("{}: interrupted before there was a reply", args.endpoint).into())
}

/// A reply as it is printed: what a function returned in the words of `echo`, any other as a message.
fn told(args: &CallArgs, name: &str, reply: &DynamicMessage) -> Result<String, Failure> {
    let kind = match name.parse::<ServiceKind>() {
        Ok(kind) if !args.json => kind,
        _ => return shown(reply, args.json),
    };
    let returned = returned(kind, reply).with_context(|| format!("{}", args.endpoint))?;
    let service = || args.endpoint.name.clone();
    returned.map(|payload| summary(&payload)).map_err(|reason| {
        let refused = CallError::Refused { service: service(), reason };
        Failure::Failed(anyhow::Error::new(refused))
    })
}

/// The request that the command line gives: fields, or what a function is called with.
fn request(args: &CallArgs, name: &str, client: &AnyClient) -> Result<DynamicMessage, Failure> {
    let mut request = client.request();
    let value = args.value.as_deref().map(|text| native::json("--value", text)).transpose()?;
    let given = match (value, Convention::of(name)) {
        (Some(value), Some(convention)) if !native::is_fields(&value, &request) => {
            let one = Arguments { args: vec![value], ..Arguments::default() };
            return convention.fill(&mut request, one).map(|()| request);
        }
        (Some(value), _) => value,
        (None, convention) => {
            let arguments = Arguments::read(args.args.as_deref(), args.kwargs.as_deref())?;
            match convention {
                Some(convention) => {
                    return convention.fill(&mut request, arguments).map(|()| request);
                }
                None => arguments.fields(&request)?,
            }
        }
    };
    client
        .request_plan()
        .from_json(&given, Limits::default().message_bytes)
        .map_err(|error| Failure::Usage(format!("the value is no request of {name}: {error}")))
}

fn wait(client: &AnyClient) -> Duration {
    let until = client.deadline().map(|at| at.saturating_duration_since(Instant::now()));
    until.unwrap_or(WAIT_SLICE).min(WAIT_SLICE)
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

/// Waits until somebody offers the service: its type. `None` when asked to end.
fn announced(args: &CallArgs, ros2: &Ros2, shutdown: &Shutdown) -> Result<Option<String>, Failure> {
    let name = ros2.resolve(&args.endpoint.name).map_err(Failure::usage)?;
    let mut discovery = ros2.discover().context("ros2")?;
    let deadline = Instant::now() + args.timeout;
    let wake = Wake::new();
    while !shutdown.requested() {
        let found = discovery.endpoints().context("ros2")?;
        let mut types: Vec<_> = found
            .into_iter()
            .filter(|endpoint| endpoint.name == name && endpoint.role == Role::Server)
            .filter_map(|endpoint| endpoint.type_name)
            .collect();
        types.sort();
        types.dedup();
        match types.as_slice() {
            [] => {}
            [only] => return Ok(Some(only.clone())),
            several => {
                let text = format!(
                    "{} has several types: {}; choose one with --type",
                    args.endpoint,
                    several.join(", ")
                );
                return Err(Failure::Usage(text));
            }
        }
        if Instant::now() >= deadline {
            return Err(Failure::TimedOut(format!(
                "{}: time-out: no node offers it; give --type, or see `wrapyfi list ros2`",
                args.endpoint
            )));
        }
        wake.wait(WAIT_SLICE);
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

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
