//! Life cycle of a managed ROS 2 node: its states and transitions, with the numbers and names of `rcl_lifecycle`.
//!
//! ```text
//!                  configure          activate
//!   unconfigured ─────────────▶ inactive ─────────────▶ active        a transition goes through a state of
//!        ▲      ◀─────────────          ◀─────────────                its own (configuring, …), in which the
//!        │         cleanup           deactivate                       node works: success goes on, failure
//!        │                                                            goes back, error goes here
//!   errorprocessing ─▶ finalized ◀── shutdown, from each of them             ┆
//!        ▲┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┄┘
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use wrapyfi_endpoint::Wake;
use wrapyfi_interfaces::named;

named! {
    /// State of a node.
    #[repr(u8)]
    #[allow(missing_docs)] // the picture above names them
    pub enum State {
        Unknown = 0 => "unknown",
        Unconfigured = 1 => "unconfigured",
        Inactive = 2 => "inactive",
        Active = 3 => "active",
        Finalized = 4 => "finalized",
        Configuring = 10 => "configuring",
        CleaningUp = 11 => "cleaningup",
        ShuttingDown = 12 => "shuttingdown",
        Activating = 13 => "activating",
        Deactivating = 14 => "deactivating",
        ErrorProcessing = 15 => "errorprocessing",
    }
    /// Name of the state.
    pub fn label;
}

impl State {
    /// Number of the state in `lifecycle_msgs/msg/State`.
    pub const fn id(self) -> u8 {
        self as u8
    }

    /// True for a state in which a node stays.
    pub const fn is_primary(self) -> bool {
        self.id() < Self::Configuring.id()
    }
}

/// Transition from one state to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// Number of the transition in `lifecycle_msgs/msg/Transition`.
    pub id: u8,
    /// Name of the transition.
    pub label: &'static str,
    /// State in which it begins.
    pub start: State,
    /// State in which it ends.
    pub goal: State,
}

const fn transition(id: u8, label: &'static str, start: State, goal: State) -> Transition {
    Transition { id, label, start, goal }
}

named! {
    /// Result of what a node does in a state that is not primary.
    pub enum Outcome {
        /// Success of the work.
        Success => "transition_success",
        /// Refusal: everything is as it was before.
        Failure => "transition_failure",
        /// Fault, after which everything is to be put away.
        Error => "transition_error",
    }
    /// Name of the transition that follows.
    pub fn label;
}

const SUCCESS: &str = Outcome::Success.label();
const FAILURE: &str = Outcome::Failure.label();
const ERROR: &str = Outcome::Error.label();

/// All transitions, in the order in which `rcl_lifecycle` lists them.
pub const TRANSITIONS: [Transition; 25] = {
    use State::{
        Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized,
        Inactive, ShuttingDown, Unconfigured,
    };
    [
        transition(1, "configure", Unconfigured, Configuring),
        transition(10, SUCCESS, Configuring, Inactive),
        transition(11, FAILURE, Configuring, Unconfigured),
        transition(12, ERROR, Configuring, ErrorProcessing),
        transition(2, "cleanup", Inactive, CleaningUp),
        transition(20, SUCCESS, CleaningUp, Unconfigured),
        transition(21, FAILURE, CleaningUp, Inactive),
        transition(22, ERROR, CleaningUp, ErrorProcessing),
        transition(3, "activate", Inactive, Activating),
        transition(30, SUCCESS, Activating, Active),
        transition(31, FAILURE, Activating, Inactive),
        transition(32, ERROR, Activating, ErrorProcessing),
        transition(4, "deactivate", Active, Deactivating),
        transition(40, SUCCESS, Deactivating, Inactive),
        transition(41, FAILURE, Deactivating, Active),
        transition(42, ERROR, Deactivating, ErrorProcessing),
        transition(5, "shutdown", Unconfigured, ShuttingDown),
        transition(6, "shutdown", Inactive, ShuttingDown),
        transition(7, "shutdown", Active, ShuttingDown),
        transition(50, SUCCESS, ShuttingDown, Finalized),
        transition(51, FAILURE, ShuttingDown, Finalized),
        transition(52, ERROR, ShuttingDown, ErrorProcessing),
        transition(60, SUCCESS, ErrorProcessing, Unconfigured),
        transition(61, FAILURE, ErrorProcessing, Finalized),
        transition(62, ERROR, ErrorProcessing, Finalized),
    ]
};

/// State of a node now, which any thread may look at, and the bell that rings where it stays in another one.
#[derive(Debug, Clone)]
pub struct Lifecycle(Arc<AtomicU8>, Wake);

impl Default for Lifecycle {
    fn default() -> Self {
        Self(Arc::new(AtomicU8::new(State::Unconfigured.id())), Wake::new())
    }
}

impl Lifecycle {
    /// State of the node.
    pub fn state(&self) -> State {
        let id = self.0.load(Relaxed);
        State::ALL.into_iter().find(|state| state.id() == id).unwrap_or(State::Unknown)
    }

    /// Bell that rings where the node stays in another state.
    pub fn changes(&self) -> &Wake {
        &self.1
    }

    /// Transitions that can be asked for in the state of now.
    pub fn available(&self) -> impl Iterator<Item = Transition> + use<> {
        let state = self.state();
        TRANSITIONS.into_iter().filter(move |one| state.is_primary() && one.start == state)
    }

