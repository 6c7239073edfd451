//! What is other in one plan than in another.
//!
//! ```text
//!   + yarp:/cam -> ros2:/cam  sensor_msgs/msg/Image  queue 10 drop_oldest     a route that begins
//!   - yarp:/old -> ros2:/old  …                                               one that ends
//!   ~ yarp:/arm -> ros2:/arm  … queue 10 drop_oldest                          one that begins anew,
//!     now  yarp:/arm -> ros2:/arm  … queue 50 drop_oldest                     with other settings
//! ```

use std::collections::BTreeMap;
use std::fmt;

use super::plan::Plan;
use super::plan_pattern::PatternSpec;
use super::route::Route;
use crate::Limits;
use crate::endpoint::UnknownMiddleware;
use crate::types::Map;

/// What a plan changes of the one before it, an entry a route or pattern, in the order of their ends.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PlanDiff {
    /// Routes and patterns that only the new plan has.
    pub added: Vec<String>,
    /// Those that only the old one has.
    pub removed: Vec<String>,
    /// Those with other settings: as they were, and as they are.
    pub changed: Vec<(String, String)>,
    /// Number of those that are the same in both.
    pub kept: usize,
}

/// Why a plan cannot hold while the routes run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ApplyError {
    /// The plan has an end on a middleware that was not started.
    #[error("{0}; to use another middleware, start the program anew")]
    Unknown(UnknownMiddleware),
}

/// An entry of a plan.
#[derive(PartialEq)]
enum Entry {
    Route(Route),
    Pattern(Box<PatternSpec>),
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Route(Route::Topic(spec)) => spec.fmt(f),
            Self::Route(Route::Service(spec)) => spec.fmt(f),
            Self::Pattern(spec) => spec.fmt(f),
        }
    }
}

impl Plan {
    /// What `new` changes of this plan.
    #[must_use]
    pub fn diff(&self, new: &Self) -> PlanDiff {
        let (mut before, after) = (self.entries(), new.entries());
        let mut diff = PlanDiff::default();
        for (ends, entry) in after {
            match before.remove(&ends) {
                None => diff.added.push(entry.to_string()),
                Some(same) if same == entry => diff.kept += 1,
                Some(old) => diff.changed.push(shown_apart(&old, &entry)),
            }
        }
        diff.removed = before.into_values().map(|entry| entry.to_string()).collect();
        diff
    }

    /// Routes and patterns by what makes them the same: their ends.
    fn entries(&self) -> BTreeMap<String, Entry> {
        let topics = self.routes.iter().map(|spec| Route::Topic(Box::new(spec.clone())));
        let services = self.services.iter().map(|spec| Route::Service(Box::new(spec.clone())));
        let routes = topics.chain(services).map(|route| {
            let key = route.key();
            (format!("{} {} -> {}", key.role, key.from, key.to), Entry::Route(route))
        });
        let pattern = |spec: &PatternSpec| (spec.ends(), Entry::Pattern(Box::new(spec.clone())));
        let patterns = self.patterns.iter().map(pattern);
        routes.chain(patterns).collect()
    }
}

/// Two entries in words that differ.
fn shown_apart(old: &Entry, new: &Entry) -> (String, String) {
    let (mut before, mut after) = (old.to_string(), new.to_string());
    if before == after {
        for (text, entry) in [(&mut before, old), (&mut after, new)] {
            text.push_str(&match entry {
                Entry::Route(Route::Topic(spec)) => details_of_topic(spec),
                Entry::Route(Route::Service(spec)) => details_of_service(spec),
                Entry::Pattern(spec) => {
                    let details = match &spec.carried {
                        super::Carried::Topics { template, .. } => details_of_topic(template),
                        super::Carried::Services { template, .. } => details_of_service(template),
                    };
                    format!("  name {:?}{details}", spec.name)
                }
            });
        }
    }
    (before, after)
}

/// Settings that the usual text leaves out.
fn details_of_topic(spec: &super::RouteSpec) -> String {
    format!("  qos {}{}", spec.qos.qos(), details(&spec.name, spec.limits, &spec.options))
}

/// As [`details_of_topic`].
fn details_of_service(spec: &super::ServiceRouteSpec) -> String {
    details(&spec.name, spec.limits, &spec.options)
}

fn details(name: &str, limits: Limits, options: &Map) -> String {
    let options: Vec<String> = options
        .iter()
        .map(|(name, value)| format!("{}: {value:?}", name.as_str().unwrap_or_default()))
        .collect();
    let (bytes, options) = (limits.message_bytes, options.join(", "));
    format!("  name {name:?}  messages up to {bytes} bytes  options {{{options}}}")
}

impl PlanDiff {
    /// True where the plans mean the same.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.added.is_empty() && self.removed.is_empty() && self.changed.is_empty()
    }

    /// The numbers, in a line.
    #[must_use]
    pub fn summary(&self) -> String {
        let Self { added, removed, changed, kept } = self;
        let (added, removed, changed) = (added.len(), removed.len(), changed.len());
        format!("{added} added, {removed} removed, {changed} changed, {kept} the same")
    }
}

impl fmt::Display for PlanDiff {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for text in &self.removed {
            writeln!(f, "- {text}")?;
        }
        for (before, after) in &self.changed {
            writeln!(f, "~ {before}\n  now  {after}")?;
        }
        for text in &self.added {
            writeln!(f, "+ {text}")?;
        }
        f.write_str(&self.summary())
    }
}
