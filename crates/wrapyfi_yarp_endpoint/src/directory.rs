//! The names there are, as the name server tells them, and who waits for one.
//!
//! ```text
//!   name server ── list, then [add], [del] ──▶ Directory ── names() ──▶ discovery
//!                     one connection             │
//!                                                └─ rings those who watch that name
//! ```
//!
//! One connection tells all changes, so that no program has to ask again and again whether a port is
//! there. When the name server ends and comes back, everybody is rung: a new one knows nothing. Programs of
//! YARP do not register again, so that a port which the lost name server knew stays here for as long as it
//! answers where it was ([`super::unlisted`]).

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::error::Error;
use std::sync::{Arc, Weak};
use std::time::Duration;

use tokio::sync::Notify;
use tokio::task::JoinSet;
use wrapyfi_yarp::name::events::NameEvents;
use wrapyfi_yarp::name::{NameClient, NameEvent};
use wrapyfi_yarp::port::names::Registration;

use super::registered_port::Entry;
use super::shared::InstanceState;
use super::unlisted;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{Cause, Mutex, Named};
use wrapyfi_yarp::task::erased;

/// Longest time that opening an endpoint waits for the first answer of the name server.
const FIRST_ANSWER: Duration = Duration::from_secs(1);
/// Time after which an answer that has not come is reported as awaited: a dead link takes several
/// times five seconds.
const SLOW: Duration = Duration::from_millis(500);

/// Ports that the name server has registered, kept up to date from its events.
#[derive(Debug)]
pub(super) struct Directory {
    server: String,
    /// True when the name server is on another machine.
    is_afar: bool,
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    /// Counts the times that the name server was reached; none while it is away.
    reached: Option<u64>,
    times: u64,
    failure: Option<String>,
    /// Registered ports; multicast groups are none.
    names: BTreeMap<String, Entry>,
    /// Counts the ports that were entered.
    entered: u64,
    /// Counts the changes of names.
    changes: u64,
    watchers: BTreeMap<String, Vec<Weak<Notify>>>,
}

impl Inner {
    /// Takes over the ports of a list, without multicast groups; whether names came or went. Ports that the
    /// first list (`is_first`) of a name server leaves out are unlisted from now on.
    fn enter(&mut self, ports: Vec<Registration>, is_first: bool) -> bool {
        self.changes += 1;
        let mut before = std::mem::take(&mut self.names);
        let mut changed = false;
        for port in ports.into_iter().filter(|port| port.carrier != "mcast") {
            let known = before.remove(&port.name);
            changed |= known.as_ref().is_none_or(|known| known.is_unlisted);
            self.enter_port(port, known);
        }
        let left = before.len();
        before.retain(|_, entry| entry.is_unlisted || is_first && entry.at.is_some());
        changed |= before.len() < left;
        before.values_mut().for_each(|entry| entry.is_unlisted = true);
        self.names.append(&mut before);
        changed
    }

    /// Enters a registered port. One that is where it was is the one that it was.
    fn enter_port(&mut self, port: Registration, known: Option<Entry>) {
        let number = match known {
            Some(known) if known.at.as_ref().is_none_or(|at| *at == port) => known.number,
            _ => {
                self.entered += 1;
                self.entered
            }
        };
        self.names.insert(port.name.clone(), Entry::new(number, Some(port)));
    }

    fn ring(&self, name: &str) {
        if let Some(watchers) = self.watchers.get(name) {
            watchers.iter().filter_map(Weak::upgrade).for_each(|bell| _ = ring(&bell));
        }
    }
}

impl Directory {
    pub(super) fn new(client: &NameClient, is_afar: bool) -> Self {
        let conf = client.server();
        let server = format!("{}:{}", conf.host, conf.port);
        Self { server, is_afar, inner: Mutex::default() }
    }

    /// Number of the name server's connection, counted from the first; `None` while it is away.
    pub(super) fn reached(&self) -> Option<u64> {
        self.inner.lock().reached
    }

