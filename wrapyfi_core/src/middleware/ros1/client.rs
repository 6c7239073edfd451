//! Calls a service: finds its server, and has one connection for each call under way.
//!
//! ```text
//!   send ─▶ Book ─▶ call task ─ idle connection, or a new one ─▶ request ─▶ reply ─▶ take
//!   seeker: lookupService ─▶ probe ─▶ where the server is, and again while it does not answer
//! ```
//!
//! TCPROS answers the requests of one connection one after the other, so calls that are under way at
//! once take several. A connection that has answered is kept for the next call.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use bytes::{BufMut as _, Bytes, BytesMut};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::{Notify, watch};
use tokio::task::AbortHandle;
use tokio::time::{timeout, timeout_at};

use super::config::NodeUri;
use super::core::Core;
use super::header::Header;
use super::services::{self, MAX_ERROR_BYTES, ServiceForm, ServiceType};
use super::tcpros;
use crate::DecodeError;
use crate::backoff::Backoff;
use crate::endpoint::book::Book;
use crate::endpoint::calls::{Stage, ends};
use crate::endpoint::{
    CallError, Client, Context, Link, OpenError, Reply, Request, ServiceSpec, Ticket, Wake,
};
use crate::types::Payload;

/// Longest time between two looks for a server that is not there.
const SEEK: Duration = Duration::from_secs(1);
/// Time between two looks for a server that is there: it may have moved.
const RESEEK: Duration = Duration::from_secs(5);
/// How long a reply is waited for whose call has ended: it is counted as late.
const LATE: Duration = Duration::from_secs(30);
/// Connections that are kept for the next call.
const IDLE: usize = 8;

/// A request as it will be sent.
struct Outgoing {
    frame: Bytes,
    deadline: Instant,
}

/// How a call ended on its connection.
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

/// What the call tasks share.
struct Line {
    core: Weak<Core>,
    service: String,
    wire_type: ServiceType,
    limit_bytes: usize,
    wake: Wake,
    ended: Mutex<VecDeque<Ended>>,
    idle: Mutex<Vec<TcpStream>>,
    /// Where the server is.
    place: watch::Sender<Option<NodeUri>>,
    /// Why there is none.
    why: Mutex<Option<String>>,
    /// Rung when the server should be looked for.
    seek: Notify,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Calls one service.
pub(super) struct Ros1Client {
    core: Arc<Core>,
    form: ServiceForm,
    book: Book<Outgoing>,
    line: Arc<Line>,
    seeker: AbortHandle,
    /// Tasks whose calls may have ended without them.
    tasks: VecDeque<AbortHandle>,
    sequence: i64,
}

impl Ros1Client {
    pub(super) fn open(
        core: &Arc<Core>,
        service: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        let form = ServiceForm::new(core, spec)?;
        let line = Arc::new(Line {
            core: Arc::downgrade(core),
            service: service.to_owned(),
            wire_type: form.wire_type.clone(),
            limit_bytes: spec.limits.message_bytes,
            wake: context.wake.clone(),
            ended: Mutex::default(),
            idle: Mutex::default(),
            place: watch::channel(None).0,
            why: Mutex::default(),
            seek: Notify::new(),
        });
        let seeker = core.handle.spawn(seek(Arc::clone(&line), core.next_id())).abort_handle();
        Ok(Self {
            core: Arc::clone(core),
            form,
            book: Book::new(&spec.service, spec.pending, &context.counters),
            line,
            seeker,
            tasks: VecDeque::new(),
            sequence: 0,
        })
    }

