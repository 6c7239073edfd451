//! A route as data: source, destination, types and settings. It can be printed, serialised,
//! compared and replaced.
//!
//! ```text
//!   { from: "zeromq:/a", to: "ros2:/a", type: Image }   one name, its type given      runs as it stands
//!   { from: "ros:/chatter", to: "ros2:/chatter" }       one name, its type learned  ┐ routes are made once
//!   { from: "ros:/(.*)", to: "ros2:/$1" }               a pattern: many names       ┘ what they take is there
//! ```

use std::time::Duration;

use super::config_qos::{QosConfig, QosOverride};
use super::stamping::StampSource;
use wrapyfi_data::Limits;
use wrapyfi_data::plugin::Plugins;
use wrapyfi_data::types::{Encoding, Map, MessageType, RosAction, ServiceKind, Value};
use wrapyfi_endpoint::pattern::{
    Inverse, NamePattern, bare, fits_template, ros_name, with_leading_digits,
};
use wrapyfi_endpoint::{
    ActionSpec, BridgeMark, Conventions, EndpointAddress, Interaction, QueueSpec, ServiceSpec,
    TopicSpec,
};

/// Option that both routes of a control board have at the board's end.
pub(super) const BOARD_OPTION: &str = "board";
/// Type of the lines of logs, and number of those that wait in a route.
const LOG: (&str, usize) = ("rcl_interfaces/msg/Log", 1000);
/// Time by which a request outlives the call that the route makes for it.
const ANSWER_MARGIN: Duration = Duration::from_secs(2);

/// Key of a route: its interaction and its ends. Entries of two plans with one key are about the same route.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RouteKey {
    /// Interaction of the endpoints that the route takes from and gives to.
    pub interaction: Interaction,
    /// Source of messages, or address at which a service has its server.
    pub from: EndpointAddress,
    /// Destination of messages, or address at which a service is offered.
    pub to: EndpointAddress,
}

/// A route that is to run, or a pattern that means many.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_data::types, wrapyfi_engine as engine}; }
/// use wrapyfi_core::engine::Route;
/// use wrapyfi_core::types::MessageType;
/// let route = Route::topic("zeromq:/camera".parse()?, "ros2:/camera".parse()?, MessageType::Image);
/// assert_eq!((route.from.middleware.as_str(), route.to.middleware.as_str()), ("zeromq", "ros2"));
/// assert!(route.to_string().starts_with("zeromq:/camera -> ros2:/camera  topic  sensor_msgs/msg/Image"));
/// # Ok::<(), wrapyfi_endpoint::ParseAddressError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// Name in tables, logs and errors.
    pub name: String,
    /// Source of messages, or address at which a service has its server. The name of a pattern is
    /// its regular expression.
    pub from: EndpointAddress,
    /// Destination of messages, or address at which a service is offered. That of a pattern refers
    /// to its groups.
    pub to: EndpointAddress,
    /// Names that a pattern means; `None` for a route with one name.
    #[doc(hidden)]
    pub names: Option<Names>,
    /// Types of messages, or of requests and replies.
    #[doc(hidden)]
    pub types: RouteTypes,
    /// Origin of `types`.
    #[doc(hidden)]
    pub typing: Typing,
    /// Settings of the route.
    pub policy: Policy,
    /// Mark that the destination announces, of a route that a pattern made. Its source then passes
    /// over messages that came through the destination's middleware before.
    #[doc(hidden)]
    pub mark: Option<BridgeMark>,
}

/// Types that a route carries.
///
/// ```
/// use wrapyfi_data::types::MessageType;
/// use wrapyfi_engine::{Route, RouteTypes, Types};
/// let route = Route::topic("zeromq:/a".parse()?, "ros2:/a".parse()?, MessageType::Image);
/// assert_eq!(route.types, RouteTypes::Topic(Types::from(MessageType::Image)));
/// # Ok::<(), wrapyfi_endpoint::ParseAddressError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RouteTypes {
    /// Messages.
    Topic(Types),
    /// Requests and replies.
    Service(ServiceKind),
    /// Goals, feedback and results; `None` until the type is learned.
    Action(Option<RosAction>),
}

