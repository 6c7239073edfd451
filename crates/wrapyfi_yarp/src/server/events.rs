//! Readers of changes: those the name server connects to, and those that turned their connection
//! around.
//!
//! ```text
//!   tell([add] "/cam") ──▶ a queue each ──▶ one task each ──▶ message, acknowledgement
//!                          (full: dropped, counted)
//! ```

use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use wrapyfi_retry::Mutex;

use super::shared::Shared;
use crate::Dialect;
use crate::name::{NameEvent, Target};
use crate::port::link::Link;
use crate::port::{Counters, LinkError};
use crate::wire::{Carrier, Command, Sender, admin};

/// The readers there are.
#[derive(Debug, Default)]
pub(super) struct Readers(Mutex<Inner>);

#[derive(Debug, Default)]
struct Inner {
    readers: Vec<Reader>,
    tasks: JoinSet<()>,
    ended: bool,
}

#[derive(Debug)]
struct Reader {
    name: String,
    carrier: String,
    queue: mpsc::Sender<NameEvent>,
}

impl Readers {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        let mut inner = self.0.lock();
        while inner.tasks.try_join_next().is_some() {}
        inner.readers.retain(|reader| !reader.queue.is_closed());
        inner
    }

    /// Names and carriers of the readers.
    pub(super) fn names(&self) -> Vec<(String, String)> {
        let inner = self.inner();
        inner.readers.iter().map(|reader| (reader.name.clone(), reader.carrier.clone())).collect()
    }

    /// Tells a change to everybody, now or never.
    pub(super) fn tell(&self, event: &NameEvent, counters: &Counters) {
        for reader in &self.inner().readers {
            if reader.queue.try_send(event.clone()).is_err() {
                counters.add("event_dropped");
            }
        }
    }

    /// Says goodbye to a reader; false where there is none of that name.
    pub(super) fn remove(&self, name: &str) -> bool {
        let mut inner = self.inner();
        let before = inner.readers.len();
        // Its task ends when nobody can tell it anything.
        inner.readers.retain(|reader| reader.name != name);
        inner.readers.len() < before
    }

    /// Says goodbye to all.
    pub(super) fn end(&self) {
        let mut inner = self.inner();
        inner.ended = true;
        inner.readers.clear();
        inner.tasks.abort_all();
    }

    /// Says goodbye to all, and waits a moment for it to be heard.
    pub(super) async fn farewell(&self) {
        let mut tasks = {
            let mut inner = self.inner();
            inner.ended = true;
            inner.readers.clear();
            std::mem::take(&mut inner.tasks)
        };
        let all = async { while tasks.join_next().await.is_some() {} };
        if tokio::time::timeout(FAREWELL, all).await.is_err() {
            tracing::debug!(target: "wrapyfi_yarp::server", "readers that do not read are cut off");
        }
    }

    /// Serves a reader on a connection that is open.
    pub(super) fn add(&self, name: String, carrier: String, link: Link, shared: &Shared) -> bool {
        let limits = &shared.options.limits;
        let (queue, waiting) = mpsc::channel(limits.max_waiting_events);
        let mut inner = self.inner();
        // A second connection to the same port takes the place of the first. Readers that are no ports
        // may share a name, as all our clients do.
        inner.readers.retain(|reader| reader.name != name || !name.starts_with('/'));
        if inner.ended || inner.readers.len() >= limits.max_readers {
            shared.counters.add("too_many_readers");
            return false;
        }
        let dialect = shared.options.dialect;
        inner.tasks.spawn(async move {
            if let Err(error) = run(link, dialect, waiting).await {
                tracing::debug!(target: "wrapyfi_yarp::server", %error, "reader lost");
            }
        });
        inner.readers.push(Reader { name, carrier, queue });
        true
    }
}

/// Longest time that a goodbye may take.
const FAREWELL: Duration = Duration::from_secs(1);

/// Connects to a port that wants to hear of changes; the sentence that says how it went.
pub(super) async fn connect(destination: &str, shared: &Arc<Shared>) -> Result<String, String> {
    let target = Target::parse(destination);
    let unknown = || admin::unknown_destination(destination);
    if !target.name.starts_with('/') {
        return Err(unknown());
    }
    let found = shared.state.lock().registry.find(&target.name, &target.network);
    let found = found.ok_or_else(unknown)?;
    let mut sender = Sender::new(&*shared.own.name);
    let carrier = match sender.qualify(&target.carrier) {
        "" => Carrier::Tcp,
        name => name.parse().map_err(|_unknown| unknown())?,
    };
    let text = sender.carrier_text(carrier);
    let unreachable = || admin::unreachable_destination(destination);
    if carrier.is_connectionless() || carrier.is_unix() || !carrier.is_push() {
        return Err(unreachable());
    }
    let (contact, options) = (found.contact(), shared.network.link_options());
    let opened = Link::open(&contact, carrier, &sender, &[], &options).await;
    let (link, _) = opened.map_err(|_error| unreachable())?;
    if !shared.readers.add(target.name, text, link, shared) {
        return Err(admin::NO_OUTPUTS.to_owned());
    }
    Ok(admin::added(&shared.own.name, destination))
}

/// Sends changes until nobody tells any more, or the reader is gone.
async fn run(
    mut link: Link,
    dialect: Dialect,
    mut waiting: mpsc::Receiver<NameEvent>,
) -> Result<(), LinkError> {
    let command = Command::Data { reply: false, envelope: None };
    loop {
        let event = tokio::select! {
            event = waiting.recv() => event,
            error = link.ended() => return Err(error),
        };
        let Some(event) = event else { break };
        let payload = event.to_bottle().encode(dialect).map_err(std::io::Error::other)?;
        link.write(&command, &Bytes::from(payload)).await?;
        // A reader that does not acknowledge gets no more: its queue fills, and then it misses changes.
        link.acknowledged().await?;
    }
    let late = |_| LinkError::Timeout(FAREWELL);
    tokio::time::timeout(FAREWELL, link.quit()).await.map_err(late)?
}
