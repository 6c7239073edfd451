//! The thread of a [`ServiceBroker`](super::ServiceBroker): requests one way, replies the other.
//!
//! ```text
//!   clients ──▶ ROUTER (front) ── held while no server has room ──▶ DEALER (back) ──▶ servers, in turn
//!      ▲              ▲             │ too many: error to the client
//!      └── not read ──┘◀── replies ─┴─ too old: dropped ───────────── DEALER
//! ```
//!
//! A request is read at once and held here, not in libzmq: so it can be counted, refused when too
//! many wait, and dropped when its caller has given up, as the mark of our clients tells, also where
//! it was that long on its way. What Python's clients ask is held until a server comes: they wait for ever.
//! Replies that a client does not read wait here as well, where their bytes count; libzmq has two of them.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::deadline;
use super::envelope::{self, Misfit, ServiceMessage};
use super::service_broker::ServiceBrokerStatus;
use super::turns::Turns;
use wrapyfi_endpoint::{Mutex, PROGRESS, Share};

/// Messages passed on before the other side and the clock are looked at.
const BATCH: usize = 128;
/// Longest time that the last replies are waited for; a program has two seconds to end.
const FAREWELL: Duration = Duration::from_millis(1000);

/// Milliseconds between two tries to send to a client that does not read.
const RETRY_MS: i64 = 5;

pub(super) struct ServiceProxy {
    front: zmq::Socket,
    back: zmq::Socket,
    stop: zmq::Socket,
    /// Requests that no server has room for, the oldest first.
    held: VecDeque<Held>,
    pending: usize,
    /// Bytes of what is held.
    share: Share,
    /// Replies by client, where one does not read.
    unread: BTreeMap<Bytes, Unread>,
    tally: ServiceBrokerStatus,
    /// The same, as others see it.
    shown: Arc<Mutex<ServiceBrokerStatus>>,
}

/// Replies that wait until their client reads.
struct Unread {
    /// Replies, each with the number that it counts for: an error of the broker itself is none.
    replies: VecDeque<(ServiceMessage, u64)>,
    share: Share,
    /// Instant at which the client last read one, or should have read the first.
    moved_at: Instant,
}

/// Outcome of sending to a client.
#[derive(PartialEq)]
enum Sent {
    Yes,
    NoRoom,
    Gone,
}

struct Held {
    message: ServiceMessage,
    /// Time at which the caller gives up, where that is known.
    until: Option<Instant>,
}

impl ServiceProxy {
    pub(super) fn new(
        front: zmq::Socket,
        back: zmq::Socket,
        stop: zmq::Socket,
        pending: usize,
        shown: Arc<Mutex<ServiceBrokerStatus>>,
    ) -> Self {
        Self {
            front,
            back,
            stop,
            held: VecDeque::new(),
            pending: pending.max(1),
            share: Share::default(),
            unread: BTreeMap::new(),
            tally: ServiceBrokerStatus::default(),
            shown,
        }
    }

    /// Passes on the replies that are on their way: a server that ends with its broker has just
    /// given its last one.
    fn last_replies(&mut self) -> zmq::Result<()> {
        let end = Instant::now() + FAREWELL;
        loop {
            self.pass_replies()?;
            self.pass_unread();
            let answered = self.tally.replies + self.tally.unheard;
            let left = end.saturating_duration_since(Instant::now());
            if answered >= self.tally.requests || left.is_zero() {
                return Ok(());
            }
            let wait = i64::try_from(left.as_millis()).unwrap_or(0) + 1;
            zmq::poll(&mut [self.back.as_poll_item(zmq::POLLIN)], wait)?;
        }
    }

    fn show(&self) {
        self.shown.lock().clone_from(&self.tally);
    }

    /// Milliseconds until the next request is too old or a reply is tried again; for ever where there is none.
    fn wait_ms(&self) -> i64 {
        let next = self.held.iter().filter_map(|held| held.until).min();
        let left = next.map(|until| {
            let left = until.saturating_duration_since(Instant::now());
            i64::try_from(left.as_millis()).unwrap_or(i64::MAX).saturating_add(1)
        });
        let retry = (!self.unread.is_empty()).then_some(RETRY_MS);
        left.into_iter().chain(retry).min().unwrap_or(-1)
    }

