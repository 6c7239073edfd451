//! Routes whose ends or types are found while running.
//!
//! ```text
//!   { from: "ros:/(.*)", to: "ros2:/$1" }          many topics, types learned   ─┐
//!   { service: "ros:/(.*)", as: "ros2:/$1" }       many services                 ├─▶ PatternSpec
//!   { from: "ros:/chatter", to: "ros2:/chatter" }  one topic, its type learned  ─┘
//! ```
//!
//! All other keys are those of any route, and hold for each that the pattern makes.

use std::fmt;

use wrapyfi_interfaces::store::TypeStore;

use super::config::{Defaults, RouteConfig, Spanned};
use super::config_error::Problem;
use super::pattern::{Inverse, NamePattern, is_denied_service, is_denied_topic, is_pattern};
use super::plan::{Available, RouteSpec, route_spec};
use super::plan_address::{address, middleware_of};
use super::plan_service::{self, ServiceRouteSpec};
use super::route::RouteKey;
use crate::endpoint::{EndpointAddress, Role};
use crate::plugin::DeviceMaps;
use crate::types::{MessageType, ServiceKind};

/// Most routes that one pattern makes, unless `max_routes` says otherwise.
pub const MAX_PATTERN_ROUTES: usize = 1000;
/// The most that `max_routes` may say.
const MOST_ROUTES: usize = 10_000;

/// What a pattern takes.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// One topic or service, whose type is not known yet.
    One(EndpointAddress),
    /// All whose names match.
    Names {
        /// Where they are.
        middleware: String,
        /// Their names.
        pattern: NamePattern,
        /// Only these, where there are any.
        allow: Vec<NamePattern>,
        /// Not these.
        deny: Vec<NamePattern>,
        /// Nor what is hidden or a node's own.
        default_deny: bool,
    },
}

/// What the routes of a pattern carry.
#[derive(Debug, Clone, PartialEq)]
pub enum Carried {
    /// Messages.
    Topics {
        /// All but the names, and the type where it is learned.
        template: Box<RouteSpec>,
        /// The type is the template's.
        typed: bool,
        /// The type where nobody tells one.
        otherwise: Option<MessageType>,
    },
    /// Requests and replies.
    Services {
        /// All but the names, and the type where it is learned.
        template: Box<ServiceRouteSpec>,
        /// The type is the template's.
        typed: bool,
        /// The type where nobody tells one.
        otherwise: Option<ServiceKind>,
    },
}

/// Routes that are made when what they take is there.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternSpec {
    /// Name in tables, logs and errors.
    pub name: String,
    /// What is taken.
    pub from: Source,
    /// Where it goes; a name that refers to the groups of the pattern, where that is one.
    pub to: EndpointAddress,
    /// What is carried.
    pub carried: Carried,
    /// Most routes.
    pub max_routes: usize,
}

impl PatternSpec {
    /// Where its sources are.
    #[must_use]
    pub fn source_middleware(&self) -> &str {
        match &self.from {
            Source::One(address) => &address.middleware,
            Source::Names { middleware, .. } => middleware,
        }
    }

    /// True for a pattern, false for one route whose type is learned.
    #[must_use]
    pub fn is_many(&self) -> bool {
        matches!(self.from, Source::Names { .. })
    }

    /// The role that sources have.
    #[must_use]
    pub fn role(&self) -> Role {
        match self.carried {
            Carried::Topics { .. } => Role::Publisher,
            Carried::Services { .. } => Role::Server,
        }
    }

    /// Where the source called `name` goes; `None` where it is not meant.
    #[must_use]
    pub fn target(&self, name: &str) -> Option<EndpointAddress> {
        let to = match &self.from {
            Source::One(address) => (address.name == name).then(|| self.to.name.clone()),
            Source::Names { middleware, pattern, allow, deny, default_deny } => {
                let denied = match self.carried {
                    Carried::Topics { .. } => is_denied_topic(middleware, name),
                    Carried::Services { .. } => is_denied_service(middleware, name),
                };
                let allowed = allow.is_empty() || allow.iter().any(|one| one.matches(name));
                if !name.starts_with('/')
                    || (*default_deny && denied)
                    || !allowed
                    || deny.iter().any(|one| one.matches(name))
                {
                    return None;
                }
                pattern.expand(name, &self.to.name)
            }
        }?;
        Some(EndpointAddress { middleware: self.to.middleware.clone(), name: to })
    }

