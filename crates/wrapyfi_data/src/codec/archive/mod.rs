//! Zip archives as `torch.save` writes them: members found without unpacking anything, stored ones
//! shared with the message.
//!
//! ```text
//!   local header │ name │ padding │ data … │ local header │ … │ directory │ end record
//!                                   │                            │             │
//!   read: stored ─▶ slice, no copy  ┘   members, names, sizes ◀──┘ ◀── found ──┘
//!         deflated ─▶ inflated, at most as long as the directory says, booked before
//! ```
//!
//! The directory is read here and not by the crate `zip`, which sizes its tables by counts that the
//! archive claims, and copies members that could be shared.

mod read;
mod write;

pub(crate) use read::Archive;
#[cfg(feature = "torch")]
pub(crate) use read::Member;
pub(crate) use write::Writer;

const LOCAL: &[u8; 4] = b"PK\x03\x04";
const DIRECTORY: &[u8; 4] = b"PK\x01\x02";
const END: &[u8; 4] = b"PK\x05\x06";
/// Length of an end record without its comment.
const END_LENGTH: usize = 22;
/// Length of a directory entry without name, extra field and comment.
const ENTRY_LENGTH: usize = 46;
/// Length of a local header without name and extra field.
const LOCAL_LENGTH: usize = 30;
