//! Connecting ports that belong to others, as `yarp connect` does.
//!
//! ```text
//!   connect("/cam", "tcp://view")
//!     names: where is /cam, where is /view?
//!     /cam:  [list] [out] "/view"          how are they connected now?
//!     /cam:  [add] "tcp://view"            the sender opens the connection itself
//! ```
//!
//! With a carrier that pulls (`mjpeg`) the receiver is asked instead. A port that does not answer is
//! reported to the name server.

use std::time::Duration;

use super::exchange::{Exchange, ExchangeError};
use super::{Target, name_fault};
use crate::port::names::{Names, NamesError, Registration};
use crate::wire::Command;
use crate::{Bottle, Limits, Value};

/// Error of connecting, disconnecting or inspecting ports.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The name cannot be that of a port.
    #[error("port name {name:?} {reason}")]
    BadName {
        /// Name.
        name: String,
        /// Rule that the name breaks.
        reason: String,
    },
    /// The name server does not know it.
    #[error("there is no port {name}: see which there are with yarp name list")]
    Unknown {
        /// Name.
        name: String,
    },
    /// The name server does not answer.
    #[error("cannot find port {name}: {source}")]
    Names {
        /// Name that was looked for.
        name: String,
        /// Failure of the name server.
        source: NamesError,
    },
    /// The port that should do it does not answer.
    #[error("port {name} does not answer: {source}")]
    Port {
        /// Port that was asked.
        name: String,
        /// Failure of the exchange.
        source: ExchangeError,
    },
    /// The port that should do it would not.
    #[error("port {name} would not: {reason}")]
    Refused {
        /// Port that was asked.
        name: String,
        /// Reason in the port's words.
        reason: String,
    },
}

/// Settings of the requests to ports.
#[derive(Debug, Clone)]
pub struct ConnectOptions {
    /// Longest time that each request may take.
    pub timeout: Duration,
    /// Limits of answers.
    pub limits: Limits,
}

impl Default for ConnectOptions {
    fn default() -> Self {
        Self { timeout: super::client::DEFAULT_TIMEOUT, limits: Limits::default() }
    }
}

/// Two ports, found, and how they are to be connected.
struct Pair {
    src: Registration,
    dest: Registration,
    /// Carrier with its qualifiers.
    carrier: String,
    pull: bool,
}

impl Pair {
    /// Port that is asked, name of the port that the question is about, and the direction.
    fn sides(&self) -> (&Registration, &str, &'static str) {
        if self.pull {
            (&self.dest, &self.src.name, "in")
        } else {
            (&self.src, &self.dest.name, "out")
        }
    }
}

/// Connects two ports. Either may have a carrier before it (`fast_tcp://view`); that of the
/// receiver counts, then that of the sender, then `tcp`.
///
/// # Errors
/// As [`ConnectError`].
pub async fn connect(
    names: &dyn Names,
    src: &str,
    dest: &str,
    options: &ConnectOptions,
) -> Result<(), ConnectError> {
    let pair = find(names, src, dest).await?;
    let (asked, other, _) = pair.sides();
    listed(names, &pair, options).await?;
    let request = [Value::vocab("add"), format!("{}:/{other}", pair.carrier).into()];
    let answer = administer(names, asked, request.into_iter().collect(), options).await?;
    match accepted(asked, &answer) {
        Ok(()) => Ok(()),
        Err(refused) => {
            report(names, &pair.dest.name).await;
            Err(refused)
        }
    }
}

/// Ends the connection of two ports.
///
/// # Errors
/// As [`ConnectError`]; [`ConnectError::Refused`] where there is no such connection.
pub async fn disconnect(
    names: &dyn Names,
    src: &str,
    dest: &str,
    options: &ConnectOptions,
) -> Result<(), ConnectError> {
    let pair = find(names, src, dest).await?;
    let (asked, other, _) = pair.sides();
    let now = listed(names, &pair, options).await?;
    let pulled = now.find("push").is_some_and(|push| push.as_i64() == Some(0));
    let silent = now.find("connectionless").is_some_and(|flag| flag.as_i64() == Some(1));
    if silent && pulled != pair.pull {
        // The other side would go on sending: nobody else tells it.
        let (told, about) =
            if pair.pull { (&pair.src, &pair.dest) } else { (&pair.dest, &pair.src) };
        let request = [Value::vocab("del"), about.name.as_str().into()];
        administer(names, told, request.into_iter().collect(), options).await?;
    }
    let request = [Value::vocab("del"), other.into()];
    accepted(asked, &administer(names, asked, request.into_iter().collect(), options).await?)
}

/// True when two ports are connected by the carrier that [`connect`] would use.
///
/// # Errors
/// As [`ConnectError`].
pub async fn is_connected(
    names: &dyn Names,
    src: &str,
    dest: &str,
    options: &ConnectOptions,
) -> Result<bool, ConnectError> {
    let pair = find(names, src, dest).await?;
    let now = listed(names, &pair, options).await?;
    Ok(now.find("carrier").is_some_and(|carrier| carrier.is_word(&pair.carrier)))
}

