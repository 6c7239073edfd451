//! Keeps ports registered, whatever happens to the name server.
//!
//! ```text
//!            register("/cam") … unregister("/cam")
//!                 │
//!   Registrar ────┴── one connection to the name server, open all the time
//!                       │ it ends              ──▶ wait for the name server, register all again
//!                       ├ verify("/cam"): it was registered or removed ─┐
//!                       └ every 5 s, the next name ────────────────────┴▶ "query": gone, or at an address
//!                                                          where no program is? register it again
//! ```
//!
//! The connection stays open because a name server that ends closes it, so its restart is noticed
//! at once without a question. The question every few seconds goes over the same connection, one
//! name after the other, whatever their number: it finds a server that is there but has forgotten
//! us (`yarp clean` during a pause of ours), and a machine that vanished without closing anything.
//! A name that another program registered meanwhile belongs to that program, as long as a program is at
//! its address: it is logged once, and left alone. A registration of a program that was killed is replaced.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::task::JoinSet;
use wrapyfi_retry::restart::restarted;
use wrapyfi_retry::{Backoff, Mutex};

use super::client::NameClient;
use super::error::NameError;
use super::reply;
use crate::port::link::{Link, LinkError};
use crate::port::names::{Later, NameRequest, Names, Registration};
use crate::task::erased;
use crate::wire::{Carrier, Command, text};

/// Settings by which ports are kept registered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RegistrarOptions {
    /// Time between two questions, whatever the number of names.
    pub check_every: Duration,
    /// Shortest time between two attempts to reach a name server that is away; it doubles up to
    /// `check_every`.
    pub retry_from: Duration,
}

impl Default for RegistrarOptions {
    fn default() -> Self {
        Self { check_every: Duration::from_secs(5), retry_from: Duration::from_millis(100) }
    }
}

/// Record of a registrar's work, and its state.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RegistrarStatus {
    /// True when the name server answered the last question.
    pub connected: bool,
    /// Number of times that the connection to the name server was lost.
    pub lost: u64,
    /// Registrations made again.
    pub renewed: u64,
    /// Names that another program has now.
    pub taken: Vec<String>,
}

/// Keeps ports registered. Cheap to clone; ends with its last clone.
#[derive(Debug, Clone)]
pub struct Registrar(Arc<RegistrarTask>);

#[derive(Debug)]
struct RegistrarTask {
    shared: Arc<RegistrarState>,
    /// Ends with the registrar.
    _task: JoinSet<()>,
}

#[derive(Debug)]
struct RegistrarState {
    client: NameClient,
    options: RegistrarOptions,
    names: Mutex<BTreeMap<String, Wanted>>,
    status: watch::Sender<RegistrarStatus>,
    /// Names whose registration has changed, and has to be looked at.
    doubted: Mutex<BTreeSet<String>>,
    /// The first name came, or a name to verify: there is something to look at.
    wake: Notify,
}

/// Longest time for which a port that has our name is given for its answer.
const ANSWERS_WITHIN: Duration = Duration::from_secs(2);

/// A port that should be registered.
#[derive(Debug, Clone)]
struct Wanted {
    at: Registration,
    /// Properties, so that they come back with the name.
    properties: BTreeMap<String, Vec<crate::Value>>,
    announced: bool,
    taken: bool,
}

impl Wanted {
    fn is_at(&self, found: &Registration) -> bool {
        (&found.host, found.port) == (&self.at.host, self.at.port)
    }
}

impl Registrar {
    /// Starts without names; nothing is connected before the first one. Runs on the current tokio
    /// runtime.
    #[must_use]
    pub fn start(client: NameClient, options: RegistrarOptions) -> Self {
        let shared = Arc::new(RegistrarState {
            client,
            options,
            names: Mutex::default(),
            status: watch::Sender::default(),
            doubted: Mutex::default(),
            wake: Notify::new(),
        });
        let (told, kept) = (Arc::clone(&shared), Arc::clone(&shared));
        let mut task = JoinSet::new();
        task.spawn(erased(restarted(
            "the registration of YARP ports".to_owned(),
            move |_| told.failed(),
            move || watch_over(Arc::clone(&kept)),
        )));
        Self(Arc::new(RegistrarTask { shared, _task: task }))
    }

    /// The client it asks with.
    pub fn client(&self) -> &NameClient {
        &self.0.shared.client
    }

