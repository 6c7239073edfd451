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
use wrapyfi_endpoint::{DropReason, ServiceSpec};

/// Shortest time to the next look at things that nobody is notified of: see
/// [`CdrClient::look_again`](super::graph::CdrClient::look_again).
pub(super) const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// Words before the RMW that no server of a service speaks, in what a client waits for.
pub const SPEAKS_NOT: &str = " that does not speak ";

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
