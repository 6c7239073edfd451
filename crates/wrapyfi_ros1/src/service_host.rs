//! The connections of a service that this node offers.
//!
//! ```text
//!   client ─ header ─▶ fits? ─ request ─▶ Requests ─▶ take
//!            ◀─ 1 size reply │ 0 size why ◀── oneshot ◀─ reply
//! ```
//!
//! One request at a time on a connection, as TCPROS has it. A client that goes away takes its request
//! along, if no program has taken it yet.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use bytes::{BufMut as _, Bytes};
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::sync::{Notify, oneshot};
use tokio::time::timeout;

use super::body::{Bodies, Body};
use super::core::Core;
use super::services::{MAX_ERROR_BYTES, ServiceCodec, ServiceType};
use super::tcpros::{self, Accepted};
use wrapyfi_endpoint::codec::requests;
use wrapyfi_endpoint::requests::Requests;
use wrapyfi_endpoint::{Context, Counters, DropReason, PROGRESS, Share, Wake};

/// Bytes in front of a reply: success, and its size.
pub(super) const HEAD: usize = 5;

/// Answer to a request: the reply, or the reason why there is none.
pub(super) type ServiceResult = Result<Reply, String>;

/// A reply that its server counts as sent. One that is dropped before it is written counts as lost.
pub(super) struct Reply {
    pieces: Vec<Bytes>,
    counters: Arc<Counters>,
    /// Reason as which it counts when it is dropped; `None` once it is written.
    unwritten: Option<DropReason>,
}

impl Reply {
    pub(super) fn new(pieces: Vec<Bytes>, context: &Context) -> Self {
        let counters = Arc::clone(&context.counters);
        Self { pieces, counters, unwritten: Some(DropReason::Closed) }
    }

    /// Size in bytes on the wire.
    pub(super) fn size(&self) -> usize {
        self.pieces.iter().map(Bytes::len).sum::<usize>() + HEAD
    }

    /// Ends a reply that is not counted as lost, or for `reason`.
    pub(super) fn end(mut self, reason: Option<DropReason>) {
        self.unwritten = reason;
    }
}

impl Drop for Reply {
    fn drop(&mut self) {
        if let Some(reason) = self.unwritten {
            self.counters.undelivered(reason, self.size());
        }
    }
}

/// A request, and the way back.
pub(super) struct Ask {
    pub(super) body: Bytes,
    pub(super) answer: oneshot::Sender<ServiceResult>,
}

pub(super) struct ServiceHost {
    service: String,
    wire_type: ServiceType,
    limit_bytes: usize,
    requests: Arc<Requests<Ask>>,
    /// Bytes of the replies that clients have not read yet.
    replies: Share,
    clients: AtomicUsize,
    /// Signal that the service ends.
    end: Notify,
}

impl ServiceHost {
    pub(super) fn new(service: &str, codec: &ServiceCodec, requests: Arc<Requests<Ask>>) -> Self {
        Self {
            service: service.to_owned(),
            wire_type: codec.wire_type.clone(),
            limit_bytes: codec.spec.limits.message_bytes,
            requests,
            replies: Share::default(),
            clients: AtomicUsize::new(0),
            end: Notify::new(),
        }
    }

    pub(super) fn context(&self) -> &Context {
        self.requests.context()
    }

    pub(super) fn wake(&self) -> &Wake {
        &self.context().wake
    }

    pub(super) fn clients(&self) -> usize {
        self.clients.load(Relaxed)
    }

    /// Ends all connections; who waits is told.
    pub(super) fn close(&self) {
        for ask in self.requests.close() {
            let text = format!("{:?} ended before it took the request", self.service);
            _ = ask.answer.send(Err(text));
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
            self.context().counters.dropped(DropReason::Mismatch);
            return tcpros::refuse(&mut stream, &text).await;
        }
        let own = core
            .header()
            .with("service", &self.service)
            .with("type", &self.wire_type.name)
            .with("md5sum", &self.wire_type.md5)
            .with("request_type", &self.wire_type.request)
            .with("response_type", &self.wire_type.response);
        let Ok(own) = own.encode() else { return };
        if stream.write_all(&own).await.is_err() || header.is_set("probe") {
            return;
        }
        let lingers = core.lingering.subscribe();
        if self.requests.is_closed() {
            return;
        }
        self.clients.fetch_add(1, Relaxed);
        self.wake().ring();
        let persistent = matches!(header.get("persistent"), Some("1" | "true" | "True"));
        self.converse(&mut stream, persistent).await;
        self.clients.fetch_sub(1, Relaxed);
        self.wake().ring();
        drop((place, lingers));
    }

