//! Instructions that name something: objects by their number in the memo, functions and classes by
//! module and name, things beside the pickle by an id.

use super::arena::{EDGE, Kind, NodeId};
use super::error::PickleError;
use super::machine::{Machine, Result};
use super::opcode as op;

/// Name of a number in the memo, in errors.
const MEMO_INDEX: &str = "memo index";
/// Entry of the memo without an object.
const UNSET: NodeId = NodeId(u32::MAX);

impl Machine<'_> {
    pub(super) fn put(&mut self, index: u64) -> Result<()> {
        let top = self.top()?;
        // A pickler numbers its objects from 0, and each takes a byte at least.
        let limit = self.scanner.data.len();
        let place = usize::try_from(index).ok().filter(|&place| place <= limit);
        let place = place.ok_or(PickleError::TooLarge {
            what: MEMO_INDEX,
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

    pub(super) fn get(&mut self, index: u64) -> Result<()> {
        let entry = usize::try_from(index).ok().and_then(|index| self.memo.get(index)).copied();
        match entry.filter(|&id| id != UNSET) {
            Some(id) => {
                self.stack.push(id);
                Ok(())
            }
            None => Err(self.fault(format!("the memo has no object number {index}"))),
        }
    }

    /// Number of an object in the memo: one byte, four, or a line of digits.
    pub(super) fn index(&mut self) -> Result<u64> {
        match self.code {
            op::BINPUT | op::BINGET => return self.scanner.unsigned(MEMO_INDEX, 1),
            op::LONG_BINPUT | op::LONG_BINGET => return self.scanner.unsigned(MEMO_INDEX, 4),
            _ => {}
        }
        let line = self.scanner.line(MEMO_INDEX)?;
        self.line_text(line)
            .and_then(|text| text.parse().ok())
            .ok_or_else(|| self.fault("the memo's index is no number"))
    }

    fn find_global(&mut self, module: &str, name: &str) -> Result<NodeId> {
        let found = self.allowed.find(module, name);
        match found.or_else(|| self.allowed.getter(module, name)) {
            Some(global) => self.arena.add(Kind::Global(global), self.at),
            None => Err(PickleError::Refused { global: shorten(module, name), at: self.at }),
        }
    }

    /// The method that `getattr(class, name)` stands for.
    pub(super) fn method(&mut self, args: NodeId) -> Result<NodeId> {
        let Kind::Tuple(args) = self.arena.kind(args) else {
            return Err(self.fault("getattr without a tuple of arguments"));
        };
        let (class, name) = match **args {
            [class, name] => (self.arena.kind(class), self.arena.kind(name)),
            _ => return Err(self.fault("getattr of anything but a class and a name")),
        };
        let (Kind::Global(class), Kind::Str(name)) = (class, name) else {
            return Err(self.fault("getattr of anything but a class and a name"));
        };
        let (class, name) = (*class, self.scanner.get(*name));
        // Longer names are on no list, and copying a long text for each of many calls takes time.
        let name = String::from_utf8_lossy(name.get(..name.len().min(SHOWN)).unwrap_or_default());
        self.find_global(class.module, &format!("{}.{name}", class.name))
    }

    pub(super) fn named_global(&mut self) -> Result<NodeId> {
        let [module, name] = [self.scanner.line("a module")?, self.scanner.line("a name")?]
            .map(|line| String::from_utf8_lossy(self.scanner.get(line)));
        self.find_global(&module, &name)
    }

    pub(super) fn stack_global(&mut self) -> Result<()> {
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

    pub(super) fn check_persistent(&self) -> Result<()> {
        if self.allowed.persistent_ids {
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
