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
mod limits;
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
pub use limits::{MAX_EVENTS, MAX_NAME_BYTES, MAX_PARAMETERS, MAX_REPLY_BYTES, MAX_VALUE_BYTES};
pub use parameter::Parameter;
pub use qos_overrides::{EndpointRole, QosOverrideError};
pub use services::ParameterService;
pub use store::ParameterStore;
pub use watch::ParameterWatch;
pub use wrapyfi_data::types::UnknownType;

use limits::SHOWN;

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod qos_tests;
#[cfg(test)]
mod request_tests;
#[cfg(test)]
mod tests;
