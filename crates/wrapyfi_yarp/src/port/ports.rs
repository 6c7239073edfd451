//! The ports that programs hold: for reading, for writing, for both.
//!
//! ```text
//!   OutputPort::write ─▶ a queue for each target ─▶ … ─▶ InputPort::recv
//! ```

use std::net::SocketAddr;
use std::sync::Arc;

use tokio::sync::watch;

use super::core::{Connected, Role, Sink};
use super::counters::Counters;
use super::inbox::{Inbox, Reading};
use super::message::{Message, PortPayload, Received};
use super::network::Network;
use super::open::{OpenError, PortOptions};
use super::outbox::Overflow;
use super::outputs::{ConnectError, ConnectionStatus, Written};
use super::owner::Owner;
use super::rpc_client::RpcClient;
use super::rpc_server::RpcServer;
use super::tools::AdminError;
use crate::Bottle;
use crate::bottle::EncodeError;
use crate::wire::Carrier;

/// Rule by which an output keeps messages for its targets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputOptions {
    /// Name and address.
    pub port: PortOptions,
    /// Most messages that wait for one target, at least 1.
    pub queue: usize,
    /// Message that gives way when the queue is full.
    pub overflow: Overflow,
}

impl Default for OutputOptions {
    fn default() -> Self {
        Self { port: PortOptions::default(), queue: 16, overflow: Overflow::default() }
    }
}

/// Rule by which an input keeps messages for its owner.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct InputOptions {
    /// Name and address.
    pub port: PortOptions,
    /// The newest only, or all.
    pub reading: Reading,
}

/// A port that sends to any number of others.
#[derive(Debug)]
pub struct OutputPort {
    owner: Owner,
}

/// A port that any number of others send to.
#[derive(Debug)]
pub struct InputPort {
    owner: Owner,
    inbox: Arc<Inbox>,
}

/// A port that sends and is sent to; YARP's plain `Port`.
#[derive(Debug)]
pub struct Port {
    owner: Owner,
    inbox: Arc<Inbox>,
}

impl Network {
    /// Opens a port that sends. `...` as a name lets the name server choose one.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_output(
        &self,
        name: &str,
        options: &OutputOptions,
    ) -> Result<OutputPort, OpenError> {
        let OutputOptions { port, queue, overflow } = options;
        let role = Role { outputs: true, queue: *queue, overflow: *overflow, ..Role::default() };
        Ok(OutputPort { owner: Owner::open(self, name, port, role, Sink::Nobody).await? })
    }

    /// Opens a port that is sent to.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_input(
        &self,
        name: &str,
        options: &InputOptions,
    ) -> Result<InputPort, OpenError> {
        let inbox = Arc::new(Inbox::new(options.reading));
        let sink = Sink::Inbox(Arc::clone(&inbox));
        let owner = Owner::open(self, name, &options.port, Role::default(), sink).await?;
        Ok(InputPort { owner, inbox })
    }

    /// Opens a port for both directions; `output.port` says where it listens.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_port(
        &self,
        name: &str,
        output: &OutputOptions,
        reading: Reading,
    ) -> Result<Port, OpenError> {
        let inbox = Arc::new(Inbox::new(reading));
        let sink = Sink::Inbox(Arc::clone(&inbox));
        let OutputOptions { port, queue, overflow } = output;
        let role = Role { outputs: true, queue: *queue, overflow: *overflow, ..Role::default() };
        let owner = Owner::open(self, name, port, role, sink).await?;
        Ok(Port { owner, inbox })
    }
}

macro_rules! every_port {
    ($($port:ty),*) => {$(
        impl $port {
            /// Name of the port: the one that the server chose, for `...`.
            #[must_use]
            pub fn name(&self) -> &str {
                &self.owner.core.name
            }

            /// Address that the port listens on.
            #[must_use]
            pub fn address(&self) -> SocketAddr {
                self.owner.core.address
            }

            /// State of the port's connections.
            #[must_use]
            pub fn status(&self) -> Vec<ConnectionStatus> {
                self.owner.core.status()
            }

            /// Counts of everything that was refused, lost or dropped, by reason.
            #[must_use]
            pub fn counters(&self) -> &Counters {
                &self.owner.core.counters
            }

            /// Number of connections, and a signal of its changes.
            #[must_use]
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

every_port!(OutputPort, InputPort, Port, RpcClient, RpcServer);

macro_rules! writers {
    ($($port:ty),*) => {$(
        impl $port {
            /// Puts a message in front of every target, and never waits: where a target's queue is
            /// full, one message gives way and is counted.
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
            #[must_use]
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

            /// Waits until every target has room, then writes. Cancel-safe: the message was then
            /// not written.
            pub async fn send(&self, message: Message) -> Written {
                for outbox in self.owner.core.outboxes() {
                    outbox.room().await;
                }
                self.write(message)
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

            /// Ends the output to a port; whether there was one.
            pub async fn disconnect(&self, destination: &str) -> bool {
                self.owner.core.remove_output(destination).await
            }

            /// Waits until there are at least so many outputs.
            pub async fn wait_for_outputs(&self, count: usize) {
                let mut connected = self.connected();
                // The sender lives as long as this port.
                connected.wait_for(|connected| connected.outputs >= count).await.ok();
            }
        }
    )*};
}

writers!(OutputPort, Port);

macro_rules! readers {
    ($($port:ty),*) => {$(
        impl $port {
            /// The next message; `None` once the port is closed. Cancel-safe.
            pub async fn recv(&self) -> Option<Received> {
                self.inbox.take().await
            }

            /// A message that is here already.
            #[must_use]
            pub fn try_recv(&self) -> Option<Received> {
                self.inbox.try_take()
            }

            /// Messages that came, those included that newer ones took the place of.
            #[must_use]
            pub fn received(&self) -> u64 {
                self.inbox.received()
            }

            /// Messages that nobody read before a newer one came.
            #[must_use]
            pub fn superseded(&self) -> u64 {
                self.inbox.superseded()
            }

            /// Asks the port `source` to send here; `carrier` as in `yarp connect`.
            ///
            /// # Errors
            /// As [`AdminError`].
            pub async fn subscribe(
                &self,
                source: &str,
                carrier: Option<&str>,
            ) -> Result<(), AdminError> {
                self.owner.core.network.connect(source, self.name(), carrier).await
            }

            /// Waits until there are at least so many inputs.
            pub async fn wait_for_inputs(&self, count: usize) {
                let mut connected = self.connected();
                // The sender lives as long as this port.
                connected.wait_for(|connected| connected.inputs >= count).await.ok();
            }
        }
    )*};
}

readers!(InputPort, Port);
