//! A configuration that changes while its bridge runs.
//!
//! ```text
//!   the file is another ─┐
//!   SIGHUP ──────────────┼─▶ read, check, compare ─▶ Applier::apply ─▶ what is the same goes on
//!   ~/reload ────────────┤     └ anything wrong: the routes stay as they are, and the reason is told
//!   ~/add_route ─────────┤
//!   ~/remove_route ──────┤
//!   ~/change_state ──────┘ configure reads it, activate starts the routes, deactivate and cleanup take them away
//! ```
//!
//! The same thread starts middlewares anew that another program has ended: `ends`.

mod ends;
mod watched_file;

use std::collections::BTreeMap;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use signal_hook::consts::SIGHUP;
use signal_hook::iterator::{Handle, Signals};
use wrapyfi_data::types::{Map, Payload, Value};
use wrapyfi_endpoint::{Context, WAITING};
use wrapyfi_engine::{Plan, PlanDiff, RouteConfig, Spanned};
use wrapyfi_interfaces::std_srvs::srv::Trigger;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_interfaces::wrapyfi_msgs::srv::{AddRoute, RemoveRoute};
use wrapyfi_node::parameters::ParameterStore;
use wrapyfi_retry::contained;
use wrapyfi_retry::thread::restarted;
use wrapyfi_ros2::NodeHandle;

use self::watched_file::WatchedFile;
use crate::edits::Edits;
use crate::exit::{Failure, Result};
use crate::in_force::{
    InForce, Options, Running, change_by, change_endpoints, ros2_types, warn_of_unheard,
};
use crate::lifecycle::{Lifecycle, Outcome, State};
use crate::middlewares::{
    self, Endpoints, Loaded, Middlewares, Settings, describe, show_endpoints,
};
use crate::on_graph::lifecycle::Managed;
use crate::on_graph::{Advertise, Offered};
use crate::shutdown::Shutdown;

/// Time between two looks at the file. It is read once it has been the same for so long.
const LOOK_EVERY: Duration = Duration::from_millis(250);
/// Longest time that the end of the program waits for a file that is being read.
const STOP_WITHIN: Duration = Duration::from_millis(500);
/// Longest time that a change of state waits for routes to close: a reliable writer of DDS waits a second for a reader
/// that was killed.
const CLOSE_WITHIN: Duration = Duration::from_secs(2);
/// Time that the reply to the transition which finalizes the node has to reach its client.
const REPLY_WITHIN: Duration = Duration::from_millis(500);
/// Warning of a file with another `page.port` than that of the start.
const OTHER_PAGE_PORT: &str = "page.port is another: start the program anew for that";
/// Most changes that get a line each in the log.
const FEW: usize = 10;

/// Source of a configuration.
#[derive(Debug, Clone)]
pub enum Source {
    /// File, which is read again.
    File(PathBuf),
    /// Text that the program has, and a name for it.
    Text(String, String),
}

impl Source {
    /// File, or the name of the text.
    pub fn name(&self) -> String {
        match self {
            Self::File(file) => file.display().to_string(),
            Self::Text(_, name) => name.clone(),
        }
    }

    /// Reads the configuration. To a file's come the `added` routes, and its settings are changed by `change`
    /// before publishers are asked for types.
    ///
    /// # Errors
    /// Exit code 2 for a configuration that is refused.
    pub fn load(
        &self,
        added: &[Spanned<RouteConfig>],
        change: impl FnOnce(&mut Endpoints) -> Result<()>,
    ) -> Result<Loaded> {
        match self {
            Self::File(file) => middlewares::load_and_learn(file, added, change),
            Self::Text(text, name) => middlewares::load_text(text, name),
        }
    }

    fn file(&self) -> Option<&Path> {
        match self {
            Self::File(file) => Some(file),
            Self::Text(..) => None,
        }
    }
}

/// Turns a bridge to the configuration that its file has now.
pub struct Reload {
    /// Source of the configuration.
    pub source: Source,
    /// Middlewares that the routes run on.
    pub middlewares: Middlewares,
    /// Arguments of the bridge.
    pub options: Options,
    /// The bridge.
    pub bridge: Running,
    /// Handle of the node on the graph; `None` where it is on none.
    pub handle: Option<NodeHandle>,
    /// Text of the configuration when it was read last.
    pub known: String,
    /// Changes to the routes of the file.
    pub edits: Edits,
    /// Port of the live page since the start.
    pub page_port: Option<u16>,
    /// Another port that the file has for it now.
    pub other_page_port: Option<u16>,
    /// State of the node.
    pub lifecycle: Lifecycle,
    /// Asked to end the program once the node is finalized.
    pub shutdown: Shutdown,
}

