//! Reading of an entry of `routes` as a [`Route`], with all its faults at once, each with its line.

use std::time::Duration;

use serde_saphyr::Location;
use wrapyfi_interfaces::store::TypeStore;

use super::config::{Config, Defaults, OverflowConfig, RouteConfig};
use super::config_devices::DevicesConfig;
use super::plan_address::{address, middleware_of};
use super::plan_options;
use super::route::{Names, Policy, Route, RouteTypes, Types, Typing};
use wrapyfi_data::Limits;
use wrapyfi_data::codec::is_convertible;
use wrapyfi_data::plugin::DeviceMaps;
use wrapyfi_data::types::{DataType, Encoding, MessageType, RosAction, ServiceKind};
use wrapyfi_endpoint::config::{Problem, Spanned};
use wrapyfi_endpoint::driver::Available;
use wrapyfi_endpoint::pattern::{NamePattern, is_pattern};
use wrapyfi_endpoint::{Conventions, EndpointAddress, Interaction, QueueSpec};

/// Most routes that one pattern makes, unless `max_routes` says otherwise.
pub(crate) const MAX_PATTERN_ROUTES: usize = 1000;
/// Largest value of `max_routes`.
const MOST_ROUTES: usize = 10_000;
/// Longest time that a call may be given, in milliseconds: an hour.
const LONGEST_TIMEOUT_MS: u64 = 3_600_000;

/// Reader of entries, which collects their faults.
pub(super) struct Reader<'r> {
    defaults: &'r Defaults,
    /// Depth of a queue, and MiB of the largest message, of routes that do not set their own.
    default_sizes: [usize; 2],
    /// Bytes that may wait in the process, of which one message may take a quarter.
    waiting_bytes: usize,
    default_devices: DeviceMaps,
    middlewares: &'r [Available<'r>],
    types: &'r mut TypeStore,
    pub(super) problems: Vec<Problem>,
}

type Entry = Spanned<RouteConfig>;

