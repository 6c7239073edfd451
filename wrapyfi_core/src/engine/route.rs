//! A route as data: its key, what is to be run, and its state, which can be printed and serialised.

use std::fmt;

use serde::Serialize;

use super::plan::RouteSpec;
use super::plan_service::ServiceRouteSpec;
use crate::endpoint::{CountersSnapshot, EndpointAddress, Qos, Role};

/// A route by its ends. What two plans say of one key is about the same route.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RouteKey {
    /// Role of the endpoints that the route takes from: publisher for topics, server for services.
    pub role: Role,
    /// Source of messages, or where a service has its server.
    pub from: EndpointAddress,
    /// Destination of messages, or where a service is offered.
    pub to: EndpointAddress,
}

/// A route as it is to be run.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Route {
    Topic(Box<RouteSpec>),
    Service(Box<ServiceRouteSpec>),
}

impl Route {
    pub(super) fn key(&self) -> RouteKey {
        match self {
            Self::Topic(spec) => spec.key(),
            Self::Service(spec) => spec.key(),
        }
    }

    /// True for a route that a pattern made, which is one of many.
    pub(super) fn is_one_of_many(&self) -> bool {
        match self {
            Self::Topic(spec) => spec.mark.is_some(),
            Self::Service(spec) => spec.mark.is_some(),
        }
    }

    /// ROS name of the type that it carries.
    pub(super) fn label(&self) -> &'static str {
        match self {
            Self::Topic(spec) => spec.message_type.label(),
            Self::Service(spec) => spec.kind.ros_type(),
        }
    }
}

impl RouteSpec {
    /// The route's ends.
    #[must_use]
    pub fn key(&self) -> RouteKey {
        RouteKey { role: Role::Publisher, from: self.from.clone(), to: self.to.clone() }
    }
}

impl ServiceRouteSpec {
    /// The route's ends.
    #[must_use]
    pub fn key(&self) -> RouteKey {
        RouteKey { role: Role::Server, from: self.service.clone(), to: self.offered.clone() }
    }
}

/// What a route does at the moment. Every state but [`RouteState::Active`] says why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "state", content = "reason", rename_all = "snake_case")]
pub enum RouteState {
    /// Nothing can flow yet; names what is waited for.
    Waiting(String),
    /// Messages flow, or will as soon as there is one.
    Active,
    /// Messages flow, but some were lost lately; names the last cause.
    Degraded(String),
    /// Can never flow as configured; names what to change.
    Error(String),
}

impl RouteState {
    /// One word, for tables.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Waiting(_) => "waiting",
            Self::Active => "active",
            Self::Degraded(_) => "degraded",
            Self::Error(_) => "error",
        }
    }

    /// Why, where there is something to say.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        match self {
            Self::Active => None,
            Self::Waiting(reason) | Self::Degraded(reason) | Self::Error(reason) => Some(reason),
        }
    }
}

impl RouteState {
    /// Says that a route has come into this state, after so many that were not logged. Of a route that is
    /// one of many made by a pattern, who comes and goes is worth no line of its own.
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
        match (self, self.reason()) {
            (Self::Waiting(_), Some(what)) => write!(f, " for {what}"),
            (_, Some(reason)) => write!(f, ": {reason}"),
            (_, None) => Ok(()),
        }
    }
}

/// A route at one moment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RouteStatus {
    /// Name from the configuration.
    pub name: String,
    /// Source address.
    pub from: String,
    /// Destination address.
    pub to: String,
    /// ROS name of the type it carries.
    #[serde(rename = "type")]
    pub message_type: &'static str,
    /// What it does, and why.
    #[serde(flatten)]
    pub state: RouteState,
    /// Quality of service in use at the source, where its middleware has one.
    pub from_qos: Option<Qos>,
    /// Quality of service in use at the destination.
    pub to_qos: Option<Qos>,
    /// What went through and what did not.
    pub counters: CountersSnapshot,
    /// Panics of the route, each of which closed both its ends for a while.
    #[serde(skip_serializing_if = "is_zero")]
    pub panics: u64,
    /// Of a pattern: what has become of what it means.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<PatternCounts>,
}

fn is_zero(number: &u64) -> bool {
    *number == 0
}

/// What has become of the names that a pattern means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PatternCounts {
    /// Routes there are.
    pub routes: usize,
    /// Names of which there is no route; each says why by itself.
    pub waiting: usize,
    /// Names beyond `max_routes`.
    pub over_limit: usize,
    /// Routes made since the start.
    pub made: u64,
    /// Routes that ended.
    pub ended: u64,
}
