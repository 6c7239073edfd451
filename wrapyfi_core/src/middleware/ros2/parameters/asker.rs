//! A client of one service whose type is known when this is built.
//!
//! ```text
//!   S::Request ─ CDR ─▶ DynamicMessage ─▶ AnyClient ─▶ … ─▶ DynamicMessage ─ CDR ─▶ S::Response
//! ```
//!
//! By way of [`AnyClient`], so that there is one place that knows how calls wait, end and are late.

use std::marker::PhantomData;
use std::time::Instant;

use wrapyfi_interfaces::dynamic::DynamicMessage;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::{Message, Service};

use super::ParameterClientError;
use crate::endpoint::Wake;
use crate::middleware::ros2::graph::Peers;
use crate::middleware::ros2::{
    AnyClient, AnyError, CallError, Ros2, ServiceOptions, ServiceType, Ticket,
};
use crate::node::parameters::ParameterService;

pub(super) struct Asker<S> {
    client: AnyClient,
    service: ServiceType,
    /// Behind the name of the node.
    name: &'static str,
    node: String,
    options: ServiceOptions,
    _service: PhantomData<fn() -> S>,
}

impl<S: Service> Asker<S> {
    pub(super) fn open(
        ros2: &Ros2,
        node: &str,
        which: ParameterService,
        options: &ServiceOptions,
        wake: &Wake,
    ) -> Result<Self, ParameterClientError> {
        let definition = |fault: String| AnyError::Open(format!("{}: {fault}", S::ROS_TYPE));
        let resolved = TypeStore::generated()
            .resolve_name(S::ROS_TYPE)
            .map_err(|error| definition(error.to_string()))?;
        let service = ServiceType::new(&resolved)?;
        let name = which.name();
        let path = format!("{node}/{name}");
        let client = AnyClient::open(ros2, &path, service.clone(), options, wake)?;
        let (node, options) = (node.to_owned(), options.clone());
        Ok(Self { client, service, name, node, options, _service: PhantomData })
    }

    /// Servers there are now.
    pub(super) fn servers(&self) -> Peers {
        self.client.servers()
    }

    /// When to poll again though nothing rang.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.client.deadline()
    }

    /// Begins a call that [`Asker::poll`] will end.
    pub(super) fn begin(&mut self, request: &S::Request) -> Result<Ticket, ParameterClientError> {
        let request = self.dynamic(request)?;
        Ok(self.client.call(&request)?)
    }

    /// A call that has ended.
    pub(super) fn poll(&mut self) -> Option<(Ticket, Result<S::Response, ParameterClientError>)> {
        let (ticket, result) = self.client.poll()?;
        Some((ticket, self.response(result)))
    }

    pub(super) fn cancel(&mut self, ticket: Ticket) {
        self.client.cancel(ticket);
    }

    /// Calls, and waits for the reply.
    pub(super) fn ask(
        &mut self,
        request: &S::Request,
    ) -> Result<S::Response, ParameterClientError> {
        let request = self.dynamic(request)?;
        let result = self.client.call_and_wait(&request);
        self.response(result)
    }

    /// A reply that cannot be used.
    pub(super) fn fault(&self, fault: impl Into<String>) -> ParameterClientError {
        let (node, service) = (self.node.clone(), self.name);
        ParameterClientError::Reply { node, service, fault: fault.into() }
    }

    fn dynamic(&self, request: &S::Request) -> Result<DynamicMessage, ParameterClientError> {
        let cdr = request.encode().to_bytes();
        let plan = self.service.request();
        plan.decode(&cdr, self.options.max_bytes).map_err(|fault| {
            CallError::Graph(crate::middleware::ros2::graph::GraphError::Stack {
                operation: "writing a request",
                topic: self.client.name().to_owned(),
                reason: fault.to_string(),
            })
            .into()
        })
    }

    fn response(
        &self,
        result: Result<DynamicMessage, CallError>,
    ) -> Result<S::Response, ParameterClientError> {
        let reply = match result {
            Ok(reply) => reply,
            Err(CallError::TimedOut { service, timeout_ms, .. })
                if self.client.servers() == Peers::None =>
            {
                let node = self.node.clone();
                return Err(ParameterClientError::Absent { node, service, timeout_ms });
            }
            Err(error) => return Err(error.into()),
        };
        let cdr = self.service.response().encode(&reply).map_err(|e| self.fault(e.to_string()))?;
        S::Response::decode(&cdr.to_bytes(), usize::MAX).map_err(|e| self.fault(e.to_string()))
    }
}
