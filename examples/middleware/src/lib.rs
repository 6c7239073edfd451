//! A middleware of your own: topics as UDP datagrams of JSON, which all programs in one multicast group hear.
//!
//! ```text
//!   {"endpoint": 7, "topic": "/chatter", "role": "publisher", "type": "Text", "is_open": true, "body": "AAEAAA…"}
//! ```
//!
//! is a message: its CDR in base64. Without a body it announces the endpoint, twice a second and at its end. What does not
//! fit into a datagram is refused. `driver.rs` makes the middleware known to programs, this file does the work.

mod driver;

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use socket2::{Domain, Protocol, Socket, Type};
use wrapyfi_data::codec::ros;
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::{
    Context, DiscoverError, Discovered, Discovery, Link, Listener, Middleware, Mutex, OpenError,
    Opened, PublishError, Publisher, Receiver, Role, Sample, Sender, TakeError, TopicSpec, Waits,
    inbox,
};

pub use driver::{DRIVER, NAME};

/// Group in which all programs hear each other, on this machine alone.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 77, 0);
/// Most bytes of a body.
const MOST: usize = 65_000;
/// Time between two announcements; an endpoint that misses four of them is gone.
const ANNOUNCE_EVERY: Duration = Duration::from_millis(500);

#[derive(Clone, Serialize, Deserialize)]
struct Datagram {
    endpoint: u64,
    topic: String,
    role: Role,
    r#type: String,
    is_open: bool,
    body: Option<String>,
    #[serde(skip, default = "Instant::now")]
    received_at: Instant,
}

impl Waits for Datagram {
    fn bytes(&self) -> usize {
        self.body.as_ref().map_or(0, String::len)
    }
}

/// The middleware `udp`: the group, as this program has joined it.
#[derive(Clone)]
pub struct Udp(Arc<Group>);

struct Group {
    socket: UdpSocket,
    address: SocketAddr,
    joined: Instant,
    endpoints: Mutex<Endpoints>,
}

/// Endpoints of this program, a listener with its queue, and those of others as they announced themselves last.
#[derive(Default)]
struct Endpoints {
    own: BTreeMap<u64, (Datagram, Context, Option<Sender<Datagram>>)>,
    others: BTreeMap<u64, Datagram>,
}

impl Udp {
    /// Joins the group on `port`.
    ///
    /// # Errors
    /// When the system gives no socket or no thread.
    pub fn join(port: u16) -> io::Result<Self> {
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        let address = SocketAddr::from((GROUP, port));
        socket.set_reuse_address(true)?;
        socket.set_recv_buffer_size(1 << 22)?;
        socket.bind(&address.into())?;
        socket.join_multicast_v4(&GROUP, &Ipv4Addr::LOCALHOST)?;
        socket.set_multicast_if_v4(&Ipv4Addr::LOCALHOST)?;
        socket.set_read_timeout(Some(ANNOUNCE_EVERY / 5))?;
        let (socket, joined, endpoints) = (socket.into(), Instant::now(), Mutex::default());
        let group = Arc::new(Group { socket, address, joined, endpoints });
        let heard = Arc::downgrade(&group);
        std::thread::Builder::new().name(NAME.to_owned()).spawn(move || hear(&heard))?;
        Ok(Self(group))
    }

    fn open<Q>(
        &self,
        role: Role,
        (spec, context): (&TopicSpec, &Context),
        (sender, queue): (Option<Sender<Datagram>>, Q),
    ) -> Result<Endpoint<Q>, OpenError> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        driver::check_topic(&spec.topic)
            .map_err(|reason| OpenError::invalid_name(NAME, &spec.topic, reason))?;
        let endpoint = u64::from(std::process::id()) << 32 | COUNT.fetch_add(1, Relaxed);
        let (topic, r#type) = (spec.topic.clone(), spec.message_type.to_string());
        let (is_open, body, received_at) = (true, None, Instant::now());
        let own = Datagram { endpoint, topic, role, r#type, is_open, body, received_at };
        let entry = (own.clone(), context.clone(), sender);
        self.0.endpoints.lock().own.insert(endpoint, entry);
        self.0.announce();
        Ok(Endpoint { group: Arc::clone(&self.0), own, spec: spec.clone(), queue })
    }
}

impl Middleware for Udp {
    fn name(&self) -> &str {
        NAME
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        let (sender, queue) = inbox(spec.queue, context);
        Ok(Box::new(self.open(Role::Listener, (spec, context), (Some(sender), queue))?))
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        Ok(Box::new(self.open(Role::Publisher, (spec, context), (None, ()))?))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(self.clone()))
    }
}

impl Discovery for Udp {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let endpoints = self.0.endpoints.lock();
        let mut found: Vec<_> = endpoints.others.values().collect();
        found.sort_by_key(|one| (&one.topic, one.role));
        let discovered = |one: &Datagram| Discovered {
            type_name: Some(one.r#type.clone()),
            ..Discovered::new(&one.topic, one.role)
        };
        Ok(found.into_iter().map(discovered).collect())
    }

