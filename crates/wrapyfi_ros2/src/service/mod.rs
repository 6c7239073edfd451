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
pub(super) mod introspection;
pub(super) mod replies;
mod server;

pub(super) use client::Ros2Client;
pub(super) use server::Ros2Server;

use wrapyfi_endpoint::ServiceSpec;

/// Requests and replies that a service of ROS 2 keeps unless its program says otherwise
/// (`rmw_qos_profile_services_default`). DDS does not announce it.
const USUAL_DEPTH: u32 = 10;

/// Requests and replies that DDS keeps: all that may be under way at once, as it overwrites what exceeds
/// its depth.
pub(super) fn depth(spec: &ServiceSpec) -> u32 {
    u32::try_from(spec.pending).unwrap_or(u32::MAX).max(USUAL_DEPTH)
}
