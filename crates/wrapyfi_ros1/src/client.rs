//! Calls a service: finds its server, and has one connection for each call under way.
//!
//! ```text
//!   send ─▶ Calls ─▶ call task ─ idle connection, or a new one ─▶ request ─▶ reply ─▶ take
//!   seeker: lookupService ─▶ probe ─▶ where the server is, and again while it does not answer
//! ```
//!
//! TCPROS answers the requests of one connection one after the other, so calls that are under way at
//! once take several. A connection that has answered is kept for the next call. Where as many are being opened as a server
//! holds, a call waits, in turn, until it may open one or another call has ended.

use std::collections::VecDeque;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

use bytes::Bytes;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::{Notify, Semaphore, watch};
use tokio::task::AbortHandle;
use tokio::time::{timeout, timeout_at};
use wrapyfi_retry::NewestTasks;

use super::body::{Bodies, Body};
use super::config::{NAME, NodeUri};
use super::core::Core;
use super::header::Header;
use super::node::Node;
use super::peer_types::{forget_service, greeted, probe_header, told_md5sum};
use super::services::{MAX_ERROR_BYTES, ServiceCodec, ServiceType};
use super::splitter;
use super::tcpros::{self, OPENING_AT_ONCE};
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeResult};
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::calls::{Calls, Stage};
use wrapyfi_endpoint::codec::requests;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::wire_client::{ClientWire, WireClient};
use wrapyfi_endpoint::{
    Absent, CallError, Cause, Context, Link, Mutex, Named, OpenResult, PROGRESS, PeerFault,
    Request, Role, ServiceSpec, Share,
};

/// Longest time between two looks for a server that is not there.
const SEEK: Duration = Duration::from_secs(1);
/// Time between two looks for a server that is there: it may have moved.
const RESEEK: Duration = Duration::from_secs(5);
/// Time after the end of a call in which its reply is still read, and counted as late.
const LATE: Duration = Duration::from_secs(30);
/// Connections that are kept for the next call.
const IDLE: usize = 8;

/// A request as it will be sent.
pub(super) struct Outgoing {
    frame: Bytes,
    deadline: Instant,
}

/// Result of one call on its connection.
enum Outcome {
    Reply(Bytes),
    Refused(String),
    TooLarge(usize),
    Failed(String),
}

struct Ended {
    sequence: i64,
    outcome: Outcome,
    bytes: usize,
    at: Instant,
}

/// State that a client shares with the tasks of its calls.
struct ClientShared {
    node: Weak<Node>,
    service: String,
    wire_type: ServiceType,
    limit_bytes: usize,
    context: Context,
    ended: Mutex<VecDeque<Ended>>,
    idle: Mutex<Vec<TcpStream>>,
    /// Places of the connections that are being opened.
    openings: Semaphore,
    /// Address of the server's node; `None` while no server is known.
    place: watch::Sender<Option<NodeUri>>,
    /// Cause for which no server is known; `None` while one is.
    why: Mutex<Option<Cause>>,
    /// Signal that the server should be looked for.
    seek: Notify,
}

/// Calls one service.
pub(super) struct Ros1Client {
    node: Arc<Node>,
    codec: ServiceCodec,
    shared: Arc<ClientShared>,
    seeker: AbortHandle,
    /// Tasks whose calls may have ended without them.
    tasks: NewestTasks,
    sequence: i64,
}

