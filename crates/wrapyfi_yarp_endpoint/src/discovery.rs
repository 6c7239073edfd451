//! The ports of a network as endpoints.
//!
//! ```text
//!   /cam         publisher /cam          /head/state:o   publisher        /head/rpc:i   server
//!   /cam:in417   listener of /cam        /head/cmd:i     listener         /head/rpc     server
//!   /cam, /cam/rpc: publisher /cam:camera_info, the calibration of the camera
//! ```
//!
//! A name server knows names only: neither types nor what a port does. So the ports themselves are asked
//! once (`survey`). Its kind is decided by, in this order:
//!
//! | | |
//! | --- | --- |
//! | what its program made it | for requests, for one direction only |
//! | its connections | what has outputs is a publisher, what has inputs alone a listener |
//! | the customs of names | `:i`, `:o`, `in`, `rpc`, and Wrapyfi's `:in` and a number |

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_yarp::port::{AdminError, Inspection, Modes};

use super::intrinsics;
use super::registered_port::Entry;
use super::role::{role, topic_of};
use super::shared::InstanceState;
use super::survey::Silence;
use super::types::FILES;
use wrapyfi_endpoint::{Cause, DiscoverError, Discovered, Discovery, NameFilter, Role};

/// Longest time that a port is given for its answer: those that died are still registered.
const TIMEOUT: Duration = Duration::from_secs(1);

/// Looks at one name server.
pub(super) struct YarpDiscovery {
    shared: Arc<InstanceState>,
    wanted: Option<NameFilter>,
    /// Verdicts of that filter on the names of the registered ports.
    judged: BTreeMap<String, bool>,
    /// State of the last look: the directory's, and how often names, answers, types and own ports
    /// had changed. While it is the same, `found` is still right.
    known: Option<(bool, [u64; 4])>,
    /// The ports that were asked then, and what was found.
    ports: BTreeMap<String, Entry>,
    found: Vec<Discovered>,
    /// True when `found` holds everything that the name server and the ports can tell.
    complete: bool,
}

impl YarpDiscovery {
    pub(super) fn new(shared: &Arc<InstanceState>) -> Self {
        Self {
            shared: Arc::clone(shared),
            wanted: None,
            judged: BTreeMap::new(),
            known: None,
            ports: BTreeMap::new(),
            found: Vec::new(),
            complete: false,
        }
    }

    /// Leaves out ports that no program wants to know of.
    fn sift(&mut self, ports: &mut BTreeMap<String, Entry>) {
        let Some(wanted) = &self.wanted else { return };
        self.judged.retain(|name, _| ports.contains_key(name));
        ports.retain(|name, _| match self.judged.get(name) {
            Some(known) => *known,
            None => {
                // The calibration of a camera is found by its pictures.
                let of_pictures = intrinsics::topic_of(name);
                let is_wanted =
                    wanted(topic_of(name).0) || of_pictures.is_some_and(|it| wanted(&it));
                self.judged.insert(name.clone(), is_wanted);
                is_wanted
            }
        });
    }
}

impl Discovery for YarpDiscovery {
    fn only(&mut self, wanted: NameFilter) {
        self.wanted = Some(wanted);
        self.judged.clear();
        self.known = None;
    }

    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let shared = Arc::clone(&self.shared);
        let was_asked = shared.directory.was_asked();
        // Before the look, so that no change is missed.
        let now = (was_asked, shared.changes());
        if self.known == Some(now) {
            // Those that did not answer may have to be asked again.
            ask(&shared, &self.ports);
            return Ok(self.found.clone());
        }
        let (mut ports, own) = (shared.directory.entries(), shared.registrar.client());
        shared.survey.forget(|name| ports.contains_key(name));
        // The name server's own names are no endpoints.
        ports.retain(|name, _| {
            name != own.namespace() && name != "fallback" && !shared.own.contains(name)
        });
        self.sift(&mut ports);
        ask(&shared, &ports);
        let mut found: BTreeMap<(&str, Role), Discovered> = BTreeMap::new();
        self.complete = was_asked && shared.survey.is_over(&ports);
        for (port, entry) in ports.iter().filter(|(port, _)| !shared.survey.is_gone(port)) {
            let told = shared.survey.answer_of(port);
            let (name, role) = role(port, told.as_deref());
            let one = found
                .entry((name, role))
                .or_insert_with(|| Discovered { count: 0, ..Discovered::new(name, role) });
            one.count += 1;
            if role == Role::Publisher {
                let promised = told.as_ref().and_then(|told| told.type_name.as_deref());
                one.type_name = shared.types.of(port, entry.number, promised);
            }
        }
        // The calibration of a camera is a topic beside its pictures.
        let pictures = found
            .values()
            .filter(|one| one.role == Role::Publisher && one.type_name.as_deref() == Some("Image"));
        let calibrations: Vec<Discovered> = pictures
            .filter(|picture| shared.directory.knows(&intrinsics::requests(&picture.name)))
            .filter_map(|picture| {
                let topic = intrinsics::topic_of(&picture.name)?;
                Some(Discovered {
                    type_name: Some(intrinsics::CAMERA_INFO.to_owned()),
                    node: Some(picture.name.clone()),
                    ..Discovered::new(topic, Role::Publisher)
                })
            })
            .collect();
        self.found = found.into_values().chain(calibrations).collect();
        self.found.sort_by(|one, other| one.name.cmp(&other.name));
        (self.known, self.ports) = (Some(now), ports);
        Ok(self.found.clone())
    }

    fn waiting_for(&self) -> Option<Cause> {
        self.shared.directory.waiting_for()
    }

    fn is_complete(&self) -> Option<bool> {
        Some(self.complete)
    }
}

