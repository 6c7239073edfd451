//! mjpeg: the receiver opens the connection and reads JPEG files off it.

use std::pin::Pin;
use std::sync::Arc;

use bytes::BytesMut;
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::connection;
use super::core::Core;
use super::entered::Entered;
use super::link::LinkError;
use super::session::Session;
use super::stream::Stream;
use crate::task::erased;
use crate::wire::mjpeg::{self, MjpegReader};
use wrapyfi_retry::liveness;

type Pulled<'a> = Pin<Box<dyn Future<Output = Result<(), LinkError>> + Send + 'a>>;

/// Asks the port `name` for its pictures; they come to the handler of `core` as they arrive.
pub(super) fn pull<'a>(core: &'a Arc<Core>, name: &'a str, contact: &'a str) -> Pulled<'a> {
    // A session may add outputs, and so pull pictures itself: without the box its type would hold itself.
    Box::pin(async move {
        let connect = |error| LinkError::Connect { address: contact.to_owned(), error };
        let limit = core.network.0.timeouts.connect;
        let opening = async {
            let stream = TcpStream::connect(contact).await.map_err(connect)?;
            liveness::set_reader(&stream);
            let peer = stream.peer_addr()?;
            let stream = Stream::Tcp(stream);
            let host = contact.rsplit_once(':').map_or(contact, |(host, _)| host);
            stream.write_all(&[&mjpeg::request(host)]).await?;
            let mut reader = MjpegReader::new(core.network.limits());
            let mut buffer = BytesMut::new();
            // The program that has no pictures says so here, and this connection is not made.
            while !reader.poll_answer(&mut buffer)? {
                buffer.reserve(1024);
                if stream.read(&mut buffer).await? == 0 {
                    return Err(LinkError::Closed);
                }
            }
            Ok(Session::pulled(core, (stream, peer), name, reader, buffer))
        };
        let opened = timeout(limit, opening).await;
        let session = opened.unwrap_or(Err(LinkError::Timeout(limit)))?;
        let entered = Entered::new(core, &session);
        let core = Arc::clone(core);
        let mut closing = core.closing.subscribe();
        tokio::spawn(erased(async move {
            tokio::select! {
                biased;
                _ = closing.wait_for(|closing| *closing) => {}
                () = connection::attend(Arc::clone(&core), session, entered) => {}
            }
        }));
        Ok(())
    })
}
