//! Instructions that make objects of others: containers, calls, state.

use super::arena::{CallData, EDGE, Kind, NodeId};
use super::globals::GETATTR;
use super::machine::{Machine, Result};
use super::{opcode as op, text};

impl Machine<'_> {
    pub(super) fn short_tuple(&mut self, length: usize) -> Result<()> {
        let items = self.take(length)?;
        self.push_tuple(items)
    }

    pub(super) fn push_tuple(&mut self, items: Vec<NodeId>) -> Result<()> {
        if items.is_empty() {
            self.stack.push(NodeId::EMPTY_TUPLE);
            return Ok(());
        }
        self.push(Kind::Tuple(items.into()))
    }

    /// Adds members to the list on top, or to the set for `ADDITEMS`.
    pub(super) fn extend(&mut self, items: &[NodeId]) -> Result<()> {
        self.arena.charge(items.len() * EDGE, self.at)?;
        let (target, set) = (self.top()?, self.code == op::ADDITEMS);
        match self.arena.kind_mut(target) {
            Some(Kind::List(members)) if !set => members.extend_from_slice(items),
            Some(Kind::Set(members)) if set => members.extend_from_slice(items),
            // No plug-in reads what is appended to an object.
            Some(Kind::Call(_)) => {}
            _ => return Err(self.not_a(target, if set { "a set" } else { "a list" })),
        }
        Ok(())
    }

    pub(super) fn pairs(&self, items: &[NodeId]) -> Result<Vec<(NodeId, NodeId)>> {
        let (pairs, rest) = items.as_chunks::<2>();
        if !rest.is_empty() {
            return Err(self.fault("the last key has no value"));
        }
        Ok(pairs.iter().map(|&[key, value]| (key, value)).collect())
    }

    pub(super) fn set_items(&mut self, items: &[NodeId]) -> Result<()> {
        self.arena.charge(items.len() * EDGE, self.at)?;
        let pairs = self.pairs(items)?;
        let target = self.top()?;
        match self.arena.kind_mut(target) {
            Some(Kind::Dict(dict)) => dict.extend(pairs),
            Some(Kind::Call(call)) => call.pairs.extend(pairs),
            _ => return Err(self.not_a(target, "a dict")),
        }
        Ok(())
    }

    /// Notes that a function or class is applied to arguments. Those of Python's own containers are
    /// made at once: they are data however they were written.
    pub(super) fn call(
        &mut self,
        callable: NodeId,
        args: NodeId,
        kwargs: Option<NodeId>,
        new: bool,
    ) -> Result<()> {
        let Kind::Global(global) = *self.arena.kind(callable) else {
            return Err(self.not_a(callable, "a function or class from the list"));
        };
        if std::ptr::eq(global, &raw const GETATTR) && kwargs.is_none() && !new {
            let method = self.method(args)?;
            self.stack.push(method);
            return Ok(());
        }
        if !global.callable {
            return Err(self.fault(format!("{global} is only read as data, it is never called")));
        }
        let Kind::Tuple(items) = self.arena.kind(args) else {
            return Err(self.not_a(args, "a tuple of arguments"));
        };
        if let Some(kwargs) = kwargs
            && !matches!(self.arena.kind(kwargs), Kind::Dict(_))
        {
            return Err(self.not_a(kwargs, "a dict of arguments"));
        }
        if kwargs.is_none() && !new {
            // These calls take three arguments at most; copying all would cost time with each call.
            let args: Vec<NodeId> = items.iter().take(4).copied().collect();
            let plain = match (global.module, global.name) {
                ("_codecs", "encode") => Some(self.encoded(&args)?),
                ("builtins", "bytes") => Some(self.byte_content(&args)?),
                ("builtins", "bytearray") => Some(byte_array(self.byte_content(&args)?)),
                ("builtins", "list") => Some(Kind::List(self.members(&args)?)),
                ("builtins", "tuple") => Some(Kind::Tuple(self.members(&args)?.into())),
                ("builtins", "set") => Some(Kind::Set(self.members(&args)?)),
                ("builtins", "frozenset") => Some(Kind::FrozenSet(self.members(&args)?.into())),
                ("copyreg", "_reconstructor") => {
                    self.check_reconstructor(&args)?;
                    None
                }
                _ => None,
            };
            if let Some(plain) = plain {
                return self.push(plain);
            }
        }
        self.push(Kind::Call(Box::new(CallData { callable, args, state: None, pairs: Vec::new() })))
    }

    /// Notes the state of an object. No `__setstate__` runs, and attributes of anything that is not
    /// such an object stay as they are.
    pub(super) fn build(&mut self, state: NodeId) -> Result<()> {
        let target = self.top()?;
        match self.arena.kind_mut(target) {
            Some(Kind::Call(call)) if call.state.is_none() => {
                call.state = Some(state);
                Ok(())
            }
            Some(Kind::Call(_)) => Err(self.fault("the object has its state already")),
            _ => Err(self.not_a(target, "an object that takes a state")),
        }
    }

    fn not_a(&self, id: NodeId, wanted: &str) -> super::PickleError {
        self.fault(format!("{} where {wanted} should be", self.arena.kind(id).name()))
    }

    /// The one way in which a function of the standard library makes an object from a class: by its
    /// base `object`.
    fn check_reconstructor(&self, args: &[NodeId]) -> Result<()> {
        let is_object = |id| {
            matches!(self.arena.kind(id), Kind::Global(global)
            if global.module == "builtins" && global.name == "object")
        };
        match *args {
            [class, base, NodeId::NONE]
                if is_object(base) && matches!(self.arena.kind(class), Kind::Global(_)) =>
            {
                Ok(())
            }
            _ => Err(self.fault("copyreg._reconstructor with a base other than object")),
        }
    }

    /// The members that `list(x)` and the like would take over.
    fn members(&self, args: &[NodeId]) -> Result<Vec<NodeId>> {
        match *args {
            [] => Ok(Vec::new()),
            [items] => match self.arena.kind(items) {
                Kind::List(items) | Kind::Set(items) => Ok(items.clone()),
                Kind::Tuple(items) | Kind::FrozenSet(items) => Ok(items.to_vec()),
                _ => Err(self.not_a(items, "a list or tuple")),
            },
            _ => Err(self.fault(format!("{} arguments where 1 should be", args.len()))),
        }
    }

    /// `_codecs.encode(text, 'latin1')`: how protocols 0 to 2 write bytes.
    fn encoded(&mut self, args: &[NodeId]) -> Result<Kind> {
        match *args {
            [text, encoding] if self.is_latin1(encoding) => self.latin1(text),
            _ => Err(self.fault("_codecs.encode for anything but 'latin1'")),
        }
    }

    /// The arguments of `bytes` and `bytearray`: nothing, bytes, or text as Latin-1.
    fn byte_content(&mut self, args: &[NodeId]) -> Result<Kind> {
        match *args {
            [] => Ok(Kind::OwnedBytes(Box::default())),
            [text, encoding] if self.is_latin1(encoding) => self.latin1(text),
            [bytes] => match *self.arena.kind(bytes) {
                Kind::Bytes(span) | Kind::ByteArray(span) => Ok(Kind::Bytes(span)),
                Kind::OwnedBytes(ref bytes) | Kind::OwnedByteArray(ref bytes) => {
                    Ok(Kind::OwnedBytes(bytes.clone()))
                }
                _ => Err(self.not_a(bytes, "bytes")),
            },
            _ => Err(self.fault("arguments that are neither bytes nor text as 'latin1'")),
        }
    }

    fn is_latin1(&self, encoding: NodeId) -> bool {
        matches!(self.arena.kind(encoding), Kind::Str(span)
            if matches!(self.scanner.get(*span), b"latin1" | b"latin-1"))
    }

    fn latin1(&mut self, id: NodeId) -> Result<Kind> {
        let length = match self.arena.kind(id) {
            Kind::Str(span) => span.end - span.start,
            Kind::OwnedStr(text) => text.len(),
            _ => return Err(self.not_a(id, "text")),
        };
        // Charged also where nothing is copied, because many calls may look through one long text.
        self.arena.charge(length, self.at)?;
        let owned = match self.arena.kind(id) {
            Kind::Str(span) => {
                let bytes = self.scanner.get(*span);
                if bytes.is_ascii() {
                    return Ok(Kind::Bytes(*span));
                }
                str::from_utf8(bytes).ok().and_then(text::to_latin1)
            }
            Kind::OwnedStr(text) => text::to_latin1(text),
            _ => None,
        };
        let owned = owned.ok_or_else(|| self.fault("a character beyond Latin-1"))?;
        Ok(Kind::OwnedBytes(Box::new(owned.into())))
    }
}

/// The byte array of such bytes.
fn byte_array(bytes: Kind) -> Kind {
    match bytes {
        Kind::Bytes(span) => Kind::ByteArray(span),
        Kind::OwnedBytes(bytes) => Kind::OwnedByteArray(bytes),
        other => other,
    }
}
