//! A middleware that could not start yet: its start is tried again, and its endpoints wait.
//!
//! ```text
//!   start ── no ──▶ DeferredMiddleware ── a thread tries again, with back-off ──▶ the middleware
//!                    └ open: OpenError::NotStarted ─▶ the route waits and says why
//! ```

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, OnceLock};

use super::{
    ActionClient, ActionServer, ActionSpec, Cause, Client, Context, DiscoverError, Discovery,
    Listener, Middleware, OpenError, OpenResult, Opened, Publisher, Server, ServiceSpec,
    StartError, TopicSpec, Wake,
};
use crate::Mutex;
use crate::backoff::Backoff;
use wrapyfi_retry::contained;

/// Stand-in for a middleware until that can be started.
///
/// ```
/// use std::sync::Arc;
/// use wrapyfi_endpoint::{DeferredMiddleware, Middleware, StartError, memory::Memory};
/// # let is_there = |_: &str| false;
/// let fault = || StartError::Absent("no program answers at 192.168.1.7".into());
/// let late = DeferredMiddleware::new("memory", fault(), move || match is_there("192.168.1.7") {
///     true => Ok(Arc::new(Memory::new("memory")) as _),
///     false => Err(fault()),
/// })?;
/// let error = late.discover().err().unwrap();
/// assert_eq!(error.to_string(), "memory to start: no program answers at 192.168.1.7");
/// # Ok::<(), std::io::Error>(())
/// ```
pub struct DeferredMiddleware {
    name: &'static str,
    shared: Arc<DeferredState>,
}

struct DeferredState {
    started: OnceLock<Arc<dyn Middleware>>,
    fault: Mutex<StartError>,
    over: AtomicBool,
    bell: Wake,
}

impl DeferredState {
    fn fault(&self) -> StartError {
        self.fault.lock().clone()
    }
}

impl DeferredMiddleware {
    /// A middleware called `name` that did not start because of `fault`; `start` is called again until it succeeds or
    /// its error is hopeless, on a thread of its own.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn new(
        name: &'static str,
        fault: StartError,
        start: impl FnMut() -> Result<Arc<dyn Middleware>, StartError> + Send + 'static,
    ) -> std::io::Result<Self> {
        tracing::warn!("{name} does not start yet, its routes wait: {fault}");
        let shared = Arc::new(DeferredState {
            started: OnceLock::new(),
            fault: Mutex::new(fault),
            over: AtomicBool::new(false),
            bell: Wake::new(),
        });
        let with = Arc::clone(&shared);
        // The thread is not joined, because a start may be in the middle of asking for an address.
        std::thread::Builder::new()
            .name(format!("start-{name}"))
            .spawn(move || keep_trying(name, &with, start))?;
        Ok(Self { name, shared })
    }

    fn started(&self) -> Result<&dyn Middleware, StartError> {
        self.shared.started.get().map(AsRef::as_ref).ok_or_else(|| self.shared.fault())
    }

    fn open<T>(&self, open: impl FnOnce(&dyn Middleware) -> OpenResult<T>) -> OpenResult<T> {
        let middleware = self.name;
        match self.started() {
            Ok(started) => open(started),
            Err(fault) if fault.is_hopeless() => {
                Err(OpenError::Refused { middleware, reason: fault.to_string() })
            }
            Err(fault) => Err(OpenError::NotStarted { middleware, fault }),
        }
    }
}

fn keep_trying(
    name: &str,
    shared: &DeferredState,
    mut start: impl FnMut() -> Result<Arc<dyn Middleware>, StartError>,
) {
    let mut backoff = Backoff::of_process(1);
    while !shared.over.load(Relaxed) {
        shared.bell.wait(backoff.wait());
        if shared.over.load(Relaxed) {
            return;
        }
        let panicked = |panic| Err(StartError::Failed(format!("its start panicked: {panic}")));
        let fault = match contained(&mut start).unwrap_or_else(panicked) {
            Ok(middleware) => {
                tracing::info!("{name} has started");
                // Only this thread sets it, so that it is not set yet.
                _ = shared.started.set(middleware);
                return;
            }
            Err(fault) => fault,
        };
        let is_hopeless = fault.is_hopeless();
        let mut known = shared.fault.lock();
        if *known != fault {
            tracing::warn!("{name} does not start: {fault}");
            *known = fault;
        }
        if is_hopeless {
            return;
        }
    }
}

impl Drop for DeferredMiddleware {
    fn drop(&mut self) {
        self.shared.over.store(true, Relaxed);
        self.shared.bell.ring();
    }
}

impl Middleware for DeferredMiddleware {
    fn name(&self) -> &str {
        self.name
    }

