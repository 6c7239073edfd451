//! `call` and `serve`: requests and replies.
//!
//! ```text
//!   ros2:                 any service whose definition is found, as messages
//!     --value, --args, --kwargs ─▶ request ─▶ AnyClient ══▶ AnyServer ─▶ --echo, --value, --file ─▶ reply
//!   ros:, yarp:, zeromq:  functions of Wrapyfi and, but for zeromq, any service
//!     --value, --args, --kwargs ─▶ Client ══▶ Server ─▶ --echo, --value, --file ─▶ reply
//! ```

use wrapyfi_core::endpoint::EndpointAddress;
use wrapyfi_interfaces::dynamic::DynamicMessage;

use super::any::yaml;
use crate::exit::Failure;

pub mod call;
mod function;
mod native;
pub mod serve;

/// The failure of a server that is given no type where services have one.
fn no_type(endpoint: &EndpointAddress) -> Failure {
    Failure::Usage(format!(
        "{endpoint}: --type is needed: NativeObject, Image, CompressedImage, AudioChunk, or any type as \
         package/srv/Name"
    ))
}

/// A request or a reply as `--json` shows it, or as `ros2 topic echo` would.
fn shown(message: &DynamicMessage, as_json: bool) -> Result<String, Failure> {
    if !as_json {
        return Ok(yaml::text(message)?);
    }
    // The message itself keeps the order of its fields; a JSON value would sort them.
    let value = serde_json::to_string(message).map_err(anyhow::Error::new)?;
    Ok(format!("{{\"type\":\"{}\",\"value\":{value}}}", message.type_name()))
}