    /// True once the name server has answered, or could not be reached.
    pub(super) fn was_asked(&self) -> bool {
        let inner = self.inner.lock();
        inner.reached.is_some() || inner.failure.is_some()
    }

    /// True when a port of this name is registered.
    pub(super) fn knows(&self, name: &str) -> bool {
        self.inner.lock().names.contains_key(name)
    }

    /// Place of a port that the name server before this one knew, and this one does not.
    pub(super) fn unlisted(&self, name: &str) -> Option<Registration> {
        self.entry(name).filter(|entry| entry.is_unlisted)?.at
    }

    /// Place of a port that the name server does not tell: one that is unlisted, and all while it is away.
    pub(super) fn kept(&self, name: &str) -> Option<Registration> {
        let inner = self.inner.lock();
        let entry = inner.names.get(name)?;
        entry.at.clone().filter(|_| entry.is_unlisted || inner.reached.is_none())
    }

    /// The port of this name.
    pub(super) fn entry(&self, name: &str) -> Option<Entry> {
        self.inner.lock().names.get(name).cloned()
    }

    /// Enters where the name server has found the port of an entry; the entry.
    pub(super) fn locate(&self, name: &str, number: u64, found: Registration) -> Entry {
        let located = Entry::new(number, Some(found));
        let mut inner = self.inner.lock();
        if let Some(entry) = inner.names.get_mut(name).filter(|entry| entry.number == number) {
            entry.clone_from(&located);
        }
        located
    }

    /// Number of changes of the registered names.
    pub(super) fn changes(&self) -> u64 {
        self.inner.lock().changes
    }

    /// All ports by name.
    pub(super) fn entries(&self) -> BTreeMap<String, Entry> {
        self.inner.lock().names.clone()
    }

    /// Cause for which nothing is known; `None` while the name server is there.
    pub(super) fn waiting_for(&self) -> Option<Cause> {
        let inner = self.inner.lock();
        if inner.reached.is_some() {
            return None;
        }
        // It was not heard yet, and may be there.
        let Some(why) = &inner.failure else { return Some(self.away(String::new())) };
        let remedy = if self.is_afar {
            "it has to run there; YARP's own listens on all addresses, `wrapyfi yarpserver` on 127.0.0.1 \
             unless --ip and --insecure are given there; a firewall may be between"
        } else {
            "start one with `wrapyfi yarpserver`"
        };
        Some(self.away(format!(" ({why}): {remedy}")))
    }

    /// Host and port of the name server.
    pub(super) fn address(&self) -> &str {
        &self.server
    }

    /// Cause that the name server does not answer, with `detail` behind its address.
    fn away(&self, detail: String) -> Cause {
        Cause::ServerAway { server: Named::server("name server", &self.server), detail }
    }

    /// Awaits `asked`, a question to the name server. Calls `say` with the reason where the answer
    /// takes longer than half a second; `to` completes the sentence "name server … to …".
    pub(super) async fn answers<T>(
        &self,
        to: &str,
        asked: impl Future<Output = T>,
        say: impl FnOnce(Cause),
    ) -> T {
        let server = || self.away(format!(" {to}"));
        unless_slow(asked, || say(self.waiting_for().unwrap_or_else(server))).await
    }

    /// Waits until the name server was asked, for a second at most.
    pub(super) async fn was_asked_in_time(&self) {
        let deadline = tokio::time::Instant::now() + FIRST_ANSWER;
        while !self.was_asked() && tokio::time::Instant::now() < deadline {
            tokio::time::sleep(FIRST_ANSWER / 50).await;
        }
    }

    /// A bell that rings when this name comes or goes, and when the name server does.
    pub(super) fn watch(&self, name: &str) -> Arc<Notify> {
        self.watch_any(&[name])
    }

    /// As [`Directory::watch`], for any of these names.
    pub(super) fn watch_any(&self, names: &[impl AsRef<str>]) -> Arc<Notify> {
        let bell = Arc::new(Notify::new());
        let mut inner = self.inner.lock();
        for name in names {
            let watchers = inner.watchers.entry(name.as_ref().to_owned()).or_default();
            watchers.retain(|watcher| watcher.strong_count() > 0);
            watchers.push(Arc::downgrade(&bell));
        }
        bell
    }

