//! A bus in memory whose ends fail as told, and plans for tests of the engine.

// Each test program uses a part.
#![allow(dead_code, unreachable_pub, clippy::expect_used, clippy::panic)]

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use wrapyfi_core::endpoint::{
    Context, DiscoverError, Discovered, Discovery, LearnError, Learned, Link, Listener, Middleware,
    OpenError, PublishError, Publisher, Registry, Sample, TakeError, TopicSpec,
};
use wrapyfi_core::engine::{Available, Config, Plan};
use wrapyfi_core::middleware::memory::Memory;
use wrapyfi_core::types::{MessageType, Payload, Value};
use wrapyfi_interfaces::store::TypeStore;

/// What goes wrong on a bus, for the ends that a bridge opens.
#[derive(Debug, Default, Clone)]
pub struct Faults {
    pub refuses_to_open: bool,
    pub sends_fail: bool,
    /// Where to panic: `take`, `publish`, `open`, `look`, `learn`, `drop`.
    pub panics_in: Option<&'static str>,
    /// Why its discovery sees nothing.
    pub away: Option<String>,
    /// Sends to topics that begin so wait until they do not any more.
    pub blocked: Option<String>,
}

/// What the ends of a bridge did on a bus, by topic.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct History {
    pub opened: usize,
    pub taken: Vec<i64>,
    pub published: Vec<i64>,
}

#[derive(Default)]
struct Shared {
    faults: Mutex<Faults>,
    changed: Condvar,
    history: Mutex<BTreeMap<String, History>>,
}

/// A bus as a bridge sees it.
pub struct Faulty {
    pub bus: Memory,
    shared: Arc<Shared>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    fn panic_in(&self, place: &str) {
        let panics = lock(&self.faults).panics_in == Some(place);
        assert!(!panics, "injected: {place}");
    }

    fn note(&self, topic: &str, enter: impl FnOnce(&mut History)) {
        enter(lock(&self.history).entry(topic.to_owned()).or_default());
    }
}

impl Faulty {
    pub fn new(name: &str) -> Arc<Self> {
        Arc::new(Self { bus: Memory::new(name), shared: Arc::default() })
    }

    /// Another bridge's view of the same bus: its faults and its history are its own.
    pub fn seen_by_another(&self) -> Arc<Self> {
        Arc::new(Self { bus: self.bus.clone(), shared: Arc::default() })
    }

    pub fn change(&self, change: impl FnOnce(&mut Faults)) {
        change(&mut lock(&self.shared.faults));
        self.shared.changed.notify_all();
    }

    pub fn heal(&self) {
        self.change(|faults| *faults = Faults::default());
    }

    pub fn history(&self, topic: &str) -> History {
        lock(&self.shared.history).get(topic).cloned().unwrap_or_default()
    }

    pub fn histories(&self) -> BTreeMap<String, History> {
        lock(&self.shared.history).clone()
    }

    fn may_open(&self, topic: &str) -> Result<(), OpenError> {
        self.shared.panic_in("open");
        if lock(&self.shared.faults).refuses_to_open {
            let reason = "injected: it refuses".to_owned();
            let topic = topic.to_owned();
            return Err(OpenError::Transport { middleware: "memory", topic, reason });
        }
        self.shared.note(topic, |history| history.opened += 1);
        Ok(())
    }
}

impl Middleware for Faulty {
    fn name(&self) -> &str {
        self.bus.name()
    }

    fn open_listener(
        &self,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Box<dyn Listener>, OpenError> {
        self.may_open(&spec.topic)?;
        let inner = self.bus.open_listener(spec, context)?;
        let (shared, topic) = (Arc::clone(&self.shared), spec.topic.clone());
        Ok(Box::new(FaultyEnd { inner, shared, topic }))
    }

    fn open_publisher(
        &self,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Box<dyn Publisher>, OpenError> {
        self.may_open(&spec.topic)?;
        let inner = self.bus.open_publisher(spec, context)?;
        let (shared, topic) = (Arc::clone(&self.shared), spec.topic.clone());
        Ok(Box::new(FaultyEnd { inner, shared, topic }))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        let (inner, shared) = (self.bus.discover()?, Arc::clone(&self.shared));
        Ok(Box::new(FaultyEnd { inner, shared, topic: String::new() }))
    }

    fn learn_topic(
        &self,
        found: &Discovered,
        types: &mut TypeStore,
    ) -> Result<Learned, LearnError> {
        self.shared.panic_in("learn");
        self.bus.learn_topic(found, types)
    }
}

/// An end, or a discovery, that fails as told.
struct FaultyEnd<T: ?Sized> {
    inner: Box<T>,
    shared: Arc<Shared>,
    topic: String,
}

impl<T: ?Sized> Drop for FaultyEnd<T> {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.shared.panic_in("drop");
        }
    }
}

