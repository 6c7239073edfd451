//! Offers a service through the broker.
//!
//! ```text
//!   take ◀─ Request ◀─ JSON ◀─ envelope kept ◀──────────────── Line
//!   reply ─ payload ─▶ mark in the envelope? ─ yes: CDR ─────▶ Line
//!                                            └ no: Wrapyfi's form
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::envelope::{self, Parcel};
use super::line::{Delivery, End, Line, Post, Unusable};
use super::{Shared, transport};
use crate::codec::requests::mark::{Kind, Mark};
use crate::codec::requests::{self};
use crate::endpoint::calls::ends;
use crate::endpoint::{
    Context, DropReason, IncomingRequest, Link, OpenError, Request, RequestId, ServeError, Server,
    ServiceSpec,
};
use crate::types::Payload;
use crate::{DecodeError, EncodeError};

/// A request with the user.
struct Open {
    envelope: Vec<Bytes>,
    received_at: Instant,
    until: Instant,
}

/// Serves one pair of ports.
pub(super) struct ZeroMqServer {
    spec: ServiceSpec,
    post: Arc<Post>,
    open: BTreeMap<RequestId, Open>,
    next: u64,
}

impl ZeroMqServer {
    pub(super) fn open(
        shared: &Shared,
        endpoint: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        let mut spec = spec.clone();
        // Beyond this the broker would cut the connection.
        spec.limits.message_bytes = spec.limits.message_bytes.min(shared.max_frame_bytes);
        let post = Line::open(shared, endpoint, End::Server, &spec, context)
            .map_err(|error| transport(&spec.service, error))?;
        Ok(Self { spec, post, open: BTreeMap::new(), next: 0 })
    }

    fn dropped(&self, reason: DropReason) {
        self.post.context().counters.dropped(reason);
    }

    fn timeout_ms(&self) -> u64 {
        u64::try_from(self.spec.timeout.as_millis()).unwrap_or(u64::MAX)
    }

    fn close(&mut self, id: RequestId) -> Option<Open> {
        let open = self.open.remove(&id);
        self.post.set_open(self.open.len());
        open
    }

    fn end_expired(&mut self) {
        let now = Instant::now();
        let over = self.open.iter().filter(|(_, open)| open.until <= now);
        let over: Vec<RequestId> = over.map(|(id, _)| *id).collect();
        for id in over {
            let Some(open) = self.close(id) else { continue };
            self.dropped(DropReason::Expired);
            let text =
                format!("{:?} did not answer within {} ms", self.spec.service, self.timeout_ms());
            self.post.send(Parcel::error(open.envelope, &text), None);
        }
    }

    /// The call in a message that came.
    fn read(&self, delivery: &Delivery, mark: Option<Mark>) -> Result<Request, DecodeError> {
        if let Some(mark) = mark {
            let (wanted, served) = (mark.content.message_type().data_type(), self.spec.kind);
            if mark.kind != Kind::Request || wanted != served.data_type() {
                return Err(DecodeError::Mismatch {
                    expected: format!(
                        "a request for {}, which is what it returns",
                        served.data_type()
                    ),
                    actual: format!("one for {wanted}"),
                });
            }
        }
        match &delivery.body {
            Ok(body) => requests::decode_request(body, &self.spec),
            Err(Unusable::TooLarge(size)) => Err(DecodeError::TooLarge {
                what: "message",
                path: "$".into(),
                actual: *size as u64,
                limit: self.spec.limits.message_bytes as u64,
            }),
            Err(Unusable::Frames(frames)) => Err(DecodeError::Mismatch {
                expected: "a request of one frame".into(),
                actual: format!("{frames} frames"),
            }),
        }
    }
}

/// How long after `received_at` the caller of a request waits, where it says so.
fn patience(mark: Option<Mark>) -> Duration {
    mark.map_or(Duration::MAX, |mark| Duration::from_millis(mark.timeout_ms.into()))
}

/// A reply as the caller reads it.
fn answer(
    mut envelope: Vec<Bytes>,
    payload: &Payload,
    spec: &ServiceSpec,
) -> Result<Parcel, EncodeError> {
    let Some(mark) = envelope::mark(&envelope) else {
        let body = requests::encode_reply(payload, spec)?.into();
        return Ok(Parcel { envelope, body });
    };
    let (content, body) = requests::encode_binary(payload, spec)?;
    envelope::stamp(&mut envelope, Mark { kind: Kind::Binary, content, ..mark });
    Ok(Parcel { envelope, body })
}

impl Server for ZeroMqServer {
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        self.end_expired();
        loop {
            let Some(delivery) = self.post.take() else { return Ok(None) };
            let mark = envelope::mark(&delivery.envelope);
            let given_up = ends(delivery.received_at, patience(mark));
            if given_up <= Instant::now() {
                // Its caller does not wait any more: what it asked for must not happen late.
                self.dropped(DropReason::Expired);
                continue;
            }
            let Delivery { wire_bytes, received_at, .. } = delivery;
            match self.read(&delivery, mark) {
                Ok(request) => {
                    self.next += 1;
                    let id = RequestId(self.next);
                    let until = ends(Instant::now(), self.spec.timeout);
                    let open = Open { envelope: delivery.envelope, received_at, until };
                    self.open.insert(id, open);
                    self.post.set_open(self.open.len());
                    return Ok(Some(IncomingRequest { id, request, wire_bytes, received_at }));
                }
                Err(fault) => {
                    let reason = fault.drop_reason();
                    self.dropped(reason);
                    let (service, fault) = (self.spec.service.clone(), fault.to_string());
                    let error = ServeError::Request { service, fault, reason };
                    self.post.send(Parcel::error(delivery.envelope, &error.to_string()), None);
                    return Err(error);
                }
            }
        }
    }

    fn reply(
        &mut self,
        id: RequestId,
        payload: Result<Payload, String>,
    ) -> Result<usize, ServeError> {
        let Open { envelope, received_at, .. } =
            self.close(id).ok_or_else(|| ServeError::NotWaiting {
                service: self.spec.service.clone(),
                timeout_ms: self.timeout_ms(),
            })?;
        let parcel = match payload {
            Err(reason) => Parcel::error(envelope, &reason),
            Ok(payload) => match answer(envelope.clone(), &payload, &self.spec) {
                Ok(parcel) => parcel,
                Err(fault) => {
                    self.dropped(DropReason::Unencodable);
                    let error = ServeError::Reply { service: self.spec.service.clone(), fault };
                    self.post.send(Parcel::error(envelope, &error.to_string()), None);
                    return Err(error);
                }
            },
        };
        let bytes = parcel.size();
        self.post.send(parcel, None);
        self.post.context().counters.sent(bytes, received_at.elapsed());
        Ok(bytes)
    }

    fn deadline(&self) -> Option<Instant> {
        self.open.values().map(|open| open.until).min()
    }

    fn link(&self) -> Link {
        // A broker does not tell servers who calls.
        Link { peers: None, waiting_for: self.post.link().waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqServer {
    fn drop(&mut self) {
        // Those who wait learn at once that nobody will answer.
        for open in std::mem::take(&mut self.open).into_values() {
            let text = format!("{:?} ended before it answered", self.spec.service);
            self.post.send(Parcel::error(open.envelope, &text), None);
        }
        while let Some(delivery) = self.post.take() {
            let text = format!("{:?} ended before it took the request", self.spec.service);
            self.post.send(Parcel::error(delivery.envelope, &text), None);
        }
        self.post.close();
    }
}
