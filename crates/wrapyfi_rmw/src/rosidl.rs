//! Structs of the crates that `rosidl_generator_rs` writes, as serialised messages and back.
//!
//! ```text
//!   idiomatic struct ─ into_rmw_message ─▶ struct of C ─ rmw_serialize ──▶ bytes
//!                    ◀─ from_rmw_message ─             ◀ rmw_deserialize ─
//! ```

#![allow(unsafe_code, reason = "rmw reads and writes the structs by their type support")]

use std::borrow::Cow;
use std::mem::ManuallyDrop;

use bytes::Bytes;
#[doc(no_inline)]
pub use rosidl_runtime_rs::{Action, Message, RmwMessage, Service};

use super::subscription::Buffer;
use super::{Fault, TypeHash, sys};

fn type_support<M: Message>() -> *const sys::rosidl_message_type_support_t {
    M::RmwMsg::get_type_support().cast()
}

/// Encapsulation header and body of a message, in the buffer that the middleware filled.
///
/// # Errors
/// When rmw refuses: its middleware has no type support in the package of the message, or there is no memory.
pub fn serialize<M: Message>(message: &M) -> Result<Bytes, Fault> {
    let native = M::into_rmw_message(Cow::Borrowed(message));
    let mut buffer = Buffer::new();
    // SAFETY: the struct is the one that its type support describes; rmw allocates what the bytes need.
    let code = unsafe {
        sys::rmw_serialize(
            std::ptr::from_ref(native.as_ref()).cast(),
            type_support::<M>(),
            &raw mut buffer.0,
        )
    };
    Fault::check("rmw_serialize", code)?;
    Ok(Bytes::from_owner(buffer))
}

/// Reads a message. Bytes of a network are to be checked against the definition before: the middlewares allocate what
/// lengths in them say.
///
/// # Errors
/// When rmw refuses.
pub fn deserialize<M: Message>(cdr: &Bytes) -> Result<M, Fault> {
    let mut native = M::RmwMsg::default();
    // Never dropped, because the memory is not its own.
    let mut bytes = ManuallyDrop::new(Buffer::new());
    bytes.0.buffer = cdr.as_ptr().cast_mut();
    (bytes.0.buffer_length, bytes.0.buffer_capacity) = (cdr.len(), cdr.len());
    // SAFETY: rmw reads the bytes alone, and the struct is the one that its type support describes.
    let code = unsafe {
        sys::rmw_deserialize(&raw const bytes.0, type_support::<M>(), (&raw mut native).cast())
    };
    Fault::check("rmw_deserialize", code)?;
    Ok(M::from_rmw_message(native))
}

/// REP-2016 hash of the definition that the crate was generated from.
///
/// # Errors
/// When the type support has none: before ROS 2 Iron there were none.
pub fn type_hash<M: Message>() -> Result<TypeHash, Fault> {
    let support = type_support::<M>();
    // SAFETY: a generated function gives its type support, which lives as long as the process, and that its hash.
    let hash = unsafe {
        let ask = support.as_ref().and_then(|support| support.get_type_hash_func);
        ask.and_then(|ask| ask(support).as_ref())
    };
    match hash {
        Some(hash) if hash.version == 1 => Ok(hash.value),
        _ => Err(Fault::new("type support", "it has no hash of version 1")),
    }
}
