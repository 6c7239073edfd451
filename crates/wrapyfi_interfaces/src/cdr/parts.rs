//! A serialised message as pieces that need not lie together.

use bytes::{Bytes, BytesMut};

/// Size of the encapsulation header in bytes.
pub const ENCAPSULATION_SIZE: usize = 4;

/// A serialised message: pieces whose concatenation is encapsulation header and body. Large
/// `uint8[]` fields are pieces that share the message's own bytes.
#[derive(Debug, Clone, Default)]
pub struct CdrParts {
    pub(super) pieces: Vec<Bytes>,
}

impl CdrParts {
    /// The pieces in order; none is empty.
    pub fn pieces(&self) -> &[Bytes] {
        &self.pieces
    }

    /// Size of the whole in bytes.
    pub fn len(&self) -> usize {
        self.pieces.iter().map(Bytes::len).sum()
    }

    /// True without any byte; an encoded message never is.
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// The whole in one piece: a copy, unless there is only one.
    pub fn to_bytes(&self) -> Bytes {
        if let [only] = self.pieces.as_slice() {
            return only.clone();
        }
        let mut joined = BytesMut::with_capacity(self.len());
        for piece in &self.pieces {
            joined.extend_from_slice(piece);
        }
        joined.freeze()
    }
}

/// A message that is serialised already, encapsulation header included.
impl From<Bytes> for CdrParts {
    fn from(cdr: Bytes) -> Self {
        let pieces = if cdr.is_empty() { Vec::new() } else { vec![cdr] };
        Self { pieces }
    }
}
