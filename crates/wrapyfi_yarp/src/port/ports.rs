//! The port that a program holds, and how a network opens it.
//!
//! ```text
//!   Port::write ─▶ a queue for each target ─▶ … ─▶ the function of another port
//!   Port::call ─▶ command d + bottle ─▶ server ─▶ bottle [ack] ─▶ Some(reply)
//!                                              └▶ ack alone    ─▶ None: it read, and said nothing
//! ```

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::watch;
use tokio::time::timeout;

use super::core::{Connected, Core, Handler, Role};
use super::fault_counts::FaultCounts;
use super::life;
use super::link::LinkError;
use super::message::{Message, PortPayload, Received};
use super::network::Network;
use super::open::{self, OpenError, PortOptions};
use super::output::{ConnectionStatus, Kind};
use super::outputs::{ConnectError, Written};
use super::rpc_link::RpcLink;
use super::session::Answer;
use crate::Bottle;
use crate::bottle::EncodeError;
use crate::task::erased;
use crate::wire::Carrier;

/// Error of a request.
#[derive(Debug, thiserror::Error)]
pub enum RpcError {
    /// No server is connected.
    #[error("port {0} is connected to no server: call Port::connect, or use `yarp connect`")]
    NotConnected(String),
    /// The server did not answer in time; its late answer will not be mistaken for another one.
    #[error("{server} did not answer within {after:?}")]
    Timeout {
        /// The server.
        server: String,
        /// The time allowed.
        after: Duration,
    },
    /// The connection failed; the next call connects again.
    #[error("request to {server}: {error}")]
    Link {
        /// The server.
        server: String,
        /// Error of the connection.
        error: LinkError,
    },
    /// The request cannot be written in the dialect.
    #[error("the request cannot be written: {0}")]
    Encode(#[from] crate::bottle::EncodeError),
    /// The reply is no bottle.
    #[error("the reply of {server} cannot be read: {error}")]
    Reply {
        /// The server.
        server: String,
        /// Fault of the bottle.
        error: crate::bottle::BottleError,
    },
}

/// A port of this program: one that sends to any number of others, takes what others send, or asks a server. Dropping
/// it closes it.
#[derive(Debug)]
pub struct Port {
    pub(crate) core: Arc<Core>,
}

impl Drop for Port {
    fn drop(&mut self) {
        self.core.closing.send_replace(true);
    }
}

impl Network {
    /// Opens a port that sends. `...` as a name lets the name server choose one.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_output(&self, name: &str, options: &PortOptions) -> Result<Port, OpenError> {
        Port::open(self, name, options, Role::Output, None).await
    }

    /// Opens a port for both directions, YARP's plain `Port`: it sends, and what comes is handed to a function as by
    /// [`Network::serve`].
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_port<F, A>(
        &self,
        name: &str,
        options: &PortOptions,
        handler: F,
    ) -> Result<Port, OpenError>
    where
        F: Fn(Received, bool) -> A + Send + Sync + 'static,
        A: Future<Output = Answer> + Send + 'static,
    {
        let handler = Some(boxed(handler));
        Port::open(self, name, options, Role::Output, handler).await
    }

    /// Opens a port for requests to another one.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_rpc_client(
        &self,
        name: &str,
        options: &PortOptions,
    ) -> Result<Port, OpenError> {
        Port::open(self, name, options, Role::Client, None).await
    }

    /// Opens a port that answers requests by a function: the fastest way, since the request stays
    /// on its connection's task. The second argument says whether a reply is wanted; without one,
    /// answer [`Answer::Nothing`].
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn serve<F, A>(
        &self,
        name: &str,
        options: &PortOptions,
        handler: F,
    ) -> Result<Port, OpenError>
    where
        F: Fn(Received, bool) -> A + Send + Sync + 'static,
        A: Future<Output = Answer> + Send + 'static,
    {
        let handler = Some(boxed(handler));
        Port::open(self, name, options, Role::Input, handler).await
    }
}

/// The function that an owner gave, as one of all types.
fn boxed<F, A>(handler: F) -> Handler
where
    F: Fn(Received, bool) -> A + Send + Sync + 'static,
    A: Future<Output = Answer> + Send + 'static,
{
    Box::new(move |request, reply| Box::pin(handler(request, reply)))
}

impl Port {
    async fn open(
        network: &Network,
        name: &str,
        options: &PortOptions,
        role: Role,
        handler: Option<Handler>,
    ) -> Result<Self, OpenError> {
        let (opened, listener) = open::open(network, name, options).await?;
        let core = Core::new(network, opened, options.clone(), role, handler, None);
        let port = Self { core: Arc::new(core) };
        tokio::spawn(erased(life::keep(Arc::clone(&port.core), listener)));
        if options.register {
            open::announce(network, port.name(), port.address().ip()).await;
        }
        Ok(port)
    }

    /// Name of the port: the one that the server chose, for `...`.
    pub fn name(&self) -> &str {
        &self.core.name
    }

    /// Address that the port listens on.
    pub fn address(&self) -> SocketAddr {
        self.core.address
    }

