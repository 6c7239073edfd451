//! Reads a pickle's instructions into the arena. Nothing is recursive here.
//!
//! ```text
//!   opcodes ─▶ stack of node numbers, marks between them ─▶ arena
//!                     ▲      │
//!                     └ memo ┘
//! ```

use bytes::Bytes;

use super::arena::{Arena, Kind, NodeId, Pickle};
use super::error::PickleError;
use super::globals::Allowed;
use super::scan::Scanner;
use super::{opcode as op, text};
use wrapyfi_data::Limits;

pub(super) type Result<T> = std::result::Result<T, PickleError>;

pub(super) struct Machine<'a> {
    pub(super) scanner: Scanner<'a>,
    pub(super) buffers: &'a [Bytes],
    pub(super) allowed: &'a Allowed,
    pub(super) arena: Arena,
    pub(super) stack: Vec<NodeId>,
    /// Heights of the stack at each mark.
    pub(super) marks: Vec<usize>,
    pub(super) memo: Vec<NodeId>,
    /// Objects in the memo, which is the number of the next one.
    pub(super) memoised: usize,
    pub(super) next_buffer: usize,
    /// Code and byte of the instruction at work.
    pub(super) code: u8,
    pub(super) at: usize,
}

/// Reads a pickle of any protocol, 0 to 5, whose out-of-band buffers are `buffers` in their order.
/// Bytes behind its end are ignored.
///
/// Objects may take four times `limits.message_bytes` of memory, and 64 bytes for each one of
/// `data`, besides what they share with `data` and `buffers`.
///
/// # Errors
/// When it is no pickle, names something that is not on the list `allowed`, or exceeds a limit.
pub fn read(data: &Bytes, buffers: &[Bytes], allowed: &Allowed, limits: &Limits) -> Result<Pickle> {
    let size = buffers.iter().fold(data.len(), |size, buffer| size.saturating_add(buffer.len()));
    if size > limits.message_bytes {
        let what = "pickle with its buffers";
        return Err(PickleError::too_large(what, 0, size, limits.message_bytes));
    }
    let mut machine = Machine {
        scanner: Scanner { data, at: 0 },
        buffers,
        allowed,
        arena: Arena::new(data.len(), limits),
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
    Ok(Pickle { data: data.clone(), buffers: buffers.to_vec(), arena: machine.arena, root })
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
            op::BININT1 => self.short_int(1)?,
            op::BININT2 => self.short_int(2)?,
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
                let kind = text::raw_unicode_escape(self.scanner.get(line), line);
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
                let items = self.take(1)?;
                self.extend(&items)?;
            }
            op::APPENDS | op::ADDITEMS => {
                let items = self.pop_mark()?;
                self.extend(&items)?;
            }
            op::EMPTY_DICT => self.push(Kind::Dict(Vec::new()))?,
            op::DICT => {
                let pairs = self.pop_mark()?;
                let pairs = self.pairs(&pairs)?;
                self.push(Kind::Dict(pairs))?;
            }
            op::SETITEM => {
                let items = self.take(2)?;
                self.set_items(&items)?;
            }
            op::SETITEMS => {
                let items = self.pop_mark()?;
                self.set_items(&items)?;
            }
            op::EMPTY_SET => self.push(Kind::Set(Vec::new()))?,
            op::FROZENSET => {
                let items = self.pop_mark()?;
                self.push(Kind::FrozenSet(items.into()))?;
            }

            op::MARK => self.marks.push(self.stack.len()),
            // POP takes a mark that is on top.
            op::POP if self.marks.last() == Some(&self.stack.len()) => drop(self.marks.pop()),
            op::POP => drop(self.pop()?),
            op::POP_MARK => drop(self.pop_mark()?),
            op::DUP => {
                let top = self.top()?;
                self.stack.push(top);
            }

            op::MEMOIZE => self.put(self.memoised as u64)?,
            op::BINPUT | op::LONG_BINPUT | op::PUT => {
                let index = self.index()?;
                self.put(index)?;
            }
            op::BINGET | op::LONG_BINGET | op::GET => {
                let index = self.index()?;
                self.get(index)?;
            }

            op::GLOBAL => {
                let global = self.named_global()?;
                self.stack.push(global);
            }
            op::STACK_GLOBAL => self.stack_global()?,
            op::REDUCE | op::NEWOBJ => {
                let args = self.pop()?;
                let callable = self.pop()?;
                self.call(callable, args, None, code == op::NEWOBJ)?;
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

            op::PERSID | op::BINPERSID => {
                self.check_persistent()?;
                if code == op::PERSID {
                    let line = self.scanner.line("PERSID")?;
                    self.push(text::latin1(self.scanner.get(line), Some(line)))?;
                }
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

    /// The object on top. What lies below a mark is out of reach until the mark is taken away.
    pub(super) fn top(&self) -> Result<NodeId> {
        let floor = self.marks.last().copied().unwrap_or_default();
        match self.stack.last() {
            Some(&top) if self.stack.len() > floor => Ok(top),
            _ => Err(self.fault("the stack is empty")),
        }
    }

    pub(super) fn pop(&mut self) -> Result<NodeId> {
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

    /// Pops all objects above the last mark, and the mark.
    fn pop_mark(&mut self) -> Result<Vec<NodeId>> {
        let floor = self.marks.pop().ok_or_else(|| self.fault("there is no mark"))?;
        Ok(self.stack.split_off(floor.min(self.stack.len())))
    }
}
