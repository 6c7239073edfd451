//! Connection of a client to its server: one request at a time, each with its reply.

use bytes::Bytes;
use tokio::sync::Mutex;

use super::link::{Link, LinkError, LinkOptions};
use crate::wire::{Carrier, Command, Sender};

/// The connection to a server of requests; opened again when it was lost.
#[derive(Debug)]
pub(super) struct RpcLink {
    contact: String,
    carrier: Carrier,
    sender: Sender,
    options: LinkOptions,
    /// Empty while a request is on its way, and after one that failed.
    link: Mutex<Option<Link>>,
}

impl RpcLink {
    pub(super) fn new(
        contact: String,
        carrier: Carrier,
        sender: Sender,
        options: LinkOptions,
    ) -> Self {
        Self { contact, carrier, sender, options, link: Mutex::new(None) }
    }

    async fn open(&self) -> Result<Link, LinkError> {
        if self.carrier.is_connectionless() || !self.carrier.is_push() {
            return Err(LinkError::Unsendable {
                carrier: self.carrier,
                reason: "it carries no replies: use tcp, fast_tcp or text_ack".to_owned(),
            });
        }
        let (contact, carrier) = (&self.contact, self.carrier);
        Link::open(contact, carrier, &self.sender, &[], &self.options).await
    }

    pub(super) async fn connect(&self) -> Result<(), LinkError> {
        let mut place = self.link.lock().await;
        *place = Some(self.open().await?);
        Ok(())
    }

    pub(super) async fn call(&self, request: &Bytes) -> Result<Option<Bytes>, LinkError> {
        let mut place = self.link.lock().await;
        // Out of its place until the reply is here: a call that is given up leaves a connection
        // whose next reply would be the wrong one.
        let mut link: Link = match place.take() {
            Some(link) if !link.is_closed() => link,
            _ => self.open().await?,
        };
        let command = Command::Data { reply: true, envelope: None };
        let reply = link.request(&command, request).await?;
        *place = Some(link);
        Ok(reply)
    }

    /// Waits until the server closes the connection or is gone; for ever while a call has it.
    pub(super) async fn ended(&self) {
        let mut place = self.link.lock().await;
        match place.as_mut() {
            Some(link) => _ = link.ended().await,
            None => std::future::pending().await,
        }
    }

    pub(super) async fn close(&self) {
        // A request on its way keeps the lock: it ends by its own time limit.
        let Ok(mut place) = self.link.try_lock() else { return };
        if let Some(link) = place.take() {
            link.quit().await.ok();
        }
    }
}
