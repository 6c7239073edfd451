//! Targets of what ZeroMQ's ports hear: who answers there, connections to the broker, what a broker tells.

use std::collections::BTreeMap;

use bytes::Bytes;
use wrapyfi_zeromq::{PortHolder, offline};

use crate::bounded;

/// Memory for each byte of a connection: an empty frame of two bytes is a message of its own.
const FRAMES: usize = 256;
/// Largest message of a connection.
const MESSAGE: usize = 4096;
/// Memory for each byte of counts: a topic of few letters is an entry with its name.
const COUNTS: usize = 256;
/// Topic of the counts.
const OWN: &str = "ZEROMQ/CONNECTIONS";

/// Answer of a program on a port where a broker is looked for.
pub fn zeromq_probe(data: &[u8]) {
    let answer = bounded(data.len(), 16, || offline::port_answer(data));
    let text = answer.to_string();
    assert!(text.len() < 256 && text.bytes().all(|byte| (b' '..=b'~').contains(&byte)), "{text:?}");
    if let PortHolder::Socket(kind) = answer {
        assert!(data.len() > 64 + kind.len() / 4, "more than was said");
    }
}

/// A connection to a port of the broker: the first byte chooses the port and how many bytes come at a time.
pub fn zeromq_peer(data: &[u8]) {
    let [choice, bytes @ ..] = data else { return };
    let (kind, piece) = (usize::from(choice >> 6), usize::from(choice & 0x3f) + 1);
    let converse = |piece| offline::converse(kind, MESSAGE, bytes, piece);
    let heard = bounded(bytes.len(), FRAMES, || converse(bytes.len()));
    let of_peer = heard.messages.iter().flatten().map(Bytes::len).sum::<usize>()
        + heard.subscriptions.iter().map(|(_, topic)| topic.len()).sum::<usize>();
    assert!(of_peer <= bytes.len(), "more than was said");
    for message in &heard.messages {
        assert!(!message.is_empty() && message.iter().map(Bytes::len).sum::<usize>() <= MESSAGE);
    }
    assert!(if kind == 0 { heard.messages.is_empty() } else { heard.subscriptions.is_empty() });
    let in_pieces = bounded(bytes.len(), FRAMES, || converse(piece));
    assert_eq!(in_pieces, heard, "in pieces of {piece}");
}

/// Subscriptions to a broker, a line each: `+` and a topic, or `-` where it ends; after a line `----`, what another
/// broker tells of itself.
pub fn zeromq_counts(data: &[u8]) {
    const SEPARATOR: &[u8] = b"\n----\n";
    let cut = data.windows(SEPARATOR.len()).position(|part| part == SEPARATOR);
    let (words, told) = data.split_at(cut.unwrap_or(data.len()));
    let told = told.strip_prefix(SEPARATOR).unwrap_or_default();
    let words = || {
        words.split(|&byte| byte == b'\n').filter_map(|line| match line {
            [b'+', topic @ ..] => Some((true, topic)),
            [b'-', topic @ ..] => Some((false, topic)),
            _ => None,
        })
    };
    let mut wanted: BTreeMap<String, u64> = BTreeMap::new();
    for (is_on, topic) in words() {
        let name = std::str::from_utf8(topic).ok().filter(|name| !name.is_empty() && *name != OWN);
        let Some(name) = name else { continue };
        if is_on {
            *wanted.entry(name.to_owned()).or_default() += 1;
        } else if let Some(count) = wanted.get_mut(name) {
            *count = count.saturating_sub(1);
        }
    }
    let message = bounded(data.len(), COUNTS, || offline::counts_after(OWN, words()));
    assert_eq!(message.is_some(), !wanted.is_empty());
    if let Some(message) = message {
        let all: BTreeMap<String, u64> =
            serde_json::from_str(&message).expect("counts are JSON whatever the names are");
        assert_eq!(all, wanted);
    }
    let counts = bounded(told.len(), COUNTS, || offline::read_counts(told));
    assert!(counts.unwrap_or_default().values().all(|count| *count > 0));
    if let Some(topics) = bounded(told.len(), COUNTS, || offline::read_table(told)) {
        assert!(topics.len() <= told.len());
    }
}
