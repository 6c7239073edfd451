//! Offers a service: a port that answers.
//!
//! ```text
//!   /rpc:in3 ── request ──▶ handler ──▶ Requests ──▶ take ── payload::decode_request
//!                              ▲ waits                  reply ── payload::encode_reply ─┐
//!                              └────────────────────────────────────────────────────────┘
//! ```
//!
//! An answer is of the dialect of its request ([`super::manner`]), and under `bottle: auto` of its form.
//!
//! A YARP client asks one thing at a time on a connection, and waits for as long as it wants to: so a
//! request that is not answered in its time is answered by an error.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use tokio::sync::oneshot;
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::port::{Answer, PortOptions, Received, RpcServer};

use super::Shared;
use super::form::{self, FoundForm};
use super::losses::Losses;
use super::manner::{self, Clients};
use super::opening::until_open;
use super::options::{Form, YarpOptions};
use super::payload;
use super::standing::Standing;
use super::tasks::{Stop, Stopped};
use wrapyfi_data::types::{Payload, ServiceKind};
use wrapyfi_endpoint::codec::{DecodeError, EncodeError};
use wrapyfi_endpoint::requests::Requests;
use wrapyfi_endpoint::wire_server::{ServerWire, WireServer};
use wrapyfi_endpoint::{Context, Link, OpenError, Request, ServeError, ServiceSpec};

/// Offers one service.
pub(super) struct YarpServer {
    desk: Arc<Desk>,
    shared: Arc<Shared>,
    _stop: Stop,
}

/// A request, and the way back.
pub(super) struct Ask {
    body: Bytes,
    reply: oneshot::Sender<Reply>,
    manner: Manner,
}

/// Dialect and form of a request.
#[derive(Debug, Clone, Copy)]
struct Manner {
    /// Dialect, as far as it shows.
    dialect: Option<Dialect>,
    form: Form,
}

/// Encoded reply.
pub(super) enum Reply {
    Known(Bytes),
    /// Reply in the dialect that is set, and in the other one, which the client may have.
    Either(Bytes, Bytes),
}

/// State that the server shares with its port.
struct Desk {
    /// The port's name before the environment changes it.
    given: String,
    name: String,
    spec: ServiceSpec,
    options: YarpOptions,
    forms: FoundForm,
    dialect: Dialect,
    clients: Arc<Clients>,
    context: Context,
    standing: Standing,
    port: Mutex<Option<RpcServer>>,
    requests: Arc<Requests<Ask>>,
    losses: Losses,
}

impl Desk {
    fn port(&self) -> MutexGuard<'_, Option<RpcServer>> {
        self.port.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reply to a request that failed. It has no floats, and so no dialect.
    fn error(&self, text: &str, manner: Manner) -> Bytes {
        let options = self.forms.of(&self.options, manner.form);
        payload::encode_error(text, &self.spec, options, self.dialect)
    }

    /// Writes an answer; twice where its floats differ and nobody knows what the client reads.
    fn write(
        &self,
        answer: &Payload,
        manner: Manner,
    ) -> Result<(Bytes, Option<Bytes>), EncodeError> {
        let options = self.forms.of(&self.options, manner.form);
        let write = |dialect| payload::encode_reply(answer, &self.spec, options, dialect);
        let body = write(manner.dialect.unwrap_or(self.dialect))?;
        if manner.dialect.is_some() || payload::is_json(&self.spec, options) {
            return Ok((body, None));
        }
        // A reply that only one dialect has a form for is written in that one.
        let other = write(self.dialect.other()).ok().filter(|other| *other != body);
        Ok((body, other))
    }

    /// True when the server takes calls as Wrapyfi's functions do.
    fn is_function(&self) -> bool {
        let is_ros = matches!(self.spec.kind, ServiceKind::Ros(_));
        !is_ros && self.options.bottle.unwrap_or_default() == Form::Json
    }

    /// Takes a request in and waits for its answer.
    async fn ask(&self, received: Received, wants_reply: bool) -> Answer {
        let dialect = self.clients.dialect(&received);
        let body = received.payload.bytes.clone();
        let manner = Manner { dialect, form: manner::form(&body) };
        let (reply, answered) = oneshot::channel();
        let bytes = body.len();
        if let Err((_, error)) = self.requests.put(Ask { body, reply, manner }, bytes) {
            let answer = || Answer::Object(self.error(&error.to_string(), manner));
            return if wants_reply { answer() } else { Answer::Nothing };
        }
        if !wants_reply {
            // Plain data for a port of requests: served, and nobody hears the answer.
            return Answer::Nothing;
        }
        Answer::Object(match answered.await {
            Ok(Reply::Known(body)) => body,
            Ok(Reply::Either(body, other)) => {
                let dialect = self.clients.usual().await;
                self.clients.written(&received, dialect);
                if dialect == self.dialect { body } else { other }
            }
            Err(_dropped) => self.error(&format!("{:?} has ended", self.spec.service), manner),
        })
    }
}

