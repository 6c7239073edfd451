//! The context that communicators share: middlewares, defaults, configuration.
//!
//! ```text
//!   CommunicatorContext ─ sources by name, default middleware, plug-ins, configuration, instances counted
//!      └─ Live ─ the library's thread, middlewares that were started
//!                made with the first instance, ended with the last
//! ```

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock, Weak};

use super::builtin;
use super::config::Configuration;
use super::runtime::Runtime;
use super::wait::IsInterrupted;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{MessageTypeError, RosAction, RosType, ServiceKind};
use wrapyfi_endpoint::method::{EndpointNeeds, Source};
use wrapyfi_endpoint::{Middleware, Mutex, Planned, StartError};
#[cfg(feature = "engine")]
use wrapyfi_engine::ConfigError;
use wrapyfi_interfaces::store::TypeStore;

/// Middlewares, defaults and configuration that communicators share. Cheap to clone.
///
/// Most programs use the context of the process, [`CommunicatorContext::global`], without naming it. A
/// middleware starts when the first value needs it; all end with the last communicator.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::CommunicatorContext;
/// use wrapyfi_core::middleware::memory::Memory;
/// let context = CommunicatorContext::builder()
///     .only(Arc::new(Memory::new("memory")))
///     .default_middleware("memory")
///     .build();
/// assert_eq!(context.middlewares(), ["memory"]);
/// ```
#[derive(Clone)]
pub struct CommunicatorContext(Arc<ContextState>);

struct ContextState {
    sources: BTreeMap<String, Arc<dyn Source>>,
    default_middleware: String,
    plugins: Plugins,
    /// Definitions of ROS types.
    types: Mutex<TypeStore>,
    configuration: Mutex<Configuration>,
    /// Number of instances made so far, by class.
    instances: Mutex<BTreeMap<&'static str, usize>>,
    is_interrupted: Option<IsInterrupted>,
    live: Mutex<Weak<Live>>,
}

/// Thread and middlewares that run as long as there are instances.
pub(super) struct Live {
    // Dropped first, because its jobs use the middlewares.
    runtime: Runtime,
    started: Mutex<BTreeMap<(String, String), Arc<dyn Middleware>>>,
}

impl std::fmt::Debug for Live {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Live").finish_non_exhaustive()
    }
}

/// Result of looking a middleware up by its name.
pub(super) enum Found {
    /// The middleware is built in.
    Source(Arc<dyn Source>),
    /// The middleware exists, but is not built in.
    Absent,
    /// No middleware has this name.
    Unknown,
}

impl CommunicatorContext {
    /// The context of the process: every middleware of this crate, defaults from `WRAPYFI_*`.
    pub fn global() -> Self {
        static GLOBAL: OnceLock<CommunicatorContext> = OnceLock::new();
        GLOBAL.get_or_init(|| Self::builder().build()).clone()
    }

    /// Begins a context of its own.
    pub fn builder() -> ContextBuilder {
        ContextBuilder {
            sources: builtin::sources(),
            default_middleware: None,
            plugins: wrapyfi_plugins::standard(),
            types: None,
            configuration: Configuration::default(),
            is_interrupted: None,
        }
    }

    /// Reads modes from a file, or from every `.yml` and `.yaml` file of a folder, as Wrapyfi's
    /// `ConfigManager` does. They hold for instances made from now on; of two entries for one
    /// method the later one counts.
    ///
    /// # Errors
    /// When a file cannot be read, or an entry is wrong; no entry is used then.
    #[cfg(feature = "engine")]
    pub fn load_config(&self, path: impl AsRef<std::path::Path>) -> Result<(), ConfigError> {
        let configuration = Configuration::load(path.as_ref())?;
        self.configure(configuration);
        Ok(())
    }

    /// Adds modes for instances made from now on, which replace those of the same method.
    pub fn configure(&self, configuration: Configuration) {
        self.0.configuration.lock().extend(configuration);
    }

    /// Names of the middlewares that are here.
    pub fn middlewares(&self) -> Vec<String> {
        self.0.sources.keys().cloned().collect()
    }

