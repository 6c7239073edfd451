//! Keeps one connection between a port of ours and another one.
//!
//! ```text
//!   persistent   name server: subscribe /cam ─▶ /cam:in7        it connects whenever both are there, else as below
//!   otherwise    /cam: [add] tcp://cam:in7                      we ask, and ask again
//!   neither      no port called /cam: waits for its name, without asking
//! ```

use super::name;
use std::time::Duration;

use tokio::sync::{Notify, watch};
use wrapyfi_yarp::port::Connected;

use super::directory::unless_slow;
use super::options::YarpOptions;
use super::shared::InstanceState;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{Cause, Named, PeerFault};

/// Time that the name server has to make the connection before it is reminded.
const TIMEOUT: Duration = Duration::from_millis(200);
/// Longest time that a farewell to the name server may take.
const FAREWELL: Duration = Duration::from_millis(500);

/// A connection that should be.
#[derive(Debug, Clone)]
pub(super) struct PortConnection {
    source: String,
    destination: String,
    /// None where it depends on what the other one is.
    carrier: Option<String>,
    persistent: bool,
    /// The one that is ours.
    own: String,
}

impl PortConnection {
    /// Connection from `source` to our port `own`.
    pub(super) fn from(source: &str, own: &str, options: &YarpOptions) -> Self {
        Self::new(source, own, own, options)
    }

    /// Connection from our port `own` to `destination`.
    pub(super) fn to(destination: &str, own: &str, options: &YarpOptions) -> Self {
        Self::new(own, destination, own, options)
    }

    fn new(source: &str, destination: &str, own: &str, options: &YarpOptions) -> Self {
        Self {
            source: source.to_owned(),
            destination: destination.to_owned(),
            carrier: options.carrier.clone(),
            persistent: options.persistent,
            own: own.to_owned(),
        }
    }

    /// The one that is not ours.
    pub(super) fn other(&self) -> &str {
        if self.own == self.source { &self.destination } else { &self.source }
    }

    /// Cause that the connection is not there, with its fault.
    fn missing(&self, fault: Option<&PeerFault>, hint: &'static str) -> Cause {
        Cause::peer(name::port(self.other()), " to connect", fault.cloned(), hint)
    }

    /// True when the other port, as it is now, is a source of files that may be no port of YARP.
    async fn reads_files(&self, shared: &InstanceState) -> bool {
        let is_source = self.own == self.destination;
        is_source && shared.located(self.other()).await.is_some_and(|other| other.has_files())
    }

    /// Sees to it, for as long as it is run. `is_connected` says whether it is there, `changed` when to
    /// look again; `say` is told why it is not.
    pub(super) async fn keep(
        &self,
        shared: &InstanceState,
        mut changed: watch::Receiver<Connected>,
        is_connected: &(dyn Fn() -> bool + Sync),
        say: &(dyn Fn(Cause) + Sync),
    ) {
        let bell = shared.directory.watch(self.other());
        let (mut backoff, mut subscribed) =
            (Backoff::of_name(self.other()).starting_at(TIMEOUT), None);
        let mut is_reminded = false;
        loop {
            let reached = shared.directory.reached();
            if reached.is_none() {
                shared.directory.waiting_for().into_iter().for_each(say);
                news(&bell, &mut changed).await;
                continue;
            }
            let has_files = self.reads_files(shared).await;
            let usual = if has_files { "mjpeg" } else { "tcp" };
            let carrier = self.carrier.as_deref().unwrap_or(usual);
            // A name server connects those that have announced themselves: who is no port never does, nor does
            // one that a name server before this one knew.
            let is_unlisted = shared.directory.unlisted(self.other()).is_some();
            let persistent = self.persistent && !has_files && !is_unlisted;
            let wish = reached.map(|reached| (reached, carrier));
            if persistent && subscribed != wish {
                let to = format!("{carrier}:/{}", self.destination);
                let asked = shared.registrar.client().subscribe(&self.source, &to);
                let what = format!("to connect port {}", self.other());
                if let Err(error) = shared.directory.answers(&what, asked, say).await {
                    let fault = PeerFault::Transport(error.to_string());
                    let address = shared.directory.address().to_owned();
                    let server = Named { words: "the name server".to_owned(), address };
                    say(Cause::peer(server, " to connect it", Some(fault), ""));
                    tokio::select! { () = bell.notified() => {}, () = backoff.pause() => {} }
                    continue;
                }
                subscribed = wish;
            }
            // Seen before the look, so that no change is missed.
            changed.mark_unchanged();
            if is_connected() {
                backoff.reset();
                is_reminded = false;
                news(&bell, &mut changed).await;
                continue;
            }
            if !shared.directory.knows(self.other()) {
                say(Cause::NotOpened(name::address(self.other())));
                news(&bell, &mut changed).await;
                continue;
            }
            let mut failure = None;
            // A name server that is not told of the end of a connection, as where a cable was cut, makes no other one.
            if !persistent || is_reminded {
                let (from, to) = (&self.source, &self.destination);
                let asked = shared.network.connect(from, to, Some(carrier));
                failure = unless_slow(asked, || say(self.missing(None, ""))).await.err();
            }
            let fault = failure.map(|error| PeerFault::Transport(error.to_string()));
            let hint = shared.hint(self.other());
            let hint = unless_slow(hint, || say(self.missing(fault.as_ref(), ""))).await;
            if is_connected() {
                continue;
            }
            say(self.missing(fault.as_ref(), hint));
            tokio::select! {
                () = bell.notified() => {
                    backoff.reset();
                    continue;
                }
                Ok(()) = changed.changed() => continue,
                () = backoff.pause() => {}
            }
            if persistent && !is_connected() {
                // An announcement makes the name server look at what should be connected.
                if let Err(error) = shared.registrar.client().announce(&self.own, true).await {
                    tracing::debug!(own = self.own, %error, "the name server was not reminded");
                }
                is_reminded = true;
            }
        }
    }

    /// Takes the wish back at the name server, which would keep it for ever.
    pub(super) async fn forget(&self, shared: &InstanceState) {
        if !self.persistent {
            return;
        }
        let names = shared.registrar.client();
        let forgotten = names.unsubscribe(&self.source, &self.destination);
        if let Ok(Err(error)) = tokio::time::timeout(FAREWELL, forgotten).await {
            tracing::debug!(own = self.own, %error, "a persistent connection stays known");
        }
    }
}

/// Waits until the other port comes or goes, or a connection of ours does.
async fn news(bell: &Notify, changed: &mut watch::Receiver<Connected>) {
    tokio::select! {
        () = bell.notified() => {}
        Ok(()) = changed.changed() => {}
    }
}