impl Reload {
    /// Reads the file and applies it with `edits`, of which one may leave out a `wanted` route.
    /// Everything that may be refused is tried before anything changes.
    fn apply(&mut self, mut edits: Edits, wanted: Option<&str>) -> Result<PlanDiff> {
        let name = self.source.name();
        // The node has its parameters once nothing can be refused any more.
        let Running { node, routes, in_force } = &self.bridge;
        let mut parameters = node.parameters().map_err(Failure::usage)?;
        if let Some(file) = self.source.file() {
            let meta = std::fs::metadata(file);
            let meta = meta.map_err(|error| Failure::usage(format!("{name}: {error}")))?;
            if !meta.is_file() {
                let text = format!("{name} is no file: only a file is read again");
                return Err(Failure::Usage(text));
            }
        }
        let mut loaded = self.source.load(edits.added(), |endpoints| {
            change_endpoints(endpoints, node, &mut parameters, &self.options)
        })?;
        edits.leave_out(wanted, &mut loaded)?;
        change_by(&mut loaded, node, &mut parameters, &self.options)?;
        let Loaded { plan, endpoints, mut types, definitions, lines, text, .. } = loaded;
        let before = &self.middlewares.settings;
        let settings = Settings::of(&endpoints, &plan, before)?;
        let refusals = before.refusals(&settings);
        if !refusals.is_empty() {
            let text = refusals.join("; ");
            return Err(Failure::Usage(format!("{name}: {text}: start the program anew for that")));
        }
        let changes = before.changes(&settings);
        let next = self.middlewares.turned_to(settings)?;
        let registry = next.registry_on(self.handle.as_ref());
        warn_of_unheard(&plan.index(|address| node.resolve(address)), &lines);
        if let Some(handle) = &self.handle {
            describe(handle, &mut types, &ros2_types(&plan));
        }
        let diff = routes.apply(plan, types, registry).map_err(Failure::usage)?;
        for change in changes {
            tracing::info!("{change}");
        }
        self.middlewares.replace_by(next);
        let removed = edits.removed();
        self.edits = edits;
        WAITING.set_limit(loaded.waiting_bytes);
        self.other_page_port = loaded.page_port.filter(|port| Some(*port) != self.page_port);
        if self.other_page_port.is_some() {
            tracing::warn!("{name}: {OTHER_PAGE_PORT}");
        }
        let told = endpoints.clone();
        let mut in_force = in_force.lock();
        *in_force = InForce { file: name, endpoints: told, definitions, removed, ..*in_force };
        drop(in_force);
        if let Some(handle) = &self.handle {
            handle.parameters(|store| {
                declare_new(&parameters, store);
                show_endpoints(&endpoints, store);
            });
        }
        self.known = text;
        Ok(diff)
    }

    /// As [`Reload::apply`] for the file as it is now, and logs the outcome.
    fn apply_and_tell(&mut self) -> Result<PlanDiff> {
        logged(&self.source.name(), false, || self.apply(self.edits.clone(), None))
    }

    /// True once the node has read its configuration.
    fn is_configured(&self) -> bool {
        matches!(self.lifecycle.state(), State::Inactive | State::Active)
    }

    /// Work of a state of the life cycle that is not primary.
    fn work(&mut self, state: State) -> Outcome {
        let done = contained(|| match state {
            State::Configuring => self.apply_and_tell().map(drop),
            State::Activating => {
                self.bridge.routes.set_active(true);
                Ok(())
            }
            State::CleaningUp | State::ErrorProcessing => self.put_away(),
            _ => {
                self.close();
                Ok(())
            }
        });
        let done = done.unwrap_or_else(|panic| Err(panicked(state.label(), &panic)));
        match done {
            Ok(()) => Outcome::Success,
            Err(failure) => {
                tracing::error!("{} failed: {failure}", state.label());
                // A configuration that is refused can be mended; what else happened is put away.
                match failure {
                    Failure::Failed(_) => Outcome::Error,
                    _ => Outcome::Failure,
                }
            }
        }
    }

    /// Closes the routes. Plan and middlewares stay.
    fn close(&self) {
        self.bridge.routes.set_active(false);
        if !self.bridge.routes.wait_closed(CLOSE_WITHIN) {
            tracing::warn!("a route has not closed within {} s", CLOSE_WITHIN.as_secs());
        }
    }

    /// Closes the routes, and forgets them with what they were told to change. Middlewares other than ROS 2 end.
    fn put_away(&mut self) -> Result<()> {
        self.close();
        let endpoints = self.bridge.in_force.lock().endpoints.clone();
        let plan = Plan::default();
        let settings = Settings::of(&endpoints, &plan, &self.middlewares.settings)?;
        let next = self.middlewares.turned_to(settings)?;
        let registry = next.registry_on(self.handle.as_ref());
        self.bridge.routes.apply(plan, TypeStore::generated(), registry).map_err(Failure::usage)?;
        self.middlewares.replace_by(next);
        self.edits = Edits::default();
        Ok(())
    }

