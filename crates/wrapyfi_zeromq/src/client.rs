//! Calls a service through the broker.
//!
//! ```text
//!   send ─ JSON ─▶ Calls ── the broker is reached ──▶ mark, "", JSON ──▶ Exchange
//!   take ◀─ payload, error ◀─ mark: whose call, which form ◀─────────── Exchange
//! ```

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;

use super::envelope::{self, ServiceMessage};
use super::exchange::{Delivery, Exchange, ServiceRole, Unusable};
use super::ledger::Ledger;
use super::shared::ZeroMqState;
use super::socket::Socket;
use super::{deadline, zmtp};
use crate::codec::mark::{self, Content, Kind, Mark};
use wrapyfi_data::EncodeResult;
use wrapyfi_data::types::{Payload, Stamp};
use wrapyfi_endpoint::calls::{Calls, Stage};
use wrapyfi_endpoint::codec::requests;
use wrapyfi_endpoint::wire_client::{ClientWire, WireClient};
use wrapyfi_endpoint::{CallError, Context, DropReason, Link, Request, ServiceSpec};

/// A request until it is sent.
pub(super) struct Outgoing {
    body: Bytes,
    deadline: Instant,
}

/// Calls the service on one pair of ports.
pub(super) struct ZeroMqClient {
    spec: ServiceSpec,
    socket: Arc<Socket<Exchange>>,
    ledger: Arc<Ledger>,
    number: i64,
}

impl ZeroMqClient {
    pub(super) fn open(
        shared: &ZeroMqState,
        broker: SocketAddr,
        spec: &ServiceSpec,
        context: &Context,
    ) -> WireClient<Self> {
        let mut spec = spec.clone();
        // Beyond this the broker would cut the connection.
        spec.limits.message_bytes = spec.limits.message_bytes.min(shared.max_frame_bytes);
        let socket = Exchange::open(shared, broker, ServiceRole::Client, &spec, context);
        shared.ledger.enter(zmtp::Kind::Dealer, &spec.service, &context.counters);
        let (service, pending) = (spec.service.clone(), spec.pending);
        let ledger = Arc::clone(&shared.ledger);
        WireClient::new(Self { spec, socket, ledger, number: 0 }, &service, pending, context)
    }

    fn deliver(&self, delivery: &Delivery, calls: &mut Calls<Outgoing>) {
        let mark = envelope::mark(&delivery.envelope);
        let call = mark.and_then(|mark| Some((mark, i64::try_from(mark.number).ok()?)));
        let Some((mark, number)) = call else {
            // No server hands back another envelope than ours.
            self.socket.context.counters.received(delivery.wire_bytes);
            self.socket.context.counters.dropped(DropReason::Malformed);
            return;
        };
        let (spec, body) = (&self.spec, &delivery.body);
        let answer = || read(mark, body.as_ref(), spec);
        calls.answered(number, delivery.wire_bytes, delivery.received_at, answer);
    }
}

/// Turns a reply into its payload, or into the caller's error.
fn read(
    mark: Mark,
    body: Result<&Bytes, &Unusable>,
    spec: &ServiceSpec,
) -> Result<Payload, CallError> {
    let unusable = |fault| CallError::Reply { service: spec.service.clone(), fault };
    let refused = |reason| CallError::Refused { service: spec.service.clone(), reason };
    let body = body.map_err(|why| unusable(why.fault("reply", spec.limits.message_bytes)))?;
    match mark.kind {
        Kind::Request => {
            requests::decode_reply(body, spec, Stamp::now()).map_err(unusable)?.map_err(refused)
        }
        Kind::Binary => mark::decode(mark.content, body, spec).map_err(unusable),
        Kind::Error => Err(refused(String::from_utf8_lossy(body).into_owned())),
    }
}

impl ClientWire for ZeroMqClient {
    type Written = Outgoing;

    fn write(&self, request: &Request, deadline: Instant) -> EncodeResult<(Outgoing, usize)> {
        let body = requests::encode_request(request, &self.spec)?;
        let bytes = body.len();
        Ok((Outgoing { body: body.into(), deadline }, bytes))
    }

    fn turn(&mut self, calls: &mut Calls<Outgoing>) {
        while self.socket.link.is_up() && calls.next_to_send().is_some() {
            self.number += 1;
            let Some(Outgoing { body, deadline }) = calls.send(self.number) else { break };
            let content = Content::of(self.spec.kind.message_type());
            let mark =
                deadline::request(content, self.number.unsigned_abs(), deadline, calls.clock());
            let envelope = vec![Bytes::from(mark.encode())];
            // A request counts with its call, and finds room.
            _ = self.socket.post(ServiceMessage { envelope, body }, Some(deadline));
        }
        while let Some(delivery) = self.socket.take() {
            self.deliver(&delivery, calls);
        }
    }

    fn missing(&self, stage: Stage) -> String {
        match (stage, self.socket.link.waiting_for()) {
            (Stage::Waiting, Some(what)) => format!("still waiting for {what}"),
            (Stage::Waiting, None) => "the broker was reached too late".to_owned(),
            (Stage::Sent, Some(what)) => {
                format!("lost {what} after it was sent: it may have been carried out, or not")
            }
            (Stage::Sent, None) if *self.ledger.servers.lock() == Some(0) => {
                "no server is connected to the broker".to_owned()
            }
            (Stage::Sent, None) => {
                "no server is there, or it has not answered; on ZeroMQ a broker \
                                    does not tell which"
                    .to_owned()
            }
        }
    }

    fn link(&self) -> Link {
        // A broker does not tell clients who serves; the one in this process does.
        let peers = *self.ledger.servers.lock();
        Link { peers, waiting_for: self.socket.link.waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqClient {
    fn drop(&mut self) {
        self.socket.close();
    }
}
