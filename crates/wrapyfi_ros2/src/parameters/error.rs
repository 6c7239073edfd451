//! Errors of reading and setting the parameters of another node.

use crate::graph::GraphError;
use wrapyfi_endpoint::{CallError, OpenError};

/// Error of reading or setting the parameters of another node.
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_ros2 as ros2; } }
/// use wrapyfi_core::middleware::ros2::ParameterClientError;
/// let error = ParameterClientError::NotDeclared { node: "/talker".into(), names: vec!["gain".into()] };
/// assert!(error.to_string().starts_with("node /talker has not declared"));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterClientError {
    /// The name cannot be that of a node.
    #[error("{node:?} is no name of a node: {reason}")]
    Name {
        /// Name as given.
        node: String,
        /// The rule it breaks.
        reason: String,
    },
    /// No program serves the parameters of such a node.
    #[error(
        "there is no node {node} with parameters: nobody offered {service} within {timeout_ms} ms"
    )]
    Absent {
        /// Full name of the node.
        node: String,
        /// Service asked for.
        service: String,
        /// Time waited.
        timeout_ms: u64,
    },
    /// The node has no parameters of these names.
    #[error("node {node} has not declared {}", list(.names))]
    NotDeclared {
        /// Full name of the node.
        node: String,
        /// The names it lacks.
        names: Vec<String>,
    },
    /// The node set some of the parameters, or none, but not all.
    #[error("node {node} refused {} of {of} parameters: {}", .refused.len(), list(&reasons(.refused)))]
    Refused {
        /// Full name of the node.
        node: String,
        /// Parameters that the node did not set, each with the reason in the node's words.
        refused: Vec<(String, String)>,
        /// Parameters in the request.
        of: usize,
    },
    /// The node answered what no node should.
    #[error("{service} of node {node} answered what cannot be used: {fault}")]
    Reply {
        /// Full name of the node.
        node: String,
        /// Service that answered.
        service: &'static str,
        /// Fault of the answer.
        fault: String,
    },
    /// The node has more parameters than are read.
    #[error("node {node} has {what} {actual}, the limit is {limit}")]
    TooMuch {
        /// Full name of the node.
        node: String,
        /// Thing of which there is too much: `names of parameters:` or `bytes of parameters:`.
        what: &'static str,
        /// Number of them.
        actual: usize,
        /// The limit.
        limit: usize,
    },
    /// The call failed.
    #[error(transparent)]
    Call(#[from] CallError),
    /// A client could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// DDS refused.
    #[error("{0}")]
    Graph(String),
}

impl From<GraphError> for ParameterClientError {
    fn from(error: GraphError) -> Self {
        Self::Graph(error.to_string())
    }
}

/// Result of reading or setting the parameters of another node.
pub type ParameterResult<T> = Result<T, ParameterClientError>;

/// A few of several things.
fn reasons(refused: &[(String, String)]) -> Vec<String> {
    refused.iter().map(|(name, reason)| format!("{name}: {reason}")).collect()
}

fn list<T: std::fmt::Display>(things: &[T]) -> String {
    const SHOWN: usize = 8;
    let mut text: Vec<_> = things.iter().take(SHOWN).map(ToString::to_string).collect();
    if things.len() > SHOWN {
        text.push(format!("and {} more", things.len() - SHOWN));
    }
    text.join("; ")
}