    fn take_requests(&mut self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some((message, _)) = envelope::receive(&self.front, usize::MAX)? else { break };
            let message = match message {
                Ok(message) => message,
                Err(misfit) => {
                    self.tally.malformed += 1;
                    if let Misfit::Frames(envelope, frames) = misfit {
                        let text = format!("a request is one frame, not {frames}");
                        self.answer(ServiceMessage::error(envelope, &text), 0);
                    }
                    continue;
                }
            };
            let until = message.mark().and_then(|mark| deadline::of(&mark));
            if until.is_some_and(|until| until <= Instant::now()) {
                self.tally.expired += 1;
                continue;
            }
            // Straight through where nobody waits in front of it.
            if self.held.is_empty() && forward(&message, &self.back, &mut self.tally)? {
                continue;
            }
            let bytes = message.size();
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
                self.tally.overloaded += 1;
                let text = format!("{why}: start a server, or ask again later");
                self.answer(ServiceMessage::error(message.envelope, &text), 0);
                continue;
            }
            self.held.push_back(Held { message, until });
        }
        Ok(())
    }

    fn pass_requests(&mut self) -> zmq::Result<()> {
        let now = Instant::now();
        let before = self.held.len();
        let share = &self.share;
        self.held.retain(|held| {
            let stays = held.until.is_none_or(|until| until > now);
            share.give(if stays { 0 } else { held.message.size() });
            stays
        });
        self.tally.expired += (before - self.held.len()) as u64;
        while let Some(held) = self.held.front() {
            if !forward(&held.message, &self.back, &mut self.tally)? {
                break;
            }
            self.share.give(held.message.size());
            self.held.pop_front();
        }
        self.tally.waiting = self.held.len() as u64;
        Ok(())
    }

    fn pass_replies(&mut self) -> zmq::Result<()> {
        for _ in 0..BATCH {
            let Some((reply, _)) = envelope::receive(&self.back, usize::MAX)? else { break };
            match reply {
                Ok(reply) => self.answer(reply, 1),
                Err(_) => self.tally.malformed += 1,
            }
        }
        Ok(())
    }

    /// Sends a reply to its client, or has it wait there until the client reads. One that is gone, or has no room
    /// left, does not hear it.
    fn answer(&mut self, reply: ServiceMessage, replies: u64) {
        let Some(client) = reply.envelope.first().cloned() else { return };
        let sent = match self.unread.contains_key(&client) {
            true => Sent::NoRoom,
            false => self.send(&reply, replies),
        };
        if sent == Sent::NoRoom {
            let unread = self.unread.entry(client).or_insert_with(|| Unread {
                replies: VecDeque::new(),
                share: self.share.beside(),
                moved_at: Instant::now(),
            });
            if unread.replies.len() < self.pending && unread.share.take(reply.size()) {
                unread.replies.push_back((reply, replies));
                return;
            }
        }
        if sent != Sent::Yes {
            self.tally.unheard += replies;
        }
    }

    /// Sends what waits to clients that read again; what one does not read for long is dropped.
    fn pass_unread(&mut self) {
        let now = Instant::now();
        for (client, mut unread) in std::mem::take(&mut self.unread) {
            let mut sent = Sent::Yes;
            while let Some((reply, replies)) = unread.replies.front() {
                sent = self.send(reply, *replies);
                if sent != Sent::Yes {
                    break;
                }
                unread.share.give(reply.size());
                unread.replies.pop_front();
                unread.moved_at = now;
            }
            let late = now.saturating_duration_since(unread.moved_at) >= PROGRESS;
            if sent == Sent::NoRoom && !late {
                self.unread.insert(client, unread);
            } else {
                self.tally.unheard +=
                    unread.replies.iter().map(|(_, replies)| replies).sum::<u64>();
            }
        }
    }

    fn send(&mut self, reply: &ServiceMessage, replies: u64) -> Sent {
        match reply.send(&self.front) {
            Ok(true) => {
                self.tally.replies += replies;
                self.tally.bytes += reply.size() as u64 * replies;
                Sent::Yes
            }
            Ok(false) => Sent::NoRoom,
            Err(error) => {
                tracing::debug!(%error, "a client is gone");
                Sent::Gone
            }
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
        zmq::poll(&mut items, self.wait_ms())?;
        let [front, back, stop] = items.map(|item| item.is_readable());
        if stop {
            self.last_replies()?;
            self.show();
            return Ok(false);
        }
        self.pass_unread();
        if back {
            self.pass_replies()?;
        }
        if front {
            self.take_requests()?;
        }
        self.pass_requests()?;
        self.show();
        Ok(true)
    }

    fn stop(&self) -> &zmq::Socket {
        &self.stop
    }

    fn failed(&mut self, why: Option<String>) {
        self.tally.failure = why;
        self.show();
    }
}

