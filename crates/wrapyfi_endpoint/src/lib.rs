//! The interface between middlewares and everything above them: listeners, publishers, clients,
//! servers.
//!
//! ```text
//!   engine, command line, communicator
//!        │ take()                    ▲ publish()
//!   ┌────▼─────┐               ┌─────┴─────┐
//!   │ Listener │               │ Publisher │      one per topic, opened by a Middleware
//!   └────▲─────┘               └─────┬─────┘
//!     inbox (bounded, counted)       │
//!   I/O thread ◀── socket    socket ─▼
//! ```
//!
//! A middleware implements [`Middleware`] and is entered under its name in a [`Registry`]; nothing
//! above knows its type. [`Client`] and [`Server`] do for requests and replies what [`Publisher`] and
//! [`Listener`] do for messages.

mod action;
mod address;
mod budget;
pub mod calls;
mod cause;
mod cause_code;
mod cause_parts;
mod clock;
pub mod codec;
#[cfg(feature = "driver")]
pub mod config;
mod context;
mod conventions;
mod counters;
mod deferred;
mod discovered;
mod discovery;
#[cfg(feature = "driver")]
pub mod driver;
mod forwarding;
mod freed;
pub mod function_action;
mod inbox;
mod interaction;
mod latched;
mod latency;
mod learn;
mod link;
mod mark;
pub mod memory;
pub mod method;
pub mod network;
mod origin;
mod outbox;
#[cfg(feature = "patterns")]
pub mod pattern;
mod peers;
mod qos;
mod qos_match;
mod qos_pinned;
mod registry;
pub mod requests;
#[cfg(feature = "patterns")]
mod ros_name;
mod service;
mod service_error;
mod start;
mod throttle;
mod topic_error;
mod wake;
pub mod wire_client;
pub mod wire_server;

use std::time::Instant;

pub use wrapyfi_retry::Mutex;
pub use wrapyfi_retry::backoff;
#[cfg(feature = "tokio")]
pub use wrapyfi_retry::restart;

pub use action::{
    ActionClient, ActionServer, ActionSpec, GoalNumber, GoalOutcome, GoalRequest, GoalUpdate,
};
pub use address::{EndpointAddress, ParseAddressError};
pub use budget::{Budget, PROGRESS, Share, WAITING};
pub use calls::Ticket;
pub use cause::Cause;
pub use cause_code::CauseCode;
pub use cause_parts::{Absent, CarriedBack, Named, PeerFault, WireType};
pub use clock::{Clock, RosNow};
pub use context::Context;
pub use conventions::{Conventions, NameService};
pub use counters::{Counters, CountersSnapshot, DropReason, GoalEvent, QosEvent, Refused};
pub use deferred::DeferredMiddleware;
pub use discovered::{AnnouncedDurability, AnnouncedQos, Discovered, Traffic};
pub use discovery::{DiscoverError, Discovery, NameFilter};
pub use forwarding::{ForwardingListener, ForwardingPublisher};
pub use freed::{give_memory_back, note_routes, start_small};
pub use inbox::{Overflow, QueueSpec, Receiver, Sender, Waits, inbox};
pub use interaction::{Interaction, Role};
pub use latched::{Latched, MAX_ORIGINS};
pub use latency::{Latency, LatencySummary};
pub use learn::{LearnError, LearnResult, Learned};
pub use learn::{action_of_name, service_of_name, topic_of_name};
pub use link::Link;
pub use mark::{BridgeMark, ParseMarkError};
pub use origin::{SampleOrigin, SourceDurability};
pub use outbox::{Outbox, Pieces};
pub use peers::Peers;
pub use qos::{Durability, History, Liveliness, Qos, QosPreset, Reliability};
pub use qos_match::{MatchedQos, QosPolicy, QosWarning, listener_qos, mismatches, publisher_qos};
pub use qos_pinned::PinnedQos;
pub use registry::{Registry, UnknownMiddleware};
pub use service::{
    Call, Client, IncomingRequest, Refusal, Reply, Request, RequestId, Server, ServiceSpec,
};
pub use service_error::{CallError, ServeError, ServeResult};
pub use start::{Builder, MiddlewareSettings, Planned, StartError, StartFn};
pub use throttle::{Throttle, Throttles};
pub use topic_error::{OpenError, OpenResult, Opened, PublishError, Published, TakeError};
#[doc(hidden)]
pub use wake::Pollable;
pub use wake::Wake;

use wrapyfi_interfaces::store::TypeStore;

