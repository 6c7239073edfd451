//! Differences between two plans.
//!
//! ```text
//!   + yarp:/cam -> ros2:/cam  topic  sensor_msgs/msg/Image  queue 10 …     a route that begins
//!   - yarp:/old -> ros2:/old  …                                               one that ends
//!   ~ yarp:/arm -> ros2:/arm  … queue 10 drop_oldest                          one that begins anew,
//!     now  yarp:/arm -> ros2:/arm  … queue 50 drop_oldest                     with other settings
//! ```

use std::collections::BTreeMap;
use std::fmt;

use super::plan::Plan;
use super::route::Route;

/// Changes from one plan to the next: an entry for each route or pattern, in the order of their
/// ends.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_engine as engine, wrapyfi_data::types}; }
/// use wrapyfi_core::engine::{Plan, Route};
/// use wrapyfi_core::types::MessageType;
/// let route = Route::topic("zeromq:/a".parse()?, "ros2:/a".parse()?, MessageType::Image);
/// let diff = Plan::default().diff(&Plan { routes: vec![route] });
/// assert_eq!((diff.added.len(), diff.removed.len(), diff.kept), (1, 0, 0));
/// # Ok::<(), wrapyfi_endpoint::ParseAddressError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PlanDiff {
    /// Routes and patterns that only the new plan has.
    pub added: Vec<String>,
    /// Routes and patterns that only the old plan has.
    pub removed: Vec<String>,
    /// Routes and patterns with other settings: as they were, and as they are.
    pub changed: Vec<(String, String)>,
    /// Number of routes and patterns that are the same in both plans.
    pub kept: usize,
}

impl Plan {
    /// Changes from this plan to `new`.
    pub fn diff(&self, new: &Self) -> PlanDiff {
        let by_key = |route| (Route::key(route), route);
        let mut before: BTreeMap<_, _> = self.routes.iter().map(by_key).collect();
        let after: BTreeMap<_, _> = new.routes.iter().map(by_key).collect();
        let mut diff = PlanDiff::default();
        for (key, route) in after {
            match before.remove(&key) {
                None => diff.added.push(route.to_string()),
                Some(same) if same == route => diff.kept += 1,
                Some(old) => diff.changed.push(shown_apart(old, route)),
            }
        }
        diff.removed = before.into_values().map(Route::to_string).collect();
        diff
    }
}

/// Two routes in words that differ: settings that the usual text leaves out are added to it.
fn shown_apart(old: &Route, new: &Route) -> (String, String) {
    let (mut before, mut after) = (old.to_string(), new.to_string());
    let settings = |route| serde_json::to_value(route).unwrap_or_default();
    let (was, is) = (settings(old), settings(new));
    if let (true, Some(was), Some(is)) = (before == after, was.as_object(), is.as_object()) {
        for (key, value) in is {
            let value_before = was.get(key).unwrap_or(&serde_json::Value::Null);
            if value != value_before {
                before.push_str(&format!("  {key} {value_before}"));
                after.push_str(&format!("  {key} {value}"));
            }
        }
    }
    (before, after)
}

impl PlanDiff {
    /// True when the plans mean the same.
    pub fn is_empty(&self) -> bool {
        self.added.is_empty() && self.removed.is_empty() && self.changed.is_empty()
    }

    /// Numbers of changes, in a line.
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
