//! The sockets of a name server: one task a connection.
//!
//! ```text
//!   accept ──▶ Session ──▶ Line, Data ──▶ Shared::apply ──▶ lines or a bottle
//!                      ├─▶ Admin, Command ──▶ as any port answers them
//!                      ├─▶ Http ──▶ page
//!                      └─▶ r ──▶ the connection becomes a reader of changes
//! ```

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use bytes::Bytes;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, watch};

use super::commands::Outcome;
use super::shared::{SessionEntry, Shared};
use super::{events, http};
use crate::Bottle;
use crate::port::ConnectionStatus;
use crate::port::accept::accept;
use crate::port::administration::{self, Administered};
use crate::port::link::Link;
use crate::port::session::{Answer, Event, Session, SessionError, SessionOptions};
use crate::wire::admin::{self, Direction};
use crate::wire::{Body, Carrier, Command, Opening};

/// Accepts until it is told to stop.
pub(super) async fn serve(
    listener: TcpListener,
    shared: Arc<Shared>,
    mut stopping: watch::Receiver<bool>,
) {
    let options = SessionOptions {
        dialect: shared.options.dialect,
        limits: shared.options.wire.clone(),
        handshake_timeout: shared.options.handshake_timeout,
        own_port: shared.own.port,
        runtime_folder: None,
        counters: Arc::clone(&shared.counters),
        ..SessionOptions::default()
    };
    let options = Arc::new(options);
    let serve = |stream, peer| attend(stream, peer, Arc::clone(&shared), Arc::clone(&options));
    let limit = shared.options.limits.max_connections;
    // An error means that nobody can stop us any more: the server was dropped.
    let end = async { _ = stopping.changed().await };
    let mut connections =
        accept(&shared.own.name, &listener, limit, &shared.counters, serve, end).await;
    drop(listener);
    shared.links.end();
    shared.readers.farewell().await;
    connections.shutdown().await;
}

/// One connection, from its header to its end.
async fn attend(
    stream: TcpStream,
    peer: SocketAddr,
    shared: Arc<Shared>,
    options: Arc<SessionOptions>,
) {
    let session = match Session::accept(stream, &options).await {
        Ok(session) => session,
        Err(SessionError::Silent) => return, // somebody looked whether we are there
        Err(error) => {
            tracing::debug!(target: "wrapyfi_yarp::server", %peer, %error, "no session");
            return;
        }
    };
    let id = shared.next_session.fetch_add(1, Relaxed);
    let end = Arc::new(Notify::new());
    let entry = SessionEntry {
        sender: session.sender().name,
        carrier: session.carrier_text(),
        end: Arc::clone(&end),
    };
    // Two connections of one port do not live together; peers that are no ports may have many.
    if entry.sender.starts_with('/') {
        for other in shared.sessions.lock().values().filter(|other| other.sender == entry.sender) {
            other.end.notify_one();
        }
    }
    shared.sessions.lock().insert(id, entry);
    let listed = Listed { id, shared: &shared };
    tokio::select! {
        ended = converse(session, &shared) => match ended {
            Ok(()) => {}
            Err(error) => {
                tracing::debug!(target: "wrapyfi_yarp::server", %peer, %error, "session ended");
            }
        },
        () = end.notified() => {}
    }
    drop(listed);
}

/// Takes a session off the list, however it ends.
struct Listed<'a> {
    id: u64,
    shared: &'a Shared,
}

impl Drop for Listed<'_> {
    fn drop(&mut self) {
        self.shared.sessions.lock().remove(&self.id);
    }
}

