//! Accepting of connections: so many at once, each on a task of its own.

use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

use super::fault_counts::FaultCounts;
use crate::task::erased;

/// Time to recover after the system refused a connection. It is out of file descriptors, mostly: the next
/// connection may find some closed.
const PAUSE: Duration = Duration::from_millis(50);

/// Takes connections until `end` is over, at most `limit` at once: `serve` makes the task of each. Those
/// that still run then are the caller's.
pub(super) async fn accept<T: Future<Output = ()> + Send + 'static>(
    name: &str,
    listener: &TcpListener,
    limit: usize,
    fault_counts: &FaultCounts,
    serve: impl Fn(TcpStream) -> T,
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
                    fault_counts.add("connection_panicked");
                }
                continue;
            }
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((_, peer)) if tasks.len() >= limit => {
                fault_counts.add("too_many_connections");
                tracing::debug!(
                    target: "wrapyfi_yarp::port", name, %peer,
                    "connection closed: {limit} are open, which is the limit"
                );
            }
            Ok((stream, _)) => _ = tasks.spawn(erased(serve(stream))),
            Err(error) => {
                fault_counts.add("accept_failed");
                tracing::warn!(target: "wrapyfi_yarp::port", name, %error, "cannot accept");
                tokio::time::sleep(PAUSE).await;
            }
        }
    }
}
