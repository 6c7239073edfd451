//! A port that asks another one: one request at a time, each with its reply.
//!
//! ```text
//!   call ─▶ command d + bottle ─▶ server ─▶ bottle [ack] ─▶ Some(reply)
//!                                        └▶ ack alone    ─▶ None: it read, and said nothing
//! ```

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use tokio::time::timeout;

use super::core::Core;
use super::link::LinkError;
use super::output::Kind;
use super::outputs::ConnectError;
use super::owner::Owner;
use super::rpc_link::RpcLink;
use crate::Bottle;

/// Error of a request.
#[derive(Debug, thiserror::Error)]
pub enum RpcError {
    /// No server is connected.
    #[error("port {0} is connected to no server: call RpcClient::connect, or use `yarp connect`")]
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

/// A port that asks one server; YARP's `RpcClient`.
#[derive(Debug)]
pub struct RpcClient {
    pub(super) owner: Owner,
}

impl RpcClient {
    /// Connects to a server: `/name`, or `carrier://name`.
    ///
    /// # Errors
    /// As [`ConnectError`]; also when it is connected already.
    pub async fn connect(&self, server: &str) -> Result<(), ConnectError> {
        self.owner.core.add_output(server).await.map(drop)
    }

    /// Forgets the server, so that another one, or the same at another address, can be connected.
    /// Returns true when there was one.
    pub async fn disconnect(&self) -> bool {
        match self.server() {
            Some((name, _)) => Core::remove_output(&self.owner.core, &name).await,
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
        let network = &self.owner.core.network;
        let bytes = request.encode(network.dialect())?.into();
        let Some(reply) = self.call_bytes(&bytes, after).await? else { return Ok(None) };
        let read = Bottle::decode_either(&reply, network.dialect(), network.limits());
        let server = || self.server().map_or_else(String::new, |(name, _)| name);
        read.map(|(reply, _)| Some(reply))
            .map_err(|error| RpcError::Reply { server: server(), error })
    }

    /// As [`RpcClient::call`], with the bytes of a bottle, and those of the reply.
    ///
    /// # Errors
    /// As [`RpcError`].
    pub async fn call_bytes(
        &self,
        request: &Bytes,
        after: Duration,
    ) -> Result<Option<Bytes>, RpcError> {
        let none = || RpcError::NotConnected(self.owner.core.name.clone());
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
        let connections = self.owner.core.connections.lock();
        connections.outputs.iter().find_map(|output| match &output.kind {
            Kind::Rpc(link) => Some((output.name.clone(), Arc::clone(link))),
            Kind::Queue(_) | Kind::Group(_) => None,
        })
    }
}
