//! A port that answers, by a function on the connection's own task.

use super::core::{Role, Sink};
use super::message::Received;
use super::network::Network;
use super::open::{OpenError, PortOptions};
use super::owner::Owner;
use super::session::Answer;

/// A port that answers requests; YARP's `RpcServer`. It takes data that want no reply, too.
#[derive(Debug)]
pub struct RpcServer {
    pub(super) owner: Owner,
}

impl Network {
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
        let (role, sink) = (Role::default(), Sink::handler(handler));
        Ok(RpcServer { owner: Owner::open(self, name, options, role, sink).await? })
    }
}
