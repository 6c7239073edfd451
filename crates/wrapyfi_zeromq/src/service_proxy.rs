//! The thread of a [`ServiceBroker`](super::ServiceBroker): requests one way, replies the other.
//!
//! ```text
//!   clients ──▶ ROUTER (front) ── held while no server has room ──▶ DEALER (back) ──▶ servers, in turn
//!      ▲              ▲             │ too many: error to the client
//!      └──────────────┘◀── replies ─┴─ too old: dropped ───────────── DEALER
//! ```
//!
//! A request is read at once and held here, not in libzmq: so it can be counted, refused when too
//! many wait, and dropped when its caller has given up, as the mark of our clients tells, also where
//! it was that long on its way. What Python's clients ask is held until a server comes: they wait for ever.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use super::deadline;
use super::envelope::{self, Misfit, Parcel};
use super::service_broker::Tally;
use super::turns::{self, Turns};
use wrapyfi_endpoint::Share;

/// Messages passed on before the other side and the clock are looked at.
const BATCH: usize = 128;
/// Longest time that the last replies are waited for; a program has two seconds to end.
const FAREWELL: Duration = Duration::from_millis(1000);

pub(super) struct ServiceProxy {
    front: zmq::Socket,
    back: zmq::Socket,
    stop: zmq::Socket,
    /// Requests that no server has room for, the oldest first.
    held: VecDeque<Held>,
    pending: usize,
    /// Bytes of what is held.
    share: Share,
    tally: Arc<Tally>,
}

struct Held {
    parcel: Parcel,
    /// Time at which the caller gives up, where that is known.
    until: Option<Instant>,
}

impl ServiceProxy {
    pub(super) fn new(
        front: zmq::Socket,
        back: zmq::Socket,
        stop: zmq::Socket,
        pending: usize,
        tally: Arc<Tally>,
    ) -> Self {
        Self {
            front,
            back,
            stop,
            held: VecDeque::new(),
            pending: pending.max(1),
            share: Share::default(),
            tally,
        }
    }

    /// Runs until the stop socket is rung.
    pub(super) fn run(mut self) {
        turns::run(&mut self);
    }

    /// Passes on the replies that are on their way: a server that ends with its broker has just
    /// given its last one.
    fn last_replies(&self) -> zmq::Result<()> {
        let end = Instant::now() + FAREWELL;
        loop {
            self.pass_replies()?;
            let count = |counter: &AtomicU64| counter.load(Relaxed);
            let answered = count(&self.tally.replies) + count(&self.tally.unheard);
            let left = end.saturating_duration_since(Instant::now());
            if answered >= count(&self.tally.requests) || left.is_zero() {
                return Ok(());
            }
            let wait = i64::try_from(left.as_millis()).unwrap_or(0) + 1;
            zmq::poll(&mut [self.back.as_poll_item(zmq::POLLIN)], wait)?;
        }
    }

    /// Milliseconds until the next request is too old; for ever where none will be.
    fn patience(&self) -> i64 {
        let next = self.held.iter().filter_map(|held| held.until).min();
        next.map_or(-1, |until| {
            let left = until.saturating_duration_since(Instant::now());
            i64::try_from(left.as_millis()).unwrap_or(i64::MAX).saturating_add(1)
        })
    }

    fn take_requests(&mut self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some((parcel, _)) = envelope::receive(&self.front, usize::MAX)? else { break };
            let parcel = match parcel {
                Ok(parcel) => parcel,
                Err(misfit) => {
                    count(&self.tally.malformed);
                    if let Misfit::Frames(envelope, frames) = misfit {
                        let text = format!("a request is one frame, not {frames}");
                        self.answer(&Parcel::error(envelope, &text))?;
                    }
                    continue;
                }
            };
            let until = parcel.mark().and_then(|mark| deadline::of(&mark));
            if until.is_some_and(|until| until <= Instant::now()) {
                count(&self.tally.expired);
                continue;
            }
            // Straight through where nobody waits in front of it.
            if self.held.is_empty() && self.forward(&parcel)? {
                continue;
            }
            let bytes = parcel.size();
            let refusal = if self.held.len() >= self.pending {
                let limit = self.pending;
                Some(format!(
                    "{limit} requests wait for a server at this broker, which is the limit"
                ))
            } else if !self.share.take(bytes) {
                let what =
                    "requests that wait for a server hold this broker's share of waiting_mib";
                Some(format!("a request of {bytes} bytes finds no room: {what}"))
            } else {
                None
            };
            if let Some(why) = refusal {
                count(&self.tally.overloaded);
                let text = format!("{why}: start a server, or ask again later");
                self.answer(&Parcel::error(parcel.envelope, &text))?;
                continue;
            }
            self.held.push_back(Held { parcel, until });
        }
        Ok(())
    }

    fn pass_requests(&mut self) -> zmq::Result<()> {
        let now = Instant::now();
        let before = self.held.len();
        let share = &self.share;
        self.held.retain(|held| {
            let stays = held.until.is_none_or(|until| until > now);
            share.give(if stays { 0 } else { held.parcel.size() });
            stays
        });
        self.tally.expired.fetch_add((before - self.held.len()) as u64, Relaxed);
        while let Some(held) = self.held.front() {
            if !self.forward(&held.parcel)? {
                break;
            }
            self.share.give(held.parcel.size());
            self.held.pop_front();
        }
        self.tally.waiting.store(self.held.len() as u64, Relaxed);
        Ok(())
    }

    /// Gives a request to the server whose turn it is; false when none has room.
    fn forward(&self, parcel: &Parcel) -> zmq::Result<bool> {
        let sent = parcel.send(&self.back)?;
        if sent {
            count(&self.tally.requests);
            self.tally.bytes.fetch_add(parcel.size() as u64, Relaxed);
        }
        Ok(sent)
    }

    fn pass_replies(&self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some((reply, _)) = envelope::receive(&self.back, usize::MAX)? else { break };
            match reply {
                Ok(reply) if self.answer(&reply)? => {
                    count(&self.tally.replies);
                    self.tally.bytes.fetch_add(reply.size() as u64, Relaxed);
                }
                Ok(_) => count(&self.tally.unheard),
                Err(_) => count(&self.tally.malformed),
            }
        }
        Ok(())
    }

    /// Sends a reply to its client; false when that is gone, or does not read.
    fn answer(&self, reply: &Parcel) -> zmq::Result<bool> {
        match reply.send(&self.front) {
            Err(zmq::Error::EHOSTUNREACH) => Ok(false),
            other => other,
        }
    }
}

