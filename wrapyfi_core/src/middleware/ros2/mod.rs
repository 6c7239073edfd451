//! ROS 2 topics over CycloneDDS.
//!
//! ```text
//!   Ros2 (Middleware) ─ names ─ listener, publisher: payload <-> CDR
//!     │
//!   graph               the trait: CDR bytes and discovery facts
//!     │
//!   cyclone_graph ───── discovery_info, domain, config ◀── environment
//!     │
//!   cyclone             the only modules that call C
//! ```

mod config;
mod cyclone;
mod cyclone_graph;
mod discovery_info;
mod domain;
pub mod environment;
pub mod graph;
pub mod names;

pub use config::CycloneConfig;
pub use cyclone_graph::{CycloneError, CycloneGraph};
pub use domain::DomainError;
