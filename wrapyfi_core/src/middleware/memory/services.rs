//! Services inside one process.
//!
//! ```text
//!   client ── request ──▶ the servers of "/x", in turn ── take, reply ──▶ the client's replies
//! ```

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Bus, lock};
use crate::endpoint::book::Book;
use crate::endpoint::calls::{Stage, ends};
use crate::endpoint::{
    CallError, Client, Context, DropReason, IncomingRequest, Link, Reply, Request, RequestId, Role,
    ServeError, Server, ServiceSpec, Ticket, Wake,
};
use crate::types::Payload;

/// Who calls and who serves under one name.
#[derive(Debug, Default)]
pub(super) struct Service {
    clients: usize,
    /// The one at the front is next.
    servers: VecDeque<Arc<ServerEnd>>,
    /// Rung when either side's number changes.
    watchers: Vec<Wake>,
    type_name: Option<&'static str>,
}

impl Service {
    /// Roles, and how many are in each.
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

type Answer = Result<Payload, String>;

/// Where the replies of one client go.
#[derive(Debug)]
struct ClientEnd {
    replies: Mutex<VecDeque<(i64, Answer)>>,
    wake: Wake,
}

impl ClientEnd {
    fn drain(&self) -> VecDeque<(i64, Answer)> {
        std::mem::take(&mut *self.replies.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn push(&self, sequence: i64, answer: Answer) {
        let mut replies = self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        replies.push_back((sequence, answer));
        drop(replies);
        self.wake.ring();
    }
}

#[derive(Debug)]
struct Asked {
    request: Request,
    client: Arc<ClientEnd>,
    sequence: i64,
    at: Instant,
}

/// Requests at one server.
#[derive(Debug)]
struct ServerEnd {
    state: Mutex<Waiting>,
    context: Context,
    limit: usize,
    service: String,
}

#[derive(Debug, Default)]
struct Waiting {
    queue: VecDeque<Asked>,
    /// With the user.
    open: usize,
}

impl ServerEnd {
    fn state(&self) -> MutexGuard<'_, Waiting> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ask(&self, asked: Asked) {
        self.context.counters.received(0);
        let mut state = self.state();
        if state.open + state.queue.len() >= self.limit {
            drop(state);
            self.context.counters.dropped(DropReason::Overloaded);
            let (service, limit) = (self.service.clone(), self.limit);
            let reason = ServeError::Overloaded { service, limit }.to_string();
            asked.client.push(asked.sequence, Err(reason));
            return;
        }
        state.queue.push_back(asked);
        drop(state);
        self.context.wake.ring();
    }
}

pub(super) struct MemoryClient {
    bus: Arc<Mutex<Bus>>,
    service: String,
    book: Book<Request>,
    end: Arc<ClientEnd>,
    sequence: i64,
}

impl MemoryClient {
    pub(super) fn open(bus: &Arc<Mutex<Bus>>, spec: &ServiceSpec, context: &Context) -> Self {
        let mut locked = lock(bus);
        let service = locked.services.entry(spec.service.clone()).or_default();
        service.clients += 1;
        service.watchers.push(context.wake.clone());
        service.ring();
        let end = ClientEnd { replies: Mutex::default(), wake: context.wake.clone() };
        Self {
            bus: Arc::clone(bus),
            service: spec.service.clone(),
            book: Book::new(&spec.service, spec.pending, &context.counters),
            end: Arc::new(end),
            sequence: 0,
        }
    }

    fn turn(&mut self) {
        while self.book.next_to_send().is_some() {
            let mut bus = lock(&self.bus);
            let Some(service) = bus.services.get_mut(&self.service) else { break };
            let Some(server) = service.servers.pop_front() else { break };
            service.servers.push_back(Arc::clone(&server));
            drop(bus);
            self.sequence += 1;
            if let Some(request) = self.book.send(self.sequence) {
                let client = Arc::clone(&self.end);
                let at = Instant::now();
                server.ask(Asked { request, client, sequence: self.sequence, at });
            }
        }
        for (sequence, answer) in self.end.drain() {
            let service = self.service.clone();
            self.book.answered(sequence, 0, Instant::now(), || {
                answer.map_err(|reason| CallError::Refused { service, reason })
            });
        }
        let servers = self.link().peers.unwrap_or(0);
        self.book.expire(|stage| match (stage, servers) {
            (Stage::Sent, 0) => "its server is gone".to_owned(),
            (Stage::Sent, _) => "its server has not answered".to_owned(),
            (Stage::Waiting, _) => "nobody offers it".to_owned(),
        });
    }
}

impl Client for MemoryClient {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        let ticket = self.book.begin(request.clone(), timeout)?;
        self.turn();
        Ok(ticket)
    }

    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        self.turn();
        self.book.take()
    }

    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        self.turn();
        self.book.take_only(ticket)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.book.cancel(ticket);
    }

    fn deadline(&self) -> Option<Instant> {
        self.book.deadline()
    }

    fn link(&self) -> Link {
        let servers = lock(&self.bus).services.get(&self.service).map(|s| s.servers.len());
        Link { peers: Some(servers.unwrap_or(0)), ..Link::default() }
    }

    fn wake(&self) -> &Wake {
        &self.end.wake
    }
}

