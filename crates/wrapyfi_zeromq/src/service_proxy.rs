//! The thread of a [`ServiceBroker`](super::ServiceBroker): requests one way, replies the other.
//!
//! ```text
//!   clients ──▶ ROUTER (front) ── held while no server has room ──▶ DEALER (back) ──▶ servers, in turn
//!      ▲              ▲             │ too many: error to the client
//!      └── not read ──┘◀── replies ─┴─ too old: dropped ───────────── DEALER
//! ```
//!
//! A request is read at once and held here: so it can be counted, refused when too
//! many wait, and dropped when its caller has given up, as the mark of our clients tells, also where
//! it was that long on its way. Requests of Python's clients are held until a server comes: they wait for ever.
//! Replies that a client does not read wait here as well, where their bytes count; its connection has two of them.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::broker_ports::BrokerPorts;
use super::deadline;
use super::envelope::{self, ServiceMessage};
use super::front::Front;
use super::options;
use super::status::ServiceBrokerStatus;
use super::turns::Turns;
use wrapyfi_endpoint::{Mutex, PROGRESS, Share};

/// Longest time that the last replies are waited for; a program has two seconds to end.
const FAREWELL: Duration = Duration::from_millis(1000);

/// Milliseconds between two tries to send to a client that does not read.
const RETRY_MS: i64 = 5;
/// Time between two looks at peers that may be dead.
const TICK: Duration = Duration::from_millis(500);

