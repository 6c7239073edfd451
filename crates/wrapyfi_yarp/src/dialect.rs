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

use std::fmt;
use std::str::FromStr;

/// The data encoding of a connection.
///
/// Integers, strings, vocabs, blobs and lists of them are the same in both, and so is all that
/// Wrapyfi sends as native objects.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Dialect {
    /// YARP 3.9 to 3.12, the installed base.
    #[default]
    V3,
    /// YARP 4.0.
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

impl fmt::Display for Dialect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::V3 => "v3",
            Self::V4 => "v4",
        })
    }
}

/// A word that names no dialect.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no dialect of YARP: write v3 (YARP 3) or v4 (YARP 4)")]
pub struct UnknownDialect(pub String);

impl FromStr for Dialect {
    type Err = UnknownDialect;

    fn from_str(text: &str) -> Result<Self, UnknownDialect> {
        match text {
            "v3" | "V3" | "3" => Ok(Self::V3),
            "v4" | "V4" | "4" => Ok(Self::V4),
            other => Err(UnknownDialect(other.to_owned())),
        }
    }
}
