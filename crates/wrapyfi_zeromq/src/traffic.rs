//! Traffic of the broker: topics, their messages, and the kind of payload that the frames show.
//!
//! ```text
//!   XSUB ── frames ──▶ count ─▶ table ── while a program is subscribed to WRAPYFI/TRAFFIC ──▶ XPUB
//! ```
//!
//! Publishers say nothing to a broker but their messages: this table is all there is to know of
//! them. It is published on a topic of its own, so that a program that asks need not subscribe to everything,
//! which would make every publisher believe it has a listener.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Topic of the table. No other program can publish to it through the broker.
pub(super) const TRAFFIC_TOPIC: &str = "WRAPYFI/TRAFFIC";
/// Prefix of the subscription that makes Wrapyfi's broker tell its counts. Not listed.
pub(super) const ASKS_FOR_COUNTS: &str = "WRAPYFI/LOOK/";
/// Prefix of the subscription that tells a publisher of the topic after it that its CURVE key may not publish it. Not
/// listed.
pub(super) const REFUSED: &str = "WRAPYFI/REFUSED/";
/// Prefix of the subscription with which a listener asks whether its CURVE key may listen to the topic after it. A broker
/// of ours answers, with a message of this name, where it may not: it ignores the other subscription. Not listed.
pub(super) const DENIED: &str = "WRAPYFI/DENIED/";

/// Beginnings of topics that a broker of ours alone publishes, whatever its settings are.
pub(super) const OWN_TOPICS: [&str; 2] = [TRAFFIC_TOPIC, DENIED];

/// Topics kept. Messages on others are counted together.
const MAX_TOPICS: usize = 4096;
/// Longest topic that is kept.
const MAX_TOPIC_BYTES: usize = 1024;

/// Traffic of one topic.
///
/// See [`BrokerStatus::topics`](super::BrokerStatus::topics).
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TopicTraffic {
    /// Messages passed on.
    pub messages: u64,
    /// Bytes of those messages, all frames.
    pub bytes: u64,
    /// Type that the last message looked like, by Wrapyfi's frames.
    #[serde(rename = "type")]
    pub type_name: Option<String>,
    /// Messages that the broker did not take: larger than it passes on, or than it had room for.
    #[serde(default)]
    pub not_taken: u64,
}

/// The table as it is table.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct TrafficTable {
    pub(super) topics: BTreeMap<String, TopicTraffic>,
    /// Messages of topics that found no room, or whose name is no text.
    pub(super) unlisted: u64,
}

/// Counts of one topic.
#[derive(Debug, Default)]
struct Seen {
    messages: u64,
    bytes: u64,
    not_taken: u64,
    look: Option<&'static str>,
}

/// Counts of one broker.
#[derive(Debug, Default)]
pub(super) struct Traffic {
    topics: BTreeMap<Vec<u8>, Seen>,
    unlisted: u64,
    /// Number of those who are subscribed to the table.
    pub(super) watchers: u64,
    changed: bool,
}

impl Traffic {
    /// Takes note of a message.
    pub(super) fn count(&mut self, topic: &[u8], bytes: usize, look: Option<&'static str>) {
        let Some(seen) = self.seen(topic) else { return };
        seen.messages += 1;
        seen.bytes = seen.bytes.saturating_add(bytes as u64);
        seen.look = look;
    }

    /// Takes note of a message that was not taken.
    pub(super) fn not_taken(&mut self, topic: &[u8]) {
        if let Some(seen) = self.seen(topic) {
            seen.not_taken += 1;
        }
    }

    /// Counts of a topic; `None` where it finds no room.
    fn seen(&mut self, topic: &[u8]) -> Option<&mut Seen> {
        self.changed = true;
        if !self.topics.contains_key(topic) {
            if self.topics.len() >= MAX_TOPICS || topic.len() > MAX_TOPIC_BYTES {
                self.unlisted += 1;
                return None;
            }
            self.topics.insert(topic.to_vec(), Seen::default());
        }
        self.topics.get_mut(topic)
    }

    /// True once after messages.
    pub(super) fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// The second frame of the table; `None` while no program is subscribed to it.
    pub(super) fn message(&self) -> Option<Vec<u8>> {
        if self.watchers == 0 {
            return None;
        }
        serde_json::to_vec(&self.table()).ok()
    }

    /// The table.
    pub(super) fn table(&self) -> TrafficTable {
        let mut table = TrafficTable { unlisted: self.unlisted, ..TrafficTable::default() };
        for (topic, &Seen { messages, bytes, not_taken, look }) in &self.topics {
            match std::str::from_utf8(topic) {
                Ok(name) if !name.is_empty() => {
                    let type_name = look.map(str::to_owned);
                    let topic = TopicTraffic { messages, bytes, type_name, not_taken };
                    table.topics.insert(name.to_owned(), topic);
                }
                _ => table.unlisted += messages,
            }
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_counted_and_told_to_those_who_ask() {
        let mut traffic = Traffic::default();
        traffic.count(b"/a", 10, Some("NativeObject"));
        traffic.count(b"/a", 5, Some("NativeObject"));
        traffic.count(&[0xff], 5, None);
        traffic.not_taken(b"/a");
        assert_eq!(traffic.message(), None, "nobody asks");
        traffic.watchers = 1;
        let text = traffic.message().unwrap();
        let table: TrafficTable = serde_json::from_slice(&text).unwrap();
        let type_name = Some("NativeObject".to_owned());
        assert_eq!(
            table.topics["/a"],
            TopicTraffic { messages: 2, bytes: 15, type_name, not_taken: 1 }
        );
        assert_eq!((table.topics.len(), table.unlisted), (1, 1));
        traffic.watchers = 0;
        assert_eq!(traffic.message(), None);
    }

    #[test]
    fn the_table_has_an_end() {
        let mut traffic = Traffic::default();
        for number in 0..MAX_TOPICS + 3 {
            traffic.count(format!("/{number}").as_bytes(), 1, None);
        }
        traffic.count(&[b'x'; MAX_TOPIC_BYTES + 1], 1, None);
        let table = traffic.table();
        assert_eq!((table.topics.len(), table.unlisted), (MAX_TOPICS, 4));
    }
}
