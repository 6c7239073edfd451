//! Parameters of a node, above any transport: no sockets, no clocks.
//!
//! ```text
//!   declare(descriptor, default) ─┐ overrides win     ┌─▶ take_events(stamp) ─▶ /parameter_events
//!                                 ▼                   │
//!   set, set_atomically ──▶ ParameterStore ───────────┼─▶ ParameterWatch::take, rings a Wake
//!        ▲  type, range, read-only                    │
//!        │                                            └─▶ get, list, describe
//!   answer(ParameterService, request) ─▶ response         the six services
//! ```
//!
//! Names, order and texts are those of ROS 2 nodes, as `ros2 param` shows them. They are rclpy's
//! where rclcpp differs.

mod descriptor;
mod error;
mod event;
mod from_outside;
mod list;
mod message;
mod parameter;
mod qos_overrides;
mod qos_profile;
mod services;
mod store;
mod watch;

pub use descriptor::{ParameterDescriptor, ParameterRange};
pub use error::{DeclareError, GetError, SetError};
pub use parameter::Parameter;
pub use qos_overrides::{
    DurabilityOverride, EndpointRole, HistoryOverride, LivelinessOverride, QosOverrideError,
    QosOverrides, ReliabilityOverride,
};
pub use services::ParameterService;
pub use store::ParameterStore;
pub use watch::ParameterWatch;
pub use wrapyfi_data::types::UnknownType;

/// Most parameters of a node, and most names in one request.
pub const MAX_PARAMETERS: usize = 4096;
/// Longest name of a parameter in bytes.
pub const MAX_NAME_BYTES: usize = 1024;
/// Largest value of a parameter in bytes.
pub const MAX_VALUE_BYTES: usize = 1 << 20;
/// Largest reply to one request, in bytes and about. A request may name a large parameter many
/// times.
pub const MAX_REPLY_BYTES: usize = 16 << 20;
/// Most events that wait to be published: the depth of `/parameter_events`.
pub const MAX_EVENTS: usize = 1000;
/// Longest part of a name or value that an error shows, in characters.
const SHOWN: usize = 100;

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod qos_tests;
#[cfg(test)]
mod request_tests;
#[cfg(test)]
mod tests;