impl<'r> Reader<'r> {
    pub(super) fn new<E>(
        config: &'r Config<E>,
        middlewares: &'r [Available<'r>],
        types: &'r mut TypeStore,
    ) -> Self {
        let defaults = &config.defaults;
        let waiting = config.limits.waiting_mib.as_ref().map(|mib| mib.value);
        let mut reader = Self {
            defaults,
            default_sizes: [10, 64],
            waiting_bytes: waiting
                .map_or(Limits::WAITING_BYTES, |mib| mib.saturating_mul(Limits::MIB)),
            default_devices: DeviceMaps::default(),
            middlewares,
            types,
            problems: Vec::new(),
        };
        reader.default_sizes = reader.sizes([&defaults.queue_depth, &defaults.max_message_mib]);
        reader.default_devices = reader.device_maps(defaults.devices.as_ref());
        reader
    }

    /// Depth of a queue and MiB of the largest message, as they are written, else those of the defaults.
    fn sizes(&mut self, written: [&Option<Spanned<usize>>; 2]) -> [usize; 2] {
        let mut sizes = self.default_sizes;
        let bounds = [("queue_depth", 100_000), ("max_message_mib", 2047)];
        for ((size, written), (key, most)) in sizes.iter_mut().zip(written).zip(bounds) {
            let Some(written) = written else { continue };
            *size = written.value;
            if !(1..=most).contains(size) {
                let text = format!("{key} is {size}, it must lie between 1 and {most}");
                self.complain(written.referenced, text);
            }
        }
        let [_, mib] = sizes;
        if let [_, Some(written)] = written
            && mib.saturating_mul(4 * Limits::MIB) > self.waiting_bytes
        {
            let (waiting, needed) = (self.waiting_bytes / Limits::MIB, mib.saturating_mul(4));
            let text = format!(
                "max_message_mib is {mib}, and one message may take a quarter of what waits in the process, which \
                 is {waiting} MiB: write `limits: {{ waiting_mib: {needed} }}`, or max_message_mib: {} at most",
                (waiting / 4).max(1)
            );
            self.complain(written.referenced, text);
        }
        sizes
    }

    /// Reads the route of an entry, and notes its faults; `None` where its ends cannot be read.
    pub(super) fn read(&mut self, entry: &Entry) -> Option<Route> {
        let interaction = entry.value.interaction();
        self.misplaced(entry, interaction);
        let ends = self.ends(entry, interaction);
        let types = self.types(&entry.value, interaction);
        let policy = self.policy(entry, interaction, ends.as_ref(), types);
        let (from, to, names) = ends?;
        let (types, typing) = types.unwrap_or((not_read(interaction), Typing::Given));
        let mut route = Route { names, typing, policy, ..Route::new(from, to, types) };
        if let RouteTypes::Topic(types) = &mut route.types {
            let has_text_type = |end| self.conventions(end).has_text_type;
            if *types == MessageType::StringJson.into()
                && [&route.from, &route.to].into_iter().all(has_text_type)
            {
                *types = MessageType::Text.into();
            }
        }
        if let Some(name) = &entry.value.name {
            route.name.clone_from(name);
        }
        Some(route)
    }

    fn conventions(&self, end: &EndpointAddress) -> Conventions {
        let known = self.middlewares.iter().find(|known| known.name == end.middleware);
        known.map_or(Conventions::NONE, |known| known.conventions)
    }

    fn complain(&mut self, at: Location, text: impl Into<String>) {
        self.problems.push(Problem::at(at, text.into()));
    }

    fn noted<T>(&mut self, read: Result<T, Problem>) -> Option<T> {
        read.map_err(|problem| self.problems.push(problem)).ok()
    }

    /// Notes the keys that mean nothing where they stand.
    fn misplaced(&mut self, entry: &Entry, interaction: Interaction) {
        let config = &entry.value;
        let [source, _] = config.ends();
        if !source.is_some_and(|source| is_pattern(&source.value)) {
            for (key, at) in [
                ("allow", place(&config.allow)),
                ("deny", place(&config.deny)),
                ("default_deny", place(&config.default_deny)),
                ("max_routes", place(&config.max_routes)),
            ] {
                let Some(at) = at else { continue };
                let only = "`from` (or `service`, `action`) is no pattern such as \"ros:/(.*)\"";
                self.complain(at, format!("{key} has no effect: {only}"));
            }
        }
        if let (Some(_), Some(otherwise)) = (&config.message_type, &config.type_if_unknown) {
            self.complain(otherwise.referenced, "type_if_unknown has no effect: type is given");
        }
        if let (Some(own), None) = (&config.from_type, &config.message_type) {
            let text = "from_type needs a type: give both, or neither";
            self.complain(own.referenced, text);
        }
        if interaction == Interaction::Topic {
            if let Some(timeout) = &config.timeout_ms {
                let text = "timeout_ms has no effect on topics: only services are answered";
                self.complain(timeout.referenced, text);
            }
            return;
        }
        for (key, written) in [("from", &config.from), ("to", &config.to)] {
            if let Some(written) = written {
                let text = format!(
                    "`{key}` stands beside {} {interaction}: give {interaction} and as only",
                    interaction.article()
                );
                self.complain(written.referenced, text);
            }
        }
        for (key, is_given) in [
            ("from_type", config.from_type.is_some()),
            ("qos", config.qos.is_some()),
            ("encoding", config.encoding.is_some()),
            ("frame_id", config.frame_id.is_some()),
            ("stamp", config.stamp.is_some()),
            ("queue_depth", config.queue_depth.is_some()),
            ("overflow", config.overflow.is_some()),
            ("max_rate_hz", config.max_rate_hz.is_some()),
            ("devices", config.devices.is_some()),
            ("lazy", config.lazy.is_some()),
            ("merge", config.merge),
            ("loop_guard", config.loop_guard.is_some()),
        ] {
            if is_given {
                let what = interaction.article();
                let text = format!("{key} has no effect on {what} {interaction}");
                self.complain(entry.referenced, text);
            }
        }
    }

    /// Reads both ends, and the names that are meant where the source is a pattern.
    fn ends(
        &mut self,
        entry: &Entry,
        interaction: Interaction,
    ) -> Option<(EndpointAddress, EndpointAddress, Option<Names>)> {
        let config = &entry.value;
        let ([from, to], [from_key, to_key]) = (config.ends(), interaction.keys());
        for (key, written) in [(from_key, from), (to_key, to)] {
            if written.is_none() {
                let text = format!(
                    "key `{key}` is missing: a route has from and to, or service and as, or action and as"
                );
                self.complain(entry.referenced, text);
            }
        }
        let is_many = from.is_some_and(|from| is_pattern(&from.value));
        let read = if is_many { middleware_of } else { address };
        let mut end = |written: Option<&Spanned<String>>| {
            let read = read(written?, self.middlewares);
            self.noted(read)
        };
        let (source, target) = (end(from), end(to));
        let names = match &source {
            Some(source) if is_many => {
                let target = target.as_ref().zip(to);
                Some(self.names(config, source, from?, target, [from_key, to_key])?)
            }
            _ => None,
        };
        let (source, target, from) = (source?, target?, from?);
        self.carried(config, interaction, [&source, &target], from.referenced);
        let goes_to_itself = match &names {
            None => source == target,
            Some(names) => {
                let target_of_a = names.pattern.expand("/a", &target.name);
                source.middleware == target.middleware && target_of_a.is_some_and(|it| it == "/a")
            }
        };
        if goes_to_itself {
            let text = match (&names, interaction) {
                (None, Interaction::Topic) => {
                    format!("route from {source} to itself: it would loop")
                }
                (None, called) => {
                    format!("{called} {source} is offered as itself: it would call itself")
                }
                (Some(_), _) => format!("{source} to {target}: every topic would go to itself"),
            };
            self.complain(from.referenced, text);
        }
        Some((source, target, names))
    }

    /// Notes where an end of a route has no such interaction, and where a setting is about functions alone, or they
    /// need one.
    fn carried(
        &mut self,
        config: &RouteConfig,
        interaction: Interaction,
        ends: [&EndpointAddress; 2],
        place: Location,
    ) {
        let is_end = |one: &&Available<'_>| ends.iter().any(|end| end.middleware == one.name);
        let at_ends = self.middlewares.iter().filter(is_end);
        let [source, destination] = ends;
        // A function stands for an action that its middleware does not have, but is offered as none.
        let has_function = |one: &&Available<'_>| {
            interaction == Interaction::Action
                && one.interactions.contains(&Interaction::Service)
                && one.name == source.middleware
                && one.name != destination.middleware
        };
        let lacks =
            |one: &&Available<'_>| !one.interactions.contains(&interaction) && !has_function(one);
        let carries = |one: &Available<'_>| {
            let words: Vec<_> = one.interactions.iter().map(|one| format!("{one}s")).collect();
            format!("{} carries {}", one.name, words.join(" and "))
        };
        let lacking: Vec<_> = at_ends.clone().filter(lacks).map(carries).collect();
        let is_function = at_ends
            .clone()
            .any(|one| !one.interactions.contains(&interaction) && has_function(&one));
        if is_function && config.message_type.is_none() && config.type_if_unknown.is_none() {
            let text = format!(
                "a function on {} does not tell the type of an action: give `type` as package/action/Type",
                source.middleware
            );
            self.complain(place, text);
        }
        if interaction == Interaction::Action
            && !is_function
            && let Some(timeout) = &config.timeout_ms
        {
            let text = "timeout_ms has no effect on an action whose server is one: it says itself when a goal has ended";
            self.complain(timeout.referenced, text);
        }
        if !lacking.is_empty() {
            let text = format!(
                "no route of {interaction}s is possible here: {}; leave it out, or write routes of its topics with \
                 from and to",
                lacking.join(", ")
            );
            self.complain(place, text);
        }
    }

    /// Reads the names that a pattern means.
    fn names(
        &mut self,
        config: &RouteConfig,
        source: &EndpointAddress,
        from: &Spanned<String>,
        target: Option<(&EndpointAddress, &Spanned<String>)>,
        [from_key, to_key]: [&str; 2],
    ) -> Option<Names> {
        let before = self.problems.len();
        let mut compile = |key: &str, text: &Spanned<String>, written: &str| {
            let wrong = |fault| format!("{key} {written:?} {fault}");
            let compiled = NamePattern::new(written);
            self.noted(compiled.map_err(|fault| Problem::at(text.referenced, wrong(fault))))
        };
        let pattern = compile(from_key, from, &source.name);
        let mut list = |key: &str, list: &Option<Spanned<Vec<Spanned<String>>>>| {
            let all = list.iter().flat_map(|list| &list.value);
            all.filter_map(|text| compile(key, text, &text.value)).collect::<Vec<_>>()
        };
        let (allow, deny) = (list("allow", &config.allow), list("deny", &config.deny));
        if let (Some(pattern), Some((target, to))) = (&pattern, target) {
            if is_pattern(&target.name.replace(['$', '{', '}'], "")) {
                let text = format!(
                    "{to_key} {:?} is a pattern; only {from_key} is one, and {to_key} refers to its \
                     groups by $1 or ${{name}}",
                    to.value
                );
                self.complain(to.referenced, text);
            } else if (target.name.contains('$') || !config.merge)
                && let Err(fault) = pattern.check_template(&target.name)
            {
                self.complain(to.referenced, format!("{to_key} {:?}: {fault}", to.value));
            }
        }
        let max_routes = config.max_routes.as_ref();
        if let Some(own) = max_routes.filter(|own| !(1..=MOST_ROUTES).contains(&own.value)) {
            let text =
                format!("max_routes is {}, it must lie between 1 and {MOST_ROUTES}", own.value);
            self.complain(own.referenced, text);
        }
        let max_routes = max_routes.map_or(MAX_PATTERN_ROUTES, |own| own.value);
        let default_deny = config.default_deny.as_ref().is_none_or(|on| on.value);
        let default_deny = default_deny.then(|| self.conventions(source));
        let ros_names = target.is_some_and(|(target, _)| self.conventions(target).has_ros_names);
        let from_ros_names = self.conventions(source).has_ros_names;
        let pattern = pattern?;
        let names =
            Names { pattern, allow, deny, default_deny, max_routes, ros_names, from_ros_names };
        (self.problems.len() == before).then_some(names)
    }

    /// Reads the types and their origin; `None` where they cannot be read.
    fn types(
        &mut self,
        config: &RouteConfig,
        interaction: Interaction,
    ) -> Option<(RouteTypes, Typing)> {
        let (typing, written) = match (&config.message_type, &config.type_if_unknown) {
            (Some(given), _) => (Typing::Given, Some(given)),
            (None, Some(otherwise)) => (Typing::LearnedIfTold, Some(otherwise)),
            (None, None) => (Typing::Learned, None),
        };
        if interaction == Interaction::Service {
            let resolved = written.map(|text| {
                ServiceKind::resolve(&text.value, self.types)
                    .map_err(|fault| Problem::at(text.referenced, fault.to_string()))
            });
            let kind = resolved.unwrap_or(Ok(ServiceKind::NativeObject));
            return Some((RouteTypes::Service(self.noted(kind)?), typing));
        }
        if interaction == Interaction::Action {
            let resolved = written.map(|text| {
                RosAction::resolve(&text.value, self.types)
                    .map_err(|fault| Problem::at(text.referenced, fault.to_string()))
            });
            let kind = match resolved {
                Some(resolved) => Some(self.noted(resolved)?),
                None => None,
            };
            return Some((RouteTypes::Action(kind), typing));
        }
        let mut resolve = |text: &Spanned<String>| {
            let resolved = MessageType::resolve(&text.value, self.types);
            self.noted(resolved.map_err(|fault| Problem::at(text.referenced, fault.to_string())))
        };
        let from_type = config.from_type.as_ref().filter(|_| typing == Typing::Given);
        let from = from_type.map(&mut resolve);
        let to = written.map_or(Some(MessageType::NativeObject), resolve);
        let types = Types { from: from.unwrap_or(to)?, to: to? };
        let (from, to) = (types.from.data_type(), types.to.data_type());
        if let Some(written) = from_type.filter(|_| !is_convertible(from, to)) {
            let text = format!(
                "from_type {} does not become type {}: {from} and {to} only become each other through \
                 NativeObject",
                types.from, types.to
            );
            self.complain(written.referenced, text);
        }
        Some((RouteTypes::Topic(types), typing))
    }

    fn policy(
        &mut self,
        entry: &Entry,
        interaction: Interaction,
        ends: Option<&(EndpointAddress, EndpointAddress, Option<Names>)>,
        types: Option<(RouteTypes, Typing)>,
    ) -> Policy {
        let config = &entry.value;
        let (types, action) = match types {
            Some((RouteTypes::Topic(types), Typing::Given)) => (Some(types), None),
            Some((RouteTypes::Action(kind), _)) => (None, kind),
            _ => (None, None),
        };
        let color_order = match config.encoding.as_ref().map(|it| (it, it.value.as_str())) {
            None | Some((_, "bgr8")) => Encoding::Bgr8,
            Some((_, "rgb8")) => Encoding::Rgb8,
            Some((encoding, other)) => {
                let text = format!("encoding {other:?} is not a channel order: write bgr8 or rgb8");
                self.complain(encoding.referenced, text);
                Encoding::Bgr8
            }
        };
        if let Some(types) = types {
            self.without_effect(config, types);
        }
        let [depth, mib] = self.sizes([&config.queue_depth, &config.max_message_mib]);
        let OverflowConfig(overflow) = config.overflow.unwrap_or(self.defaults.overflow);
        if let Some(rate) = &config.max_rate_hz
            && !(rate.value.is_finite() && rate.value > 0.0)
        {
            let text = format!("max_rate_hz is {}, it must be above 0", rate.value);
            self.complain(rate.referenced, text);
        }
        let timeout = config.timeout_ms.as_ref().filter(|_| interaction != Interaction::Topic);
        if let Some(timeout) = timeout.filter(|ms| !(1..=LONGEST_TIMEOUT_MS).contains(&ms.value)) {
            let (given, most) = (timeout.value, LONGEST_TIMEOUT_MS);
            let text = format!("timeout_ms is {given}, it must lie between 1 and {most}");
            self.complain(timeout.referenced, text);
        }
        let devices = self.device_maps(config.devices.as_ref());
        let options = ends.map(|(from, to, _)| {
            let (written, all) = (&config.options, self.middlewares);
            plan_options::read(written, [from, to], all, interaction, action, &mut self.problems)
        });
        let is_many = ends.is_some_and(|(_, _, names)| names.is_some());
        let is_lazy = is_many && interaction == Interaction::Topic;
        let default = Policy::default();
        Policy {
            qos: config.qos.unwrap_or_default(),
            queue: QueueSpec { depth, overflow },
            max_rate_hz: config.max_rate_hz.as_ref().map(|rate| rate.value),
            loop_guard: config.loop_guard.unwrap_or(default.loop_guard),
            color_order,
            frame_id: config.frame_id.as_ref().map(|frame_id| frame_id.value.clone()),
            stamp: config.stamp.as_ref().map(|stamp| stamp.value),
            limits: Limits {
                message_bytes: mib.saturating_mul(Limits::MIB).min(self.waiting_bytes / 4),
                ..default.limits
            },
            plugins: default.plugins.with_devices(devices.or_from(&self.default_devices)),
            options: options.unwrap_or_default(),
            merge: config.merge,
            lazy: config.lazy.as_ref().map_or(is_lazy, |lazy| lazy.value),
            timeout: timeout.map(|ms| Duration::from_millis(ms.value)),
            from_override: default.from_override,
            to_override: default.to_override,
        }
    }

    /// Notes the keys that mean nothing for messages of these types.
    fn without_effect(&mut self, config: &RouteConfig, Types { from, to }: Types) {
        let has_none = |kind| [from, to].iter().all(|it| it.data_type() != kind);
        let (no_image, no_object) = (has_none(DataType::Image), has_none(DataType::NativeObject));
        let (no_header, without) = (!to.has_header(), "it has no header");
        for (key, written, is_idle, why) in [
            ("frame_id", place(&config.frame_id), no_header, without),
            ("stamp", place(&config.stamp), no_header, without),
            ("encoding", place(&config.encoding), no_image, "only images have a channel order"),
            ("devices", place(&config.devices), no_object, "only native objects hold tensors"),
        ] {
            if let Some(place) = written.filter(|_| is_idle) {
                self.complain(place, format!("{key} has no effect on {}: {why}", to.label()));
            }
        }
    }

    /// Reads the device maps of a section `devices`.
    fn device_maps(&mut self, devices: Option<&Spanned<DevicesConfig>>) -> DeviceMaps {
        let maps = devices.map(|devices| devices.value.maps(devices.referenced));
        maps.and_then(|maps| self.noted(maps)).unwrap_or_default()
    }
}

/// Types of a route whose own cannot be read.
fn not_read(interaction: Interaction) -> RouteTypes {
    match interaction {
        Interaction::Topic => RouteTypes::Topic(MessageType::NativeObject.into()),
        Interaction::Service => RouteTypes::Service(ServiceKind::NativeObject),
        Interaction::Action => RouteTypes::Action(None),
    }
}

/// Place of a key that is given.
fn place<T>(written: &Option<Spanned<T>>) -> Option<Location> {
    written.as_ref().map(|it| it.referenced)
}

#[cfg(test)]
#[path = "plan_entry_tests.rs"]
mod tests;
