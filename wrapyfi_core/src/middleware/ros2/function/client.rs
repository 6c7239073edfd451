//! Calls a function of Wrapyfi as a ROS 2 service.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::{Function, check_name, refused, unwritable};
use crate::DecodeError;
use crate::endpoint::{
    CallError, Client, Context, DropReason, Link, OpenError, Reply, Request, ServiceSpec, Ticket,
    Wake,
};
use crate::middleware::ros2::graph::Peers;
use crate::middleware::ros2::service;
use crate::middleware::ros2::{AnyClient, Ros2};
use wrapyfi_interfaces::dynamic::DynamicMessage;

/// [`AnyClient`] with the data model's requests and replies.
pub(in super::super) struct FunctionClient {
    any: AnyClient,
    function: Function,
    context: Context,
    ended: VecDeque<(Ticket, Result<Reply, CallError>)>,
    late: u64,
}

impl FunctionClient {
    pub(in super::super) fn open(
        ros2: &Ros2,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
        check_name(ros2, spec)?;
        let function = Function::new(spec)?;
        let (service, options) = (function.service.clone(), function.options());
        let any = AnyClient::open(ros2, &spec.service, service, &options, &context.wake)
            .map_err(|error| refused(spec, &error))?;
        Ok(Self { any, function, context: context.clone(), ended: VecDeque::new(), late: 0 })
    }

    /// Takes what has ended in the client underneath.
    fn turn(&mut self) {
        while let Some((ticket, result)) = self.any.poll() {
            let result = match result {
                Ok(message) => self.reply(&message),
                Err(error) => Err(self.failed(error)),
            };
            self.ended.push_back((ticket, result));
        }
        let late = self.any.late();
        self.context.counters.dropped_many(DropReason::Late, late.saturating_sub(self.late));
        self.late = late;
    }

    fn reply(&self, message: &DynamicMessage) -> Result<Reply, CallError> {
        let service = self.any.name().to_owned();
        let counters = &self.context.counters;
        let (answer, wire_bytes) = self.function.read_reply(message).map_err(|fault| {
            counters.received(0);
            counters.dropped(fault.drop_reason());
            CallError::Reply { service: service.clone(), fault }
        })?;
        counters.received(wire_bytes);
        let received_at = Instant::now();
        answer
            .map(|payload| Reply { payload, wire_bytes, received_at })
            .map_err(|reason| CallError::Refused { service, reason })
    }

    fn failed(&self, error: service::CallError) -> CallError {
        match error {
            service::CallError::TimedOut { service, timeout_ms, why } => {
                CallError::TimedOut { service, timeout_ms, why }
            }
            service::CallError::TooMany { service, limit } => CallError::TooMany { service, limit },
            service::CallError::Request { service, fault } => {
                CallError::Request { service, fault: unwritable(&fault) }
            }
            service::CallError::Reply { service, fault } => {
                self.context.counters.received(0);
                self.context.counters.dropped(DropReason::Malformed);
                let fault =
                    DecodeError::Malformed { format: "CDR", path: "$".to_owned(), reason: fault };
                CallError::Reply { service, fault }
            }
            service::CallError::Graph(error) => CallError::Transport {
                service: self.any.name().to_owned(),
                reason: error.to_string(),
            },
        }
    }
}

impl Client for FunctionClient {
    fn send(&mut self, request: &Request, timeout: Duration) -> Result<Ticket, CallError> {
        let message = self
            .function
            .write_request(request, self.any.request())
            .map_err(|fault| CallError::Request { service: self.any.name().to_owned(), fault })?;
        self.any.call_within(&message, timeout).map_err(|error| self.failed(error))
    }

    fn take(&mut self) -> Option<(Ticket, Result<Reply, CallError>)> {
        self.turn();
        self.ended.pop_front()
    }

    fn take_only(&mut self, ticket: Ticket) -> Option<Result<Reply, CallError>> {
        self.turn();
        let at = self.ended.iter().position(|(ended, _)| *ended == ticket)?;
        self.ended.remove(at).map(|(_, result)| result)
    }

    fn cancel(&mut self, ticket: Ticket) {
        self.any.cancel(ticket);
        self.ended.retain(|(ended, _)| *ended != ticket);
    }

    fn deadline(&self) -> Option<Instant> {
        self.any.deadline()
    }

    fn link(&self) -> Link {
        let name = self.any.name();
        let (peers, waiting_for) = match self.any.servers() {
            Peers::Ready(servers) => (servers, None),
            Peers::None => (0, Some(format!("a server of {name}"))),
            Peers::Half => (0, Some(format!("a server of {name}, found by half"))),
            Peers::Foreign(theirs) => {
                (0, Some(format!("a server of {name} that does not speak {}", theirs.rmw())))
            }
        };
        Link { peers: Some(peers), waiting_for, keeps_last: false }
    }

    fn wake(&self) -> &Wake {
        &self.context.wake
    }
}
