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

use std::collections::BTreeMap;
use std::os::fd::AsFd as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::broker_ports::BrokerPorts;
use super::deadline;
use super::envelope::{self, ServiceMessage};
use super::front::Front;
use super::options;
use super::status::ServiceBrokerStatus;
use super::turns::{Stop, Turns};
use wrapyfi_endpoint::{DropReason, Mutex, Outbox, Overflow, Waits};

/// Longest time that the last replies are waited for; a program has two seconds to end.
const FAREWELL: Duration = Duration::from_millis(1000);

/// Milliseconds between two tries to send to a client that does not read.
const RETRY: Duration = Duration::from_millis(5);
/// Time between two looks at peers that may be dead.
const TICK: Duration = Duration::from_millis(500);

pub(super) struct ServiceProxy {
    ports: BrokerPorts,
    tick_at: Instant,
    /// Requests that no server has room for, the oldest first.
    held: Outbox<Held>,
    pending: usize,
    /// Number of servers at the last look.
    servers: usize,
    /// Replies by client, where one does not read.
    unread: BTreeMap<Bytes, Outbox<Unread>>,
    tally: ServiceBrokerStatus,
    /// The same, as others see it.
    status: Arc<Mutex<ServiceBrokerStatus>>,
}

/// A reply that waits until its client reads.
struct Unread {
    reply: ServiceMessage,
    /// Number of replies that it counts for: an error of the broker itself is none.
    replies: u64,
}