    fn ring_all(&self) {
        let mut inner = self.inner.lock();
        inner.watchers.retain(|_, watchers| {
            watchers.retain(|watcher| watcher.upgrade().is_some_and(|bell| ring(&bell)));
            !watchers.is_empty()
        });
    }

    fn apply(&self, event: NameEvent) {
        let mut inner = self.inner.lock();
        inner.changes += 1;
        let name = match event {
            NameEvent::Added(name) => {
                inner.entered += 1;
                let entry = Entry::new(inner.entered, None);
                inner.names.insert(name.clone(), entry);
                name
            }
            NameEvent::Removed(name) => {
                inner.names.remove(&name);
                name
            }
        };
        inner.ring(&name);
    }

    /// Enters that a port which was unlisted is registered again.
    fn listed(&self, port: Registration) {
        let mut inner = self.inner.lock();
        let (name, known) = (port.name.clone(), inner.names.remove(&port.name));
        inner.changes += 1;
        inner.enter_port(port, known);
        inner.ring(&name);
    }

    /// Forgets a port that is unlisted still.
    pub(super) fn forget_unlisted(&self, name: &str, number: u64) {
        let mut inner = self.inner.lock();
        if inner.names.get(name).is_some_and(|entry| entry.is_unlisted && entry.number == number) {
            inner.names.remove(name);
            inner.changes += 1;
            inner.ring(name);
        }
    }

    /// The ports of a name server that was reached; those that it does not know, as the one before did.
    fn found(&self, ports: Vec<Registration>) -> Vec<(String, Entry)> {
        let mut inner = self.inner.lock();
        inner.times += 1;
        inner.reached = Some(inner.times);
        inner.failure = None;
        inner.enter(ports, true);
        let unlisted = inner.names.iter().filter(|(_, entry)| entry.is_unlisted);
        let unlisted = unlisted.map(|(name, entry)| (name.clone(), entry.clone())).collect();
        drop(inner);
        self.ring_all();
        unlisted
    }

    /// Takes over names of the same name server, where they are others than are known.
    fn amended(&self, ports: Vec<Registration>) {
        if self.inner.lock().enter(ports, false) {
            self.ring_all();
        }
    }

    pub(super) fn lost(&self, why: &dyn std::fmt::Display) {
        let mut inner = self.inner.lock();
        let was = inner.reached.take().is_some();
        inner.failure = Some(why.to_string());
        drop(inner);
        if was {
            self.ring_all();
        }
    }
}

/// Awaits `asked`; calls `say` once where that takes longer than half a second.
pub(super) async fn unless_slow<T>(asked: impl Future<Output = T>, say: impl FnOnce()) -> T {
    tokio::pin!(asked);
    if let Ok(answer) = tokio::time::timeout(SLOW, &mut asked).await {
        return answer;
    }
    say();
    asked.await
}

fn ring(bell: &Notify) -> bool {
    bell.notify_one();
    true
}

/// Times after which the names are asked for again, once the name server was told to tell changes.
/// It does not say from when on it tells them: a port that is registered between the first list and
/// that moment is in neither.
const LOOKS_AGAIN: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(2)];

/// Keeps the directory up to date for as long as it is run.
pub(super) async fn follow(shared: Arc<InstanceState>) {
    let mut backoff = Backoff::of_name("names").starting_at(Duration::from_millis(50));
    let mut status = shared.registrar.status();
    loop {
        let lost = status.borrow_and_update().lost;
        let told = listen(&shared, &mut backoff);
        // A machine that vanished closes nothing; the registrar asks it now and then.
        let silent = status.wait_for(|status| status.lost > lost);
        tokio::select! {
            Err(error) = told => shared.directory.lost(&error),
            Ok(_) = silent => shared.directory.lost(&"its connection was lost"),
        }
        backoff.pause().await;
    }
}

