//! A route's state, as data that can be printed and serialised.

use std::fmt;

use serde::Serialize;

use crate::endpoint::{CountersSnapshot, Qos};

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
    /// Says that a route has come into this state. Of a route that is one of many made by a pattern, who
    /// comes and goes is worth no line of its own.
    pub(super) fn log(&self, route: &str, is_one_of_many: bool) {
        match self {
            Self::Error(_) => tracing::error!(route, "{self}"),
            Self::Degraded(_) => tracing::warn!(route, "{self}"),
            _ if is_one_of_many => tracing::debug!(route, "{self}"),
            _ => tracing::info!(route, "{self}"),
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
    /// Of a pattern: what has become of what it means.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<PatternCounts>,
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
