//! The way of a [`Value`] inside a Rust type through serde as it is, arrays shared.
//!
//! ```text
//!   Value: Serialize ─▶ newtype NAME ─▶ ToValue: asks ─▶ Content puts a clone on the slot ─▶ taken
//!                                       any other format ─▶ Content writes itself (foreign.rs)
//! ```
//!
//! serde's interface has no way to hand a value of a known type across, and the serializer's type
//! is unknown inside `Serialize`. A slot of the thread carries it; it is empty outside the call.

use std::cell::{Cell, RefCell};

use super::TypedError;
use crate::types::Value;

/// Name of the newtype by which a value announces itself.
pub(super) const NAME: &str = "$wrapyfi_data::types::Value";

thread_local! {
    static ASKED: Cell<bool> = const { Cell::new(false) };
    static SLOT: RefCell<Option<Value>> = const { RefCell::new(None) };
}

/// Runs `serialize`, which shall offer a value; the value.
pub(super) fn ask(
    serialize: impl FnOnce() -> Result<Value, TypedError>,
) -> Result<Value, TypedError> {
    ASKED.set(true);
    let plain = serialize();
    ASKED.set(false);
    match SLOT.take() {
        Some(value) => Ok(value),
        None => plain,
    }
}

/// Puts `value` on the slot if it was asked for; true if so.
pub(super) fn offer(value: impl FnOnce() -> Value) -> bool {
    let asked = ASKED.replace(false);
    if asked {
        SLOT.set(Some(value()));
    }
    asked
}

/// Puts `value` on the slot for the visitor that [`take`]s it.
pub(super) fn lend<T>(value: Value, visit: impl FnOnce() -> T) -> T {
    SLOT.set(Some(value));
    let result = visit();
    SLOT.set(None);
    result
}

/// The value that was lent.
pub(super) fn take() -> Option<Value> {
    SLOT.take()
}
