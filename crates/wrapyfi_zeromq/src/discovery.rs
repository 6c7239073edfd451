//! Topics of a broker: who is subscribed, and what passes.
//!
//! ```text
//!   broker ── ZEROMQ/CONNECTIONS {"/camera": 1} ──▶ listeners ─┐
//!   broker ── WRAPYFI/TRAFFIC (ours only) ────────▶ topics ────┼─▶ [Discovered]
//!   broker ── everything (any other broker) ──────▶ topics ────┘
//! ```
//!
//! Wrapyfi's own broker tells subscriptions only when they change, and nothing of traffic. To the
//! first the answer is a subscription of our own, to a name that no program publishes. To the second,
//! when a second has shown that the broker is not ours, it is to subscribe to everything: for as
//! long as we look, messages flow that no other program asked for.
//!
//! A publisher that sends nothing cannot be seen: ZeroMQ has no word for it.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::time::{Duration, Instant};

use bytes::Bytes;
use mio::{Events, Poll};

use super::codec::looks_like;
use super::config::NAME;
use super::connection::{Connection, SocketRole};
use super::heard::Heard;
use super::peer::Peer;
use super::shared::ZeroMqState;
use super::traffic::{ASKS_FOR_COUNTS, TRAFFIC_TOPIC, TopicTraffic, TrafficTable};
use super::zmtp::Kind;
use wrapyfi_endpoint::{Cause, DiscoverError, Discovered, Discovery, Role, Throttle, Traffic};

/// Longest time that our broker may take to send its table, once it is reached.
const OURS_ANSWERS_WITHIN: Duration = Duration::from_secs(1);
/// Largest count or table that is read.
const MAX_TOLD_BYTES: usize = 4 << 20;
/// Topics kept of what we see ourselves.
const MAX_TOPICS: usize = 4096;
/// Longest time that one look may wait for a handshake, which takes a millisecond on one host.
const HANDSHAKE_NEARBY: Duration = Duration::from_millis(20);

/// Looks at one broker.
pub(super) struct ZeroMqDiscovery {
    connection: Connection,
    seen: Seen,
    /// Poll in which the connection tells that something has come.
    poll: Poll,
    faults: Throttle,
    reached_at: Option<Instant>,
}

/// Topics and listeners that the broker has told of, or that were seen to pass.
struct Seen {
    monitor_topic: String,
    subscribes: Vec<String>,
    /// Bytes of a message that is read.
    most_bytes: usize,
    /// True while everything is subscribed to.
    sees_all: bool,
    has_table: bool,
    /// Listeners of each topic, once the broker has told `{"/topic": count}`. Anything else is ignored: anyone can
    /// publish it.
    listeners: Option<BTreeMap<String, u64>>,
    topics: BTreeMap<String, TopicTraffic>,
}

impl ZeroMqDiscovery {
    pub(super) fn new(shared: &ZeroMqState, monitor_topic: &str) -> Result<Self, DiscoverError> {
        let asks = format!("{ASKS_FOR_COUNTS}{}", std::process::id());
        Ok(Self {
            connection: shared.unlisted(shared.pub_address, ""),
            seen: Seen {
                monitor_topic: monitor_topic.to_owned(),
                subscribes: vec![monitor_topic.to_owned(), TRAFFIC_TOPIC.to_owned(), asks],
                most_bytes: shared.max_frame_bytes,
                sees_all: false,
                has_table: false,
                listeners: None,
                topics: BTreeMap::new(),
            },
            poll: Poll::new().map_err(|error| transport(&error))?,
            faults: Throttle::default(),
            reached_at: None,
        })
    }

    /// Subscribes to what begins with `prefix` from the start, and sees what passes there.
    pub(super) fn subscribed(mut self, prefix: &str) -> Self {
        self.seen.subscribes.push(prefix.to_owned());
        self.seen.sees_all = true;
        self
    }

    /// Takes turns of the connection until nothing more has come, or for the time that a handshake takes nearby.
    fn turns(&mut self) -> std::io::Result<()> {
        let until = Instant::now() + HANDSHAKE_NEARBY;
        let mut events = Events::with_capacity(8);
        loop {
            let now = Instant::now();
            let Self { connection, seen, poll, faults, .. } = self;
            let progress = connection.turn(seen, now, poll.registry(), faults);
            let is_open = connection.peer().is_some_and(Peer::is_open);
            if now >= until || (is_open && !progress.more) || connection.link.has_failed() {
                return Ok(());
            }
            let wait = if progress.more { Duration::ZERO } else { until - now };
            match self.poll.poll(&mut events, Some(wait)) {
                Err(error) if error.kind() != ErrorKind::Interrupted => return Err(error),
                _ => {}
            }
        }
    }

