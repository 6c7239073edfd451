//! Reads a pickle's instructions into the arena. Nothing is recursive here.
//!
//! ```text
//!   opcodes ─▶ stack of node numbers, marks between them ─▶ arena
//!                     ▲      │
//!                     └ memo ┘
//! ```

use bytes::Bytes;
use num_bigint::BigInt;

use super::arena::{Arena, EDGE, Kind, NodeId, Pickle, Span};
use super::error::PickleError;
use super::globals::Allowed;
use super::scan::Scanner;
use super::{opcode as op, text};
use crate::Limits;

pub(super) type Result<T> = std::result::Result<T, PickleError>;

/// Newest protocol there is.
const PROTOCOL: u8 = 5;
/// Digits of the longest integer written as text: Python's own limit.
const MAX_DIGITS: usize = 4300;
/// Not in the memo.
const UNSET: NodeId = NodeId(u32::MAX);

pub(super) struct Machine<'a> {
    scanner: Scanner<'a>,
    buffers: &'a [Bytes],
    allowed: &'a Allowed,
    pub(super) arena: Arena,
    stack: Vec<NodeId>,
    /// Heights of the stack at each mark.
    marks: Vec<usize>,
    memo: Vec<NodeId>,
    /// Objects in the memo, which is the number of the next one.
    memoised: usize,
    next_buffer: usize,
    /// Code and byte of the instruction at work.
    code: u8,
    pub(super) at: usize,
}

pub(super) fn run(
    data: &Bytes,
    buffers: &[Bytes],
    allowed: &Allowed,
    limits: &Limits,
) -> Result<Pickle> {
    let size = buffers.iter().fold(data.len(), |size, buffer| size.saturating_add(buffer.len()));
    if size > limits.message_bytes {
        return Err(PickleError::TooLarge {
            what: "pickle with its buffers",
            at: 0,
            actual: size as u64,
            limit: limits.message_bytes as u64,
        });
    }
    let mut machine = Machine {
        scanner: Scanner { data, at: 0 },
        buffers,
        allowed,
        arena: Arena::new(limits),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
        memoised: 0,
        next_buffer: 0,
        code: 0,
        at: 0,
    };
    let root = loop {
        if let Some(root) = machine.step()? {
            break root;
        }
    };
    Ok(Pickle {
        data: data.clone(),
        buffers: buffers.to_vec(),
        nodes: machine.arena.nodes,
        made_at: machine.arena.made_at,
        root,
        end: machine.scanner.at,
    })
}