pub(super) struct ServiceProxy {
    ports: BrokerPorts,
    tick_at: Instant,
    /// Requests that no server has room for, the oldest first.
    held: VecDeque<Held>,
    pending: usize,
    /// Bytes of what is held.
    share: Share,
    /// Replies by client, where one does not read.
    unread: BTreeMap<Bytes, Unread>,
    tally: ServiceBrokerStatus,
    /// The same, as others see it.
    status: Arc<Mutex<ServiceBrokerStatus>>,
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
        ports: BrokerPorts,
        pending: usize,
        status: Arc<Mutex<ServiceBrokerStatus>>,
    ) -> Self {
        Self {
            ports,
            tick_at: Instant::now(),
            held: VecDeque::new(),
            pending: pending.max(1),
            share: Share::default(),
            unread: BTreeMap::new(),
            tally: ServiceBrokerStatus::default(),
            status,
        }
    }

    /// Passes on the replies that are on their way: a server that ends with its broker has just
    /// given its last one.
    fn last_replies(&mut self) -> zmq::Result<()> {
        let end = Instant::now() + FAREWELL;
        loop {
            self.pass_replies();
            // Clients that read again have room.
            if let Err(error) = self.ports.front.turn(Instant::now()) {
                tracing::error!(%error, "the ZeroMQ broker cannot wait for its clients");
            }
            self.pass_unread();
            let answered = self.tally.replies + self.tally.unheard;
            let left = end.saturating_duration_since(Instant::now());
            if answered >= self.tally.requests || left.is_zero() {
                return Ok(());
            }
            let wait = options::poll_ms(left).min(RETRY_MS);
            let wait = if self.ports.back.is_unread() { 0 } else { wait };
            zmq::poll(&mut [zmq::PollItem::from_fd(self.ports.back.fd(), zmq::POLLIN)], wait)?;
        }
    }

    fn show(&mut self) {
        self.tally.cut = self.ports.settle();
        *self.ports.ledger.servers.lock() = Some(self.ports.back.connected());
        self.status.lock().clone_from(&self.tally);
    }

    /// Milliseconds until the next request is too old, a reply is tried again, or peers are looked at.
    fn wait_ms(&self) -> i64 {
        let next = self.held.iter().filter_map(|held| held.until).fold(self.tick_at, Instant::min);
        let left = options::poll_ms(next.saturating_duration_since(Instant::now()));
        if self.unread.is_empty() { left } else { left.min(RETRY_MS) }
    }

    fn take_requests(&mut self, now: Instant) {
        if let Err(error) = self.ports.front.turn(now) {
            tracing::error!(%error, "the ZeroMQ broker cannot wait for its clients");
        }
        self.tally.malformed += self.ports.front.heard.drain(..).len() as u64;
        for (client, mut frames) in std::mem::take(&mut self.ports.front.messages) {
            frames.insert(0, Bytes::copy_from_slice(&client.to_be_bytes()));
            let count = frames.len();
            let message = match envelope::split(frames, count) {
                Some((envelope, Ok(body))) => ServiceMessage { envelope, body },
                misfit => {
                    self.tally.malformed += 1;
                    if let Some((envelope, Err(frames))) = misfit {
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
            if self.held.is_empty() && forward(&message, &mut self.ports.back, &mut self.tally) {
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
    }

    fn pass_requests(&mut self) {
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
            if !forward(&held.message, &mut self.ports.back, &mut self.tally) {
                break;
            }
            self.share.give(held.message.size());
            self.held.pop_front();
        }
        self.tally.waiting = self.held.len() as u64;
    }

    fn pass_replies(&mut self) {
        if let Err(error) = self.ports.back.turn(Instant::now()) {
            tracing::error!(%error, "the ZeroMQ broker cannot wait for its servers");
        }
        self.tally.malformed += self.ports.back.heard.drain(..).len() as u64;
        for (_, frames) in std::mem::take(&mut self.ports.back.messages) {
            let count = frames.len();
            match envelope::split(frames, count) {
                Some((envelope, Ok(body))) => self.answer(ServiceMessage { envelope, body }, 1),
                _ => self.tally.malformed += 1,
            }
        }
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
        let client = reply.envelope.first().and_then(|client| client.first_chunk::<8>());
        let client = client.and_then(|client| usize::try_from(u64::from_be_bytes(*client)).ok());
        match client.and_then(|client| self.ports.front.send(client, reply.frames(1), reply.size()))
        {
            Some(true) => {
                self.tally.replies += replies;
                self.tally.bytes += reply.size() as u64 * replies;
                Sent::Yes
            }
            Some(false) => Sent::NoRoom,
            None => Sent::Gone,
        }
    }
}

impl Turns for ServiceProxy {
    const NAME: &'static str = "the ZeroMQ broker of requests and replies";

    fn turn(&mut self) -> zmq::Result<bool> {
        let Some([front, back]) = self.ports.wait(self.wait_ms())? else {
            self.last_replies()?;
            self.show();
            return Ok(false);
        };
        self.pass_unread();
        if back {
            self.pass_replies();
        }
        let now = Instant::now();
        if front {
            self.take_requests(now);
        }
        if now >= self.tick_at {
            self.ports.tick(now);
            self.tick_at = now + TICK;
        }
        self.pass_requests();
        self.show();
        Ok(true)
    }

    fn stop(&self) -> &zmq::Socket {
        &self.ports.stop
    }

    fn failed(&mut self, why: Option<String>) {
        self.tally.failure = why;
        self.show();
    }

    fn end(mut self) {
        let deadline = Instant::now() + options::LINGER;
        *self.ports.ledger.servers.lock() = None;
        self.ports.front.close(deadline);
        self.ports.back.close(deadline);
    }
}

/// Gives a request to the server whose turn it is; false when none has room.
fn forward(message: &ServiceMessage, back: &mut Front, tally: &mut ServiceBrokerStatus) -> bool {
    let sent = back.send_in_turn(message.frames(0), message.size());
    if sent {
        tally.requests += 1;
        tally.bytes += message.size() as u64;
    }
    sent
}

#[cfg(test)]
mod tests {
    use super::super::front::Bounds;
    use super::super::zmtp::Kind;
    use super::*;
    use wrapyfi_endpoint::codec::requests::mark::{Content, Mark};
    use wrapyfi_endpoint::{Budget, Clock};

    /// A broker in this thread, and its client.
    fn broker(context: &zmq::Context) -> (ServiceProxy, zmq::Socket) {
        let bounds = Bounds { hwm: 2, message_bytes: 16 << 20, connections: 8 };
        let ip = std::net::Ipv4Addr::LOCALHOST.into();
        let bound = |kind| Front::bind(kind, ip, 0, bounds, None).unwrap();
        let (front, back) = (bound(Kind::Router), bound(Kind::Dealer));
        let stop = context.socket(zmq::PAIR).unwrap();
        stop.bind("inproc://stop").unwrap();
        let client = context.socket(zmq::DEALER).unwrap();
        client.set_rcvhwm(1).unwrap();
        client.connect(&format!("tcp://127.0.0.1:{}", front.port().unwrap())).unwrap();
        let ports = BrokerPorts { front, back, stop, ledger: Arc::default() };
        (ServiceProxy::new(ports, 10, Arc::default()), client)
    }

    fn server(context: &zmq::Context, proxy: &ServiceProxy, kind: zmq::SocketType) -> zmq::Socket {
        let server = context.socket(kind).unwrap();
        server.set_linger(0).unwrap();
        let port = proxy.ports.back.port().unwrap();
        server.connect(&format!("tcp://127.0.0.1:{port}")).unwrap();
        server
    }

    fn is_readable(socket: &zmq::Socket) -> bool {
        socket.get_events().unwrap() & zmq::POLLIN != zmq::PollEvents::empty()
    }

    #[test]
    fn a_request_that_was_too_long_on_its_way_reaches_no_server() {
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        let server = server(&context, &proxy, zmq::REP);

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
        // More than the system holds of a connection.
        const REPLY: usize = 8 << 20;
        static BUDGET: Budget = Budget::new(10 * REPLY);
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        proxy.share = Share::of(&BUDGET);
        let server = server(&context, &proxy, zmq::DEALER);
        for _ in 0..10 {
            client.send_multipart([&b""[..], b"?"], 0).unwrap();
            while !is_readable(&server) {
                assert!(proxy.turn().unwrap());
            }
            let mut reply = server.recv_multipart(0).unwrap();
            *reply.last_mut().unwrap() = vec![b'x'; REPLY];
            server.send_multipart(reply, 0).unwrap();
        }
        let seen = |tally: &ServiceBrokerStatus| tally.unheard + tally.replies;
        let waits = |proxy: &ServiceProxy| {
            proxy.unread.values().map(|unread| unread.replies.len() as u64).sum::<u64>()
        };
        while seen(&proxy.tally) + waits(&proxy) < 10 {
            assert!(proxy.turn().unwrap());
        }
        // Some are with the connection, two with the broker: a third would be more than a quarter of what may wait.
        assert_eq!(waits(&proxy), 2);
        assert!(proxy.tally.unheard > 0 && BUDGET.used() <= 5 * REPLY / 2, "{}", BUDGET.used());
        while seen(&proxy.tally) < 10 {
            assert!(proxy.turn().unwrap());
            if is_readable(&client) {
                assert_eq!(client.recv_multipart(0).unwrap()[1].len(), REPLY);
            }
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
        let server = server(&context, &proxy, zmq::REP);
        while proxy.tally.requests == 0 {
            assert!(proxy.turn().unwrap());
        }
        assert_eq!((server.recv_bytes(0).unwrap().len(), BUDGET.used()), (200, 0));
    }
}