impl Ros1Client {
    pub(super) fn open(
        node: &Arc<Node>,
        service: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> OpenResult<WireClient<Self>> {
        let codec = ServiceCodec::new(node, spec, told_md5sum(node, service).as_deref())?;
        let shared = Arc::new(ClientShared {
            node: Arc::downgrade(node),
            service: service.to_owned(),
            wire_type: codec.wire_type.clone(),
            limit_bytes: spec.limits.message_bytes,
            context: context.clone(),
            ended: Mutex::default(),
            idle: Mutex::default(),
            openings: Semaphore::new(OPENING_AT_ONCE),
            place: watch::channel(None).0,
            why: Mutex::default(),
            seek: Notify::new(),
        });
        let (kept, told, seed) = (Arc::clone(&shared), Arc::clone(&shared), node.next_id());
        let seeker = restarted(
            format!("the search for service {service}"),
            move |what| told.found(None, Some(Cause::Restarting(what))),
            move || seek(Arc::clone(&kept), seed),
        );
        let seeker = node.handle.spawn(seeker).abort_handle();
        let tasks = NewestTasks::default();
        let wire = Self { node: Arc::clone(node), codec, shared, seeker, tasks, sequence: 0 };
        Ok(WireClient::new(wire, &spec.service, spec.pending, context))
    }
}

/// Turns the result of a call into the payload of its reply, or into the caller's error.
fn read(outcome: Outcome, codec: &ServiceCodec) -> Result<Payload, CallError> {
    let service = codec.spec.service.clone();
    match outcome {
        Outcome::Reply(body) => {
            codec.decode_reply(&body).map_err(|fault| CallError::Reply { service, fault })
        }
        Outcome::Refused(reason) => Err(CallError::Refused { service, reason }),
        Outcome::Failed(reason) => Err(CallError::Transport { service, reason }),
        Outcome::TooLarge(size) => {
            let fault = DecodeError::too_large(size, codec.spec.limits.message_bytes);
            Err(CallError::Reply { service, fault })
        }
    }
}

impl ClientShared {
    fn end(&self, sequence: i64, outcome: Outcome, bytes: usize) {
        let at = self.context.clock.now();
        self.ended.lock().push_back(Ended { sequence, outcome, bytes, at });
        self.context.wake.ring();
    }

    /// Description of the missing server, and the reason.
    fn missing(&self) -> Cause {
        let fault = self.node.upgrade().and_then(|node| node.fault());
        fault.or_else(|| self.why.lock().clone()).unwrap_or_else(|| {
            Absent::new(Role::Server, "a ROS 1 node that offers", NAME, &self.service).into()
        })
    }

    /// Cause for which the server, which the master names, is not called.
    fn fault(&self, server: &str, fault: PeerFault) -> Cause {
        Cause::peer(Named::endpoint(server, NAME, &self.service), "", Some(fault), "")
    }

    /// Notes where the server is, or why nowhere.
    fn found(&self, place: Option<NodeUri>, why: Option<Cause>) {
        *self.why.lock() = why;
        let changed = self.place.send_if_modified(|now| {
            let changes = *now != place;
            *now = place;
            changes
        });
        if changed {
            self.idle.lock().clear();
            self.context.wake.ring();
        }
    }

    /// The server at `place` did not answer.
    fn lost(&self, place: &NodeUri, why: String) {
        if self.place.borrow().as_ref() == Some(place) {
            self.found(None, Some(self.fault("the server of", why.into())));
            self.seek.notify_one();
        }
    }

    /// Cause for which a server with this header cannot be called, if there is one.
    fn objection(&self, header: &Header) -> Option<Cause> {
        let wanted = &self.wire_type;
        if let Some(error) = header.get("error") {
            let says = requests::beginning(error, MAX_ERROR_BYTES).to_owned();
            let server = Named::endpoint("the server of", NAME, &self.service);
            return Some(Cause::ServerRefuses { server, says });
        }
        let md5 = header.get("md5sum").unwrap_or("*");
        (md5 != "*" && md5 != wanted.md5).then(|| {
            let theirs = tcpros::shown(header.get("type").unwrap_or("another type"), md5);
            let ours = tcpros::shown(&wanted.name, &wanted.md5);
            self.fault("another server of", PeerFault::Unlike { verb: "is", theirs, ours })
        })
    }

    /// A kept connection that still stands.
    fn kept(&self) -> Option<TcpStream> {
        loop {
            let stream = self.idle.lock().pop()?;
            // One that has something to say was closed, or is out of step.
            if matches!(stream.try_read(&mut [0]), Err(e) if e.kind() == std::io::ErrorKind::WouldBlock)
            {
                return Some(stream);
            }
        }
    }

    fn keep(&self, stream: TcpStream) {
        let mut idle = self.idle.lock();
        if idle.len() < IDLE {
            idle.push(stream);
        }
    }

    /// Connections that are being opened, in words; `None` where none is.
    fn opening(&self) -> Option<String> {
        let count = OPENING_AT_ONCE.saturating_sub(self.openings.available_permits());
        let NodeUri { host, port } = self.place.borrow().clone()?;
        (count > 0).then(|| {
            format!(
                "{count} connections to its server at {host}:{port} are being opened, at most {OPENING_AT_ONCE} at once"
            )
        })
    }

