//! `call` and `serve`: requests and replies of any service whose definition is found.
//!
//! ```text
//!   --value ─▶ request ─▶ AnyClient ══▶ AnyServer ─▶ --echo, --value ─▶ reply
//! ```

use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::any::yaml;
use crate::exit::Failure;

pub mod call;
mod native;
pub mod serve;

/// A request or a reply as `--json` shows it, or as `ros2 topic echo` would.
fn shown(message: &DynamicMessage, as_json: bool) -> Result<String, Failure> {
    if !as_json {
        return Ok(yaml::text(message)?);
    }
    // The message itself keeps the order of its fields; a JSON value would sort them.
    let value = serde_json::to_string(message).map_err(anyhow::Error::new)?;
    Ok(format!("{{\"type\":\"{}\",\"value\":{value}}}", message.type_name()))
}

/// Only ROS 2 has services here so far.
fn check_middleware(endpoint: &wrapyfi_core::endpoint::EndpointAddress) -> Result<(), Failure> {
    if endpoint.middleware == "ros2" {
        return Ok(());
    }
    let text = format!("{endpoint}: services are on ros2 only: write ros2:{}", endpoint.name);
    Err(Failure::Usage(text))
}
