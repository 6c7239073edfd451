//! The broker's thread: messages one way, subscriptions the other, counts every half second.
//!
//! ```text
//!   publishers ──▶ back: XSUB ── messages ────────▶ front: XPUB ──▶ listeners
//!   publishers ◀── XSUB ◀── first, last subscription ── XPUB ◀── listeners
//!                                  │                      ▲
//!                                  └─ Monitor ── counts ──┘
//! ```
//!
//! A publisher of the process that the broker runs in needs no XSUB: its messages go to the front on its own thread, and
//! only subscriptions come to it by its connection.
//!
//! Frames are moved, not copied, where they are large. The monitor sees subscriptions only: messages, however many,
//! cannot delay the counts by more than one batch.
//!
//! A listener that reads more slowly than is published misses what exceeds its queue here, and no other program is
//! slowed down. Each message that it misses is counted, here and where it was published in this process.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::assembly::NotTaken;
use super::broker_ports::{BrokerPorts, Wait};
use super::codec::looks_like;
use super::heard::Heard;
use super::inside::Passes;
use super::message::Loss;
use super::monitor::Monitor;
use super::options;
use super::status::BrokerStatus;
use super::traffic::{OWN_TOPICS, TRAFFIC_TOPIC, Traffic, TrafficTable};
use super::turns::{Stop, Turns};
use wrapyfi_endpoint::{Mutex, Throttle};

/// Time between repeats of the counts, for publishers that connect later than the listener.
const REPEAT: Duration = Duration::from_millis(500);
/// Time between two tellings, as a multiple of what the last one took: subscriptions that come and go without end leave
/// the broker to its messages.
const REST: u32 = 10;

/// State of the broker, which its thread and publishers of this process use in turn.
pub(super) struct Proxy {
    pub(super) ports: BrokerPorts,
    pub(super) monitor: Monitor,
    pub(super) traffic: Traffic,
    /// Counts, as others see them.
    pub(super) status: Arc<Mutex<BrokerStatus>>,
    pub(super) slow: Throttle,
    /// Time at which the counts are sent again.
    pub(super) repeat_at: Instant,
    /// True where a change has not been announced.
    pub(super) is_untold: bool,
    /// Time from which on changes are told.
    pub(super) tell_at: Instant,
}

impl Proxy {
    fn pass_subscriptions(&mut self, now: Instant) {
        let is_traffic = |topic: &[u8]| topic == TRAFFIC_TOPIC.as_bytes();
        for heard in std::mem::take(&mut self.ports.front.heard) {
            let pass_on = match &heard {
                Heard::Ignored
                | Heard::NoRoom(_)
                | Heard::Message(_)
                | Heard::Denied(_)
                | Heard::NotTaken(_) => {
                    self.status.lock().ignored += 1;
                    None
                }
                Heard::Subscribed(topic) if is_traffic(topic) => {
                    self.traffic.watchers += 1;
                    self.is_untold = true;
                    None
                }
                Heard::Unsubscribed(topic) if is_traffic(topic) => {
                    self.traffic.watchers = self.traffic.watchers.saturating_sub(1);
                    None
                }
                Heard::Subscribed(topic) => {
                    self.monitor.subscribed(topic, now).then_some((true, topic))
                }
                Heard::Unsubscribed(topic) => {
                    self.monitor.unsubscribed(topic, now).then_some((false, topic))
                }
            };
            if let Some((is_wanted, topic)) = pass_on {
                self.ports.back.want(topic, is_wanted);
            }
        }
        self.is_untold |= self.monitor.take_changed();
        self.ports.back.flush();
    }

    /// Reads and passes on what has come, as far as each publisher has a turn; false when nothing had.
    fn pass_messages(&mut self, now: Instant) -> bool {
        if let Err(error) = self.ports.back.turn(now) {
            tracing::error!(%error, "the ZeroMQ broker cannot wait for its publishers");
        }
        let messages = std::mem::take(&mut self.ports.back.messages);
        let any = !messages.is_empty();
        for (_, frames) in messages {
            self.pass(frames);
        }
        let mut status = self.status.lock();
        for NotTaken { topic, reason } in std::mem::take(&mut self.ports.back.not_taken) {
            *status.missed.entry(reason.as_str()).or_default() += 1;
            self.traffic.not_taken(&topic);
            self.ports.ledger.not_taken(&topic, reason);
        }
        self.ports.front.flush();
        status.ignored += self.ports.back.heard.drain(..).len() as u64;
        any
    }

    /// Passes a message on to the queues of its listeners.
    fn pass(&mut self, frames: Vec<Bytes>) {
        let bytes = frames.iter().map(Bytes::len).sum();
        let forged = |first: &Bytes| {
            self.monitor.is_forged(first)
                || OWN_TOPICS.iter().any(|own| first.starts_with(own.as_bytes()))
        };
        if frames.first().is_some_and(forged) {
            self.status.lock().forged += 1;
            return;
        }
        if let (Some(topic), Some(last)) = (frames.first(), frames.last()) {
            self.traffic.count(topic, bytes, looks_like(frames.len(), last));
        }
        self.ports.front.publish(frames, Some(bytes));
        let mut status = self.status.lock();
        status.messages += 1;
        status.bytes += bytes as u64;
    }

