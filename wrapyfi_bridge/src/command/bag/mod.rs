//! Recordings: `wrapyfi convert`, `wrapyfi play`, `wrapyfi record`.

pub mod convert;
mod output;
pub mod play;
pub mod record;
mod source;

pub(crate) use self::convert::types;