    /// Has the registration of a name looked at, where it is one of these ports: the name server has told that
    /// it changed.
    pub fn verify(&self, name: &str) {
        let shared = &self.0.shared;
        if shared.names.lock().contains_key(name) {
            shared.doubted.lock().insert(name.to_owned());
            shared.wake.notify_one();
        }
    }

    /// State of the registrar, and a signal of its changes.
    pub fn status(&self) -> watch::Receiver<RegistrarStatus> {
        self.0.shared.status.subscribe()
    }
}

/// Unregisters a port, unless another program has its name by now.
async fn release(client: &NameClient, wanted: &Wanted) -> Result<(), NameError> {
    let at = &wanted.at;
    let found = if wanted.taken { None } else { client.query(&at.name).await? };
    match found {
        Some(found) if wanted.is_at(&found) => client.unregister(&at.name).await,
        _ => Ok(()),
    }
}

/// For ports: whatever registers through this stays registered until it unregisters.
impl Names for Registrar {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        Box::pin(async {
            let at = self.client().register(request).await?;
            // Groups belong to a port that opens them again; their numbers mean nothing later.
            if at.carrier != "mcast" {
                self.0.shared.insert(at.clone());
            }
            Ok(at)
        })
    }

    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>> {
        Names::query(self.client(), name)
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        Box::pin(async move {
            match self.0.shared.forget(name) {
                Some(wanted) => release(self.client(), &wanted).await,
                None => self.client().unregister(name).await,
            }
        })
    }

    /// Announces a port, and makes sure that it is the one that the name server tells of.
    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()> {
        Box::pin(async move {
            if alive {
                self.0.shared.change(name, |wanted| wanted.announced = true);
            }
            Names::announce(self.client(), name, alive).await?;
            if alive && self.0.shared.wanted(name).is_some() {
                self.0.shared.renew(name).await?;
            }
            Ok(())
        })
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        self.0.shared.change(name, |wanted| {
            let values = values.iter().map(|value| value.as_str().into()).collect();
            wanted.properties.insert(key.to_owned(), values);
        });
        Names::set(self.client(), name, key, values)
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        Names::get(self.client(), name, key)
    }
}

impl RegistrarState {
    fn insert(&self, at: Registration) {
        let name = at.name.clone();
        let properties = BTreeMap::new();
        let wanted = Wanted { at, properties, announced: false, taken: false };
        self.names.lock().insert(name, wanted);
        self.wake.notify_one();
    }

    fn forget(&self, name: &str) -> Option<Wanted> {
        let forgotten = self.names.lock().remove(name);
        if forgotten.as_ref().is_some_and(|wanted| wanted.taken) {
            self.status.send_modify(|status| status.taken.retain(|known| known != name));
        }
        forgotten
    }

    /// Registration that is wanted for a name now; `None` when it was unregistered.
    fn wanted(&self, name: &str) -> Option<Wanted> {
        self.names.lock().get(name).cloned()
    }

    fn change(&self, name: &str, how: impl FnOnce(&mut Wanted)) {
        if let Some(wanted) = self.names.lock().get_mut(name) {
            how(wanted);
        }
    }

    /// The name after this one, from the beginning behind the last one.
    fn after(&self, name: &str) -> Option<Wanted> {
        let names = self.names.lock();
        let behind = (Bound::Excluded(name.to_owned()), Bound::Unbounded);
        names.range(behind).next().or_else(|| names.iter().next()).map(|(_, wanted)| wanted.clone())
    }

    fn failed(&self) {
        self.status.send_modify(|status| status.connected = false);
    }

    /// Makes sure that one port is registered where it is.
    async fn renew(&self, name: &str) -> Result<(), NameError> {
        let found = self.client.query(name).await?;
        self.judge(name, found).await
    }

    /// Registers a port again whose name the name server does not know, or tells for an address where no program is.
    async fn judge(&self, name: &str, found: Option<Registration>) -> Result<(), NameError> {
        if let Some(found) = found {
            if self.is_ours(&found) || !self.is_deserted(&found).await {
                self.compare(&found);
                return Ok(());
            }
            tracing::info!(
                target: "wrapyfi_yarp::name",
                "{name} is registered at {}:{}, where nobody is", found.host, found.port
            );
        }
        // As it is now: a port that was opened again meanwhile has another number.
        while let Some(wanted) = self.wanted(name) {
            self.register(&wanted).await?;
            if self.wanted(name).is_none_or(|now| now.at == wanted.at) {
                break;
            }
        }
        Ok(())
    }

    /// True for a registration that is as it should be, and for one that is not wanted any more.
    fn is_ours(&self, found: &Registration) -> bool {
        let wanted = self.wanted(&found.name);
        wanted.is_none_or(|wanted| wanted.is_at(found))
    }

