//! Accepting of connections: so many at once, each on a task of its own.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

use super::counters::Counters;

/// Time to recover after the system refused a connection. It is out of file descriptors, mostly: the next
/// connection may find some closed.
const PAUSE: Duration = Duration::from_millis(50);

/// Takes connections until `end` is over, at most `limit` at once: `serve` makes the task of each. Those
/// that still run then are the caller's.
pub(crate) async fn accept<T: Future<Output = ()> + Send + 'static>(
    name: &str,
    listener: &TcpListener,
    limit: usize,
    counters: &Counters,
    serve: impl Fn(TcpStream, SocketAddr) -> T,
    end: impl Future<Output = ()>,
) -> JoinSet<()> {
    let mut tasks = JoinSet::new();
    tokio::pin!(end);
    loop {
        let accepted = tokio::select! {
            biased;
            () = &mut end => return tasks,
            // Those that have ended make room first.
            Some(ended) = tasks.join_next() => {
                if ended.is_err_and(|error| error.is_panic()) {
                    counters.add("connection_panicked");
                }
                continue;
            }
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((_, peer)) if tasks.len() >= limit => {
                counters.add("too_many_connections");
                tracing::debug!(
                    target: "wrapyfi_yarp::port", name, %peer,
                    "connection closed: {limit} are open, which is the limit"
                );
            }
            Ok((stream, peer)) => _ = tasks.spawn(serve(stream, peer)),
            Err(error) => {
                counters.add("accept_failed");
                tracing::warn!(target: "wrapyfi_yarp::port", name, %error, "cannot accept");
                tokio::time::sleep(PAUSE).await;
            }
        }
    }
}