/// Hears one name server until it ends.
async fn listen(
    shared: &Arc<InstanceState>,
    backoff: &mut Backoff,
) -> Result<Infallible, Box<dyn Error + Send + Sync>> {
    let (client, directory) = (shared.registrar.client(), &shared.directory);
    let mut events = NameEvents::open(client).await?;
    // They end with this name server: the next one may know the ports.
    let mut watches = JoinSet::new();
    for (name, entry) in directory.found(client.list("").await?) {
        watches.spawn(erased(unlisted::until_gone(Arc::clone(shared), name, entry)));
    }
    backoff.reset();
    let begin = tokio::time::Instant::now();
    let mut looks = LOOKS_AGAIN.iter();
    let mut next_look = looks.next();
    loop {
        let look_at = begin + next_look.copied().unwrap_or_default();
        tokio::select! {
            event = events.next() => match event? {
                NameEvent::Added(name) if directory.unlisted(&name).is_some() => {
                    let port = client.query(&name).await?;
                    port.into_iter().for_each(|port| directory.listed(port));
                }
                event => {
                    let (NameEvent::Added(name) | NameEvent::Removed(name)) = &event;
                    shared.registrar.verify(name);
                    directory.apply(event);
                }
            },
            () = tokio::time::sleep_until(look_at), if next_look.is_some() => {
                next_look = looks.next();
                // Changes that are told meanwhile wait in the connection, and are applied after it.
                directory.amended(client.list("").await?);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(name: &str, port: u16) -> Registration {
        let (name, host, carrier) = (name.to_owned(), "127.0.0.1".to_owned(), "tcp".to_owned());
        Registration { name, host, port, carrier }
    }

    #[test]
    fn a_port_keeps_its_number_until_it_is_another_one() {
        let mut inner = Inner::default();
        assert!(inner.enter(vec![port("/a", 1), port("/b", 2)], true));
        let number = |inner: &Inner, name: &str| inner.names[name].number;
        let (a, b) = (number(&inner, "/a"), number(&inner, "/b"));
        assert_ne!(a, b);
        assert!(!inner.enter(vec![port("/a", 1), port("/b", 3)], false), "the same names");
        assert_eq!(number(&inner, "/a"), a);
        assert_ne!(number(&inner, "/b"), b, "it is elsewhere");
        inner.names.get_mut("/a").unwrap().at = None;
        let group = Registration { carrier: "mcast".into(), ..port("/group", 4) };
        assert!(inner.enter(vec![port("/a", 7), group], false), "/b went");
        assert_eq!(number(&inner, "/a"), a, "its address was not known before");
        assert_eq!(inner.names.len(), 1);
    }

    #[test]
    fn what_a_new_name_server_does_not_know_is_unlisted_until_it_does() {
        let mut inner = Inner::default();
        let unlisted = |inner: &Inner| {
            let unlisted = inner.names.iter().filter(|(_, entry)| entry.is_unlisted);
            unlisted.map(|(name, _)| name.clone()).collect::<Vec<_>>()
        };
        inner.enter(vec![port("/a", 1), port("/b", 2), port("/nowhere", 3)], true);
        inner.names.get_mut("/nowhere").unwrap().at = None;
        let number = inner.names["/a"].number;
        assert!(inner.enter(vec![port("/b", 2)], true));
        assert_eq!(unlisted(&inner), ["/a"]);
        assert!(!inner.enter(vec![port("/b", 2)], false), "nothing is new");
        assert!(inner.enter(vec![], false), "/b went");
        assert_eq!((unlisted(&inner), inner.names.len()), (vec!["/a".to_owned()], 1));
        inner.enter(vec![], true);
        assert_eq!(unlisted(&inner), ["/a"], "also at the next one");
        assert!(inner.enter(vec![port("/a", 1)], false), "it is known again");
        assert_eq!(inner.names["/a"], Entry::new(number, Some(port("/a", 1))));
        inner.enter(vec![], true);
        inner.enter(vec![port("/a", 9)], false);
        assert_ne!(inner.names["/a"].number, number, "it is elsewhere");
    }
}
