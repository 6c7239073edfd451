//! The live page of a bridge that runs, on a port of this machine alone.
//!
//! ```text
//!   browser ─ GET ─▶ server ─ own Host, so many connections, so many bytes ─▶ answers
//!                                                                              │
//!     /               document    the page: one file, with the hashes of what it may run
//!     /routes.json    answers     statuses of the routes, as `wrapyfi bridge --json` has them
//!     /previews.json  previews    newest messages of the routes that a page shows
//!     /why.json       answers     what `wrapyfi why` says of a route
//!     /metrics        metrics     Prometheus
//! ```
//!
//! All of it runs on one thread, and no route waits for it. Without a page open it costs nothing.

mod answers;
mod document;
mod metrics;
mod preview;
mod previews;
mod server;

use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use tokio::sync::oneshot;
use wrapyfi_endpoint::network::owner;

use self::answers::Answers;
use crate::in_force::Running;

/// Longest time that the end of the program waits for an answer in progress.
const STOP_WITHIN: Duration = Duration::from_millis(500);

/// The page. It ends when it is dropped.
pub struct Page {
    /// Closed to end it.
    stop: Option<oneshot::Sender<()>>,
    /// Closed by the thread at its end.
    ended: Receiver<()>,
}

impl Page {
    /// Serves the page at `port` of 127.0.0.1. A port that is taken leaves the bridge without its page, which is
    /// logged: the routes go on.
    #[must_use]
    pub fn start(port: u16, bridge: Running) -> Option<Self> {
        serve(port, bridge)
            .inspect_err(|why| {
                let owner = owner(port).map(|it| format!(" ({it})")).unwrap_or_default();
                tracing::error!(
                    "there is no live page at 127.0.0.1:{port}: {why}{owner}; another port is `page: {{ port: … }}` \
                     of the configuration, or parameter page_port"
                );
            })
            .ok()
    }
}

fn serve(port: u16, bridge: Running) -> std::io::Result<Page> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .max_blocking_threads(1)
        .thread_name("page-why")
        .build()?;
    let (stop, stopped) = oneshot::channel();
    let (alive, ended) = channel::<()>();
    std::thread::Builder::new().name("page".to_owned()).spawn(move || {
        let _alive = alive;
        let answers = Arc::new(Answers::new(bridge));
        runtime.block_on(server::serve(listener, answers, stopped));
        // A question that is being answered is not waited for.
        runtime.shutdown_background();
    })?;
    tracing::info!(
        "the live page is at http://{address}/, for Prometheus at http://{address}/metrics"
    );
    Ok(Page { stop: Some(stop), ended })
}

impl Drop for Page {
    fn drop(&mut self) {
        self.stop = None;
        _ = self.ended.recv_timeout(STOP_WITHIN);
    }
}
