//! A topic published: encodes, sends on the caller's thread, knows whether a program listens.
//!
//! An XPUB instead of Wrapyfi's PUB, because it tells who is subscribed. To the broker's XSUB the
//! two are alike. It holds `send_hwm` messages for a broker that reads slower than we send; what
//! comes then is refused, not dropped.

use super::codec;
use super::publication::PublicationSocket;
use super::shared::ZeroMqState;
use super::zmtp::Kind;
use wrapyfi_data::types::{Image, Payload, Pixels};
use wrapyfi_endpoint::{Context, DropReason, Link, PublishError, Publisher, TopicSpec};

/// Sends one topic through the broker.
pub(super) struct ZeroMqPublisher {
    socket: PublicationSocket,
    spec: TopicSpec,
    depth: usize,
    /// True once the log says that colours are sent in another order than they come in.
    told_order: bool,
}

impl ZeroMqPublisher {
    pub(super) fn open(shared: &ZeroMqState, spec: &TopicSpec, context: &Context) -> Self {
        let mut spec = spec.clone();
        // Beyond this the broker would cut the connection.
        spec.limits.message_bytes = spec.limits.message_bytes.min(shared.max_frame_bytes);
        let socket = PublicationSocket::open(shared, &spec.topic, context);
        shared.ledger.enter(Kind::Xpub, &spec.topic, &context.counters);
        Self { socket, spec, depth: usize::from(shared.send_hwm), told_order: false }
    }

    /// Says where Wrapyfi's listeners refuse an image, and where its colours change their order; true once it was said.
    fn tell_order(&self, payload: &Payload) -> bool {
        let Payload::Image(Image { pixels: Pixels::Raw(raw), .. }) = payload else { return false };
        if raw.encoding.channels() == 4 {
            tracing::warn!(
                topic = self.spec.topic,
                "{} images have four channels: Wrapyfi's listeners take three, and raise ValueError; have the camera \
                 send rgb8 or bgr8",
                raw.encoding
            );
            return true;
        }
        let orders = raw.encoding.color_order().zip(self.spec.color_order.color_order());
        let Some((has, sent)) = orders.filter(|(has, sent)| has != sent) else { return false };
        tracing::info!(
            topic = self.spec.topic,
            "{} images are sent as {sent}, which Wrapyfi's listeners take them for; `encoding: {has}` on the \
             route sends them as they are",
            raw.encoding
        );
        true
    }

    fn failed(&self, reason: &dyn std::fmt::Display) -> PublishError {
        PublishError::Transport { topic: self.spec.topic.clone(), reason: reason.to_string() }
    }
}

impl Publisher for ZeroMqPublisher {
    /// While no program is subscribed nothing is encoded: [`PublishError::NoConsumer`].
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        if let Some(what) = self.socket.link.waiting_for() {
            return Err(self.failed(&format_args!("waiting for {what}")));
        }
        let audience = self.socket.audience();
        if audience.subscriptions == 0 {
            return Err(PublishError::NoConsumer(self.spec.topic.clone()));
        }
        if !self.told_order {
            self.told_order = self.tell_order(payload);
        }
        let frames = codec::encode(payload, &self.spec)?;
        let bytes = frames.iter().map(Vec::len).sum();
        let is_refused = self.socket.publish(&audience, frames, bytes).map_err(|reason| {
            let topic = self.spec.topic.clone();
            match reason {
                DropReason::Stalled => PublishError::QueueFull { topic, depth: self.depth },
                DropReason::OverBudget => PublishError::OverBudget(topic),
                _ => self.failed(&"the connection to the broker has just ended"),
            }
        })?;
        // It was sent all the same: the broker names whom it refuses.
        match is_refused {
            false => Ok(bytes),
            true => Err(PublishError::Refused {
                topic: self.spec.topic.clone(),
                reason: format!("the broker {}", self.socket.link.denied("publish", "publish")),
            }),
        }
    }

    fn link(&self) -> Link {
        // A lazy route takes from its source what a program wants.
        let peers = Some(self.socket.subscriptions(self.spec.mark.is_some()));
        Link { peers, waiting_for: self.socket.link.waiting_for(), keeps_last: false }
    }
}

impl Drop for ZeroMqPublisher {
    fn drop(&mut self) {
        self.socket.close();
    }
}
