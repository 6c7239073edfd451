//! The connections of a service that this node offers.
//!
//! ```text
//!   client ─ header ─▶ fits? ─ request ─▶ [ waiting … ] ─▶ Ros1Server::take
//!            ◀─ 1 size reply │ 0 size why ◀── oneshot ◀──── Ros1Server::reply
//! ```
//!
//! One request at a time on a connection, as TCPROS has it. A client that goes away takes its request
//! along, if nobody has taken it yet.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use bytes::{BufMut as _, Bytes, BytesMut};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::sync::{Notify, oneshot};

use super::core::Core;
use super::header::Header;
use super::services::{ServiceForm, ServiceType, shortened};
use super::tcpros::{self, Accepted};
use crate::endpoint::{Context, DropReason, ServeError, Wake};

/// What is sent back: the pieces of a message, or why there is none.
pub(super) type Answer = Result<Vec<Bytes>, String>;

/// A request, and the way back.
pub(super) struct Asked {
    pub(super) body: Bytes,
    pub(super) received_at: Instant,
    pub(super) answer: oneshot::Sender<Answer>,
}

pub(super) struct ServiceHost {
    service: String,
    wire_type: ServiceType,
    limit_bytes: usize,
    pending: usize,
    context: Context,
    state: Mutex<State>,
    /// Rung when the service ends.
    end: Notify,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Asked>,
    /// With the user.
    open: usize,
    clients: usize,
    closed: bool,
}