/// True when a port is registered and answers: as `yarp exists`.
///
/// # Errors
/// When the name server does not answer, or the name is none.
pub async fn exists(
    names: &dyn Names,
    name: &str,
    options: &ConnectOptions,
) -> Result<bool, ConnectError> {
    let port = match lookup(names, name).await {
        Ok(port) => port,
        Err(ConnectError::Unknown { .. }) => return Ok(false),
        Err(error) => return Err(error),
    };
    let exchange = Exchange::to(&port, options.timeout, &options.limits);
    // Two connections, as YARP: the first without a byte finds out quickly that nobody listens.
    if exchange.in_time(exchange.open()).await.is_err() {
        return Ok(false);
    }
    let request = Bottle::from(vec![Value::vocab("ver")]);
    let answer = exchange.bottle(&Command::Admin, &request).await;
    Ok(answer.is_ok_and(|answer| answer.get(0).is_some_and(|word| word.is_word("ver"))))
}

/// Description that a port gives of itself and its connections, line by line: as `yarp ping`.
///
/// # Errors
/// As [`ConnectError`].
pub async fn ping(
    names: &dyn Names,
    name: &str,
    options: &ConnectOptions,
) -> Result<Vec<String>, ConnectError> {
    let port = lookup(names, name).await?;
    let exchange = Exchange::to(&port, options.timeout, &options.limits);
    match exchange.lines("<ping>", &Command::Describe, None).await {
        Ok(lines) => {
            Ok(lines.iter().map(|line| String::from_utf8_lossy(line).into_owned()).collect())
        }
        Err(source) => Err(ConnectError::Port { name: port.name, source }),
    }
}

/// Asks a port's administration.
///
/// # Errors
/// When it does not answer; it is reported to the name server then.
pub async fn administer(
    names: &dyn Names,
    port: &Registration,
    request: Bottle,
    options: &ConnectOptions,
) -> Result<Bottle, ConnectError> {
    let exchange = Exchange::to(port, options.timeout, &options.limits);
    match exchange.bottle(&Command::Admin, &request).await {
        Ok(answer) => Ok(answer),
        Err(source) => {
            report(names, &port.name).await;
            Err(ConnectError::Port { name: port.name.clone(), source })
        }
    }
}

async fn find(names: &dyn Names, src: &str, dest: &str) -> Result<Pair, ConnectError> {
    let (from, to) = (Target::parse(src), Target::parse(dest));
    let (mut src, mut dest) = (lookup(names, src).await?, lookup(names, dest).await?);
    let named = [to.carrier, from.carrier].into_iter().find(|carrier| !carrier.is_empty());
    let carrier = named.unwrap_or_else(|| dest.carrier.clone());
    let pull = Target { carrier: carrier.clone(), ..Target::default() }.is_pull();
    // A network chooses an address; the ports know each other by their names.
    (src.name, dest.name) = (rooted(from.name), rooted(to.name));
    Ok(Pair { src, dest, carrier, pull })
}

/// Finds a port, whatever stands before its name.
async fn lookup(names: &dyn Names, name: &str) -> Result<Registration, ConnectError> {
    let Target { network, name, .. } = Target::parse(name);
    let name = rooted(name);
    if let Some(reason) = name_fault(&name, Limits::default().max_name_bytes) {
        return Err(ConnectError::BadName { name, reason });
    }
    let asked = if network.is_empty() { name.clone() } else { format!("/net={network}{name}") };
    match names.query(&asked).await {
        Ok(Some(found)) => Ok(found),
        Ok(None) => Err(ConnectError::Unknown { name }),
        Err(source) => Err(ConnectError::Names { name, source }),
    }
}

/// `tcp:/cam` names /cam as well as `tcp://cam` does.
fn rooted(name: String) -> String {
    if name.starts_with('/') || name == "..." { name } else { format!("/{name}") }
}

/// Connection between the two as it is now, in the asked port's words; empty where there is none.
async fn listed(
    names: &dyn Names,
    pair: &Pair,
    options: &ConnectOptions,
) -> Result<Bottle, ConnectError> {
    let (asked, other, side) = pair.sides();
    let request = [Value::vocab("list"), Value::vocab(side), other.into()];
    administer(names, asked, request.into_iter().collect(), options).await
}

/// Turns an answer to `[add]` or `[del]` into a result.
fn accepted(asked: &Registration, answer: &Bottle) -> Result<(), ConnectError> {
    let words = answer.get(1).and_then(Value::as_str).unwrap_or_default();
    match answer.get(0).and_then(Value::as_i64) {
        Some(0) => Ok(()),
        _ => Err(ConnectError::Refused {
            name: asked.name.clone(),
            reason: if words.is_empty() { answer.to_text() } else { words.trim().to_owned() },
        }),
    }
}

/// Tells the name server that a port does not answer; it may not answer either.
async fn report(names: &dyn Names, name: &str) {
    if let Err(error) = names.announce(name, false).await {
        tracing::debug!(target: "wrapyfi_yarp::name", %error, name, "not reported as dead");
    }
}
