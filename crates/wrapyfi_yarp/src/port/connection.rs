//! One connection that somebody opened to a port, from its header to its end.

use std::sync::Arc;

use tokio::net::TcpStream;

use super::administration;
use super::core::Core;
use super::datagrams;
use super::entered::Entered;
use super::open::Admission;
use super::session::{Answer, Event, Session, SessionError};
use super::target::Way;
use crate::wire::http;
use crate::wire::{Carrier, Command, Fault, Opening, mjpeg};

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
    let address = session.peer().ip().to_string();
    let entered = Entered::new(&core, name.clone(), session.carrier_text(), false, true);
    let after = tokio::select! {
        biased;
        () = entered.stop.notified() => After::Close,
        after = serve(&core, &entered, session) => after,
    };
    drop(entered);
    if !matches!(after, After::Close)
        && let Err(fault) = Admission::check(core.readers.as_ref(), &name, &address)
    {
        return core.counters.count(&fault);
    }
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
                let answer = administration::administer(core, &request).await;
                session.answer(Answer::Bottle(answer)).await?;
            }
            Event::Command(Command::Reverse) if core.role.outputs && !core.role.client => {
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
