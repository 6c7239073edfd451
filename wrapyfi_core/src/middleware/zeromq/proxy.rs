//! The broker's thread: messages one way, subscriptions the other, counts every half second.
//!
//! ```text
//!   publishers ──▶ XSUB (back) ── messages ──────────▶ XPUB (front) ──▶ listeners
//!   publishers ◀── XSUB ◀── first, last subscription ── XPUB ◀────────── listeners
//!                                  │                      ▲
//!                                  └─ Monitor ── counts ──┘
//! ```
//!
//! Frames are moved, and only the first of a message is copied. The monitor sees subscriptions
//! only: messages, however many, cannot delay the counts by more than one batch.
//!
//! A listener that reads slower than is published misses what exceeds its queue of `hwm` messages
//! here, and nobody else is slowed down. That its queue is full shows once, at the first message
//! it misses: libzmq then leaves it out without a word until it has read half of the queue. So
//! these moments are counted and warned about, not the messages.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::broker::Shared;
use super::monitor::Monitor;
use super::sockopt;
use super::traffic::{Look, TRAFFIC_TOPIC, Traffic};

/// How often counts are repeated, for publishers that connect later than the listener.
const REPEAT: Duration = Duration::from_millis(500);
/// Messages passed on before the other side and the clock are looked at.
const BATCH: usize = 128;

/// Shortest time between two warnings about slow listeners.
const WARN_PAUSE: Duration = Duration::from_secs(10);

const SUBSCRIBE: u8 = 1;
const UNSUBSCRIBE: u8 = 0;

pub(super) struct Proxy {
    pub(super) front: zmq::Socket,
    pub(super) back: zmq::Socket,
    pub(super) stop: zmq::Socket,
    pub(super) monitor: Monitor,
    pub(super) traffic: Traffic,
    pub(super) shared: Arc<Shared>,
    /// When the next warning about slow listeners may come.
    pub(super) warn_at: Instant,
}

impl Proxy {
    /// Runs until the stop socket is rung.
    pub(super) fn run(mut self) {
        let mut repeat_at = Instant::now() + REPEAT;
        loop {
            match self.turn(repeat_at) {
                Ok(true) => {}
                Ok(false) | Err(zmq::Error::ETERM) => break,
                Err(zmq::Error::EINTR | zmq::Error::EAGAIN) => continue,
                Err(error) => {
                    tracing::error!(%error, "the ZeroMQ broker stopped");
                    self.shared.failed(error);
                    break;
                }
            }
            let now = Instant::now();
            if self.monitor.take_changed() || now >= repeat_at {
                self.tell(now);
                repeat_at = now + REPEAT;
            }
        }
    }

    /// Waits for one event or `until`, and handles it; false when it is time to stop.
    fn turn(&mut self, until: Instant) -> zmq::Result<bool> {
        let wait = until.saturating_duration_since(Instant::now()).as_millis() + 1;
        let mut items = [
            self.front.as_poll_item(zmq::POLLIN),
            self.back.as_poll_item(zmq::POLLIN),
            self.stop.as_poll_item(zmq::POLLIN),
        ];
        zmq::poll(&mut items, i64::try_from(wait).unwrap_or(1))?;
        let [front, back, stop] = items.map(|item| item.is_readable());
        if stop {
            return Ok(false);
        }
        if front {
            self.pass_subscriptions()?;
        }
        if back {
            self.pass_messages()?;
        }
        Ok(true)
    }

