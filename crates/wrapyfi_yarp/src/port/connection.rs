//! One connection that somebody opened to a port, from its header to its end.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::net::TcpStream;
use tokio::sync::{Notify, oneshot};

use super::core::{Core, Input, Sink};
use super::datagrams;
use super::inbox::Delivery;
use super::message::{PortPayload, Received};
use super::session::{Answer, Data, Event, Session, SessionError};
use super::target::Way;
use crate::wire::http::{self, Request};
use crate::wire::{Body, Carrier, Command, Fault, Opening, mjpeg};

/// An entry in the list of inputs, while this lives.
pub(super) struct Entered {
    core: Arc<Core>,
    id: u64,
    pub(super) name: Arc<str>,
    pub(super) stop: Arc<Notify>,
    messages: Arc<AtomicU64>,
}

impl Entered {
    /// Enters an input. A rooted name drives out the older connection of that name.
    pub(super) fn new(
        core: &Arc<Core>,
        name: String,
        carrier: String,
        connectionless: bool,
        push: bool,
    ) -> Self {
        let (stop, messages) = (Arc::new(Notify::new()), Arc::new(AtomicU64::new(0)));
        let shared: Arc<str> = name.as_str().into();
        let mut connections = core.connections();
        if name.starts_with('/') {
            for older in connections.inputs.iter().filter(|input| input.name == name) {
                older.stop.notify_one();
                core.counters.add("replaced");
            }
            connections.inputs.retain(|input| input.name != name);
        }
        let id = Core::new_id(&mut connections);
        connections.inputs.push(Input {
            id,
            name,
            carrier,
            connectionless,
            push,
            stop: Arc::clone(&stop),
            messages: Arc::clone(&messages),
        });
        core.ring(&connections);
        drop(connections);
        Self { core: Arc::clone(core), id, name: shared, stop, messages }
    }

    /// Hands data to whoever reads them; the answer for the sender.
    pub(super) async fn deliver(&self, data: Data) -> Answer {
        self.messages.fetch_add(1, Ordering::Relaxed);
        let core = &self.core;
        let Data { body, envelope, reply } = data;
        let is_text = matches!(body, Body::Text(_));
        let payload =
            match PortPayload::received(body, core.network.dialect(), core.network.limits()) {
                Ok(payload) => payload,
                Err(fault) => {
                    core.counters.count(&fault);
                    return Answer::Nothing;
                }
            };
        self.hand(self.received(payload, envelope, is_text), reply).await
    }

    /// Hands over what came without a session, and waits for room.
    pub(super) async fn put(&self, payload: PortPayload, envelope: Option<bytes::Bytes>) {
        self.messages.fetch_add(1, Ordering::Relaxed);
        self.hand(self.received(payload, envelope, false), false).await;
    }

    async fn hand(&self, received: Received, reply: bool) -> Answer {
        let core = &self.core;
        match &core.sink {
            Sink::Handler(handler) => handler(received, reply).await,
            Sink::Nobody => Answer::Nothing,
            Sink::Inbox(inbox) => {
                let (told, taken) = match core.role.when_taken {
                    true => Some(oneshot::channel()).unzip(),
                    false => (None, None),
                };
                let is_open = inbox.put(Delivery { received, taken: told }).await;
                // Dropped with the queue when the port closes: then nobody is left to be told.
                if let Some(taken) = taken.filter(|_| is_open) {
                    taken.await.ok();
                }
                Answer::Nothing
            }
        }
    }

    /// Hands data over when there is room now; datagrams cannot be held back.
    pub(super) async fn offer(&self, payload: PortPayload, envelope: Option<bytes::Bytes>) {
        self.messages.fetch_add(1, Ordering::Relaxed);
        let received = self.received(payload, envelope, false);
        match &self.core.sink {
            Sink::Handler(handler) => drop(handler(received, false).await),
            Sink::Nobody => {}
            Sink::Inbox(inbox) => {
                if !inbox.try_put(Delivery { received, taken: None }) {
                    self.core.counters.add("inbox_full");
                }
            }
        }
    }

    fn received(
        &self,
        payload: PortPayload,
        envelope: Option<bytes::Bytes>,
        is_text: bool,
    ) -> Received {
        Received {
            payload,
            envelope,
            from: Arc::clone(&self.name),
            connection: self.id,
            is_text,
            dialect: self.core.network.dialect(),
            limits: Arc::clone(&self.core.limits),
        }
    }
}