    /// What leads from a name at the destination back to the source, where that can be told.
    pub(super) fn inverse(&self) -> Option<Inverse> {
        match &self.from {
            Source::One(_) => None,
            Source::Names { pattern, .. } => Inverse::new(pattern, &self.to.name),
        }
    }

    /// Ends of a route whose type is learned; none of a pattern.
    pub(super) fn key_of_one(&self) -> Option<RouteKey> {
        let Source::One(from) = &self.from else { return None };
        Some(RouteKey { role: self.role(), from: from.clone(), to: self.to.clone() })
    }

    /// True where routes of both between the same ends are the same.
    pub(super) fn makes_the_same(&self, other: &Self) -> bool {
        // Routes of a pattern are named after their ends.
        let named = |carried: &Carried| {
            let mut carried = carried.clone();
            match &mut carried {
                Carried::Topics { template, .. } => template.name.clear(),
                Carried::Services { template, .. } => template.name.clear(),
            }
            carried
        };
        self.is_many() == other.is_many()
            && (self.is_many() || self.name == other.name)
            && named(&self.carried) == named(&other.carried)
    }

    /// Its ends as they were written.
    pub(super) fn ends(&self) -> String {
        match &self.from {
            Source::One(address) => format!("route {address} -> {}", self.to),
            Source::Names { middleware, pattern, .. } => {
                format!("{:?} {middleware}:{pattern} -> {}", self.role(), self.to).to_lowercase()
            }
        }
    }

    /// The largest message that a route of it takes, in bytes.
    #[must_use]
    pub fn largest_message(&self) -> usize {
        match &self.carried {
            Carried::Topics { template, .. } => template.limits.message_bytes,
            Carried::Services { template, .. } => template.limits.message_bytes,
        }
    }
}

impl fmt::Display for PatternSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let from = match &self.from {
            Source::One(address) => address.to_string(),
            Source::Names { middleware, pattern, .. } => format!("{middleware}:{pattern}"),
        };
        let (typed, what) = match &self.carried {
            Carried::Topics { template, typed, .. } => (*typed, template.message_type.label()),
            Carried::Services { template, typed, .. } => (*typed, template.kind.ros_type()),
        };
        match self.carried {
            Carried::Topics { .. } => write!(f, "{from} -> {}", self.to)?,
            Carried::Services { .. } => write!(f, "{} -> {from}", self.to)?,
        }
        write!(f, "  {}", if typed { what } else { "type learned" })?;
        if let Carried::Topics { template, .. } = &self.carried {
            template.show_header(f)?;
        }
        let Source::Names { allow, deny, .. } = &self.from else { return Ok(()) };
        for (word, list) in [("allow", allow), ("deny", deny)] {
            if !list.is_empty() {
                let list: Vec<String> = list.iter().map(NamePattern::to_string).collect();
                write!(f, "  {word} {}", list.join(" "))?;
            }
        }
        write!(f, "  at most {} routes", self.max_routes)
    }
}

/// True for an entry whose ends or type are found while running.
pub(super) fn is_found_later(config: &RouteConfig) -> bool {
    let source = config.from.as_ref().or(config.service.as_ref());
    config.message_type.is_none() || source.is_some_and(|source| is_pattern(&source.value))
}