    /// Name of the middleware of values that name none.
    pub fn default_middleware(&self) -> &str {
        &self.0.default_middleware
    }

    pub(super) fn plugins(&self) -> &Plugins {
        &self.0.plugins
    }

    /// Looks up a ROS type by its name.
    pub(super) fn ros_type(&self, name: &str) -> Result<RosType, MessageTypeError> {
        let resolved = self.0.types.lock().resolve_name(name).map_err(Box::new)?;
        Ok(RosType::new(&resolved)?)
    }

    /// Looks up the type of an action by its name.
    pub(super) fn ros_action(&self, name: &str) -> Result<RosAction, MessageTypeError> {
        RosAction::resolve(name, &mut self.0.types.lock())
    }

    /// Looks up the type of a service by its name.
    pub(super) fn service_kind(&self, name: &str) -> Result<ServiceKind, MessageTypeError> {
        ServiceKind::resolve(name, &mut self.0.types.lock())
    }

    pub(super) fn find(&self, name: &str) -> Found {
        match self.0.sources.get(name) {
            Some(source) => Found::Source(Arc::clone(source)),
            // A method that names a middleware that exists, but is not built in, is not refused.
            None if builtin::KNOWN.contains(&name) => Found::Absent,
            None => Found::Unknown,
        }
    }

    pub(super) fn is_interrupted(&self) -> Option<IsInterrupted> {
        self.0.is_interrupted
    }

    pub(super) fn configuration(&self) -> Configuration {
        self.0.configuration.lock().clone()
    }

    /// Counts a new instance of `class` and returns its number, from 0.
    pub(super) fn number(&self, class: &'static str) -> usize {
        let mut instances = self.0.instances.lock();
        let count = instances.entry(class).or_default();
        *count += 1;
        *count - 1
    }

    pub(super) fn live(&self) -> Arc<Live> {
        let mut live = self.0.live.lock();
        live.upgrade().unwrap_or_else(|| {
            let made = Arc::new(Live { runtime: Runtime::start(), started: Mutex::default() });
            *live = Arc::downgrade(&made);
            made
        })
    }
}

impl Live {
    pub(super) fn runtime(&self) -> &Runtime {
        &self.runtime
    }

    /// Instance of a middleware that these options ask for; started now if it does not run yet.
    pub(super) fn middleware(
        &self,
        source: &dyn Source,
        wanted: &EndpointNeeds<'_>,
    ) -> Result<Arc<dyn Middleware>, StartError> {
        let planned = source.plan(wanted)?;
        let key = (source.name().to_owned(), planned.key);
        if let Some(running) = self.started.lock().get(&key) {
            return Ok(Arc::clone(running));
        }
        // Started without the lock, because it may take seconds. Only the library's thread starts
        // middlewares, so that none is started twice.
        let started = (planned.start)()?;
        self.started.lock().insert(key, Arc::clone(&started));
        Ok(started)
    }
}

impl Default for CommunicatorContext {
    fn default() -> Self {
        Self::global()
    }
}

impl std::fmt::Debug for CommunicatorContext {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CommunicatorContext")
            .field("middlewares", &self.middlewares())
            .field("default_middleware", &self.0.default_middleware)
            .finish_non_exhaustive()
    }
}

/// A middleware that runs already, whatever the options say.
struct Running(Arc<dyn Middleware>);

impl Source for Running {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn plan(&self, _wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
        let middleware = Arc::clone(&self.0);
        Ok(Planned { key: String::new(), start: Arc::new(move || Ok(Arc::clone(&middleware))) })
    }
}

/// Builder of a [`CommunicatorContext`].
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_core::communicator::CommunicatorContext;
/// use wrapyfi_core::middleware::memory::Memory;
/// let context = CommunicatorContext::builder().middleware(Arc::new(Memory::new("bus"))).build();
/// assert!(context.middlewares().contains(&"bus".to_owned()));
/// ```
pub struct ContextBuilder {
    sources: Vec<Arc<dyn Source>>,
    default_middleware: Option<String>,
    plugins: Plugins,
    types: Option<TypeStore>,
    configuration: Configuration,
    is_interrupted: Option<IsInterrupted>,
}

