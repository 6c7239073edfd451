//! One target of an output: the task that empties its queue into its connection.
//!
//! ```text
//!   Outbox ─▶ stream:   write, wait for the ack where there is one, notice when the reader closes
//!          ─▶ udp:      datagrams to one receiver, one after the other
//!          ─▶ mcast:    datagrams to the group, once for all targets of this port
//!          ─▶ mjpeg:    JPEG files to a reader that asked over HTTP
//! ```

use std::sync::Arc;

use bytes::Bytes;
use tokio::net::UdpSocket;

use super::link::{Link, LinkError};
use super::message::{Loss, Message, PayloadKind};
use super::outbox::Outbox;
use super::pace::Pace;
use crate::wire::{Carrier, Command, datagram, message, mjpeg};

/// Transport of a target's messages.
#[derive(Debug)]
pub(super) enum Way {
    /// tcp, `fast_tcp`, text, `text_ack`.
    Stream(Link),
    /// A text connection turned around: no acknowledgements, no goodbye.
    Reversed(Link),
    /// A browser or an mjpeg reader.
    Mjpeg(Link),
    /// Datagrams through a connected socket.
    Datagrams { socket: UdpSocket, pace: Pace },
}

/// Sends what the queue brings until it closes or the connection ends.
pub(super) async fn run(mut way: Way, outbox: &Outbox) -> Result<(), LinkError> {
    loop {
        let next = match &mut way {
            Way::Stream(link) | Way::Reversed(link) | Way::Mjpeg(link) => tokio::select! {
                biased;
                next = outbox.next() => next,
                error = link.ended() => return Err(error),
            },
            Way::Datagrams { .. } => outbox.next().await,
        };
        let Some(message) = next else { break };
        match send(&mut way, &message).await {
            Ok(()) => {}
            Err(LinkError::Unsendable { carrier, reason }) => {
                tracing::debug!(target: "wrapyfi_yarp::port", %carrier, reason, "not sent");
                message.lost(Loss::Unsendable);
            }
            Err(error) => return Err(error),
        }
    }
    match way {
        Way::Stream(link) => link.quit().await,
        Way::Reversed(_) | Way::Mjpeg(_) | Way::Datagrams { .. } => Ok(()),
    }
}

async fn send(way: &mut Way, message: &Arc<Message>) -> Result<(), LinkError> {
    let Message { payload, envelope, .. } = &**message;
    let command = Command::Data { reply: false, envelope: envelope.clone() };
    if payload.kind == PayloadKind::Raw {
        let carrier = match way {
            Way::Mjpeg(_) => None,
            Way::Stream(link) | Way::Reversed(link) => Some(link.carrier),
            Way::Datagrams { .. } => Some(Carrier::Udp),
        };
        if let Some(carrier) = carrier {
            // YARP's readers lose the thread for good behind bytes that are no object.
            let reason = "a file is read over mjpeg only: connect with carrier mjpeg".to_owned();
            return Err(LinkError::Unsendable { carrier, reason });
        }
    }
    match way {
        Way::Stream(link) => {
            link.write(&command, &payload.bytes).await?;
            link.acknowledged().await
        }
        Way::Reversed(link) => link.write(&command, &payload.bytes).await,
        Way::Mjpeg(link) => {
            let picture = picture(message)?;
            let head = mjpeg::part_head(picture.len());
            link.write_raw(&[&head, &picture, mjpeg::PART_END]).await
        }
        Way::Datagrams { socket, pace } => {
            let head = message::head(&command, &[payload.bytes.len()])?;
            for datagram in datagram::split(&head, &payload.bytes, datagram::MAX_DATAGRAM) {
                pace.turn(datagram.len()).await;
                socket.send(&datagram).await?;
            }
            Ok(())
        }
    }
}

/// The JPEG file of a message, with its envelope in it.
fn picture(message: &Message) -> Result<Bytes, LinkError> {
    let bytes = &message.payload.bytes;
    if message.payload.kind != PayloadKind::Raw || !bytes.starts_with(&[0xff, 0xd8]) {
        return Err(LinkError::Unsendable {
            carrier: Carrier::Mjpeg,
            reason: "only JPEG files go over mjpeg: write them as PortPayload::raw".to_owned(),
        });
    }
    Ok(match &message.envelope {
        Some(envelope) => mjpeg::with_envelope(bytes, envelope),
        None => bytes.clone(),
    })
}
