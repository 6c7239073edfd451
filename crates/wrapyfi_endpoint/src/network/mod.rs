//! Network rules that all middlewares share: names of machines, and permission to listen.
//!
//! * [`Hosts`]: names of machines that the configuration maps to addresses.
//! * [`Variables`]: settings from the environment.
//! * [`owner`]: the program that has a port.
//! * [`Insecure`]: the one rule for addresses that other machines reach.

mod hosts;
mod insecure;
mod owner;
mod variables;

pub use hosts::{Hosts, facing, is_of_this_machine, server_text, unspecified};
pub use insecure::{Insecure, Place, ReachedByOthers, is_on};
pub use owner::owner;
pub use variables::{VariableError, Variables, variable};