    fn turn(&mut self) {
        self.tasks.retain(|task| !task.is_finished());
        while self.line.place.borrow().is_some() && self.book.next_to_send().is_some() {
            self.sequence += 1;
            let Some(outgoing) = self.book.send(self.sequence) else { break };
            let line = Arc::clone(&self.line);
            let task = self.core.handle.spawn(call(line, self.sequence, outgoing));
            self.tasks.push_back(task.abort_handle());
            // Those that wait for late replies are given up first.
            if self.tasks.len() > self.form.spec.pending.saturating_mul(2)
                && let Some(oldest) = self.tasks.pop_front()
            {
                oldest.abort();
            }
        }
        let ended = std::mem::take(&mut *locked(&self.line.ended));
        for Ended { sequence, outcome, bytes, at } in ended {
            let form = &self.form;
            self.book.answered(sequence, bytes, at, || read(outcome, form));
        }
        let line = &self.line;
        self.book.expire(|stage| match stage {
            Stage::Waiting => line.missing(),
            Stage::Sent => "its server has not answered".to_owned(),
        });
    }
}

/// What came of a call.
fn read(outcome: Outcome, form: &ServiceForm) -> Result<Payload, CallError> {
    let service = form.spec.service.clone();
    match outcome {
        Outcome::Reply(body) => {
            form.decode_reply(&body).map_err(|fault| CallError::Reply { service, fault })
        }
        Outcome::Refused(reason) => Err(CallError::Refused { service, reason }),
        Outcome::Failed(reason) => Err(CallError::Transport { service, reason }),
        Outcome::TooLarge(size) => {
            let (what, path) = ("message", "$".to_owned());
            let (actual, limit) = (size as u64, form.spec.limits.message_bytes as u64);
            let fault = DecodeError::TooLarge { what, path, actual, limit };
            Err(CallError::Reply { service, fault })
        }
    }
}

impl Line {
    fn end(&self, sequence: i64, outcome: Outcome, bytes: usize) {
        locked(&self.ended).push_back(Ended { sequence, outcome, bytes, at: Instant::now() });
        self.wake.ring();
    }

    /// Why no server is known.
    fn missing(&self) -> String {
        let fault = self.core.upgrade().and_then(|core| core.fault());
        fault
            .or_else(|| locked(&self.why).clone())
            .unwrap_or_else(|| format!("a ROS 1 node that offers {}", self.service))
    }

    /// Notes where the server is, or why nowhere.
    fn found(&self, place: Option<NodeUri>, why: Option<String>) {
        *locked(&self.why) = why;
        let changed = self.place.send_if_modified(|now| {
            let changes = *now != place;
            *now = place;
            changes
        });
        if changed {
            locked(&self.idle).clear();
            self.wake.ring();
        }
    }

    /// The server at `place` did not answer.
    fn lost(&self, place: &NodeUri, why: &str) {
        if self.place.borrow().as_ref() == Some(place) {
            self.found(None, Some(format!("the server of {}: {why}", self.service)));
            self.seek.notify_one();
        }
    }

    fn header(&self, caller: &str) -> Header {
        Header::new()
            .with("callerid", caller)
            .with("service", &self.service)
            .with("tcp_nodelay", "1")
    }

    /// A kept connection that still stands.
    fn kept(&self) -> Option<TcpStream> {
        loop {
            let stream = locked(&self.idle).pop()?;
            // One that has something to say was closed, or is out of step.
            if matches!(stream.try_read(&mut [0]), Err(e) if e.kind() == std::io::ErrorKind::WouldBlock)
            {
                return Some(stream);
            }
        }
    }

    fn keep(&self, stream: TcpStream) {
        let mut idle = locked(&self.idle);
        if idle.len() < IDLE {
            idle.push(stream);
        }
    }

