//! Properties on ROS 1: a namespace of the parameter server.
//!
//! ```text
//!   publish { gain: 2.5, camera.rate: 30 } ─▶ setParam /x/gain 2.5, /x/camera/rate 30
//!   take ◀─ what changed ◀─ known ◀─ subscribeParam /x, and again at every paramUpdate
//! ```
//!
//! Python Wrapyfi sets and reads the same names. As on ROS 2 a listener yields all parameters first and
//! then each change. A value that this node sets is no change to its own listeners: a namespace and the
//! parameters of a ROS 2 node can be routed both ways.

mod publisher;
mod values;
mod watched;

use std::time::Instant;

pub(super) use publisher::ParameterPublisher;
pub(super) use values::{to_xml, under};
pub(super) use watched::{ParameterListener, Watched};

use super::node::Node;
use super::xmlrpc;

/// The namespace `key` has this value, as the master said when it was asked at `asked`.
pub(super) fn arrived(node: &Node, key: &str, value: &xmlrpc::Value, asked: Instant) {
    let watched = node.state().parameters.get(key).cloned().unwrap_or_default();
    watched.iter().for_each(|one| one.give(value, asked));
}

/// Something changed at `key`: every namespace that it touches is asked for anew.
pub(super) fn changed(node: &Node, key: &str) {
    let key = key.trim_end_matches('/');
    let within = |inner: &str, outer: &str| {
        inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    node.rewatch(|watched| within(key, watched) || within(watched, key));
}