impl Drop for Entered {
    fn drop(&mut self) {
        let mut connections = self.core.connections();
        connections.inputs.retain(|input| input.id != self.id);
        self.core.ring(&connections);
    }
}

/// Next use of a connection after its session.
enum After {
    Close,
    /// The peer reads from now on.
    Reversed(Session),
    /// The peer asked for pictures.
    Pictures(Session),
}

/// Takes care of a connection.
pub(super) async fn run(core: Arc<Core>, stream: TcpStream) {
    let session = match Session::accept(stream, &core.session).await {
        Ok(session) => session,
        Err(error) => {
            tracing::trace!(target: "wrapyfi_yarp::port", name = core.name, %error, "refused");
            return;
        }
    };
    if let Opening::Messages { carrier, group, .. } = *session.opening()
        && carrier.is_connectionless()
    {
        datagrams::receive(core, session, group).await;
        return;
    }
    let sender = session.sender();
    let name = sender.name.clone();
    let entered = Entered::new(&core, name.clone(), session.carrier_text(), false, true);
    let after = tokio::select! {
        biased;
        () = entered.stop.notified() => After::Close,
        after = serve(&core, &entered, session) => after,
    };
    drop(entered);
    match after {
        After::Close => {}
        After::Reversed(session) => {
            let contact = session.peer().to_string();
            let carrier = session.carrier_text();
            let Some(stream) = session.into_tcp() else { return };
            let way = Way::Reversed(core.reversed(stream));
            core.start(&name, Carrier::Text, carrier, contact, way, None);
        }
        After::Pictures(session) => {
            let contact = session.peer().to_string();
            let Some(stream) = session.into_tcp() else { return };
            let mut link = core.reversed(stream);
            if link.write_raw(&[mjpeg::RESPONSE_HEAD.as_bytes()]).await.is_ok() {
                let carrier = Carrier::Mjpeg.name().to_owned();
                core.start(&name, Carrier::Mjpeg, carrier, contact, Way::Mjpeg(link), None);
            }
        }
    }
}

async fn serve(core: &Arc<Core>, entered: &Entered, mut session: Session) -> After {
    match serve_events(core, entered, &mut session).await {
        Ok(Turn::End) => After::Close,
        Ok(Turn::Reverse) => After::Reversed(session),
        Ok(Turn::Pictures) => After::Pictures(session),
        Err(error) => {
            let name = &core.name;
            tracing::debug!(target: "wrapyfi_yarp::port", name, from = &*entered.name, %error, "closed");
            if matches!(error, SessionError::Io(_)) {
                core.counters.add("connection_failed");
            }
            After::Close
        }
    }
}

enum Turn {
    End,
    Reverse,
    Pictures,
}

async fn serve_events(
    core: &Arc<Core>,
    entered: &Entered,
    session: &mut Session,
) -> Result<Turn, SessionError> {
    while let Some(event) = session.next().await? {
        match event {
            Event::Data(data) => {
                let answer = entered.deliver(data).await;
                let last = matches!(answer, Answer::Last(_));
                session.answer(answer).await?;
                if last {
                    return Ok(Turn::End);
                }
            }
            Event::Admin(request) => {
                let answer = core.administer(&request).await;
                session.answer(Answer::Bottle(answer)).await?;
            }
            Event::Command(Command::Reverse) if core.role.outputs && !core.role.client => {
                return Ok(Turn::Reverse);
            }
            Event::Command(command) => {
                let lines = core.command(&command).await;
                let answer = if session.is_text() { Answer::Lines(lines) } else { Answer::Nothing };
                session.answer(answer).await?;
            }
            Event::Http(request) => {
                let answer = if !request.wants_stream() {
                    page(core, &request)
                } else if core.role.outputs && !core.role.client && core.pictures {
                    return Ok(Turn::Pictures);
                } else {
                    let fault = Fault::NoPictures(core.name.clone());
                    core.counters.count(&fault);
                    http::not_acceptable(&fault.to_string())
                };
                session.answer(Answer::Raw(answer.into())).await?;
            }
            // Only name servers have an answer to these.
            Event::Line(_) => core.counters.add("name_request"),
        }
    }
    Ok(Turn::End)
}

/// Page that a browser is shown.
fn page(core: &Core, _request: &Request) -> Vec<u8> {
    let escaped = core.describe().replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    http::page(&format!(
        "<html><head><title>{name}</title></head><body><h1>yarp port {name}</h1>\
         <pre>{escaped}</pre></body></html>\n",
        name = core.name
    ))
}