    /// Counts what listeners missed, and who was refused.
    fn settle(&mut self) {
        let mut status = self.status.lock();
        for Loss { reason, listener, first } in std::mem::take(&mut self.ports.front.losses) {
            *status.missed.entry(reason.as_str()).or_default() += 1;
            let topic = first.as_ref().map(|(topic, _)| String::from_utf8_lossy(topic));
            if let Some(unlogged_before) = self.slow.pass(Instant::now()) {
                let topic = topic.as_deref().unwrap_or_default();
                tracing::warn!(%listener, topic, unlogged_before, "a listener missed a message ({reason})");
            }
            if let Some((topic, bytes)) = &first {
                self.ports.ledger.undelivered(topic, reason, *bytes);
            }
        }
        status.denied = self.ports.front.denied + self.ports.back.denied;
        status.cut = self.ports.settle();
    }

    /// Publishes the table of topics to those who asked for it.
    fn tell_traffic(&mut self) {
        if let Some(table) = self.traffic.message() {
            self.ports.front.publish(vec![TRAFFIC_TOPIC.into(), table.into()], None);
        }
    }

    /// Publishes the counts and shows them to [`super::Broker::status`]. At rest, with a thousand topics, that is most of
    /// what a broker does: so nothing is put into words that nobody hears, nor shown again unchanged.
    fn tell(&mut self, now: Instant) {
        if self.monitor.prune(now) || self.is_untold {
            let counts = self.monitor.listed().map(|(topic, count)| (topic.to_owned(), count));
            let counts = counts.collect();
            self.status.lock().subscriptions = counts;
        }
        if self.traffic.take_changed() {
            let TrafficTable { topics, unlisted } = self.traffic.table();
            let mut status = self.status.lock();
            (status.topics, status.unlisted) = (topics, unlisted);
        }
        self.tell_traffic();
        if let Some(topic) = self.monitor.own_topic.clone()
            && self.ports.front.is_heard(&topic)
            && let Some(json) = self.monitor.message()
        {
            self.ports.front.publish(vec![topic.into(), json.into()], None);
        }
        self.ports.front.flush();
    }

    /// Wait for what happens next, or for the time of the next counts.
    fn waits(&self) -> Wait {
        let tell_at =
            if self.is_untold { self.tell_at.min(self.repeat_at) } else { self.repeat_at };
        self.ports.waits(tell_at.saturating_duration_since(Instant::now()))
    }

    /// Handles what has happened at the two ports.
    fn handle(&mut self, [front, back]: [bool; 2]) {
        let mut now = Instant::now();
        if front {
            if let Err(error) = self.ports.front.turn(now) {
                tracing::error!(%error, "the ZeroMQ broker cannot wait for its listeners");
            }
            self.pass_subscriptions(now);
        }
        if back {
            // A turn of its own, whatever the listeners took.
            self.pass_messages(Instant::now());
            now = Instant::now();
        }
        if now >= self.repeat_at {
            self.ports.tick(now);
            self.pass_subscriptions(now);
        }
        if (self.is_untold && now >= self.tell_at) || now >= self.repeat_at {
            self.tell(now);
            self.is_untold = false;
            self.repeat_at = now + REPEAT;
            self.tell_at = Instant::now() + now.elapsed() * REST;
        }
        self.settle();
    }

    /// Passes on what has come, and what waits.
    fn close(&mut self) {
        let deadline = Instant::now() + options::LINGER;
        while self.pass_messages(Instant::now()) || self.ports.back.is_unread() {
            if Instant::now() >= deadline {
                break;
            }
        }
        self.ports.front.close(deadline);
        self.settle();
    }
}

/// The broker as its thread has it: unlocked while it waits.
pub(super) struct ProxyThread(pub(super) Arc<Mutex<Proxy>>);

impl Turns for ProxyThread {
    const NAME: &'static str = "the ZeroMQ broker";

    /// Waits for one event or for the time of the next counts.
    fn turn(&mut self, stop: &Stop) -> std::io::Result<bool> {
        let wait = self.0.lock().waits();
        let Some(happened) = wait.on(stop)? else { return Ok(false) };
        self.0.lock().handle(happened);
        Ok(true)
    }

    fn failed(&mut self, why: Option<String>) {
        self.0.lock().status.lock().failure = why;
    }

    fn end(self) {
        self.0.lock().close();
    }
}

impl Passes for Mutex<Proxy> {
    fn pass_on(&self, frames: Vec<Bytes>) {
        let mut proxy = self.lock();
        proxy.pass(frames);
        proxy.ports.front.flush();
        proxy.settle();
    }
}