impl YarpServer {
    pub(super) fn open(
        shared: &Arc<Shared>,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<WireServer<Self>, OpenError> {
        let options = YarpOptions::of_service(spec)?;
        let name = options.port.clone().unwrap_or_else(|| spec.service.clone());
        super::check_name(&name)?;
        let given = name;
        let name = shared.own_name(&given);
        let waiting = format!("port {name} to open");
        let desk = Arc::new(Desk {
            given,
            name,
            spec: spec.clone(),
            dialect: shared.network(&options).dialect(),
            clients: Arc::new(Clients::new(
                shared.network(&options),
                shared.registrar.client().namespace(),
                &options,
            )),
            forms: FoundForm::new(&options),
            options,
            context: context.clone(),
            standing: Standing::new(context.wake.clone(), waiting),
            port: Mutex::default(),
            requests: Arc::new(Requests::new(spec, context)),
            losses: Losses::default(),
        });
        let (stop, stopped) = shared.tasks.stop();
        let (kept, told) = ((Arc::clone(shared), Arc::clone(&desk)), Arc::clone(&desk));
        shared.tasks.spawn(
            &desk.name,
            move |what| told.standing.waiting(what),
            move || keep(kept.clone(), stopped.clone()),
        );
        let requests = Arc::clone(&desk.requests);
        let wire = Self { desk, shared: Arc::clone(shared), _stop: stop };
        Ok(WireServer::new(wire, requests, spec))
    }
}

/// The life of a port.
async fn keep((shared, desk): (Arc<Shared>, Arc<Desk>), mut stopped: Stopped) {
    // A task that panicked has left its port open.
    close(&shared, &desk).await;
    let name = desk.name.as_str();
    let opened = until_open(&shared, name, &desk.standing, || {
        let (network, desk) = (shared.network(&desk.options), Arc::clone(&desk));
        let given = desk.given.clone();
        async move {
            let wanted = PortOptions { rpc: true, ..PortOptions::default() };
            network
                .serve(&given, &wanted, move |received, wants_reply| {
                    let desk = Arc::clone(&desk);
                    async move { desk.ask(received, wants_reply).await }
                })
                .await
        }
    });
    let port = tokio::select! {
        () = stopped.wait() => return,
        port = opened => port,
    };
    let mut changes = port.connected();
    shared.own.insert(name);
    *desk.port() = Some(port);
    if desk.is_function() {
        form::mark(&shared, name).await;
    }
    let counted = async {
        loop {
            changes.mark_unchanged();
            if let Some(port) = &*desk.port() {
                desk.losses.count(port.counters(), &desk.context.counters);
                let status = port.status();
                let clients = status.iter().filter(|one| one.incoming && one.name.starts_with('/'));
                desk.standing.connected(clients.count());
            }
            if changes.changed().await.is_err() {
                return;
            }
        }
    };
    tokio::select! {
        () = stopped.wait() => {}
        () = counted => {}
    }
    // Those who wait learn at once that nobody will answer: their ways back are dropped.
    drop(desk.requests.close());
    close(&shared, &desk).await;
    desk.standing.waiting("YARP, which has ended");
}

/// Closes the port that is open, if any.
async fn close(shared: &Shared, desk: &Desk) {
    let port = desk.port().take();
    if let Some(port) = port {
        port.close().await;
        shared.own.remove(&desk.name);
    }
}

impl ServerWire for YarpServer {
    type Ask = Ask;
    type Answer = (Bytes, Option<Bytes>);

    fn read(&self, Ask { body, manner, .. }: &Ask) -> Result<Request, DecodeError> {
        let Desk { spec, options, dialect, .. } = &*self.desk;
        let options = self.desk.forms.of(options, manner.form);
        payload::decode_request(body, spec, options, manner.dialect.unwrap_or(*dialect))
    }

    fn write(&self, ask: &Ask, payload: &Payload) -> Result<Self::Answer, EncodeError> {
        self.desk.write(payload, ask.manner)
    }

    fn send(
        &mut self,
        Ask { reply, manner, .. }: Ask,
        answer: Result<Self::Answer, &str>,
    ) -> Result<Option<usize>, ServeError> {
        let (body, other) = answer.unwrap_or_else(|why| (self.desk.error(why, manner), None));
        let bytes = body.len();
        let answer = match other {
            None => Reply::Known(body),
            Some(other) => Reply::Either(body, other),
        };
        // Whoever asked may be gone: then nobody waits for it any more.
        reply.send(answer).ok();
        Ok(Some(bytes))
    }

    fn link(&self) -> Link {
        let link = self.desk.standing.link();
        match self.shared.taken(&self.desk.name) {
            Some(why) => Link { waiting_for: Some(why), ..link },
            None => link,
        }
    }
}