/// Gives a request to the server whose turn it is; false when none has room.
fn forward(
    message: &ServiceMessage,
    back: &zmq::Socket,
    tally: &mut ServiceBrokerStatus,
) -> zmq::Result<bool> {
    let sent = message.send(back)?;
    if sent {
        tally.requests += 1;
        tally.bytes += message.size() as u64;
    }
    Ok(sent)
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
        let front = context.socket(zmq::ROUTER).unwrap();
        front.set_router_mandatory(true).unwrap();
        front.set_sndhwm(1).unwrap();
        front.bind("inproc://front").unwrap();
        let back = bound(zmq::DEALER, "inproc://back");
        let stop = bound(zmq::PAIR, "inproc://stop");
        let client = context.socket(zmq::DEALER).unwrap();
        // What both ends hold counts as one inside a process.
        client.set_rcvhwm(1).unwrap();
        client.connect("inproc://front").unwrap();
        (ServiceProxy::new(front, back, stop, 10, Arc::default()), client)
    }

    #[test]
    fn a_request_that_was_too_long_on_its_way_reaches_no_server() {
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
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
        while proxy.tally.expired + proxy.tally.requests < 2 {
            assert!(proxy.turn().unwrap());
        }
        assert_eq!(server.recv_bytes(0).unwrap(), b"fresh");
        assert_eq!(proxy.tally.expired, 1);
    }

    #[test]
    fn replies_that_a_client_does_not_read_are_bounded_in_bytes() {
        static BUDGET: Budget = Budget::new(1000);
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        proxy.share = Share::of(&BUDGET);
        let server = context.socket(zmq::DEALER).unwrap();
        server.connect("inproc://back").unwrap();
        for _ in 0..10 {
            client.send_multipart([&b""[..], b"?"], 0).unwrap();
            while server.get_events().unwrap() & zmq::POLLIN == zmq::PollEvents::empty() {
                assert!(proxy.turn().unwrap());
            }
            let mut reply = server.recv_multipart(0).unwrap();
            *reply.last_mut().unwrap() = vec![b'x'; 100];
            server.send_multipart(reply, 0).unwrap();
        }
        let seen = |tally: &ServiceBrokerStatus| tally.unheard + tally.replies;
        let waits = |proxy: &ServiceProxy| {
            proxy.unread.values().map(|unread| unread.replies.len() as u64).sum::<u64>()
        };
        while seen(&proxy.tally) + waits(&proxy) < 10 {
            assert!(proxy.turn().unwrap());
        }
        // Two are with libzmq, two with the broker: a third would be more than a quarter of what may wait.
        assert_eq!((waits(&proxy), proxy.tally.unheard), (2, 6));
        assert!(BUDGET.used() <= 250, "{}", BUDGET.used());
        for _ in 0..4 {
            while client.get_events().unwrap() & zmq::POLLIN == zmq::PollEvents::empty() {
                assert!(proxy.turn().unwrap());
            }
            assert_eq!(client.recv_multipart(0).unwrap()[1].len(), 100);
        }
        assert_eq!((seen(&proxy.tally), BUDGET.used()), (10, 0));
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
        while proxy.tally.overloaded == 0 {
            assert!(proxy.turn().unwrap());
        }
        let told = client.recv_multipart(0).unwrap().concat();
        let told = String::from_utf8_lossy(&told);
        assert!(told.contains("finds no room") && told.contains("waiting_mib"), "{told}");
        assert!(BUDGET.used() >= 200);
        let server = context.socket(zmq::REP).unwrap();
        server.connect("inproc://back").unwrap();
        while proxy.tally.requests == 0 {
            assert!(proxy.turn().unwrap());
        }
        assert_eq!((server.recv_bytes(0).unwrap().len(), BUDGET.used()), (200, 0));
    }
}
