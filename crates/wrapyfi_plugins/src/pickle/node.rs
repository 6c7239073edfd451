//! An object of a pickle that was read, and the values that it may be read as.
//!
//! A plug-in walks from the root and asks each node for the kind that should be there; where
//! another kind is, the error says so with the path that was taken.

use std::fmt;

use bytes::Bytes;
use num_bigint::BigInt;

use super::arena::{Kind, NodeId, Pickle};
use super::call::PickleCall;
use super::error::PickleError;
use super::globals::Global;
use super::items::{Items, Pairs};
use super::trail::{PathStep, Trail};
use wrapyfi_data::codec::{SHOWN, quote};

/// One object of a [`Pickle`]. Copying it costs nothing.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed};
///
/// // pickle.dumps(("speed", 1.5), 2)
/// let data = b"\x80\x02X\x05\0\0\0speedG?\xf8\0\0\0\0\0\0\x86.".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::BUILTINS, &Limits::default())?;
/// let [name, value] = pickle.root().tuple()?.exact()?;
/// assert_eq!((name.str()?, value.float()?), ("speed", 1.5));
/// let error = value.str().unwrap_err();
/// assert_eq!(error.to_string(), "$[1] should be a str, it is the float 1.5 (byte 12)");
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Clone, Copy)]
pub struct Node<'p> {
    pub(super) pickle: &'p Pickle,
    pub(super) id: NodeId,
    pub(super) trail: Trail,
}

