//! A serialised message as pieces that need not lie together.

use std::ops::Deref;
use std::sync::OnceLock;

use bytes::{Bytes, BytesMut};

/// Size of the encapsulation header in bytes.
pub const ENCAPSULATION_SIZE: usize = 4;

/// A serialised message: pieces whose concatenation is encapsulation header and body. Large
/// `uint8[]` fields are pieces that share the message's own bytes.
///
/// It is its bytes wherever they are asked for in one piece: pieces are joined by a copy then, once. Who sends
/// [`pieces`](Self::pieces) copies nothing.
///
/// ```
/// use wrapyfi_interfaces::{Message, sensor_msgs::msg::Image};
/// let cdr = Image { data: vec![7; 1 << 20].into(), ..Image::default() }.encode();
/// assert_eq!(cdr.pieces().len(), 2);
/// assert_eq!(cdr[..4], [0, 1, 0, 0]);
/// ```
#[derive(Debug, Clone, Default)]
pub struct CdrParts {
    /// Empty where the message is in one piece.
    pieces: Vec<Bytes>,
    /// The message in one piece, as soon as it is.
    whole: OnceLock<Bytes>,
}

impl CdrParts {
    /// A message of pieces, of which none is empty.
    pub(super) fn of(pieces: Vec<Bytes>) -> Self {
        Self { pieces, whole: OnceLock::new() }
    }

    /// The pieces in order; none is empty.
    pub fn pieces(&self) -> &[Bytes] {
        match self.whole.get() {
            Some(whole) if self.pieces.is_empty() && !whole.is_empty() => {
                std::slice::from_ref(whole)
            }
            _ => &self.pieces,
        }
    }

    /// Size of the whole in bytes.
    pub fn len(&self) -> usize {
        self.pieces().iter().map(Bytes::len).sum()
    }

    /// True without any byte; an encoded message never is.
    pub fn is_empty(&self) -> bool {
        self.pieces().is_empty()
    }

    /// The whole in one piece: a copy the first time, unless there is only one.
    pub fn to_bytes(&self) -> Bytes {
        Bytes::clone(self)
    }
}

impl Deref for CdrParts {
    type Target = Bytes;

    fn deref(&self) -> &Bytes {
        self.whole.get_or_init(|| {
            let mut joined = BytesMut::with_capacity(self.len());
            self.pieces.iter().for_each(|piece| joined.extend_from_slice(piece));
            joined.freeze()
        })
    }
}

/// Messages of the same bytes are one, however these lie.
impl PartialEq for CdrParts {
    fn eq(&self, other: &Self) -> bool {
        self.len() == other.len() && **self == **other
    }
}

/// A message that is serialised already, encapsulation header included.
impl From<Bytes> for CdrParts {
    fn from(cdr: Bytes) -> Self {
        Self { pieces: Vec::new(), whole: cdr.into() }
    }
}

impl From<Vec<u8>> for CdrParts {
    fn from(cdr: Vec<u8>) -> Self {
        Bytes::from(cdr).into()
    }
}

impl From<&'static [u8]> for CdrParts {
    fn from(cdr: &'static [u8]) -> Self {
        Bytes::from_static(cdr).into()
    }
}