impl ServiceHost {
    pub(super) fn new(service: &str, form: &ServiceForm, context: &Context) -> Self {
        Self {
            service: service.to_owned(),
            wire_type: form.wire_type.clone(),
            limit_bytes: form.spec.limits.message_bytes,
            pending: form.spec.pending,
            context: context.clone(),
            state: Mutex::default(),
            end: Notify::new(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn wake(&self) -> &Wake {
        &self.context.wake
    }

    pub(super) fn context(&self) -> &Context {
        &self.context
    }

    /// The oldest request whose client still waits.
    pub(super) fn take(&self) -> Option<Asked> {
        let mut state = self.state();
        loop {
            let asked = state.waiting.pop_front()?;
            if !asked.answer.is_closed() {
                state.open += 1;
                return Some(asked);
            }
            // Its client is gone: what it asked for must not happen late.
            self.context.counters.dropped(DropReason::Expired);
        }
    }

    pub(super) fn set_open(&self, open: usize) {
        self.state().open = open;
    }

    pub(super) fn clients(&self) -> usize {
        self.state().clients
    }

    /// Ends all connections; who waits is told.
    pub(super) fn close(&self) {
        let waiting = {
            let mut state = self.state();
            state.closed = true;
            std::mem::take(&mut state.waiting)
        };
        for asked in waiting {
            let text = format!("{:?} ended before it took the request", self.service);
            _ = asked.answer.send(Err(text));
        }
        self.end.notify_waiters();
    }

    /// Serves a client until either end closes.
    pub(super) async fn serve(&self, accepted: Accepted, core: &Arc<Core>) {
        let caller = accepted.caller().to_owned();
        let Accepted { mut stream, header, place, .. } = accepted;
        let md5 = header.get("md5sum").unwrap_or_default();
        if md5 != "*" && md5 != self.wire_type.md5 {
            let wire_type = &self.wire_type;
            let text = format!(
                "{caller} calls {} as {} [{md5}], but it is {} [{}]: call it as that",
                self.service,
                header.get("type").unwrap_or("another type"),
                wire_type.name,
                wire_type.md5,
            );
            tracing::warn!("ROS 1: refused a client: {text}");
            self.context.counters.dropped(DropReason::Mismatch);
            return tcpros::refuse(&mut stream, &text).await;
        }
        let own = Header::new()
            .with("callerid", core.name.full())
            .with("service", &self.service)
            .with("type", &self.wire_type.name)
            .with("md5sum", &self.wire_type.md5)
            .with("request_type", &self.wire_type.request)
            .with("response_type", &self.wire_type.response);
        let Ok(own) = own.encode() else { return };
        if stream.write_all(&own).await.is_err() || header.is_set("probe") {
            return;
        }
        let lingers = core.lingering.begin();
        if !self.come() {
            return;
        }
        let persistent = matches!(header.get("persistent"), Some("1" | "true" | "True"));
        self.converse(&mut stream, persistent).await;
        self.state().clients -= 1;
        self.context.wake.ring();
        drop((place, lingers));
    }

    fn come(&self) -> bool {
        let mut state = self.state();
        if state.closed {
            return false;
        }
        state.clients += 1;
        drop(state);
        self.context.wake.ring();
        true
    }

    async fn converse(&self, stream: &mut TcpStream, persistent: bool) {
        loop {
            let end = self.end.notified();
            tokio::pin!(end);
            end.as_mut().enable();
            if self.state().closed {
                return;
            }
            let request = tokio::select! {
                request = self.hear(stream) => request,
                () = end => return,
            };
            let answer = match request {
                None => return,
                Some(Err(refusal)) => Err(refusal),
                Some(Ok(body)) => match self.ask(body) {
                    Err(refusal) => Err(refusal),
                    Ok(answer) => match wait(stream, answer).await {
                        Some(answer) => answer,
                        None => return,
                    },
                },
            };
            if write(stream, answer).await.is_err() || !persistent {
                return;
            }
        }
    }

    /// The next request; `None` at the end of the connection.
    async fn hear(&self, stream: &mut TcpStream) -> Option<Result<Bytes, String>> {
        let size = stream.read_u32_le().await.ok()?;
        let size = usize::try_from(size).ok()?;
        let counters = &self.context.counters;
        if size > self.limit_bytes {
            counters.received(size);
            counters.dropped(DropReason::Oversize);
            let rest = u64::try_from(size).ok()?;
            tokio::io::copy(&mut stream.take(rest), &mut tokio::io::sink()).await.ok()?;
            let limit = self.limit_bytes;
            return Some(Err(format!("the request is {size} bytes long, the limit is {limit}")));
        }
        let mut body = BytesMut::with_capacity(size);
        while body.len() < size {
            let left = size - body.len();
            if stream.read_buf(&mut (&mut body).limit(left)).await.ok()? == 0 {
                return None;
            }
        }
        counters.received(size + 4);
        Some(Ok(body.freeze()))
    }

    /// Lets a request wait for the user, or says why not.
    fn ask(&self, body: Bytes) -> Result<oneshot::Receiver<Answer>, String> {
        let (answer, receiver) = oneshot::channel();
        let mut state = self.state();
        if state.closed {
            return Err(format!("{:?} has ended", self.service));
        }
        if state.open + state.waiting.len() >= self.pending {
            drop(state);
            self.context.counters.dropped(DropReason::Overloaded);
            let (service, limit) = (self.service.clone(), self.pending);
            return Err(ServeError::Overloaded { service, limit }.to_string());
        }
        state.waiting.push_back(Asked { body, received_at: Instant::now(), answer });
        drop(state);
        self.context.wake.ring();
        Ok(receiver)
    }
}

/// Waits for the answer; `None` where the client goes first.
async fn wait(stream: &TcpStream, mut answer: oneshot::Receiver<Answer>) -> Option<Answer> {
    let ended = || "the server ended before it answered".to_owned();
    let mut next = [0];
    tokio::select! {
        answer = &mut answer => return Some(answer.unwrap_or_else(|_e| Err(ended()))),
        peeked = stream.peek(&mut next) => match peeked {
            Ok(0) | Err(_) => return None,
            // It asks already for what comes next.
            Ok(_) => {}
        },
    }
    Some(answer.await.unwrap_or_else(|_e| Err(ended())))
}

async fn write(stream: &mut TcpStream, answer: Answer) -> std::io::Result<()> {
    let (success, pieces) = match answer {
        Ok(pieces) => (1, pieces),
        Err(text) => (0, vec![Bytes::copy_from_slice(shortened(&text).as_bytes())]),
    };
    let size: usize = pieces.iter().map(Bytes::len).sum();
    let size = u32::try_from(size).map_err(std::io::Error::other)?;
    let mut start = Vec::with_capacity(5);
    start.put_u8(success);
    start.put_u32_le(size);
    let mut all = std::collections::VecDeque::from(pieces);
    // Small pieces in one packet.
    while let Some(piece) = all.front() {
        if piece.len() > 16 * 1024 {
            break;
        }
        start.extend_from_slice(piece);
        all.pop_front();
    }
    stream.write_all(&start).await?;
    for piece in all {
        stream.write_all(&piece).await?;
    }
    stream.flush().await
}