    /// State of the port's connections.
    pub fn status(&self) -> Vec<ConnectionStatus> {
        self.core.status()
    }

    /// Counts of everything that was refused, lost or dropped, by reason.
    pub fn fault_counts(&self) -> &FaultCounts {
        &self.core.fault_counts
    }

    /// Number of connections, and a signal of its changes.
    pub fn connected(&self) -> watch::Receiver<Connected> {
        self.core.connected.subscribe()
    }

    /// Sends what waits, says goodbye and unregisters. Dropping the port does the same
    /// without waiting for it, as long as its runtime lives.
    pub async fn close(self) {
        self.end().await;
    }

    /// As [`Self::close`].
    pub(crate) async fn end(&self) {
        self.core.closing.send_replace(true);
        let mut closed = self.core.closed.subscribe();
        // The sender lives as long as the core, which this holds.
        closed.wait_for(|closed| *closed).await.ok();
    }

    /// Queues a message for every target without waiting; a full queue drops one message and counts it.
    pub fn write(&self, message: Message) -> Written {
        self.core.write(message, |_any| true)
    }

    /// As [`Self::write`], to the targets of carrier mjpeg alone: a JPEG file.
    pub fn write_picture(&self, message: Message) -> Written {
        self.core.write(message, |carrier| carrier == Carrier::Mjpeg)
    }

    /// As [`Self::write`], to all targets but those of carrier mjpeg.
    pub fn write_object(&self, message: Message) -> Written {
        self.core.write(message, |carrier| carrier != Carrier::Mjpeg)
    }

    /// Number of targets of carrier mjpeg.
    pub fn picture_readers(&self) -> usize {
        self.core.picture_readers()
    }

    /// [`Self::write`] with a bottle and no envelope.
    ///
    /// # Errors
    /// When the network's dialect lacks a type in it.
    pub fn write_bottle(&self, bottle: &Bottle) -> Result<Written, EncodeError> {
        let payload = PortPayload::bottle(bottle, self.core.network.dialect())?;
        Ok(self.write(Message::new(payload)))
    }

    /// Waits until everything that was written is sent, and acknowledged where the carrier
    /// does that.
    pub async fn flush(&self) {
        for outbox in self.core.outboxes() {
            outbox.drained().await;
        }
    }

    /// Connects to `/name`, or `carrier://name`; another output to that port ends first.
    ///
    /// # Errors
    /// As [`ConnectError`].
    pub async fn connect(&self, destination: &str) -> Result<(), ConnectError> {
        self.core.add_output(destination).await.map(drop)
    }

    /// Forgets the server, so that another one, or the same at another address, can be connected.
    /// Returns true when there was one.
    pub async fn disconnect(&self) -> bool {
        match self.server() {
            Some((name, _)) => Core::remove_output(&self.core, &name).await,
            None => false,
        }
    }

    /// Sends a request; its reply, `None` when the server took it and said nothing.
    ///
    /// Requests of one client wait for each other. When this is dropped early, or runs out of
    /// time, its connection is closed and the next call opens another one.
    ///
    /// # Errors
    /// As [`RpcError`].
    pub async fn call(
        &self,
        request: &Bottle,
        after: Duration,
    ) -> Result<Option<Bottle>, RpcError> {
        let network = &self.core.network;
        let bytes = request.encode(network.dialect())?.into();
        let Some(reply) = self.call_bytes(&bytes, after).await? else { return Ok(None) };
        let read = Bottle::decode_either(&reply, network.dialect(), network.limits());
        let server = || self.server().map_or_else(String::new, |(name, _)| name);
        read.map(|(reply, _)| Some(reply))
            .map_err(|error| RpcError::Reply { server: server(), error })
    }

    /// As [`Port::call`], with the bytes of a bottle, and those of the reply.
    ///
    /// # Errors
    /// As [`RpcError`].
    pub async fn call_bytes(
        &self,
        request: &Bytes,
        after: Duration,
    ) -> Result<Option<Bytes>, RpcError> {
        let none = || RpcError::NotConnected(self.core.name.clone());
        let (server, link) = self.server().ok_or_else(none)?;
        match timeout(after, link.call(request)).await {
            Ok(Ok(reply)) => Ok(reply),
            Ok(Err(error)) => Err(RpcError::Link { server, error }),
            Err(_) => Err(RpcError::Timeout { server, after }),
        }
    }

    /// Waits until the server of a client that makes no calls closes the connection or is gone; for ever where none is
    /// connected. A call waits until this is dropped.
    pub async fn ended(&self) {
        match self.server() {
            Some((_, link)) => link.ended().await,
            None => std::future::pending().await,
        }
    }

    fn server(&self) -> Option<(String, Arc<RpcLink>)> {
        let connections = self.core.connections.lock();
        connections.outputs.iter().find_map(|output| match &output.kind {
            Kind::Rpc(link) => Some((output.peer.name.clone(), Arc::clone(link))),
            Kind::Queue(_) | Kind::Group(_) => None,
        })
    }
}
