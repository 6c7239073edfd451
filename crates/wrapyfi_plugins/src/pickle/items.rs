//! The parts of an object: members of a sequence, pairs of a dict.

use std::fmt::Display;

use super::arena::NodeId;
use super::error::PickleError;
use super::node::{Node, View};
use super::trail::PathStep;

/// Members in their order: of a `list`, `tuple`, `set`, or the arguments of a call.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed};
/// // pickle.dumps([1, 2])
/// let data = b"\x80\x02](K\x01K\x02e.".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::BUILTINS, &Limits::default())?;
/// let items = pickle.root().list()?;
/// let sum: i64 = items.iter().map(|item| item.int()).sum::<Result<_, _>>()?;
/// assert_eq!((items.len(), sum, items.find(2).is_none()), (2, 3, true));
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Items<'p> {
    pub(super) owner: Node<'p>,
    pub(super) step: fn(u32) -> PathStep,
    pub(super) ids: &'p [NodeId],
}

/// As a number in a path; no pickle has so many objects that it does not fit.
fn small(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

impl<'p> Items<'p> {
    /// Number of items.
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// True when there are no items.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// The member number `index`, if there are so many.
    pub fn find(&self, index: usize) -> Option<Node<'p>> {
        self.ids.get(index).map(|&id| self.owner.child(id, (self.step)(small(index))))
    }

    /// The member number `index`.
    ///
    /// # Errors
    /// When there are not so many.
    pub fn get(&self, index: usize) -> Result<Node<'p>, PickleError> {
        self.find(index).ok_or_else(|| self.count(format_args!("at least {}", index + 1)))
    }

    /// All of them, when they are exactly so many: `let [shape, data] = items.exact()?`.
    ///
    /// # Errors
    /// When there are more or fewer.
    pub fn exact<const N: usize>(&self) -> Result<[Node<'p>; N], PickleError> {
        let ids = <[NodeId; N]>::try_from(self.ids).ok();
        let ids = ids.ok_or_else(|| self.count(N))?;
        let mut index = 0;
        Ok(ids.map(|id| {
            index += 1;
            self.owner.child(id, (self.step)(index - 1))
        }))
    }

    fn count(&self, wanted: impl Display) -> PickleError {
        PickleError::Unexpected {
            path: self.owner.path(),
            expected: format!("something with {wanted} parts"),
            actual: format!("{} with {}", self.owner, self.len()),
            at: self.owner.at(),
        }
    }

    /// All of them.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Node<'p>> + use<'p> {
        let Self { owner, step, ids } = *self;
        ids.iter().enumerate().map(move |(index, &id)| owner.child(id, step(small(index))))
    }
}

/// Pairs of a `dict` in their order.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_plugins::pickle::{self, Allowed};
/// // pickle.dumps({"a": 1})
/// let data = b"\x80\x02}X\x01\0\0\0aK\x01s.".to_vec().into();
/// let pickle = pickle::read(&data, &[], &Allowed::BUILTINS, &Limits::default())?;
/// let pairs = pickle.root().dict()?;
/// assert_eq!((pairs.len(), pairs.get("a")?.int()?), (1, 1));
/// assert!(pairs.find("b").is_none());
/// # Ok::<(), pickle::PickleError>(())
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Pairs<'p> {
    pub(super) owner: Node<'p>,
    pub(super) ids: &'p [(NodeId, NodeId)],
}

impl<'p> Pairs<'p> {
    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// True when there are no pairs.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// The value under the text `key`: the last one, as in Python. Looks at every key.
    pub fn find(&self, key: &str) -> Option<Node<'p>> {
        self.ids.iter().rev().find_map(|&(id, value)| {
            let here = self.owner.child(id, PathStep::State);
            match here.view() {
                View::Str(text) if text == key => Some(self.owner.child(value, PathStep::Key(id))),
                _ => None,
            }
        })
    }

    /// The value under the text `key`.
    ///
    /// # Errors
    /// When there is none.
    pub fn get(&self, key: &str) -> Result<Node<'p>, PickleError> {
        self.find(key)
            .ok_or_else(|| self.owner.unexpected(format!("something with the key {key:?}")))
    }

    /// All of them, key and value.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Node<'p>, Node<'p>)> + use<'p> {
        let Self { owner, ids } = *self;
        ids.iter().enumerate().map(move |(index, &(key, value))| {
            (
                owner.child(key, PathStep::KeyAt(small(index))),
                owner.child(value, PathStep::Key(key)),
            )
        })
    }
}