    fn pass_subscriptions(&mut self) -> zmq::Result<()> {
        let now = Instant::now();
        for _ in 0..BATCH {
            let Some(frame) = receive(&self.front)? else { break };
            if frame.get_more() {
                // Listeners have nothing to say but subscriptions.
                while self.front.recv_msg(0)?.get_more() {}
                self.shared.count_ignored();
                continue;
            }
            let pass_on = match frame.split_first() {
                Some((&SUBSCRIBE, topic)) if topic == TRAFFIC_TOPIC.as_bytes() => {
                    self.traffic.watched();
                    self.tell_traffic();
                    false
                }
                Some((&UNSUBSCRIBE, topic)) if topic == TRAFFIC_TOPIC.as_bytes() => {
                    self.traffic.unwatched();
                    false
                }
                Some((&SUBSCRIBE, topic)) => self.monitor.subscribed(topic, now),
                Some((&UNSUBSCRIBE, topic)) => self.monitor.unsubscribed(topic, now),
                _ => {
                    self.shared.count_ignored();
                    false
                }
            };
            if pass_on {
                self.back.send(frame, 0)?;
            }
        }
        Ok(())
    }

    fn pass_messages(&mut self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some(first) = receive(&self.back)? else { break };
            let forged =
                self.monitor.is_forged(&first) || first.starts_with(TRAFFIC_TOPIC.as_bytes());
            let (mut frames, mut look) = (1, None);
            let mut bytes = first.len();
            let mut more = first.get_more();
            if !forged {
                self.begin(&first, more_flag(more))?;
            }
            while more {
                let frame = self.back.recv_msg(0)?;
                bytes += frame.len();
                frames += 1;
                more = frame.get_more();
                if !more {
                    look = Look::guess(frames, &frame);
                }
                if !forged {
                    self.front.send(frame, more_flag(more) | zmq::DONTWAIT)?;
                }
            }
            if forged {
                self.shared.count_forged();
            } else {
                self.shared.count_message(bytes);
                self.traffic.count(&first, bytes, look);
            }
        }
        Ok(())
    }

    /// Sends the first frame of a message, which decides who receives it: all that are subscribed
    /// and have room.
    fn begin(&mut self, first: &[u8], flag: i32) -> zmq::Result<()> {
        match self.front.send(first, flag | zmq::DONTWAIT) {
            Err(zmq::Error::EAGAIN) => {}
            other => return other,
        }
        self.shared.count_overflow();
        let now = Instant::now();
        if now >= self.warn_at {
            self.warn_at = now + WARN_PAUSE;
            let topic = String::from_utf8_lossy(first);
            tracing::warn!(%topic, "a listener is slower than its topic and misses messages");
        }
        sockopt::set_xpub_nodrop(&mut self.front, false)?;
        let sent = self.front.send(first, flag | zmq::DONTWAIT);
        sockopt::set_xpub_nodrop(&mut self.front, true)?;
        sent
    }

    /// Publishes the table of topics to those who asked for it.
    fn tell_traffic(&mut self) {
        let Some(table) = self.traffic.message() else { return };
        let sent = self
            .begin(TRAFFIC_TOPIC.as_bytes(), zmq::SNDMORE)
            .and_then(|()| self.front.send(table, zmq::DONTWAIT));
        if let Err(error) = sent {
            tracing::warn!(%error, "the ZeroMQ broker could not publish its table of topics");
        }
    }

    /// Publishes the counts and shows them to [`super::Broker::status`].
    fn tell(&mut self, now: Instant) {
        let message = self.monitor.message(now);
        self.shared.set_subscriptions(self.monitor.listed());
        self.shared.set_traffic(self.traffic.told());
        self.tell_traffic();
        let Some(json) = message else { return };
        let Some(topic) = self.monitor.own_topic().map(<[u8]>::to_vec) else { return };
        let sent = self
            .begin(&topic, zmq::SNDMORE)
            .and_then(|()| self.front.send(json.as_bytes(), zmq::DONTWAIT));
        if let Err(error) = sent {
            tracing::warn!(%error, "the ZeroMQ broker could not publish its counts");
        }
    }
}

fn more_flag(more: bool) -> i32 {
    if more { zmq::SNDMORE } else { 0 }
}

/// The next frame, if one waits.
fn receive(socket: &zmq::Socket) -> zmq::Result<Option<zmq::Message>> {
    match socket.recv_msg(zmq::DONTWAIT) {
        Ok(frame) => Ok(Some(frame)),
        Err(zmq::Error::EAGAIN) => Ok(None),
        Err(error) => Err(error),
    }
}