    /// A connection to the server, or the words with which it refuses; `None` where none comes before `deadline`.
    async fn connect(&self, deadline: Instant) -> Option<Result<TcpStream, String>> {
        if let Some(stream) = self.kept() {
            return Some(Ok(stream));
        }
        let opening = self.openings.acquire();
        let _opening = timeout_at(deadline.into(), opening).await.ok()?.ok()?;
        let mut places = self.place.subscribe();
        loop {
            // Another call may have ended meanwhile.
            if let Some(stream) = self.kept() {
                return Some(Ok(stream));
            }
            let known = places.wait_for(Option::is_some);
            let place = timeout_at(deadline.into(), known).await.ok()?.ok()?.clone()?;
            let own = self
                .node
                .upgrade()?
                .header()
                .with("service", &self.service)
                .with("tcp_nodelay", "1")
                .with("type", &self.wire_type.name)
                .with("md5sum", &self.wire_type.md5)
                .with("persistent", "1");
            match tcpros::greeted(&place.host, place.port, &own).await {
                Ok((stream, header)) => {
                    let refusal = header.get("error");
                    let refusal =
                        refusal.map(|it| requests::beginning(it, MAX_ERROR_BYTES).to_owned());
                    return Some(refusal.map_or(Ok(stream), Err));
                }
                Err(why) => self.lost(&place, why.to_string()),
            }
        }
    }
}

/// One call, from its connection to its reply.
async fn call(shared: Arc<ClientShared>, sequence: i64, Outgoing { frame, deadline }: Outgoing) {
    let mut stream = match shared.connect(deadline).await {
        None => return,
        Some(Err(refusal)) => return shared.end(sequence, Outcome::Refused(refusal), 0),
        // The caller has given up: no request goes out.
        Some(Ok(stream)) if deadline <= Instant::now() => return shared.keep(stream),
        Some(Ok(stream)) => stream,
    };
    if let Err(error) = stream.write_all(&frame).await {
        let text = format!("the connection broke while it asked: {error}");
        return shared.end(sequence, Outcome::Failed(text), 0);
    }
    let late = deadline.checked_add(LATE).unwrap_or(deadline);
    match timeout_at(late.into(), hear(&mut stream, shared.limit_bytes)).await {
        // No call counts on it any more.
        Err(_elapsed) => {}
        Ok(Err(ended)) => {
            let text = format!("no answer came: {ended}");
            shared.end(sequence, Outcome::Failed(text), 0);
        }
        Ok(Ok((outcome, bytes))) => {
            // The rest of a reply that is too large is still to come.
            if !matches!(outcome, Outcome::TooLarge(_)) {
                shared.keep(stream);
            }
            shared.end(sequence, outcome, bytes);
        }
    }
}

/// Calls a service once, by the bytes of its request and reply.
///
/// # Errors
/// When no node offers it, the node refuses, or the connection breaks; in words.
pub(super) async fn call_once(
    core: &Core,
    service: &str,
    wire_type: &ServiceType,
    body: &[u8],
    limit: usize,
) -> Result<Bytes, String> {
    let place = core.master.lookup_service(service).await.map_err(|error| error.to_string())?;
    let place = place.ok_or_else(|| format!("no ROS 1 node offers {service}"))?;
    let own = core
        .header()
        .with("service", service)
        .with("tcp_nodelay", "1")
        .with("type", &wire_type.name)
        .with("md5sum", &wire_type.md5);
    let greeted = tcpros::greeted(&place.host, place.port, &own).await;
    let (mut stream, header) = greeted.map_err(|why| why.to_string())?;
    if let Some(error) = header.get("error") {
        return Err(requests::beginning(error, MAX_ERROR_BYTES).to_owned());
    }
    let size =
        u32::try_from(body.len()).map_err(|_e| format!("{} bytes are too many", body.len()))?;
    let sent = stream.write_all(&[&size.to_le_bytes(), body].concat()).await;
    sent.map_err(|error| format!("the connection broke while it asked: {error}"))?;
    match hear(&mut stream, limit).await {
        Ok((Outcome::Reply(body), _)) => Ok(body),
        Ok((Outcome::Refused(reason) | Outcome::Failed(reason), _)) => Err(reason),
        Ok((Outcome::TooLarge(size), _)) => Err(DecodeError::too_large(size, limit).to_string()),
        Err(ended) => Err(format!("no answer came: {ended}")),
    }
}

async fn hear(stream: &mut TcpStream, limit: usize) -> Result<(Outcome, usize), splitter::Ended> {
    let success = stream.read_u8().await? != 0;
    let limit = if success { limit } else { MAX_ERROR_BYTES };
    let bodies = Bodies::new(limit, PROGRESS, Share::default());
    let size = bodies.size(stream).await?.ok_or(splitter::Ended::Closed)?;
    if size > limit {
        return Ok((Outcome::TooLarge(size), size));
    }
    let body = bodies.read(stream, size, "the reply").await.map_err(|(ended, _begun)| ended)?;
    let outcome = match body {
        Body::Whole(body) if success => Outcome::Reply(body),
        Body::Whole(body) => Outcome::Refused(String::from_utf8_lossy(&body).into_owned()),
        Body::Passed { reason, .. } => Outcome::Failed(reason),
    };
    Ok((outcome, size + 5))
}

/// Knows where the server is, for as long as the client lives.
async fn seek(shared: Arc<ClientShared>, seed: u64) {
    let mut backoff = Backoff::of_process(seed).up_to(SEEK);
    loop {
        let known = shared.place.borrow().clone();
        let wait = match look(&shared, known.as_ref()).await {
            Some(Ok(place)) => {
                backoff.reset();
                shared.found(Some(place), None);
                RESEEK
            }
            Some(Err(why)) => {
                shared.found(None, why);
                backoff.wait()
            }
            None => return,
        };
        if timeout(wait, shared.seek.notified()).await.is_ok() {
            // It was just found to be gone: the master may still name it.
            backoff.pause().await;
        }
    }
}

/// Asks the master for the node that offers the service, and that node whether it is there and of which type it is: the
/// master also names servers that were killed. A master that was restarted knows no node, so the address `known` stays
/// then; `None` when this node has ended.
async fn look(
    shared: &ClientShared,
    known: Option<&NodeUri>,
) -> Option<Result<NodeUri, Option<Cause>>> {
    let node = shared.node.upgrade()?;
    let (place, is_listed) = match node.master.lookup_service(&shared.service).await {
        Ok(Some(place)) => (place, true),
        // A master that was restarted knows no node: the server may still be there.
        Ok(None) => match known {
            Some(known) => (known.clone(), false),
            None => return Some(Err(None)),
        },
        // The known address stays: calls need no master.
        Err(error) => {
            return Some(known.cloned().ok_or_else(|| Some(error.cause(&node.master.uri))));
        }
    };
    let probe = probe_header(&node, &shared.service);
    drop(node);
    Some(match greeted(&place, &probe).await {
        Err(why) => Err(is_listed.then(|| shared.fault("the server of", why.to_string().into()))),
        Ok(header) => match shared.objection(&header) {
            Some(why) => {
                forget_service(&*shared.node.upgrade()?, &shared.service);
                Err(is_listed.then_some(why))
            }
            None => Ok(place),
        },
    })
}

impl ClientWire for Ros1Client {
    type Written = Outgoing;

