//! A pickle that was read, written again: in another protocol, without what nothing refers to.

use std::collections::HashMap;

use super::super::EncodeError;
use super::arena::{CallData, Kind, NodeId, Pickle};
use super::error::unwritable;
use super::opcode as op;
use super::write::{Pickled, Protocol, Writer};

impl Pickle {
    /// Writes the objects again. What is the same object twice stays so.
    ///
    /// # Errors
    /// When something has no form in `protocol`, or an object that cannot change holds itself.
    pub fn write(&self, protocol: Protocol) -> Result<Pickled, EncodeError> {
        let mut rewriter = Rewriter {
            pickle: self,
            uses: self.count_uses(),
            writer: Writer::new(protocol),
            memo: HashMap::new(),
            open: vec![false; self.nodes.len()],
            tasks: vec![Task::Visit(self.root)],
        };
        while let Some(task) = rewriter.tasks.pop() {
            match task {
                Task::Op(code) => rewriter.writer.op(code),
                Task::Made(id) => {
                    rewriter.set_open(id, false);
                    rewriter.memoise(id);
                }
                Task::Visit(id) => rewriter.visit(id)?,
            }
        }
        rewriter.writer.finish()
    }

    /// Number of references to each object from the root.
    fn count_uses(&self) -> Vec<u32> {
        let mut uses = vec![0_u32; self.nodes.len()];
        let mut open = vec![self.root];
        while let Some(id) = open.pop() {
            if let Some(count) = uses.get_mut(id.0 as usize) {
                *count = count.saturating_add(1);
                if *count == 1 {
                    self.kind(id).each_part(|part| open.push(part));
                }
            }
        }
        uses
    }
}

impl Kind {
    fn each_part(&self, mut each: impl FnMut(NodeId)) {
        match self {
            Self::List(items) | Self::Set(items) => items.iter().copied().for_each(each),
            Self::Tuple(items) | Self::FrozenSet(items) => items.iter().copied().for_each(each),
            Self::Dict(pairs) => pairs.iter().flat_map(|&(k, v)| [k, v]).for_each(each),
            Self::Persistent(id) => each(*id),
            Self::Call(call) => {
                let CallData { callable, args, kwargs, state, .. } = **call;
                [Some(callable), Some(args), kwargs, state]
                    .into_iter()
                    .flatten()
                    .for_each(&mut each);
                call.items.iter().copied().for_each(&mut each);
                call.pairs.iter().flat_map(|&(k, v)| [k, v]).for_each(each);
            }
            _ => {}
        }
    }
}

enum Task {
    Visit(NodeId),
    Op(u8),
    /// The object is complete: from here on it has a number.
    Made(NodeId),
}

struct Rewriter<'a> {
    pickle: &'a Pickle,
    uses: Vec<u32>,
    writer: Writer,
    memo: HashMap<NodeId, u32>,
    /// Objects that cannot be referred to before they are complete, and are not yet.
    open: Vec<bool>,
    tasks: Vec<Task>,
}