/// Kind and content of a [`Node`], for `match`.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed, View};
/// // pickle.dumps("hello")
/// let data = b"\x80\x02X\x05\0\0\0hello.".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::BUILTINS, &Limits::default())?;
/// let length = match pickle.root().view() {
///     View::Str(text) => text.len(),
///     View::List(items) | View::Tuple(items) => items.len(),
///     _ => 0,
/// };
/// assert_eq!(length, 5);
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum View<'p> {
    /// `None`.
    None,
    /// `True` or `False`.
    Bool(bool),
    /// An integer that fits 64 bits signed.
    Int(i64),
    /// An integer that does not fit.
    BigInt(&'p BigInt),
    /// A float.
    Float(f64),
    /// Text.
    Str(&'p str),
    /// Text with lone surrogates, as UTF-16 code units.
    Utf16(&'p [u16]),
    /// `bytes`; [`Node::bytes`] shares them.
    Bytes(&'p [u8]),
    /// `bytearray`; [`Node::bytes`] shares it.
    ByteArray(&'p [u8]),
    /// A buffer that came beside the pickle.
    Buffer(&'p Bytes),
    /// `list`.
    List(Items<'p>),
    /// `tuple`.
    Tuple(Items<'p>),
    /// `dict`; a key may come twice, the last one counts.
    Dict(Pairs<'p>),
    /// `set`; a member may come twice.
    Set(Items<'p>),
    /// `frozenset`; a member may come twice.
    FrozenSet(Items<'p>),
    /// A function or class, named as data.
    Global(&'static Global),
    /// A function or class applied to arguments.
    Call(PickleCall<'p>),
    /// An object beside the pickle, by its id.
    Persistent(Node<'p>),
}

type Result<T> = std::result::Result<T, PickleError>;

impl Pickle {
    /// The object that was pickled.
    pub fn root(&self) -> Node<'_> {
        Node { pickle: self, id: self.root, trail: Trail::default() }
    }
}

/// Methods that read an object as one kind of value.
macro_rules! kinds {
    ($($(#[$doc:meta])* $name:ident -> $value:ty: $($view:ident)|+, $expected:literal;)*) => {$(
        $(#[$doc])*
        ///
        /// # Errors
        /// When the object is of another kind.
        pub fn $name(&self) -> Result<$value> {
            match self.view() {
                $(View::$view(value))|+ => Ok(value),
                _ => Err(self.unexpected($expected)),
            }
        }
    )*};
}

impl<'p> Node<'p> {
    pub(super) fn child(&self, id: NodeId, step: PathStep) -> Self {
        Self { pickle: self.pickle, id, trail: self.trail.and(step) }
    }

    fn kind(&self) -> &'p Kind {
        self.pickle.arena.kind(self.id)
    }

    /// Number of the object: two nodes with the same number are the same Python object.
    pub fn id(&self) -> NodeId {
        self.id
    }

    /// Byte of the opcode that made the object, as `pickletools.dis` shows it.
    #[must_use]
    pub fn at(&self) -> usize {
        self.pickle.arena.made_at(self.id)
    }

    /// Path from the root to the object: `$._mgr.args[0]`.
    pub fn path(&self) -> String {
        let mut path = String::from(if self.trail.is_cut() { "$…" } else { "$" });
        for step in self.trail.steps() {
            match step {
                PathStep::Index(index) => path += &format!("[{index}]"),
                PathStep::Arg(index) => path += &format!(".args[{index}]"),
                PathStep::KeyAt(index) => path += &format!(".keys[{index}]"),
                PathStep::State => path += ".state",
                PathStep::Persistent => path += ".id",
                PathStep::Key(id) => {
                    let key = Node { id, ..*self };
                    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
                    match key.view() {
                        View::Str(text)
                            if (1..=SHOWN).contains(&text.len()) && text.chars().all(plain) =>
                        {
                            path.push('.');
                            path += text;
                        }
                        _ => path += &format!("[{key}]"),
                    }
                }
            }
        }
        path
    }

    /// Error for an object of another kind than `expected`.
    pub fn unexpected(&self, expected: impl Into<String>) -> PickleError {
        PickleError::Unexpected {
            path: self.path(),
            expected: expected.into(),
            actual: self.to_string(),
            at: self.at(),
        }
    }

    /// Error for an object that is made as its kind, but says what cannot be.
    pub(crate) fn invalid(&self, what: &'static str, reason: impl Into<String>) -> PickleError {
        PickleError::Invalid { what, path: self.path(), reason: reason.into(), at: self.at() }
    }

    /// Kind and content of the object.
    pub fn view(&self) -> View<'p> {
        let pickle = self.pickle;
        let items = |ids| Items { owner: *self, step: PathStep::Index, ids };
        match self.kind() {
            Kind::None => View::None,
            Kind::Bool(value) => View::Bool(*value),
            Kind::Int(value) => View::Int(*value),
            Kind::BigInt(value) => View::BigInt(value),
            Kind::Float(value) => View::Float(*value),
            Kind::Str(span) => View::Str(pickle.str(*span)),
            Kind::OwnedStr(text) => View::Str(text),
            Kind::Utf16(units) => View::Utf16(units),
            Kind::Bytes(span) => View::Bytes(pickle.bytes(*span)),
            Kind::OwnedBytes(bytes) => View::Bytes(bytes),
            Kind::ByteArray(span) => View::ByteArray(pickle.bytes(*span)),
            Kind::OwnedByteArray(bytes) => View::ByteArray(bytes),
            // The reader has checked the index.
            Kind::Buffer(index) => match pickle.buffers.get(*index as usize) {
                Some(content) => View::Buffer(content),
                None => View::None,
            },
            Kind::List(ids) => View::List(items(ids)),
            Kind::Tuple(ids) => View::Tuple(items(ids)),
            Kind::Set(ids) => View::Set(items(ids)),
            Kind::FrozenSet(ids) => View::FrozenSet(items(ids)),
            Kind::Dict(pairs) => View::Dict(Pairs { owner: *self, ids: pairs }),
            Kind::Global(global) => View::Global(global),
            Kind::Call(data) => View::Call(PickleCall { node: *self, data }),
            Kind::Persistent(id) => View::Persistent(self.child(*id, PathStep::Persistent)),
        }
    }

    /// True for `None`.
    pub fn is_none(&self) -> bool {
        matches!(self.kind(), Kind::None)
    }

    /// The node, or nothing where the object is `None`.
    #[must_use]
    pub fn option(self) -> Option<Self> {
        (!self.is_none()).then_some(self)
    }

    kinds! {
        /// The object as a `bool`.
        bool -> bool: Bool, "a bool";
        /// The object as an integer that fits 64 bits signed.
        int -> i64: Int, "an int of 64 bits";
        /// The object as a float.
        float -> f64: Float, "a float";
        /// The object as text without lone surrogates.
        str -> &'p str: Str, "a str";
        /// The object as a `list`.
        list -> Items<'p>: List, "a list";
        /// The object as a `tuple`.
        tuple -> Items<'p>: Tuple, "a tuple";
        /// The object as a `list` or a `tuple`.
        sequence -> Items<'p>: List | Tuple, "a list or tuple";
        /// The object as a `dict`.
        dict -> Pairs<'p>: Dict, "a dict";
        /// The object as a function or class named as data.
        global -> &'static Global: Global, "a function or class";
        /// The object as a call of any function or class.
        any_call -> PickleCall<'p>: Call, "an object";
        /// The id of something beside the pickle.
        persistent -> Node<'p>: Persistent, "a persistent id";
    }

    /// The object as an integer that can be a size or an index.
    ///
    /// # Errors
    /// As [`Self::bool`].
    pub fn size(&self) -> Result<usize> {
        let size = self.int().ok().and_then(|value| usize::try_from(value).ok());
        size.ok_or_else(|| self.unexpected("an int of 0 or more"))
    }

    /// The object as bytes, which are shared: of `bytes`, a `bytearray` or an out-of-band buffer.
    ///
    /// # Errors
    /// As [`Self::bool`].
    pub fn bytes(&self) -> Result<Bytes> {
        match self.kind() {
            Kind::Bytes(span) | Kind::ByteArray(span) => Ok(self.pickle.shared(*span)),
            Kind::OwnedBytes(bytes) | Kind::OwnedByteArray(bytes) => Ok(Bytes::clone(bytes)),
            Kind::Buffer(index) => match self.pickle.buffers.get(*index as usize) {
                Some(buffer) => Ok(buffer.clone()),
                None => Err(self.unexpected("bytes")),
            },
            _ => Err(self.unexpected("bytes")),
        }
    }

    /// True for exactly this function or class, named as data: `is_global("numpy.ndarray")`.
    pub fn is_global(&self, dotted: &str) -> bool {
        matches!(self.kind(), Kind::Global(global) if global.is(dotted))
    }

    /// The object as a call of this function or class: `call("torch._utils._rebuild_tensor_v2")`.
    ///
    /// # Errors
    /// As [`Self::bool`].
    pub fn call(&self, dotted: &str) -> Result<PickleCall<'p>> {
        self.call_of(&[dotted])
    }

    /// The object as a call of one of these functions or classes.
    ///
    /// # Errors
    /// As [`Self::bool`].
    pub fn call_of(&self, dotted: &[&str]) -> Result<PickleCall<'p>> {
        match self.view() {
            View::Call(call) if dotted.iter().any(|name| call.global().is(name)) => Ok(call),
            _ => Err(self.unexpected(format!("an object of {}", dotted.join(" or ")))),
        }
    }
}

impl Global {
    /// True for `dotted`, for instance `numpy.core.multiarray._reconstruct`.
    pub fn is(&self, dotted: &str) -> bool {
        dotted.strip_prefix(self.module).and_then(|rest| rest.strip_prefix('.')) == Some(self.name)
    }
}

/// Writes the node in the words of an error message: `the int 5`.
impl fmt::Display for Node<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.view() {
            View::Bool(value) => f.write_str(if value { "True" } else { "False" }),
            View::Int(value) => write!(f, "the int {value}"),
            View::Float(value) => write!(f, "the float {value}"),
            View::Str(text) => write!(f, "the str {}", quote(text)),
            View::Bytes(bytes) => write!(f, "{} bytes", bytes.len()),
            View::List(items) => write!(f, "a list of {}", items.len()),
            View::Tuple(items) => write!(f, "a tuple of {}", items.len()),
            View::Dict(pairs) => write!(f, "a dict of {}", pairs.len()),
            View::Global(global) => write!(f, "the name {global}"),
            View::Call(call) => write!(f, "an object of {}", call.global()),
            _ => f.write_str(self.kind().name()),
        }
    }
}

impl fmt::Debug for Node<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {self}", self.path())
    }
}