use wrapyfi_data::Limits;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Encoding, Map, MessageType, Payload, RosAction, ServiceKind};

/// A transport that carries topics: ZeroMQ, ROS 2, …
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::error::Error;
/// use wrapyfi_core::endpoint::{Context, Middleware, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Value};
///
/// /// Works on any middleware.
/// fn greet(middleware: &dyn Middleware, spec: &TopicSpec) -> Result<(), Box<dyn Error>> {
///     let mut publisher = middleware.open_publisher(spec, &Context::default())?;
///     publisher.publish(&Value::from("hello").into())?;
///     Ok(())
/// }
///
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/greeting", MessageType::Text);
/// let mut listener = bus.open_listener(&spec, &Context::default())?;
/// greet(&bus, &spec)?;
/// assert_eq!(listener.take()?.unwrap().payload, Value::from("hello").into());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Middleware: Send + Sync {
    /// Name in addresses, for instance `zeromq` in `zeromq:/camera`.
    fn name(&self) -> &str;

    /// Network on which its names have their meaning: a name is the same topic for all who return the same text, in
    /// other programs too. `None` where it is not known yet, or no other program can be on it.
    fn network(&self) -> Option<String> {
        self.inner()?.network()
    }

    /// The middleware that does all that a wrapper leaves out; `None` for a transport itself. What a method does by
    /// default is asked of it, so that a wrapper can forget none.
    fn inner(&self) -> Option<&dyn Middleware> {
        None
    }

    /// Starts receiving a topic. Returns at once: a peer that is not there yet is waited for.
    ///
    /// # Errors
    /// When the topic can never be received as asked; the reason says what to change.
    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener>;

    /// Prepares sending to a topic. Returns at once, as [`Middleware::open_listener`] does.
    ///
    /// # Errors
    /// When the topic can never be sent as asked.
    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher>;

    /// Gives an endpoint that a route opens, a listener where it is `at_source`, what is usual for its topic here.
    /// Not called for a route that says it itself.
    fn follow_conventions(&self, spec: &mut TopicSpec, at_source: bool) {
        if let Some(inner) = self.inner() {
            inner.follow_conventions(spec, at_source);
        }
    }

    /// Prepares calling a service. Returns at once: a server that is not there yet is waited for.
    ///
    /// # Errors
    /// When the service can never be called as asked, or the middleware has no services.
    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        match self.inner() {
            Some(inner) => inner.open_client(spec, context),
            None => Err(OpenError::not_carried(self.name(), Interaction::Service, &spec.service)),
        }
    }

    /// Starts offering a service. Returns at once.
    ///
    /// # Errors
    /// When the service can never be offered as asked, or the middleware has no services.
    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        match self.inner() {
            Some(inner) => inner.open_server(spec, context),
            None => Err(OpenError::not_carried(self.name(), Interaction::Service, &spec.service)),
        }
    }

    /// Prepares sending goals to an action. Returns at once: a server that is not there yet is waited for. By default
    /// the action is a function of that name ([`function_action`]).
    ///
    /// # Errors
    /// When goals can never be sent as asked, or the middleware has no actions.
    fn open_action_client(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionClient> {
        match self.inner() {
            Some(inner) => inner.open_action_client(spec, context),
            None => function_action::open(self, spec, context, None),
        }
    }

    /// Starts offering an action. Returns at once.
    ///
    /// # Errors
    /// When the action can never be offered as asked, or the middleware has no actions.
    fn open_action_server(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionServer> {
        match self.inner() {
            Some(inner) => inner.open_action_server(spec, context),
            None => Err(OpenError::not_carried(self.name(), Interaction::Action, &spec.action)),
        }
    }

    /// Begins to look for the endpoints of other programs. Returns at once, before any is found.
    ///
    /// # Errors
    /// When the middleware has no way to list endpoints, or the transport refuses.
    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        self.inner().map_or_else(
            || Err(DiscoverError::Unsupported(self.name().to_owned())),
            <dyn Middleware>::discover,
        )
    }

    /// As [`Middleware::discover`], and also finds endpoints that show only to a program that
    /// listens to them, which may cost their publishers something: those of `topic`, or of all
    /// topics.
    ///
    /// # Errors
    /// As [`Middleware::discover`].
    fn discover_closely(&self, topic: Option<&str>) -> Result<Box<dyn Discovery>, DiscoverError> {
        self.inner().map_or_else(|| self.discover(), |inner| inner.discover_closely(topic))
    }

    /// Properties of this middleware on which routes by pattern depend.
    fn routing_properties(&self) -> RoutingProperties {
        self.inner().map(<dyn Middleware>::routing_properties).unwrap_or_default()
    }

    /// Learns the type of a topic from the announcement of one of its endpoints. Returns at once:
    /// where the endpoint has to be asked first, a later call has the answer. `types` is asked for
    /// definitions first.
    ///
    /// # Errors
    /// When the type is not known, or not yet.
    #[doc(hidden)]
    fn learn_topic(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<Learned> {
        match self.inner() {
            Some(inner) => inner.learn_topic(found, types),
            None => topic_of_name(self.name(), found, types),
        }
    }

    /// Type that a listener with these options receives where the topic has the type `learned`.
    fn received_as(&self, learned: MessageType, options: &Map) -> MessageType {
        self.inner().map_or(learned, |inner| inner.received_as(learned, options))
    }

    /// Options with which a listener of the source `name` is opened ahead of its publishers, for listeners at the
    /// destination of a route ([`RoutingProperties::subscribes_first`]); `None` where it is not opened ahead.
    fn ahead_options(&self, name: &str) -> Option<Map> {
        match self.inner() {
            Some(inner) => inner.ahead_options(name),
            None => self.routing_properties().subscribes_first.then(Map::default),
        }
    }

    /// Learns the type of a service from its server's announcement, as [`Middleware::learn_topic`].
    ///
    /// # Errors
    /// As [`Middleware::learn_topic`].
    #[doc(hidden)]
    fn learn_service(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<ServiceKind> {
        match self.inner() {
            Some(inner) => inner.learn_service(found, types),
            None => service_of_name(self.name(), found, types),
        }
    }

    /// Learns the type of an action from its server's announcement, as [`Middleware::learn_topic`].
    ///
    /// # Errors
    /// As [`Middleware::learn_topic`].
    #[doc(hidden)]
    fn learn_action(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<RosAction> {
        match self.inner() {
            Some(inner) => inner.learn_action(found, types),
            None => action_of_name(self.name(), found, types),
        }
    }

    /// Place for the lines of this program's log, where the middleware has one.
    fn log_sink(&self) -> Option<Box<dyn LogSink>> {
        self.inner()?.log_sink()
    }

    /// Cause for which this middleware has ended for good, for instance an order to end; `None` while
    /// it works, or may work again by itself.
    fn ended(&self) -> Option<Cause> {
        self.inner()?.ended()
    }

    /// True when a discovered publisher keeps its last message for listeners that come later.
    /// Returns at once: `None` while the publisher has not answered, and a later call has the
    /// answer.
    fn keeps_last(&self, found: &Discovered) -> Option<bool> {
        let keeps = |qos: AnnouncedQos| qos.durability != AnnouncedDurability::Volatile;
        self.inner()
            .map_or_else(|| Some(found.qos.is_some_and(keeps)), |inner| inner.keeps_last(found))
    }

    /// Makes sure that the program that is found under this name is there: it is in the way of a route. Returns at
    /// once; who is gone is not found any more.
    fn verify(&self, name: &str) {
        if let Some(inner) = self.inner() {
            inner.verify(name);
        }
    }

    /// Cause for which nothing of this middleware can work at the moment, for instance a master that
    /// does not answer; `None` where no fault is known.
    fn waiting_for(&self) -> Option<Cause> {
        self.inner()?.waiting_for()
    }
}

/// Takes the lines of a program's log. Returns at once: who reads them is not waited for.
pub trait LogSink: Send + Sync {
    /// Takes a line of `component`. `level` is `ERROR`, `WARNING`, `INFO` or `DEBUG`.
    fn write(&self, level: &str, component: &str, text: &str);
}

/// Properties of a middleware on which routes by pattern depend.
///
/// ```
/// use wrapyfi_endpoint::{Middleware, RoutingProperties, memory::Memory};
/// let bus = Memory::new("memory");
/// assert_eq!(bus.routing_properties(), RoutingProperties::default());
/// assert!(!bus.routing_properties().any_ros_type);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RoutingProperties {
    /// True where the middleware carries every ROS type as it is.
    pub any_ros_type: bool,
    /// True where every message has a time, which is ROS time and may be simulated.
    pub ros_time: bool,
    /// True where discovery leaves out this program's own endpoints and its listeners do not hear
    /// them, so that a topic may be bridged in both directions.
    pub tells_own: bool,
    /// True where discovery shows the marks of other bridges' endpoints.
    pub shows_marks: bool,
    /// True where a listener that is there first hears a publisher at once, long before discovery
    /// finds that publisher, or is connected by others. A route whose destination has a listener then opens
    /// its source ahead of it.
    pub subscribes_first: bool,
    /// True where messages carry no type and may be read as any type that they fit. A route then
    /// takes the type that the listeners at its destination want.
    pub untyped: bool,
    /// True where endpoints follow the option `carrier`.
    pub carriers: bool,
    /// Names, below that of an action, of topics that are its parts. Patterns of topics leave them out where there are
    /// patterns of actions.
    pub action_topics: &'static [&'static str],
}

/// The receiving end of a topic.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{Context, Listener, Middleware, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Payload, Value};
///
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/x", MessageType::NativeObject);
/// let context = Context::default();
/// let mut listener = bus.open_listener(&spec, &context)?;
/// assert_eq!(listener.take()?, None);
/// bus.open_publisher(&spec, &Context::default())?.publish(&Value::from(5).into())?;
/// context.wake.wait(Duration::from_secs(1)); // rung when a message arrives
/// assert_eq!(listener.take()?.unwrap().payload, Payload::from(Value::from(5)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Listener: Send {
    /// Takes the next message, if one waits. Never blocks: [`Context::wake`] rings when one
    /// arrives.
    ///
    /// # Errors
    /// When the next message cannot be used. It is dropped; the one after it can be taken.
    fn take(&mut self) -> Result<Option<Sample>, TakeError>;

    /// Drops the next message unread, because the route does not want it; false when none waits.
    fn discard(&mut self) -> bool {
        !matches!(self.take(), Ok(None))
    }

    /// The part of the listener that routes use, where its publishers may keep messages.
    #[doc(hidden)]
    fn forwarding(&mut self) -> Option<&mut dyn ForwardingListener> {
        None
    }

    /// Connection of the listener now; its peers are publishers.
    fn link(&self) -> Link;

    /// Looks at the announcements of the peers, and adapts to them where the listener was opened
    /// with [`TopicSpec::match_peers`]. Cheap while nothing changes. The owner calls it when the
    /// bell rings and when [`Review::next`] has come.
    #[doc(hidden)]
    fn review(&mut self, _now: Instant) -> Review {
        Review::default()
    }
}

