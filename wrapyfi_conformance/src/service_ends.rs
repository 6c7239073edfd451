//! A client and a server with what their owner does.

use std::time::Duration;

use wrapyfi_core::endpoint::{
    CallError, Client, Context, CountersSnapshot, DropReason, IncomingRequest, Middleware, Reply,
    Request, RequestId, ServeError, Server, ServiceSpec, Ticket,
};
use wrapyfi_core::types::{Payload, Value};

use crate::{PATIENCE, Rig, Side, wait_until};

/// A client and its owner.
pub struct Caller {
    /// The client.
    pub client: Box<dyn Client>,
    /// Its context.
    pub context: Context,
}

/// A server and its owner.
pub struct Clerk {
    /// The server.
    pub server: Box<dyn Server>,
    /// Its context.
    pub context: Context,
    /// Requests that could not be served.
    pub refused: Vec<ServeError>,
}

impl Caller {
    /// Opens a client.
    #[track_caller]
    pub fn open(middleware: &dyn Middleware, spec: &ServiceSpec) -> Self {
        let context = Context::default();
        let client = middleware.open_client(spec, &context).unwrap();
        Self { client, context }
    }

    /// What was counted so far.
    #[must_use]
    pub fn counters(&self) -> CountersSnapshot {
        self.context.counters.snapshot()
    }

    /// Waits until a call would be sent at once.
    #[track_caller]
    pub fn ready(&self) {
        wait_until(&self.context.wake, "the way to the server", || {
            self.client.link().waiting_for.is_none()
        });
    }

    /// Begins a call with these arguments and all the time there is.
    #[track_caller]
    pub fn ask(&mut self, args: impl Into<Vec<Value>>) -> Ticket {
        self.ask_within(args, PATIENCE)
    }

    /// Begins a call.
    #[track_caller]
    pub fn ask_within(&mut self, args: impl Into<Vec<Value>>, timeout: Duration) -> Ticket {
        self.client.send(&Request::new(args), timeout).unwrap()
    }

    /// How a call ended, if it has.
    pub fn ended(&mut self, ticket: Ticket) -> Option<Result<Payload, CallError>> {
        let result = self.client.take_only(ticket)?;
        Some(result.map(|reply: Reply| reply.payload))
    }

    /// Waits for the end of a call while `clerk` echoes.
    #[track_caller]
    pub fn await_echo(&mut self, ticket: Ticket, clerk: &mut Clerk) -> Result<Payload, CallError> {
        self.await_with(ticket, || _ = clerk.echo())
    }

    /// Waits for the end of a call; `meanwhile` is done again and again.
    #[track_caller]
    pub fn await_with(
        &mut self,
        ticket: Ticket,
        mut meanwhile: impl FnMut(),
    ) -> Result<Payload, CallError> {
        let wake = self.context.wake.clone();
        let mut result = None;
        wait_until(&wake, "the end of a call", || {
            meanwhile();
            result = self.ended(ticket);
            result.is_some()
        });
        result.unwrap()
    }
}

impl Clerk {
    /// Opens a server.
    #[track_caller]
    pub fn open(middleware: &dyn Middleware, spec: &ServiceSpec) -> Self {
        let context = Context::default();
        let server = middleware.open_server(spec, &context).unwrap();
        Self { server, context, refused: Vec::new() }
    }

    /// What was counted so far.
    #[must_use]
    pub fn counters(&self) -> CountersSnapshot {
        self.context.counters.snapshot()
    }

    /// Requests dropped for `reason`.
    #[must_use]
    pub fn dropped_for(&self, reason: DropReason) -> u64 {
        self.counters().dropped_for(reason)
    }

    /// The next request, if one waits; those that cannot be served are passed over.
    pub fn take(&mut self) -> Option<IncomingRequest> {
        loop {
            match self.server.take() {
                Ok(request) => return request,
                Err(error) => self.refused.push(error),
            }
        }
    }

    /// Waits for the next request.
    #[track_caller]
    pub fn receive(&mut self) -> IncomingRequest {
        let wake = self.context.wake.clone();
        let mut next = None;
        wait_until(&wake, "a request", || {
            next = self.take();
            next.is_some()
        });
        next.unwrap()
    }

    /// Answers with a payload.
    #[track_caller]
    pub fn answer(&mut self, id: RequestId, payload: impl Into<Payload>) {
        self.server.reply(id, Ok(payload.into())).unwrap();
    }

    /// Answers every request that waits with its arguments; how many there were.
    pub fn echo(&mut self) -> usize {
        let mut answered = 0;
        while let Some(IncomingRequest { id, request, .. }) = self.take() {
            self.answer(id, Value::List(request.args));
            answered += 1;
        }
        self.server.flush();
        answered
    }
}

/// A server at `at` and a client at the other side that has been answered once.
#[track_caller]
pub fn call_and_serve<R: Rig>(rig: &R, at: Side, spec: &ServiceSpec) -> (Caller, Clerk) {
    let mut clerk = Clerk::open(rig.side(at), spec);
    let mut caller = Caller::open(rig.side(at.other()), spec);
    caller.ready();
    if spec.kind.data_type() == wrapyfi_core::types::DataType::NativeObject {
        let ticket = caller.ask([]);
        caller.await_echo(ticket, &mut clerk).unwrap();
    }
    (caller, clerk)
}

/// A time-out that is over soon: what waits for it goes on at once.
pub(crate) const SOON: Duration = Duration::from_millis(200);