impl RouteTypes {
    /// ROS name of the type at the destination.
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Topic(types) => types.to.label(),
            Self::Service(kind) => kind.ros_type(),
            Self::Action(kind) => kind.map_or("unknown", RosAction::name),
        }
    }
}

/// Types of a route's messages.
///
/// See [`RouteTypes`].
///
/// ```
/// use wrapyfi_data::types::MessageType;
/// use wrapyfi_engine::Types;
/// let pictures = Types { from: MessageType::Image, to: MessageType::CompressedImage };
/// assert_ne!(pictures.from, Types::from(MessageType::CompressedImage).from);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Types {
    /// Type at the source.
    pub from: MessageType,
    /// Type at the destination.
    pub to: MessageType,
}

impl From<MessageType> for Types {
    fn from(both: MessageType) -> Self {
        Self { from: both, to: both }
    }
}

/// Origin of a route's types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Typing {
    /// The configuration gives them.
    Given,
    /// The endpoints at the source announce them; those of the route mean nothing.
    Learned,
    /// As [`Typing::Learned`]; where no endpoint announces any, those of the route hold.
    LearnedIfTold,
}

/// True where `meant` is another name for `to`, which has what ROS 2 lacks.
pub(super) fn may_be_meant(to: &EndpointAddress, meant: &EndpointAddress) -> bool {
    to.middleware == meant.middleware && to != meant && ros_name(&meant.name) == to.name
}

/// Names that a pattern means.
///
/// ```
/// use wrapyfi_data::types::MessageType;
/// use wrapyfi_engine::{NamePattern, Names, Route};
/// let mut route = Route::topic("ros2:/".parse()?, "zeromq:/".parse()?, MessageType::Image);
/// route.names = Some(Names {
///     pattern: NamePattern::new("/camera/.*")?,
///     allow: vec![],
///     deny: vec![NamePattern::new(".*/depth")?],
///     default_deny: None,
///     max_routes: 8,
///     ros_names: false,
///     from_ros_names: true,
/// });
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Names {
    /// Pattern that names must match.
    pub pattern: NamePattern,
    /// Names that are allowed; empty for all.
    pub allow: Vec<NamePattern>,
    /// Names that are left out, also where they are allowed.
    pub deny: Vec<NamePattern>,
    /// Conventions of the source by which hidden names and those that every program has are left out;
    /// `None` where none is.
    pub default_deny: Option<Conventions>,
    /// Largest number of routes.
    pub max_routes: usize,
    /// True where the destination has names of ROS, so that others are replaced.
    pub ros_names: bool,
    /// True where the source has names of ROS, so that a name at the destination which is none may be meant by them.
    pub from_ros_names: bool,
}

/// Settings of a route.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_data::types, wrapyfi_engine as engine}; }
/// use wrapyfi_core::engine::{Policy, Route};
/// use wrapyfi_core::types::MessageType;
/// let mut route = Route::topic("yarp:/camera".parse()?, "ros2:/camera".parse()?, MessageType::Image);
/// route.policy = Policy { max_rate_hz: Some(10.0), lazy: true, ..Policy::default() };
/// # Ok::<(), wrapyfi_endpoint::ParseAddressError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    /// Quality of service on middlewares that have one.
    pub qos: QosConfig,
    /// Changes to `qos` at the source, from the start of the program.
    #[doc(hidden)]
    pub from_override: QosOverride,
    /// Changes to `qos` at the destination, from the start of the program.
    #[doc(hidden)]
    pub to_override: QosOverride,
    /// Queue between source and conversion.
    pub queue: QueueSpec,
    /// Highest rate passed on, in messages per second.
    pub max_rate_hz: Option<f64>,
    /// True where the route stays closed that would close a circle over other bridges.
    pub loop_guard: bool,
    /// Channel order of three-channel frames on Wrapyfi's side.
    pub color_order: Encoding,
    /// Coordinate frame that messages get; `None` leaves the source's.
    pub frame_id: Option<String>,
    /// Source of the time that messages get; `None` leaves the default.
    pub stamp: Option<StampSource>,
    /// Bounds on every message, request and reply.
    pub limits: Limits,
    /// Plug-ins that read and write objects inside native objects.
    pub plugins: Plugins,
    /// Settings that only some middlewares have, by name.
    pub options: Map,
    /// True when the source is open only while a program listens at the destination.
    pub lazy: bool,
    /// True where other routes may have the same destination, those of one pattern among them.
    pub merge: bool,
    /// Time within which a call of a service is answered, [`ServiceSpec::TIMEOUT`] unless given, and a function that
    /// stands for an action, for which there is no limit unless given.
    pub timeout: Option<Duration>,
}

