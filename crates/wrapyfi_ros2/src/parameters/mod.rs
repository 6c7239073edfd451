//! The parameters of other nodes: read, written, and watched.
//!
//! ```text
//!   ParameterClient ─ list, get, set ─▶ /node/list_parameters, get_parameters, set_parameters
//!   RemoteParameters ─ list, get once, and after a restart ─▶ the same services
//!                    ◀─ what changed ──────────────────────── /parameter_events
//!     listener, publisher: endpoints whose messages are properties, `ros2:/node` with type Properties
//! ```

mod asker;
mod client;
mod error;
mod event;
mod listener;
mod publisher;
mod remote;

pub use client::ParameterClient;
pub use error::{ParameterClientError, ParameterResult, RefusedParameter};
pub(super) use listener::PropertiesListener;
pub(super) use publisher::PropertiesPublisher;
pub use remote::RemoteParameters;

use super::ServiceOptions;
use super::ros2::Ros2;
use wrapyfi_node::NodeName;
use wrapyfi_node::parameters::ParameterService;

/// Names that are asked for in one request.
const CHUNK: usize = 256;
/// Names of one node that are read.
const MAX_NAMES: usize = 65_536;

/// Full name of the node that `name` means to ours: relative to our namespace, unless absolute.
fn node_name(ros2: &Ros2, name: &str) -> Result<String, ParameterClientError> {
    let invalid = |reason: String| ParameterClientError::Name { node: name.to_owned(), reason };
    let expanded = ros2.graph().node().expand(name).map_err(|error| invalid(error.to_string()))?;
    NodeName::check_topic(&expanded).map_err(|error| invalid(error.to_string()))?;
    Ok(expanded)
}

/// Options of clients of parameters: with the depth that nodes have there.
fn options(given: &ServiceOptions) -> ServiceOptions {
    ServiceOptions { depth: ParameterService::DEPTH, ..given.clone() }
}
