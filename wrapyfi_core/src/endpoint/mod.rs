//! The seam between middlewares and everything above them.
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

mod address;
pub(crate) mod book;
mod budget;
pub(crate) mod calls;
mod clock;
mod counters;
mod discovery;
mod inbox;
mod late;
mod latency;
mod learn;
mod mark;
mod origin;
mod qos;
mod qos_match;
mod qos_pinned;
mod registry;
mod service;
mod service_error;
mod topic_error;
mod wake;

use std::sync::Arc;
use std::time::Instant;

pub use address::{EndpointAddress, ParseAddressError};
pub use budget::{Budget, Share, WAITING};
pub use calls::Ticket;
pub use clock::{RosClock, RosNow};
pub use counters::{Counters, CountersSnapshot, DropReason, QosEvent};
pub use discovery::{
    AnnouncedDurability, AnnouncedQos, DiscoverError, Discovered, Discovery, NameFilter, Role,
    Traffic,
};
pub use inbox::{Overflow, QueueSpec, Receiver, Sender, Waits, inbox};
pub use late::{Late, StartFault};
pub use latency::{Latency, LatencySummary};
pub use learn::{LearnError, Learned};
pub(crate) use learn::{service_of_name, topic_of_name};
pub use mark::{BridgeMark, ParseMarkError};
pub use origin::{Keeping, Origin};
pub use qos::{Durability, History, Liveliness, Qos, QosPreset, Reliability};
pub use qos_match::{MatchedQos, QosPolicy, QosWarning, listener_qos, mismatches, publisher_qos};
pub use qos_pinned::PinnedQos;
pub use registry::{Registry, UnknownMiddleware};
pub use service::{Client, IncomingRequest, Reply, Request, RequestId, Server, ServiceSpec};
pub use service_error::{CallError, ServeError};
pub use topic_error::{OpenError, PublishError, TakeError};
pub use wake::Wake;

use wrapyfi_interfaces::store::TypeStore;

use crate::Limits;
use crate::plugin::Plugins;
use crate::types::{Encoding, Map, MessageType, Payload, ServiceKind};

/// A transport that carries topics: ZeroMQ, ROS 2, …
pub trait Middleware: Send + Sync {
    /// Name in addresses, for instance `zeromq` in `zeromq:/camera`.
    fn name(&self) -> &str;