    /// True where the address of a registration refuses connections.
    async fn is_deserted(&self, found: &Registration) -> bool {
        let version = std::iter::once(crate::Value::vocab("ver")).collect();
        let asked = self.client.link_options();
        let answer = asked.ask(&found.contact(), &version, ANSWERS_WITHIN).await;
        answer.is_err_and(|error| error.is_refused())
    }

    async fn register(&self, wanted: &Wanted) -> Result<(), NameError> {
        let Registration { name, host, port, carrier } = &wanted.at;
        let request = NameRequest {
            name: name.clone(),
            carrier: Some(carrier.clone()),
            host: Some(host.clone()),
            port: Some(*port),
        };
        let at = self.client.register(&request).await?;
        self.compare(&at);
        for (key, values) in &wanted.properties {
            self.client.set(name, key, values).await?;
        }
        if wanted.announced {
            self.client.announce(name, true).await?;
        }
        tracing::info!(target: "wrapyfi_yarp::name", name, "registered again");
        self.status.send_modify(|status| status.renewed += 1);
        Ok(())
    }

    /// Compares a registration that was found with the one that is wanted: another program may have
    /// taken the name.
    fn compare(&self, found: &Registration) {
        let name = &found.name;
        let taken = {
            let mut names = self.names.lock();
            // Unregistered meanwhile.
            let Some(wanted) = names.get_mut(name) else { return };
            let taken = !wanted.is_at(found);
            if taken == wanted.taken {
                return;
            }
            wanted.taken = taken;
            taken
        };
        if taken {
            tracing::warn!(
                target: "wrapyfi_yarp::name",
                "port name {name} was taken by {}:{}: choose another name for one of them",
                found.host, found.port
            );
        }
        self.status.send_modify(|status| {
            status.taken.retain(|known| known != name);
            if taken {
                status.taken.push(name.clone());
            }
        });
    }
}

/// Watches the name server as long as there are names.
async fn watch_over(shared: Arc<RegistrarState>) {
    let RegistrarOptions { check_every, retry_from } = shared.options;
    let mut backoff = Backoff::of_name("YARP's name server")
        .starting_at(retry_from)
        .up_to(check_every.max(retry_from));
    loop {
        if shared.names.lock().is_empty() {
            shared.wake.notified().await;
        } else if let Err(error) = renew_and_watch(&shared, &mut backoff).await {
            tracing::debug!(target: "wrapyfi_yarp::name", error = %error, "name server lost");
            shared.failed();
            backoff.pause().await;
        }
    }
}

/// Registers all names that are gone, and watches the connection as long as there are names.
///
/// # Errors
/// When the name server does not answer, or the connection ends.
async fn renew_and_watch(
    shared: &RegistrarState,
    backoff: &mut Backoff,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let names: Vec<String> = shared.names.lock().keys().cloned().collect();
    let link = shared.client.greet(Carrier::TextAck, "anon_registrar").await?;
    for name in &names {
        shared.renew(name).await?;
    }
    backoff.reset();
    shared.status.send_modify(|status| status.connected = true);
    let watched = stay(shared, link).await;
    if watched.is_err() {
        shared.status.send_modify(|status| status.lost += 1);
    }
    Ok(watched?)
}

/// Watches one connection until it ends, which is an error, or until there are no names.
async fn stay(shared: &RegistrarState, mut link: Link) -> Result<(), LinkError> {
    let mut last = String::new();
    loop {
        let doubted = shared.doubted.lock().pop_first();
        let name = match doubted {
            Some(name) => name,
            None => tokio::select! {
                error = link.ended() => return Err(error),
                () = shared.wake.notified() => continue,
                () = tokio::time::sleep(shared.options.check_every) => {
                    let Some(wanted) = shared.after(&last) else { return Ok(()) };
                    last.clone_from(&wanted.at.name);
                    wanted.at.name
                }
            },
        };
        let data = Command::Data { reply: true, envelope: None };
        let question = text::message(&data, Some(format!("query {name}").as_bytes()));
        let asked = async {
            link.write_raw(&[&question]).await?;
            link.answer_lines().await
        };
        let answer = shared.client.in_time(asked).await?;
        let found = answer.first().and_then(|line| reply::registration(line));
        if let Err(error) = shared.judge(&name, found).await {
            tracing::warn!(target: "wrapyfi_yarp::name", %error, name, "not registered");
        }
    }
}