/// What only patterns have, given elsewhere.
pub(super) fn misplaced(config: &RouteConfig) -> Vec<Problem> {
    let only = "has no effect: `from` (or `service`) is no pattern such as \"ros:/(.*)\"";
    let places = [
        ("allow", config.allow.as_ref().map(|it| it.referenced)),
        ("deny", config.deny.as_ref().map(|it| it.referenced)),
        ("default_deny", config.default_deny.as_ref().map(|it| it.referenced)),
        ("max_routes", config.max_routes.as_ref().map(|it| it.referenced)),
    ];
    let source = config.from.as_ref().or(config.service.as_ref());
    let many = source.is_some_and(|source| is_pattern(&source.value));
    let given = places.into_iter().filter_map(|(key, place)| Some((key, place.filter(|_| !many)?)));
    let mut problems: Vec<_> =
        given.map(|(key, place)| Problem::at(place, format!("{key} {only}"))).collect();
    if let (Some(_), Some(otherwise)) = (&config.message_type, &config.type_if_unknown) {
        let text = "type_if_unknown has no effect: type is given".to_owned();
        problems.push(Problem::at(otherwise.referenced, text));
    }
    problems
}

/// Reads an entry for which [`is_found_later`] holds.
pub(super) fn read(
    entry: &Spanned<RouteConfig>,
    defaults: &Defaults,
    default_devices: &DeviceMaps,
    middlewares: &[Available<'_>],
    types: &mut TypeStore,
) -> Result<PatternSpec, Vec<Problem>> {
    let is_service = plan_service::is_service(&entry.value);
    let (from_key, to_key) = if is_service { ("service", "as") } else { ("from", "to") };
    let config = &entry.value;
    let (from, to) =
        if is_service { (&config.service, &config.offered) } else { (&config.from, &config.to) };
    let (Some(from), Some(to)) = (from, to) else {
        let missing = if from.is_none() { from_key } else { to_key };
        let text =
            format!("key `{missing}` is missing: a route has from and to, or service and as");
        return Err(vec![Problem::at(entry.referenced, text)]);
    };
    let (source, target) = ends(from, to, (from_key, to_key), config, middlewares)?;
    let mut problems = Vec::new();
    let many = is_pattern(&from.value);
    let typed = config.message_type.is_some();
    let otherwise = config.type_if_unknown.as_ref().filter(|_| !typed);
    let max_routes = config.max_routes.as_ref().filter(|_| many);
    if let Some(own) = max_routes.filter(|own| !(1..=MOST_ROUTES).contains(&own.value)) {
        let text = format!("max_routes is {}, it must lie between 1 and {MOST_ROUTES}", own.value);
        problems.push(Problem::at(own.referenced, text));
    }
    if let Some(own) = config.from_type.as_ref().filter(|_| !typed) {
        let text = "from_type needs a type: give both, or neither".to_owned();
        problems.push(Problem::at(own.referenced, text));
    }
    let plain = stand_in(entry, (from, to), is_service, many);
    let carried = if is_service {
        let otherwise = otherwise.and_then(|text| {
            let read = ServiceKind::resolve(&text.value, types);
            read.map_err(|fault| problems.push(Problem::at(text.referenced, fault.to_string())))
                .ok()
        });
        plan_service::read(&plain, defaults, middlewares, types)
            .map(Box::new)
            .map(|template| Carried::Services { template, typed, otherwise })
    } else {
        let otherwise = otherwise.and_then(|text| {
            let read = MessageType::resolve(&text.value, types);
            read.map_err(|fault| problems.push(Problem::at(text.referenced, fault.to_string())))
                .ok()
        });
        route_spec(&plain, defaults, default_devices, middlewares, types).map(|mut template| {
            template.lazy = config.lazy.as_ref().map_or(many, |lazy| lazy.value);
            Carried::Topics { template: Box::new(template), typed, otherwise }
        })
    };
    match carried {
        Ok(carried) if problems.is_empty() => {
            let written = match is_service {
                true => format!("{} -> {}", to.value, from.value),
                false => format!("{} -> {}", from.value, to.value),
            };
            let name = config.name.clone().unwrap_or(written);
            let max_routes = max_routes.map_or(MAX_PATTERN_ROUTES, |own| own.value);
            Ok(PatternSpec { name, from: source, to: target, carried, max_routes })
        }
        carried => {
            problems.extend(carried.err().unwrap_or_default());
            Err(problems)
        }
    }
}

/// The entry as one of a plain route between the same middlewares: everything but names and types is
/// read as there.
fn stand_in(
    entry: &Spanned<RouteConfig>,
    (from, to): (&Spanned<String>, &Spanned<String>),
    is_service: bool,
    many: bool,
) -> Spanned<RouteConfig> {
    let mut plain = entry.clone();
    let config = &mut plain.value;
    let named = |text: &Spanned<String>, name: &str| {
        let middleware = text.value.split(':').next().unwrap_or_default();
        Some(Spanned { value: format!("{middleware}:{name}"), ..text.clone() })
    };
    let ends = (named(from, "/pattern_source"), named(to, "/pattern_destination"));
    if is_service {
        (config.service, config.offered) = ends;
    } else {
        (config.from, config.to) = ends;
    }
    if config.message_type.is_none() {
        let text = Spanned { value: "NativeObject".to_owned(), ..from.clone() };
        (config.message_type, config.type_if_unknown, config.from_type) = (Some(text), None, None);
    }
    if many {
        (config.allow, config.deny) = (None, None);
        (config.default_deny, config.max_routes) = (None, None);
    }
    plain
}

/// What is taken, and where it goes.
fn ends(
    from: &Spanned<String>,
    to: &Spanned<String>,
    (from_key, to_key): (&str, &str),
    config: &RouteConfig,
    middlewares: &[Available<'_>],
) -> Result<(Source, EndpointAddress), Vec<Problem>> {
    let mut problems = Vec::new();
    let mut note = |problem| problems.push(problem);
    if !is_pattern(&from.value) {
        let source = address(from, middlewares).map_err(&mut note).ok();
        let target = address(to, middlewares).map_err(&mut note).ok();
        return match (source, target) {
            (Some(source), Some(target)) if source == target => {
                let text = format!("route from {source} to itself: it would loop");
                Err(vec![Problem::at(from.referenced, text)])
            }
            (Some(source), Some(target)) => Ok((Source::One(source), target)),
            _ => Err(problems),
        };
    }
    let source = middleware_of(from, middlewares).map_err(&mut note).ok();
    let target = middleware_of(to, middlewares).map_err(&mut note).ok();
    let mut compile = |key: &str, text: &Spanned<String>, written: &str| {
        let compiled = NamePattern::new(written);
        let wrong = |fault| format!("{key} {written:?} is no regular expression: {fault}");
        compiled.map_err(|fault| note(Problem::at(text.referenced, wrong(fault)))).ok()
    };
    let pattern = source.as_ref().and_then(|source| compile(from_key, from, &source.name));
    let mut list = |key: &str, list: &Option<Spanned<Vec<Spanned<String>>>>| {
        let all = list.iter().flat_map(|list| &list.value);
        all.filter_map(|text| compile(key, text, &text.value)).collect::<Vec<_>>()
    };
    let (allow, deny) = (list("allow", &config.allow), list("deny", &config.deny));
    if let (Some(pattern), Some(target)) = (&pattern, &target) {
        let without = target.name.replace(['$', '{', '}'], "");
        if is_pattern(&without) {
            let text = format!(
                "{to_key} {:?} is a pattern; only {from_key} is one, and {to_key} refers to its \
                 groups by $1 or ${{name}}",
                to.value
            );
            note(Problem::at(to.referenced, text));
        } else if let Err(fault) = pattern.check_template(&target.name) {
            note(Problem::at(to.referenced, format!("{to_key} {:?}: {fault}", to.value)));
        }
    }
    let (Some(source), Some(target), Some(pattern), true) =
        (source, target, pattern, problems.is_empty())
    else {
        return Err(problems);
    };
    if source.middleware == target.middleware
        && pattern.expand("/a", &target.name).is_some_and(|it| it == "/a")
    {
        let text = format!("{} to {}: every topic would go to itself", from.value, to.value);
        return Err(vec![Problem::at(from.referenced, text)]);
    }
    let default_deny = config.default_deny.as_ref().is_none_or(|on| on.value);
    let middleware = source.middleware;
    Ok((Source::Names { middleware, pattern, allow, deny, default_deny }, target))
}

#[cfg(test)]
#[path = "plan_pattern_tests.rs"]
mod tests;
