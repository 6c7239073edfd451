//! A client and a server with what their owner does.

use std::time::Duration;

use wrapyfi_data::types::{Payload, Value};
use wrapyfi_endpoint::{
    CallError, Client, Context, CountersSnapshot, DropReason, IncomingRequest, Middleware, Reply,
    Request, RequestId, ServeError, Server, ServiceSpec, Ticket,
};

use crate::{TIMEOUT, Testbed, WireEnd, wait_for, wait_until};

/// A client and its owner.
pub struct ClientEnd {
    /// The client.
    pub client: Box<dyn Client>,
    /// Context of the client.
    pub context: Context,
}

/// A server and its owner.
pub struct ServerEnd {
    /// The server.
    pub server: Box<dyn Server>,
    /// Context of the server.
    pub context: Context,
    /// Requests that could not be served.
    pub refused: Vec<ServeError>,
}

impl ClientEnd {
    /// Opens a client.
    #[track_caller]
    pub fn open(middleware: &dyn Middleware, spec: &ServiceSpec) -> Self {
        let context = Context::default();
        let client = middleware.open_client(spec, &context).unwrap();
        Self { client, context }
    }

    /// Counters so far.
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
        self.ask_within(args, TIMEOUT)
    }

    /// Begins a call.
    #[track_caller]
    pub fn ask_within(&mut self, args: impl Into<Vec<Value>>, timeout: Duration) -> Ticket {
        self.client.send(&Request::new(args), timeout).unwrap()
    }

    /// Result of a call, if it has ended.
    pub fn ended(&mut self, ticket: Ticket) -> Option<Result<Payload, CallError>> {
        let result = self.client.take_only(ticket)?;
        Some(result.map(|reply: Reply| reply.payload))
    }

    /// Waits for the end of a call while `server_end` echoes.
    #[track_caller]
    #[expect(clippy::print_stderr, reason = "shown with the failure of the test")]
    pub fn await_echo(
        &mut self,
        ticket: Ticket,
        server_end: &mut ServerEnd,
    ) -> Result<Payload, CallError> {
        let reply = self.await_with(ticket, || _ = server_end.echo());
        if reply.is_err() {
            let (counters, kept) = (server_end.counters(), server_end.server.kept());
            eprintln!("the server: {counters:?}, {kept} replies kept, {:?}", server_end.refused);
        }
        reply
    }

    /// Waits for the end of a call; `meanwhile` is done again and again.
    #[track_caller]
    pub fn await_with(
        &mut self,
        ticket: Ticket,
        mut meanwhile: impl FnMut(),
    ) -> Result<Payload, CallError> {
        wait_for(self.context.wake.clone(), "the end of a call", || {
            meanwhile();
            self.ended(ticket)
        })
    }
}

impl ServerEnd {
    /// Opens a server.
    #[track_caller]
    pub fn open(middleware: &dyn Middleware, spec: &ServiceSpec) -> Self {
        let context = Context::default();
        let server = middleware.open_server(spec, &context).unwrap();
        Self { server, context, refused: Vec::new() }
    }

    /// Counters so far.
    pub fn counters(&self) -> CountersSnapshot {
        self.context.counters.snapshot()
    }

    /// Requests dropped for `reason`.
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
        wait_for(self.context.wake.clone(), "a request", || self.take())
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
            self.answer(id, Value::List(request.into_call().unwrap().args));
            answered += 1;
        }
        self.server.flush();
        answered
    }
}

/// A server at `at` and a client at the other side that has been answered once.
#[track_caller]
pub fn call_and_serve<R: Testbed>(
    testbed: &R,
    at: WireEnd,
    spec: &ServiceSpec,
) -> (ClientEnd, ServerEnd) {
    let mut server_end = ServerEnd::open(testbed.side(at), spec);
    let mut client_end = ClientEnd::open(testbed.side(at.other()), spec);
    client_end.ready();
    if spec.kind.data_type() == wrapyfi_data::types::DataType::NativeObject {
        let ticket = client_end.ask([]);
        client_end.await_echo(ticket, &mut server_end).unwrap();
    }
    (client_end, server_end)
}

/// A time-out that is over soon: what waits for it goes on at once.
pub(crate) const SOON: Duration = Duration::from_millis(200);
