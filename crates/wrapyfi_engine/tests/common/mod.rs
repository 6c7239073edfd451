//! A bus in memory whose ends fail as told, and plans for tests of the engine.

pub mod bridges;
pub mod seeds;
mod services;
mod transport;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use wrapyfi_data::types::{MessageType, Payload, ServiceKind, Value};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{
    Cause, Client, Clock, Context, DiscoverError, Discovered, Discovery, LearnError, Learned, Link,
    Listener, Middleware, NameFilter, OpenError, PublishError, Publisher, Registry, Review,
    RoutingProperties, Sample, Server, ServiceSpec, TakeError, TopicSpec,
};
use wrapyfi_engine::{Available, Config, Plan, Route};
use wrapyfi_interfaces::parser::Dialect;
use wrapyfi_interfaces::store::TypeStore;

use transport::{Paced, Unsteady};

/// The hand of a clock that stands until it is moved.
#[derive(Clone)]
pub struct Hand(Arc<Mutex<Instant>>);

impl Hand {
    pub fn new() -> Self {
        Self(Arc::new(Mutex::new(Instant::now())))
    }

    pub fn now(&self) -> Instant {
        *lock(&self.0)
    }

    pub fn advance(&self, time: Duration) {
        *lock(&self.0) += time;
    }

    pub fn clock(&self) -> Clock {
        let hand = self.clone();
        Clock::new(move || hand.now())
    }

    pub fn context(&self) -> Context {
        Context { clock: self.clock(), ..Context::default() }
    }
}

/// Faults of a bus, for the ends that a bridge opens.
#[derive(Debug, Default, Clone)]
pub struct Faults {
    pub refuses_to_open: bool,
    /// Prefix of topics that it refuses to open.
    pub refused: Option<String>,
    pub sends_fail: bool,
    /// Every third message comes after one that was sent later.
    pub messages_are_late: bool,
    /// Every fourth message comes twice.
    pub messages_come_twice: bool,
    /// Every fifth message is lost on its way, on topics whose quality of service allows that.
    pub messages_are_lost: bool,
    /// Way in which the peers of publishers read.
    pub readers: Readers,
    /// True while there is no connection: what is under way is lost.
    pub is_cut: bool,
    /// Function that panics: `take`, `publish`, `send`, `reply`, `open`, `look`, `only`, `learn`, `traits`,
    /// `drop`.
    pub panics_in: Option<&'static str>,
    /// Reason that its discovery sees nothing; `None` while it works.
    pub away: Option<String>,
    /// Prefix of topics to which sends block until the prefix is changed.
    pub blocked: Option<String>,
}

/// Way in which the peers of a publisher read what its transport holds for them.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub enum Readers {
    #[default]
    Read,
    /// One message at each look of the publisher at its links.
    Slow,
    /// None.
    Stopped,
}

/// Messages that the ends of a bridge took and published on a topic.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct History {
    pub opened: usize,
    pub taken: Vec<i64>,
    pub published: Vec<i64>,
    /// Calls that the last client was given and that have not ended.
    pub under_way: i64,
}

#[derive(Default)]
struct FaultyState {
    faults: Mutex<Faults>,
    changed: Condvar,
    history: Mutex<BTreeMap<String, History>>,
}

/// A bus as a bridge sees it.
pub struct Faulty {
    pub bus: Memory,
    shared: Arc<FaultyState>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl FaultyState {
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

    /// View of another bridge on the same bus, with faults and history of its own.
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
        let is_refused = {
            let faults = lock(&self.shared.faults);
            let one = faults.refused.as_ref().is_some_and(|begin| topic.starts_with(begin));
            faults.refuses_to_open || one
        };
        if is_refused {
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
        let inner: Box<dyn Listener> = Box::new(Unsteady::new(inner, &shared, spec, context));
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
        let inner: Box<dyn Publisher> = Box::new(Paced::new(inner, &shared, spec, context));
        Ok(Box::new(FaultyEnd { inner, shared, topic }))
    }

    fn open_client(
        &self,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Box<dyn Client>, OpenError> {
        self.may_open(&spec.service)?;
        let inner = self.bus.open_client(spec, context)?;
        // Those of the one before went with it.
        self.shared.note(&spec.service, |history| history.under_way = 0);
        let (shared, topic) = (Arc::clone(&self.shared), spec.service.clone());
        Ok(Box::new(FaultyEnd { inner, shared, topic }))
    }

    fn open_server(
        &self,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Box<dyn Server>, OpenError> {
        self.may_open(&spec.service)?;
        let inner = self.bus.open_server(spec, context)?;
        let (shared, topic) = (Arc::clone(&self.shared), spec.service.clone());
        Ok(Box::new(FaultyEnd { inner, shared, topic }))
    }

    fn routing_properties(&self) -> RoutingProperties {
        self.shared.panic_in("traits");
        self.bus.routing_properties()
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

    fn learn_service(
        &self,
        found: &Discovered,
        types: &mut TypeStore,
    ) -> Result<ServiceKind, LearnError> {
        self.shared.panic_in("learn");
        self.bus.learn_service(found, types)
    }
}

/// An end, or a discovery, that fails as told.
struct FaultyEnd<T: ?Sized> {
    inner: Box<T>,
    shared: Arc<FaultyState>,
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

    fn review(&mut self, now: Instant) -> Review {
        self.inner.review(now)
    }
}

impl Discovery for FaultyEnd<dyn Discovery> {
    fn only(&mut self, wanted: NameFilter) {
        self.shared.panic_in("only");
        self.inner.only(wanted);
    }

    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        self.shared.panic_in("look");
        self.inner.endpoints()
    }

    fn waiting_for(&self) -> Option<Cause> {
        lock(&self.shared.faults).away.clone().map(Cause::Transport)
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

/// A store of types without definitions.
pub fn types() -> TypeStore {
    TypeStore::new(Dialect::Ros2, BTreeMap::<PathBuf, String>::new())
}

thread_local! {
    /// Routes that were read before: of the time of a simulation, most went into compiling the same few patterns.
    static READ: RefCell<BTreeMap<String, Route>> = RefCell::default();
}

/// A plan of routes as a file has them, between buses `a`, `b` and `c`.
pub fn plan(routes: &[String]) -> Plan {
    let read = |text: &String| {
        let known = READ.with_borrow(|known| known.get(text).cloned());
        known.unwrap_or_else(|| {
            let route = read(text);
            READ.with_borrow_mut(|known| known.insert(text.clone(), route.clone()));
            route
        })
    };
    Plan { routes: routes.iter().map(read).collect() }
}

fn read(route: &str) -> Route {
    let text = format!("  - {{ {route} }}\n");
    let config: Config<NoEndpoints> =
        Config::from_yaml(&format!("routes:\n{text}"), "bridge.yaml").expect("a configuration");
    let known = ["a", "b", "c"].map(|name| Available { name, ..Available::default() });
    let plan = Plan::new(&config, &known, &mut types(), "bridge.yaml").expect("a plan");
    plan.routes.into_iter().next().expect("a route")
}
