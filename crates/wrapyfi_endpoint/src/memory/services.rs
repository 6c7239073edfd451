//! Services inside one process.
//!
//! ```text
//!   client ── request ──▶ the servers of "/x", in turn ── take, reply ──▶ the client's replies
//! ```

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

use super::Bus;
use crate::calls::{Calls, Stage};
use crate::requests::Requests;
use crate::wire_client::{ClientWire, WireClient};
use crate::wire_server::{Sent, ServerWire, WireServer};
use crate::{CallError, Context, Link, Mutex, Request, Role, ServiceSpec, Wake};
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeError};

/// Clients and servers of one service name.
#[derive(Debug, Default)]
pub(super) struct Service {
    clients: usize,
    /// Servers; the one at the front gets the next request.
    servers: VecDeque<Arc<Requests<Ask>>>,
    /// Bells that ring when the number of clients or servers changes.
    watchers: Vec<Wake>,
    type_name: Option<&'static str>,
}

impl Service {
    /// Number of endpoints in each role.
    pub(super) fn ends(&self) -> [(Role, usize); 2] {
        [(Role::Client, self.clients), (Role::Server, self.servers.len())]
    }

    pub(super) fn type_name(&self) -> Option<&'static str> {
        self.type_name
    }

    fn ring(&self) {
        self.watchers.iter().for_each(Wake::ring);
    }
}

/// Direction of a parcel of a service.
///
/// See [`Carriage`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// A request, to a server.
    Request,
    /// A reply, to a client.
    Reply,
}

/// Fate of a request or reply on its way.
///
/// See [`Carriage`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// Arrives at once.
    Arrives,
    /// Arrives behind everything that is sent before the next look.
    Late,
    /// Arrives at once, and once more behind everything that is sent before the next look.
    Twice,
    /// Never arrives.
    Lost,
}

/// Rule that decides the fate of requests and replies; all arrive by default.
///
/// ```
/// use std::time::Duration;
/// use wrapyfi_data::types::ServiceKind;
/// use wrapyfi_endpoint::memory::{Carriage, Fate, Memory, Way};
/// use wrapyfi_endpoint::{CallError, Context, Middleware, Request, ServiceSpec};
///
/// let bus = Memory::new("memory");
/// bus.carry_services(Carriage::new(|way| match way {
///     Way::Request => Fate::Lost,
///     Way::Reply => Fate::Arrives,
/// }));
/// let spec = ServiceSpec::new("/add", ServiceKind::NativeObject);
/// let _server = bus.open_server(&spec, &Context::default())?;
/// let mut client = bus.open_client(&spec, &Context::default())?;
/// let error = client.call(&Request::default(), Duration::from_millis(10)).unwrap_err();
/// assert!(matches!(error, CallError::TimedOut { .. }));
/// # Ok::<(), wrapyfi_endpoint::OpenError>(())
/// ```
#[derive(Clone, Default)]
pub struct Carriage(Option<Arc<dyn Fn(Way) -> Fate + Send + Sync>>);

impl Carriage {
    /// A transport on which `fate` decides.
    pub fn new(fate: impl Fn(Way) -> Fate + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(fate)))
    }

    /// Copies of a parcel that arrive now and late.
    fn carry<T: Clone>(&self, way: Way, parcel: T) -> (Option<T>, Option<T>) {
        match self.0.as_ref().map_or(Fate::Arrives, |fate| fate(way)) {
            Fate::Arrives => (Some(parcel), None),
            Fate::Late => (None, Some(parcel)),
            Fate::Twice => (Some(parcel.clone()), Some(parcel)),
            Fate::Lost => (None, None),
        }
    }
}

impl fmt::Debug for Carriage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Carriage").field(&self.0.is_some()).finish()
    }
}

type Answer = Result<Payload, String>;

/// Queue of the replies to one client, and the signal that wakes it.
#[derive(Debug)]
struct ClientEnd {
    /// Replies that are here, and replies that are late.
    replies: Mutex<[VecDeque<(i64, Answer)>; 2]>,
    wake: Wake,
}

impl ClientEnd {
    fn drain(&self) -> VecDeque<(i64, Answer)> {
        let [here, late] = &mut *self.replies.lock();
        std::mem::replace(here, std::mem::take(late))
    }

    fn push(&self, carriage: &Carriage, sequence: i64, answer: Answer) {
        let (now, then) = carriage.carry(Way::Reply, (sequence, answer));
        let [here, late] = &mut *self.replies.lock();
        here.extend(now);
        late.extend(then);
        self.wake.ring();
    }
}

#[derive(Debug, Clone)]
pub(super) struct Ask {
    request: Request,
    client: Arc<ClientEnd>,
    sequence: i64,
}

pub(super) struct MemoryClient {
    bus: Arc<Mutex<Bus>>,
    service: String,
    end: Arc<ClientEnd>,
    sequence: i64,
    late: Vec<(Arc<Requests<Ask>>, Ask)>,
}

