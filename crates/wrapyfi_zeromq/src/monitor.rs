//! Counts of the subscribed connections by topic, as the broker's XPUB socket reports them.
//!
//! ```text
//!   XPUB ── 0x01 topic ──▶ subscribed()  ─┐
//!        ── 0x00 topic ──▶ unsubscribed() ├─▶ message(): {"/camera": 2, "/sound": 0}
//!                                         │
//!                                         └─▶ true: one for publishers
//! ```
//!
//! The broker's XPUB reports each connection that comes and each one that goes, by unsubscription,
//! closed connection or missed heartbeats; one that subscribes to a topic twice is counted once.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::{Duration, Instant};

/// Topics listed at most. Beyond, subscriptions work but are not told.
const MAX_TOPICS: usize = 4096;
/// Bytes of the names of all that are listed: each listener of the counts gets them at every change.
const MAX_BYTES: usize = 1 << 20;
/// Longest name that is listed.
const MAX_NAME_BYTES: usize = 1024;
/// Time for which a topic stays listed with count 0, so that every publisher hears of it although
/// single repeats may be lost.
const KEEP_ZERO: Duration = Duration::from_secs(10);

/// Counts of one broker.
#[derive(Debug)]
pub(super) struct Monitor {
    /// First part of a message with counts.
    pub(super) own_topic: Option<Vec<u8>>,
    topics: BTreeMap<Vec<u8>, Count>,
    /// Bytes of their names.
    bytes: usize,
    changed: bool,
}

#[derive(Debug, Clone, Copy)]
struct Count {
    subscriptions: u64,
    changed_at: Instant,
}

impl Monitor {
    /// Counts without any subscription. The counts are published on `own_topic`, which is not
    /// counted itself.
    pub(super) fn new(own_topic: Option<&str>) -> Self {
        let own_topic = own_topic.map(|topic| topic.as_bytes().to_vec());
        Self { own_topic, topics: BTreeMap::new(), bytes: 0, changed: false }
    }

    /// True for a first frame that listeners of the counts would take for counts.
    pub(super) fn is_forged(&self, first_frame: &[u8]) -> bool {
        self.own_topic.as_ref().is_some_and(|own| first_frame.starts_with(own))
    }

    /// Takes note of a subscription; true for one that is publishers' concern.
    pub(super) fn subscribed(&mut self, topic: &[u8], now: Instant) -> bool {
        // A new listener of the counts gets them at once.
        self.changed = true;
        if self.own_topic.as_deref() == Some(topic) {
            return false;
        }
        if let Some(count) = self.topics.get_mut(topic) {
            *count = Count { subscriptions: count.subscriptions + 1, changed_at: now };
            return true;
        }
        let bytes = self.bytes + topic.len();
        if self.topics.len() < MAX_TOPICS && bytes <= MAX_BYTES && topic.len() <= MAX_NAME_BYTES {
            self.bytes = bytes;
            self.topics.insert(topic.to_vec(), Count { subscriptions: 1, changed_at: now });
        }
        true
    }

    /// Takes note that a subscription is gone; true for one that is publishers' concern.
    pub(super) fn unsubscribed(&mut self, topic: &[u8], now: Instant) -> bool {
        if self.own_topic.as_deref() == Some(topic) {
            return false;
        }
        if let Some(count) = self.topics.get_mut(topic) {
            let subscriptions = count.subscriptions.saturating_sub(1);
            *count = Count { subscriptions, changed_at: now };
            self.changed = true;
        }
        true
    }

    /// True once after each change.
    pub(super) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Takes out the topics that nobody has been subscribed to for a while; true when there were any.
    pub(super) fn prune(&mut self, now: Instant) -> bool {
        let before = self.topics.len();
        self.topics.retain(|topic, count| {
            let is_kept = count.subscriptions > 0
                || now.saturating_duration_since(count.changed_at) < KEEP_ZERO;
            self.bytes -= if is_kept { 0 } else { topic.len() };
            is_kept
        });
        self.topics.len() < before
    }