    /// Starts receiving a topic. Returns at once: a peer that is not there yet is waited for.
    ///
    /// # Errors
    /// When the topic can never be received as asked; the reason says what to change.
    fn open_listener(
        &self,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Box<dyn Listener>, OpenError>;

    /// Prepares sending to a topic. Returns at once, as [`Middleware::open_listener`] does.
    ///
    /// # Errors
    /// When the topic can never be sent as asked.
    fn open_publisher(
        &self,
        spec: &TopicSpec,
        context: &Context,
    ) -> Result<Box<dyn Publisher>, OpenError>;

    /// Prepares calling a service. Returns at once: a server that is not there yet is waited for.
    ///
    /// # Errors
    /// When the service can never be called as asked, or the middleware has no services.
    fn open_client(
        &self,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Box<dyn Client>, OpenError> {
        _ = context;
        Err(self.no_services(spec))
    }

    /// Starts offering a service. Returns at once.
    ///
    /// # Errors
    /// When the service can never be offered as asked, or the middleware has no services.
    fn open_server(
        &self,
        spec: &ServiceSpec,
        context: &Context,
    ) -> Result<Box<dyn Server>, OpenError> {
        _ = context;
        Err(self.no_services(spec))
    }

    /// What a middleware without services says when one is asked for.
    fn no_services(&self, spec: &ServiceSpec) -> OpenError {
        OpenError::NoServices { middleware: self.name().to_owned(), service: spec.service.clone() }
    }

    /// Begins to look for the endpoints of other programs. Returns at once, with nothing found yet.
    ///
    /// # Errors
    /// When the middleware has no way to tell them, or the transport refuses.
    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Err(DiscoverError::Unsupported { middleware: self.name().to_owned() })
    }

    /// As [`Middleware::discover`], and also sees what shows only to those who listen to it, which may
    /// cost its publishers something: of `topic`, or of all.
    ///
    /// # Errors
    /// As [`Middleware::discover`].
    fn discover_closely(&self, topic: Option<&str>) -> Result<Box<dyn Discovery>, DiscoverError> {
        _ = topic;
        self.discover()
    }

    /// What this middleware is to routes by pattern.
    fn traits(&self) -> Traits {
        Traits::default()
    }

    /// The type of a topic from what one of its endpoints announces. Returns at once: where somebody
    /// has to be asked first, a later call has the answer. `types` is asked for definitions first.
    ///
    /// # Errors
    /// Why the type is not known, or not yet.
    fn learn_topic(
        &self,
        found: &Discovered,
        types: &mut TypeStore,
    ) -> Result<Learned, LearnError> {
        topic_of_name(self.name(), found, types)
    }

    /// The type that a listener with these options receives where the topic has the type `learned`.
    fn received_as(&self, learned: MessageType, options: &Map) -> MessageType {
        _ = options;
        learned
    }

    /// The type of a service from what its server announces, as [`Middleware::learn_topic`].
    ///
    /// # Errors
    /// As [`Middleware::learn_topic`].
    fn learn_service(
        &self,
        found: &Discovered,
        types: &mut TypeStore,
    ) -> Result<ServiceKind, LearnError> {
        service_of_name(self.name(), found, types)
    }

    /// Why this middleware has ended for good, for instance because somebody told it to; `None` while it
    /// works, or may work again by itself.
    fn ended(&self) -> Option<String> {
        None
    }

    /// Whether a publisher that was found keeps its last message for whoever comes later. Returns at
    /// once: `None` where it has not told yet, and a later call has the answer.
    fn keeps_last(&self, found: &Discovered) -> Option<bool> {
        Some(found.qos.is_some_and(|qos| qos.durability != AnnouncedDurability::Volatile))
    }

    /// Why nothing of this middleware can work at the moment, for instance a master that does not
    /// answer; `None` where nothing is known to be wrong.
    fn waiting_for(&self) -> Option<String> {
        None
    }
}

/// What a middleware is to routes by pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Traits {
    /// It carries every ROS type as it is.
    pub any_ros_type: bool,
    /// The times of its messages are ROS time, which may be simulated, and none comes without.
    pub ros_time: bool,
    /// Its discovery leaves out this program's own endpoints, and its listeners do not hear them: a
    /// topic may be bridged in both directions.
    pub tells_own: bool,
    /// Its discovery shows the marks of other bridges' endpoints.
    pub shows_marks: bool,
    /// A subscription that is there first hears a publisher at once, long before discovery finds that:
    /// where somebody waits at the destination, a route subscribes before there is a publisher.
    pub subscribes_first: bool,
    /// Its messages have no types but what they look like, and may be read as any type that they fit:
    /// a route takes the one that its listeners want.
    pub untyped: bool,
}

/// Receives one topic.
pub trait Listener: Send {
    /// The next message, if one waits. Never blocks: [`Context::wake`] rings when one arrives.
    ///
    /// # Errors
    /// The next message was unusable. It is gone; the one after it can be taken.
    fn take(&mut self) -> Result<Option<Sample>, TakeError>;

    /// Drops the next message without looking into it, for when nobody wants it; false when none
    /// waits.
    fn discard(&mut self) -> bool {
        !matches!(self.take(), Ok(None))
    }

    /// Passes over the next message without looking into it, because nobody wants it yet; how many
    /// were lost by that, `None` when none waits. Where publishers keep their last message for
    /// whoever comes later (transient local), the listener keeps it likewise: the newest of each
    /// publisher is taken first when somebody wants it.
    fn set_aside(&mut self) -> Option<u64> {
        self.discard().then_some(1)
    }

    /// A publisher that keeps its last message and has gone: ended, killed, or out of reach. `None`
    /// where there is none that was not told yet. Told after its last message was taken; it is the
    /// number that the messages had in [`Origin::publisher`].
    fn departed(&mut self) -> Option<u64> {
        None
    }

    /// Whether its publishers keep their last message for who comes later.
    fn keeping(&self) -> Keeping {
        Keeping::Unknown
    }

    /// What the listener is connected to now.
    fn link(&self) -> Link;

    /// Looks at what its peers announce, and adapts to it where the listener was opened with
    /// [`TopicSpec::match_peers`]. Cheap while nothing changes. The owner calls it when the bell
    /// rings and when [`Review::next`] has come.
    fn review(&mut self, _now: Instant) -> Review {
        Review::default()
    }
}

/// Sends to one topic.
pub trait Publisher: Send {
    /// Hands `payload` to the transport; the number of bytes that go on its wire.
    ///
    /// # Errors
    /// The message was not sent, and why.
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError>;

