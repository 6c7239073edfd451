//! Registrations of this node: those that are wanted, those that the master has, and the next step
//! from one to the other.
//!
//! ```text
//!   wanted  { publisher /a, subscriber /b }  ┐
//!   entered { publisher /a, service /c }     ┴─▶ next: Enter subscriber /b, Remove service /c
//! ```
//!
//! Plain data: no socket, no clock. A master that was lost has nothing entered.

use std::collections::{BTreeMap, BTreeSet};

/// Kind of an endpoint that the master registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Kind {
    Publisher,
    Subscriber,
    Service,
    Parameter,
    /// A parameter of ours: the mark of something that a bridge made by pattern.
    Mark,
}

/// One registration: the master knows no two of them by the same name from one node.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Key {
    pub(super) kind: Kind,
    pub(super) name: String,
}

impl Key {
    pub(super) fn new(kind: Kind, name: &str) -> Self {
        Self { kind, name: name.to_owned() }
    }
}

/// A step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum MasterUpdate {
    /// Tell the master, with the type of the topic, or the text of a mark.
    Enter(Key, String),
    /// Tell the master that it is gone.
    Remove(Key),
}

#[derive(Debug, Default)]
pub(super) struct Registrations {
    /// Wanted registrations, each with its type and the number of the wish.
    wanted: BTreeMap<Key, (String, u64)>,
    entered: BTreeSet<Key>,
    /// Number of the last wish, and of the last one when the present step was chosen.
    wishes: u64,
    begun: u64,
}

impl Registrations {
    /// `key` is to be registered; anew where it is already, so that the master says again who else
    /// is there.
    pub(super) fn want(&mut self, key: Key, type_name: &str) {
        self.entered.remove(&key);
        self.wishes += 1;
        self.wanted.insert(key, (type_name.to_owned(), self.wishes));
    }

    /// `key` is no longer to be registered.
    pub(super) fn unwant(&mut self, key: &Key) {
        self.wanted.remove(key);
    }

    /// Ends all registrations.
    pub(super) fn unwant_all(&mut self) {
        self.wanted.clear();
    }

    /// The next step. Registrations that end come first: a name may be given to another program.
    pub(super) fn next(&mut self) -> Option<MasterUpdate> {
        self.begun = self.wishes;
        let gone = self.entered.iter().find(|key| !self.wanted.contains_key(key));
        if let Some(key) = gone {
            return Some(MasterUpdate::Remove(key.clone()));
        }
        let mut missing = self.wanted.iter().filter(|(key, _)| !self.entered.contains(key));
        let (key, (type_name, _)) = missing.next()?;
        Some(MasterUpdate::Enter(key.clone(), type_name.clone()))
    }

    /// A step was taken. One whose registration is no longer wanted is undone next, and one that was wanted anew
    /// meanwhile is taken again.
    pub(super) fn taken(&mut self, step: &MasterUpdate) {
        match step {
            MasterUpdate::Enter(key, _)
                if self.wanted.get(key).is_some_and(|(_, wish)| *wish > self.begun) => {}
            MasterUpdate::Enter(key, _) => _ = self.entered.insert(key.clone()),
            MasterUpdate::Remove(key) => _ = self.entered.remove(key),
        }
    }

    /// The master knows nothing of this node any more.
    pub(super) fn forgotten(&mut self) {
        self.entered.clear();
    }

    /// True where the master should know this node.
    pub(super) fn expected(&self) -> bool {
        self.entered.iter().any(|key| !matches!(key.kind, Kind::Parameter | Kind::Mark))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn key(name: &str) -> Key {
        Key::new(Kind::Publisher, name)
    }

    #[test]
    fn what_is_wanted_is_entered_once_and_removed_once() {
        let mut all = Registrations::default();
        all.want(key("/a"), "std_msgs/String");
        let enter = MasterUpdate::Enter(key("/a"), "std_msgs/String".into());
        assert_eq!(all.next(), Some(enter.clone()));
        all.taken(&enter);
        assert_eq!(all.next(), None);
        assert!(all.expected());
        all.unwant(&key("/a"));
        assert_eq!(all.next(), Some(MasterUpdate::Remove(key("/a"))));
        all.taken(&MasterUpdate::Remove(key("/a")));
        assert_eq!(all.next(), None);
        assert!(!all.expected());
    }

    #[test]
    fn a_master_that_forgot_is_told_again() {
        let mut all = Registrations::default();
        all.want(key("/a"), "t");
        let enter = all.next().unwrap();
        all.taken(&enter);
        all.forgotten();
        assert_eq!(all.next(), Some(enter));
    }

    #[test]
    fn what_is_wanted_anew_while_it_is_entered_is_entered_again() {
        let mut all = Registrations::default();
        all.want(key("/a"), "t");
        let enter = all.next().unwrap();
        all.want(key("/a"), "t");
        all.taken(&enter);
        assert_eq!(all.next(), Some(enter.clone()));
        all.taken(&enter);
        assert_eq!(all.next(), None);
    }

    #[test]
    fn what_went_while_it_was_entered_is_removed() {
        let mut all = Registrations::default();
        all.want(key("/a"), "t");
        let enter = all.next().unwrap();
        all.unwant(&key("/a"));
        all.taken(&enter);
        assert_eq!(all.next(), Some(MasterUpdate::Remove(key("/a"))));
    }

    proptest! {
        /// However it goes, the steps end, and the master then knows what is wanted.
        #[test]
        fn steps_lead_to_what_is_wanted(
            moves in proptest::collection::vec((0_u8..4, 0_u8..4), 0..60)
        ) {
            let mut all = Registrations::default();
            for (what, name) in moves {
                let key = key(&format!("/{name}"));
                match what {
                    0 => all.want(key, "t"),
                    1 => all.unwant(&key),
                    2 => all.forgotten(),
                    _ => if let Some(step) = all.next() { all.taken(&step) },
                }
            }
            for _ in 0..20 {
                match all.next() {
                    Some(step) => all.taken(&step),
                    None => break,
                }
            }
            prop_assert_eq!(all.next(), None);
            prop_assert!(all.entered.iter().eq(all.wanted.keys()));
        }
    }
}