impl<'a> Machine<'a> {
    /// Does one instruction. The object that was pickled, when it was the last.
    fn step(&mut self) -> Result<Option<NodeId>> {
        self.at = self.scanner.at;
        let [code] = self.scanner.array("an opcode")?;
        self.code = code;
        match code {
            op::STOP => return self.pop().map(Some),
            op::PROTO => self.protocol()?,
            op::FRAME => self.frame()?,

            op::NONE => self.stack.push(NodeId::NONE),
            op::NEWTRUE => self.stack.push(NodeId::TRUE),
            op::NEWFALSE => self.stack.push(NodeId::FALSE),
            op::BININT1 => {
                let [value] = self.scanner.array("BININT1")?;
                self.push(Kind::Int(value.into()))?;
            }
            op::BININT2 => {
                let value = u16::from_le_bytes(self.scanner.array("BININT2")?);
                self.push(Kind::Int(value.into()))?;
            }
            op::BININT => {
                let value = i32::from_le_bytes(self.scanner.array("BININT")?);
                self.push(Kind::Int(value.into()))?;
            }
            op::LONG1 => self.long(1)?,
            op::LONG4 => self.long(4)?,
            op::INT | op::LONG => self.decimal()?,
            op::BINFLOAT => {
                let value = f64::from_be_bytes(self.scanner.array("BINFLOAT")?);
                self.push(Kind::Float(value))?;
            }
            op::FLOAT => self.float()?,

            op::SHORT_BINUNICODE => self.unicode(1)?,
            op::BINUNICODE => self.unicode(4)?,
            op::BINUNICODE8 => self.unicode(8)?,
            op::UNICODE => {
                let line = self.scanner.line("UNICODE")?;
                let kind = text::raw_unicode_escape(self.scanner.get(line));
                let kind = kind.map_err(|reason| self.fault(reason))?;
                self.push(kind)?;
            }
            op::SHORT_BINBYTES => self.counted(1, Kind::Bytes)?,
            op::BINBYTES => self.counted(4, Kind::Bytes)?,
            op::BINBYTES8 => self.counted(8, Kind::Bytes)?,
            op::BYTEARRAY8 => self.counted(8, Kind::ByteArray)?,
            op::SHORT_BINSTRING => self.byte_string(1)?,
            op::BINSTRING => self.byte_string(4)?,
            op::STRING => {
                let line = self.scanner.line("STRING")?;
                let bytes = text::quoted(self.scanner.get(line));
                let bytes = bytes.map_err(|reason| self.fault(reason))?;
                self.push(text::latin1(&bytes, None))?;
            }
            op::NEXT_BUFFER => self.buffer()?,
            op::READONLY_BUFFER => self.readonly()?,

            op::EMPTY_TUPLE => self.stack.push(NodeId::EMPTY_TUPLE),
            op::TUPLE1 => self.short_tuple(1)?,
            op::TUPLE2 => self.short_tuple(2)?,
            op::TUPLE3 => self.short_tuple(3)?,
            op::TUPLE => {
                let items = self.pop_mark()?;
                self.push_tuple(items)?;
            }
            op::EMPTY_LIST => self.push(Kind::List(Vec::new()))?,
            op::LIST => {
                let items = self.pop_mark()?;
                self.push(Kind::List(items))?;
            }
            op::APPEND => {
                let item = self.pop()?;
                self.append(&[item])?;
            }
            op::APPENDS => {
                let items = self.pop_mark()?;
                self.append(&items)?;
            }
            op::EMPTY_DICT => self.push(Kind::Dict(Vec::new()))?,
            op::DICT => {
                let pairs = self.pop_mark()?;
                let pairs = self.pairs(&pairs)?;
                self.push(Kind::Dict(pairs))?;
            }
            op::SETITEM => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.set_items(&[key, value])?;
            }
            op::SETITEMS => {
                let items = self.pop_mark()?;
                self.set_items(&items)?;
            }
            op::EMPTY_SET => self.push(Kind::Set(Vec::new()))?,
            op::ADDITEMS => {
                let items = self.pop_mark()?;
                self.add_items(&items)?;
            }
            op::FROZENSET => {
                let items = self.pop_mark()?;
                self.push(Kind::FrozenSet(items.into()))?;
            }

            op::MARK => self.marks.push(self.stack.len()),
            // A mark on top is what goes.
            op::POP if self.marks.last() == Some(&self.stack.len()) => drop(self.marks.pop()),
            op::POP => drop(self.pop()?),
            op::POP_MARK => drop(self.pop_mark()?),
            op::DUP => {
                let top = self.top()?;
                self.stack.push(top);
            }

            op::MEMOIZE => self.put(self.memoised as u64)?,
            op::BINPUT => {
                let [index] = self.scanner.array("BINPUT")?;
                self.put(index.into())?;
            }
            op::LONG_BINPUT => {
                let index = u32::from_le_bytes(self.scanner.array("LONG_BINPUT")?);
                self.put(index.into())?;
            }
            op::PUT => {
                let index = self.index("PUT")?;
                self.put(index)?;
            }
            op::BINGET => {
                let [index] = self.scanner.array("BINGET")?;
                self.get(index.into())?;
            }
            op::LONG_BINGET => {
                let index = u32::from_le_bytes(self.scanner.array("LONG_BINGET")?);
                self.get(index.into())?;
            }
            op::GET => {
                let index = self.index("GET")?;
                self.get(index)?;
            }

            op::GLOBAL => {
                let global = self.named_global()?;
                self.stack.push(global);
            }
            op::STACK_GLOBAL => self.stack_global()?,
            op::REDUCE => {
                let args = self.pop()?;
                let callable = self.pop()?;
                self.call(callable, args, None, false)?;
            }
            op::NEWOBJ => {
                let args = self.pop()?;
                let class = self.pop()?;
                self.call(class, args, None, true)?;
            }
            op::NEWOBJ_EX => {
                let kwargs = self.pop()?;
                let args = self.pop()?;
                let class = self.pop()?;
                self.call(class, args, Some(kwargs), true)?;
            }
            op::INST => {
                let class = self.named_global()?;
                let args = self.pop_mark()?;
                self.push_tuple(args)?;
                let args = self.pop()?;
                self.call(class, args, None, false)?;
            }
            op::OBJ => {
                let mut args = self.pop_mark()?;
                if args.is_empty() {
                    return Err(self.fault("the class is missing"));
                }
                let class = args.remove(0);
                self.push_tuple(args)?;
                let args = self.pop()?;
                self.call(class, args, None, false)?;
            }
            op::BUILD => {
                let state = self.pop()?;
                self.build(state)?;
            }

            op::PERSID => {
                self.check_persistent()?;
                let line = self.scanner.line("PERSID")?;
                self.push(text::latin1(self.scanner.get(line), Some(line)))?;
                let id = self.pop()?;
                self.push(Kind::Persistent(id))?;
            }
            op::BINPERSID => {
                self.check_persistent()?;
                let id = self.pop()?;
                self.push(Kind::Persistent(id))?;
            }
            op::EXT1 | op::EXT2 | op::EXT4 => {
                return Err(self.fault("the extension registry names code of the sender's process"));
            }
            _ => return Err(self.fault("no instruction of protocols 0 to 5")),
        }
        Ok(None)
    }

    pub(super) fn fault(&self, reason: impl Into<String>) -> PickleError {
        PickleError::Opcode { opcode: op::name(self.code), at: self.at, reason: reason.into() }
    }

    // The stack.

    pub(super) fn push(&mut self, kind: Kind) -> Result<()> {
        let id = self.arena.add(kind, self.at)?;
        self.stack.push(id);
        Ok(())
    }

    pub(super) fn push_id(&mut self, id: NodeId) {
        self.stack.push(id);
    }

    /// The object on top. What lies below a mark is out of reach until the mark is taken away.
    pub(super) fn top(&self) -> Result<NodeId> {
        let floor = self.marks.last().copied().unwrap_or_default();
        match self.stack.last() {
            Some(&top) if self.stack.len() > floor => Ok(top),
            _ => Err(self.fault("the stack is empty")),
        }
    }

    fn pop(&mut self) -> Result<NodeId> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    /// The last `count` objects, in the order in which they were pushed.
    pub(super) fn take(&mut self, count: usize) -> Result<Vec<NodeId>> {
        let floor = self.marks.last().copied().unwrap_or_default();
        match self.stack.len().checked_sub(count) {
            Some(start) if start >= floor => Ok(self.stack.split_off(start)),
            _ => Err(self.fault("the stack is empty")),
        }
    }

    /// Everything above the last mark, and the mark.
    fn pop_mark(&mut self) -> Result<Vec<NodeId>> {
        let floor = self.marks.pop().ok_or_else(|| self.fault("there is no mark"))?;
        Ok(self.stack.split_off(floor.min(self.stack.len())))
    }

    pub(super) fn span_bytes(&self, span: Span) -> &'a [u8] {
        self.scanner.get(span)
    }

    // The memo.

    fn put(&mut self, index: u64) -> Result<()> {
        let top = self.top()?;
        // A pickler counts, and every object takes a byte at least.
        let limit = self.scanner.data.len();
        let place = usize::try_from(index).ok().filter(|&place| place <= limit);
        let place = place.ok_or(PickleError::TooLarge {
            what: "memo index",
            at: self.at,
            actual: index,
            limit: limit as u64,
        })?;
        if place >= self.memo.len() {
            self.arena.charge((place + 1 - self.memo.len()) * EDGE, self.at)?;
            self.memo.resize(place + 1, UNSET);
        }
        if let Some(entry) = self.memo.get_mut(place) {
            self.memoised += usize::from(*entry == UNSET);
            *entry = top;
        }
        Ok(())
    }

    fn get(&mut self, index: u64) -> Result<()> {
        let entry = usize::try_from(index).ok().and_then(|index| self.memo.get(index)).copied();
        match entry.filter(|&id| id != UNSET) {
            Some(id) => {
                self.stack.push(id);
                Ok(())
            }
            None => Err(self.fault(format!("the memo has no object number {index}"))),
        }
    }

    fn index(&mut self, what: &'static str) -> Result<u64> {
        let line = self.scanner.line(what)?;
        self.line_text(line)
            .and_then(|text| text.parse().ok())
            .ok_or_else(|| self.fault("the memo's index is no number"))
    }

    fn line_text(&self, line: Span) -> Option<&'a str> {
        str::from_utf8(self.scanner.get(line)).ok().map(str::trim)
    }

    // Headers.

    fn protocol(&mut self) -> Result<()> {
        let [version] = self.scanner.array("PROTO")?;
        if version > PROTOCOL {
            return Err(self.fault(format!("protocol {version}, the newest known is {PROTOCOL}")));
        }
        Ok(())
    }

    /// A frame says only how much may be read ahead; one that is not there is refused.
    fn frame(&mut self) -> Result<()> {
        let length = u64::from_le_bytes(self.scanner.array("FRAME")?);
        let start = self.scanner.at;
        self.scanner.span("a frame", length)?;
        self.scanner.at = start;
        Ok(())
    }

    // Atoms.

    /// The bytes behind a length of `width` bytes.
    fn counted_span(&mut self, width: u8) -> Result<Span> {
        let length = match width {
            1 => u64::from(u8::from_le_bytes(self.scanner.array("a length")?)),
            4 => u64::from(u32::from_le_bytes(self.scanner.array("a length")?)),
            _ => u64::from_le_bytes(self.scanner.array("a length")?),
        };
        self.scanner.span("counted bytes", length)
    }

    fn counted(&mut self, width: u8, kind: fn(Span) -> Kind) -> Result<()> {
        let span = self.counted_span(width)?;
        self.push(kind(span))
    }

    fn unicode(&mut self, width: u8) -> Result<()> {
        let span = self.counted_span(width)?;
        let kind = text::utf8(self.scanner.get(span), span);
        let kind = kind.ok_or_else(|| self.fault("the text is not UTF-8"))?;
        self.push(kind)
    }

    fn byte_string(&mut self, width: u8) -> Result<()> {
        let span = self.counted_span(width)?;
        self.push(text::latin1(self.scanner.get(span), Some(span)))
    }

    fn long(&mut self, width: u8) -> Result<()> {
        let span = self.counted_span(width)?;
        let value = BigInt::from_signed_bytes_le(self.scanner.get(span));
        self.push_integer(value)
    }

    fn push_integer(&mut self, value: BigInt) -> Result<()> {
        let kind = i64::try_from(&value);
        self.push(kind.map_or_else(|_| Kind::BigInt(Box::new(value)), Kind::Int))
    }

    /// `INT`, where `00` and `01` are bools, and `LONG`, which may end in `L`.
    fn decimal(&mut self) -> Result<()> {
        let line = self.scanner.line("an integer")?;
        let bytes = self.scanner.get(line);
        if let (op::INT, b"00" | b"01") = (self.code, bytes) {
            self.stack.push(if bytes == b"01" { NodeId::TRUE } else { NodeId::FALSE });
            return Ok(());
        }
        if bytes.len() > MAX_DIGITS + 2 {
            return Err(self.fault(format!("more than {MAX_DIGITS} digits")));
        }
        let digits = self.line_text(line).unwrap_or_default();
        let value = digits.strip_suffix('L').unwrap_or(digits).parse::<BigInt>();
        let value = value.ok().ok_or_else(|| self.fault("no integer"))?;
        self.push_integer(value)
    }

    fn float(&mut self) -> Result<()> {
        let line = self.scanner.line("FLOAT")?;
        let value = self.line_text(line).and_then(|text| text.parse().ok());
        let value = value.ok_or_else(|| self.fault("no float"))?;
        self.push(Kind::Float(value))
    }

    fn buffer(&mut self) -> Result<()> {
        let index = self.next_buffer;
        if index >= self.buffers.len() {
            return Err(PickleError::Buffer {
                wanted: index + 1,
                count: self.buffers.len(),
                at: self.at,
            });
        }
        self.next_buffer += 1;
        let index = u32::try_from(index).ok().ok_or_else(|| self.fault("too many buffers"))?;
        self.push(Kind::Buffer { index, readonly: false })
    }

    fn readonly(&mut self) -> Result<()> {
        let top = self.top()?;
        match *self.arena.kind(top) {
            Kind::Buffer { index, .. } => {
                self.pop()?;
                self.push(Kind::Buffer { index, readonly: true })
            }
            Kind::ByteArray(span) => {
                self.pop()?;
                self.push(Kind::Bytes(span))
            }
            Kind::Bytes(_) | Kind::OwnedBytes(_) => Ok(()),
            ref other => Err(self.fault(format!("{} is no buffer", other.name()))),
        }
    }

    // Globals.

    fn find_global(&mut self, module: &str, name: &str) -> Result<NodeId> {
        match self.allowed.find(module, name) {
            Some(global) => self.arena.add(Kind::Global(global), self.at),
            None => Err(PickleError::Refused { global: shorten(module, name), at: self.at }),
        }
    }

    fn named_global(&mut self) -> Result<NodeId> {
        let [module, name] = [self.scanner.line("a module")?, self.scanner.line("a name")?]
            .map(|line| String::from_utf8_lossy(self.scanner.get(line)));
        self.find_global(&module, &name)
    }

    fn stack_global(&mut self) -> Result<()> {
        let name = self.pop()?;
        let module = self.pop()?;
        let text = |id| match self.arena.kind(id) {
            Kind::Str(span) => str::from_utf8(self.scanner.get(*span)).ok(),
            _ => None,
        };
        // Text that is not plain UTF-8 in the pickle is no name of an entry.
        let (Some(module), Some(name)) = (text(module), text(name)) else {
            return Err(self.fault("module and name are not two plain strings"));
        };
        let global = self.find_global(module, name)?;
        self.stack.push(global);
        Ok(())
    }

    fn check_persistent(&self) -> Result<()> {
        if self.allowed.has_persistent_ids() {
            return Ok(());
        }
        Err(self.fault("nothing lies beside this pickle that an id could refer to"))
    }
}

/// Characters of a name that are shown: names come from foreign messages.
const SHOWN: usize = 60;

fn shorten(module: &str, name: &str) -> String {
    let cut = |text: &str| {
        let shown: String = text.chars().take(SHOWN).map(printable).collect();
        if shown.chars().count() < text.chars().count() { shown + "…" } else { shown }
    };
    format!("{}.{}", cut(module), cut(name))
}

fn printable(c: char) -> char {
    if c.is_control() { '?' } else { c }
}