    /// Does what a service asks for, and logs the outcome.
    fn serve(&mut self, service: Asked, text: &str) -> Result<PlanDiff> {
        if !self.is_configured() {
            let (state, node) = (self.lifecycle.state().label(), self.bridge.node.name().fqn());
            return Err(Failure::Usage(format!(
                "the bridge is {state} and has no routes: ros2 lifecycle set {node} configure"
            )));
        }
        let (file, mut edits) = (self.source.name(), self.edits.clone());
        match service {
            Asked::Reload => self.apply_and_tell(),
            Asked::AddRoute => logged(&file, true, || {
                edits.add(text)?;
                self.apply(edits, None)
            }),
            Asked::RemoveRoute => logged(&file, true, || {
                edits.remove(text);
                self.apply(edits, Some(text))
            }),
        }
    }
}

/// Declares the parameters of `from` that `store` has not.
fn declare_new(from: &ParameterStore, store: &mut ParameterStore) {
    let new: Vec<&str> = from.names().filter(|name| store.describe(name).is_none()).collect();
    for name in new {
        let (Some(descriptor), Ok(value)) = (from.describe(name), from.get(name)) else { continue };
        if let Err(error) = store.declare(descriptor.clone(), value.clone()) {
            tracing::warn!("parameter {name} is not declared: {error}");
        }
    }
}

/// Failure of something that panicked.
fn panicked(what: &str, panic: &str) -> Failure {
    Failure::Failed(anyhow::Error::msg(format!("{what} panicked: {panic}")))
}

/// Applies the configuration of `file`, and logs what came of it. A panic is an error like others; a mistake of a
/// caller, who is answered, is none.
fn logged(
    file: &str,
    has_caller: bool,
    apply: impl FnOnce() -> Result<PlanDiff>,
) -> Result<PlanDiff> {
    let begin = Instant::now();
    let applied = contained(apply)
        .unwrap_or_else(|panic| Err(panicked(&format!("what reads {file}"), &panic)));
    match applied {
        Ok(diff) => {
            let all = diff.to_string();
            let lines = all.lines().take(all.lines().count().saturating_sub(1));
            let is_few = all.lines().count() <= FEW;
            for line in lines {
                match is_few {
                    true => tracing::info!("{line}"),
                    false => tracing::debug!("{line}"),
                }
            }
            let ms = begin.elapsed().as_millis();
            tracing::info!("{file} was read again: {}, in {ms} ms", diff.summary());
            Ok(diff)
        }
        Err(failure) => {
            match &failure {
                Failure::Usage(_) if has_caller => {
                    tracing::warn!("a caller's change was refused: {failure}");
                }
                _ => tracing::error!("the routes stay as they are: {failure}"),
            }
            Err(failure)
        }
    }
}

/// The thread that looks whether the configuration is to be read again. It ends when it is dropped.
pub struct Watch {
    stop: Arc<AtomicBool>,
    context: Context,
    /// Closed by the thread at its end.
    ended: Receiver<()>,
    /// Ends the thread of the signal, where it is caught.
    hang_up: Option<Handle>,
}

