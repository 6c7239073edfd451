//! The ports that programs hold, and how a network opens them.
//!
//! ```text
//!   OutputPort::write ─▶ a queue for each target ─▶ … ─▶ the function of an RpcServer
//! ```

use std::net::SocketAddr;

use tokio::sync::watch;

use super::core::{self, Connected, Role};
use super::counters::Counters;
use super::message::{Message, PortPayload, Received};
use super::network::Network;
use super::open::{OpenError, PortOptions};
use super::output::ConnectionStatus;
use super::outputs::{ConnectError, Written};
use super::owner::Owner;
use super::rpc_client::RpcClient;
use super::session::Answer;
use crate::Bottle;
use crate::bottle::EncodeError;
use crate::wire::Carrier;

/// A port that sends to any number of others.
#[derive(Debug)]
pub struct OutputPort {
    pub(super) owner: Owner,
}

/// A port that answers requests; YARP's `RpcServer`. It takes data that want no reply, too.
#[derive(Debug)]
pub struct RpcServer {
    pub(super) owner: Owner,
}

impl Network {
    /// Opens a port that sends. `...` as a name lets the name server choose one.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_output(
        &self,
        name: &str,
        options: &PortOptions,
    ) -> Result<OutputPort, OpenError> {
        Ok(OutputPort { owner: Owner::open(self, name, options, Role::Output, None).await? })
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
    ) -> Result<OutputPort, OpenError>
    where
        F: Fn(Received, bool) -> A + Send + Sync + 'static,
        A: Future<Output = Answer> + Send + 'static,
    {
        let handler = Some(core::handler(handler));
        Ok(OutputPort { owner: Owner::open(self, name, options, Role::Output, handler).await? })
    }

    /// Opens a port for requests to another one.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_rpc_client(
        &self,
        name: &str,
        options: &PortOptions,
    ) -> Result<RpcClient, OpenError> {
        Ok(RpcClient { owner: Owner::open(self, name, options, Role::Client, None).await? })
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
    ) -> Result<RpcServer, OpenError>
    where
        F: Fn(Received, bool) -> A + Send + Sync + 'static,
        A: Future<Output = Answer> + Send + 'static,
    {
        let handler = Some(core::handler(handler));
        Ok(RpcServer { owner: Owner::open(self, name, options, Role::Input, handler).await? })
    }
}

macro_rules! every_port {
    ($($port:ty),*) => {$(
        impl $port {
            /// Name of the port: the one that the server chose, for `...`.
            pub fn name(&self) -> &str {
                &self.owner.core.name
            }

            /// Address that the port listens on.
            pub fn address(&self) -> SocketAddr {
                self.owner.core.address
            }

            /// State of the port's connections.
            pub fn status(&self) -> Vec<ConnectionStatus> {
                self.owner.core.status()
            }

            /// Counts of everything that was refused, lost or dropped, by reason.
            pub fn counters(&self) -> &Counters {
                &self.owner.core.counters
            }

            /// Number of connections, and a signal of its changes.
            pub fn connected(&self) -> watch::Receiver<Connected> {
                self.owner.core.connected.subscribe()
            }

            /// Sends what waits, says goodbye and unregisters. Dropping the port does the same
            /// without waiting for it, as long as its runtime lives.
            pub async fn close(self) {
                self.owner.close().await;
            }
        }
    )*};
}

every_port!(OutputPort, RpcClient, RpcServer);

impl OutputPort {
    /// Queues a message for every target without waiting; a full queue drops one message and counts it.
    pub fn write(&self, message: Message) -> Written {
        self.owner.core.write(message, |_any| true)
    }

    /// As [`Self::write`], to the targets of carrier mjpeg alone: a JPEG file.
    pub fn write_picture(&self, message: Message) -> Written {
        self.owner.core.write(message, |carrier| carrier == Carrier::Mjpeg)
    }

    /// As [`Self::write`], to all targets but those of carrier mjpeg.
    pub fn write_object(&self, message: Message) -> Written {
        self.owner.core.write(message, |carrier| carrier != Carrier::Mjpeg)
    }

    /// Number of targets of carrier mjpeg.
    pub fn picture_readers(&self) -> usize {
        self.owner.core.picture_readers()
    }

    /// [`Self::write`] with a bottle and no envelope.
    ///
    /// # Errors
    /// When the network's dialect lacks a type in it.
    pub fn write_bottle(&self, bottle: &Bottle) -> Result<Written, EncodeError> {
        let payload = PortPayload::bottle(bottle, self.owner.core.network.dialect())?;
        Ok(self.write(Message::new(payload)))
    }

    /// Waits until everything that was written is sent, and acknowledged where the carrier
    /// does that.
    pub async fn flush(&self) {
        for outbox in self.owner.core.outboxes() {
            outbox.drained().await;
        }
    }

    /// Connects to `/name`, or `carrier://name`; another output to that port ends first.
    ///
    /// # Errors
    /// As [`ConnectError`].
    pub async fn connect(&self, destination: &str) -> Result<(), ConnectError> {
        self.owner.core.add_output(destination).await.map(drop)
    }
}
