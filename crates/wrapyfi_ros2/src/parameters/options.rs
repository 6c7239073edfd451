//! Settings and limits of the calls to the parameter services of a node.

use std::time::Duration;

use super::ParameterClientError;
use crate::ros2::Ros2;
use wrapyfi_data::Limits;
use wrapyfi_endpoint::ServiceSpec;
use wrapyfi_node::NodeName;

/// Names that are asked for in one request.
pub(super) const CHUNK: usize = 256;
/// Names of one node that are read.
pub(super) const MAX_NAMES: usize = 65_536;

/// Full name of the node that `name` means to ours: relative to our namespace, unless absolute.
pub(super) fn node_name(ros2: &Ros2, name: &str) -> Result<String, ParameterClientError> {
    let invalid = |reason: String| ParameterClientError::Name { node: name.to_owned(), reason };
    let expanded = ros2.graph().node().expand(name).map_err(|error| invalid(error.to_string()))?;
    NodeName::check_topic(&expanded).map_err(|error| invalid(error.to_string()))?;
    Ok(expanded)
}

/// Settings of the calls to the parameter services of a node.
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_ros2 as ros2; } }
/// use std::time::Duration;
/// use wrapyfi_core::middleware::ros2::ServiceOptions;
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
