//! Offers a service: a port that answers.
//!
//! ```text
//!   /rpc:in3 ── request ──▶ handler ──▶ queue ──▶ take ── payload::decode_request
//!                              ▲ waits                  reply ── payload::encode_reply ─┐
//!                              └────────────────────────────────────────────────────────┘
//! ```
//!
//! An answer is of the dialect of its request ([`super::manner`]), and under `bottle: auto` of its form.
//!
//! A YARP client asks one thing at a time on a connection, and waits for as long as it wants to: so a
//! request that is not answered in its time is answered by an error.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

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
use crate::codec::EncodeError;
use crate::endpoint::calls::ends;
use crate::endpoint::{
    Context, DropReason, IncomingRequest, Link, OpenError, RequestId, ServeError, Server,
    ServiceSpec,
};
use crate::types::{Payload, ServiceKind};

/// Offers one service.
pub(super) struct YarpServer {
    desk: Arc<Desk>,
    shared: Arc<Shared>,
    open: HashMap<RequestId, Open>,
    next: u64,
    _stop: Stop,
}

/// A request with its user.
struct Open {
    reply: oneshot::Sender<Reply>,
    manner: Manner,
    received_at: Instant,
    until: Instant,
}

/// A request that nobody has taken.
struct Asked {
    body: Bytes,
    reply: oneshot::Sender<Reply>,
    manner: Manner,
    received_at: Instant,
}

/// How a request was written.
#[derive(Debug, Clone, Copy)]
struct Manner {
    /// As far as it shows.
    dialect: Option<Dialect>,
    form: Form,
}

/// What goes back.
enum Reply {
    Known(Bytes),
    /// In the dialect that is set, and in the other one, which the client may have.
    Either(Bytes, Bytes),
}

/// What the server shares with its port.
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
    waiting: Mutex<Waiting>,
    losses: Losses,
}

#[derive(Default)]
struct Waiting {
    queue: VecDeque<Asked>,
    /// With the user.
    open: usize,
    closed: bool,
}

impl Desk {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn port(&self) -> MutexGuard<'_, Option<RpcServer>> {
        self.port.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn dropped(&self, reason: DropReason) {
        self.context.counters.dropped(reason);
    }

    /// Why there is no reply. It has no floats, and so no dialect.
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
        // What only one dialect has a form for is written in that one.
        let other = write(self.dialect.other()).ok().filter(|other| *other != body);
        Ok((body, other))
    }

    /// Whether it takes calls as Wrapyfi's functions do.
    fn is_function(&self) -> bool {
        let is_ros = matches!(self.spec.kind, ServiceKind::Ros(_));
        !is_ros && self.options.bottle.unwrap_or_default() == Form::Json
    }

    /// Takes a request in and waits for its answer.
    async fn ask(&self, received: Received, wants_reply: bool) -> Answer {
        let dialect = self.clients.dialect(&received);
        let body = received.payload.bytes.clone();
        let manner = Manner { dialect, form: manner::form(&body) };
        self.context.counters.received(body.len());
        let (reply, answered) = oneshot::channel();
        let over = {
            let mut waiting = self.waiting();
            if waiting.closed {
                Some(format!("{:?} has ended", self.spec.service))
            } else if waiting.open + waiting.queue.len() >= self.spec.pending {
                self.dropped(DropReason::Overloaded);
                let (service, limit) = (self.spec.service.clone(), self.spec.pending);
                Some(ServeError::Overloaded { service, limit }.to_string())
            } else {
                let received_at = Instant::now();
                waiting.queue.push_back(Asked { body, reply, manner, received_at });
                None
            }
        };
        if let Some(why) = over {
            let answer = || Answer::Object(self.error(&why, manner));
            return if wants_reply { answer() } else { Answer::Nothing };
        }
        self.context.wake.ring();
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

    fn timeout_ms(&self) -> u64 {
        u64::try_from(self.spec.timeout.as_millis()).unwrap_or(u64::MAX)
    }
}