    /// Subscribes to everything when the broker has shown that it is not ours.
    fn widen(&mut self, now: Instant) {
        if !self.connection.link.is_up() {
            self.reached_at = None;
            return;
        }
        let since = *self.reached_at.get_or_insert(now);
        let seen = &mut self.seen;
        if seen.has_table || seen.sees_all || now < since + OURS_ANSWERS_WITHIN {
            return;
        }
        let all = String::new();
        if let Some(peer) = self.connection.peer_mut()
            && peer.subscribe_to(&all).is_ok()
        {
            seen.subscribes.push(all);
            seen.sees_all = true;
        }
    }
}

impl SocketRole for Seen {
    fn begin(&mut self, peer: Peer) -> Peer {
        peer.of_messages(Kind::Xsub, self.most_bytes).subscribing(self.subscribes.clone())
    }

    fn hear(&mut self, said: Heard) {
        if let Heard::Message(frames) = said {
            self.take(&frames);
        }
    }
}

impl Seen {
    fn take(&mut self, frames: &[Bytes]) {
        let Some((first, behind)) = frames.split_first() else { return };
        let body: &[u8] = behind.last().map_or(&[], |last| last);
        let Ok(topic) = std::str::from_utf8(first) else { return };
        if topic == self.monitor_topic {
            if let Some(counts) = read_counts(body) {
                self.listeners = Some(counts);
            }
        } else if topic == TRAFFIC_TOPIC {
            if let Some(topics) = read_table(body) {
                (self.topics, self.has_table) = (topics, true);
            }
        } else if self.sees_all
            && !topic.is_empty()
            && (self.topics.len() < MAX_TOPICS || self.topics.contains_key(topic))
        {
            let bytes: usize = frames.iter().map(Bytes::len).sum();
            let seen = self.topics.entry(topic.to_owned()).or_default();
            seen.messages += 1;
            seen.bytes = seen.bytes.saturating_add(bytes as u64);
            seen.type_name = looks_like(frames.len(), body).map(str::to_owned);
        }
    }
}

/// Topics with their listeners, from what a broker told.
pub(super) fn read_counts(body: &[u8]) -> Option<BTreeMap<String, u64>> {
    let body = Some(body).filter(|body| body.len() <= MAX_TOLD_BYTES)?;
    let mut counts: BTreeMap<String, u64> = serde_json::from_slice(body).ok()?;
    let own = |topic: &str| topic == TRAFFIC_TOPIC || topic.starts_with(ASKS_FOR_COUNTS);
    counts.retain(|topic, count| *count > 0 && !own(topic));
    Some(counts)
}

/// Topics with their traffic, from what a broker of ours told.
pub(super) fn read_table(body: &[u8]) -> Option<BTreeMap<String, TopicTraffic>> {
    let body = Some(body).filter(|body| body.len() <= MAX_TOLD_BYTES)?;
    serde_json::from_slice::<TrafficTable>(body).ok().map(|told| told.topics)
}

fn transport(error: &std::io::Error) -> DiscoverError {
    DiscoverError::Transport { middleware: NAME.to_owned(), reason: error.to_string() }
}

impl Discovery for ZeroMqDiscovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        self.turns().map_err(|error| transport(&error))?;
        self.widen(Instant::now());
        let publishers = self.seen.topics.iter().map(|(name, seen)| Discovered {
            type_name: seen.type_name.clone(),
            traffic: Some(Traffic {
                messages: seen.messages,
                bytes: seen.bytes,
                not_taken: seen.not_taken,
            }),
            ..Discovered::new(name, Role::Publisher)
        });
        let listeners = self.seen.listeners.iter().flatten().map(|(name, count)| Discovered {
            count: *count,
            ..Discovered::new(name, Role::Listener)
        });
        let mut found: Vec<_> = publishers.chain(listeners).collect();
        found.sort_by(|a, b| (&a.name, a.role).cmp(&(&b.name, b.role)));
        Ok(found)
    }

    fn waiting_for(&self) -> Option<Cause> {
        self.connection.link.waiting_for()
    }

    fn is_complete(&self) -> Option<bool> {
        // Of another's broker whatever passes is new, for as long as we look.
        Some(if self.connection.link.is_up() {
            self.seen.has_table && self.seen.listeners.is_some()
        } else {
            self.connection.link.has_failed()
        })
    }
}
