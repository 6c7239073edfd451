//! One connection that somebody opened to a port, from its header to its end.

use std::sync::Arc;

use tokio::net::TcpStream;

use super::administration;
use super::core::{Core, Role};
use super::datagrams;
use super::entered::Entered;
use super::open::Admission;
use super::session::{Answer, Event, Session, SessionError};
use super::target::Way;
use crate::wire::http;
use crate::wire::{Carrier, Command, Fault, Opening, mjpeg};

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
    let mut session = match Session::accept(stream, &core.session).await {
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
    let address = session.peer().ip().to_string();
    let entered = Entered::new(&core, name.clone(), session.carrier_text(), false, true);
    let turn = tokio::select! {
        biased;
        () = entered.stop.notified() => Turn::End,
        turn = serve(&core, &entered, &mut session) => turn.unwrap_or_else(|error| {
            let (name, from) = (&core.name, &*entered.name);
            tracing::debug!(target: "wrapyfi_yarp::port", name, from, %error, "closed");
            if matches!(error, SessionError::Io(_)) {
                core.counters.add("connection_failed");
            }
            Turn::End
        }),
    };
    drop(entered);
    if matches!(turn, Turn::End) {
        return;
    }
    if let Err(fault) = Admission::check(core.readers.as_ref(), &name, &address) {
        return core.counters.count(&fault);
    }
    let (carrier, contact) = (session.carrier_text(), session.peer().to_string());
    let Some(stream) = session.into_tcp() else { return };
    let mut link = core.reversed(stream);
    if matches!(turn, Turn::Reverse) {
        core.start(&name, Carrier::Text, carrier, contact, Way::Reversed(link), None);
    } else if link.write_raw(&[mjpeg::RESPONSE_HEAD.as_bytes()]).await.is_ok() {
        let carrier = Carrier::Mjpeg.name().to_owned();
        core.start(&name, Carrier::Mjpeg, carrier, contact, Way::Mjpeg(link), None);
    }
}

async fn serve(
    core: &Arc<Core>,
    entered: &Entered,
    session: &mut Session,
) -> Result<Turn, SessionError> {
    while let Some(event) = session.next().await? {
        match event {
            Event::Data(data) => {
                let answer = entered.deliver(data).await;
                session.answer(answer).await?;
            }
            Event::Admin(request) => {
                let answer = administration::administer(core, &request).await;
                session.answer(Answer::Bottle(answer)).await?;
            }
            Event::Command(Command::Reverse) if core.role == Role::Output => {
                return Ok(Turn::Reverse);
            }
            Event::Command(command) => {
                let lines = administration::command(core, &command).await;
                let answer = if session.is_text() { Answer::Lines(lines) } else { Answer::Nothing };
                session.answer(answer).await?;
            }
            Event::Http(request) => {
                let answer = if !request.wants_stream() {
                    page(core)
                } else if core.role == Role::Output && core.pictures {
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
fn page(core: &Arc<Core>) -> Vec<u8> {
    let escaped = administration::describe(core)
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    http::page(&format!(
        "<html><head><title>{name}</title></head><body><h1>yarp port {name}</h1>\
         <pre>{escaped}</pre></body></html>\n",
        name = core.name
    ))
}
