//! Offers a service through the broker.
//!
//! ```text
//!   take ◀─ Request ◀─ JSON ◀─ envelope kept ◀──────────────── Exchange
//!   reply ─ payload ─▶ mark in the envelope? ─ yes: CDR ─────▶ Exchange
//!                                            └ no: Wrapyfi's form
//! ```

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use super::envelope::{self, ServiceMessage};
use super::exchange::{Delivery, Exchange, ServiceRole};
use super::shared::ZeroMqState;
use super::socket::Socket;
use super::zmtp;
use crate::codec::mark::{self, Kind, Mark};
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::calls::ends;
use wrapyfi_endpoint::codec::requests;
use wrapyfi_endpoint::requests::{Asked, Requests};
use wrapyfi_endpoint::wire_server::{Sent, ServerWire, WireServer};
use wrapyfi_endpoint::{Context, DropReason, Link, Request, ServeError, ServiceSpec};

/// Serves one pair of ports.
pub(super) struct ZeroMqServer {
    spec: ServiceSpec,
    socket: Arc<Socket<Exchange>>,
}

impl ZeroMqServer {
    pub(super) fn open(
        shared: &ZeroMqState,
        broker: SocketAddr,
        spec: &ServiceSpec,
        context: &Context,
    ) -> WireServer<Self> {
        let mut spec = spec.clone();
        // Beyond this the broker would cut the connection.
        spec.limits.message_bytes = spec.limits.message_bytes.min(shared.max_frame_bytes);
        shared.ledger.enter(zmtp::Kind::Router, &spec.service, &context.counters);
        let requests = Arc::new(Requests::new(&spec, context));
        let end = ServiceRole::Server(Arc::clone(&requests));
        let socket = Exchange::open(shared, broker, end, &spec, context);
        WireServer::new(Self { spec: spec.clone(), socket }, requests, &spec)
    }
}

impl ServerWire for ZeroMqServer {
    type Ask = Delivery;
    type Answer = ServiceMessage;

    fn is_given_up(&self, asked: &Asked<Delivery>) -> bool {
        let mark = envelope::mark(&asked.ask.envelope);
        // Without a mark it is not known how long the client waits.
        let timeout =
            mark.map_or(Duration::MAX, |mark| Duration::from_millis(mark.timeout_ms.into()));
        ends(asked.received_at, timeout) <= self.socket.context.clock.now()
    }

    fn read(&self, delivery: &Delivery) -> Result<Request, DecodeError> {
        if let Some(mark) = envelope::mark(&delivery.envelope) {
            let (wanted, served) = (mark.content.message_type().data_type(), self.spec.kind);
            if mark.kind != Kind::Request || wanted != served.data_type() {
                return Err(DecodeError::mismatch(
                    format!("a request for {}, which is what it returns", served.data_type()),
                    format!("one for {wanted}"),
                ));
            }
        }
        match &delivery.body {
            Ok(body) => requests::decode_request(body, &self.spec),
            Err(why) => Err(why.fault("request", self.spec.limits.message_bytes)),
        }
    }

    /// A reply as the caller reads it.
    fn write(&self, delivery: &Delivery, payload: &Payload) -> Result<ServiceMessage, EncodeError> {
        let mut envelope = delivery.envelope.clone();
        let Some(mark) = envelope::mark(&envelope) else {
            let body = requests::encode_reply(payload, &self.spec)?.into();
            return Ok(ServiceMessage { envelope, body });
        };
        let (content, body) = mark::encode(payload, &self.spec)?;
        envelope::stamp(&mut envelope, Mark { kind: Kind::Binary, content, ..mark });
        Ok(ServiceMessage { envelope, body })
    }

    fn send(&mut self, delivery: Delivery, answer: Result<ServiceMessage, &str>) -> Sent {
        let is_reply = answer.is_ok();
        let message = answer.unwrap_or_else(|why| ServiceMessage::error(delivery.envelope, why));
        let bytes = message.size();
        let Err(ServiceMessage { envelope, .. }) = self.socket.post(message, None) else {
            return Ok(Some(bytes));
        };
        let error = ServeError::NoRoom { service: self.spec.service.clone(), bytes };
        if is_reply {
            self.socket.context.counters.dropped(DropReason::OverBudget);
            // Short, and so it may find room.
            self.socket.refuse(envelope, &error.to_string());
        }
        Err(error)
    }

    fn link(&self) -> Link {
        // A broker does not tell servers who calls.
        Link { peers: None, waiting_for: self.socket.link.waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqServer {
    fn drop(&mut self) {
        self.socket.close();
    }
}
