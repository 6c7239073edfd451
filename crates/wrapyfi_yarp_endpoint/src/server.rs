//! Offers a service: a port that answers.
//!
//! ```text
//!   /rpc:in3 ── request ──▶ handler ──▶ Requests ──▶ take ── payload::decode_request
//!                              ▲ waits                  reply ── payload::encode_reply ─┐
//!                              └────────────────────────────────────────────────────────┘
//! ```
//!
//! An answer is of the dialect of its request ([`super::client_dialects`]), and under `bottle: auto` of its format.
//!
//! A YARP client asks one thing at a time on a connection, and waits for as long as it wants to: so a
//! request that is not answered in its time is answered by an error.

use std::sync::Arc;

use bytes::Bytes;
use tokio::sync::oneshot;
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::port::{Answer, Port, PortOptions, Received};

use super::client_dialects::{self, ClientDialects, InDialects};
use super::link_state::LinkState;
use super::losses::Losses;
use super::name::check_name;
use super::opening::until_open;
use super::options::{BottleFormat, YarpOptions};
use super::payload;
use super::shared::InstanceState;
use super::tasks::Stop;
use super::{found_format, name};
use wrapyfi_data::types::{Payload, ServiceKind};
use wrapyfi_endpoint::codec::{DecodeError, EncodeResult};
use wrapyfi_endpoint::requests::Requests;
use wrapyfi_endpoint::wire_server::{Sent, ServerWire, WireServer};
use wrapyfi_endpoint::{Cause, Context, Link, Mutex, OpenResult, Request, ServiceSpec};

/// Offers one service.
pub(super) struct YarpServer {
    state: Arc<ServerState>,
    shared: Arc<InstanceState>,
    _stop: Stop,
}

/// A request, and the way back.
pub(super) struct Ask {
    body: Bytes,
    reply: oneshot::Sender<InDialects>,
    format: RequestFormat,
}

/// Dialect and format of a request.
#[derive(Debug, Clone, Copy)]
struct RequestFormat {
    /// Dialect, as far as it shows.
    dialect: Option<Dialect>,
    bottle: BottleFormat,
}

/// State that the server shares with its port.
struct ServerState {
    /// The port's name before the environment changes it.
    given: String,
    name: String,
    spec: ServiceSpec,
    options: YarpOptions,
    dialect: Dialect,
    clients: Arc<ClientDialects>,
    context: Context,
    link_state: Arc<LinkState>,
    port: Mutex<Option<Port>>,
    requests: Arc<Requests<Ask>>,
    losses: Losses,
}

impl ServerState {
    /// Reply to a request that failed. It has no floats, and so no dialect.
    fn error(&self, text: &str, format: RequestFormat) -> Bytes {
        let options = self.options.with_found(format.bottle);
        payload::encode_error(text, &self.spec, &options, self.dialect)
    }

    /// Writes an answer; twice where its floats differ and it is not known what the client reads.
    fn write(&self, answer: &Payload, format: RequestFormat) -> EncodeResult<InDialects> {
        let options = self.options.with_found(format.bottle);
        let reader_is_known = format.dialect.is_some() || payload::is_json(&self.spec, &options);
        InDialects::of(format.dialect.unwrap_or(self.dialect), reader_is_known, |dialect| {
            payload::encode_reply(answer, &self.spec, &options, dialect)
        })
    }

    /// True when the server takes calls as Wrapyfi's functions do.
    fn is_function(&self) -> bool {
        let is_ros = matches!(self.spec.kind, ServiceKind::Ros(_));
        !is_ros && self.options.bottle.unwrap_or_default() == BottleFormat::Json
    }

    /// Takes a request in and waits for its answer.
    async fn ask(&self, received: Received, wants_reply: bool) -> Answer {
        if wants_reply && let Some(usage) = payload::usage(&received.payload.bytes, &self.spec) {
            return Answer::Object(usage);
        }
        let dialect = self.clients.dialect(&received);
        let body = received.payload.bytes.clone();
        let format = RequestFormat { dialect, bottle: client_dialects::format(&body) };
        let (reply, answered) = oneshot::channel();
        let bytes = body.len();
        if let Err((_, error)) = self.requests.put(Ask { body, reply, format }, bytes) {
            let answer = || Answer::Object(self.error(&error.to_string(), format));
            return if wants_reply { answer() } else { Answer::Nothing };
        }
        if !wants_reply {
            // Plain data for a port of requests: served, and no program hears the answer.
            return Answer::Nothing;
        }
        Answer::Object(match answered.await {
            Ok(InDialects { usual, other: None }) => usual,
            Ok(InDialects { usual, other: Some(other) }) => {
                let dialect = self.clients.usual().await;
                self.clients.written(&received, dialect);
                if dialect == self.dialect { usual } else { other }
            }
            Err(_dropped) => self.error(&format!("{:?} has ended", self.spec.service), format),
        })
    }
}