impl Watch {
    /// Starts to look. Has the service `~/reload` where the node is on ROS 2, and takes SIGHUP, which asks a
    /// service to read its file again, unless the program is on a terminal, whose end it tells.
    ///
    /// # Errors
    /// When the system refuses a thread or a handler.
    pub fn start(reload: Reload) -> Result<Self> {
        let (context, stop) = (Context::default(), Arc::<AtomicBool>::default());
        let hung_up = Arc::<AtomicBool>::default();
        let mut hang_up = None;
        let file = reload.source.file().map(Path::to_owned);
        if file.is_some() && !std::io::stdin().is_terminal() {
            let mut signals = Signals::new([SIGHUP]).context("cannot catch SIGHUP")?;
            hang_up = Some(signals.handle());
            let (flag, wake) = (Arc::clone(&hung_up), context.wake.clone());
            let thread = std::thread::Builder::new().name("hang-up".to_owned());
            let thread = thread.spawn(move || {
                for _signal in signals.forever() {
                    flag.store(true, Relaxed);
                    wake.ring();
                }
            });
            thread.context("cannot catch SIGHUP")?;
        }
        let is_on_ros2 = reload.handle.is_some();
        let (lifecycle, registry) = (reload.lifecycle.clone(), reload.middlewares.registry());
        let (node, number) = (&reload.bridge.node, reload.bridge.routes.number());
        let own = Advertise { node, number, registry, context: &context };
        let mut services = Vec::new();
        if is_on_ros2 && file.is_some() {
            services = vec![
                (Asked::Reload, own.offer::<Trigger>("reload")),
                (Asked::AddRoute, own.offer::<AddRoute>("add_route")),
                (Asked::RemoveRoute, own.offer::<RemoveRoute>("remove_route")),
            ];
        }
        let mut managed = Managed::new(lifecycle.clone());
        if is_on_ros2 {
            managed.open(&own);
        }
        if !reload.options.no_autostart {
            // The program has done it before.
            for transition in ["configure", "activate"] {
                let transition = lifecycle.asked(0, transition);
                transition.map(|transition| managed.go(transition, |_| Outcome::Success));
            }
        }
        let mut looked = WatchedFile::new(file.as_deref());
        let (told, wake) = (Arc::clone(&stop), context.wake.clone());
        let (alive, ended) = channel::<()>();
        let thread = std::thread::Builder::new().name("reload".to_owned());
        let started = thread.spawn(move || {
            // Dropped last: a middleware that is left while the program ends takes the process along.
            let _alive = alive;
            let (mut reload, mut services, mut managed) = (reload, services, managed);
            let (mut ends, mut finalized_at) = (BTreeMap::new(), None);
            let pause = |time: Duration| {
                std::thread::sleep(time.min(STOP_WITHIN / 2));
                !told.load(Relaxed)
            };
            restarted("thread reload", pause, || {
                while !told.load(Relaxed) {
                    let is_other =
                        file.as_deref().is_some_and(|file| looked.is_other(file, &reload.known));
                    if (hung_up.swap(false, Relaxed) || is_other) && reload.is_configured() {
                        // It is told in the log.
                        _ = reload.apply_and_tell();
                    }
                    reload.start_ended_anew(&mut ends);
                    for (service, offered) in &mut services {
                        if let Some(offered) = offered {
                            answer(*service, offered, &mut reload);
                        }
                    }
                    managed.answer(|state| reload.work(state));
                    if lifecycle.state() == State::Finalized {
                        // Later: the end of the program takes a reply along that is not on its way yet.
                        let since = *finalized_at.get_or_insert_with(Instant::now);
                        if since.elapsed() >= REPLY_WITHIN {
                            reload.shutdown.request();
                        }
                    }
                    wake.wait(LOOK_EVERY);
                }
            });
        });
        started.context("cannot watch the configuration")?;
        Ok(Self { stop, context, ended, hang_up })
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        if let Some(hang_up) = &self.hang_up {
            hang_up.close();
        }
        self.stop.store(true, Relaxed);
        self.context.wake.ring();
        // It sends nothing, and is gone or left in the middle of a file.
        _ = self.ended.recv_timeout(STOP_WITHIN);
    }
}

/// Service that changes the routes.
#[derive(Debug, Clone, Copy)]
enum Asked {
    Reload,
    AddRoute,
    RemoveRoute,
}

/// Answers those who asked by a service.
fn answer(service: Asked, offered: &mut Offered, reload: &mut Reload) {
    let field = match service {
        Asked::Reload => "",
        Asked::AddRoute => "route",
        Asked::RemoveRoute => "name",
    };
    while let Some(asked) = offered.next() {
        let call = asked.request.into_call().unwrap_or_default();
        let text = call.kwargs.get(field).and_then(Value::as_str).unwrap_or_default();
        let told = reload.serve(service, text);
        let success = told.is_ok();
        let mut message = told.map_or_else(|why| why.to_string(), |diff| diff.to_string());
        if success && reload.other_page_port.is_some() {
            message = format!("{message}\n{OTHER_PAGE_PORT}");
        }
        let fields: Map = [("success", Value::from(success)), ("message", message.into())].into();
        offered.answer(asked.id, Payload::from(Value::Map(fields)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_node::NodeName;
    use wrapyfi_node::parameters::ParameterDescriptor;

    #[test]
    fn a_node_gets_the_parameters_that_it_has_not() {
        let name = NodeName::new("bridge", "/").unwrap();
        let store = || ParameterStore::new(&name, [("given".to_owned(), 7.into())].into()).unwrap();
        let (mut of_file, mut of_node) = (store(), store());
        let own = of_node.names().count();
        of_file.declare(ParameterDescriptor::new("given").read_only(), 1).unwrap();
        declare_new(&of_file, &mut of_node);
        declare_new(&of_file, &mut of_node);
        assert_eq!(of_node.names().count(), own + 1);
        assert_eq!(of_node.get("given").unwrap().to_string(), "7");
        assert!(of_node.set("given", 8).is_err(), "it is fixed there, too");
    }

    #[test]
    fn a_panic_while_the_file_is_read_is_an_error_that_says_so() {
        let error = logged("bridge.yaml", true, || panic!("on purpose")).unwrap_err();
        assert_eq!(error.to_string(), "what reads bridge.yaml panicked: on purpose");
        assert_eq!(error.code(), 1, "an error of the node, and none of its configuration");
    }
}
