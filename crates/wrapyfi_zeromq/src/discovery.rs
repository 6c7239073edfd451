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
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::codec::looks_like;
use super::config::NAME;
use super::frames::{Received, receive};
use super::link::{self, BrokerLink, Watch};
use super::options;
use super::shared::ZeroMqState;
use super::traffic::{ASKS_FOR_COUNTS, TRAFFIC_TOPIC, TopicTraffic, TrafficTable};
use wrapyfi_endpoint::{Cause, DiscoverError, Discovered, Discovery, Role, Traffic, Wake};

/// Longest time that our broker may take to send its table, once it is reached.
const OURS_ANSWERS_WITHIN: Duration = Duration::from_secs(1);
/// Largest count or table that is read.
const MAX_TOLD_BYTES: usize = 4 << 20;
/// Topics kept of what we see ourselves.
const MAX_TOPICS: usize = 4096;
/// Messages taken at once.
const BATCH: usize = 1024;

/// Looks at one broker.
pub(super) struct ZeroMqDiscovery {
    monitor_topic: String,
    /// Socket and watch; none once it is dropped.
    connection: Option<(zmq::Socket, Watch)>,
    link: Arc<BrokerLink>,
    reached_at: Option<Instant>,
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
        let link = BrokerLink::new(&shared.pub_endpoint(), "", shared.keys.as_ref());
        let connection = shared
            .contexts
            .open(|context| open(context, shared, &link, monitor_topic))
            .map_err(|error| transport(&error))?;
        Ok(Self {
            monitor_topic: monitor_topic.to_owned(),
            connection: Some(connection),
            link,
            reached_at: None,
            sees_all: false,
            has_table: false,
            listeners: None,
            topics: BTreeMap::new(),
        })
    }

    /// Subscribes to what begins with `prefix` from the start, and sees what passes there.
    pub(super) fn subscribed(mut self, prefix: &str) -> Result<Self, DiscoverError> {
        if let Some((socket, _)) = &self.connection {
            socket.set_subscribe(prefix.as_bytes()).map_err(|error| transport(&error))?;
            self.sees_all = true;
        }
        Ok(self)
    }

    fn read(&mut self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some((socket, _)) = &self.connection else { return Ok(()) };
            let Some(Received { frames, count, bytes }) = receive(socket, usize::MAX)? else {
                return Ok(());
            };
            let (Some(first), body) = (frames.first(), frames.get(1..)) else { continue };
            let body: &[u8] = body.and_then(<[_]>::last).map_or(&[], |last| last);
            let Ok(topic) = std::str::from_utf8(first) else { continue };
            if topic == self.monitor_topic {
                if let Some(counts) = read_counts(body) {
                    self.listeners = Some(counts);
                }
            } else if topic == TRAFFIC_TOPIC {
                if let Some(topics) = read_table(body) {
                    (self.topics, self.has_table) = (topics, true);
                }
            } else if self.sees_all && !topic.is_empty() {
                let room = self.topics.len() < MAX_TOPICS || self.topics.contains_key(topic);
                if room {
                    let seen = self.topics.entry(topic.to_owned()).or_default();
                    seen.messages += 1;
                    seen.bytes = seen.bytes.saturating_add(bytes as u64);
                    seen.type_name = looks_like(count, body).map(str::to_owned);
                }
            }
        }
        Ok(())
    }

    /// Subscribes to everything when the broker has shown that it is not ours.
    fn widen(&mut self, now: Instant) -> zmq::Result<()> {
        if !self.link.is_up() {
            self.reached_at = None;
            return Ok(());
        }
        let since = *self.reached_at.get_or_insert(now);
        if self.has_table || self.sees_all || now < since + OURS_ANSWERS_WITHIN {
            return Ok(());
        }
        let Some((socket, _)) = &self.connection else { return Ok(()) };
        socket.set_subscribe(b"")?;
        self.sees_all = true;
        Ok(())
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

fn transport(error: &zmq::Error) -> DiscoverError {
    DiscoverError::Transport { middleware: NAME.to_owned(), reason: error.to_string() }
}

fn open(
    context: &zmq::Context,
    shared: &ZeroMqState,
    link: &Arc<BrokerLink>,
    monitor_topic: &str,
) -> zmq::Result<(zmq::Socket, Watch)> {
    let socket = context.socket(zmq::SUB)?;
    options::set_common(&socket, shared.ip)?;
    socket.set_maxmsgsize(options::frame_limit(shared.max_frame_bytes))?;
    let name = format!("{ASKS_FOR_COUNTS}{}", std::process::id());
    for topic in [monitor_topic, TRAFFIC_TOPIC, &name] {
        socket.set_subscribe(topic.as_bytes())?;
    }
    link::connect(context, socket, link, shared.keys.as_ref())
}

impl Discovery for ZeroMqDiscovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let now = Instant::now();
        if let Some((socket, watch)) = &mut self.connection {
            watch.take();
            watch.connect_again(socket, &Wake::new(), now);
        }
        self.read().and_then(|()| self.widen(now)).map_err(|error| transport(&error))?;
        let publishers = self.topics.iter().map(|(name, seen)| Discovered {
            type_name: seen.type_name.clone(),
            traffic: Some(Traffic {
                messages: seen.messages,
                bytes: seen.bytes,
                not_taken: seen.not_taken,
            }),
            ..Discovered::new(name, Role::Publisher)
        });
        let listeners = self.listeners.iter().flatten().map(|(name, count)| Discovered {
            count: *count,
            ..Discovered::new(name, Role::Listener)
        });
        let mut found: Vec<_> = publishers.chain(listeners).collect();
        found.sort_by(|a, b| (&a.name, a.role).cmp(&(&b.name, b.role)));
        Ok(found)
    }

    fn waiting_for(&self) -> Option<Cause> {
        self.link.waiting_for()
    }

    fn is_complete(&self) -> Option<bool> {
        // Of another's broker whatever passes is new, for as long as we look.
        Some(if self.link.is_up() {
            self.has_table && self.listeners.is_some()
        } else {
            self.link.has_failed()
        })
    }
}

impl Drop for ZeroMqDiscovery {
    fn drop(&mut self) {
        // In this order: see link.rs.
        if let Some((socket, watch)) = self.connection.take() {
            drop(socket);
            watch.see_out();
        }
    }
}