    fn inner(&self) -> Option<&dyn Middleware> {
        self.started().ok()
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.open(|started| started.open_listener(spec, context))
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.open(|started| started.open_publisher(spec, context))
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        self.open(|started| started.open_client(spec, context))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        self.open(|started| started.open_server(spec, context))
    }

    fn open_action_client(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionClient> {
        self.open(|started| started.open_action_client(spec, context))
    }

    fn open_action_server(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionServer> {
        self.open(|started| started.open_action_server(spec, context))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        self.started().map_err(|fault| not_listed(self.name, fault))?.discover()
    }

    fn discover_closely(&self, topic: Option<&str>) -> Result<Box<dyn Discovery>, DiscoverError> {
        self.started().map_err(|fault| not_listed(self.name, fault))?.discover_closely(topic)
    }

    fn waiting_for(&self) -> Option<Cause> {
        match self.started() {
            Ok(started) => started.waiting_for(),
            Err(fault) => Some(OpenError::NotStarted { middleware: self.name, fault }.into()),
        }
    }
}

fn not_listed(middleware: &str, fault: StartError) -> DiscoverError {
    let middleware = middleware.to_owned();
    match fault.is_hopeless() {
        true => DiscoverError::Refused { middleware, reason: fault.to_string() },
        false => DiscoverError::NotStarted { middleware, fault },
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use wrapyfi_data::types::MessageType;

    use super::*;
    use crate::memory::Memory;

    fn absent(what: &str) -> StartError {
        StartError::Absent(what.to_owned())
    }

    fn opened(late: &DeferredMiddleware) -> OpenResult<()> {
        let spec = TopicSpec::new("/t", MessageType::NativeObject);
        late.open_listener(&spec, &Context::default()).map(drop)
    }

    #[test]
    fn what_needs_it_waits_and_is_told_why_until_it_is_there() {
        let (let_go, held) = std::sync::mpsc::channel::<()>();
        let late = DeferredMiddleware::new("memory", absent("nobody is there"), move || {
            held.recv().map_err(|_closed| absent("closed"))?;
            Ok(Arc::new(Memory::new("memory")))
        });
        let late = late.unwrap();
        let error = opened(&late).unwrap_err();
        assert!(error.is_transient());
        assert_eq!(error.to_string(), "memory to start: nobody is there");
        assert_eq!(late.waiting_for(), Some(error.into()));
        let error = late.discover().map(drop).unwrap_err();
        assert_eq!(error.to_string(), "memory to start: nobody is there");
        let_go.send(()).unwrap();
        while opened(&late).is_err() {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(late.waiting_for(), None);
    }

    /// A default that does not ask the inner middleware would hide what a wrapper leaves out.
    #[test]
    fn each_default_of_a_middleware_asks_the_one_inside() {
        let source = include_str!("lib.rs");
        let (_, methods) = source.split_once("pub trait Middleware").unwrap();
        let (methods, _) = methods.split_once("\n}\n").unwrap();
        for method in methods.split("\n    fn ").skip(1) {
            let (head, body) = method.split_once(" {\n").unwrap_or((method, ""));
            let name = head.split('(').next().unwrap();
            let is_own = head.contains(';') || name == "inner";
            assert!(is_own || body.contains("self.inner()"), "{name}");
        }
    }

    #[test]
    fn a_start_that_panics_is_told_and_tried_again() {
        let (let_go, held) = std::sync::mpsc::channel::<()>();
        let mut starts = 0;
        let late = DeferredMiddleware::new("memory", absent("nobody is there"), move || {
            starts += 1;
            assert!(starts > 1, "on purpose");
            held.recv().map_err(|_closed| absent("closed"))?;
            Ok(Arc::new(Memory::new("memory")))
        });
        let late = late.unwrap();
        let fault = StartError::Failed("its start panicked: on purpose".to_owned());
        let told = Cause::from(OpenError::NotStarted { middleware: "memory", fault });
        while late.waiting_for().as_ref() != Some(&told) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let_go.send(()).unwrap();
        while opened(&late).is_err() {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn what_can_never_work_is_not_tried_again() {
        let (told, tries) = std::sync::mpsc::channel::<()>();
        let late = DeferredMiddleware::new("memory", absent("nobody is there"), move || {
            told.send(()).unwrap();
            Err(StartError::refused("not allowed"))
        });
        let late = late.unwrap();
        tries.recv().unwrap();
        // The thread ends, and its end of the channel with it.
        tries.recv().unwrap_err();
        let error = opened(&late).unwrap_err();
        assert!(!error.is_transient() && error.to_string().contains("not allowed"), "{error}");
    }
}