impl ContextBuilder {
    /// Adds a middleware that runs already, in place of one of its name.
    #[must_use]
    pub fn middleware(self, middleware: Arc<dyn Middleware>) -> Self {
        self.source(Arc::new(Running(middleware)))
    }

    /// Adds a middleware that is started when it is needed, in place of one of its name.
    #[must_use]
    #[doc(hidden)]
    pub fn source(mut self, source: Arc<dyn Source>) -> Self {
        self.sources.push(source);
        self
    }

    /// Names the nodes on ROS 2 and remaps their topics and services by a command line with
    /// `--ros-args`: `__node`, `__ns`, rules for names. Its parameters and log levels are for the
    /// program, which reads them from [`RosArgs`](crate::node::RosArgs).
    ///
    /// ```
    /// use wrapyfi_core::communicator::CommunicatorContext;
    /// use wrapyfi_core::node::{RosArgs, read_params_file};
    /// let args = RosArgs::parse(std::env::args().skip(1), read_params_file)?;
    /// let context = CommunicatorContext::builder().ros_args(args).build();
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[cfg(feature = "ros2")]
    #[must_use]
    pub fn ros_args(self, args: wrapyfi_node::args::RosArgs) -> Self {
        self.source(wrapyfi_ros2::source(args))
    }

    /// Adds this middleware in place of those built in; others may be added after it.
    #[must_use]
    pub fn only(mut self, middleware: Arc<dyn Middleware>) -> Self {
        self.sources.clear();
        self.middleware(middleware)
    }

    /// Sets the middleware of values that name none; without this call it is that of
    /// `WRAPYFI_DEFAULT_MWARE` or `WRAPYFI_DEFAULT_COMMUNICATOR`, else `zeromq`.
    #[must_use]
    pub fn default_middleware(mut self, name: impl Into<String>) -> Self {
        self.default_middleware = Some(name.into());
        self
    }

    /// Sets the plug-ins that read and write objects inside native objects.
    #[must_use]
    pub fn plugins(mut self, plugins: Plugins) -> Self {
        self.plugins = plugins;
        self
    }

    /// Sets the definitions of ROS types; without this call those of installed packages
    /// (`AMENT_PREFIX_PATH`) are used, then those that are built in.
    #[must_use]
    pub fn types(mut self, types: TypeStore) -> Self {
        self.types = Some(types);
        self
    }

    /// Sets the modes by class and method.
    #[must_use]
    pub fn configuration(mut self, configuration: Configuration) -> Self {
        self.configuration = configuration;
        self
    }

    /// Sets what a waiting thread asks, twenty times a second, whether its wait is over: it then ends with
    /// [`MethodError::Cancelled`](super::MethodError::Cancelled).
    #[must_use]
    #[doc(hidden)]
    pub fn interrupted_by(mut self, is_interrupted: IsInterrupted) -> Self {
        self.is_interrupted = Some(is_interrupted);
        self
    }

    /// Makes the context.
    #[must_use]
    pub fn build(self) -> CommunicatorContext {
        let from_environment = || {
            ["WRAPYFI_DEFAULT_MWARE", "WRAPYFI_DEFAULT_COMMUNICATOR"]
                .into_iter()
                .find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
        };
        let default_middleware = self.default_middleware.or_else(from_environment);
        let sources = self.sources.into_iter().map(|source| (source.name().to_owned(), source));
        CommunicatorContext(Arc::new(ContextState {
            sources: sources.collect(),
            default_middleware: default_middleware.unwrap_or_else(|| builtin::DEFAULT.to_owned()),
            plugins: self.plugins,
            types: Mutex::new(
                self.types.unwrap_or_else(|| TypeStore::from_environment().or_generated()),
            ),
            configuration: Mutex::new(self.configuration),
            instances: Mutex::default(),
            is_interrupted: self.is_interrupted,
            live: Mutex::default(),
        }))
    }
}

impl std::fmt::Debug for ContextBuilder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<_> = self.sources.iter().map(|source| source.name()).collect();
        f.debug_struct("ContextBuilder").field("sources", &names).finish_non_exhaustive()
    }
}
