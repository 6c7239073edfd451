//! One connection that a program opened to a port, from its header to its end.

use std::sync::Arc;

use tokio::net::TcpStream;
use tokio::time::timeout;

use super::administration;
use super::core::{Core, Role};
use super::datagrams;
use super::entered::Entered;
use super::link::{Link, LinkError};
use super::open::Admission;
use super::output::Peer;
use super::session::{Answer, Event, Session};
use super::target::Way;
use crate::wire::http;
use crate::wire::{Carrier, Command, Fault, mjpeg};

/// Next use of a connection after its session.
enum Turn {
    End,
    /// The peer reads from now on.
    Reverse,
    /// The peer asked for pictures.
    Pictures,
}

/// Takes care of a connection.
pub(super) async fn run(core: Arc<Core>, stream: TcpStream) {
    let session = match Session::accept(stream, &core).await {
        Ok(session) => session,
        Err(error) => {
            tracing::trace!(target: "wrapyfi_yarp::port", name = core.name, %error, "refused");
            return;
        }
    };
    if !session.carrier.is_some_and(Carrier::is_connectionless) {
        let entered = Entered::new(&core, &session);
        attend(core, session, entered).await;
    } else if core.name_service.is_some() {
        // No program sends commands in datagrams, and answers could not go back.
        core.fault_counts.add("unsupported_carrier");
    } else {
        datagrams::receive(core, session).await;
    }
}

/// Takes care of a session until it ends.
pub(super) async fn attend(core: Arc<Core>, mut session: Session, entered: Entered) {
    let turn = tokio::select! {
        biased;
        () = entered.stop.notified() => Turn::End,
        turn = serve(&core, &entered, &mut session) => turn.unwrap_or_else(|error| {
            let (name, from) = (&core.name, &*entered.name);
            tracing::debug!(target: "wrapyfi_yarp::port", name, from, %error, "closed");
            if matches!(error, LinkError::Io(_)) {
                core.fault_counts.add("connection_failed");
            }
            Turn::End
        }),
    };
    drop(entered);
    if matches!(turn, Turn::End) || core.is_full() {
        return;
    }
    let (name, address) = (session.name.clone(), session.peer.ip().to_string());
    if let Err(fault) = Admission::check(core.options.readers.as_ref(), &name, &address) {
        return core.fault_counts.count(&fault);
    }
    let (contact, carrier_text) = (session.peer.to_string(), session.carrier_text.clone());
    let Some(stream) = session.into_tcp() else { return };
    let mut link = Link::reversed(stream, Carrier::Text, core.network.link_options());
    if matches!(turn, Turn::Reverse) {
        let peer = Peer { name, carrier: Carrier::Text, carrier_text, contact };
        core.start(peer, Way::Reversed(link));
    } else if link.write_raw(&[mjpeg::RESPONSE_HEAD.as_bytes()]).await.is_ok() {
        let carrier_text = Carrier::Mjpeg.name().to_owned();
        let peer = Peer { name, carrier: Carrier::Mjpeg, carrier_text, contact };
        core.start(peer, Way::Mjpeg(link));
    }
}

async fn serve(
    core: &Arc<Core>,
    entered: &Entered,
    session: &mut Session,
) -> Result<Turn, LinkError> {
    let asker = session.peer.ip();
    let service = core.name_service.as_ref();
    let idle = service.filter(|_| session.is_one_line()).map(|names| names.idle_timeout);
    loop {
        let next = session.next();
        let event = match idle {
            None => next.await?,
            Some(limit) => match timeout(limit, next).await {
                Ok(event) => event?,
                Err(_elapsed) => {
                    core.fault_counts.add("idle");
                    return Ok(Turn::End);
                }
            },
        };
        let Some(event) = event else { return Ok(Turn::End) };
        // A name server that has ended answers nothing.
        let names = service.and_then(|service| service.requests.upgrade());
        let answer = match event {
            Event::Line(line) => match names {
                Some(names) => names.answer(&line, asker),
                // Only name servers have an answer to these.
                None => {
                    core.fault_counts.add("name_request");
                    continue;
                }
            },
            Event::Data(data) => match names {
                Some(names) => {
                    let answer = names.answer(&data.body, asker);
                    if data.reply { answer } else { Answer::Nothing }
                }
                None => entered.deliver(data).await,
            },
            Event::Admin(request) => {
                Answer::Bottle(administration::administer(core, &request).await)
            }
            Event::Command(Command::Reverse) if core.role == Role::Output => {
                return Ok(Turn::Reverse);
            }
            Event::Command(command) => {
                let lines = administration::command(core, &command).await;
                if session.is_text() { Answer::Raw(lines.into()) } else { Answer::Nothing }
            }
            Event::Http(request) => Answer::Raw(match names {
                Some(names) => names.page(&request, asker),
                None if !request.wants_stream() => page(core).into(),
                None if core.role == Role::Output && core.options.pictures => {
                    return Ok(Turn::Pictures);
                }
                None => {
                    let fault = Fault::NoPictures(core.name.clone());
                    core.fault_counts.count(&fault);
                    http::not_acceptable(&fault.to_string()).into()
                }
            }),
        };
        session.answer(answer).await?;
    }
}

/// Page that a browser is shown.
fn page(core: &Core) -> Vec<u8> {
    http::page(&format!(
        "<html><head><title>{name}</title></head><body><h1>yarp port {name}</h1>\
         <pre>{}</pre></body></html>\n",
        http::escape(&administration::describe(core)),
        name = core.name
    ))
}
