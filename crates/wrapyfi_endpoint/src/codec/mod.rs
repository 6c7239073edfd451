//! Bytes to values and back: the codecs of [`wrapyfi_data`], and those of requests, which take a
//! service's settings.
//!
//! | module | reads and writes | specified in |
//! | --- | --- | --- |
//! | [`requests`] | requests and replies on ZeroMQ | docs/reference/wire/zeromq-requests.md |

pub mod requests;

pub use wrapyfi_data::codec::*;