impl MemoryClient {
    pub(super) fn open(
        bus: &Arc<Mutex<Bus>>,
        spec: &ServiceSpec,
        context: &Context,
    ) -> WireClient<Self> {
        let mut locked = bus.lock();
        let service = locked.services.entry(spec.service.clone()).or_default();
        service.clients += 1;
        service.watchers.push(context.wake.clone());
        service.ring();
        let end = ClientEnd { replies: Mutex::default(), wake: context.wake.clone() };
        let (bus, service) = (Arc::clone(bus), spec.service.clone());
        let wire = Self { bus, service, end: Arc::new(end), sequence: 0, late: Vec::new() };
        WireClient::new(wire, &spec.service, spec.pending, context)
    }
}

impl ClientWire for MemoryClient {
    type Written = Request;

    fn write(&self, request: &Request, _: Instant) -> Result<(Request, usize), EncodeError> {
        Ok((request.clone(), request.size_hint()))
    }

    fn turn(&mut self, calls: &mut Calls<Request>) {
        let before = std::mem::take(&mut self.late);
        while calls.next_to_send().is_some() {
            let mut bus = self.bus.lock();
            let Some(service) = bus.services.get_mut(&self.service) else { break };
            let Some(server) = service.servers.pop_front() else { break };
            service.servers.push_back(Arc::clone(&server));
            let carriage = bus.carriage.clone();
            drop(bus);
            self.sequence += 1;
            let Some(request) = calls.send(self.sequence) else { break };
            let (client, sequence) = (Arc::clone(&self.end), self.sequence);
            let ask = Ask { request, client, sequence };
            let (now, late) = carriage.carry(Way::Request, (server, ask));
            now.into_iter().for_each(|(server, ask)| put(&server, ask));
            self.late.extend(late);
        }
        before.into_iter().for_each(|(server, ask)| put(&server, ask));
        for (sequence, answer) in self.end.drain() {
            let (service, now) = (self.service.clone(), calls.clock().now());
            calls.answered(sequence, 0, now, || {
                answer.map_err(|reason| CallError::Refused { service, reason })
            });
        }
    }

    fn missing(&self, stage: Stage) -> String {
        match (stage, self.link().peers) {
            (Stage::Sent, Some(0)) => "its server is gone".to_owned(),
            (Stage::Sent, _) => "its server has not answered".to_owned(),
            (Stage::Waiting, _) => "nobody offers it".to_owned(),
        }
    }

    fn link(&self) -> Link {
        let servers = self.bus.lock().services.get(&self.service).map(|s| s.servers.len());
        Link { peers: Some(servers.unwrap_or(0)), ..Link::default() }
    }
}

/// Hands a request to a server, which may have no room for it.
fn put(server: &Requests<Ask>, ask: Ask) {
    let bytes = ask.request.size_hint();
    if let Err((Ask { client, sequence, .. }, error)) = server.put(ask, bytes) {
        client.push(&Carriage::default(), sequence, Err(error.to_string()));
    }
}

impl Drop for MemoryClient {
    fn drop(&mut self) {
        if let Some(service) = self.bus.lock().services.get_mut(&self.service) {
            service.clients = service.clients.saturating_sub(1);
            service.ring();
        }
    }
}

pub(super) struct MemoryServer {
    bus: Arc<Mutex<Bus>>,
    service: String,
    requests: Arc<Requests<Ask>>,
}

impl MemoryServer {
    pub(super) fn open(
        bus: &Arc<Mutex<Bus>>,
        spec: &ServiceSpec,
        context: &Context,
    ) -> WireServer<Self> {
        let requests = Arc::new(Requests::new(spec, context));
        let mut locked = bus.lock();
        let service = locked.services.entry(spec.service.clone()).or_default();
        service.servers.push_back(Arc::clone(&requests));
        service.type_name = Some(spec.kind.ros_type());
        service.watchers.push(context.wake.clone());
        service.ring();
        let (bus, service) = (Arc::clone(bus), spec.service.clone());
        WireServer::new(Self { bus, service, requests: Arc::clone(&requests) }, requests, spec)
    }
}

impl ServerWire for MemoryServer {
    type Ask = Ask;
    type Answer = Payload;

    fn read(&self, ask: &Ask) -> Result<Request, DecodeError> {
        Ok(ask.request.clone())
    }

    fn write(&self, _ask: &Ask, payload: &Payload) -> Result<Payload, EncodeError> {
        Ok(payload.clone())
    }

    fn send(&mut self, ask: Ask, answer: Result<Payload, &str>) -> Sent {
        let carriage = self.bus.lock().carriage.clone();
        ask.client.push(&carriage, ask.sequence, answer.map_err(str::to_owned));
        Ok(Some(0))
    }

    fn link(&self) -> Link {
        let clients = self.bus.lock().services.get(&self.service).map(|s| s.clients);
        Link { peers: Some(clients.unwrap_or(0)), ..Link::default() }
    }
}

impl Drop for MemoryServer {
    fn drop(&mut self) {
        if let Some(service) = self.bus.lock().services.get_mut(&self.service) {
            service.servers.retain(|server| !Arc::ptr_eq(server, &self.requests));
            service.ring();
        }
    }
}
