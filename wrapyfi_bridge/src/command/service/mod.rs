//! `call` and `serve`: requests and replies.
//!
//! ```text
//!   ros2:    any service whose definition is found
//!            --value ─▶ request ─▶ AnyClient ══▶ AnyServer ─▶ --echo, --value ─▶ reply
//!   zeromq:  functions of Wrapyfi
//!            --args, --kwargs ─▶ Client ══▶ Server ─▶ --echo, --value, --file ─▶ reply
//! ```

use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::any::yaml;
use crate::exit::Failure;

pub mod call;
mod function;
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
