//! The broker's thread: messages one way, subscriptions the other, counts every half second.
//!
//! ```text
//!   publishers ──▶ XSUB (back) ── messages ──────────▶ Front ──▶ listeners
//!   publishers ◀── XSUB ◀── first, last subscription ── Front ◀── listeners
//!                                  │                      ▲
//!                                  └─ Monitor ── counts ──┘
//! ```
//!
//! Frames are moved, not copied, where they are large. The monitor sees subscriptions only: messages, however many,
//! cannot delay the counts by more than one batch.
//!
//! A listener that reads more slowly than is published misses what exceeds its queue here, and nobody else is slowed
//! down. Each message that it misses is counted, here and where it was published in this process.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::broker::Shared;
use super::front::Front;
use super::ledger::Ledger;
use super::monitor::Monitor;
use super::options;
use super::peer::{Heard, Loss};
use super::traffic::{Look, TRAFFIC_TOPIC, Traffic};
use super::turns::{self, Turns};
use wrapyfi_endpoint::Throttle;

/// Time between repeats of the counts, for publishers that connect later than the listener.
const REPEAT: Duration = Duration::from_millis(500);
/// Messages passed on before the other side and the clock are looked at.
const BATCH: usize = 128;

const SUBSCRIBE: u8 = 1;
const UNSUBSCRIBE: u8 = 0;

pub(super) struct Proxy {
    pub(super) front: Front,
    pub(super) back: zmq::Socket,
    pub(super) stop: zmq::Socket,
    pub(super) monitor: Monitor,
    pub(super) traffic: Traffic,
    pub(super) shared: Arc<Shared>,
    pub(super) ledger: Arc<Ledger>,
    pub(super) slow: Throttle,
    /// Time at which the counts are sent again.
    pub(super) repeat_at: Instant,
}

impl Proxy {
    /// Runs until the stop socket is rung.
    pub(super) fn run(mut self) {
        turns::run(&mut self);
        self.end();
    }

    /// Passes on what has come, and what waits.
    fn end(&mut self) {
        let deadline = Instant::now() + options::LINGER;
        while let Ok(true) = self.pass_messages() {
            if Instant::now() >= deadline {
                break;
            }
        }
        self.front.close(deadline);
        self.settle();
    }

    fn pass_subscriptions(&mut self, now: Instant) -> zmq::Result<()> {
        for heard in self.front.heard() {
            let (word, topic) = match &heard {
                Heard::Subscribed(topic) => (SUBSCRIBE, topic),
                Heard::Unsubscribed(topic) => (UNSUBSCRIBE, topic),
                Heard::Ignored => {
                    self.shared.count_ignored();
                    continue;
                }
            };
            let pass_on = match word {
                SUBSCRIBE if topic == TRAFFIC_TOPIC.as_bytes() => {
                    self.traffic.watched();
                    self.tell_traffic();
                    false
                }
                _ if topic == TRAFFIC_TOPIC.as_bytes() => {
                    self.traffic.unwatched();
                    false
                }
                SUBSCRIBE => self.monitor.subscribed(topic, now),
                _ => self.monitor.unsubscribed(topic, now),
            };
            if pass_on {
                self.back.send([&[word][..], &topic[..]].concat(), 0)?;
            }
        }
        Ok(())
    }

    /// Passes on what has come, one batch at most; true when there may be more.
    fn pass_messages(&mut self) -> zmq::Result<bool> {
        let mut more = true;
        for _ in 0..BATCH {
            let Some(first) = receive(&self.back)? else {
                more = false;
                break;
            };
            let forged =
                self.monitor.is_forged(&first) || first.starts_with(TRAFFIC_TOPIC.as_bytes());
            let (mut count, mut bytes) = (1, first.len());
            let mut frames = vec![first];
            while frames.last().is_some_and(zmq::Message::get_more) {
                // Frames of one message arrive together: this does not wait.
                let frame = self.back.recv_msg(0)?;
                bytes += frame.len();
                count += 1;
                match forged {
                    true => frames = vec![frame],
                    false => frames.push(frame),
                }
            }
            if forged {
                self.shared.count_forged();
                continue;
            }
            if let [topic, .., last] = &frames[..] {
                self.traffic.count(topic, bytes, Look::guess(count, last));
            } else if let [topic] = &frames[..] {
                self.traffic.count(topic, bytes, None);
            }
            self.front.publish(frames, Some(bytes));
            // Before it is counted: who sees a message in the counts sees its losses too.
            self.settle();
            self.shared.count_message(bytes);
        }
        self.front.flush();
        Ok(more)
    }

