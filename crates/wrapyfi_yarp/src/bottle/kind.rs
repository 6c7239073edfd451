//! The type codes of both dialects.

use crate::Dialect;

/// The bit that makes a code that of a list.
pub(super) const LIST: i32 = 256;
/// The code of a dictionary.
pub(super) const DICT: i32 = 256 + 512;

/// Kind of a value that is no list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Int8,
    Int16,
    Int32,
    Int64,
    Float32,
    Float64,
    Vocab32,
    Vocab64,
    String,
    Blob,
}

impl Kind {
    const ALL: [Self; 10] = [
        Self::Int8,
        Self::Int16,
        Self::Int32,
        Self::Int64,
        Self::Float32,
        Self::Float64,
        Self::Vocab32,
        Self::Vocab64,
        Self::String,
        Self::Blob,
    ];

    /// Code of the kind; `None` where the dialect lacks the type.
    pub(super) const fn code(self, dialect: Dialect) -> Option<i32> {
        Some(match (self, dialect) {
            (Self::Int32, _) => 1,
            (Self::String, _) => 4,
            (Self::Vocab32, _) => 9,
            (Self::Float64, Dialect::V3) | (Self::Float32, Dialect::V4) => 10,
            (Self::Blob, _) => 12,
            (Self::Int64, _) => 17,
            (Self::Vocab64, Dialect::V3) => return None,
            (Self::Vocab64, Dialect::V4) => 18,
            (Self::Float64, Dialect::V4) => 20,
            (Self::Int8, _) => 32,
            (Self::Int16, _) => 64,
            (Self::Float32, Dialect::V3) => 128,
        })
    }

    pub(super) fn of_code(code: i32, dialect: Dialect) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code(dialect) == Some(code))
    }

    /// Bytes that every value of this kind takes behind its code: all of a number, the length
    /// of a string.
    pub(super) const fn size(self) -> usize {
        match self {
            Self::Int8 => 1,
            Self::Int16 => 2,
            Self::Int32 | Self::Float32 | Self::Vocab32 | Self::String | Self::Blob => 4,
            Self::Int64 | Self::Float64 | Self::Vocab64 => 8,
        }
    }

    /// True when values of this kind all have the same size.
    pub(super) const fn is_sized(self) -> bool {
        !matches!(self, Self::String | Self::Blob)
    }

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Int8 => "an int8",
            Self::Int16 => "an int16",
            Self::Int32 => "an int32",
            Self::Int64 => "an int64",
            Self::Float32 => "a float32",
            Self::Float64 => "a float64",
            Self::Vocab32 => "a vocab",
            Self::Vocab64 => "a 64-bit vocab",
            Self::String => "a string",
            Self::Blob => "a blob",
        }
    }
}

/// Meaning of a code in a bottle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Code {
    /// A value.
    Value(Kind),
    /// A list; of one kind where its elements come without codes.
    List(Option<Kind>),
    /// A dictionary.
    Dict,
}

impl Code {
    pub(super) fn of(code: i32, dialect: Dialect) -> Option<Self> {
        if code == DICT {
            return Some(Self::Dict);
        }
        if code == LIST {
            return Some(Self::List(None));
        }
        match Kind::of_code(code, dialect) {
            Some(kind) => Some(Self::Value(kind)),
            None => {
                Kind::of_code(code.checked_sub(LIST)?, dialect).map(|kind| Self::List(Some(kind)))
            }
        }
    }
}
