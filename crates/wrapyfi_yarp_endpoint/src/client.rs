//! Calls a service: a port that asks.
//!
//! ```text
//!   send ─▶ Calls ── the server is there ──▶ a task each: idle connection, or one more ══▶ /rpc
//!   take ◀── payload::decode_reply ◀── state ◀── bytes, or why there are none ◀───────────┘
//! ```
//!
//! YARP's replies have no number, so a connection carries one call at a time, and several calls have
//! several connections. One more has a port with a name, as Wrapyfi's client is; it carries no calls
//! and tells when the server goes. Under `bottle: auto` it also finds out, before the first call, whether a
//! function of Wrapyfi answers there ([`super::found_format`]), and before the first request with a float whether a
//! program of YARP 4 does ([`super::client_dialects`]). A connection whose call took too long is kept for its late
//! reply for a while, so that this is counted and taken for no other.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use bytes::Bytes;
use tokio::sync::{Notify, watch};
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::port::{LinkError, Port, PortOptions, RpcError};

use super::client_dialects::{self, InDialects};
use super::directory::unless_slow;
use super::link_state::LinkState;
use super::name::check_name;
use super::opening::{numbered, until_open};
use super::options::{BottleFormat, YarpOptions};
use super::payload;
use super::shared::InstanceState;
use super::tasks::Stop;
use super::{found_format, name};
use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::calls::{Calls, Stage};
use wrapyfi_endpoint::codec::{EncodeError, EncodeResult};
use wrapyfi_endpoint::wire_client::{ClientWire, WireClient};
use wrapyfi_endpoint::{
    CallError, Cause, Clock, Context, Link, Mutex, OpenResult, PeerFault, Request, ServiceSpec,
};

/// Time after the deadline of a call in which its reply is still known, and counted as late.
const LATE: Duration = Duration::from_secs(30);

/// A request until it is sent.
pub(super) struct Outgoing {
    body: Body,
    deadline: Instant,
}

enum Body {
    Written(InDialects),
    /// Request as it is, while it is not known how the server reads.
    Unwritten(Request),
}

/// Calls one service.
pub(super) struct YarpClient {
    state: Arc<ClientState>,
    shared: Arc<InstanceState>,
    number: i64,
    _stop: Stop,
}

/// Result of one call.
enum Outcome {
    Reply(Bytes),
    /// The server took the request and has no answer.
    Silence,
    /// The connection failed after the request went out.
    Lost(String),
    /// The request has no format that the server reads.
    Unwritable(EncodeError),
}

/// State that a client shares with its tasks.
struct ClientState {
    spec: ServiceSpec,
    options: YarpOptions,
    /// Format that the server reads, where the options leave it to be found.
    format: Mutex<BottleFormat>,
    dialect: Dialect,
    /// The dialect of the server as it is now, once it was asked.
    known_dialect: Mutex<Option<Dialect>>,
    link_state: Arc<LinkState>,
    clock: Clock,
    outcomes: Mutex<VecDeque<(i64, Outcome, Instant)>>,
    /// Connections without a call, and which of the server's times they belong to.
    idle: Mutex<Vec<(u64, Arc<Port>)>>,
    /// Number of the server's connection, counted from the first; `None` while it is away.
    up: watch::Sender<Option<u64>>,
    /// Signal that a connection to the server failed.
    failed: Notify,
    /// Calls that have a connection, those included that no caller waits for.
    out: AtomicUsize,
    /// The port that has a name: it knows whether the server is there.
    port: Mutex<Option<Arc<Port>>>,
}

impl ClientState {
    fn target(&self) -> String {
        format!("{}:/{}", self.options.carrier(), self.spec.service)
    }