impl Turns for ServiceProxy {
    const NAME: &'static str = "the ZeroMQ broker of requests and replies";

    fn turn(&mut self) -> zmq::Result<bool> {
        let back = if self.held.is_empty() { zmq::POLLIN } else { zmq::POLLIN | zmq::POLLOUT };
        let mut items = [
            self.front.as_poll_item(zmq::POLLIN),
            self.back.as_poll_item(back),
            self.stop.as_poll_item(zmq::POLLIN),
        ];
        zmq::poll(&mut items, self.patience())?;
        let [front, back, stop] = items.map(|item| item.is_readable());
        if stop {
            self.last_replies()?;
            return Ok(false);
        }
        if back {
            self.pass_replies()?;
        }
        if front {
            self.take_requests()?;
        }
        self.pass_requests()?;
        Ok(true)
    }

    fn stop(&self) -> &zmq::Socket {
        &self.stop
    }

    fn failed(&self, why: Option<String>) {
        self.tally.failed(why);
    }
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Relaxed);
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::codec::requests::mark::{Content, Mark};
    use wrapyfi_endpoint::{Budget, Clock};

    /// A broker in this thread, and its client.
    fn broker(context: &zmq::Context) -> (ServiceProxy, zmq::Socket) {
        let bound = |kind, name: &str| {
            let socket = context.socket(kind).unwrap();
            socket.bind(name).unwrap();
            socket
        };
        let (front, back) =
            (bound(zmq::ROUTER, "inproc://front"), bound(zmq::DEALER, "inproc://back"));
        let stop = bound(zmq::PAIR, "inproc://stop");
        let client = context.socket(zmq::DEALER).unwrap();
        client.connect("inproc://front").unwrap();
        (ServiceProxy::new(front, back, stop, 10, Arc::default()), client)
    }

    #[test]
    fn a_request_that_was_too_long_on_its_way_reaches_no_server() {
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        let tally = Arc::clone(&proxy.tally);
        let server = context.socket(zmq::REP).unwrap();
        server.connect("inproc://back").unwrap();

        let minute = Duration::from_secs(60);
        let fresh =
            deadline::request(Content::NativeObject, 2, Instant::now() + minute, &Clock::default());
        // Its caller has given up, though its timeout is a minute.
        let late = Mark { number: 1, ends_ms: fresh.ends_ms - 61_000, ..fresh };
        for (mark, body) in [(late, "late"), (fresh, "fresh")] {
            client.send_multipart([&mark.encode(), "".as_bytes(), body.as_bytes()], 0).unwrap();
        }
        let seen = || tally.expired.load(Relaxed) + tally.requests.load(Relaxed);
        while seen() < 2 {
            assert!(proxy.turn().unwrap());
        }
        assert_eq!(server.recv_bytes(0).unwrap(), b"fresh");
        assert_eq!(tally.expired.load(Relaxed), 1);
    }

    #[test]
    fn requests_that_are_held_count_in_bytes() {
        static BUDGET: Budget = Budget::new(1000);
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        proxy.share = Share::of(&BUDGET);
        for size in [200, 100] {
            client.send_multipart([Vec::new(), vec![b'x'; size]], 0).unwrap();
        }
        while proxy.tally.overloaded.load(Relaxed) == 0 {
            assert!(proxy.turn().unwrap());
        }
        let told = client.recv_multipart(0).unwrap().concat();
        let told = String::from_utf8_lossy(&told);
        assert!(told.contains("finds no room") && told.contains("waiting_mib"), "{told}");
        assert!(BUDGET.used() >= 200);
        let server = context.socket(zmq::REP).unwrap();
        server.connect("inproc://back").unwrap();
        while proxy.tally.requests.load(Relaxed) == 0 {
            assert!(proxy.turn().unwrap());
        }
        assert_eq!((server.recv_bytes(0).unwrap().len(), BUDGET.used()), (200, 0));
    }
}
