//! Topics inside one process: for tests of everything above the middlewares, and to show how
//! small a middleware can be.
//!
//! ```text
//!   publisher ──▶ topic "/x" ──▶ inbox of every listener
//!   client ────▶ service "/x" ──▶ one of its servers
//!   client ────▶ action "/x" ───▶ its server
//! ```

mod actions;
mod services;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::{
    ActionClient, ActionServer, ActionSpec, Client, Context, DiscoverError, Discovered, Discovery,
    Link, Listener, Middleware, Mutex, Opened, PublishError, Publisher, Receiver, Role, Sample,
    Sender, Server, ServiceSpec, TakeError, TopicSpec, Wake, inbox,
};
use wrapyfi_data::types::Payload;

/// A bus of topics that live in this process.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Payload, Value};
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/x", MessageType::NativeObject);
/// let mut listener = bus.open_listener(&spec, &Context::default())?;
/// bus.open_publisher(&spec, &Context::default())?.publish(&Payload::from(Value::Null))?;
/// assert!(listener.take()?.is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// A clone is the same bus.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    name: String,
    bus: Arc<Mutex<Bus>>,
}

pub use services::{Carriage, Fate, Way};

#[derive(Debug, Default)]
struct Bus {
    topics: BTreeMap<String, Topic>,
    services: BTreeMap<String, services::Service>,
    actions: BTreeMap<String, actions::Action>,
    carriage: Carriage,
}

#[derive(Debug, Default)]
struct Topic {
    publishers: usize,
    listeners: Vec<(Sender<Sample>, Context)>,
    /// Bells that ring when the number of peers changes.
    watchers: Vec<Wake>,
    /// Type with which the topic was opened last.
    type_name: Option<&'static str>,
}

impl Memory {
    /// Makes a bus under a name of its own, so that one process can hold several.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), bus: Arc::default() }
    }

    /// Sets the rule that decides the fate of requests and replies on their way, for tests of the layers above.
    #[doc(hidden)]
    pub fn carry_services(&self, carriage: Carriage) {
        self.bus.lock().carriage = carriage;
    }

    fn enter(&self, spec: &TopicSpec, context: &Context, enter: impl FnOnce(&mut Topic)) {
        let mut bus = self.bus.lock();
        let topic = bus.topics.entry(spec.topic.clone()).or_default();
        topic.type_name = Some(spec.message_type.label());
        enter(topic);
        topic.watchers.push(context.wake.clone());
        topic.watchers.iter().for_each(Wake::ring);
    }
}

impl Middleware for Memory {
    fn name(&self) -> &str {
        &self.name
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        let (sender, receiver) = inbox(spec.queue, context);
        self.enter(spec, context, |topic| topic.listeners.push((sender, context.clone())));
        Ok(Box::new(MemoryListener {
            bus: Arc::clone(&self.bus),
            topic: spec.topic.clone(),
            receiver: Some(receiver),
        }))
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.enter(spec, context, |topic| topic.publishers += 1);
        Ok(Box::new(MemoryPublisher { bus: Arc::clone(&self.bus), topic: spec.topic.clone() }))
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        Ok(Box::new(services::MemoryClient::open(&self.bus, spec, context)))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        Ok(Box::new(services::MemoryServer::open(&self.bus, spec, context)))
    }

    fn open_action_client(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionClient> {
        Ok(Box::new(actions::MemoryActionClient::open(&self.bus, spec, context)))
    }

    fn open_action_server(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionServer> {
        Ok(Box::new(actions::MemoryActionServer::open(&self.bus, spec, context)))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(MemoryDiscovery { bus: Arc::clone(&self.bus) }))
    }
}

struct MemoryDiscovery {
    bus: Arc<Mutex<Bus>>,
}

impl Discovery for MemoryDiscovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let bus = self.bus.lock();
        let found = bus.topics.iter().flat_map(|(name, topic)| {
            [(Role::Publisher, topic.publishers), (Role::Listener, topic.listeners.len())].map(
                |(role, count)| Discovered {
                    count: count as u64,
                    type_name: topic.type_name.map(str::to_owned),
                    ..Discovered::new(name, role)
                },
            )
        });
        let services = bus.services.iter().map(|(name, it)| (name, it.ends(), it.type_name()));
        let actions = bus.actions.iter().map(|(name, it)| (name, it.ends(), it.type_name()));
        let served = services.chain(actions).flat_map(|(name, ends, type_name)| {
            ends.map(|(role, count)| Discovered {
                count: count as u64,
                type_name: type_name.map(str::to_owned),
                ..Discovered::new(name, role)
            })
        });
        Ok(found.chain(served).filter(|endpoint| endpoint.count > 0).collect())
    }

    fn is_complete(&self) -> Option<bool> {
        Some(true)
    }
}

struct MemoryListener {
    bus: Arc<Mutex<Bus>>,
    topic: String,
    /// Queue of the listener; `None` once it is closed.
    receiver: Option<Receiver<Sample>>,
}

impl Listener for MemoryListener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        Ok(self.receiver.as_ref().and_then(Receiver::pop))
    }

    fn discard(&mut self) -> bool {
        self.receiver.as_ref().and_then(Receiver::pop).is_some()
    }

    fn link(&self) -> Link {
        let publishers =
            self.bus.lock().topics.get(&self.topic).map_or(0, |topic| topic.publishers);
        Link { peers: Some(publishers), ..Link::default() }
    }
}

impl Drop for MemoryListener {
    fn drop(&mut self) {
        // Closed first, because the watchers that are rung look whether it is still there.
        self.receiver = None;
        if let Some(topic) = self.bus.lock().topics.get_mut(&self.topic) {
            topic.listeners.retain(|(listener, _)| !listener.is_closed());
            topic.watchers.iter().for_each(Wake::ring);
        }
    }
}

struct MemoryPublisher {
    bus: Arc<Mutex<Bus>>,
    topic: String,
}

impl Publisher for MemoryPublisher {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let mut bus = self.bus.lock();
        let topic = bus.topics.entry(self.topic.clone()).or_default();
        topic.listeners.retain(|(listener, _)| !listener.is_closed());
        for (listener, context) in &topic.listeners {
            context.counters.received(0);
            let sample = Sample {
                payload: payload.clone(),
                wire_bytes: 0,
                received_at: context.clock.now(),
                origin: None,
            };
            listener.settle(sample);
        }
        Ok(0)
    }

    fn link(&self) -> Link {
        let mut bus = self.bus.lock();
        let topic = bus.topics.entry(self.topic.clone()).or_default();
        topic.listeners.retain(|(listener, _)| !listener.is_closed());
        Link { peers: Some(topic.listeners.len()), ..Link::default() }
    }
}

impl Drop for MemoryPublisher {
    fn drop(&mut self) {
        if let Some(topic) = self.bus.lock().topics.get_mut(&self.topic) {
            topic.publishers = topic.publishers.saturating_sub(1);
            topic.watchers.iter().for_each(Wake::ring);
        }
    }
}
