//! mjpeg: the receiver opens the connection and reads JPEG files off it.

use std::io;
use std::sync::Arc;

use bytes::BytesMut;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::core::Core;
use super::entered::Entered;
use super::link::LinkError;
use super::message::PortPayload;
use super::room::{Begun, progress};
use crate::wire::mjpeg::{self, MjpegReader};
use crate::wire::{Carrier, Step};
use wrapyfi_retry::liveness;

/// Asks the port `name` for its pictures; they come to the sink of `core` as they arrive.
pub(super) async fn pull(core: &Arc<Core>, name: &str, contact: &str) -> Result<(), LinkError> {
    let connect = |error| LinkError::Connect { address: contact.to_owned(), error };
    let limit = core.network.0.timeouts.connect;
    let opening = async {
        let mut stream = TcpStream::connect(contact).await.map_err(connect)?;
        liveness::set_reader(&stream);
        let host = contact.rsplit_once(':').map_or(contact, |(host, _)| host);
        stream.write_all(&mjpeg::request(host)).await?;
        let mut reader = MjpegReader::new(core.network.limits());
        let mut buffer = BytesMut::new();
        // Whoever has no pictures says so here, and this connection is not made.
        while !reader.poll_answer(&mut buffer)? {
            if stream.read_buf(&mut buffer).await? == 0 {
                return Err(LinkError::Closed);
            }
        }
        Ok((stream, reader, buffer))
    };
    let opened = timeout(limit, opening).await;
    let opened = opened.unwrap_or(Err(LinkError::Timeout(limit)))?;
    let carrier = Carrier::Mjpeg.name().to_owned();
    let entered = Entered::new(core, name.to_owned(), carrier, false, false);
    let core = Arc::clone(core);
    let mut closing = core.closing.subscribe();
    tokio::spawn(async move {
        let ended = tokio::select! {
            biased;
            () = entered.stop.notified() => Ok(()),
            _ = closing.wait_for(|closing| *closing) => Ok(()),
            ended = read(&core, &entered, opened) => ended,
        };
        if let Err(error) = ended {
            let (name, from) = (&core.name, &*entered.name);
            tracing::debug!(target: "wrapyfi_yarp::port", name, from, %error, "pictures ended");
            core.counters.add("connection_failed");
        }
    });
    Ok(())
}

async fn read(
    core: &Core,
    entered: &Entered,
    (mut stream, mut reader, mut buffer): (TcpStream, MjpegReader, BytesMut),
) -> io::Result<()> {
    let limit = core.session.progress_timeout;
    let mut room = Begun::new(core.session.rooms);
    loop {
        match reader.poll(&mut buffer) {
            Ok(Step::Event(picture)) => {
                entered.put(PortPayload::raw(picture.jpeg), picture.envelope).await;
            }
            Ok(Step::Need(more)) => {
                buffer.reserve(more.max(8 * 1024));
                let cut_short = reader.end(buffer.len());
                let held = room.hold(buffer.len());
                let read = stream.read_buf(&mut buffer);
                let read = match held {
                    Ok(()) => progress(cut_short.is_some(), limit, read).await,
                    Err(fault) => Err(fault),
                };
                let fault = match read {
                    Ok(Ok(1..)) => continue,
                    Ok(read) => read.map(|_end| cut_short)?,
                    Err(fault) => Some(fault),
                };
                fault.iter().for_each(|fault| core.counters.count(fault));
                return Ok(());
            }
            Err(fault) => {
                core.counters.count(&fault);
                return Ok(());
            }
        }
    }
}
