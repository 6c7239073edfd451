//! mjpeg: the receiver opens the connection and reads JPEG files off it.

use std::io;
use std::sync::Arc;

use bytes::BytesMut;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::connection::Entered;
use super::core::Core;
use super::link::LinkError;
use super::message::Payload;
use crate::wire::mjpeg::{self, MjpegReader};
use crate::wire::{Carrier, Step};

impl Core {
    /// Asks the port `name` for its pictures; they come to this port's sink as they arrive.
    pub(super) async fn pull(self: &Arc<Self>, name: &str, contact: &str) -> Result<(), LinkError> {
        let connect = |error| LinkError::Connect { address: contact.to_owned(), error };
        let limit = self.network.0.timeouts.connect;
        let connected = timeout(limit, TcpStream::connect(contact)).await;
        let mut stream =
            connected.map_err(|_elapsed| LinkError::Timeout(limit))?.map_err(connect)?;
        let host = contact.rsplit_once(':').map_or(contact, |(host, _)| host);
        stream.write_all(&mjpeg::request(host)).await?;
        let carrier = Carrier::Mjpeg.name().to_owned();
        let entered = Entered::new(self, name.to_owned(), carrier, false, false);
        let core = Arc::clone(self);
        let mut closing = self.closing.subscribe();
        tokio::spawn(async move {
            let ended = tokio::select! {
                biased;
                () = entered.stop.notified() => Ok(()),
                _ = closing.wait_for(|closing| *closing) => Ok(()),
                ended = read(&core, &entered, stream) => ended,
            };
            if let Err(error) = ended {
                let (name, from) = (&core.name, &*entered.name);
                tracing::debug!(target: "wrapyfi_yarp::port", name, from, %error, "pictures ended");
                core.counters.add("connection_failed");
            }
        });
        Ok(())
    }
}

async fn read(core: &Core, entered: &Entered, mut stream: TcpStream) -> io::Result<()> {
    let mut reader = MjpegReader::new(core.network.limits());
    let mut buffer = BytesMut::new();
    loop {
        match reader.poll(&mut buffer) {
            Ok(Step::Event(picture)) => {
                entered.put(Payload::raw(picture.jpeg), picture.envelope).await;
            }
            Ok(Step::Need(more)) => {
                buffer.reserve(more.max(8 * 1024));
                if stream.read_buf(&mut buffer).await? == 0 {
                    if let Some(fault) = reader.end(buffer.len()) {
                        core.counters.count(&fault);
                    }
                    return Ok(());
                }
            }
            Err(fault) => {
                core.counters.count(&fault);
                return Ok(());
            }
        }
    }
}