    /// A connection to the server as it is now; `None` when it is lost.
    async fn connection(&self, shared: &InstanceState, time: u64) -> Option<Arc<Port>> {
        let free = {
            let mut idle = self.idle.lock();
            idle.retain(|(known, _)| *known == time);
            idle.pop()
        };
        if let Some((_, free)) = free {
            return Some(free);
        }
        let base = self.port.lock().as_ref().map(|port| port.name().to_owned())?;
        let options = PortOptions { register: false, ..shared.asking() };
        // A name of its own: a server keeps one connection of each.
        let name = format!("{base}/{}", numbered(""));
        let opened = async {
            let client = shared.network(&self.options).open_rpc_client(&name, &options).await?;
            client.connect(&self.target()).await?;
            Ok::<_, Box<dyn std::error::Error + Send + Sync>>(Arc::new(client))
        };
        let opened = opened.await.inspect_err(|error| {
            tracing::debug!(service = self.spec.service, %error, "no connection");
        });
        opened.ok()
    }

    /// The options, with the format that the server reads.
    fn options(&self) -> Cow<'_, YarpOptions> {
        self.options.with_found(*self.format.lock())
    }

    /// A request in the dialect that the server has `known`, where it has.
    fn write(&self, request: &Request, known: Option<Dialect>) -> EncodeResult<InDialects> {
        let options = self.options();
        let is_known = known.or(options.dialect).is_some();
        let reader_is_known = is_known || payload::is_json(&self.spec, &options);
        InDialects::of(known.unwrap_or(self.dialect), reader_is_known, |dialect| {
            payload::encode_request(request, &self.spec, &options, dialect)
        })
    }

    /// The format of a request that the server reads: it is asked once, and where that decides.
    async fn readable<'a>(&self, shared: &InstanceState, written: &'a InDialects) -> &'a Bytes {
        let InDialects { usual, other: Some(other) } = written else { return &written.usual };
        let known = *self.known_dialect.lock();
        let dialect = match known {
            Some(dialect) => dialect,
            None => client_dialects::ask(&shared.network, &self.spec.service).await.0,
        };
        *self.known_dialect.lock() = Some(dialect);
        if dialect == self.dialect { usual } else { other }
    }

    /// Makes one call. Until the request is out, a server that is lost is waited for; `None` when
    /// its time was over before.
    async fn call(
        &self,
        shared: &InstanceState,
        body: &Body,
        deadline: Instant,
    ) -> Option<Outcome> {
        let mut up = self.up.subscribe();
        let mut written = None;
        let left = || deadline.saturating_duration_since(self.clock.now());
        loop {
            let time = tokio::time::timeout(left(), up.wait_for(Option::is_some)).await;
            let time = (*time.ok()?.ok()?)?;
            if let Some(client) = self.connection(shared, time).await {
                if left().is_zero() {
                    // It must not be carried out late.
                    self.idle.lock().push((time, client));
                    return None;
                }
                let body = match body {
                    Body::Written(body) => body,
                    Body::Unwritten(request) => {
                        let known = *self.known_dialect.lock();
                        match self.write(request, known) {
                            Ok(body) => written.insert(body),
                            Err(fault) => {
                                self.idle.lock().push((time, client));
                                return Some(Outcome::Unwritable(fault));
                            }
                        }
                    }
                };
                let body = self.readable(shared, body).await;
                match client.call_bytes(body, left() + LATE).await {
                    Ok(reply) => {
                        self.idle.lock().push((time, client));
                        return Some(reply.map_or(Outcome::Silence, Outcome::Reply));
                    }
                    Err(error) if was_not_sent(&error) => {}
                    Err(error) => {
                        self.failed.notify_one();
                        return Some(Outcome::Lost(error.to_string()));
                    }
                }
            }
            // The keeper looks at the server; until then nothing is tried.
            self.failed.notify_one();
            let changed = up.wait_for(|now| *now != Some(time));
            tokio::time::timeout(left(), changed).await.ok()?.ok()?;
        }
    }
}

/// True when the error shows that the server cannot have seen the request.
fn was_not_sent(error: &RpcError) -> bool {
    matches!(
        error,
        RpcError::Link { error: LinkError::Connect { .. }, .. } | RpcError::NotConnected(_)
    )
}

/// Has the port open that has a name.
async fn serve((shared, state): (Arc<InstanceState>, Arc<ClientState>)) {
    let service = &state.spec.service;
    let (network, options) = (shared.network(&state.options), shared.asking());
    let port = until_open(&shared, service, &state.link_state, || async {
        let name = state.options.port.clone().unwrap_or_else(|| numbered(service));
        network.open_rpc_client(&name, &options).await
    });
    let port = Arc::new(port.await);
    *state.port.lock() = Some(Arc::clone(&port));
    stay_connected(&shared, &state, &port).await;
}