    fn write(&self, request: &Request, deadline: Instant) -> EncodeResult<(Outgoing, usize)> {
        let frame = self.codec.encode_request(request)?;
        let bytes = frame.len();
        Ok((Outgoing { frame, deadline }, bytes))
    }

    fn turn(&mut self, calls: &mut Calls<Outgoing>) {
        while self.shared.place.borrow().is_some() && calls.next_to_send().is_some() {
            self.sequence += 1;
            let Some(outgoing) = calls.send(self.sequence) else { break };
            let shared = Arc::clone(&self.shared);
            let task = self.node.handle.spawn(call(shared, self.sequence, outgoing));
            // Those that wait for late replies are given up first.
            let most = self.codec.spec.pending.saturating_mul(2);
            self.tasks.enter(task.abort_handle(), most);
        }
        let ended = std::mem::take(&mut *self.shared.ended.lock());
        for Ended { sequence, outcome, bytes, at } in ended {
            let codec = &self.codec;
            calls.answered(sequence, bytes, at, || read(outcome, codec));
        }
    }

    fn missing(&self, stage: Stage) -> String {
        match stage {
            Stage::Waiting => format!("still waiting for {}", self.shared.missing()),
            Stage::Sent => match self.shared.opening() {
                Some(opening) => format!("its server has not answered; {opening}"),
                None => "its server has not answered".to_owned(),
            },
        }
    }

    fn link(&self) -> Link {
        let found = self.shared.place.borrow().is_some();
        let waiting_for = (!found).then(|| self.shared.missing());
        Link { peers: Some(usize::from(found)), waiting_for, keeps_last: false }
    }
}

impl Drop for Ros1Client {
    fn drop(&mut self) {
        self.seeker.abort();
        self.tasks.abort();
    }
}