    /// As [`Publisher::publish`], where it is known whose message it is. A publisher that keeps
    /// messages keeps the last one of each origin that does so too, until [`Publisher::forget`].
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    fn forward(
        &mut self,
        payload: &Payload,
        origin: Option<Origin>,
    ) -> Result<usize, PublishError> {
        _ = origin;
        self.publish(payload)
    }

    /// An origin has gone: who comes later is no longer given its last message.
    fn forget(&mut self, publisher: u64) {
        _ = publisher;
    }

    /// The source was closed, and the numbers of its origins with it: nothing of them is kept.
    fn forget_all(&mut self) {}

    /// Told now and again what [`Listener::keeping`] says of the source. A publisher that was
    /// opened with [`TopicSpec::match_peers`] offers the same.
    fn follow_source(&mut self, source: Keeping) {
        _ = source;
    }

    /// What the publisher is connected to now. A publisher without consumer need not be given
    /// anything, except where [`Link::keeps_last`] says that later consumers will want it.
    fn link(&self) -> Link;

    /// As [`Listener::review`].
    fn review(&mut self, _now: Instant) -> Review {
        Review::default()
    }
}

/// What came of a look at an endpoint's peers.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Review {
    /// Quality of service in use; `None` where the middleware has none.
    pub qos: Option<Qos>,
    /// How it was changed by this look, if it was.
    pub changed: Option<QosChange>,
    /// What the owner should tell its user, each once: peers that do not fit, and what to do.
    pub warnings: Vec<String>,
    /// When to look again even if nothing rings.
    pub next: Option<Instant>,
    /// Why fewer messages go out than are given, in words; `None` where all do.
    pub slowed: Option<String>,
}

/// An endpoint was opened again with another quality of service.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QosChange {
    /// What it was.
    pub from: Qos,
    /// What it is now.
    pub to: Qos,
    /// The peers that asked for it, in a few words.
    pub why: String,
}

/// A received message.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The content.
    pub payload: Payload,
    /// Size on the wire in bytes, all frames.
    pub wire_bytes: usize,
    /// When its last byte was here.
    pub received_at: Instant,
    /// Whose it is, where the listener can tell.
    pub origin: Option<Origin>,
}

impl Waits for Sample {
    fn bytes(&self) -> usize {
        self.wire_bytes
    }
}

/// State of an endpoint's connection, for status tables and for waiting.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Link {
    /// Peers that are matched: listeners of a publisher, publishers of a listener. `None` where
    /// the transport cannot know.
    pub peers: Option<usize>,
    /// Why nothing can flow at the moment (`broker tcp://127.0.0.1:5555 does not answer`);
    /// `None` when the way is open.
    pub waiting_for: Option<String>,
    /// The last message is kept for consumers that come later (transient local).
    pub keeps_last: bool,
}

/// What to open: a topic, its type, and how it is treated.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicSpec {
    /// Name in that middleware, for instance `/camera/image_raw`.
    pub topic: String,
    /// Type of its messages.
    pub message_type: MessageType,
    /// Quality of service, where the middleware has one.
    pub qos: Qos,
    /// Fits the quality of service to the peers that exist and follows them
    /// ([`Listener::review`]); `qos` is used while there are none, its history and lifespan always.
    pub match_peers: bool,
    /// Policies that hold whatever `qos` and the peers say.
    pub pinned: PinnedQos,
    /// Queue of a listener.
    pub queue: QueueSpec,
    /// Channel order that three-channel frames from Wrapyfi have (`encoding:` of a route);
    /// [`Encoding::Bgr8`] by OpenCV custom.
    pub color_order: Encoding,
    /// Bounds on every message.
    pub limits: Limits,
    /// What reads and writes plug-in objects inside native objects.
    pub plugins: Plugins,
    /// Settings that only some middlewares have, by name, such as `carrier`; each reads those that it
    /// knows.
    pub options: Map,
    /// What a publisher announces where there is room for it: that a bridge made it by pattern.
    pub mark: Option<BridgeMark>,
    /// A listener passes over publishers whose mark says that their messages came through this
    /// middleware, where it can tell.
    pub shun: Option<String>,
}

impl TopicSpec {
    /// A topic with default quality of service, queue and limits.
    #[must_use]
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
            plugins: Plugins::standard(),
            options: Map::default(),
            mark: None,
            shun: None,
        }
    }
}

/// What an endpoint shares with its owner.
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Rung when a message arrives or the link changes.
    pub wake: Wake,
    /// Where arrivals and drops are counted. A listener counts what it receives and what its
    /// queue drops; the owner counts everything after [`Listener::take`].
    pub counters: Arc<Counters>,
}
