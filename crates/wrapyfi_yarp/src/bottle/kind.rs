//! The type codes of both dialects.

use strum::IntoEnumIterator as _;

use crate::Dialect;

/// The bit that makes a code that of a list.
pub(super) const LIST: i32 = 256;
/// The code of a dictionary.
pub(super) const DICT: i32 = 256 + 512;

/// Kind of a value that is no list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumIter)]
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
    /// Words for the kind, the bytes that every value of it takes behind its code (all of a number, the
    /// length of a string), and its codes in V3 and V4; `None` where the dialect lacks the type.
    const fn row(self) -> (&'static str, usize, Option<i32>, Option<i32>) {
        match self {
            Self::Int8 => ("an int8", 1, Some(32), Some(32)),
            Self::Int16 => ("an int16", 2, Some(64), Some(64)),
            Self::Int32 => ("an int32", 4, Some(1), Some(1)),
            Self::Int64 => ("an int64", 8, Some(17), Some(17)),
            Self::Float32 => ("a float32", 4, Some(128), Some(10)),
            Self::Float64 => ("a float64", 8, Some(10), Some(20)),
            Self::Vocab32 => ("a vocab", 4, Some(9), Some(9)),
            Self::Vocab64 => ("a 64-bit vocab", 8, None, Some(18)),
            Self::String => ("a string", 4, Some(4), Some(4)),
            Self::Blob => ("a blob", 4, Some(12), Some(12)),
        }
    }

    /// Code of the kind; `None` where the dialect lacks the type.
    pub(super) const fn code(self, dialect: Dialect) -> Option<i32> {
        let (_, _, v3, v4) = self.row();
        match dialect {
            Dialect::V3 => v3,
            Dialect::V4 => v4,
        }
    }

    pub(super) fn of_code(code: i32, dialect: Dialect) -> Option<Self> {
        Self::iter().find(|kind| kind.code(dialect) == Some(code))
    }

    pub(super) const fn size(self) -> usize {
        self.row().1
    }

    /// True when values of this kind all have the same size.
    pub(super) const fn is_sized(self) -> bool {
        !matches!(self, Self::String | Self::Blob)
    }

    pub(super) const fn name(self) -> &'static str {
        self.row().0
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
