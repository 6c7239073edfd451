//! Configuration to routes: every name parsed, every conflict found before anything is opened.

use std::collections::BTreeMap;

use super::config::Config;
use super::config_error::{ConfigError, Problem};
use super::plan_address::Available;
use super::plan_entry::Reader;
use super::route::{Kind, Route, RouteKey};
use wrapyfi_endpoint::{EndpointAddress, Role};
use wrapyfi_interfaces::store::TypeStore;

/// The routes of a configuration, checked.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_engine as engine; }
/// use std::collections::BTreeMap;
/// use wrapyfi_core::engine::{Available, Config, Plan};
/// use wrapyfi_interfaces::store::TypeStore;
/// let text = "routes:\n  - from: zeromq:/camera\n    to: ros2:/camera\n    type: Image\n";
/// let config: Config<BTreeMap<String, String>> = Config::from_yaml(text, "bridge.yaml")?;
/// let middlewares = ["zeromq", "ros2"].map(|name| Available { name, ..Available::default() });
/// let plan = Plan::new(&config, &middlewares, &mut TypeStore::generated(), "bridge.yaml")?;
/// assert_eq!(plan.routes[0].to.to_string(), "ros2:/camera");
/// assert!(plan.uses("zeromq") && !plan.uses("yarp"));
/// # Ok::<(), wrapyfi_engine::ConfigError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// Routes and patterns, in the order of the file.
    pub routes: Vec<Route>,
}

impl Plan {
    /// Names of the middlewares on which routes have ends, each as often as it is named.
    pub fn middlewares(&self) -> impl Iterator<Item = &str> {
        let ends = self.routes.iter().flat_map(|route| [&route.from, &route.to]);
        ends.map(|end| end.middleware.as_str())
    }

    /// True where an end of a route is on this middleware.
    pub fn uses(&self, middleware: &str) -> bool {
        self.middlewares().any(|name| name == middleware)
    }

    /// True where other programs connect to an end of a route on this middleware, as they do unless
    /// it only calls services.
    pub fn is_reached_on(&self, middleware: &str) -> bool {
        self.routes.iter().any(|route| {
            let is_called = matches!(route.kind, Kind::Service(_)) && route.is_whole();
            route.to.middleware == middleware || (route.from.middleware == middleware && !is_called)
        })
    }

    /// True where a service has an end on this middleware.
    pub fn has_services_on(&self, middleware: &str) -> bool {
        let services = self.routes.iter().filter(|it| matches!(it.kind, Kind::Service(_)));
        services.flat_map(|it| [&it.from, &it.to]).any(|end| end.middleware == middleware)
    }

    /// Size of the largest message of a route with an end on this middleware, in bytes.
    pub fn largest_message_on(&self, middleware: &str) -> usize {
        let on =
            |route: &&Route| [&route.from, &route.to].iter().any(|it| it.middleware == middleware);
        let bytes = self.routes.iter().filter(on).map(|route| route.policy.limits.message_bytes);
        bytes.max().unwrap_or(0)
    }

    /// As [`Plan::read`]; `file` is the name of the configuration in errors.
    ///
    /// # Errors
    /// When there are faults, all of them.
    pub fn new<E>(
        config: &Config<E>,
        middlewares: &[Available<'_>],
        types: &mut TypeStore,
        file: &str,
    ) -> Result<Self, ConfigError> {
        let (plan, problems) = Self::read(config, middlewares, types);
        match problems.is_empty() {
            true => Ok(plan),
            false => Err(ConfigError { file: file.to_owned(), problems }),
        }
    }

    /// Checks `config` against the middlewares that exist, and looks its types up in `types`. Beside the routes whose
    /// ends can be read are the faults, all of them: unknown middlewares and types, bad names and numbers, routes that
    /// are given twice, destinations with two routes without `merge: true`.
    #[doc(hidden)]
    pub fn read<E>(
        config: &Config<E>,
        middlewares: &[Available<'_>],
        types: &mut TypeStore,
    ) -> (Self, Vec<Problem>) {
        let mut reader = Reader::new(&config.defaults, middlewares, types);
        let mut routes: Vec<Route> = Vec::with_capacity(config.routes.len());
        let mut seen: BTreeMap<RouteKey, u64> = BTreeMap::new();
        let mut into: BTreeMap<(Role, EndpointAddress), (u64, bool)> = BTreeMap::new();
        let mut names = BTreeMap::new();
        if config.routes.is_empty() {
            let message = "no routes: nothing to do".to_owned();
            reader.problems.push(Problem { position: None, message });
        }
        for entry in &config.routes {
            let Some(route) = reader.read(entry) else { continue };
            let (line, key) = (entry.referenced.line(), route.key());
            let place = (key.role, key.to.clone());
            let merges = entry.value.merge;
            let taken = into.get(&place).filter(|(_, others)| !(*others && merges));
            let fault = match (seen.insert(key, line), taken) {
                (Some(first), _) => {
                    Some(format!("route {} stands already in {}", route.ends(), at(first)))
                }
                (None, Some((first, _))) if !route.is_many() => Some(match route.kind {
                    Kind::Service(_) => {
                        format!("{} already offers a service as {}", at(*first), route.to)
                    }
                    Kind::Topic(_) => format!(
                        "{} already routes to {}; write merge: true on both to mix them",
                        at(*first),
                        route.to
                    ),
                }),
                _ => None,
            };
            let named = entry.value.name.as_ref().and_then(|name| names.insert(name, line));
            let named = named.map(|first| {
                format!("{} already has the name {}; give each its own", at(first), route.name)
            });
            let faults = fault.into_iter().chain(named);
            reader.problems.extend(faults.map(|text| Problem::at(entry.referenced, text)));
            if !route.is_many() {
                into.entry(place).or_insert((line, merges));
            }
            routes.push(route);
        }
        (Self { routes }, reader.problems)
    }
}

/// Place of an entry in words, by its line; one that a running bridge was told to add has none.
fn at(line: u64) -> String {
    if line == 0 { "an entry that was added".to_owned() } else { format!("line {line}") }
}

#[cfg(test)]
#[path = "plan_tests.rs"]
mod tests;
