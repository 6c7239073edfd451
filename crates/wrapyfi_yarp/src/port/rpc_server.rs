//! A port that answers: in a queue for its owner, or by a function on the connection's own task.

use std::sync::Arc;

use tokio::sync::oneshot;

use super::core::{Core, Owner, Role, Sink};
use super::inbox::{Inbox, Reading};
use super::message::Received;
use super::network::Network;
use super::open::{OpenError, PortOptions};
use super::session::Answer;
use crate::Bottle;

/// A port that answers requests; YARP's `RpcServer`. It takes data that want no reply, too.
#[derive(Debug)]
pub struct RpcServer {
    pub(super) owner: Owner,
    inbox: Arc<Inbox>,
}

/// A request, and the way back. A request that is dropped is answered by an empty bottle, so that
/// its sender does not wait for ever.
#[derive(Debug)]
pub struct Request {
    /// Request as it came.
    pub received: Received,
    reply: Option<oneshot::Sender<Answer>>,
}

impl Request {
    /// True when the sender waits for a reply.
    #[must_use]
    pub fn wants_reply(&self) -> bool {
        self.reply.is_some()
    }

    /// Answers with a bottle; false when the sender is gone, or wanted no reply.
    pub fn reply(self, reply: Bottle) -> bool {
        self.answer(Answer::Bottle(reply))
    }

    /// Answers with anything; false when the sender is gone, or wanted no reply.
    pub fn answer(mut self, answer: Answer) -> bool {
        self.reply.take().is_some_and(|reply| reply.send(answer).is_ok())
    }
}

/// Most requests that wait; their senders wait for a reply anyhow.
const QUEUE: usize = 64;

impl Network {
    /// Opens a port that answers requests out of a queue: [`RpcServer::recv`].
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open_rpc_server(
        &self,
        name: &str,
        options: &PortOptions,
    ) -> Result<RpcServer, OpenError> {
        let reading = Reading::Strict { queue: QUEUE, acknowledge: super::Acknowledge::Queued };
        let inbox = Arc::new(Inbox::new(reading));
        let sink = Sink::Inbox(Arc::clone(&inbox));
        let role = Role { replies: true, ..Role::default() };
        Ok(RpcServer { owner: Core::open(self, name, options, role, sink).await?, inbox })
    }

    /// Opens a port that answers requests by a function: the fastest way, since the request stays
    /// on its connection's task. The second argument says whether a reply is wanted; without one,
    /// answer [`Answer::Nothing`]. [`RpcServer::recv`] then has nothing to give.
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
        let inbox = Arc::new(Inbox::new(Reading::Newest));
        let sink = Sink::Handler(Box::new(move |request, reply| Box::pin(handler(request, reply))));
        let role = Role { replies: true, ..Role::default() };
        let owner = Core::open(self, name, options, role, sink).await?;
        Ok(RpcServer { owner, inbox })
    }
}

impl RpcServer {
    /// The next request; `None` once the port is closed. Cancel-safe.
    pub async fn recv(&self) -> Option<Request> {
        let delivery = self.inbox.take().await?;
        Some(Request { received: delivery.received, reply: delivery.reply })
    }
}
