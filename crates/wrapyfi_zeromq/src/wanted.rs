//! Subscriptions of all listeners, as publishers are told of them.
//!
//! ```text
//!   subscriptions ──▶ first 256 bytes of each ──▶ told, as often as there are subscriptions
//!                     no room for another     ──▶ the empty one: everything is wanted
//! ```
//!
//! A publisher of libzmq keeps 50 bytes for each byte that it is told, sends nothing while it takes them in, and may
//! overflow its stack, where it has a call for each byte. A subscription to a beginning asks for more, never for less,
//! and the broker itself looks at each topic in whole.

use std::collections::BTreeMap;

use bytes::Bytes;

/// Bytes of a subscription that publishers are told.
const MOST_OF_TOPIC: usize = 256;
/// Bytes of all that they are told, each with [`BESIDE`].
const MOST_BYTES: usize = 512 * 1024;
/// Bytes that one counts beside its name.
const BESIDE: usize = 16;

/// Subscriptions as publishers know them.
#[derive(Debug)]
pub(super) struct Wanted {
    /// Number of subscriptions for which each was told.
    told: BTreeMap<Bytes, usize>,
    bytes: usize,
    most_bytes: usize,
}

impl Default for Wanted {
    fn default() -> Self {
        Self::of(MOST_BYTES)
    }
}

impl Wanted {
    const fn of(most_bytes: usize) -> Self {
        Self { told: BTreeMap::new(), bytes: 0, most_bytes }
    }

    /// Subscription that publishers are to be told once a program has subscribed to `topic`; `None` where they know it.
    pub(super) fn subscribed(&mut self, topic: &[u8]) -> Option<Bytes> {
        let begins = topic.get(..MOST_OF_TOPIC).unwrap_or(topic);
        if let Some(times) = self.told.get_mut(begins) {
            *times += 1;
            return None;
        }
        let bytes = self.bytes + begins.len() + BESIDE;
        if bytes > self.most_bytes && !begins.is_empty() {
            return self.subscribed(b"");
        }
        self.bytes = bytes;
        let begins = Bytes::copy_from_slice(begins);
        self.told.insert(begins.clone(), 1);
        Some(begins)
    }

    /// Subscription that publishers are to be told is no more once one to `topic` has ended.
    pub(super) fn unsubscribed(&mut self, topic: &[u8]) -> Option<Bytes> {
        let begins = topic.get(..MOST_OF_TOPIC).unwrap_or(topic);
        // One without room may have come before one of the same name that has: as many as are not counted there are
        // counted as "everything", whichever they are.
        let told = if self.told.contains_key(begins) { begins } else { b"" };
        let times = self.told.get_mut(told)?;
        *times -= 1;
        if *times > 0 {
            return None;
        }
        let (told, _) = self.told.remove_entry(told)?;
        self.bytes -= told.len() + BESIDE;
        Some(told)
    }

    /// All that a publisher is told when it comes.
    pub(super) fn all(&self) -> Vec<Bytes> {
        self.told.keys().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_publisher_is_told_once_and_no_more_than_the_beginning() {
        let mut wanted = Wanted::default();
        assert_eq!(wanted.subscribed(b"/a").as_deref(), Some(&b"/a"[..]));
        assert_eq!(wanted.subscribed(b"/a"), None);
        assert_eq!(wanted.unsubscribed(b"/a"), None);
        assert_eq!(wanted.unsubscribed(b"/a").as_deref(), Some(&b"/a"[..]));
        let long = |end: u8| [vec![b'x'; 64_000], vec![end]].concat();
        assert_eq!(wanted.subscribed(&long(1)).unwrap(), vec![b'x'; MOST_OF_TOPIC]);
        assert_eq!(wanted.subscribed(&long(2)), None);
        assert_eq!(wanted.unsubscribed(&long(1)), None);
        assert_eq!(wanted.unsubscribed(&long(2)).unwrap(), vec![b'x'; MOST_OF_TOPIC]);
        assert_eq!((wanted.all().len(), wanted.bytes), (0, 0));
    }

    #[test]
    fn what_has_no_room_makes_everything_wanted() {
        let mut wanted = Wanted::default();
        let topics: Vec<_> = (0..4090).map(|number| format!("{number:01000}")).collect();
        let topics: Vec<Vec<u8>> =
            topics.iter().map(|topic| topic.bytes().rev().collect()).collect();
        let told: Vec<_> = topics.iter().filter_map(|topic| wanted.subscribed(topic)).collect();
        assert!(wanted.bytes <= MOST_BYTES && told.last().unwrap().is_empty());
        assert_eq!(told.len(), wanted.all().len());
        let gone = topics.iter().filter_map(|topic| wanted.unsubscribed(topic));
        assert_eq!(gone.count(), told.len());
        assert_eq!((wanted.all().len(), wanted.bytes), (0, 0));
    }

    proptest! {
        #[test]
        fn publishers_send_what_is_subscribed(
            steps in prop::collection::vec((0_usize..20, any::<bool>()), 0..200),
        ) {
            let (mut wanted, mut subscribed) = (Wanted::of(3000), Vec::new());
            let name = |number: usize| number.to_string().repeat(200).into_bytes();
            for (number, comes) in steps {
                if comes {
                    wanted.subscribed(&name(number));
                    subscribed.push(number);
                } else if let Some(place) = subscribed.iter().position(|it| *it == number) {
                    wanted.unsubscribed(&name(number));
                    subscribed.remove(place);
                }
                let told = wanted.all();
                for number in &subscribed {
                    prop_assert!(told.iter().any(|told| name(*number).starts_with(told)));
                }
            }
            for number in subscribed {
                wanted.unsubscribed(&name(number));
            }
            prop_assert_eq!((wanted.all().len(), wanted.bytes), (0, 0));
        }
    }
}
