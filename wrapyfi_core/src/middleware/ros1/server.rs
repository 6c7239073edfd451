//! Offers a service: requests from the host's queue, answers back to their connections.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;
use tokio::sync::oneshot;

use super::NAME;
use super::core::Core;
use super::marks::Marked;
use super::service_host::{Answer, Asked, ServiceHost};
use super::services::ServiceForm;
use crate::endpoint::calls::ends;
use crate::endpoint::{
    Context, DropReason, IncomingRequest, Link, OpenError, RequestId, Role, ServeError, Server,
    ServiceSpec,
};
use crate::types::Payload;

/// A request with the user.
struct Open {
    answer: oneshot::Sender<Answer>,
    received_at: Instant,
    until: Instant,
}

/// Offers one service.
pub(super) struct Ros1Server {
    core: Arc<Core>,
    service: String,
    marked: Option<Marked>,
    form: ServiceForm,
    host: Arc<ServiceHost>,
    open: BTreeMap<RequestId, Open>,
    next: u64,
}

impl Ros1Server {
    pub(super) fn open(
        core: &Arc<Core>,
        service: &str,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        let form = ServiceForm::new(core, spec)?;
        let host = Arc::new(ServiceHost::new(service, &form, context));
        if !core.offer(service, &host) {
            return Err(OpenError::Transport {
                middleware: NAME,
                topic: spec.service.clone(),
                reason: format!("this node offers {service} already; a name has one server"),
            });
        }
        let marked = spec.mark.clone().map(|mark| Marked {
            role: Role::Server,
            name: service.to_owned(),
            node: core.name.full().to_owned(),
            mark,
        });
        if let Some(marked) = &marked {
            core.mark(marked);
        }
        Ok(Self {
            core: Arc::clone(core),
            service: service.to_owned(),
            marked,
            form,
            host,
            open: BTreeMap::new(),
            next: 0,
        })
    }

    fn dropped(&self, reason: DropReason) {
        self.host.context().counters.dropped(reason);
    }

    fn timeout_ms(&self) -> u64 {
        u64::try_from(self.form.spec.timeout.as_millis()).unwrap_or(u64::MAX)
    }

    fn close(&mut self, id: RequestId) -> Option<Open> {
        let open = self.open.remove(&id);
        self.host.set_open(self.open.len());
        open
    }

    fn end_expired(&mut self) {
        let now = Instant::now();
        let over = self.open.iter().filter(|(_, open)| open.until <= now);
        let over: Vec<RequestId> = over.map(|(id, _)| *id).collect();
        for id in over {
            let Some(open) = self.close(id) else { continue };
            self.dropped(DropReason::Expired);
            let text = format!(
                "{:?} did not answer within {} ms",
                self.form.spec.service,
                self.timeout_ms()
            );
            _ = open.answer.send(Err(text));
        }
    }
}

impl Server for Ros1Server {
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        self.end_expired();
        let Some(Asked { body, received_at, answer }) = self.host.take() else { return Ok(None) };
        match self.form.decode_request(&body) {
            Ok(request) => {
                self.next += 1;
                let id = RequestId(self.next);
                let until = ends(Instant::now(), self.form.spec.timeout);
                self.open.insert(id, Open { answer, received_at, until });
                self.host.set_open(self.open.len());
                let wire_bytes = body.len() + 4;
                Ok(Some(IncomingRequest { id, request, wire_bytes, received_at }))
            }
            Err(fault) => {
                self.host.set_open(self.open.len());
                let reason = fault.drop_reason();
                self.dropped(reason);
                let (service, fault) = (self.form.spec.service.clone(), fault.to_string());
                let error = ServeError::Request { service, fault, reason };
                _ = answer.send(Err(error.to_string()));
                Err(error)
            }
        }
    }

    fn reply(
        &mut self,
        id: RequestId,
        payload: Result<Payload, String>,
    ) -> Result<usize, ServeError> {
        let Open { answer, received_at, .. } =
            self.close(id).ok_or_else(|| ServeError::NotWaiting {
                service: self.form.spec.service.clone(),
                timeout_ms: self.timeout_ms(),
            })?;
        let reply = match payload {
            Err(reason) => Err(reason),
            Ok(payload) => match self.form.encode_reply(&payload) {
                Ok(pieces) => Ok(pieces),
                Err(fault) => {
                    self.dropped(DropReason::Unencodable);
                    let error =
                        ServeError::Reply { service: self.form.spec.service.clone(), fault };
                    _ = answer.send(Err(error.to_string()));
                    return Err(error);
                }
            },
        };
        let bytes = 5 + match &reply {
            Ok(pieces) => pieces.iter().map(Bytes::len).sum(),
            Err(reason) => reason.len(),
        };
        if answer.send(reply).is_err() {
            // Its client has gone.
            self.dropped(DropReason::Late);
            return Ok(0);
        }
        self.host.context().counters.sent(bytes, received_at.elapsed());
        Ok(bytes)
    }

    fn deadline(&self) -> Option<Instant> {
        self.open.values().map(|open| open.until).min()
    }

    fn link(&self) -> Link {
        let fault = self.core.fault();
        Link { peers: Some(self.host.clients()), waiting_for: fault, keeps_last: false }
    }
}

impl Drop for Ros1Server {
    fn drop(&mut self) {
        if let Some(marked) = &self.marked {
            self.core.unmark(marked);
        }
        for open in std::mem::take(&mut self.open).into_values() {
            let text = format!("{:?} ended before it answered", self.form.spec.service);
            _ = open.answer.send(Err(text));
        }
        self.host.close();
        self.core.withdraw(&self.service);
    }
}