/// Closes the port that is open, if any, and the connections of calls.
async fn close((_, state): (Arc<InstanceState>, Arc<ClientState>)) {
    state.up.send_replace(None);
    state.idle.lock().clear();
    let port = state.port.lock().take();
    if let Some(port) = port {
        port.disconnect().await;
        // No other program has it any more.
        if let Some(port) = Arc::into_inner(port) {
            port.close().await;
        }
    }
}

/// Cause that the port of a service has not answered.
fn unanswered(service: &str, fault: Option<PeerFault>, hint: &'static str) -> Cause {
    Cause::peer(name::port(service), " to answer", fault, hint)
}

async fn stay_connected(shared: &InstanceState, state: &ClientState, port: &Port) {
    let bell = shared.directory.watch(&state.spec.service);
    let (mut backoff, mut time) = (Backoff::of_name(&state.spec.service), 0);
    let mut changes = port.connected();
    let mut has_just_come = false;
    loop {
        if !shared.directory.knows(&state.spec.service) {
            has_just_come = true;
            let away = shared.directory.waiting_for();
            let nobody = || Cause::NotOpened(name::address(&state.spec.service));
            state.link_state.waiting(away.unwrap_or_else(nobody));
            bell.notified().await;
            continue;
        }
        let asked = shared.located(&state.spec.service);
        let (what, say) = (format!("to tell where port {} is", state.spec.service), |what| {
            state.link_state.waiting(what);
        });
        let at = shared.directory.answers(&what, asked, say).await.and_then(|entry| entry.at);
        if let Err(error) = port.connect(&state.target()).await {
            let say = |hint| {
                let fault = PeerFault::Transport(error.to_string());
                state.link_state.waiting(unanswered(&state.spec.service, Some(fault), hint));
            };
            let hint = shared.hint(&state.spec.service);
            say(unless_slow(hint, || say("")).await);
            // A name is registered a moment before its port listens.
            tokio::select! { () = bell.notified() => backoff.reset(), () = backoff.pause() => {} }
            continue;
        }
        // Without a name server it stays what it was.
        if state.options.finds_format && shared.directory.reached().is_some() {
            let found = found_format::of_server(shared, &state.spec.service, has_just_come).await;
            *state.format.lock() = found;
        }
        has_just_come = false;
        backoff.reset();
        *state.known_dialect.lock() = None;
        time += 1;
        state.up.send_replace(Some(time));
        state.link_state.connected(1);
        loop {
            let rung = tokio::select! {
                // It said goodbye, or was killed.
                _ = changes.wait_for(|now| now.outputs == 0) => false,
                () = port.ended() => false,
                () = state.failed.notified() => false,
                () = bell.notified() => true,
            };
            // The same server that was registered again is no other server, nor is one whose name server went.
            let stays = rung && {
                let now = shared.located(&state.spec.service).await;
                now.is_none_or(|now| now.at == at)
            };
            if !stays {
                break;
            }
        }
        state.up.send_replace(None);
        state.idle.lock().clear();
        state.link_state.waiting(unanswered(&state.spec.service, None, ""));
        port.disconnect().await;
    }
}

impl YarpClient {
    pub(super) fn open(
        shared: &Arc<InstanceState>,
        spec: &ServiceSpec,
        context: &Context,
    ) -> OpenResult<WireClient<Self>> {
        let options = YarpOptions::of_service(spec)?;
        check_name(&spec.service)?;
        if let Some(port) = &options.port {
            check_name(port)?;
        }
        let waiting = unanswered(&spec.service, None, "");
        let state = Arc::new(ClientState {
            spec: spec.clone(),
            format: Mutex::new(BottleFormat::Bottle),
            dialect: shared.network(&options).dialect(),
            known_dialect: Mutex::default(),
            options,
            link_state: Arc::new(LinkState::new(context.wake.clone(), waiting)),
            clock: context.clock.clone(),
            outcomes: Mutex::default(),
            idle: Mutex::default(),
            up: watch::Sender::new(None),
            failed: Notify::new(),
            out: AtomicUsize::new(0),
            port: Mutex::default(),
        });
        let kept = (Arc::clone(shared), Arc::clone(&state));
        let stop = shared.tasks.spawn(&spec.service, &state.link_state, kept, serve, close);
        let shared = Arc::clone(shared);
        let wire = Self { state, shared, number: 0, _stop: stop };
        Ok(WireClient::new(wire, &spec.service, spec.pending, context))
    }

