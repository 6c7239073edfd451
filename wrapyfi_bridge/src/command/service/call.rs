//! `wrapyfi call`; here `ros2:/service`.

use std::io::{self, Write as _};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_core::Limits;
use wrapyfi_core::endpoint::{Middleware as _, Role, Wake};
use wrapyfi_core::middleware::ros2::{AnyClient, CallError, Ros2, ServiceOptions, ServiceType};

use super::native::Convention;
use super::{function, shown};
use crate::cli::CallArgs;
use crate::command::{WAIT_SLICE, any};
use crate::exit::Failure;
use crate::middlewares::Middlewares;
use crate::shutdown::Shutdown;

/// Calls once and prints the reply.
///
/// # Errors
/// Exit code 3 when there was no reply in time, 2 when type, service or request is wrong.
pub fn run(args: &CallArgs, shutdown: &Shutdown) -> Result<(), Failure> {
    if args.endpoint.middleware != "ros2" {
        return function::call(args, shutdown);
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
    let service = ServiceType::new(&resolved).map_err(Failure::usage)?;
    let wake = Wake::new();
    let left = args.timeout.saturating_sub(begin.elapsed());
    let options = ServiceOptions { timeout: left, ..ServiceOptions::default() };
    let mut client = AnyClient::open(&ros2, &args.endpoint.name, service, &options, &wake)
        .map_err(Failure::usage)?;
    let json = args.value.as_deref().unwrap_or("{}");
    let json: serde_json::Value =
        serde_json::from_str(json).map_err(|error| Failure::Usage(format!("--value: {error}")))?;
    let mut request = client
        .request_plan()
        .from_json(&json, Limits::default().message_bytes)
        .map_err(|error| Failure::Usage(format!("the value is no request of {name}: {error}")))?;
    match Convention::of(&name) {
        Some(convention) if args.value.is_none() => {
            convention.fill(&mut request, args.args.as_deref(), args.kwargs.as_deref())?;
        }
        None if args.args.is_some() || args.kwargs.is_some() => {
            let text = format!("{name} is no function of Wrapyfi: give its fields with --value");
            return Err(Failure::Usage(text));
        }
        _ => {}
    }
    let ticket = client.call(&request).map_err(Failure::usage)?;
    while !shutdown.requested() {
        let Some((ended, result)) = client.poll() else {
            wake.wait(wait(&client));
            continue;
        };
        debug_assert_eq!(ended, ticket);
        let reply = result.map_err(failed)?;
        let mut out = io::stdout().lock();
        writeln!(out, "{}", shown(&reply, args.json)?).context("cannot print")?;
        return out.flush().context("cannot print").map_err(Failure::from);
    }
    Err(anyhow!("{}: interrupted before there was a reply", args.endpoint).into())
}

fn wait(client: &AnyClient) -> Duration {
    let until = client.deadline().map(|at| at.saturating_duration_since(Instant::now()));
    until.unwrap_or(WAIT_SLICE).min(WAIT_SLICE)
}

fn failed(error: CallError) -> Failure {
    match error {
        CallError::TimedOut { .. } => Failure::TimedOut(error.to_string()),
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
