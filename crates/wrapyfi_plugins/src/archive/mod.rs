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
//! Archives are written by the crate `zip`. Their directory is read here, because that crate sizes its tables by
//! counts that the archive claims, and copies members that could be shared.

mod read;
mod write;

pub(crate) use read::Archive;
#[cfg(feature = "torch")]
pub(crate) use read::Member;
pub(crate) use write::Writer;