impl YarpServer {
    pub(super) fn open(
        shared: &Arc<InstanceState>,
        spec: &ServiceSpec,
        context: &Context,
    ) -> OpenResult<WireServer<Self>> {
        let options = YarpOptions::of_service(spec)?;
        let name = options.port.clone().unwrap_or_else(|| spec.service.clone());
        check_name(&name)?;
        let given = name;
        let name = shared.own_name(&given);
        let waiting = Cause::peer(name::port(&name), " to open", None, "");
        let state = Arc::new(ServerState {
            given,
            name,
            spec: spec.clone(),
            dialect: shared.network(&options).dialect(),
            clients: Arc::new(ClientDialects::new(
                shared.network(&options),
                shared.registrar.client().namespace(),
                &options,
            )),
            options,
            context: context.clone(),
            link_state: Arc::new(LinkState::new(context.wake.clone(), waiting)),
            port: Mutex::default(),
            requests: Arc::new(Requests::new(spec, context)),
            losses: Losses::default(),
        });
        let kept = (Arc::clone(shared), Arc::clone(&state));
        let stop = shared.tasks.spawn(&state.name, &state.link_state, kept, serve, close);
        let requests = Arc::clone(&state.requests);
        let wire = Self { state, shared: Arc::clone(shared), _stop: stop };
        Ok(WireServer::new(wire, requests, spec))
    }
}

/// Has the port open.
async fn serve((shared, state): (Arc<InstanceState>, Arc<ServerState>)) {
    let (name, network) = (state.name.as_str(), shared.network(&state.options));
    let wanted = PortOptions { rpc: true, ..PortOptions::default() };
    let port = until_open(&shared, name, &state.link_state, || {
        let asked = Arc::clone(&state);
        network.serve(&state.given, &wanted, move |received, wants_reply| {
            let state = Arc::clone(&asked);
            async move { state.ask(received, wants_reply).await }
        })
    })
    .await;
    let mut changes = port.connected();
    shared.own.insert(name);
    *state.port.lock() = Some(port);
    if state.is_function() {
        found_format::mark(&shared, name).await;
    }
    loop {
        changes.mark_unchanged();
        if let Some(port) = &*state.port.lock() {
            state.losses.count(port.fault_counts(), &state.context.counters);
            let status = port.status();
            let clients = status.iter().filter(|one| one.incoming && one.name.starts_with('/'));
            state.link_state.connected(clients.count());
        }
        if changes.changed().await.is_err() {
            return;
        }
    }
}

/// Closes the port that is open, if any.
async fn close((shared, state): (Arc<InstanceState>, Arc<ServerState>)) {
    let port = state.port.lock().take();
    if let Some(port) = port {
        // Those who wait learn at once that no answer will come: their ways back are dropped.
        while let Some(waiting) = state.requests.next() {
            state.requests.ended(waiting.bytes);
        }
        shared.own.close(port).await;
    }
}

impl ServerWire for YarpServer {
    type Ask = Ask;
    type Answer = InDialects;

    fn read(&self, Ask { body, format, .. }: &Ask) -> Result<Request, DecodeError> {
        let ServerState { spec, options, dialect, .. } = &*self.state;
        let options = options.with_found(format.bottle);
        payload::decode_request(body, spec, &options, format.dialect.unwrap_or(*dialect))
    }

    fn write(&self, ask: &Ask, payload: &Payload) -> EncodeResult<InDialects> {
        self.state.write(payload, ask.format)
    }

    fn send(&mut self, Ask { reply, format, .. }: Ask, answer: Result<InDialects, &str>) -> Sent {
        let failed = |why: &str| InDialects { usual: self.state.error(why, format), other: None };
        let answer = answer.unwrap_or_else(failed);
        let bytes = answer.usual.len();
        // The program that asked may be gone: then no client waits for it any more.
        reply.send(answer).ok();
        Ok(Some(bytes))
    }

    fn link(&self) -> Link {
        let link = self.state.link_state.link();
        match self.shared.taken(&self.state.name) {
            Some(why) => Link { waiting_for: Some(why), ..link },
            None => link,
        }
    }
}