impl Waits for Unread {
    fn bytes(&self) -> usize {
        self.reply.size()
    }
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

impl Waits for Held {
    fn bytes(&self) -> usize {
        self.message.size()
    }
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
            held: Outbox::default(),
            pending: pending.max(1),
            servers: 0,
            unread: BTreeMap::new(),
            tally: ServiceBrokerStatus::default(),
            status,
        }
    }

    /// Passes on the replies that are on their way: a server that ends with its broker has just
    /// given its last one.
    fn last_replies(&mut self) -> std::io::Result<()> {
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
            let is_unread = self.ports.back.is_unread();
            let wait = if is_unread { Duration::ZERO } else { left.min(RETRY) };
            let server = self.ports.back.registry();
            options::readable([server.as_fd()], wait)?;
        }
    }

    fn show(&mut self) {
        self.tally.cut = self.ports.settle();
        self.servers = self.ports.back.connected();
        *self.ports.ledger.servers.lock() = Some(self.servers);
        self.status.lock().clone_from(&self.tally);
    }

    /// Time until the next request is too old, a reply is tried again, or peers are looked at.
    fn time_left(&self) -> Duration {
        let next = self.held.iter().filter_map(|held| held.until).fold(self.tick_at, Instant::min);
        let left = next.saturating_duration_since(Instant::now());
        if self.unread.is_empty() { left } else { left.min(RETRY) }
    }

    fn take_requests(&mut self, now: Instant) {
        if let Err(error) = self.ports.front.turn(now) {
            tracing::error!(%error, "the ZeroMQ broker cannot wait for its clients");
        }
        self.tally.malformed += self.ports.front.heard.drain(..).len() as u64;
        for (client, mut frames) in std::mem::take(&mut self.ports.front.messages) {
            frames.insert(0, Bytes::copy_from_slice(&client.to_be_bytes()));
            let message = match envelope::split(frames) {
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
            // Straight through where no request waits in front of it.
            if self.held.is_empty() && forward(&message, &mut self.ports.back, &mut self.tally) {
                continue;
            }
            let held = Held { message, until };
            let held = self.held.push(held, self.pending, Overflow::DropNewest, drop);
            let Err((Held { message, .. }, reason)) = held else { continue };
            let why = match reason {
                DropReason::OverBudget => format!(
                    "a request of {} bytes finds no room: requests that wait for a server hold this broker's share of \
                     waiting_mib",
                    message.size()
                ),
                _ => format!(
                    "{} requests wait for a server at this broker, which is the limit",
                    self.pending
                ),
            };
            self.tally.overloaded += 1;
            let text = format!("{why}: start a server, or ask again later");
            self.answer(ServiceMessage::error(message.envelope, &text), 0);
        }
    }

    /// Refuses the requests without a limit of time when the last server goes: who has waited for it is told so, and
    /// nothing is begun hours later that nobody waits for.
    fn refuse_unlimited(&mut self) {
        if self.servers == 0 || self.ports.back.connected() > 0 {
            return;
        }
        let has_limit = |held: &Held| held.message.mark().is_none_or(|mark| mark.has_limit());
        let unlimited = self.held.iter().filter(|held| !has_limit(held));
        let envelopes: Vec<_> = unlimited.map(|held| held.message.envelope.clone()).collect();
        self.held.retain(has_limit);
        for envelope in envelopes {
            self.answer(
                ServiceMessage::error(envelope, "the last server of the broker has gone"),
                0,
            );
        }
    }

    fn pass_requests(&mut self) {
        let now = Instant::now();
        let before = self.held.len();
        self.held.retain(|held| held.until.is_none_or(|until| until > now));
        self.tally.expired += (before - self.held.len()) as u64;
        while let Some(held) = self.held.first() {
            if !forward(&held.message, &mut self.ports.back, &mut self.tally) {
                break;
            }
            _ = self.held.pop();
        }
        self.tally.waiting = self.held.len() as u64;
    }

    fn pass_replies(&mut self) {
        if let Err(error) = self.ports.back.turn(Instant::now()) {
            tracing::error!(%error, "the ZeroMQ broker cannot wait for its servers");
        }
        self.tally.malformed += self.ports.back.heard.drain(..).len() as u64;
        for (_, frames) in std::mem::take(&mut self.ports.back.messages) {
            match envelope::split(frames) {
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
            let unread = self.unread.entry(client).or_insert_with(|| self.held.beside());
            let reply = Unread { reply, replies };
            if unread.push(reply, self.pending, Overflow::DropNewest, drop).is_ok() {
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
            while let Some(Unread { reply, replies }) = unread.first() {
                sent = self.send(reply, *replies);
                if sent != Sent::Yes {
                    break;
                }
                _ = unread.pop();
            }
            if sent == Sent::NoRoom && !unread.stands_still(now) {
                self.unread.insert(client, unread);
            } else {
                self.tally.unheard += unread.iter().map(|unread| unread.replies).sum::<u64>();
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

    fn turn(&mut self, stop: &Stop) -> std::io::Result<bool> {
        let wait = self.ports.waits(self.time_left());
        let Some([front, back]) = wait.on(stop)? else {
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
        self.refuse_unlimited();
        self.pass_requests();
        self.show();
        Ok(true)
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
    use crate::codec::mark::{Content, Mark};
    use wrapyfi_endpoint::{Budget, Clock, Share, calls};

    /// A broker in this thread, and its client.
    fn broker(context: &zmq::Context) -> (ServiceProxy, zmq::Socket) {
        let bounds = Bounds { hwm: 2, message_bytes: 16 << 20, connections: 8 };
        let ip = std::net::Ipv4Addr::LOCALHOST.into();
        let bound = |kind| Front::bind(kind, ip, 0, bounds, None).unwrap();
        let (front, back) = (bound(Kind::Router), bound(Kind::Dealer));
        let client = context.socket(zmq::DEALER).unwrap();
        client.set_rcvhwm(1).unwrap();
        client.connect(&format!("tcp://127.0.0.1:{}", front.port().unwrap())).unwrap();
        let ports = BrokerPorts { front, back, ledger: Arc::default() };
        (ServiceProxy::new(ports, 10, Arc::default()), client)
    }

    fn server(context: &zmq::Context, proxy: &ServiceProxy, kind: zmq::SocketType) -> zmq::Socket {
        let server = context.socket(kind).unwrap();
        server.set_linger(0).unwrap();
        let port = proxy.ports.back.port().unwrap();
        server.connect(&format!("tcp://127.0.0.1:{port}")).unwrap();
        server
    }

    fn turn(proxy: &mut ServiceProxy) {
        let (_running, stop) = Stop::pair().unwrap();
        assert!(proxy.turn(&stop).unwrap());
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
            turn(&mut proxy);
        }
        assert_eq!(server.recv_bytes(0).unwrap(), b"fresh");
        assert_eq!(proxy.tally.expired, 1);
    }

    #[test]
    fn who_waits_without_a_limit_hears_that_the_last_server_has_gone() {
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        let ask = |number, timeout| {
            let (kind, deadline) = (Content::NativeObject, calls::ends(Instant::now(), timeout));
            let mark = deadline::request(kind, number, deadline, &Clock::default());
            // Few of them fill a connection.
            client.send_multipart([&mark.encode(), "".as_bytes(), &[b'?'; 1 << 16]], 0).unwrap();
        };
        ask(1, Duration::MAX);
        while proxy.held.is_empty() {
            turn(&mut proxy);
        }
        // There was none that could go.
        turn(&mut proxy);
        assert_eq!(proxy.held.len(), 1);
        let server = context.socket(zmq::REP).unwrap();
        server.set_linger(0).unwrap();
        server.set_rcvhwm(1).unwrap();
        server.connect(&format!("tcp://127.0.0.1:{}", proxy.ports.back.port().unwrap())).unwrap();
        while proxy.tally.requests < 1 {
            turn(&mut proxy);
        }
        // As many as the connection of a server that reads nothing takes, and some more: it may yet take one or two.
        let (mut number, mut is_limited) = (1, false);
        while proxy.held.len() < 8 || !is_limited {
            number += 1;
            is_limited = proxy.held.len() >= 7;
            ask(number, if is_limited { Duration::from_secs(600) } else { Duration::MAX });
            let seen = |proxy: &ServiceProxy| proxy.tally.requests + proxy.held.len() as u64;
            while seen(&proxy) < number {
                turn(&mut proxy);
            }
        }
        drop(server);
        while !proxy.held.iter().all(|held| held.message.mark().unwrap().has_limit()) {
            turn(&mut proxy);
        }
        while !is_readable(&client) {
            turn(&mut proxy);
        }
        let reply = client.recv_multipart(0).unwrap();
        assert_eq!(reply.last().unwrap(), b"the last server of the broker has gone");
        assert!(!proxy.held.is_empty());
    }

    #[test]
    fn replies_that_a_client_does_not_read_are_bounded_in_bytes() {
        // More than the system holds of a connection.
        const REPLY: usize = 8 << 20;
        static BUDGET: Budget = Budget::new(10 * REPLY);
        let context = zmq::Context::new();
        let (mut proxy, client) = broker(&context);
        proxy.held = Outbox::of(Share::of(&BUDGET));
        let server = server(&context, &proxy, zmq::DEALER);
        for _ in 0..10 {
            client.send_multipart([&b""[..], b"?"], 0).unwrap();
            while !is_readable(&server) {
                turn(&mut proxy);
            }
            let mut reply = server.recv_multipart(0).unwrap();
            *reply.last_mut().unwrap() = vec![b'x'; REPLY];
            server.send_multipart(reply, 0).unwrap();
        }
        let seen = |tally: &ServiceBrokerStatus| tally.unheard + tally.replies;
        let waits = |proxy: &ServiceProxy| {
            proxy.unread.values().map(|unread| unread.len() as u64).sum::<u64>()
        };
        while seen(&proxy.tally) + waits(&proxy) < 10 {
            turn(&mut proxy);
        }
        // Some are with the connection, two with the broker: a third would be more than a quarter of what may wait.
        assert_eq!(waits(&proxy), 2);
        assert!(proxy.tally.unheard > 0 && BUDGET.used() <= 5 * REPLY / 2, "{}", BUDGET.used());
        while seen(&proxy.tally) < 10 {
            turn(&mut proxy);
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
        proxy.held = Outbox::of(Share::of(&BUDGET));
        for size in [200, 100] {
            client.send_multipart([Vec::new(), vec![b'x'; size]], 0).unwrap();
        }
        while proxy.tally.overloaded == 0 {
            turn(&mut proxy);
        }
        let told = client.recv_multipart(0).unwrap().concat();
        let told = String::from_utf8_lossy(&told);
        assert!(told.contains("finds no room") && told.contains("waiting_mib"), "{told}");
        assert!(BUDGET.used() >= 200);
        let server = server(&context, &proxy, zmq::REP);
        while proxy.tally.requests == 0 {
            turn(&mut proxy);
        }
        assert_eq!((server.recv_bytes(0).unwrap().len(), BUDGET.used()), (200, 0));
    }
}
