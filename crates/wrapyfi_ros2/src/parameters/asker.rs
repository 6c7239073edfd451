//! A client of one service whose type is known when this is built.
//!
//! ```text
//!   S::Request ─ CDR ─▶ Ros2Client ─▶ … ─ CDR ─▶ S::Response
//! ```

use std::marker::PhantomData;
use std::time::{Duration, Instant};

use wrapyfi_interfaces::{Message, Service};

use super::{ParameterClientError, ParameterResult, ServiceOptions};
use crate::graph::Peers;
use crate::ros2::{Ros2, no_service};
use crate::service::Ros2Client;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Payload, RosMessage, RosService, ServiceKind};
use wrapyfi_endpoint::wire_client::WireClient;
use wrapyfi_endpoint::{CallError, Client, Context, Reply, Request, ServiceSpec, Ticket, Wake};
use wrapyfi_node::parameters::ParameterService;

pub(super) struct Asker<S> {
    client: WireClient<Ros2Client>,
    service: RosService,
    /// Name of the service, behind the name of the node.
    name: &'static str,
    node: String,
    timeout: Duration,
    _service: PhantomData<fn() -> S>,
}

impl<S: Service> Asker<S> {
    pub(super) fn open(
        ros2: &Ros2,
        node: &str,
        which: ParameterService,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> ParameterResult<Self> {
        let name = which.name();
        let service = RosService::of::<S>().map_err(|error| {
            no_service(&ServiceSpec::new(S::ROS_TYPE, ServiceKind::NativeObject), &error)
        })?;
        let spec = ServiceSpec {
            timeout: options.timeout,
            limits: Limits { message_bytes: options.max_bytes, ..Limits::default() },
            ..ServiceSpec::new(format!("{node}/{name}"), ServiceKind::Ros(service))
        };
        let context = Context { wake: wake.clone(), ..Context::default() };
        let client = Ros2Client::open(ros2, &spec, ParameterService::DEPTH, &context)?;
        let (node, timeout) = (node.to_owned(), options.timeout);
        Ok(Self { client, service, name, node, timeout, _service: PhantomData })
    }

    /// Servers there are now.
    pub(super) fn servers(&self) -> Peers {
        self.client.wire().servers()
    }

    /// Time of the next poll though nothing rang.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.client.deadline()
    }

    /// Begins a call that [`Asker::poll`] will end.
    pub(super) fn begin(&mut self, request: &S::Request) -> ParameterResult<Ticket> {
        let request = self.message(request);
        Ok(self.client.send(&request, self.timeout)?)
    }

    /// A call that has ended.
    pub(super) fn poll(&mut self) -> Option<(Ticket, Result<S::Response, ParameterClientError>)> {
        let (ticket, result) = self.client.take()?;
        Some((ticket, self.response(result)))
    }

    pub(super) fn cancel(&mut self, ticket: Ticket) {
        self.client.cancel(ticket);
    }

    /// Calls, and waits for the reply.
    pub(super) fn ask(&mut self, request: &S::Request) -> ParameterResult<S::Response> {
        let request = self.message(request);
        let result = self.client.call(&request, self.timeout);
        self.response(result)
    }

    /// A reply that cannot be used.
    pub(super) fn fault(&self, fault: impl Into<String>) -> ParameterClientError {
        let (node, service) = (self.node.clone(), self.name);
        ParameterClientError::Reply { node, service, fault: fault.into() }
    }

    fn message(&self, request: &S::Request) -> Request {
        Request::Message(RosMessage::new(self.service.request(), request.encode()))
    }

    fn response(&self, result: Result<Reply, CallError>) -> ParameterResult<S::Response> {
        let reply = match result {
            Ok(reply) => reply,
            Err(CallError::TimedOut { service, timeout_ms, .. })
                if self.client.wire().servers() == Peers::None =>
            {
                let node = self.node.clone();
                return Err(ParameterClientError::Absent { node, service, timeout_ms });
            }
            Err(error) => return Err(error.into()),
        };
        let Payload::RosMessage(message) = reply.payload else {
            return Err(self.fault("no message"));
        };
        S::Response::decode(&message.cdr, usize::MAX).map_err(|e| self.fault(e.to_string()))
    }
}
