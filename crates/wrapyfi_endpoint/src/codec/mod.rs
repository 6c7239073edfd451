//! Bytes to values and back: the codecs of [`wrapyfi_data`], and those of messages that take a topic's or a
//! service's settings.
//!
//! ```text
//!   ZeroMQ frames ─▶ frames ─▶ Payload ─▶ ros ─▶ CDR
//!                      │          ▲
//!        json, npy, jpeg ────────┘          every arrow also runs the other way
//! ```
//!
//! | module | reads and writes | specified in |
//! | --- | --- | --- |
//! | [`frames`] | Wrapyfi's ZeroMQ messages | docs/reference/wire/zeromq.md |
//! | [`requests`] | requests and replies on ZeroMQ | docs/reference/wire/zeromq-requests.md |

pub mod frames;
pub mod requests;

pub use wrapyfi_data::codec::*;