    /// The second frame of the counts, in Python's spelling of JSON; `None` when there is nothing
    /// to tell.
    pub(super) fn message(&self) -> Option<String> {
        self.own_topic.as_ref()?;
        let mut json = String::from("{");
        for (topic, count) in self.listed() {
            let name = serde_json::Value::from(topic);
            let comma = if json.len() > 1 { ", " } else { "" };
            // Writing to a String does not fail.
            write!(json, "{comma}{name}: {count}").ok()?;
        }
        json.push('}');
        (json.len() > 2).then_some(json)
    }

    /// Topics that have a name, with their counts.
    pub(super) fn listed(&self) -> impl Iterator<Item = (&str, u64)> {
        self.topics.iter().filter_map(|(topic, count)| {
            let name = std::str::from_utf8(topic).ok().filter(|name| !name.is_empty())?;
            Some((name, count.subscriptions))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: &str = "ZEROMQ/CONNECTIONS";

    #[test]
    fn counts_are_written_as_wrapyfi_writes_them() {
        let now = Instant::now();
        let mut monitor = Monitor::new(Some(OWN));
        assert_eq!(monitor.message(), None);
        assert!(monitor.subscribed(b"/cap/own", now));
        assert_eq!(monitor.message().unwrap(), r#"{"/cap/own": 1}"#);
        assert!(monitor.subscribed(b"/cap/own", now));
        assert!(monitor.subscribed("/\"\u{e9}".as_bytes(), now));
        let json = monitor.message().unwrap();
        let counts: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(counts, serde_json::json!({"/cap/own": 2, "/\"\u{e9}": 1}));
    }

    #[test]
    fn the_last_one_gone_is_zero_for_a_while() {
        let now = Instant::now();
        let mut monitor = Monitor::new(Some(OWN));
        monitor.subscribed(b"/a", now);
        monitor.subscribed(b"/a", now);
        monitor.unsubscribed(b"/a", now);
        assert_eq!(monitor.message().unwrap(), r#"{"/a": 1}"#);
        monitor.unsubscribed(b"/a", now);
        assert_eq!(monitor.message().unwrap(), r#"{"/a": 0}"#);
        monitor.subscribed(b"/a", now);
        monitor.unsubscribed(b"/a", now);
        assert!(monitor.prune(now + KEEP_ZERO));
        assert_eq!(monitor.message(), None);
    }

    #[test]
    fn its_own_topic_is_neither_counted_nor_passed_on() {
        let now = Instant::now();
        let mut monitor = Monitor::new(Some(OWN));
        assert!(!monitor.subscribed(OWN.as_bytes(), now));
        assert!(monitor.take_changed(), "the new listener gets the counts at once");
        assert!(!monitor.take_changed());
        assert_eq!(monitor.message(), None);
        assert!(monitor.is_forged(b"ZEROMQ/CONNECTIONS2"));
        assert!(!monitor.is_forged(b"/a"));
    }

    #[test]
    fn what_is_told_has_an_end_and_room_comes_back() {
        let now = Instant::now();
        let mut monitor = Monitor::new(Some(OWN));
        assert!(monitor.subscribed(&[b'x'; MAX_NAME_BYTES + 1], now), "it works, untold");
        let names: Vec<_> = (0..4000).map(|number| format!("{number:0>1000}")).collect();
        for name in &names {
            assert!(monitor.subscribed(name.as_bytes(), now));
        }
        assert_eq!(monitor.listed().count(), MAX_BYTES / 1000);
        for name in &names {
            monitor.unsubscribed(name.as_bytes(), now);
        }
        assert!(monitor.prune(now + KEEP_ZERO));
        assert_eq!(monitor.message(), None);
        assert_eq!(monitor.bytes, 0);
    }

    #[test]
    fn names_that_are_no_text_work_unlisted() {
        let now = Instant::now();
        let mut monitor = Monitor::new(Some(OWN));
        assert!(monitor.subscribed(&[0xff], now));
        assert!(monitor.subscribed(b"", now));
        assert_eq!(monitor.message(), None);
        assert!(monitor.unsubscribed(&[0xff], now));
    }
}