    /// A connection to the server, or the words with which it refuses.
    async fn connect(&self) -> Result<TcpStream, String> {
        if let Some(stream) = self.kept() {
            return Ok(stream);
        }
        let mut places = self.place.subscribe();
        loop {
            let place = match places.wait_for(Option::is_some).await {
                Ok(place) => place.clone(),
                Err(_) => return Err("the client has ended".to_owned()),
            };
            let Some(place) = place else { continue };
            let Some(core) = self.core.upgrade() else {
                return Err("the node has ended".to_owned());
            };
            let own = self
                .header(core.name.full())
                .with("type", &self.wire_type.name)
                .with("md5sum", &self.wire_type.md5)
                .with("persistent", "1");
            drop(core);
            let mut stream = match tcpros::connect(&place.host, place.port).await {
                Ok(stream) => stream,
                Err(why) => {
                    self.lost(&place, &why);
                    continue;
                }
            };
            match tcpros::greet(&mut stream, &own).await {
                Ok(header) => match header.get("error") {
                    Some(error) => return Err(services::shortened(error).to_owned()),
                    None => return Ok(stream),
                },
                Err(error) => self.lost(&place, &error.to_string()),
            }
        }
    }
}

/// One call, from its connection to its reply.
async fn call(line: Arc<Line>, sequence: i64, Outgoing { frame, deadline }: Outgoing) {
    let deadline = tokio::time::Instant::from_std(deadline);
    let mut stream = match timeout_at(deadline, line.connect()).await {
        // What its caller has given up is not asked for.
        Err(_elapsed) => return,
        Ok(Err(refusal)) => return line.end(sequence, Outcome::Refused(refusal), 0),
        Ok(Ok(stream)) => stream,
    };
    if let Err(error) = stream.write_all(&frame).await {
        let text = format!("the connection broke while it asked: {error}");
        return line.end(sequence, Outcome::Failed(text), 0);
    }
    let late = deadline.checked_add(LATE).unwrap_or(deadline);
    match timeout_at(late, hear(&mut stream, line.limit_bytes)).await {
        // Nobody counts on it any more.
        Err(_elapsed) => {}
        Ok(Err(error)) => {
            let text = format!("the connection broke before the answer: {error}");
            line.end(sequence, Outcome::Failed(text), 0);
        }
        Ok(Ok((outcome, bytes))) => {
            // The rest of a reply that is too large is still to come.
            if !matches!(outcome, Outcome::TooLarge(_)) {
                line.keep(stream);
            }
            line.end(sequence, outcome, bytes);
        }
    }
}

async fn hear(stream: &mut TcpStream, limit: usize) -> std::io::Result<(Outcome, usize)> {
    let success = stream.read_u8().await? != 0;
    let size = usize::try_from(stream.read_u32_le().await?).unwrap_or(usize::MAX);
    let limit = if success { limit } else { MAX_ERROR_BYTES };
    if size > limit {
        return Ok((Outcome::TooLarge(size), size));
    }
    let mut body = BytesMut::with_capacity(size);
    while body.len() < size {
        let left = size - body.len();
        if stream.read_buf(&mut (&mut body).limit(left)).await? == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
    }
    let body = body.freeze();
    let outcome = if success {
        Outcome::Reply(body)
    } else {
        Outcome::Refused(String::from_utf8_lossy(&body).into_owned())
    };
    Ok((outcome, size + 5))
}

/// Knows where the server is, for as long as the client lives.
async fn seek(line: Arc<Line>, seed: u64) {
    let mut backoff = Backoff::of_process(seed);
    loop {
        let known = line.place.borrow().clone();
        let wait = match look(&line, known.as_ref()).await {
            Some(Ok(place)) => {
                backoff.reset();
                line.found(Some(place), None);
                RESEEK
            }
            Some(Err(why)) => {
                line.found(None, why);
                backoff.wait().min(SEEK)
            }
            None => return,
        };
        if timeout(wait, line.seek.notified()).await.is_ok() {
            // It was just found to be gone: the master may still name it.
            tokio::time::sleep(backoff.wait().min(SEEK)).await;
        }
    }
}

/// Where the server is; `None` where the node has ended.
async fn look(line: &Line, known: Option<&NodeUri>) -> Option<Result<NodeUri, Option<String>>> {
    let core = line.core.upgrade()?;
    let (place, is_listed) = match core.master.lookup_service(&line.service).await {
        Ok(Some(place)) => (place, true),
        // One that was restarted knows nobody: the server may still be there.
        Ok(None) => match known {
            Some(known) => (known.clone(), false),
            None => return Some(Err(None)),
        },
        // What was known stays so: calls need no master.
        Err(error) => return Some(known.cloned().ok_or_else(|| Some(error.awaited()))),
    };
    if is_listed && known == Some(&place) {
        return Some(Ok(place));
    }
    // The master also names servers that were killed.
    let probe = line.header(core.name.full()).with("md5sum", "*").with("probe", "1");
    drop(core);
    let answer = match tcpros::connect(&place.host, place.port).await {
        Ok(mut stream) => {
            tcpros::greet(&mut stream, &probe).await.map_err(|error| error.to_string())
        }
        Err(why) => Err(why),
    };
    Some(match answer {
        Ok(header) => match header.get("error") {
            Some(_) if !is_listed => Err(None),
            Some(error) => {
                let refusal = services::shortened(error);
                Err(Some(format!("the server of {}, which refuses: {refusal}", line.service)))
            }
            None => Ok(place),
        },
        Err(_) if !is_listed => Err(None),
        Err(why) => Err(Some(format!("the server of {}: {why}", line.service))),
    })
}

impl Client for Ros1Client {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        let frame = self.form.encode_request(request).map_err(|fault| CallError::Request {
            service: self.form.spec.service.clone(),
            fault,
        })?;
        let deadline = ends(Instant::now(), timeout);
        let ticket = self.book.begin(Outgoing { frame, deadline }, timeout)?;
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
        let found = self.line.place.borrow().is_some();
        let waiting_for = (!found).then(|| self.line.missing());
        Link { peers: Some(usize::from(found)), waiting_for, keeps_last: false }
    }

    fn wake(&self) -> &Wake {
        &self.line.wake
    }
}

impl Drop for Ros1Client {
    fn drop(&mut self) {
        self.seeker.abort();
        self.tasks.iter().for_each(AbortHandle::abort);
    }
}