/// The sending end of a topic.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, Publisher, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Value};
///
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/x", MessageType::NativeObject);
/// let mut publisher = bus.open_publisher(&spec, &Context::default())?;
/// assert_eq!(publisher.link().peers, Some(0)); // no program listens yet
/// let mut listener = bus.open_listener(&spec, &Context::default())?;
/// assert_eq!(publisher.link().peers, Some(1));
/// publisher.publish(&Value::from(5).into())?;
/// assert!(listener.take()?.is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Publisher: Send {
    /// Hands `payload` to the transport; number of bytes that go on its wire.
    ///
    /// # Errors
    /// When the message was not sent.
    fn publish(&mut self, payload: &Payload) -> Published;

    /// The part of the publisher that routes use, where it can keep messages.
    #[doc(hidden)]
    fn forwarding(&mut self) -> Option<&mut dyn ForwardingPublisher> {
        None
    }

    /// Connection of the publisher now; its peers are listeners. A publisher without peers need not
    /// be given messages, except where [`Link::keeps_last`] is set: later listeners are sent the
    /// last one.
    fn link(&self) -> Link;

    /// As [`Listener::review`].
    #[doc(hidden)]
    fn review(&mut self, _now: Instant) -> Review {
        Review::default()
    }
}

/// Result of a look at an endpoint's peers.
///
/// ```
/// use std::time::Instant;
/// use wrapyfi_endpoint::{Context, Middleware, Review, TopicSpec, memory::Memory};
/// use wrapyfi_data::types::MessageType;
/// let spec = TopicSpec::new("/x", MessageType::Image);
/// let mut listener = Memory::new("memory").open_listener(&spec, &Context::default())?;
/// let Review { qos, warnings, .. } = listener.review(Instant::now());
/// assert!(qos.is_none() && warnings.is_empty()); // this middleware has no quality of service
/// # Ok::<(), wrapyfi_endpoint::OpenError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Review {
    /// Quality of service in use; `None` where the middleware has none.
    pub qos: Option<Qos>,
    /// Change of the quality of service that this look made, if any.
    pub changed: Option<QosChange>,
    /// Warnings that the owner shows its user once each: peers that do not fit, and the remedy.
    pub warnings: Vec<String>,
    /// Instant at which to look again even if nothing rings.
    pub next: Option<Instant>,
    /// Cause for which fewer messages go out than are given; `None` where all do.
    pub slowed: Option<Cause>,
}

