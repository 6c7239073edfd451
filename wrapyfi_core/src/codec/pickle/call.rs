//! A function or class applied to arguments: what was written down of it, none of it executed.

use super::arena::CallData;
use super::error::PickleError;
use super::globals::Global;
use super::items::{Items, Pairs};
use super::node::{Node, View};
use super::trail::Step;

/// An object as its pickle describes it.
///
/// ```text
///   callable(*args)   or   cls.__new__(cls, *args, **kwargs)
///      then  __setstate__(state)  then  append each item  then  set each pair
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Call<'p> {
    pub(super) node: Node<'p>,
    pub(super) data: &'p CallData,
}

/// What a call holds whose callable is no entry, which cannot be.
const NOTHING: Global = Global { module: "builtins", name: "object", callable: false };

impl<'p> Call<'p> {
    /// The object itself.
    #[must_use]
    pub fn node(&self) -> Node<'p> {
        self.node
    }

    /// The function or class.
    #[must_use]
    pub fn global(&self) -> &'static Global {
        match self.node.child(self.data.callable, Step::State).view() {
            View::Global(global) => global,
            _ => &NOTHING,
        }
    }

    /// Its positional arguments.
    #[must_use]
    pub fn args(&self) -> Items<'p> {
        match self.node.child(self.data.args, Step::State).view() {
            View::Tuple(items) => Items { owner: self.node, step: Step::Arg, ids: items.ids },
            _ => Items { owner: self.node, step: Step::Arg, ids: &[] },
        }
    }

    /// The positional argument number `index`.
    ///
    /// # Errors
    /// When there are not so many.
    pub fn arg(&self, index: usize) -> Result<Node<'p>, PickleError> {
        self.args().get(index)
    }

    /// Its keyword arguments, a `dict`, where the pickle has any.
    #[must_use]
    pub fn kwargs(&self) -> Option<Node<'p>> {
        self.data.kwargs.map(|id| self.node.child(id, Step::Kwargs))
    }

    /// True where a class makes an instance without running its `__init__`.
    #[must_use]
    pub fn is_new(&self) -> bool {
        self.data.new
    }

    /// What its `__setstate__` would receive.
    ///
    /// # Errors
    /// When it has none.
    pub fn state(&self) -> Result<Node<'p>, PickleError> {
        self.find_state().ok_or_else(|| self.node.unexpected("an object with a state"))
    }

    /// What its `__setstate__` would receive, if anything.
    #[must_use]
    pub fn find_state(&self) -> Option<Node<'p>> {
        self.data.state.map(|id| self.node.child(id, Step::State))
    }

    /// What would be appended to it.
    #[must_use]
    pub fn items(&self) -> Items<'p> {
        Items { owner: self.node, step: Step::Item, ids: &self.data.items }
    }

    /// What would be set in it by key, as in an `OrderedDict`.
    #[must_use]
    pub fn pairs(&self) -> Pairs<'p> {
        Pairs { owner: self.node, ids: &self.data.pairs }
    }
}
