//! A function or class applied to arguments, as the pickle describes it; it is never executed.

use super::arena::CallData;
use super::error::PickleError;
use super::globals::Global;
use super::items::{Items, Pairs};
use super::node::{Node, View};
use super::trail::PathStep;

/// An object as its pickle describes it.
///
/// ```text
///   callable(*args)   or   cls.__new__(cls, *args)   then  __setstate__(state)  then  set each pair
/// ```
#[derive(Debug, Clone, Copy)]
pub struct PickleCall<'p> {
    pub(super) node: Node<'p>,
    pub(super) data: &'p CallData,
}

/// Callable of a call whose callable is no entry of the list, which cannot be.
const NOTHING: Global = Global { module: "builtins", name: "object", callable: false };

impl<'p> PickleCall<'p> {
    /// The object itself.
    pub fn node(&self) -> Node<'p> {
        self.node
    }

    /// The function or class.
    pub fn global(&self) -> &'static Global {
        match self.node.child(self.data.callable, PathStep::State).view() {
            View::Global(global) => global,
            _ => &NOTHING,
        }
    }

    /// Positional arguments.
    pub fn args(&self) -> Items<'p> {
        match self.node.child(self.data.args, PathStep::State).view() {
            View::Tuple(items) => Items { owner: self.node, step: PathStep::Arg, ids: items.ids },
            _ => Items { owner: self.node, step: PathStep::Arg, ids: &[] },
        }
    }

    /// The positional argument number `index`.
    ///
    /// # Errors
    /// When there are fewer arguments.
    pub fn arg(&self, index: usize) -> Result<Node<'p>, PickleError> {
        self.args().get(index)
    }

    /// State that the object's `__setstate__` would receive.
    ///
    /// # Errors
    /// When the object has no state.
    pub fn state(&self) -> Result<Node<'p>, PickleError> {
        self.find_state().ok_or_else(|| self.node.unexpected("an object with a state"))
    }

    /// State that the object's `__setstate__` would receive, if it has one.
    pub fn find_state(&self) -> Option<Node<'p>> {
        self.data.state.map(|id| self.node.child(id, PathStep::State))
    }

    /// Keys and values that would be set in the object, as in an `OrderedDict`.
    pub fn pairs(&self) -> Pairs<'p> {
        Pairs { owner: self.node, ids: &self.data.pairs }
    }
}
