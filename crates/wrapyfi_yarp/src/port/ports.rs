//! The ports that programs hold.
//!
//! ```text
//!   OutputPort::write ─▶ a queue for each target ─▶ … ─▶ the function of an RpcServer
//! ```

use std::net::SocketAddr;

use tokio::sync::watch;

use super::core::Connected;
use super::counters::Counters;
use super::message::{Message, PortPayload};
use super::open::PortOptions;
use super::outbox::Overflow;
use super::outputs::{ConnectError, ConnectionStatus, Written};
use super::owner::Owner;
use super::rpc_client::RpcClient;
use crate::Bottle;
use crate::bottle::EncodeError;
use crate::wire::Carrier;

/// Rule by which an output keeps messages for its targets.
#[derive(Debug, Clone)]
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