impl Listener for FaultyEnd<dyn Listener> {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let taken = self.inner.take()?;
        if let Some(sample) = &taken {
            // Its bytes are what makes it panic: it is gone.
            self.shared.panic_in("take");
            let n = number_of(&sample.payload);
            self.shared.note(&self.topic, |history| history.taken.push(n));
        }
        Ok(taken)
    }

    fn discard(&mut self) -> bool {
        self.inner.discard()
    }

    fn link(&self) -> Link {
        self.inner.link()
    }
}

impl Publisher for FaultyEnd<dyn Publisher> {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        self.shared.panic_in("publish");
        let mut faults = lock(&self.shared.faults);
        while faults.blocked.as_ref().is_some_and(|begin| self.topic.starts_with(begin)) {
            faults = self.shared.changed.wait(faults).unwrap_or_else(PoisonError::into_inner);
        }
        if faults.sends_fail {
            let reason = "injected: it does not send".to_owned();
            return Err(PublishError::Transport { topic: self.topic.clone(), reason });
        }
        drop(faults);
        let sent = self.inner.publish(payload)?;
        let n = number_of(payload);
        self.shared.note(&self.topic, |history| history.published.push(n));
        Ok(sent)
    }

    fn link(&self) -> Link {
        self.inner.link()
    }
}

impl Discovery for FaultyEnd<dyn Discovery> {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        self.shared.panic_in("look");
        self.inner.endpoints()
    }

    fn waiting_for(&self) -> Option<String> {
        lock(&self.shared.faults).away.clone()
    }
}

pub fn number(n: i64) -> Payload {
    Payload::from(Value::Int(n))
}

pub fn number_of(payload: &Payload) -> i64 {
    match payload {
        Payload::NativeObject(object) => object.value.as_i64().expect("a number"),
        other => panic!("{other:?}"),
    }
}

pub fn topic(name: &str) -> TopicSpec {
    TopicSpec::new(name, MessageType::NativeObject)
}

pub fn publisher(bus: &Memory, name: &str) -> Box<dyn Publisher> {
    bus.open_publisher(&topic(name), &Context::default()).expect("memory opens")
}

pub fn listener(bus: &Memory, name: &str, depth: usize) -> Box<dyn Listener> {
    let mut spec = topic(name);
    spec.queue.depth = depth;
    bus.open_listener(&spec, &Context::default()).expect("memory opens")
}

/// All numbers that wait.
pub fn drain(listener: &mut dyn Listener) -> Vec<i64> {
    std::iter::from_fn(|| listener.take().expect("memory takes"))
        .map(|sample| number_of(&sample.payload))
        .collect()
}

pub fn registry(buses: &[&Arc<Faulty>]) -> Registry {
    let mut registry = Registry::new();
    for bus in buses {
        registry.register(Arc::clone(bus) as _);
    }
    registry
}

#[derive(Debug, Default, serde::Deserialize)]
struct NoEndpoints {}

/// A plan of routes as a file has them, between buses `a`, `b` and `c`.
pub fn plan(routes: &[String]) -> Plan {
    if routes.is_empty() {
        return Plan::default();
    }
    let text: String = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect();
    let config: Config<NoEndpoints> =
        Config::from_yaml(&format!("routes:\n{text}"), "bridge.yaml").expect("a configuration");
    let known =
        ["a", "b", "c"].map(|name| Available { name, check_topic: &|_| Ok(()), options: &[] });
    Plan::new(&config, &known, &mut TypeStore::generated(), "bridge.yaml").expect("a plan")
}

/// Waits for a condition, long.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let end = Instant::now() + std::time::Duration::from_secs(120);
    while !holds() {
        assert!(Instant::now() < end, "never: {what}");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}
