//! State of a route, which can be printed and serialised.

use std::fmt;

use serde::Serialize;

use super::route::Route;
use wrapyfi_endpoint::{Cause, CountersSnapshot, EndpointAddress, Interaction, Qos};

/// State of a route. Every state but [`RouteState::Active`] says why.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_engine as engine; }
/// use wrapyfi_core::engine::RouteState;
/// use wrapyfi_endpoint::{Absent, CauseCode, Role};
/// let camera = Absent::at(Role::Publisher, &"zeromq:/camera".parse()?);
/// let state = RouteState::Waiting(camera.into());
/// assert_eq!(state.cause().map(|cause| cause.code()), Some(CauseCode::NobodyPublishes));
/// assert_eq!(state.to_string(), "waiting for a publisher on zeromq:/camera");
/// # Ok::<(), wrapyfi_endpoint::ParseAddressError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum RouteState {
    /// Nothing can flow yet; names the thing that the route waits for.
    Waiting(Cause),
    /// Messages flow, or will as soon as there is one.
    Active,
    /// Messages flow, but some were lost lately; names the last cause.
    Degraded(Cause),
    /// Nothing can ever flow as configured; names the setting to change.
    Error(Cause),
}

impl RouteState {
    /// Word for the state, for tables.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Waiting(_) => "waiting",
            Self::Active => "active",
            Self::Degraded(_) => "degraded",
            Self::Error(_) => "error",
        }
    }

    /// Cause of the state; `None` for [`RouteState::Active`].
    pub fn cause(&self) -> Option<&Cause> {
        match self {
            Self::Active => None,
            Self::Waiting(cause) | Self::Degraded(cause) | Self::Error(cause) => Some(cause),
        }
    }

    /// Logs that a route has come into this state, after `unlogged_before` states that were not
    /// logged. A route that is one of many of a pattern is logged at level debug where no message
    /// was lost.
    pub(super) fn log(&self, route: &str, is_one_of_many: bool, unlogged_before: u64) {
        let unlogged_before = (unlogged_before > 0).then_some(unlogged_before);
        match self {
            Self::Error(_) => tracing::error!(route, unlogged_before, "{self}"),
            Self::Degraded(_) => tracing::warn!(route, unlogged_before, "{self}"),
            _ if is_one_of_many => tracing::debug!(route, unlogged_before, "{self}"),
            _ => tracing::info!(route, unlogged_before, "{self}"),
        }
    }
}

impl fmt::Display for RouteState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())?;
        match (self, self.cause()) {
            (Self::Waiting(_), Some(what)) => write!(f, " for {what}"),
            (_, Some(reason)) => write!(f, ": {reason}"),
            (_, None) => Ok(()),
        }
    }
}

/// Status of a route at one moment.
///
/// See the example of the [crate](crate), which reads the counters of one.
///
/// ```
/// # use std::{sync::Arc, time::Instant};
/// # use wrapyfi_data::types::MessageType;
/// # use wrapyfi_endpoint::{Registry, memory::Memory};
/// # use wrapyfi_engine::{Engine, Plan, Route, RouteState};
/// # let mut registry = Registry::new();
/// # registry.register(Arc::new(Memory::new("memory")));
/// # let route = Route::topic("memory:/in".parse()?, "memory:/out".parse()?, MessageType::Image);
/// # let plan = Plan { routes: vec![route] };
/// let mut engine = Engine::new(plan, &registry);
/// engine.step(Instant::now());
/// for route in engine.status() {
///     println!("{} -> {}: {}", route.from, route.to, route.state.word());
///     assert_eq!((route.has_source, route.counters.sent), (false, 0));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RouteStatus {
    /// Name from the configuration.
    pub name: String,
    /// Source address.
    pub from: String,
    /// Destination address.
    pub to: String,
    /// Interaction that the route carries, in its word: `topic`, `service` or `action`.
    #[serde(rename = "kind")]
    pub interaction: Interaction,
    /// ROS name of the type that the route carries.
    #[serde(rename = "type")]
    pub message_type: &'static str,
    /// State and its reason.
    #[serde(flatten)]
    pub state: RouteState,
    /// True where a program is known at the source: there is a connection to a publisher, of a service to its server,
    /// or a look at the middleware has found one.
    pub has_source: bool,
    /// Quality of service in use at the source, where its middleware has one.
    pub from_qos: Option<Qos>,
    /// Quality of service in use at the destination.
    pub to_qos: Option<Qos>,
    /// Numbers of messages that went through and that were dropped.
    pub counters: CountersSnapshot,
    /// Number of messages a second, to a tenth, that were handed to the destination in the last second, or up to two.
    pub messages_per_s: f64,
    /// Number of bytes a second, as the destination's wire counts them.
    pub bytes_per_s: u64,
    /// Number of panics of the route, each of which closed both its ends for a while.
    #[serde(skip_serializing_if = "is_zero")]
    pub panics: u64,
    /// Numbers of routes and names, of a pattern.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[doc(hidden)]
    pub pattern: Option<PatternCounts>,
}

impl RouteStatus {
    /// Status of a route that carries nothing yet. A service shows its offered end first.
    pub(super) fn idle(
        name: &str,
        (interaction, source, destination): (Interaction, &EndpointAddress, &EndpointAddress),
        message_type: &'static str,
        state: RouteState,
    ) -> Self {
        let [from, to] = interaction.in_direction(source, destination);
        Self {
            name: name.to_owned(),
            from: from.to_string(),
            to: to.to_string(),
            interaction,
            message_type,
            state,
            has_source: false,
            from_qos: None,
            to_qos: None,
            counters: CountersSnapshot::default(),
            messages_per_s: 0.0,
            bytes_per_s: 0,
            panics: 0,
            pattern: None,
        }
    }

    /// Status of a route, or of a pattern, that runs as it stands in its plan.
    pub(super) fn planned(route: &Route, state: RouteState) -> Self {
        let label = if route.is_many() { "by pattern" } else { route.label() };
        Self::idle(&route.name, (route.interaction(), &route.from, &route.to), label, state)
    }
}

fn is_zero(number: &u64) -> bool {
    *number == 0
}

/// Numbers of a pattern's routes, and of names that have none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PatternCounts {
    /// Number of routes that exist.
    pub routes: usize,
    /// Number of names without a route; each of them has a status that says why.
    pub waiting: usize,
    /// Number of names beyond `max_routes`.
    pub over_limit: usize,
    /// Number of routes made since the start.
    pub made: u64,
    /// Number of routes that ended.
    pub ended: u64,
}
