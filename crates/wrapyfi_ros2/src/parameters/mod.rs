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

use std::time::Duration;

use super::ros2::Ros2;
use wrapyfi_data::Limits;
use wrapyfi_endpoint::ServiceSpec;
use wrapyfi_node::NodeName;

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

/// Settings of the calls to the parameter services of a node.
///
/// ```
/// use std::time::Duration;
/// use wrapyfi_ros2::ServiceOptions;
/// let patient = ServiceOptions { timeout: Duration::from_secs(30), ..ServiceOptions::default() };
/// assert!(patient.timeout > ServiceOptions::default().timeout);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceOptions {
    /// Time that a call has, from its begin to its reply: 5 s.
    pub timeout: Duration,
    /// Largest request or reply in bytes.
    pub max_bytes: usize,
}

impl Default for ServiceOptions {
    fn default() -> Self {
        Self { timeout: ServiceSpec::TIMEOUT, max_bytes: Limits::default().message_bytes }
    }
}
