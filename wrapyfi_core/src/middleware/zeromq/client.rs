//! Calls a service through the broker.
//!
//! ```text
//!   send ─ JSON ─▶ Book ── the broker is reached ──▶ mark, "", JSON ──▶ Line
//!   take ◀─ payload, error ◀─ mark: whose call, which form ◀─────────── Line
//! ```

use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::deadline;
use super::envelope::{self, Parcel};
use super::line::{Delivery, End, Line, Post, Unusable};
use super::{Shared, transport};
use crate::DecodeError;
use crate::codec::requests::mark::{Content, Kind, Mark};
use crate::codec::requests::{self};
use crate::endpoint::book::Book;
use crate::endpoint::calls::{Stage, ends};
use crate::endpoint::{
    CallError, Client, Context, DropReason, Link, OpenError, Reply, Request, ServiceSpec, Ticket,
    Wake,
};
use crate::types::{Payload, Stamp};

/// A request until it is sent.
struct Outgoing {
    body: Bytes,
    deadline: Instant,
}

/// Calls the service on one pair of ports.
pub(super) struct ZeroMqClient {
    spec: ServiceSpec,
    book: Book<Outgoing>,
    post: Arc<Post>,
    number: i64,
}

impl ZeroMqClient {
    pub(super) fn open(
        shared: &Shared,
        endpoint: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        let mut spec = spec.clone();
        // Beyond this the broker would cut the connection.
        spec.limits.message_bytes = spec.limits.message_bytes.min(shared.max_frame_bytes);
        let post = Line::open(shared, endpoint, End::Client, &spec, context)
            .map_err(|error| transport(&spec.service, error))?;
        let book = Book::new(&spec.service, spec.pending, &context.counters);
        Ok(Self { spec, book, post, number: 0 })
    }

    /// Sends what can be sent, takes what has come, ends what took too long.
    fn turn(&mut self) {
        while self.post.link().is_up() && self.book.next_to_send().is_some() {
            self.number += 1;
            let Some(Outgoing { body, deadline }) = self.book.send(self.number) else { break };
            let content = Content::of(self.spec.kind.message_type());
            let mark = deadline::request(content, self.number.unsigned_abs(), deadline);
            let envelope = vec![Bytes::from(mark.encode())];
            self.post.send(Parcel { envelope, body }, Some(deadline));
        }
        while let Some(delivery) = self.post.take() {
            self.deliver(&delivery);
        }
        let link = self.post.link();
        self.book.expire(|stage| match (stage, link.waiting_for()) {
            (Stage::Waiting, Some(what)) => format!("still waiting for {what}"),
            (Stage::Waiting, None) => "the broker was reached too late".to_owned(),
            (Stage::Sent, Some(what)) => {
                format!("lost {what} after it was sent: it may have been carried out, or not")
            }
            (Stage::Sent, None) => {
                "no server is there, or it has not answered; on ZeroMQ a broker \
                                    does not tell which"
                    .to_owned()
            }
        });
    }

    fn deliver(&mut self, delivery: &Delivery) {
        let mark = envelope::mark(&delivery.envelope);
        let call = mark.and_then(|mark| Some((mark, i64::try_from(mark.number).ok()?)));
        let Some((mark, number)) = call else {
            // Nobody hands back another envelope than ours.
            self.post.context().counters.received(delivery.wire_bytes);
            self.post.context().counters.dropped(DropReason::Malformed);
            return;
        };
        let (spec, body) = (&self.spec, &delivery.body);
        let answer = || read(mark, body.as_ref(), spec);
        self.book.answered(number, delivery.wire_bytes, delivery.received_at, answer);
    }
}

/// What a reply says.
fn read(
    mark: Mark,
    body: Result<&Bytes, &Unusable>,
    spec: &ServiceSpec,
) -> Result<Payload, CallError> {
    let unusable = |fault| CallError::Reply { service: spec.service.clone(), fault };
    let refused = |reason| CallError::Refused { service: spec.service.clone(), reason };
    let body = body.map_err(|why| {
        unusable(match *why {
            Unusable::TooLarge(size) => DecodeError::TooLarge {
                what: "message",
                path: "$".into(),
                actual: size as u64,
                limit: spec.limits.message_bytes as u64,
            },
            Unusable::Frames(frames) => DecodeError::Mismatch {
                expected: "a reply of one frame".into(),
                actual: format!("{frames} frames"),
            },
        })
    })?;
    match mark.kind {
        Kind::Request => {
            requests::decode_reply(body, spec, Stamp::now()).map_err(unusable)?.map_err(refused)
        }
        Kind::Binary => requests::decode_binary(mark.content, body, spec).map_err(unusable),
        Kind::Error => Err(refused(String::from_utf8_lossy(body).into_owned())),
    }
}

impl Client for ZeroMqClient {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        let body = requests::encode_request(request, &self.spec)
            .map_err(|fault| CallError::Request { service: self.spec.service.clone(), fault })?;
        let deadline = ends(Instant::now(), timeout);
        let ticket = self.book.begin(Outgoing { body: body.into(), deadline }, timeout)?;
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
        // A broker does not tell clients who serves.
        Link { peers: None, waiting_for: self.post.link().waiting_for(), keeps_last: false }
    }

    fn wake(&self) -> &Wake {
        &self.post.context().wake
    }
}

impl Drop for ZeroMqClient {
    fn drop(&mut self) {
        self.post.close();
    }
}
