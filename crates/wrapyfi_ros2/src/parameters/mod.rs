//! The parameters of other nodes: read, written, and watched.
//!
//! ```text
//!   ParameterClient ─ list, get, set ─▶ /node/list_parameters, get_parameters, set_parameters
//!   RemoteParameters ─ list, get once, and after a restart ─▶ the same services
//!                    ◀─ what changed ──────────────────────── /parameter_events
//!     listener, publisher: endpoints whose messages are properties, `ros2:/node` with type Properties
//! ```

mod asker;
mod client;
mod error;
mod event;
mod listener;
mod options;
mod publisher;
mod remote;

pub use client::ParameterClient;
pub use error::{ParameterClientError, ParameterResult};
pub(super) use listener::PropertiesListener;
pub use options::ServiceOptions;
pub(super) use publisher::PropertiesPublisher;
pub use remote::RemoteParameters;
