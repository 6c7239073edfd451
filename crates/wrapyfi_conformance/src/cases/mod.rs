//! The cases. Each one starts a testbed of its own and says in its name what must hold.

mod content;
mod delivery;
mod discovery;
mod faults;
mod link;
mod queue;
mod restart;
mod services;

pub use content::*;
pub use delivery::*;
pub use discovery::*;
pub use faults::*;
pub use link::*;
pub use queue::*;
pub use restart::*;
pub use services::*;