/// Asks those of `ports` that have not been asked. Returns at once.
fn ask(shared: &Arc<InstanceState>, ports: &BTreeMap<String, Entry>) {
    let mut due = shared.survey.due(ports, Instant::now());
    // Those whose first message is waited for behind that have the longest way.
    due.sort_by_cached_key(|(name, entry)| is_told_by_name(shared, name, entry));
    for (name, entry) in due {
        // One that was connected otherwise is asked all.
        let whole =
            !is_told_by_name(shared, &name, &entry) || shared.survey.answer_of(&name).is_some();
        let (shared, room) = (Arc::clone(shared), Arc::clone(&shared.survey.room));
        let tasks = Arc::clone(&shared);
        tasks.tasks.spawn_aside(async move {
            let Ok(_permit) = room.acquire_owned().await else { return };
            let told = interview(&shared, &name, whole).await;
            shared.survey.enter(&name, entry.number, told, Instant::now());
        });
    }
}

/// Watches a port that is in the way of a route: when its program is killed, no other program tells. Returns at once.
pub(super) fn verify(shared: &Arc<InstanceState>, name: &str) {
    let Some(Entry { number, .. }) = shared.directory.entry(name) else { return };
    if !shared.survey.begins_watch(name, number) {
        return;
    }
    let (tasks, shared, name) = (Arc::clone(shared), Arc::clone(shared), name.to_owned());
    tasks.tasks.spawn_aside(async move {
        if let Some(contact) = shared.located(&name).await.and_then(|entry| entry.contact()) {
            _ = shared.network.until_closed(&contact).await;
        }
        let is_refused = interview(&shared, &name, false).await == Err(Silence::Refused);
        shared.survey.ends_watch(&name, number, is_refused, Instant::now());
    });
}

/// True when the name of a port tells that it sends, and which type.
fn is_told_by_name(shared: &InstanceState, name: &str, entry: &Entry) -> bool {
    let sends = matches!(role(name, None).1, Role::Publisher);
    sends && shared.types.of(name, entry.number, None).is_some()
}

/// Asks a port about itself; about its connections alone unless `whole`.
async fn interview(shared: &InstanceState, name: &str, whole: bool) -> Result<Inspection, Silence> {
    let asked = async {
        match shared.located(name).await {
            None => Err(AdminError::Unknown(name.to_owned())),
            // A server of files over HTTP may understand nothing else.
            Some(entry) if entry.has_files() => {
                let modes = Some(Modes { input: false, output: true, rpc: false });
                Ok(Inspection { modes, type_name: Some(FILES.into()), ..Inspection::default() })
            }
            Some(entry) => shared.network.inspect(name, entry.contact().as_deref(), whole).await,
        }
    };
    match tokio::time::timeout(TIMEOUT, asked).await {
        Ok(Ok(told)) => Ok(told),
        Ok(Err(error)) => {
            tracing::debug!(port = name, %error, "does not say what it is");
            let is_elsewhere = shared.is_afar && shared.is_on_loopback(name);
            let is_refused = error.is_refused() && !is_elsewhere;
            Err(if is_refused { Silence::Refused } else { Silence::NoAnswer })
        }
        Err(_elapsed) => {
            tracing::debug!(port = name, "did not say within {TIMEOUT:?} what it is");
            Err(Silence::NoAnswer)
        }
    }
}
