//! Objects that a pickle describes, beside each other, each one naming its parts by number.
//!
//! ```text
//!   nodes   0      1      2      3        4          5
//!           None   False  True   ()       "a"        [4, 4, 5]   a list that holds itself
//! ```
//!
//! An object used twice costs one number more; one that holds itself cannot make a walk over the
//! nodes, or their end, go on for ever.

use bytes::Bytes;
use num_bigint::BigInt;

use super::error::PickleError;
use super::globals::Global;
use wrapyfi_data::Limits;

/// Number of an object in its [`Pickle`].
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed};
/// // pickle.dumps([(same := "a" + "b"), same]): one text, twice in the list
/// let data = b"](X\x02\0\0\0abq\x00h\x00e.".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::BUILTINS, &Limits::default())?;
/// let [first, second] = pickle.root().list()?.exact()?;
/// assert_eq!(first.id(), second.id());
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub(super) u32);

impl NodeId {
    pub(super) const NONE: Self = Self(0);
    pub(super) const FALSE: Self = Self(1);
    pub(super) const TRUE: Self = Self(2);
    pub(super) const EMPTY_TUPLE: Self = Self(3);
}

/// Bytes of the pickle itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub(super) start: usize,
    pub(super) end: usize,
}

#[derive(Debug)]
pub(super) enum Kind {
    None,
    Bool(bool),
    Int(i64),
    BigInt(Box<BigInt>),
    Float(f64),
    /// Valid UTF-8 in the pickle.
    Str(Span),
    OwnedStr(Box<str>),
    Utf16(Box<[u16]>),
    Bytes(Span),
    ByteArray(Span),
    OwnedBytes(Box<Bytes>),
    OwnedByteArray(Box<Bytes>),
    Buffer(u32),
    List(Vec<NodeId>),
    Tuple(Box<[NodeId]>),
    Dict(Vec<(NodeId, NodeId)>),
    Set(Vec<NodeId>),
    FrozenSet(Box<[NodeId]>),
    Global(&'static Global),
    Call(Box<CallData>),
    Persistent(NodeId),
}

/// A function or class applied to arguments, and what was done to the result.
#[derive(Debug)]
pub(super) struct CallData {
    pub(super) callable: NodeId,
    /// A tuple.
    pub(super) args: NodeId,
    pub(super) state: Option<NodeId>,
    pub(super) pairs: Vec<(NodeId, NodeId)>,
}

/// A pickle that was read: its objects by number. No code was executed, and bytes are shared with
/// the input.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed};
/// // pickle.dumps(5), and two bytes that are no part of it
/// let data = b"\x80\x02K\x05.\xff\xff".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::BUILTINS, &Limits::default())?;
/// assert_eq!(pickle.root().int()?, 5);
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug)]
pub struct Pickle {
    pub(super) data: Bytes,
    pub(super) buffers: Vec<Bytes>,
    pub(super) arena: Arena,
    pub(super) root: NodeId,
}

impl Pickle {
    pub(super) fn bytes(&self, span: Span) -> &[u8] {
        self.data.get(span.start..span.end).unwrap_or_default()
    }

    pub(super) fn str(&self, span: Span) -> &str {
        str::from_utf8(self.bytes(span)).unwrap_or_default()
    }

    pub(super) fn shared(&self, span: Span) -> Bytes {
        self.data.slice_ref(self.bytes(span))
    }
}

/// Objects while they are made, and the memory they may still take.
#[derive(Debug)]
pub(super) struct Arena {
    nodes: Vec<Kind>,
    made_at: Vec<u32>,
    left: usize,
    limit: usize,
}

/// Memory of a node: itself and where it was made.
const NODE: usize = size_of::<Kind>() + size_of::<u32>();
/// Memory of a reference to a node.
pub(super) const EDGE: usize = size_of::<NodeId>();