impl YarpServer {
    pub(super) fn open(
        shared: &Arc<Shared>,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Self, OpenError> {
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
            waiting: Mutex::default(),
            losses: Losses::default(),
        });
        let (stop, stopped) = shared.tasks.stop();
        shared.tasks.spawn(keep(Arc::clone(shared), Arc::clone(&desk), stopped));
        let (shared, open) = (Arc::clone(shared), HashMap::new());
        Ok(Self { desk, shared, open, next: 0, _stop: stop })
    }

    fn close(&mut self, id: RequestId) -> Option<Open> {
        let open = self.open.remove(&id)?;
        self.desk.waiting().open = self.open.len();
        Some(open)
    }

    fn end_expired(&mut self) {
        let now = Instant::now();
        let over = self.open.iter().filter(|(_, open)| open.until <= now);
        let over: Vec<RequestId> = over.map(|(id, _)| *id).collect();
        for id in over {
            let Some(open) = self.close(id) else { continue };
            self.desk.dropped(DropReason::Expired);
            let (service, limit) = (&self.desk.spec.service, self.desk.timeout_ms());
            let text = format!("{service:?} did not answer within {limit} ms");
            // Whoever asked may be gone.
            let error = self.desk.error(&text, open.manner);
            open.reply.send(Reply::Known(error)).ok();
        }
    }
}

/// The life of a port.
async fn keep(shared: Arc<Shared>, desk: Arc<Desk>, mut stopped: Stopped) {
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
    let left = {
        let mut waiting = desk.waiting();
        waiting.closed = true;
        std::mem::take(&mut waiting.queue)
    };
    drop(left);
    let port = desk.port().take();
    if let Some(port) = port {
        port.close().await;
    }
    shared.own.remove(name);
    desk.standing.waiting("YARP, which has ended");
}

impl Server for YarpServer {
    fn take(&mut self) -> Result<Option<IncomingRequest>, ServeError> {
        self.end_expired();
        let (asked, open) = {
            let mut waiting = self.desk.waiting();
            let Some(asked) = waiting.queue.pop_front() else { return Ok(None) };
            waiting.open = self.open.len() + 1;
            (asked, self.open.len())
        };
        let Asked { body, reply, manner, received_at } = asked;
        let Desk { spec, options, dialect, .. } = &*self.desk;
        let options = self.desk.forms.of(options, manner.form);
        let dialect = manner.dialect.unwrap_or(*dialect);
        match payload::decode_request(&body, spec, options, dialect) {
            Ok(request) => {
                self.next += 1;
                let id = RequestId(self.next);
                let until = ends(Instant::now(), spec.timeout);
                self.open.insert(id, Open { reply, manner, received_at, until });
                Ok(Some(IncomingRequest { id, request, wire_bytes: body.len(), received_at }))
            }
            Err(fault) => {
                self.desk.waiting().open = open;
                let reason = fault.drop_reason();
                self.desk.dropped(reason);
                let (service, fault) = (spec.service.clone(), fault.to_string());
                let error = ServeError::Request { service, fault, reason };
                reply.send(Reply::Known(self.desk.error(&error.to_string(), manner))).ok();
                Err(error)
            }
        }
    }

    fn reply(
        &mut self,
        id: RequestId,
        answer: Result<Payload, String>,
    ) -> Result<usize, ServeError> {
        let Open { reply, manner, received_at, .. } =
            self.close(id).ok_or_else(|| ServeError::NotWaiting {
                service: self.desk.spec.service.clone(),
                timeout_ms: self.desk.timeout_ms(),
            })?;
        let (body, other) = match answer {
            Err(reason) => (self.desk.error(&reason, manner), None),
            Ok(answer) => match self.desk.write(&answer, manner) {
                Ok(written) => written,
                Err(fault) => {
                    self.desk.dropped(DropReason::Unencodable);
                    let service = self.desk.spec.service.clone();
                    let error = ServeError::Reply { service, fault };
                    reply.send(Reply::Known(self.desk.error(&error.to_string(), manner))).ok();
                    return Err(error);
                }
            },
        };
        let bytes = body.len();
        // Whoever asked may be gone: then nobody waits for it any more.
        reply
            .send(other.map_or_else(
                || Reply::Known(body.clone()),
                |other| Reply::Either(body.clone(), other),
            ))
            .ok();
        self.desk.context.counters.sent(bytes, received_at.elapsed());
        Ok(bytes)
    }

    fn deadline(&self) -> Option<Instant> {
        self.open.values().map(|open| open.until).min()
    }

    fn link(&self) -> Link {
        let link = self.desk.standing.link();
        match self.shared.taken(&self.desk.name) {
            Some(why) => Link { waiting_for: Some(why), ..link },
            None => link,
        }
    }
}