impl Drop for MemoryClient {
    fn drop(&mut self) {
        if let Some(service) = lock(&self.bus).services.get_mut(&self.service) {
            service.clients = service.clients.saturating_sub(1);
            service.ring();
        }
    }
}

pub(super) struct MemoryServer {
    bus: Arc<Mutex<Bus>>,
    spec: ServiceSpec,
    end: Arc<ServerEnd>,
    open: HashMap<RequestId, (Arc<ClientEnd>, i64, Instant)>,
    next: u64,
}

impl MemoryServer {
    pub(super) fn open(bus: &Arc<Mutex<Bus>>, spec: &ServiceSpec, context: &Context) -> Self {
        let end = Arc::new(ServerEnd {
            state: Mutex::default(),
            context: context.clone(),
            limit: spec.pending,
            service: spec.service.clone(),
        });
        let mut locked = lock(bus);
        let service = locked.services.entry(spec.service.clone()).or_default();
        service.servers.push_back(Arc::clone(&end));
        service.type_name = Some(spec.kind.ros_type());
        service.watchers.push(context.wake.clone());
        service.ring();
        let bus = Arc::clone(bus);
        Self { bus, spec: spec.clone(), end, open: HashMap::new(), next: 0 }
    }

    fn close(&mut self, id: RequestId) -> Option<(Arc<ClientEnd>, i64)> {
        let (client, sequence, _) = self.open.remove(&id)?;
        self.end.state().open = self.open.len();
        Some((client, sequence))
    }

    fn timeout_ms(&self) -> u64 {
        u64::try_from(self.spec.timeout.as_millis()).unwrap_or(u64::MAX)
    }

    fn expire(&mut self) {
        let now = Instant::now();
        let over = self.open.iter().filter(|(_, (_, _, until))| *until <= now);
        let over: Vec<RequestId> = over.map(|(id, _)| *id).collect();
        for id in over {
            let Some((client, sequence)) = self.close(id) else { continue };
            self.end.context.counters.dropped(DropReason::Expired);
            let text =
                format!("{} did not answer within {} ms", self.spec.service, self.timeout_ms());
            client.push(sequence, Err(text));
        }
    }
}

impl Server for MemoryServer {
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        self.expire();
        let mut state = self.end.state();
        let Some(asked) = state.queue.pop_front() else { return Ok(None) };
        let Asked { request, client, sequence, at } = asked;
        self.next += 1;
        let id = RequestId(self.next);
        self.open.insert(id, (client, sequence, ends(Instant::now(), self.spec.timeout)));
        state.open = self.open.len();
        Ok(Some(IncomingRequest { id, request, wire_bytes: 0, received_at: at }))
    }

    fn reply(
        &mut self,
        id: RequestId,
        answer: Result<Payload, String>,
    ) -> Result<usize, ServeError> {
        let begun = Instant::now();
        let (client, sequence) = self.close(id).ok_or_else(|| ServeError::NotWaiting {
            service: self.spec.service.clone(),
            timeout_ms: self.timeout_ms(),
        })?;
        client.push(sequence, answer);
        self.end.context.counters.sent(0, begun.elapsed());
        Ok(0)
    }

    fn deadline(&self) -> Option<Instant> {
        self.open.values().map(|(_, _, until)| *until).min()
    }

    fn link(&self) -> Link {
        let clients = lock(&self.bus).services.get(&self.spec.service).map(|s| s.clients);
        Link { peers: Some(clients.unwrap_or(0)), ..Link::default() }
    }
}

impl Drop for MemoryServer {
    fn drop(&mut self) {
        if let Some(service) = lock(&self.bus).services.get_mut(&self.spec.service) {
            service.servers.retain(|server| !Arc::ptr_eq(server, &self.end));
            service.ring();
        }
    }
}
