//! TCPROS connections: how they are opened, accepted and refused.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Weak};
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::timeout;

use super::header::{Header, HeaderError, NODE};
use super::xmlrpc::shortened;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_endpoint::{Mutex, WireType};

/// Longest time until a connection stands, an unreachable host's included.
pub(super) const CONNECT: Duration = Duration::from_secs(5);
/// Most connections to one address that are being opened. Sockets of rospy hold five that wait to be accepted: the system
/// drops one more, and tries it again after 1, 3 and 7 s.
pub(super) const OPENING_AT_ONCE: usize = 5;
/// Longest time until the other side has told its header.
const GREETING: Duration = Duration::from_secs(10);
/// Silence after which the system asks whether the other side is still there.
const KEEPALIVE: Duration = Duration::from_secs(5);
/// Time between two such questions, of which three may stay unanswered.
const KEEPALIVE_AGAIN: Duration = Duration::from_secs(1);

/// Error of waiting for a connection header.
#[derive(Debug, thiserror::Error)]
pub(super) enum GreetingError {
    #[error("the connection failed: {0}")]
    Io(#[from] io::Error),
    #[error(transparent)]
    Header(#[from] HeaderError),
    #[error("no connection header came within {} s", GREETING.as_secs())]
    Silent,
    /// There is no connection: the reason.
    #[error("{0}")]
    Away(String),
}

/// A type as a header has it, each part shortened.
pub(super) fn shown(name: &str, md5: &str) -> WireType {
    WireType { name: shortened(name), checksum: shortened(md5) }
}

/// Sets the socket options of every TCPROS connection.
pub(super) fn prepare(stream: &TcpStream) -> io::Result<()> {
    // Nagle and delayed acknowledgements together hold small messages back for 40 ms.
    stream.set_nodelay(true)?;
    let keepalive =
        TcpKeepalive::new().with_time(KEEPALIVE).with_interval(KEEPALIVE_AGAIN).with_retries(3);
    SockRef::from(stream).set_tcp_keepalive(&keepalive)
}

/// Places among the connections that are being opened to one address, by address.
static OPENING: Mutex<BTreeMap<(String, u16), Weak<Semaphore>>> = Mutex::new(BTreeMap::new());

/// A place among the connections to an address whose other side has not answered yet; it is free again when the value
/// is dropped.
pub(super) async fn place_to_open(host: &str, port: u16) -> Option<OwnedSemaphorePermit> {
    let places = {
        let mut opening = OPENING.lock();
        let known = opening.get(&(host.to_owned(), port)).and_then(Weak::upgrade);
        known.unwrap_or_else(|| {
            opening.retain(|_, places| places.strong_count() > 0);
            let places = Arc::new(Semaphore::new(OPENING_AT_ONCE));
            opening.insert((host.to_owned(), port), Arc::downgrade(&places));
            places
        })
    };
    // The semaphore is never closed.
    places.acquire_owned().await.ok()
}

/// A connection to a node that has told its header in answer to ours.
pub(super) async fn greeted(
    host: &str,
    port: u16,
    own: &Header,
) -> Result<(TcpStream, Header), GreetingError> {
    let failed =
        |error: io::Error| GreetingError::Away(format!("{host}:{port} does not answer: {error}"));
    // rospy accepts the next one when it has heard this one's header.
    let Ok(_place) = timeout(CONNECT, place_to_open(host, port)).await else {
        return Err(GreetingError::Away(format!(
            "{host}:{port} has {OPENING_AT_ONCE} connections to answer first, which have taken {} s",
            CONNECT.as_secs()
        )));
    };
    let Ok(reached) = timeout(CONNECT, reach(host, port)).await else {
        let why = format!("{host}:{port} did not answer within {} s", CONNECT.as_secs());
        return Err(GreetingError::Away(why));
    };
    let mut stream = reached.map_err(failed)?;
    prepare(&stream).map_err(failed)?;
    let header = greet(&mut stream, own).await?;
    Ok((stream, header))
}

/// A socket to a machine; an error says where it is the name that leads nowhere.
pub(super) async fn reach(host: &str, port: u16) -> io::Result<TcpStream> {
    let found = match tokio::net::lookup_host((host, port)).await {
        // Cancelled, and no answer of the system: the runtime ends, and this task with it.
        Err(error) if error.kind() == io::ErrorKind::Other => std::future::pending().await,
        found => found.map_err(|error| io::Error::other(Hosts::unresolved(host, &error)))?,
    };
    TcpStream::connect(found.collect::<Vec<_>>().as_slice()).await
}

/// Tells the other side our header and hears its.
async fn greet(stream: &mut TcpStream, own: &Header) -> Result<Header, GreetingError> {
    stream.write_all(&own.encode()?).await?;
    hear(stream).await
}

/// Reads a header.
pub(super) async fn hear(stream: &mut TcpStream) -> Result<Header, GreetingError> {
    let read = async {
        let mut size = [0; 4];
        stream.read_exact(&mut size).await?;
        let mut body = vec![0; Header::declared_size(size)?];
        stream.read_exact(&mut body).await?;
        Ok(Header::decode(&body)?)
    };
    timeout(GREETING, read).await.unwrap_or(Err(GreetingError::Silent))
}

/// Refuses a connection, in words that the other side logs.
pub(super) async fn refuse(stream: &mut TcpStream, error: &str) {
    let Ok(header) = Header::new().with("error", error).encode() else { return };
    // It may be gone already.
    _ = stream.write_all(&header).await;
    _ = stream.shutdown().await;
}

/// A connection that was accepted.
pub(super) struct Accepted {
    pub(super) stream: TcpStream,
    pub(super) header: Header,
    pub(super) peer: SocketAddr,
    /// Place of the connection among those that may be open at once.
    pub(super) place: OwnedSemaphorePermit,
}

impl Accepted {
    /// Name of the node at the other end, as it says.
    pub(super) fn caller(&self) -> &str {
        self.header.get(NODE).or_else(|| self.header.get("callerid")).unwrap_or("(unnamed)")
    }
}

/// A port that others connect to, and how many may at once. It outlives the task that accepts them.
pub(super) struct Port {
    pub(super) listener: TcpListener,
    pub(super) connections: usize,
    pub(super) places: Arc<Semaphore>,
}

impl Port {
    /// A free port.
    pub(super) async fn bind(ip: IpAddr, connections: usize) -> io::Result<(Arc<Self>, u16)> {
        let listener = TcpListener::bind(SocketAddr::new(ip, 0)).await?;
        let number = listener.local_addr()?.port();
        let places = Arc::new(Semaphore::new(connections));
        Ok((Arc::new(Self { listener, connections, places }), number))
    }
}

/// Pauses after an accept that failed, most often because there are no file descriptors left.
pub(super) fn accepting() -> Backoff {
    Backoff::of_name("accept").up_to(Duration::from_secs(1))
}

/// The next connection.
pub(super) async fn accepted(
    listener: &TcpListener,
    backoff: &mut Backoff,
) -> (TcpStream, SocketAddr) {
    loop {
        match listener.accept().await {
            Ok(accepted) => {
                backoff.reset();
                return accepted;
            }
            Err(error) => {
                tracing::warn!("ROS 1: no connection can be accepted: {error}");
                backoff.pause().await;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    use tokio::task::JoinSet;

    use super::*;

    #[test]
    fn a_name_that_nobody_looks_up_any_more_is_not_called_unresolved() {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let handle = runtime.handle().clone();
        runtime.shutdown_background();
        let _entered = handle.enter();
        let mut waker = std::task::Context::from_waker(std::task::Waker::noop());
        let reached = std::pin::pin!(reach("localhost", 1)).as_mut().poll(&mut waker);
        assert!(reached.is_pending(), "{reached:?}");
    }

    #[tokio::test]
    async fn no_more_connections_than_rospy_holds_are_opened_at_once() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let (now, most) = (Arc::<AtomicUsize>::default(), Arc::<AtomicUsize>::default());
        let (waiting, highest) = (Arc::clone(&now), Arc::clone(&most));
        let _server = tokio::spawn(async move {
            while let Ok((mut stream, _)) = listener.accept().await {
                highest.fetch_max(waiting.fetch_add(1, SeqCst) + 1, SeqCst);
                let waiting = Arc::clone(&waiting);
                tokio::spawn(async move {
                    hear(&mut stream).await.unwrap();
                    // All the others have come meanwhile, if nothing holds them back.
                    tokio::time::sleep(Duration::from_millis(20)).await;
                    waiting.fetch_sub(1, SeqCst);
                    stream.write_all(&Header::new().with("type", "a").encode().unwrap()).await
                });
            }
        });
        let mut asking = JoinSet::new();
        for _ in 0..4 * OPENING_AT_ONCE {
            let own = Header::new().with("callerid", "/a");
            asking.spawn(async move { greeted("127.0.0.1", port, &own).await.unwrap().1 });
        }
        let heard = asking.join_all().await;
        assert_eq!(heard.len(), 4 * OPENING_AT_ONCE);
        assert!(heard.iter().all(|header| header.get("type") == Some("a")));
        assert_eq!(now.load(SeqCst), 0);
        assert!(most.load(SeqCst) <= OPENING_AT_ONCE, "{most:?} at once");
        assert!(OPENING.lock().values().all(|places| places.strong_count() == 0));
    }
}
