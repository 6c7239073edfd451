//! `call` and `serve`: requests and replies of any middleware.
//!
//! ```text
//!   function of Wrapyfi   --args, --kwargs ─▶ Call of values ───┐
//!   any other service     --value, --args, --kwargs ─▶ fields ──┴─▶ Client ══▶ Server
//!                                                                               │
//!   printed ◀─ Payload ◀─ Client ◀══ Server ◀─ --echo, --value, --file ─────────┘
//! ```

use std::path::PathBuf;
use std::time::{Duration, Instant};

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{RosMessage, ServiceKind, Value};
use wrapyfi_endpoint::{EndpointAddress, Wake, codec::json};

use super::{WAIT_SLICE, definitions, yaml};
use crate::cli::ServiceName;
use crate::exit::{Failure, Result};
use crate::middlewares::conventions;

pub mod call;
pub mod serve;

/// Kind of the service: a function of Wrapyfi, or on all middlewares but ZeroMQ any service.
fn kind(
    name: &ServiceName,
    endpoint: &EndpointAddress,
    folders: &[PathBuf],
) -> Result<ServiceKind> {
    if !conventions(&endpoint.middleware).has_service_names {
        return name.0.parse().map_err(Failure::usage);
    }
    ServiceKind::resolve(&name.0, &mut definitions::of_command(folders)?)
        .map_err(|error| Failure::Usage(format!("{error} (--definitions DIR)")))
}

/// The JSON of an option, in Wrapyfi's dialect.
pub(in crate::command) fn value(option: &str, text: &str) -> Result<Value> {
    json::decode(
        &Bytes::copy_from_slice(text.as_bytes()),
        &Limits::default(),
        &wrapyfi_core::plugin::standard(),
    )
    .map_err(|error| Failure::Usage(format!("{option}: {error}")))
}

/// A request or a reply of ROS as `--json` shows it, or as `ros2 topic echo` would.
pub(in crate::command) fn as_text(message: &RosMessage, as_json: bool) -> anyhow::Result<String> {
    let fields = message.fields(message.cdr.len())?;
    if !as_json {
        return yaml::text(&fields);
    }
    // The message itself keeps the order of its fields; a JSON value would sort them.
    let value = serde_json::to_string(&fields)?;
    Ok(format!("{{\"type\":\"{}\",\"value\":{value}}}", fields.type_name()))
}

/// Waits for the bell, and no longer than until `deadline`.
pub(in crate::command) fn wait(wake: &Wake, deadline: Option<Instant>) {
    let left = deadline.map(|at| at.saturating_duration_since(Instant::now()));
    wake.wait(left.unwrap_or(Duration::MAX).min(WAIT_SLICE));
}
