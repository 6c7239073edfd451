//! Why parameters of another node could not be read or set.

use std::fmt;

use crate::middleware::ros2::graph::GraphError;
use crate::middleware::ros2::{AnyError, CallError};

/// A parameter that a node did not set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RefusedParameter {
    /// Its name.
    pub name: String,
    /// Why, in the words of the node.
    pub reason: String,
}

impl fmt::Display for RefusedParameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason = if self.reason.is_empty() { "no reason given" } else { &self.reason };
        write!(f, "{}: {reason}", self.name)
    }
}

/// Why parameters of another node could not be read or set.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterClientError {
    /// No node can be called so.
    #[error("{node:?} is no name of a node: {reason}")]
    Name {
        /// As given.
        node: String,
        /// The rule it breaks.
        reason: String,
    },
    /// Nobody serves the parameters of such a node.
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
    #[error("node {node} refused {} of {of} parameters: {}", .refused.len(), list(.refused))]
    Refused {
        /// Full name of the node.
        node: String,
        /// Those it did not set.
        refused: Vec<RefusedParameter>,
        /// Parameters in the request.
        of: usize,
    },
    /// The node set none of the parameters, which were to be set together.
    #[error("node {node} refused to set {of} parameters together: {reason}")]
    RefusedTogether {
        /// Full name of the node.
        node: String,
        /// Parameters in the request.
        of: usize,
        /// Why, in the words of the node.
        reason: String,
    },
    /// The node answered what no node should.
    #[error("{service} of node {node} answered what cannot be used: {fault}")]
    Reply {
        /// Full name of the node.
        node: String,
        /// Service that answered.
        service: &'static str,
        /// What is wrong.
        fault: String,
    },
    /// The node has more parameters than are read.
    #[error("node {node} has {what} {actual}, the limit is {limit}")]
    TooMuch {
        /// Full name of the node.
        node: String,
        /// What is too much: `names of parameters:` or `bytes of parameters:`.
        what: &'static str,
        /// How much it is.
        actual: usize,
        /// The limit.
        limit: usize,
    },
    /// The call failed.
    #[error(transparent)]
    Call(#[from] CallError),
    /// A client could not be opened.
    #[error(transparent)]
    Open(#[from] AnyError),
    /// DDS refused.
    #[error(transparent)]
    Graph(#[from] GraphError),
}

/// A few of several things.
fn list<T: fmt::Display>(things: &[T]) -> String {
    const SHOWN: usize = 8;
    let mut text: Vec<_> = things.iter().take(SHOWN).map(ToString::to_string).collect();
    if things.len() > SHOWN {
        text.push(format!("and {} more", things.len() - SHOWN));
    }
    text.join("; ")
}
