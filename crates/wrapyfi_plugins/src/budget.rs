//! Budget of memory that one object may take beyond the bytes it shares with its message.
//!
//! A pickle may name one part many times. Where each time costs memory again, its bytes are taken
//! from the budget first, so that a short pickle cannot fill the memory.

use std::cell::Cell;

use crate::pickle::{Node, PickleError};
use wrapyfi_data::Limits;

/// Number of bytes that the parts of one object may still take.
#[derive(Debug)]
pub(super) struct Budget {
    left: Cell<usize>,
    limit: usize,
    depth: Cell<usize>,
}

/// Deepest nesting of objects that are read one inside the other.
const MAX_DEPTH: usize = 16;

/// Budget of one object, as a multiple of the largest message: text columns and joined chunks take
/// several times their size.
const FACTOR: usize = 4;

impl Budget {
    /// A budget of [`FACTOR`] times the largest message.
    pub(super) fn new(limits: &Limits) -> Self {
        let limit = limits.message_bytes.saturating_mul(FACTOR);
        Self { left: Cell::new(limit), limit, depth: Cell::new(0) }
    }

    /// Reads an object inside the one being read, one level deeper.
    pub(super) fn deeper<T>(
        &self,
        node: &Node<'_>,
        read: impl FnOnce() -> Result<T, PickleError>,
    ) -> Result<T, PickleError> {
        let depth = self.depth.get();
        if depth >= MAX_DEPTH {
            return Err(node.unexpected(format!("something nested at most {MAX_DEPTH} deep")));
        }
        self.depth.set(depth + 1);
        let found = read();
        self.depth.set(depth);
        found
    }

    /// Takes `bytes` from the budget for the object at `node`.
    pub(super) fn take(&self, node: &Node<'_>, bytes: usize) -> Result<(), PickleError> {
        match self.left.get().checked_sub(bytes) {
            Some(left) => {
                self.left.set(left);
                Ok(())
            }
            None => {
                let wanted = (self.limit - self.left.get()).saturating_add(bytes);
                let what = "memory of the object";
                Err(PickleError::too_large(what, node.at(), wanted, self.limit))
            }
        }
    }
}