/// Change of an endpoint that was opened again with another quality of service.
///
/// See [`Review::changed`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QosChange {
    /// Quality of service before the change.
    pub from: Qos,
    /// Quality of service now.
    pub to: Qos,
    /// Peers that asked for the change, in a few words.
    pub why: String,
}

/// A received message.
///
/// ```
/// # mod wrapyfi_core {
/// #     pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types};
/// #     pub mod middleware { pub use wrapyfi_endpoint::memory; }
/// # }
/// use wrapyfi_core::endpoint::{Context, Middleware, Sample, TopicSpec};
/// use wrapyfi_core::middleware::memory::Memory;
/// use wrapyfi_core::types::{MessageType, Payload, Value};
/// let bus = Memory::new("memory");
/// let spec = TopicSpec::new("/x", MessageType::NativeObject);
/// let mut listener = bus.open_listener(&spec, &Context::default())?;
/// bus.open_publisher(&spec, &Context::default())?.publish(&Value::from("hi").into())?;
/// let Some(Sample { payload, received_at, .. }) = listener.take()? else { panic!("no message") };
/// assert!(matches!(payload, Payload::NativeObject(object) if object.as_str() == Some("hi")));
/// assert!(received_at.elapsed().as_secs() < 60);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Content of the message.
    pub payload: Payload,
    /// Size on the wire in bytes, all frames.
    pub wire_bytes: usize,
    /// Instant at which the last byte arrived.
    pub received_at: Instant,
    /// Publisher that sent the message, where the listener can tell.
    pub origin: Option<SampleOrigin>,
}

