//! Connections that others open: to whom each belongs.
//!
//! ```text
//!   accept ─▶ header ─┬ service=/add ─▶ ServiceHost
//!                     ├ topic=/scan  ─▶ Publication of that type
//!                     └ neither      ─▶ error=…, closed
//! ```

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::sync::{Arc, Weak};
use std::time::Instant;

use tokio::net::TcpStream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::timeout;

use super::node::Node;
use super::recall::recall;
use super::tcpros::{
    Accepted, CONNECT, GreetingError, Port, accepted, accepting, hear, prepare, refuse,
};
use wrapyfi_endpoint::{Mutex, Throttle};

/// Lines of the log about connections that are refused: a flood of them is one line in [`Throttle::EVERY`] of each kind.
#[derive(Default)]
struct Refusals {
    /// For no place, and for headers that are none.
    connections: Mutex<Throttle>,
    /// For definitions that do not fit.
    subscribers: Mutex<Throttle>,
}

/// Logs a refusal, and the number of those that were not logged before it.
fn tell(throttle: &Mutex<Throttle>, peer: SocketAddr, what: &str, why: &str) {
    let Some(silent) = throttle.lock().pass(Instant::now()) else { return };
    match silent {
        0 => tracing::warn!(%peer, "ROS 1: refused a {what}: {why}"),
        silent => tracing::warn!(%peer, "ROS 1: refused a {what}, and {silent} before it: {why}"),
    }
}

/// Accepts connections until it is aborted. Those beyond the limit are refused at once.
pub(super) async fn accept(port: Arc<Port>, node: Weak<Node>) {
    let Port { listener, connections, places } = &*port;
    let (mut backoff, refusals) = (accepting(), Arc::<Refusals>::default());
    loop {
        let (mut stream, peer) = accepted(listener, &mut backoff).await;
        let (node, refusals) = (node.clone(), Arc::clone(&refusals));
        match Arc::clone(places).try_acquire_owned() {
            Ok(place) => {
                tokio::spawn(async move { welcome(stream, peer, place, &node, &refusals).await });
            }
            Err(_) => {
                let text = format!("{connections} connections are open, which is the limit");
                tell(&refusals.connections, peer, "connection", &text);
                // It fits into the socket's buffer: no program is waited for.
                tokio::spawn(async move { timeout(CONNECT, refuse(&mut stream, &text)).await });
            }
        }
    }
}

async fn welcome(
    mut stream: TcpStream,
    peer: SocketAddr,
    place: OwnedSemaphorePermit,
    node: &Weak<Node>,
    refusals: &Refusals,
) {
    if let Err(error) = prepare(&stream) {
        tracing::debug!(%peer, "ROS 1: {error}");
        return;
    }
    let header = match hear(&mut stream).await {
        Ok(header) => header,
        // It asked only whether a program is here, as `wrapyfi why` does.
        Err(GreetingError::Io(left)) if left.kind() == ErrorKind::UnexpectedEof => return,
        Err(error) => {
            let text = error.to_string();
            tell(&refusals.connections, peer, "connection", &text);
            refuse(&mut stream, &text).await;
            return;
        }
    };
    let Some(node) = node.upgrade() else { return };
    let mut accepted = Accepted { stream, header, peer, place };
    if let Some(service) = accepted.header.get("service") {
        let host = node.state().services.get(service).cloned();
        match host {
            Some(host) => return host.serve(accepted, &node.core).await,
            None => {
                let text = format!("{} does not offer service {service}", node.name.full());
                return refuse(&mut accepted.stream, &text).await;
            }
        }
    }
    let Some(topic) = accepted.header.get("topic") else {
        let text = "a connection header needs a topic or a service";
        return refuse(&mut accepted.stream, text).await;
    };
    let all = node.state().topics.get(topic).cloned().unwrap_or_default();
    let wanted = accepted.header.get("md5sum").unwrap_or_default();
    let fitting = all.iter().find(|one| one.wire_type.fits(wanted));
    match (fitting, all.first()) {
        (Some(publication), _) => match publication.refusal(&accepted) {
            None => {
                let subscriber = accepted.caller().to_owned();
                if !publication.serve(accepted, &node.core).await {
                    return;
                }
                let (core, publication) = (Arc::clone(&node.core), Arc::downgrade(publication));
                // Neither lives on for a subscriber that is lost.
                drop((node, all));
                recall(&core, &publication, &subscriber).await;
            }
            Some(text) => {
                tell(&refusals.subscribers, peer, "subscriber", &text);
                refuse(&mut accepted.stream, &text).await;
            }
        },
        (None, Some(other)) => {
            let wants = accepted.header.get("type").unwrap_or("*");
            all.iter().for_each(|one| one.misfits(accepted.caller(), wants));
            let other = &other.wire_type;
            let text = format!(
                "{} wants topic {topic} to be {wants} [{wanted}], but {} publishes {} [{}]: have \
                 both use the same definition",
                accepted.caller(),
                node.name.full(),
                other.name,
                other.md5,
            );
            tell(&refusals.subscribers, peer, "subscriber", &text);
            refuse(&mut accepted.stream, &text).await;
        }
        (None, None) => {
            let text = format!("{} does not publish {topic}", node.name.full());
            refuse(&mut accepted.stream, &text).await;
        }
    }
}
