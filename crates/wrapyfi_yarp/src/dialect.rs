//! Data encoding that a peer speaks.
//!
//! ```text
//!              float32   float64   vocab64   sound        image, bytes 40..44
//!   V3           128        10        -      5 elements   i16 quantum, i16 flag
//!   V4            10        20       18      6 elements   i32 quantum
//! ```
//!
//! Connections, commands and the name server are the same in both. Nothing on the wire names the
//! dialect: it is a setting, or the answer to a probe.

/// The data encoding of a connection.
///
/// Integers, strings, vocabs, blobs and lists of them are the same in both, and so is all that
/// Wrapyfi sends as native objects.
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_yarp as yarp; } }
/// use wrapyfi_core::middleware::yarp::Dialect;
/// assert_eq!("v4".parse(), Ok(Dialect::V4));
/// assert_eq!((Dialect::default(), Dialect::V3.other()), (Dialect::V3, Dialect::V4));
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, strum::Display, strum::EnumString)]
#[strum(parse_err_ty = UnknownDialect, parse_err_fn = UnknownDialect::of)]
pub enum Dialect {
    /// YARP 3.9 to 3.12, the installed base.
    #[default]
    #[strum(to_string = "v3", serialize = "V3", serialize = "3")]
    V3,
    /// YARP 4.0.
    #[strum(to_string = "v4", serialize = "V4", serialize = "4")]
    V4,
}

impl Dialect {
    /// The other one: what to try where this one does not fit.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::V3 => Self::V4,
            Self::V4 => Self::V3,
        }
    }
}

/// A word that names no dialect.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no dialect of YARP: write v3 (YARP 3) or v4 (YARP 4)")]
pub struct UnknownDialect(pub String);

impl UnknownDialect {
    fn of(word: &str) -> Self {
        Self(word.to_owned())
    }
}