async fn converse(mut session: Session, shared: &Arc<Shared>) -> Result<(), SessionError> {
    let peer = session.peer().ip();
    if let Opening::Messages { carrier, .. } = session.opening()
        && carrier.is_connectionless()
    {
        // Nobody sends commands in datagrams, and answers could not go back.
        shared.counters.add("unsupported_carrier");
        return Ok(());
    }
    let one_line = matches!(session.opening(), Opening::Names(_));
    loop {
        let next = session.next();
        let event = if one_line {
            match tokio::time::timeout(shared.options.idle_timeout, next).await {
                Ok(event) => event?,
                Err(_) => {
                    shared.counters.add("idle");
                    return Ok(());
                }
            }
        } else {
            next.await?
        };
        let Some(event) = event else { return Ok(()) };
        let answer = match event {
            Event::Line(line) => {
                reply(&shared.apply_body(&Body::Text(line), Some(peer)), true, shared)
            }
            Event::Data(data) => {
                let outcome = shared.apply_body(&data.body, Some(peer));
                if data.reply {
                    reply(&outcome, session.is_text(), shared)
                } else {
                    Answer::Nothing
                }
            }
            Event::Admin(request) => {
                Answer::Bottle(administration::administer(shared, &request).await)
            }
            Event::Http(request) => Answer::Raw(http::answer(&request, shared, peer)),
            Event::Command(Command::Reverse) if session.is_text() => {
                let carrier = match session.opening() {
                    Opening::Messages { carrier, .. } => *carrier,
                    Opening::Names(_) | Opening::Http(_) => Carrier::Text,
                };
                let (name, text) = (session.sender().name, session.carrier_text());
                let Some(stream) = session.into_tcp() else { return Ok(()) };
                let link = Link::reversed(stream, carrier, shared.network.link_options());
                shared.readers.add(name, text, link, shared);
                return Ok(());
            }
            Event::Command(command) => {
                let lines = administration::command(shared, &command).await;
                if session.is_text() { Answer::Lines(lines) } else { Answer::Nothing }
            }
        };
        session.answer(answer).await?;
    }
}

/// The bytes of an answer, whatever form the command came in.
fn reply(outcome: &Outcome, text: bool, shared: &Shared) -> Answer {
    let mut bytes = Vec::new();
    if text {
        outcome.reply.write_text(&mut bytes);
    } else if let Err(error) = outcome.reply.write_binary(&mut bytes, shared.options.dialect) {
        // Nothing that was stored comes from the other dialect: this cannot be sent by anybody.
        tracing::warn!(target: "wrapyfi_yarp::server", %error, "answer not sent");
        return Answer::Bottle(admin::fail(Some(&error.to_string())));
    }
    Answer::Raw(Bytes::from(bytes))
}

/// The name server's own port: readers of changes are its outputs, sessions its inputs.
impl Administered for Arc<Shared> {
    fn name(&self) -> &str {
        &self.own.name
    }

    fn contact(&self) -> String {
        format!("{}:{}", self.own.host, self.own.port)
    }

    fn connections(&self, direction: Direction) -> Vec<ConnectionStatus> {
        let listed = |(name, carrier)| ConnectionStatus {
            name,
            carrier,
            incoming: direction == Direction::In,
            connectionless: false,
            push: true,
        };
        match direction {
            Direction::Out => self.readers.names().into_iter().map(listed).collect(),
            Direction::In => {
                let sessions = self.sessions.lock();
                let of = |entry: &SessionEntry| (entry.sender.clone(), entry.carrier.clone());
                sessions.values().map(of).map(listed).collect()
            }
        }
    }

    async fn add(&self, destination: &str) -> Result<String, String> {
        events::connect(destination, self).await
    }

    async fn remove_output(&self, name: &str) -> bool {
        self.readers.remove(name)
    }

    fn remove_input(&self, name: &str) -> bool {
        let sessions = self.sessions.lock();
        let found = sessions.values().filter(|entry| entry.sender == name);
        found.inspect(|entry| entry.end.notify_one()).count() > 0
    }

    fn set_property(&self, _key: &str, _values: Bottle) -> Bottle {
        admin::fail(None)
    }

    fn property(&self, _key: Option<&str>) -> Bottle {
        Bottle::new()
    }
}
