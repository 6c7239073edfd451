//! Listeners by what they are subscribed to: a subscription is the beginning of a topic.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use bytes::Bytes;

/// Listeners, each by the number of its connection.
#[derive(Debug, Default)]
pub(super) struct Subscribers {
    index: HashMap<Bytes, BTreeSet<usize>>,
    /// Number of the different subscriptions of each length.
    lengths: BTreeMap<usize, usize>,
}

impl Subscribers {
    pub(super) fn add(&mut self, beginning: Bytes, id: usize) {
        let length = beginning.len();
        let ids = self.index.entry(beginning).or_default();
        if ids.insert(id) && ids.len() == 1 {
            *self.lengths.entry(length).or_default() += 1;
        }
    }

    pub(super) fn remove(&mut self, beginning: &[u8], id: usize) {
        let Some(ids) = self.index.get_mut(beginning) else { return };
        ids.remove(&id);
        if !ids.is_empty() {
            return;
        }
        self.index.remove(beginning);
        if let Some(count) = self.lengths.get_mut(&beginning.len()) {
            *count -= 1;
            if *count == 0 {
                self.lengths.remove(&beginning.len());
            }
        }
    }

    /// Everybody who is subscribed to a beginning of `topic`, each once.
    pub(super) fn of(&self, topic: &[u8]) -> Vec<usize> {
        let lengths = self.lengths.range(..=topic.len()).map(|(length, _)| *length);
        let subscribed = lengths.filter_map(|length| self.index.get(topic.get(..length)?));
        let mut ids: Vec<usize> = subscribed.flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_subscribed_to_a_beginning_is_found_once_until_it_leaves() {
        let mut subscribers = Subscribers::default();
        for (beginning, id) in [("/a", 1), ("/a", 1), ("/a/b", 1), ("/a/b", 2), ("", 3)] {
            subscribers.add(Bytes::from_static(beginning.as_bytes()), id);
        }
        assert_eq!(subscribers.of(b"/a/b/c"), [1, 2, 3]);
        assert_eq!(subscribers.of(b"/a"), [1, 3]);
        assert_eq!(subscribers.of(b"/x"), [3]);
        for (beginning, id) in [("/a", 1), ("/a/b", 1), ("", 3), ("/never", 3)] {
            subscribers.remove(beginning.as_bytes(), id);
        }
        assert_eq!(subscribers.of(b"/a/b/c"), [2]);
        subscribers.remove(b"/a/b", 2);
        assert!(subscribers.index.is_empty() && subscribers.lengths.is_empty());
    }
}
