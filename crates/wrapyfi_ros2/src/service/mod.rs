//! Services, called and served: bytes below, what users hold above.
//!
//! ```text
//!   Client ─▶ Ros2Client ═══ DDS ═══▶ Ros2Server ─▶ Server
//!             ServiceCodec: how requests and replies are written
//! ```
//!
//! Time-outs, late replies, and how many may be under way at once are [`wrapyfi_endpoint`]'s.

mod client;
mod codec;
pub(super) mod replies;
mod server;

use std::time::Duration;

pub(super) use client::Ros2Client;
pub use codec::returned;
pub(super) use server::Ros2Server;

use super::graph::GraphError;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{RosService, ServiceKind};
use wrapyfi_endpoint::{DropReason, ServiceSpec};

/// Shortest time to the next look at things that nobody is notified of: see
/// [`CdrClient::look_again`](super::graph::CdrClient::look_again).
pub(super) const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// Settings of the calls of a client or a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceOptions {
    /// Time that a call has, from its begin to its reply: 5 s.
    pub timeout: Duration,
    /// Calls of one client, or requests of one server, that may be under way at once: 64.
    pub pending: usize,
    /// Requests and replies kept by DDS: 10.
    pub depth: u32,
    /// Largest request or reply in bytes.
    pub max_bytes: usize,
}

impl Default for ServiceOptions {
    fn default() -> Self {
        Self {
            timeout: Duration::from_secs(5),
            pending: 64,
            depth: 10,
            max_bytes: Limits::default().message_bytes,
        }
    }
}

impl ServiceOptions {
    pub(super) fn spec(&self, name: &str, service: RosService) -> ServiceSpec {
        ServiceSpec {
            timeout: self.timeout,
            pending: self.pending,
            limits: Limits { message_bytes: self.max_bytes, ..Limits::default() },
            ..ServiceSpec::new(name, ServiceKind::Ros(service))
        }
    }
}

/// Requests and replies that DDS keeps: all that may be under way at once, as it overwrites what exceeds
/// its depth.
pub(super) fn depth(spec: &ServiceSpec) -> u32 {
    u32::try_from(spec.pending).unwrap_or(u32::MAX).max(10)
}

/// Reason as which a message that cannot be used is counted; `None` where DDS itself fails.
fn drop_reason(error: &GraphError) -> Option<DropReason> {
    match error {
        GraphError::TooLarge { .. } => Some(DropReason::Oversize),
        GraphError::NoIdentity { .. } => Some(DropReason::Malformed),
        GraphError::ForeignMapping { .. } => Some(DropReason::ServiceMapping),
        _ => None,
    }
}
