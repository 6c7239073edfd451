//! Path from the root to an object, for the errors that name it.

use super::arena::{NodeId, Pickle};
use super::node::{Node, SHOWN, View};

/// One step from an object to one of its parts.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step {
    Index(u32),
    Item(u32),
    Arg(u32),
    /// The value under a key.
    Key(NodeId),
    /// The n-th key.
    KeyAt(u32),
    Kwargs,
    State,
    Persistent,
}

/// Steps that are remembered.
const STEPS: usize = 12;

/// The last steps from the root.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trail {
    steps: [Step; STEPS],
    taken: u32,
}

impl Default for Trail {
    fn default() -> Self {
        Self { steps: [Step::State; STEPS], taken: 0 }
    }
}

impl Trail {
    pub(super) fn and(mut self, step: Step) -> Self {
        // The newest step overwrites the oldest.
        if let Some(place) = self.steps.get_mut(self.taken as usize % STEPS) {
            *place = step;
        }
        self.taken = self.taken.saturating_add(1);
        self
    }

    pub(super) fn show(&self, pickle: &Pickle) -> String {
        let taken = self.taken as usize;
        let first = taken.saturating_sub(STEPS);
        let mut path = String::from(if first > 0 { "$…" } else { "$" });
        for step in (first..taken).filter_map(|index| self.steps.get(index % STEPS)) {
            match *step {
                Step::Index(index) => path += &format!("[{index}]"),
                Step::Item(index) => path += &format!(".items[{index}]"),
                Step::Arg(index) => path += &format!(".args[{index}]"),
                Step::KeyAt(index) => path += &format!(".keys[{index}]"),
                Step::Kwargs => path += ".kwargs",
                Step::State => path += ".state",
                Step::Persistent => path += ".id",
                Step::Key(id) => {
                    let key = Node { pickle, id, trail: Self::default() };
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
}
