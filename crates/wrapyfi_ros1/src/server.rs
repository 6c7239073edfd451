//! Offers a service: requests of the host's connections, answers back to them.

use std::sync::Arc;

use bytes::Bytes;

use super::config::NAME;
use super::node::{Mark, Node};
use super::service_host::{Ask, HEAD, Reply, ServiceHost};
use super::services::ServiceCodec;
use wrapyfi_data::types::Payload;
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::requests::{Asked, Requests};
use wrapyfi_endpoint::wire_server::{Sent, ServerWire, WireServer};
use wrapyfi_endpoint::{Context, Link, OpenError, OpenResult, Request, Role, ServiceSpec};

/// Offers one service.
pub(super) struct Ros1Server {
    node: Arc<Node>,
    service: String,
    /// Told to other bridges while the server lives.
    _mark: Option<Mark>,
    codec: ServiceCodec,
    host: Arc<ServiceHost>,
}

impl Ros1Server {
    pub(super) fn open(
        node: &Arc<Node>,
        service: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> OpenResult<WireServer<Self>> {
        let codec = ServiceCodec::new(node, spec, None)?;
        let requests = Arc::new(Requests::new(spec, context));
        let host = Arc::new(ServiceHost::new(service, &codec, Arc::clone(&requests)));
        if !node.offer(service, &host) {
            return Err(OpenError::transport(
                NAME,
                &spec.service,
                format!("this node offers {service} already; a name has one server"),
            ));
        }
        let mark = node.mark(Role::Server, service, &spec.mark);
        let (node, service) = (Arc::clone(node), service.to_owned());
        Ok(WireServer::new(Self { node, service, _mark: mark, codec, host }, requests, spec))
    }
}

impl ServerWire for Ros1Server {
    type Ask = Ask;
    type Answer = Vec<Bytes>;

    /// A client that has gone took its request along.
    fn is_given_up(&self, asked: &Asked<Ask>) -> bool {
        asked.ask.answer.is_closed()
    }

    fn read(&self, ask: &Ask) -> Result<Request, DecodeError> {
        self.codec.decode_request(&ask.body)
    }

    fn write(&self, _ask: &Ask, payload: &Payload) -> Result<Vec<Bytes>, EncodeError> {
        self.codec.encode_reply(payload)
    }

    fn send(&mut self, ask: Ask, answer: Result<Vec<Bytes>, &str>) -> Sent {
        let answer = answer.map_err(str::to_owned);
        let answer = answer.map(|pieces| Reply::new(pieces, self.host.context()));
        let bytes = answer.as_ref().map_or_else(|why| why.len() + HEAD, Reply::size);
        Ok(match ask.answer.send(answer) {
            Ok(()) => Some(bytes),
            Err(answer) => {
                // It does not count as sent.
                answer.into_iter().for_each(|reply| reply.end(None));
                None
            }
        })
    }

    fn link(&self) -> Link {
        let fault = self.node.fault();
        Link { peers: Some(self.host.clients()), waiting_for: fault, keeps_last: false }
    }
}

impl Drop for Ros1Server {
    fn drop(&mut self) {
        self.host.close();
        self.node.withdraw(&self.service);
    }
}