    fn end(&self, calls: &mut Calls<Outgoing>, (number, outcome, at): (i64, Outcome, Instant)) {
        let service = self.state.spec.service.clone();
        let body = match outcome {
            Outcome::Reply(body) => body,
            Outcome::Silence => {
                let reason = "its port took the request and does not answer requests".to_owned();
                return calls.failed(number, CallError::Transport { service, reason });
            }
            Outcome::Unwritable(fault) => {
                return calls.failed(number, CallError::Request { service, fault });
            }
            Outcome::Lost(why) => {
                let reason = format!("{why}; it may have been carried out, or not");
                return calls.failed(number, CallError::Transport { service, reason });
            }
        };
        let state = &self.state;
        calls.answered(number, body.len(), at, || {
            let now = Stamp::now();
            match payload::decode_reply(&body, &state.spec, &state.options(), state.dialect, now) {
                Ok(Ok(payload)) => Ok(payload),
                Ok(Err(reason)) => Err(CallError::Refused { service, reason }),
                Err(fault) => Err(CallError::Reply { service, fault }),
            }
        });
    }
}

/// The task of one call.
async fn make(
    shared: Arc<InstanceState>,
    state: Arc<ClientState>,
    number: i64,
    outgoing: Outgoing,
) {
    let outcome = state.call(&shared, &outgoing.body, outgoing.deadline).await;
    state.out.fetch_sub(1, Relaxed);
    if let Some(outcome) = outcome {
        state.outcomes.lock().push_back((number, outcome, state.clock.now()));
    }
    state.link_state.wake.ring();
}

impl ClientWire for YarpClient {
    type Written = Outgoing;

    fn write(&self, request: &Request, deadline: Instant) -> EncodeResult<(Outgoing, usize)> {
        if self.state.options.finds_format {
            let body = Body::Unwritten(request.clone());
            return Ok((Outgoing { body, deadline }, request.size_hint()));
        }
        // Another server may be there by the time that it is sent.
        let written = self.state.write(request, None)?;
        let other = written.other.as_ref().map_or(0, Bytes::len);
        let bytes = written.usual.len().saturating_add(other);
        Ok((Outgoing { body: Body::Written(written), deadline }, bytes))
    }

    fn turn(&mut self, calls: &mut Calls<Outgoing>) {
        // Late replies have their connections still: twice the calls is the most.
        let most = self.state.spec.pending.saturating_mul(2);
        while self.state.up.borrow().is_some()
            && self.state.out.load(Relaxed) < most
            && calls.next_to_send().is_some()
        {
            self.number += 1;
            let Some(outgoing) = calls.send(self.number) else { break };
            self.state.out.fetch_add(1, Relaxed);
            let call =
                make(Arc::clone(&self.shared), Arc::clone(&self.state), self.number, outgoing);
            self.shared.tasks.spawn_aside(call);
        }
        let came = std::mem::take(&mut *self.state.outcomes.lock());
        for ended in came {
            self.end(calls, ended);
        }
    }

    fn missing(&self, stage: Stage) -> String {
        match (stage, self.state.link_state.link().waiting_for) {
            (Stage::Waiting, Some(what)) => format!("still waiting for {what}"),
            (Stage::Waiting, None) => "earlier calls of it are not answered either".to_owned(),
            (Stage::Sent, Some(what)) => format!("its server is gone: waiting for {what}"),
            (Stage::Sent, None) => "its server has not answered".to_owned(),
        }
    }

    fn link(&self) -> Link {
        self.state.link_state.link()
    }
}