    /// The transition that is asked for by name, or by number where the name is empty; `None` where there is
    /// no such one from the state of now.
    pub fn asked(&self, id: u8, label: &str) -> Option<Transition> {
        self.available()
            .find(|one| if label.is_empty() { one.id == id } else { one.label == label })
    }

    /// Goes through a transition, and those that follow from it, to a primary state. `work` does what an
    /// intermediate state is for, and `tell` hears of each change. True where the work was a success.
    pub fn go(
        &self,
        transition: Transition,
        mut work: impl FnMut(State) -> Outcome,
        mut tell: impl FnMut(Transition),
    ) -> bool {
        let (mut next, mut first) = (transition, None);
        loop {
            self.0.store(next.goal.id(), Relaxed);
            tell(next);
            if next.goal.is_primary() {
                self.1.ring();
                return first == Some(Outcome::Success);
            }
            let outcome = work(next.goal);
            first.get_or_insert(outcome);
            let follows = |one: &Transition| one.start == next.goal && one.label == outcome.label();
            // Each intermediate state has all three.
            let Some(follows) = TRANSITIONS.into_iter().find(follows) else { return false };
            next = follows;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::State::{Active, Finalized, Inactive, Unconfigured};
    use super::*;

    fn in_state(state: State) -> Lifecycle {
        Lifecycle(Arc::new(AtomicU8::new(state.id())), Wake::new())
    }

    /// For each state and each transition that can be asked for: the states on success, failure, and error whose
    /// processing succeeds.
    #[test]
    fn every_transition_from_every_state_ends_where_rcl_lifecycle_ends() {
        let asked = ["configure", "cleanup", "activate", "deactivate", "shutdown"];
        let allowed = |state, label| match (state, label) {
            (Unconfigured, "configure") => Some([Inactive, Unconfigured]),
            (Inactive, "cleanup") => Some([Unconfigured, Inactive]),
            (Inactive, "activate") => Some([Active, Inactive]),
            (Active, "deactivate") => Some([Inactive, Active]),
            (Unconfigured | Inactive | Active, "shutdown") => Some([Finalized, Finalized]),
            _ => None,
        };
        for state in State::ALL {
            for label in asked {
                let found = in_state(state).asked(0, label);
                let expected = allowed(state, label);
                assert_eq!(found.is_some(), expected.is_some(), "{label} from {state:?}");
                let (Some(found), Some([good, bad])) = (found, expected) else { continue };
                assert_eq!(in_state(state).asked(found.id, ""), Some(found), "by its number");
                for (outcome, ends) in [
                    (Outcome::Success, good),
                    (Outcome::Failure, bad),
                    (Outcome::Error, Unconfigured),
                ] {
                    let node = in_state(state);
                    let work = |at| match at {
                        State::ErrorProcessing => Outcome::Success,
                        _ => outcome,
                    };
                    let mut told = vec![state];
                    let is_done = node.go(found, work, |one| {
                        assert_eq!(told.last(), Some(&one.start), "{told:?}");
                        told.push(one.goal);
                    });
                    assert_eq!(is_done, outcome == Outcome::Success, "{label} from {state:?}");
                    assert_eq!(node.state(), ends, "{label} from {state:?}: {outcome:?}");
                    assert_eq!(told.last(), Some(&ends));
                    let steps = if outcome == Outcome::Error { 4 } else { 3 };
                    assert_eq!(told.len(), steps, "{told:?}");
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_put_away_is_finalized() {
        for outcome in [Outcome::Failure, Outcome::Error] {
            let node = in_state(Active);
            let work = |at| match at {
                State::ErrorProcessing => outcome,
                _ => Outcome::Error,
            };
            assert!(!node.go(node.asked(4, "").unwrap(), work, |_| {}));
            assert_eq!(node.state(), Finalized);
            assert_eq!(node.available().count(), 0);
        }
    }

    #[test]
    fn a_name_goes_before_a_number_and_what_follows_by_itself_cannot_be_asked_for() {
        let node = Lifecycle::default();
        assert_eq!(node.state(), Unconfigured);
        let ids = |node: &Lifecycle| node.available().map(|one| one.id).collect::<Vec<_>>();
        assert_eq!(ids(&node), [1, 5]);
        assert_eq!(ids(&in_state(Inactive)), [2, 3, 6]);
        assert_eq!(ids(&in_state(Active)), [4, 7]);
        assert_eq!(node.asked(1, "not used"), None);
        assert_eq!(node.asked(99, "configure").map(|one| one.id), Some(1));
        for (id, label) in [(10, ""), (0, SUCCESS), (0, ""), (8, ""), (6, "")] {
            assert_eq!(node.asked(id, label), None, "{id} {label}");
        }
    }

    #[test]
    fn each_intermediate_state_has_an_end_for_each_outcome() {
        for state in State::ALL.into_iter().filter(|state| !state.is_primary()) {
            for label in [SUCCESS, FAILURE, ERROR] {
                let ends =
                    TRANSITIONS.iter().filter(|one| one.start == state && one.label == label);
                assert_eq!(ends.count(), 1, "{label} of {state:?}");
            }
        }
    }
}
