//! Functions of `yarp connect`, `yarp exists` and their kin, on ports of any process.

use std::time::Duration;

use tokio::time::timeout;

use super::inspect::{self, Inspection};
use super::link::{ADMIN, Link, LinkError, LinkOptions};
use super::names::Registration;
use super::network::Network;
use crate::name::NameError;
use crate::wire::admin::split_destination;
use crate::wire::{Carrier, Command, Sender};
use crate::{Bottle, Dialect, Value};

/// Error of a request to a port.
#[derive(Debug, thiserror::Error)]
pub enum AdminError {
    /// No port has this name.
    #[error("no port {0} is registered: check the name, and that its program runs")]
    Unknown(String),
    /// The name server failed.
    #[error(transparent)]
    Names(#[from] NameError),
    /// The port failed.
    #[error("port {name}: {error}")]
    Port {
        /// Name of the port.
        name: String,
        /// Error of the connection.
        error: LinkError,
    },
    /// The port said no.
    #[error("port {name} refused: {reason}")]
    Refused {
        /// Name of the port.
        name: String,
        /// Reason in the port's words.
        reason: String,
    },
    /// The probe's answer fits no dialect.
    #[error("port {name} answered the probe with {answer:?}, which no dialect does")]
    Probe {
        /// Name of the port.
        name: String,
        /// Answer that came.
        answer: Vec<u8>,
    },
}

impl AdminError {
    /// True when no program is at the port's address.
    pub fn is_refused(&self) -> bool {
        matches!(self, Self::Port { error, .. } if error.is_refused())
    }
}

/// Host and number, as connections take them.
pub(crate) fn contact(host: &str, port: u16) -> String {
    if host.contains(':') { format!("[{host}]:{port}") } else { format!("{host}:{port}") }
}

impl Registration {
    /// Host and number, as connections take them.
    pub fn contact(&self) -> String {
        contact(&self.host, self.port)
    }
}

impl Network {
    /// The port of a name; `None` when it is unknown.
    ///
    /// # Errors
    /// When the name server fails.
    pub async fn query(&self, name: &str) -> Result<Option<Registration>, NameError> {
        let found = self.names().query(name).await;
        match (self.0.known)(name) {
            Some(known) => Ok(found.ok().flatten().or(Some(known))),
            None => found,
        }
    }

    /// True when a port of this name is registered and answers.
    pub async fn exists(&self, name: &str) -> bool {
        let Ok(Some(port)) = self.query(name).await else { return false };
        let version = std::iter::once(Value::vocab("ver")).collect();
        let contact = port.contact();
        let asked = self.ask(&contact, &version);
        // A dead host answers nothing at all: no reason to wait as long as for a connection.
        let answer = timeout(Duration::from_secs(2), asked).await;
        matches!(answer, Ok(Ok(answer)) if answer.get(0).is_some_and(|word| word.is_word("ver")))
    }

    /// Sends an administrative request to a port; its answer.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn admin(&self, name: &str, request: &Bottle) -> Result<Bottle, AdminError> {
        self.admin_at(name, None, request).await
    }

    pub(crate) async fn admin_at(
        &self,
        name: &str,
        contact: Option<&str>,
        request: &Bottle,
    ) -> Result<Bottle, AdminError> {
        let asked = self.ask(&self.contact(name, contact).await?, request).await;
        asked.map_err(|error| AdminError::Port { name: name.to_owned(), error })
    }

    /// The address of a port: `known`, or the one that the name server tells.
    pub(super) async fn contact(
        &self,
        name: &str,
        known: Option<&str>,
    ) -> Result<String, AdminError> {
        match known {
            Some(known) => Ok(known.to_owned()),
            None => Ok(self.registered(name).await?.contact()),
        }
    }

