//! Name servers, seen from those who ask them.
//!
//! ```text
//!   environment, yarp.conf ──▶ NameClient ──query, register, …──▶ name server
//!                                  │                                 │
//!                     Registrar ───┘ (registers again)               └──▶ NameEvents: [add] /cam
//! ```
//!
//! * [`conf`] and [`environment`]: where the name server is, and how this machine names its ports.
//! * [`client`]: requests, each bounded in time and size.
//! * [`registrar`]: keeps ports registered when the name server is started again.
//! * [`events`]: what is registered and unregistered, as it happens.
//! * [`multicast`]: finding a name server without any configuration.

pub mod client;
pub mod conf;
pub mod environment;
pub mod events;
pub mod multicast;
pub mod registrar;

mod contact;
mod error;
mod reply;

pub use client::NameClient;
pub use conf::{ConfError, Located, NameServerConf};
pub use contact::Target;
pub(crate) use contact::{is_pull, name_fault};
pub use environment::Environment;
pub use error::NameError;
pub use events::NameEvent;
pub use multicast::DISCOVERY_GROUP;
pub use registrar::Registrar;
pub(crate) use reply::{read_answer, registration};