impl Policy {
    /// Time that a call of a service has.
    pub fn answer_within(&self) -> Duration {
        self.timeout.unwrap_or(ServiceSpec::TIMEOUT)
    }
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            qos: QosConfig::default(),
            from_override: QosOverride::default(),
            to_override: QosOverride::default(),
            queue: QueueSpec::default(),
            max_rate_hz: None,
            loop_guard: true,
            color_order: Encoding::Bgr8,
            frame_id: None,
            stamp: None,
            limits: Limits::default(),
            plugins: wrapyfi_plugins::standard(),
            options: Map::default(),
            lazy: false,
            merge: false,
            timeout: None,
        }
    }
}

impl Route {
    /// Makes a route of messages, with default settings.
    pub fn topic(from: EndpointAddress, to: EndpointAddress, message_type: MessageType) -> Self {
        Self::new(from, to, RouteTypes::Topic(message_type.into()))
    }

    /// Makes a route of a service that has its server at `from`, with default settings.
    pub fn service(from: EndpointAddress, to: EndpointAddress, kind: ServiceKind) -> Self {
        Self::new(from, to, RouteTypes::Service(kind))
    }

    /// Makes a route of an action that has its server at `from`, with default settings.
    pub fn action(from: EndpointAddress, to: EndpointAddress, kind: RosAction) -> Self {
        Self::new(from, to, RouteTypes::Action(Some(kind)))
    }

    pub(super) fn new(from: EndpointAddress, to: EndpointAddress, types: RouteTypes) -> Self {
        let (names, policy, mark) = (None, Policy::default(), None);
        let mut route = Self {
            name: String::new(),
            from,
            to,
            names,
            types,
            typing: Typing::Given,
            policy,
            mark,
        };
        route.name = route.ends();
        route
    }

    /// Ends of the route in the direction of messages or requests, such as `ros2:/a -> zeromq:/a`.
    pub fn ends(&self) -> String {
        ends(self.interaction(), &self.from, &self.to)
    }

    /// The two ends in a name as [`Self::ends`] writes it.
    pub fn read_ends(name: &str) -> Option<(&str, &str)> {
        name.split_once(" -> ")
    }

    /// Key of the route.
    #[doc(hidden)]
    pub fn key(&self) -> RouteKey {
        RouteKey { interaction: self.interaction(), from: self.from.clone(), to: self.to.clone() }
    }

    /// Interaction of the endpoints that the route takes from and gives to.
    pub fn interaction(&self) -> Interaction {
        match self.types {
            RouteTypes::Topic(_) => Interaction::Topic,
            RouteTypes::Service(_) => Interaction::Service,
            RouteTypes::Action(_) => Interaction::Action,
        }
    }

    /// True for a pattern, false for a route with one name.
    pub fn is_many(&self) -> bool {
        self.names.is_some()
    }

    /// True for a direction of a control board, whose states and movements have one name and are different messages.
    pub fn serves_board(&self) -> bool {
        self.policy.options.get(BOARD_OPTION).and_then(Value::as_bool) == Some(true)
    }

    /// Name of the board of which it is a direction, which has another word behind it.
    pub fn board_name(&self) -> Option<&str> {
        self.name.rsplit_once(' ').filter(|_| self.serves_board()).map(|(board, _)| board)
    }