    async fn converse(&self, stream: &mut TcpStream, persistent: bool) {
        let bodies = Bodies::new(self.limit_bytes, PROGRESS, Share::default());
        loop {
            let end = self.end.notified();
            tokio::pin!(end);
            end.as_mut().enable();
            if self.requests.is_closed() {
                return;
            }
            let request = tokio::select! {
                request = self.hear(stream, &bodies) => request,
                () = end => return,
            };
            let answer = match request {
                None => return,
                Some(Err(refusal)) => Err(refusal),
                Some(Ok(body)) => {
                    let (answer, receiver) = oneshot::channel();
                    let bytes = body.len() + 4;
                    match self.requests.put(Ask { body, answer }, bytes) {
                        Err((_, refusal)) => Err(refusal.to_string()),
                        Ok(()) => match wait(stream, receiver).await {
                            Some(answer) => answer,
                            None => return,
                        },
                    }
                }
            };
            if self.reply(stream, answer).await.is_err() || !persistent {
                return;
            }
        }
    }

    /// Writes an answer. A reply waits here until its client has read it, and counts as waiting in this process:
    /// without room its client is told. One that is not read is not sent.
    async fn reply(&self, stream: &mut TcpStream, answer: ServiceResult) -> std::io::Result<()> {
        let reply = match answer {
            Ok(reply) => reply,
            Err(why) => return refuse(stream, &why).await,
        };
        let bytes = reply.size();
        if !self.replies.take(bytes) {
            reply.end(Some(DropReason::OverBudget));
            let why = format!(
                "the reply of {bytes} bytes finds no room: others that are not read hold the share of {} of \
                 `limits: {{ waiting_mib }}`",
                self.service
            );
            return refuse(stream, &why).await;
        }
        // Where this task is aborted here, the service ends, and gives back its share as a whole.
        let written = write(stream, 1, &reply.pieces).await;
        self.replies.give(bytes);
        reply.end(written.is_err().then_some(DropReason::ConnectionLost));
        written
    }

    /// The next request; `None` at the end of the connection.
    async fn hear(&self, stream: &mut TcpStream, bodies: &Bodies) -> Option<Result<Bytes, String>> {
        let size = bodies.size(stream).await.ok()??;
        let counters = &self.context().counters;
        match bodies.read(stream, size, "the request").await {
            Ok(Body::Whole(body)) => Some(Ok(body)),
            Ok(Body::Passed { why, reason }) => {
                counters.received(size);
                counters.dropped(why);
                Some(Err(reason))
            }
            Err((ended, begun)) => {
                tracing::debug!(service = self.service, "ROS 1: a request was cut short: {ended}");
                counters.received(begun);
                counters.dropped(ended.drop_reason());
                None
            }
        }
    }
}

/// Waits for the answer; `None` where the client goes first.
async fn wait(
    stream: &TcpStream,
    mut answer: oneshot::Receiver<ServiceResult>,
) -> Option<ServiceResult> {
    let ended = || "the server ended before it answered".to_owned();
    let mut next = [0];
    tokio::select! {
        answer = &mut answer => return Some(answer.unwrap_or_else(|_e| Err(ended()))),
        peeked = stream.peek(&mut next) => match peeked {
            // A reply that was given at the same time counts as lost with the connection.
            Ok(0) | Err(_) => {
                answer.close();
                if let Ok(Ok(reply)) = answer.try_recv() {
                    reply.end(Some(DropReason::ConnectionLost));
                }
                return None;
            }
            // It asks already for what comes next.
            Ok(_) => {}
        },
    }
    Some(answer.await.unwrap_or_else(|_e| Err(ended())))
}

/// Tells a client why it gets no reply.
async fn refuse(stream: &mut TcpStream, why: &str) -> std::io::Result<()> {
    let why = requests::beginning(why, MAX_ERROR_BYTES);
    write(stream, 0, &[Bytes::copy_from_slice(why.as_bytes())]).await
}

async fn write(stream: &mut TcpStream, success: u8, pieces: &[Bytes]) -> std::io::Result<()> {
    let size: usize = pieces.iter().map(Bytes::len).sum();
    let size = u32::try_from(size).map_err(std::io::Error::other)?;
    let mut start = Vec::with_capacity(HEAD);
    start.put_u8(success);
    start.put_u32_le(size);
    // Small pieces in one packet.
    let small = pieces.iter().take_while(|piece| piece.len() <= 16 * 1024);
    let large = pieces.iter().skip(small.clone().count());
    small.for_each(|piece| start.extend_from_slice(piece));
    write_all(stream, &start).await?;
    for piece in large {
        write_all(stream, piece).await?;
    }
    stream.flush().await
}

/// Writes bytes, as long as the client goes on to read them.
async fn write_all(stream: &mut TcpStream, mut bytes: &[u8]) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let written = timeout(PROGRESS, stream.write(bytes)).await??;
        if written == 0 {
            return Err(std::io::ErrorKind::WriteZero.into());
        }
        bytes = bytes.get(written..).unwrap_or_default();
    }
    Ok(())
}