impl Waits for Sample {
    fn bytes(&self) -> usize {
        self.wire_bytes
    }
}

/// A topic to open, with its type and the settings of the endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_endpoint as endpoint, wrapyfi_data::types}; }
/// use wrapyfi_core::endpoint::{Overflow, QosPreset, QueueSpec, TopicSpec};
/// use wrapyfi_core::types::MessageType;
/// let spec = TopicSpec {
///     qos: QosPreset::SensorData.into(),
///     queue: QueueSpec { depth: 1, overflow: Overflow::DropOldest },
///     ..TopicSpec::new("/camera/image_raw", MessageType::Image)
/// };
/// assert_eq!(spec.message_type.ros_type(), "sensor_msgs/msg/Image");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TopicSpec {
    /// Name of the topic in that middleware, for instance `/camera/image_raw`.
    pub topic: String,
    /// Type of the messages.
    pub message_type: MessageType,
    /// Quality of service, where the middleware has one.
    pub qos: Qos,
    /// True when the endpoint fits its quality of service to its peers and follows them
    /// ([`Listener::review`]); `qos` is used while there are none, its history and lifespan always.
    pub match_peers: bool,
    /// Policies that hold in place of those of `qos` and the peers.
    #[doc(hidden)]
    pub pinned: PinnedQos,
    /// Queue of a listener.
    pub queue: QueueSpec,
    /// Channel order that three-channel frames from Wrapyfi have (`encoding:` of a route);
    /// [`Encoding::Bgr8`] by OpenCV custom.
    pub color_order: Encoding,
    /// Bounds on every message.
    pub limits: Limits,
    /// Plug-ins that read and write objects inside native objects.
    pub plugins: Plugins,
    /// Settings that only some middlewares have, by name, such as `carrier`; each middleware reads
    /// those that it knows.
    pub options: Map,
    /// Mark of the bridge that makes the publisher by pattern; announced where the wire has room
    /// for it.
    #[doc(hidden)]
    pub mark: Option<BridgeMark>,
    /// Middleware whose messages a listener passes over: those of publishers whose mark says that
    /// they came through it, where the listener can tell.
    pub ignore_through: Option<String>,
}

impl TopicSpec {
    /// Conversion of what is given to the topic to its type.
    pub fn conversion(&self) -> Conversion {
        Conversion { to: self.message_type, color_order: self.color_order, limits: self.limits }
    }

    /// A topic with default quality of service, queue and limits.
    pub fn new(topic: impl Into<String>, message_type: MessageType) -> Self {
        Self {
            topic: topic.into(),
            message_type,
            qos: Qos::default(),
            match_peers: false,
            pinned: PinnedQos::default(),
            queue: QueueSpec::default(),
            color_order: Encoding::Bgr8,
            limits: Limits::default(),
            plugins: wrapyfi_plugins::standard(),
            options: Map::default(),
            mark: None,
            ignore_through: None,
        }
    }
}
