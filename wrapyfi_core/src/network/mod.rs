//! What all middlewares share of the network: names of machines, and who may reach our sockets.
//!
//! * [`Hosts`]: names of machines that the configuration maps to addresses.
//! * [`Insecure`]: the one rule for addresses that other machines reach.

mod hosts;
mod insecure;

pub use hosts::{Hosts, facing, is_of_this_machine};
pub use insecure::{Insecure, Place, ReachedByOthers, is_on};
