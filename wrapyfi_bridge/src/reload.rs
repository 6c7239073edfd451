//! A configuration that changes while its bridge runs.
//!
//! ```text
//!   the file is another ─┐
//!   SIGHUP ──────────────┼─▶ read, check, compare ─▶ Applier::apply ─▶ what is the same goes on
//!   ~/reload ────────────┘     └ anything wrong: the routes stay as they are, and the reason is told
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{IsTerminal as _, Read as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use serde_json::Value as Json;
use signal_hook::consts::SIGHUP;
use wrapyfi_core::endpoint::{Context, Registry, Server, ServiceSpec, WAITING};
use wrapyfi_core::engine::{Applier, Config, ConfigError, MAX_CONFIG_BYTES, Plan, PlanDiff};
use wrapyfi_core::middleware::ros2::NodeHandle;
use wrapyfi_core::types::{Map, Payload, ServiceKind, Value};
use wrapyfi_interfaces::store::TypeStore;

use crate::command::bridge::{ros2_types, warn_of_unheard};
use crate::exit::Failure;
use crate::middlewares::{self, Loaded};
use crate::node::Node;
use crate::overrides;

/// How often the file is looked at. It is read once it has been the same for so long.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// Time after which a file that is gone is complained of: editors take it away for a moment.
const GONE_AFTER: Duration = Duration::from_secs(2);
/// How long the end of the program waits for a file that is being read.
const STOP_WITHIN: Duration = Duration::from_millis(500);
/// Most changes that get a line each in the log.
const FEW: usize = 10;

/// Reads a configuration file of at most [`MAX_CONFIG_BYTES`].
///
/// # Errors
/// When it cannot be read, is longer, or is no UTF-8 text.
pub fn read_file(file: &Path) -> std::io::Result<String> {
    let mut text = String::new();
    File::open(file)?.take(MAX_CONFIG_BYTES as u64 + 1).read_to_string(&mut text)?;
    Ok(text)
}

/// What a running bridge cannot change, as it was at its start.
#[derive(Debug, Clone, Default)]
pub struct Fixed {
    /// Settings of `endpoints` and `hosts`, each by its place in the file.
    settings: BTreeMap<String, String>,
    middlewares: BTreeSet<String>,
    largest_message: usize,
    /// Middlewares on which others connect to us.
    reached: BTreeSet<String>,
    has_zeromq_services: bool,
}

impl Fixed {
    /// Of a plan and the text of its file, which is called `name` in errors.
    ///
    /// # Errors
    /// When the text is no configuration.
    pub fn of(plan: &Plan, text: &str, name: &str) -> Result<Self, ConfigError> {
        let config: Config<Json> = Config::from_yaml(text, name)?;
        let mut settings = BTreeMap::new();
        flatten("endpoints", &config.endpoints, &mut settings);
        for (host, address) in &config.hosts {
            settings.insert(format!("hosts.{host}"), address.value.clone());
        }
        let middlewares: BTreeSet<String> = plan.middlewares().map(str::to_owned).collect();
        let reached = middlewares.iter().filter(|name| plan.is_reached_on(name)).cloned().collect();
        let mut ends = plan.services.iter().flat_map(|route| [&route.offered, &route.service]);
        Ok(Self {
            settings,
            reached,
            largest_message: plan.largest_message(),
            has_zeromq_services: ends.any(|end| end.middleware == "zeromq"),
            middlewares,
        })
    }

    /// What of `new` a bridge that was started with this cannot turn to, each in words.
    #[must_use]
    pub fn refusals(&self, new: &Self) -> Vec<String> {
        let mut found = Vec::new();
        let keys: BTreeSet<&String> = self.settings.keys().chain(new.settings.keys()).collect();
        for key in keys {
            let value = |of: &Self| of.settings.get(key).cloned().unwrap_or("left out".to_owned());
            let (before, now) = (value(self), value(new));
            if before != now {
                found.push(format!("{key} was {before} at the start and is {now} now"));
            }
        }
        for name in new.middlewares.difference(&self.middlewares) {
            found.push(format!("no route was on {name} at the start"));
        }
        for name in new.reached.difference(&self.reached) {
            if self.middlewares.contains(name) {
                found.push(format!("nobody connected to a route on {name} at the start"));
            }
        }
        if new.has_zeromq_services && !self.has_zeromq_services {
            found.push("no service was on zeromq at the start".to_owned());
        }
        let (before, now) = (self.largest_message, new.largest_message);
        if now > before {
            found.push(format!(
                "max_message_mib: messages up to {now} bytes, {before} at the start"
            ));
        }
        found
    }
}

/// Enters the values below a key, each with its place: `endpoints.zeromq.pub_port`.
fn flatten(place: &str, value: &Json, found: &mut BTreeMap<String, String>) {
    match value {
        Json::Null => {}
        Json::Object(fields) => {
            fields.iter().for_each(|(key, value)| flatten(&format!("{place}.{key}"), value, found));
        }
        other => _ = found.insert(place.to_owned(), other.to_string()),
    }
}

/// Turns a bridge to the configuration that its file has now.
pub struct Reload {
    /// File of the configuration.
    pub file: PathBuf,
    /// What the bridge was started with.
    pub fixed: Fixed,
    /// The bridge's node.
    pub node: Node,
    /// What the node has on the graph, where it is on one.
    pub handle: Option<NodeHandle>,
    /// The routes.
    pub routes: Applier,
}

impl Reload {
    /// Reads the file and applies it; text and difference.
    fn apply(&self) -> Result<(String, PlanDiff), Failure> {
        let name = self.file.display().to_string();
        let meta = std::fs::metadata(&self.file);
        let meta = meta.map_err(|error| Failure::usage(format!("{name}: {error}")))?;
        if !meta.is_file() {
            return Err(Failure::Usage(format!("{name} is no file: only a file is read again")));
        }
        let Loaded { mut plan, mut types, waiting_bytes, text, .. } =
            middlewares::load_and_learn(&self.file)?;
        let fixed = Fixed::of(&plan, &text, &name).map_err(Failure::usage)?;
        let refusals = self.fixed.refusals(&fixed);
        if !refusals.is_empty() {
            let text = refusals.join("; ");
            return Err(Failure::Usage(format!("{name}: {text}: start the program anew for that")));
        }
        let overridden = match &self.handle {
            Some(handle) => handle.parameters(|it| overrides::apply(&mut plan, &self.node, it)),
            None => {
                let mut store = self.node.parameters().map_err(Failure::usage)?;
                overrides::apply(&mut plan, &self.node, &mut store)
            }
        };
        overridden.map_err(Failure::usage)?;
        if let Some(handle) = &self.handle {
            handle.types(|described| {
                for name in ros2_types(&plan) {
                    if let Err(error) = described.add_named(&mut types, name) {
                        tracing::warn!("{name} is not described: {error}");
                    }
                }
            });
        }
        warn_of_unheard(&plan, &self.node);
        let diff = self.routes.apply(plan, types).map_err(Failure::usage)?;
        WAITING.set_limit(waiting_bytes);
        Ok((text, diff))
    }

    /// As [`Reload::apply`], and logs what came of it.
    fn apply_and_tell(&self, known: &mut String) -> Result<PlanDiff, String> {
        match self.apply() {
            Ok((text, diff)) => {
                *known = text;
                let all = diff.to_string();
                let lines = all.lines().take(all.lines().count().saturating_sub(1));
                let is_few = all.lines().count() <= FEW;
                for line in lines {
                    match is_few {
                        true => tracing::info!("{line}"),
                        false => tracing::debug!("{line}"),
                    }
                }
                tracing::info!("{} was read again: {}", self.file.display(), diff.summary());
                Ok(diff)
            }
            Err(failure) => {
                tracing::error!("the routes stay as they are: {failure}");
                Err(failure.to_string())
            }
        }
    }
}

/// A file as the system sees it: any change of it, or another in its place, is another mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Mark([i64; 4], u64, u64);

impl Mark {
    fn of(file: &Path) -> Option<Self> {
        let meta = std::fs::metadata(file).ok()?;
        let times = [meta.mtime(), meta.mtime_nsec(), meta.ctime(), meta.ctime_nsec()];
        Some(Self(times, meta.ino(), meta.len()))
    }
}

/// The thread that looks whether the configuration is to be read again. It ends when it is dropped.
pub struct Watch {
    stop: Arc<AtomicBool>,
    context: Context,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Starts to look. Has the service `~/reload` where the node is on ROS 2, and takes SIGHUP, which asks a
    /// service to read its file again, unless the program is on a terminal, whose end it tells.
    ///
    /// # Errors
    /// When the system refuses a thread or a handler.
    pub fn start(reload: Reload, registry: &Registry) -> Result<Self, Failure> {
        let (context, stop) = (Context::default(), Arc::<AtomicBool>::default());
        let hung_up = Arc::<AtomicBool>::default();
        if !std::io::stdin().is_terminal() {
            signal_hook::flag::register(SIGHUP, Arc::clone(&hung_up))
                .context("cannot catch SIGHUP")?;
        }
        let service = reload.handle.is_some().then(|| offer(&reload.node, registry, &context));
        let mut service = service.flatten();
        let known = read_file(&reload.file).unwrap_or_default();
        let (told, wake) = (Arc::clone(&stop), context.wake.clone());
        let thread = std::thread::Builder::new().name("reload".to_owned()).spawn(move || {
            let mut looked = Looked::new(&reload.file, known);
            while !told.load(Relaxed) {
                if hung_up.swap(false, Relaxed) || looked.is_other(&reload.file) {
                    // It is told in the log.
                    _ = reload.apply_and_tell(&mut looked.text);
                }
                if let Some(server) = &mut service {
                    answer(server.as_mut(), &reload, &mut looked.text);
                }
                wake.wait(LOOK_EVERY);
            }
        });
        Ok(Self { stop, context, thread: Some(thread.context("cannot watch the configuration")?) })
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        self.context.wake.ring();
        let end = Instant::now() + STOP_WITHIN;
        let Some(thread) = self.thread.take() else { return };
        while !thread.is_finished() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        if thread.is_finished() && thread.join().is_err() {
            tracing::error!("the thread that reads the configuration again panicked");
        }
    }
}

/// What was seen of the file.
struct Looked {
    /// Its text when it was read last.
    text: String,
    mark: Option<Mark>,
    /// It is another, and is read once it stays the same.
    is_fresh: bool,
    gone_since: Option<Instant>,
    is_told: bool,
}

impl Looked {
    fn new(file: &Path, text: String) -> Self {
        let mark = Mark::of(file);
        Self { text, mark, is_fresh: false, gone_since: None, is_told: false }
    }

    /// Whether the file has another text, and has had it for a while.
    fn is_other(&mut self, file: &Path) -> bool {
        let mark = Mark::of(file);
        if mark.is_none() {
            let since = *self.gone_since.get_or_insert_with(Instant::now);
            if since.elapsed() >= GONE_AFTER && !std::mem::replace(&mut self.is_told, true) {
                tracing::warn!("{} is gone: the routes stay as they are", file.display());
            }
            return false;
        }
        (self.gone_since, self.is_told) = (None, false);
        if mark != self.mark {
            (self.mark, self.is_fresh) = (mark, true);
            return false;
        }
        let is_file = || std::fs::metadata(file).is_ok_and(|meta| meta.is_file());
        // What cannot be read is told by whoever reads it.
        std::mem::take(&mut self.is_fresh)
            && (!is_file() || read_file(file).map_or(true, |text| text != self.text))
    }
}

/// Offers `~/reload`, a `std_srvs/srv/Trigger`.
fn offer(node: &Node, registry: &Registry, context: &Context) -> Option<Box<dyn Server>> {
    let mut types = TypeStore::generated();
    let offered = ServiceKind::resolve("std_srvs/srv/Trigger", &mut types)
        .map_err(|error| error.to_string())
        .and_then(|kind| {
            let ros2 = registry.get("ros2").map_err(|error| error.to_string())?;
            let name = node.resolve_service("~/reload").map_err(|error| error.to_string())?;
            ros2.open_server(&ServiceSpec::new(name, kind), context)
                .map_err(|error| error.to_string())
        });
    offered.inspect_err(|error| tracing::warn!("~/reload is not offered: {error}")).ok()
}

/// Answers those who asked by the service.
fn answer(server: &mut dyn Server, reload: &Reload, known: &mut String) {
    while let Ok(Some(asked)) = server.take() {
        let told = reload.apply_and_tell(known);
        let success = told.is_ok();
        let message = told.map_or_else(|why| why, |diff| diff.to_string());
        let fields: Map = [("success", Value::from(success)), ("message", message.into())].into();
        if let Err(error) = server.reply(asked.id, Ok(Payload::from(Value::Map(fields)))) {
            tracing::warn!("~/reload was not answered: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fixed(text: &str) -> Fixed {
        let Loaded { plan, .. } = middlewares::load_text(text, "test").unwrap();
        Fixed::of(&plan, text, "test").unwrap()
    }

    const ROUTES: &str = "routes:\n  - { from: 'zeromq:/a', to: 'ros2:/a', type: Text }\n";

    #[test]
    fn what_needs_a_start_is_named_by_its_key() {
        let with = |more: &str| fixed(&format!("{more}{ROUTES}"));
        let none: [String; 0] = [];
        let before = with("");
        assert_eq!(before.refusals(&with("endpoints: { yarp: {} }\n")), none);
        assert_eq!(
            before.refusals(&with("endpoints: { zeromq: { pub_port: 7000 } }\n")),
            ["endpoints.zeromq.pub_port was left out at the start and is 7000 now"]
        );
        assert_eq!(
            with("hosts: { robot: 10.0.0.1 }\n").refusals(&with("hosts: { robot: 10.0.0.2 }\n")),
            ["hosts.robot was 10.0.0.1 at the start and is 10.0.0.2 now"]
        );
        let more = "  - { from: 'ros:/b', to: 'ros2:/b', type: Text, max_message_mib: 100 }\n";
        let refusals = before.refusals(&fixed(&format!("{ROUTES}{more}")));
        assert_eq!(refusals.len(), 2, "{refusals:?}");
        assert!(refusals[0].contains("no route was on ros at the start"), "{refusals:?}");
        assert!(refusals[1].contains("max_message_mib"), "{refusals:?}");
    }

    /// A file that is written anew, one put in its place, one that is gone, and one that was only touched.
    #[test]
    fn a_file_is_another_once_it_has_another_text_for_a_while() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bridge.yaml");
        std::fs::write(&file, "one").unwrap();
        let mut looked = Looked::new(&file, "one".to_owned());
        assert!(!looked.is_other(&file));
        std::fs::write(&file, "two").unwrap();
        assert!(!looked.is_other(&file), "it may not be all yet");
        assert!(looked.is_other(&file));
        looked.text = "two".to_owned();
        assert!(!looked.is_other(&file));
        let beside = folder.path().join("new.yaml");
        std::fs::write(&beside, "three").unwrap();
        std::fs::remove_file(&file).unwrap();
        assert!(!looked.is_other(&file));
        std::fs::rename(&beside, &file).unwrap();
        assert!(!looked.is_other(&file));
        assert!(looked.is_other(&file));
        looked.text = "three".to_owned();
        std::fs::write(&file, "three").unwrap();
        assert!(!looked.is_other(&file));
        assert!(!looked.is_other(&file), "its text is the same");
        let endless = read_file(Path::new("/dev/zero")).unwrap();
        assert_eq!(endless.len(), MAX_CONFIG_BYTES + 1);
    }
}