    /// Connects two ports: `carrier` as in `yarp connect`, with qualifiers; `tcp` when `None`.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn connect(
        &self,
        source: &str,
        destination: &str,
        carrier: Option<&str>,
    ) -> Result<(), AdminError> {
        let carrier = carrier.unwrap_or("tcp");
        let bare = carrier.split('+').next().unwrap_or_default();
        // The receiver opens pull carriers.
        let pull = bare == Carrier::Mjpeg.name();
        let (asked, other) = if pull { (destination, source) } else { (source, destination) };
        self.registered(other).await?;
        self.add_output(asked, None, &format!("{carrier}:/{other}")).await
    }

    /// Asks a port to connect itself to `target` (`tcp:/name`). `contact` is the port's address
    /// (`127.0.0.1:10002`); the name server is asked for it where there is none.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn add_output(
        &self,
        name: &str,
        contact: Option<&str>,
        target: &str,
    ) -> Result<(), AdminError> {
        let request = [Value::vocab("add"), target.into()].into_iter().collect();
        self.command(name, contact, &request).await
    }

    /// Takes a connection of a port away, as [`Network::add_output`] made it.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn remove_output(
        &self,
        name: &str,
        contact: Option<&str>,
        destination: &str,
    ) -> Result<(), AdminError> {
        let request = [Value::vocab("del"), Value::string(destination)].into_iter().collect();
        self.command(name, contact, &request).await
    }

    /// Takes a connection away.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn disconnect(&self, source: &str, destination: &str) -> Result<(), AdminError> {
        self.remove_output(source, None, destination).await
    }

    /// Finds out which dialect a port speaks, by the bytes of a number that it keeps for us.
    ///
    /// The property `wrapyfi_probe` stays at that port. A port that waits for a reply tells
    /// nothing.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn probe_dialect(&self, name: &str) -> Result<Dialect, AdminError> {
        const KEY: &str = "wrapyfi_probe";
        let port = self.registered(name).await?;
        let failed = |error| AdminError::Port { name: name.to_owned(), error };
        // As text, so that the port itself chooses the type.
        let words = [Value::vocab("prop"), Value::vocab("set"), KEY.into(), 1.5.into()];
        let set = words.into_iter().collect();
        self.ask(&port.contact(), &set).await.map_err(failed)?;
        let get: Bottle =
            [Value::vocab("prop"), Value::vocab("get"), KEY.into()].into_iter().collect();
        let asked = async {
            let contact = port.contact();
            let sender = Sender::new(ADMIN);
            // Of YARP 3, since 10 is a code of both; 20 shows YARP 4.
            let options = LinkOptions { dialect: Dialect::V3, ..self.link_options() };
            let mut link = Link::open(&contact, Carrier::Tcp, &sender, &[], &options).await?;
            let request = get.encode(options.dialect).unwrap_or_default().into();
            Ok::<_, LinkError>(link.request(&Command::Admin, &request).await?.unwrap_or_default())
        };
        let limit = self.0.timeouts.admin;
        let answer = timeout(limit, asked).await.unwrap_or(Err(LinkError::Timeout(limit)));
        let answer = answer.map_err(failed)?;
        // The code of the list, which all its elements share: 256 and that of a double.
        match *answer {
            [10, 1, 0, 0, ..] => Ok(Dialect::V3),
            [20, 1, 0, 0, ..] => Ok(Dialect::V4),
            _ => Err(AdminError::Probe { name: name.to_owned(), answer: answer.to_vec() }),
        }
    }

    /// Asks a port how it is connected and, where `whole`, what it is: a port of YARP starts
    /// `lsb_release` before it says that. `contact` is its address (`127.0.0.1:10002`); the name
    /// server is asked for it where there is none.
    ///
    /// # Errors
    /// As [`AdminError`].
    pub async fn inspect(
        &self,
        name: &str,
        contact: Option<&str>,
        whole: bool,
    ) -> Result<Inspection, AdminError> {
        let contact = self.contact(name, contact).await?;
        let limit = self.0.timeouts.admin;
        let asked =
            timeout(limit, inspect::interview(&self.link_options(), name, &contact, whole)).await;
        let asked = asked.unwrap_or(Err(LinkError::Timeout(limit)));
        asked.map_err(|error| AdminError::Port { name: name.to_owned(), error })
    }

    /// Waits until the port at an address closes a connection on which nothing is asked, as it does when its program is
    /// killed.
    ///
    /// # Errors
    /// When there is no such connection.
    pub async fn until_closed(&self, contact: &str) -> Result<(), LinkError> {
        let why = Link::admin(contact, &self.link_options()).await?.ended().await;
        tracing::debug!(target: "wrapyfi_yarp::port", contact, %why, "watched port");
        Ok(())
    }

    async fn registered(&self, name: &str) -> Result<Registration, AdminError> {
        let bare = split_destination(name).map_or_else(|| name.to_owned(), |(_, name)| name);
        self.query(&bare).await?.ok_or_else(|| AdminError::Unknown(name.to_owned()))
    }

    /// A request that is answered by a number and a sentence.
    async fn command(
        &self,
        name: &str,
        contact: Option<&str>,
        request: &Bottle,
    ) -> Result<(), AdminError> {
        let answer = self.admin_at(name, contact, request).await?;
        if answer.get(0).and_then(Value::as_i64) == Some(0) {
            return Ok(());
        }
        let reason = answer.get(1).and_then(Value::as_str).map(|reason| reason.trim().to_owned());
        let reason = reason.unwrap_or_else(|| answer.to_text());
        Err(AdminError::Refused { name: name.to_owned(), reason })
    }

    /// One administrative request over a connection of its own.
    async fn ask(&self, contact: &str, request: &Bottle) -> Result<Bottle, LinkError> {
        self.link_options().ask(contact, request, self.0.timeouts.admin).await
    }

    /// Sends `~/name` and goodbye over a text connection: how senders of datagrams end.
    pub(super) async fn tell_gone(&self, contact: &str, name: &str) -> Result<(), LinkError> {
        let options = self.link_options();
        let sender = Sender::new(ADMIN);
        let mut link = Link::open(contact, Carrier::Text, &sender, &[], &options).await?;
        link.write_raw(&[format!("~{name}\r\nq\r\n").as_bytes()]).await?;
        link.line().await?;
        Ok(())
    }
}