impl Rewriter<'_> {
    fn set_open(&mut self, id: NodeId, is_open: bool) {
        if let Some(open) = self.open.get_mut(id.0 as usize) {
            *open = is_open;
        }
    }

    /// Gives the object on top of the stack a number, where it is used again.
    fn memoise(&mut self, id: NodeId) {
        if self.uses.get(id.0 as usize).is_none_or(|&uses| uses < 2) {
            return;
        }
        let index = u32::try_from(self.memo.len()).unwrap_or(u32::MAX);
        self.memo.insert(id, index);
        if self.writer.protocol() >= Protocol::V4 {
            return self.writer.op(op::MEMOIZE);
        }
        match u8::try_from(index) {
            Ok(index) => self.writer.raw(&[op::BINPUT, index]),
            Err(_) => {
                self.writer.op(op::LONG_BINPUT);
                self.writer.raw(&index.to_le_bytes());
            }
        }
    }

    fn visit(&mut self, id: NodeId) -> Result<(), EncodeError> {
        if let Some(&index) = self.memo.get(&id) {
            match u8::try_from(index) {
                Ok(index) => self.writer.raw(&[op::BINGET, index]),
                Err(_) => {
                    self.writer.op(op::LONG_BINGET);
                    self.writer.raw(&index.to_le_bytes());
                }
            }
            return Ok(());
        }
        if self.open.get(id.0 as usize).copied().unwrap_or_default() {
            return Err(unwritable(
                "a tuple, or the arguments of an object, that hold themselves",
                "only lists, dicts, sets and states may",
            ));
        }
        let old = self.writer.protocol() < Protocol::V4;
        let pickle = self.pickle;
        let kind = pickle.kind(id);
        match kind {
            Kind::None => self.writer.none(),
            Kind::Bool(value) => self.writer.bool(*value),
            Kind::Int(value) => self.writer.int(*value),
            Kind::Float(value) => self.writer.float(*value),
            // Long integers get a memo entry, as in Python, or each use would write one again.
            Kind::BigInt(value) => self.atom(id, |w| w.big_int(value)),
            Kind::Str(span) => self.atom(id, |w| w.str(pickle.str(*span))),
            Kind::OwnedStr(text) => self.atom(id, |w| w.str(text)),
            Kind::Utf16(units) => self.atom(id, |w| w.utf16(units)),
            Kind::Bytes(span) => self.atom(id, |w| w.bytes(pickle.bytes(*span))),
            Kind::OwnedBytes(bytes) => self.atom(id, |w| w.bytes(bytes)),
            Kind::ByteArray(span) => self.atom(id, |w| w.byte_array(pickle.bytes(*span))),
            Kind::OwnedByteArray(bytes) => self.atom(id, |w| w.byte_array(bytes)),
            Kind::Buffer { index, readonly } => {
                let content = pickle.buffers.get(*index as usize).cloned().unwrap_or_default();
                self.atom(id, |w| match (readonly, w.protocol()) {
                    (false, _) => w.buffer(content),
                    (true, Protocol::V5) => {
                        w.buffer(content);
                        w.op(op::READONLY_BUFFER);
                    }
                    (true, _) => w.bytes(&content),
                });
            }
            Kind::Global(global) => self.atom(id, |w| w.global(global.module, global.name)),
            Kind::Persistent(inner) => {
                self.closed(id, &[op::BINPERSID]);
                self.tasks.push(Task::Visit(*inner));
            }
            Kind::Tuple(items) if items.is_empty() => self.writer.op(op::EMPTY_TUPLE),
            Kind::Tuple(items) => {
                self.writer.op(op::MARK);
                self.closed(id, &[op::TUPLE]);
                self.visit_all(items.iter().copied());
            }
            Kind::FrozenSet(items) if old => self.old_set(id, "frozenset", items),
            Kind::FrozenSet(items) => {
                self.writer.op(op::MARK);
                self.closed(id, &[op::FROZENSET]);
                self.visit_all(items.iter().copied());
            }
            Kind::Set(items) if old => self.old_set(id, "set", items),
            Kind::Set(items) => self.container(id, op::EMPTY_SET, op::ADDITEMS, items),
            Kind::List(items) => self.container(id, op::EMPTY_LIST, op::APPENDS, items),
            Kind::Dict(pairs) => {
                self.writer.op(op::EMPTY_DICT);
                self.memoise(id);
                self.set_items(pairs);
            }
            Kind::Call(call) => self.call(id, call)?,
        }
        Ok(())
    }

    fn atom(&mut self, id: NodeId, write: impl FnOnce(&mut Writer)) {
        write(&mut self.writer);
        self.memoise(id);
    }

    /// Schedules the opcodes that end an object; it counts as made only after them.
    fn closed(&mut self, id: NodeId, end: &[u8]) {
        self.set_open(id, true);
        self.tasks.push(Task::Made(id));
        self.tasks.extend(end.iter().rev().map(|&code| Task::Op(code)));
    }

    /// Tasks are done from the last to the first.
    fn visit_all(&mut self, ids: impl DoubleEndedIterator<Item = NodeId>) {
        self.tasks.extend(ids.rev().map(Task::Visit));
    }

    /// An object that is there before its members are.
    fn container(&mut self, id: NodeId, empty: u8, fill: u8, items: &[NodeId]) {
        self.writer.op(empty);
        self.memoise(id);
        self.fill(fill, items.iter().copied());
    }

    fn set_items(&mut self, pairs: &[(NodeId, NodeId)]) {
        self.fill(op::SETITEMS, pairs.iter().flat_map(|&(key, value)| [key, value]));
    }

    fn fill(&mut self, fill: u8, ids: impl DoubleEndedIterator<Item = NodeId>) {
        let before = self.tasks.len();
        self.tasks.push(Task::Op(fill));
        self.visit_all(ids);
        if self.tasks.len() == before + 1 {
            // There are no items, so the opcode that fills them in is not written.
            self.tasks.pop();
        } else {
            self.tasks.push(Task::Op(op::MARK));
        }
    }

    /// A set before protocol 4: made of a list.
    fn old_set(&mut self, id: NodeId, name: &'static str, items: &[NodeId]) {
        self.writer.global("__builtin__", name);
        self.writer.raw(&[op::EMPTY_LIST, op::MARK]);
        self.closed(id, &[op::APPENDS, op::TUPLE1, op::REDUCE]);
        self.visit_all(items.iter().copied());
    }

    fn call(&mut self, id: NodeId, call: &CallData) -> Result<(), EncodeError> {
        let code = match (call.kwargs, call.new) {
            (None, false) => op::REDUCE,
            (None, true) => op::NEWOBJ,
            _ if self.writer.protocol() >= Protocol::V4 => op::NEWOBJ_EX,
            _ => {
                return Err(unwritable("an object with keyword arguments", "use protocol 4 or 5"));
            }
        };
        // Tasks run from the last to the first.
        if let Some(state) = call.state {
            self.tasks.push(Task::Op(op::BUILD));
            self.tasks.push(Task::Visit(state));
        }
        self.set_items(&call.pairs);
        self.fill(op::APPENDS, call.items.iter().copied());
        self.closed(id, &[code]);
        self.tasks.extend(call.kwargs.map(Task::Visit));
        self.tasks.push(Task::Visit(call.args));
        self.tasks.push(Task::Visit(call.callable));
        Ok(())
    }
}
