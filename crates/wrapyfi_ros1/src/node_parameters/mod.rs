//! Parameters of ROS 1 as nodes of ROS 2 have theirs: services and events of each node, answered here.
//!
//! ```text
//!   parameter server: /x/…   ─▶ ┐                      ┌─▶ /x/list_parameters, get, describe, types
//!   /x/parameter_descriptions ─▶ │                      │
//!   /x/parameter_updates     ─▶ ├─▶ NodeParameters ◀──┼── /x/set_parameters, set_parameters_atomically
//!   /x/set_parameters        ◀─ │    a ParameterStore   │
//!   setParam, deleteParam    ◀─ ┘                      └─▶ /x/parameter_events
//! ```
//!
//! `x` is a server of dynamic_reconfigure, or a node that has parameters in its namespace. Discovery lists the six
//! services and the topic as if the node had them, so that routes carry them as any others; ROS 2's side makes a node
//! `/x` of what it is given so. What a server describes hides what the parameter server has under the same name.

mod client;
mod events;
mod found;
mod literal;
mod reconfigure;
mod source;

pub(super) use client::ParameterServiceClient;
pub(super) use events::ParameterEvents;
pub(super) use found::{add, event_type, is_answered_here, service_kind};
pub(super) use source::SharedParameters;