    fn is_complete(&self) -> Option<bool> {
        Some(self.0.joined.elapsed() > 2 * ANNOUNCE_EVERY)
    }
}

/// Takes what comes, until the middleware and its endpoints are dropped.
fn hear(group: &Weak<Group>) {
    let (mut bytes, mut announced) = (vec![0; 1 << 16], Instant::now());
    while let Some(group) = group.upgrade() {
        if let Ok(length) = group.socket.recv(&mut bytes) {
            match serde_json::from_slice(bytes.get(..length).unwrap_or_default()) {
                Ok(datagram) => group.take(datagram),
                Err(error) => tracing::debug!("a datagram on {NAME} is none of ours: {error}"),
            }
        }
        if announced.elapsed() >= ANNOUNCE_EVERY {
            announced = Instant::now();
            group.announce();
        }
    }
}

impl Group {
    fn send(&self, datagram: &Datagram) -> io::Result<usize> {
        self.socket.send_to(&serde_json::to_vec(datagram)?, self.address)
    }

    /// Tells the others what this program has, and its endpoints to look at the others.
    fn announce(&self) {
        let mut endpoints = self.endpoints.lock();
        endpoints.others.retain(|_, one| one.received_at.elapsed() < 4 * ANNOUNCE_EVERY);
        for (own, context, _) in endpoints.own.values() {
            context.wake.ring();
            if let Err(error) = self.send(own) {
                tracing::warn!("{} on {NAME} is not announced: {error}", own.topic);
            }
        }
    }

    fn take(&self, datagram: Datagram) {
        let mut endpoints = self.endpoints.lock();
        if endpoints.own.contains_key(&datagram.endpoint) {
            return;
        }
        if datagram.body.is_some() {
            for (own, context, queue) in endpoints.own.values() {
                if let (Some(queue), true) = (queue, own.topic == datagram.topic) {
                    context.counters.received(datagram.bytes());
                    queue.settle(datagram.clone());
                }
            }
            return;
        }
        let is_change = match datagram.is_open {
            true => endpoints.others.insert(datagram.endpoint, datagram).is_none(),
            false => endpoints.others.remove(&datagram.endpoint).is_some(),
        };
        drop(endpoints);
        // A new endpoint hears of those here at once.
        if is_change {
            self.announce();
        }
    }
}

/// An endpoint that is open, with the queue of a listener.
struct Endpoint<Q> {
    group: Arc<Group>,
    own: Datagram,
    spec: TopicSpec,
    queue: Q,
}

impl<Q> Endpoint<Q> {
    fn peers(&self) -> Link {
        let endpoints = self.group.endpoints.lock();
        let is_peer = |one: &&Datagram| one.topic == self.own.topic && one.role != self.own.role;
        Link { peers: Some(endpoints.others.values().filter(is_peer).count()), ..Link::default() }
    }
}

impl<Q> Drop for Endpoint<Q> {
    fn drop(&mut self) {
        self.group.endpoints.lock().own.remove(&self.own.endpoint);
        // Others miss its announcements, where this one does not come.
        _ = self.group.send(&Datagram { is_open: false, ..self.own.clone() });
    }
}

impl Listener for Endpoint<Receiver<Datagram>> {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(datagram) = self.queue.pop() else { return Ok(None) };
        let TopicSpec { message_type, limits, plugins, .. } = &self.spec;
        let (wire_bytes, received_at) = (datagram.bytes(), datagram.received_at);
        if datagram.r#type != self.own.r#type {
            return Err(DecodeError::mismatch(&self.own.r#type, datagram.r#type));
        }
        DecodeError::check_size(wire_bytes, limits.message_bytes)?;
        let cdr = base64_simd::STANDARD.decode_to_vec(datagram.body.unwrap_or_default());
        let cdr = cdr.map_err(|error| DecodeError::malformed("base64", error.to_string()))?;
        let payload = ros::decode(&cdr.into(), *message_type, limits, plugins)?;
        Ok(Some(Sample { payload, wire_bytes, received_at, origin: None }))
    }

    fn discard(&mut self) -> bool {
        self.queue.pop().is_some()
    }

    fn link(&self) -> Link {
        self.peers()
    }
}

impl Publisher for Endpoint<()> {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let (TopicSpec { message_type, limits, plugins, .. }, own) = (&self.spec, self.own.clone());
        // A datagram for which no program waits would lie in the socket's buffer, and reach a listener that opens later.
        if self.peers().peers == Some(0) {
            return Err(PublishError::NoConsumer(own.topic));
        }
        let parts = ros::encode(payload, *message_type, plugins)?;
        let body = base64_simd::STANDARD.encode_to_string(parts.to_bytes());
        EncodeError::check_size(body.len(), limits.message_bytes.min(MOST))?;
        let sent = self.group.send(&Datagram { body: Some(body), ..own });
        let topic = self.own.topic.clone();
        sent.map_err(|error| PublishError::Transport { topic, reason: error.to_string() })
    }

    fn link(&self) -> Link {
        self.peers()
    }
}
