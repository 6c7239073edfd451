//! Python's pickles, read as data.
//!
//! ```text
//!   pickle ────▶ machine ─▶ arena of nodes ─▶ Node: walk by what should be there ─▶ arrays, values
//!   buffers ──┘     │
//!                   └ names looked up in the list of the plug-in: one that is not on it ends the
//!                     reading, and the object travels on undecoded
//! ```
//!
//! Nothing is ever imported or called. An instruction that would call a function is written down as
//! a [`Call`]; what it means is known to whoever reads the plug-in. `docs/wire/pickle.md` has the
//! lists.

mod arena;
mod atoms;
mod build;
mod builtin;
mod call;
mod dtype;
mod error;
mod globals;
mod items;
mod machine;
mod names;
mod node;
mod numpy;
mod opcode;
mod rewrite;
mod scan;
mod text;
mod trail;
mod value;
mod write;
mod write_numpy;

use bytes::Bytes;

pub use arena::{NodeId, Pickle};
pub use builtin::Slice;
pub use call::Call;
pub use dtype::ArrayDtype;
pub use error::PickleError;
pub use globals::{Allowed, Global};
pub use items::{Items, Pairs};
pub use node::{Node, View};
pub use numpy::PickledArray;
pub use write::{Pickled, Protocol, Writer};

use crate::Limits;

/// Reads a pickle of any protocol, 0 to 5, whose out-of-band buffers are `buffers` in their order.
/// Bytes behind its end are ignored: [`Pickle::end`] says where that is.
///
/// Objects may take four times `limits.message_bytes` of memory, and 64 bytes for each one of
/// `data`, besides what they share with `data` and `buffers`.
///
/// # Errors
/// When it is no pickle, names something that is not on the list `allowed`, or exceeds a limit.
pub fn read(
    data: &Bytes,
    buffers: &[Bytes],
    allowed: &Allowed,
    limits: &Limits,
) -> Result<Pickle, PickleError> {
    machine::run(data, buffers, allowed, limits)
}

#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod tests;