    /// Counts what listeners missed.
    fn settle(&mut self) {
        for Loss { reason, listener, first } in self.front.losses() {
            self.shared.count_missed(reason);
            let topic = first.as_ref().map(|(topic, _)| String::from_utf8_lossy(topic));
            if let Some(unlogged_before) = self.slow.pass(Instant::now()) {
                let topic = topic.as_deref().unwrap_or_default();
                tracing::warn!(%listener, topic, unlogged_before, "a listener missed a message ({reason})");
            }
            if let Some((topic, bytes)) = &first {
                self.ledger.undelivered(topic, reason, *bytes);
            }
        }
    }

    /// Publishes the table of topics to those who asked for it.
    fn tell_traffic(&mut self) {
        if let Some(table) = self.traffic.message() {
            self.front.publish(vec![TRAFFIC_TOPIC.into(), table.into()], None);
        }
    }

    /// Publishes the counts and shows them to [`super::Broker::status`].
    fn tell(&mut self, now: Instant) {
        let message = self.monitor.message(now);
        self.shared.set_subscriptions(self.monitor.listed());
        self.shared.set_traffic(self.traffic.told());
        self.tell_traffic();
        if let (Some(json), Some(topic)) = (message, self.monitor.own_topic()) {
            self.front.publish(vec![topic.into(), json.into_bytes().into()], None);
        }
        self.front.flush();
    }
}

impl Turns for Proxy {
    const NAME: &'static str = "the ZeroMQ broker";

    /// Waits for one event or for the time of the next counts.
    fn turn(&mut self) -> zmq::Result<bool> {
        let wait = match self.front.is_unread() {
            true => 0,
            false => self.repeat_at.saturating_duration_since(Instant::now()).as_millis() + 1,
        };
        let mut items = [
            zmq::PollItem::from_fd(self.front.fd(), zmq::POLLIN),
            self.back.as_poll_item(zmq::POLLIN),
            self.stop.as_poll_item(zmq::POLLIN),
        ];
        zmq::poll(&mut items, i64::try_from(wait).unwrap_or(1))?;
        let [front, back, stop] = items.map(|item| item.is_readable());
        if stop {
            return Ok(false);
        }
        let mut now = Instant::now();
        if front || self.front.is_unread() {
            if let Err(error) = self.front.turn(now) {
                tracing::error!(%error, "the ZeroMQ broker cannot wait for its listeners");
            }
            self.pass_subscriptions(now)?;
        }
        if back {
            self.pass_messages()?;
            now = Instant::now();
        }
        if now >= self.repeat_at {
            self.front.tick(now);
            self.pass_subscriptions(now)?;
        }
        if self.monitor.take_changed() || now >= self.repeat_at {
            self.tell(now);
            self.repeat_at = now + REPEAT;
        }
        self.settle();
        Ok(true)
    }

    fn stop(&self) -> &zmq::Socket {
        &self.stop
    }

    fn failed(&self, why: Option<String>) {
        self.shared.failed(why);
    }
}

/// The next frame, if one waits.
fn receive(socket: &zmq::Socket) -> zmq::Result<Option<zmq::Message>> {
    match socket.recv_msg(zmq::DONTWAIT) {
        Ok(frame) => Ok(Some(frame)),
        Err(zmq::Error::EAGAIN) => Ok(None),
        Err(error) => Err(error),
    }
}
