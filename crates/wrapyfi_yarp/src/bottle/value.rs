//! One element of a bottle.

use std::borrow::Cow;
use std::fmt;

use bytes::Bytes;

use super::list::Bottle;

/// One element of a bottle: 40 bytes, whatever it holds. Strings and blobs share the bytes of the
/// message they were read from.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// 8-bit integer.
    Int8(i8),
    /// 16-bit integer.
    Int16(i16),
    /// 32-bit integer: what YARP's text and most programs mean by a number without a point.
    Int32(i32),
    /// 64-bit integer.
    Int64(i64),
    /// Single precision.
    Float32(f32),
    /// Double precision.
    Float64(f64),
    /// A word of up to four letters, or a boolean.
    Vocab32(Vocab),
    /// A word of up to eight letters; YARP 4 only.
    Vocab64(Vocab64),
    /// A string.
    String(Text),
    /// Bytes.
    Blob(Bytes),
    /// A list.
    List(Bottle),
    /// A dictionary, YARP's `Property`: its elements are lists of a key and a value.
    Dict(Bottle),
}

impl Value {
    /// A string.
    pub fn string(text: impl Into<Text>) -> Self {
        Self::String(text.into())
    }

    /// A vocab of the first four bytes of `word`, as in `[set]`.
    pub fn vocab(word: &str) -> Self {
        Self::Vocab32(Vocab::new(word))
    }

    /// A blob.
    pub fn blob(bytes: impl Into<Bytes>) -> Self {
        Self::Blob(bytes.into())
    }

    /// The string, where this is one and UTF-8.
    pub fn as_str(&self) -> Option<&str> {
        match self {
            Self::String(text) => text.as_str(),
            _ => None,
        }
    }

    /// The integer, where this is one of any width.
    pub fn as_i64(&self) -> Option<i64> {
        match self {
            Self::Int8(number) => Some(i64::from(*number)),
            Self::Int16(number) => Some(i64::from(*number)),
            Self::Int32(number) => Some(i64::from(*number)),
            Self::Int64(number) => Some(*number),
            _ => None,
        }
    }

    /// The number, where this is an integer or a float. 64-bit integers are rounded.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Self::Float32(number) => Some(f64::from(*number)),
            Self::Float64(number) => Some(*number),
            // The nearest double is what is asked for.
            other => other.as_i64().map(|number| number as f64),
        }
    }

    /// The boolean, where this is one: the vocab `[1]` or the vocab 0 in bottles that programs
    /// put together, `[ok]` or `[fail]` in the structures of YARP's interfaces.
    pub fn as_bool(&self) -> Option<bool> {
        match self {
            Self::Vocab32(Vocab::TRUE | Vocab::OK) => Some(true),
            Self::Vocab32(Vocab::FALSE | Vocab::FAIL) => Some(false),
            _ => None,
        }
    }

    /// The elements, where this is a list or a dictionary.
    pub fn as_list(&self) -> Option<&Bottle> {
        match self {
            Self::List(list) | Self::Dict(list) => Some(list),
            _ => None,
        }
    }

    /// True when the value is `word`, as a vocab or as a string: YARP's commands come as either. Of
    /// a vocab, only as many letters count as it can hold.
    pub fn is_word(&self, word: &str) -> bool {
        match self {
            Self::Vocab32(vocab) => *vocab == Vocab::new(word),
            Self::Vocab64(vocab) => *vocab == Vocab64::new(word),
            Self::String(text) => text.as_bytes() == word.as_bytes(),
            _ => false,
        }
    }
}

macro_rules! value_from {
    ($($from:ty => $variant:ident),* $(,)?) => {
        $(impl From<$from> for Value {
            fn from(value: $from) -> Self {
                Self::$variant(value.into())
            }
        })*
    };
}

value_from! {
    i8 => Int8, i16 => Int16, i32 => Int32, i64 => Int64, f32 => Float32, f64 => Float64,
    bool => Vocab32, Vocab => Vocab32, Vocab64 => Vocab64, &str => String, String => String,
    Text => String, Bytes => Blob, Bottle => List,
}

/// Words of a few letters, as numbers.
macro_rules! vocab {
    ($(#[$doc:meta])* $name:ident($int:ty), $letters:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash)]
        pub struct $name(pub $int);

        impl $name {
            /// The first letters of `word`, as many as there is room for.
            pub fn new(word: &str) -> Self {
                Self::from_bytes(word.as_bytes())
            }

            /// The first of `bytes`, as many as there is room for. Each is added as a signed number,
            /// as YARP does: letters beyond ASCII come out odd, but the same.
            pub fn from_bytes(bytes: &[u8]) -> Self {
                let letters = bytes.iter().take($letters).enumerate();
                Self(letters.fold(0, |code: $int, (place, &letter)| {
                    let letter = <$int>::from(letter.cast_signed());
                    code.wrapping_add(letter.wrapping_shl(8 * place as u32))
                }))
            }

            /// The letters without the zeros that pad them.
            pub fn letters(self) -> Vec<u8> {
                self.0.to_le_bytes().into_iter().filter(|&letter| letter != 0).collect()
            }
        }

        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "[{}]", String::from_utf8_lossy(&self.letters()))
            }
        }
    };
}

vocab! {
    /// Up to four letters in 32 bits, the first in the lowest byte.
    Vocab(i32), 4
}

vocab! {
    /// Up to eight letters in 64 bits, the first in the lowest byte; YARP 4 only.
    Vocab64(i64), 8
}

impl Vocab {
    /// True, written `[1]` and `true`.
    pub const TRUE: Self = Self(0x31);
    /// False: no letters at all.
    pub const FALSE: Self = Self(0);
    /// True in the structures of YARP's interfaces, and "it was done" in replies: `[ok]`.
    pub const OK: Self = Self(0x6b6f);
    /// False in the structures of YARP's interfaces, and "it was not done" in replies: `[fail]`.
    pub const FAIL: Self = Self(0x6c69_6166);
}

impl From<bool> for Vocab {
    fn from(value: bool) -> Self {
        if value { Self::TRUE } else { Self::FALSE }
    }
}

/// Text of a bottle: UTF-8 in practice, any bytes on the wire.
#[derive(Clone, Default, PartialEq, Eq, Hash)]
pub struct Text(Bytes);

impl Text {
    /// The text, where it is UTF-8.
    pub fn as_str(&self) -> Option<&str> {
        std::str::from_utf8(&self.0).ok()
    }

    /// The bytes as they came.
    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    /// The text, with U+FFFD for what is not UTF-8.
    pub fn to_string_lossy(&self) -> Cow<'_, str> {
        String::from_utf8_lossy(&self.0)
    }

    /// The bytes, shared with the message they came in.
    pub fn into_bytes(self) -> Bytes {
        self.0
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.to_string_lossy(), f)
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Self {
        Self(Bytes::copy_from_slice(text.as_bytes()))
    }
}

impl From<String> for Text {
    fn from(text: String) -> Self {
        Self(text.into())
    }
}

impl From<Bytes> for Text {
    fn from(bytes: Bytes) -> Self {
        Self(bytes)
    }
}

impl From<Vec<u8>> for Text {
    fn from(bytes: Vec<u8>) -> Self {
        Self(bytes.into())
    }
}
