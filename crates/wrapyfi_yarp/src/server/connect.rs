//! Connections between registered ports, made and ended as `yarp connect` and `yarp disconnect` do.
//!
//! ```text
//!   Pair::find("/cam", "tcp://view")      where is /cam, where is /view?
//!     is_connected   /cam: [list] [out] "/view"    how are they connected now?
//!     connect        /cam: [add] "tcp://view"      the sender opens the connection itself
//! ```
//!
//! With a carrier that pulls (`mjpeg`) the receiver is asked instead. A port that does not answer is
//! doubted from then on.

use std::sync::Arc;

use super::shared::Shared;
use crate::name::{Exchange, ExchangeError, Target, name_fault};
use crate::port::names::Registration;
use crate::wire::Command;
use crate::{Bottle, Limits, Value};

/// Error of connecting and disconnecting ports.
#[derive(Debug, thiserror::Error)]
pub(super) enum ConnectError {
    /// The name cannot be that of a port.
    #[error("port name {name:?} {reason}")]
    BadName { name: String, reason: String },
    /// No port of this name is registered.
    #[error("there is no port {name}: see which there are with yarp name list")]
    Unknown { name: String },
    /// The port that should do it does not answer.
    #[error("port {name} does not answer: {source}")]
    Port { name: String, source: ExchangeError },
    /// The port that should do it would not.
    #[error("port {name} would not: {reason}")]
    Refused { name: String, reason: String },
}

/// Two registered ports, and how they are to be connected.
pub(super) struct Pair<'a> {
    shared: &'a Arc<Shared>,
    src: Registration,
    dest: Registration,
    /// Carrier with its qualifiers.
    carrier: String,
    pull: bool,
}

impl<'a> Pair<'a> {
    /// Finds two ports. Either may have a carrier before it (`fast_tcp://view`); that of the
    /// receiver counts, then that of the sender, then the one that the receiver is registered with.
    pub(super) fn find(
        shared: &'a Arc<Shared>,
        src: &str,
        dest: &str,
    ) -> Result<Self, ConnectError> {
        let (from, to) = (Target::parse(src), Target::parse(dest));
        let (mut src, mut dest) = (lookup(shared, &from)?, lookup(shared, &to)?);
        let named = [to.carrier, from.carrier].into_iter().find(|carrier| !carrier.is_empty());
        let carrier = named.unwrap_or_else(|| dest.carrier.clone());
        let pull = Target { carrier: carrier.clone(), ..Target::default() }.is_pull();
        // A network chooses an address; the ports know each other by their names.
        (src.name, dest.name) = (rooted(from.name), rooted(to.name));
        Ok(Self { shared, src, dest, carrier, pull })
    }

    /// True when the ports are connected by the carrier that [`Pair::connect`] would use.
    pub(super) async fn is_connected(&self) -> Result<bool, ConnectError> {
        let now = self.listed().await?;
        Ok(now.find("carrier").is_some_and(|carrier| carrier.is_word(&self.carrier)))
    }

    /// Connects the ports.
    pub(super) async fn connect(&self) -> Result<(), ConnectError> {
        let (asked, other, _) = self.sides();
        self.listed().await?;
        let add = [Value::vocab("add"), format!("{}:/{other}", self.carrier).into()];
        let connected = self.obeyed(asked, add).await;
        if let Err(ConnectError::Refused { .. }) = connected {
            self.shared.doubt(&self.dest.name);
        }
        connected
    }

    /// Ends the connection; [`ConnectError::Refused`] where there is none.
    pub(super) async fn disconnect(&self) -> Result<(), ConnectError> {
        let (asked, other, _) = self.sides();
        let now = self.listed().await?;
        let pulled = now.find("push").is_some_and(|push| push.as_i64() == Some(0));
        let silent = now.find("connectionless").is_some_and(|flag| flag.as_i64() == Some(1));
        if silent && pulled != self.pull {
            // The other side would go on sending: nobody else tells it.
            let (told, about) =
                if self.pull { (&self.src, &self.dest) } else { (&self.dest, &self.src) };
            self.ask(told, [Value::vocab("del"), about.name.as_str().into()]).await?;
        }
        self.obeyed(asked, [Value::vocab("del"), other.into()]).await
    }

    /// Port that is asked, name of the port that the question is about, and the direction.
    fn sides(&self) -> (&Registration, &str, &'static str) {
        if self.pull {
            (&self.dest, &self.src.name, "in")
        } else {
            (&self.src, &self.dest.name, "out")
        }
    }

    /// Connection between the two as it is now, in the asked port's words; empty where there is none.
    async fn listed(&self) -> Result<Bottle, ConnectError> {
        let (asked, other, side) = self.sides();
        self.ask(asked, [Value::vocab("list"), Value::vocab(side), other.into()]).await
    }

    /// Has a port carry out a request.
    async fn obeyed(&self, port: &Registration, request: [Value; 2]) -> Result<(), ConnectError> {
        let answer = self.ask(port, request).await?;
        let words = answer.get(1).and_then(Value::as_str).unwrap_or_default();
        match answer.get(0).and_then(Value::as_i64) {
            Some(0) => Ok(()),
            _ => Err(ConnectError::Refused {
                name: port.name.clone(),
                reason: if words.is_empty() { answer.to_text() } else { words.trim().to_owned() },
            }),
        }
    }

    /// Asks a port's administration. A port that does not answer is doubted.
    async fn ask(
        &self,
        port: &Registration,
        request: impl IntoIterator<Item = Value>,
    ) -> Result<Bottle, ConnectError> {
        let options = &self.shared.options;
        let exchange = Exchange::to(port, options.link_timeout, &options.wire);
        let asked = exchange.bottle(&Command::Admin, &request.into_iter().collect()).await;
        asked.map_err(|source| {
            self.shared.doubt(&port.name);
            ConnectError::Port { name: port.name.clone(), source }
        })
    }
}

/// Finds a port, whatever stands before its name.
fn lookup(shared: &Shared, target: &Target) -> Result<Registration, ConnectError> {
    let name = rooted(target.name.clone());
    if let Some(reason) = name_fault(&name, Limits::default().max_name_bytes) {
        return Err(ConnectError::BadName { name, reason });
    }
    let found = shared.state().registry.find(&name, &target.network);
    found.ok_or(ConnectError::Unknown { name })
}

/// `tcp:/cam` names /cam as well as `tcp://cam` does.
fn rooted(name: String) -> String {
    if name.starts_with('/') || name == "..." { name } else { format!("/{name}") }
}