/// Memory that the objects of a pickle may take, in bytes, content that stays in the pickle not
/// counted: a node is tens of bytes, however short its opcode. No opcode needs more than 64 for
/// each of its bytes, unless it copies what others made.
fn budget(pickle_bytes: usize, limits: &Limits) -> usize {
    let honest = pickle_bytes.saturating_mul(64).saturating_add(4 << 10);
    honest.min(limits.message_bytes.saturating_mul(4).max(64 << 10))
}

impl Arena {
    pub(super) fn new(pickle_bytes: usize, limits: &Limits) -> Self {
        let limit = budget(pickle_bytes, limits);
        let nodes =
            vec![Kind::None, Kind::Bool(false), Kind::Bool(true), Kind::Tuple(Box::default())];
        let made_at = vec![0; nodes.len()];
        Self { nodes, made_at, left: limit, limit }
    }

    /// Takes `bytes` from the memory that is left.
    pub(super) fn charge(&mut self, bytes: usize, at: usize) -> Result<(), PickleError> {
        if let Some(left) = self.left.checked_sub(bytes) {
            self.left = left;
            return Ok(());
        }
        let used = self.limit - self.left;
        let wanted = used.saturating_add(bytes);
        Err(PickleError::too_large("memory of the pickle", at, wanted, self.limit))
    }

    pub(super) fn add(&mut self, kind: Kind, at: usize) -> Result<NodeId, PickleError> {
        let more = match &kind {
            Kind::BigInt(value) => usize::try_from(value.bits() / 8).unwrap_or(usize::MAX),
            Kind::OwnedStr(text) => text.len(),
            Kind::Utf16(units) => size_of_val(&**units),
            Kind::OwnedBytes(bytes) | Kind::OwnedByteArray(bytes) => {
                size_of::<Bytes>() + bytes.len()
            }
            Kind::List(items) | Kind::Set(items) => items.len() * EDGE,
            Kind::Tuple(items) | Kind::FrozenSet(items) => items.len() * EDGE,
            Kind::Dict(pairs) => pairs.len() * 2 * EDGE,
            Kind::Call(_) => size_of::<CallData>(),
            _ => 0,
        };
        self.charge(NODE.saturating_add(more), at)?;
        let id = u32::try_from(self.nodes.len()).ok().ok_or(PickleError::TooLarge {
            what: "number of objects",
            at,
            actual: self.nodes.len() as u64,
            limit: u32::MAX.into(),
        })?;
        self.nodes.push(kind);
        self.made_at.push(u32::try_from(at).unwrap_or(u32::MAX));
        Ok(NodeId(id))
    }

    pub(super) fn kind(&self, id: NodeId) -> &Kind {
        // No number without a node is ever made; `None` is the least harmful answer.
        self.nodes.get(id.0 as usize).unwrap_or(&Kind::None)
    }

    pub(super) fn made_at(&self, id: NodeId) -> usize {
        self.made_at.get(id.0 as usize).copied().unwrap_or_default() as usize
    }

    pub(super) fn kind_mut(&mut self, id: NodeId) -> Option<&mut Kind> {
        self.nodes.get_mut(id.0 as usize)
    }
}

impl Kind {
    /// Name of the kind, in Python's words.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Bool(_) => "a bool",
            Self::Int(_) | Self::BigInt(_) => "an int",
            Self::Float(_) => "a float",
            Self::Str(_) | Self::OwnedStr(_) | Self::Utf16(_) => "a str",
            Self::Bytes(_) | Self::OwnedBytes(_) => "bytes",
            Self::ByteArray(_) | Self::OwnedByteArray(_) => "a bytearray",
            Self::Buffer(_) => "an out-of-band buffer",
            Self::List(_) => "a list",
            Self::Tuple(_) => "a tuple",
            Self::Dict(_) => "a dict",
            Self::Set(_) => "a set",
            Self::FrozenSet(_) => "a frozenset",
            Self::Global(_) => "a function or class",
            Self::Call(_) => "an object",
            Self::Persistent(_) => "a persistent id",
        }
    }
}