    /// True for a route that runs as it stands, because it has one name and its type is given.
    pub fn is_whole(&self) -> bool {
        !self.is_many() && self.typing == Typing::Given
    }

    /// Types of the route's messages; native objects for a service or an action, which has none.
    pub fn message_types(&self) -> Types {
        match self.types {
            RouteTypes::Topic(types) => types,
            RouteTypes::Service(_) | RouteTypes::Action(_) => MessageType::NativeObject.into(),
        }
    }

    /// ROS name of the type at the destination.
    pub(super) fn label(&self) -> &'static str {
        self.types.label()
    }

    /// Destination of the source called `name`; `None` where the route leaves it out.
    pub fn target(&self, name: &str) -> Option<EndpointAddress> {
        let Some(Names { pattern, ros_names, .. }) = &self.names else {
            return (self.from.name == name).then(|| self.to.clone());
        };
        if !name.starts_with('/') || self.left_out(name).is_some() {
            return None;
        }
        let name = pattern.expand(name, &self.to.name)?;
        let name = if *ros_names { ros_name(&name) } else { name };
        Some(EndpointAddress { middleware: self.to.middleware.clone(), name })
    }

    /// True for a pattern whose sources have names of ROS.
    pub(super) fn has_names_of_ros(&self) -> bool {
        self.names.as_ref().is_some_and(|names| names.from_ros_names)
    }

    /// Route that the pattern makes from a source to a destination; also where that is awaited under a name that ROS 2
    /// lacks.
    pub fn made_between(&self, from: &EndpointAddress, to: &EndpointAddress) -> Option<Self> {
        let made = self.made_from(from)?;
        let is_meant = self.has_names_of_ros() && may_be_meant(&made.to, to);
        (made.to == *to || is_meant).then(|| Self { to: to.clone(), ..made })
    }

    /// Route that the pattern makes for a source.
    pub fn made_from(&self, from: &EndpointAddress) -> Option<Self> {
        let is_meant = self.is_many() && from.middleware == self.from.middleware;
        let to = is_meant.then(|| self.target(&from.name))??;
        Some(Self { from: from.clone(), to, names: None, ..self.clone() })
    }

    /// Route that the pattern makes into a destination; `None` also where the source cannot be told from it.
    pub fn made_to(&self, to: &EndpointAddress) -> Option<Self> {
        let inverse = self.inverse()?;
        let replaced = self.has_names_of_ros().then(|| ros_name(&to.name));
        let name = self.source(&inverse, &to.name);
        let name = name.or_else(|| self.source(&inverse, &replaced?))?;
        let from = EndpointAddress { middleware: self.from.middleware.clone(), name };
        let made = self.made_from(&from).filter(|made| made.to.middleware == to.middleware)?;
        self.made_between(&from, to).or(Some(made))
    }

    /// Source that becomes `name` at the destination, as far as it can be told: a digit that an underscore stands
    /// before may have begun the part, another character that an underscore replaced is lost.
    pub(super) fn source(&self, inverse: &Inverse, name: &str) -> Option<String> {
        let has_ros_names = self.names.as_ref().is_some_and(|names| names.ros_names);
        let digits = has_ros_names.then(|| with_leading_digits(name));
        [Some(name), digits.as_deref()].into_iter().flatten().find_map(|made| {
            let source = inverse.source(made)?;
            let target = self.target(&source)?;
            (bare(&target.name) == bare(name)).then_some(source)
        })
    }

    /// True where the pattern may go to `name`. Groups and filters of a source that can be told from the destination
    /// decide.
    pub(super) fn may_go_to(&self, inverse: &Inverse, name: &str) -> bool {
        let has_ros_names = self.names.as_ref().is_some_and(|names| names.ros_names);
        let may_be_replaced = has_ros_names && name.contains('_');
        (may_be_replaced && fits_template(&self.to.name, name))
            || self.source(inverse, name).is_some()
            || (self.has_names_of_ros() && self.source(inverse, &ros_name(name)).is_some())
    }

    /// Way from a name at the destination of a pattern back to the source; `None` where no name
    /// leads back.
    pub(super) fn inverse(&self) -> Option<Inverse> {
        Inverse::new(&self.names.as_ref()?.pattern, &self.to.name)
    }

    /// Largest number of routes that the pattern makes.
    pub(super) fn max_routes(&self) -> usize {
        self.names.as_ref().map_or(1, |names| names.max_routes)
    }

    /// True when both patterns make the same routes between the same ends.
    pub(super) fn makes_the_same(&self, other: &Self) -> bool {
        // Routes of a pattern are named after their ends.
        self.is_many() == other.is_many()
            && (self.is_many() || self.name == other.name)
            && (self.types, self.typing) == (other.types, other.typing)
            && self.policy == other.policy
    }

    /// Topic to open at `address`, one of the route's two ends.
    pub fn topic_spec(&self, address: &EndpointAddress) -> TopicSpec {
        let (policy, types) = (&self.policy, self.message_types());
        let at_source = *address == self.from;
        let changed = if at_source { policy.from_override } else { policy.to_override };
        let mut queue = policy.queue;
        // Programs log many lines at once when they start.
        if types.to.ros_type() == LOG.0 && queue == QueueSpec::default() {
            queue.depth = LOG.1;
        }
        TopicSpec {
            topic: address.name.clone(),
            message_type: if at_source { types.from } else { types.to },
            qos: policy.qos.qos(),
            match_peers: changed.follows || matches!(policy.qos, QosConfig::Match(_)),
            pinned: changed.pinned,
            queue,
            color_order: policy.color_order,
            limits: policy.limits,
            plugins: policy.plugins.clone(),
            options: policy.options.clone(),
            mark: self.mark.clone().filter(|_| !at_source),
            ignore_through: self
                .mark
                .as_ref()
                .filter(|_| at_source)
                .map(|_| self.to.middleware.clone()),
        }
    }

    /// As [`Route::topic_spec`]; where the route says nothing, the middleware at `address` has its conventions.
    pub fn topic_spec_by(
        &self,
        address: &EndpointAddress,
        follow_conventions: impl FnOnce(&mut TopicSpec, bool),
    ) -> TopicSpec {
        let mut spec = self.topic_spec(address);
        if self.policy.qos == QosConfig::default() {
            follow_conventions(&mut spec, *address == self.from);
        }
        spec
    }

    /// Service to open at `address`, one of the route's two ends.
    pub fn service_spec(&self, address: &EndpointAddress) -> ServiceSpec {
        let kind = match self.types {
            RouteTypes::Service(kind) => kind,
            RouteTypes::Topic(_) | RouteTypes::Action(_) => ServiceKind::NativeObject,
        };
        // The margin lets the route report that the server did not answer, before the request
        // expires.
        let margin = if *address == self.to { ANSWER_MARGIN } else { Duration::ZERO };
        ServiceSpec {
            timeout: self.policy.answer_within().saturating_add(margin),
            limits: self.policy.limits,
            options: self.policy.options.clone(),
            mark: self.mark.clone(),
            ..ServiceSpec::new(address.name.clone(), kind)
        }
    }

    /// Action of type `kind` to open at `address`, one of the route's two ends.
    pub fn action_spec(&self, address: &EndpointAddress, kind: RosAction) -> ActionSpec {
        ActionSpec {
            limits: self.policy.limits,
            color_order: self.policy.color_order,
            plugins: self.policy.plugins.clone(),
            timeout: self.policy.timeout,
            options: self.policy.options.clone(),
            mark: self.mark.clone(),
            ..ActionSpec::new(address.name.clone(), kind)
        }
    }
}

/// Ends of a route in the direction of messages or calls, such as `ros2:/a -> zeromq:/a`.
pub(super) fn ends(
    interaction: Interaction,
    source: &EndpointAddress,
    destination: &EndpointAddress,
) -> String {
    let [from, to] = interaction.in_direction(source, destination);
    format!("{from} -> {to}")
}
