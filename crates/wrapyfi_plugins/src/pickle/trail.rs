//! Path from the root to an object, for the errors that name it.

use super::arena::NodeId;

/// One step from an object to one of its parts.
#[derive(Debug, Clone, Copy)]
pub(super) enum PathStep {
    Index(u32),
    Arg(u32),
    /// The value under a key.
    Key(NodeId),
    /// The n-th key.
    KeyAt(u32),
    State,
    Persistent,
}

/// Steps that are remembered.
const STEPS: usize = 12;

/// The last steps from the root.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trail {
    steps: [PathStep; STEPS],
    taken: u32,
}

impl Default for Trail {
    fn default() -> Self {
        Self { steps: [PathStep::State; STEPS], taken: 0 }
    }
}

impl Trail {
    pub(super) fn and(mut self, step: PathStep) -> Self {
        // The newest step overwrites the oldest.
        if let Some(place) = self.steps.get_mut(self.taken as usize % STEPS) {
            *place = step;
        }
        self.taken = self.taken.saturating_add(1);
        self
    }

    /// True where the path is longer than the steps that are remembered.
    pub(super) fn is_cut(&self) -> bool {
        self.taken as usize > STEPS
    }

    /// The last steps, the oldest first.
    pub(super) fn steps(&self) -> impl Iterator<Item = PathStep> {
        let taken = self.taken as usize;
        let first = taken.saturating_sub(STEPS);
        (first..taken).filter_map(|index| self.steps.get(index % STEPS).copied())
    }
}
