//! Settings of all middlewares: `endpoints` of a configuration, changed by parameters and arguments.

use std::any::Any;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use serde::de::{self, Deserialize, Deserializer, IgnoredAny, MapAccess, Visitor};
use wrapyfi_data::Limits;
use wrapyfi_endpoint::config::{ConfigError, Problem, in_no_file};
use wrapyfi_endpoint::driver::{
    Permission, Purpose, RouteFacts, Section, ServerAddress, Setting, StartNeeds,
};
use wrapyfi_endpoint::network::{Hosts, Place};
use wrapyfi_endpoint::{Interaction, Middleware, Planned, StartError};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_ros2::Ros2Section;

use super::drivers::{BUNDLED, drivers, guarded, names, unknown};
use crate::exit::{Failure, Result};
use crate::logging;
use crate::own_address::OwnAddress;

/// Names of the sections that `endpoints` of a configuration has.
#[derive(Debug, Clone, Default)]
pub struct SectionNames(Vec<&'static str>);

impl<'de> Deserialize<'de> for SectionNames {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Sections).map(Self)
    }
}

struct Sections;

impl<'de> Visitor<'de> for Sections {
    type Value = Vec<&'static str>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("keys with values")
    }

    fn visit_unit<E>(self) -> Result<Self::Value, E> {
        Ok(Vec::new())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut sections: A) -> Result<Self::Value, A::Error> {
        let mut found = Vec::new();
        while let Some(SectionName(name)) = sections.next_key()? {
            sections.next_value::<IgnoredAny>()?;
            found.push(name);
        }
        Ok(found)
    }
}

/// Key of a section: the name of a middleware of this program.
struct SectionName(&'static str);

impl<'de> Deserialize<'de> for SectionName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_str(Key)
    }
}

struct Key;

impl Visitor<'_> for Key {
    type Value = SectionName;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a middleware")
    }

    fn visit_str<E: de::Error>(self, key: &str) -> Result<SectionName, E> {
        if let Some(name) = names().iter().find(|name| **name == key) {
            return Ok(SectionName(name));
        }
        match BUNDLED.iter().any(|driver| driver.available().name == key) {
            true => Err(E::custom(format!(
                "this program has no middleware {key}: `wrapyfi` has it; middlewares here: {}",
                names().join(", ")
            ))),
            false => Err(E::unknown_field(key, names())),
        }
    }
}

/// Settings of all middlewares of this program.
#[derive(Debug, Clone)]
pub struct Endpoints {
    /// The sections by the names of their middlewares.
    sections: BTreeMap<&'static str, Box<dyn Section>>,
    /// `hosts` of the configuration.
    pub hosts: Hosts,
}

impl Default for Endpoints {
    fn default() -> Self {
        let sections = drivers().iter().filter_map(|(name, driver)| {
            let section = guarded(name, || driver.section());
            Some((*name, section.inspect_err(|panic| tracing::error!("{panic}")).ok()?))
        });
        Self { sections: sections.collect(), hosts: Hosts::default() }
    }
}

impl Endpoints {
    /// Reads the sections that a configuration has out of its text, all where it is not known which, and notes their
    /// faults.
    pub(super) fn read(
        text: &str,
        written: Option<&SectionNames>,
        problems: &mut Vec<Problem>,
    ) -> Self {
        let mut endpoints = Self::default();
        let before = before_routes(text);
        let read = |section: Box<dyn Section>| match section.read(before) {
            // The cut may be within braces or a quoted text, and a remedy may depend on what follows: with a fault, the
            // whole text decides.
            reading if !reading.problems.is_empty() && before != text => section.read(text),
            reading => reading,
        };
        for (name, driver) in drivers()
            .iter()
            .filter(|(name, _)| written.is_none_or(|written| written.0.contains(name)))
        {
            match guarded(name, || read(driver.section())) {
                Ok(reading) => {
                    // What stands around the sections was read before: a place has one fault.
                    let known: Vec<_> = problems.iter().map(|known| known.position).collect();
                    let new =
                        reading.problems.into_iter().filter(|it| !known.contains(&it.position));
                    problems.extend(new);
                    if let Some(section) = reading.value {
                        endpoints.sections.insert(name, section);
                    }
                }
                Err(panic) => problems.push(Problem { position: None, message: panic.to_string() }),
            }
        }
        endpoints
    }

    /// Settings of the middleware that is called `name`.
    ///
    /// # Errors
    /// Exit code 2 where there is none.
    pub(super) fn section(&self, name: &str) -> Result<&dyn Section> {
        self.sections.get(name).map(AsRef::as_ref).ok_or_else(|| unknown(name))
    }

    /// Settings of ROS 2, on which the bridge is a node.
    pub fn ros2(&self) -> Ros2Section {
        let section = self.sections.get(wrapyfi_ros2::NAME).map(|section| &**section as &dyn Any);
        section.and_then(<dyn Any>::downcast_ref).cloned().unwrap_or_default()
    }

    /// Each section with its name; what it panics about is told.
    fn each_mut(&mut self, mut act: impl FnMut(&'static str, &mut dyn Section)) {
        for (name, section) in &mut self.sections {
            if let Err(panic) = guarded(name, || act(name, section.as_mut())) {
                tracing::error!("{panic}");
            }
        }
    }

    /// The settings that parameters change, by their full names: `endpoints.yarp.ip`.
    pub(super) fn each_setting(&mut self, mut act: impl FnMut(String, Setting<'_>)) {
        self.each_mut(|name, section| {
            for (key, setting) in section.settings() {
                act(format!("endpoints.{name}.{key}"), setting);
            }
        });
    }

    /// The words that let others in, each with the name of its section.
    pub(crate) fn each_permission(&mut self, mut act: impl FnMut(&str, Permission<'_>)) {
        self.each_mut(|name, section| _ = section.permission().map(|it| act(name, it)));
    }

    /// Sets a port of a middleware; false where its settings have none of this name.
    pub(super) fn set_port(&mut self, middleware: &str, key: &str, port: u16) -> bool {
        let (mut is_set, wanted) = (false, format!("endpoints.{middleware}.{key}"));
        self.each_setting(|name, setting| {
            if let (true, Setting::Port(place)) = (name == wanted, setting) {
                (*place, is_set) = (Some(in_no_file(port)), true);
            }
        });
        is_set
    }

    /// Gives the node of a bridge of all of a middleware a name there, where the settings have none.
    pub fn name_node(&mut self, middleware: &str, node: &str) {
        self.each_mut(|name, section| {
            if name == middleware {
                section.name_node(node);
            }
        });
    }

    /// Says at which address others reach the endpoints, before what the sections say.
    pub fn reached_at(&mut self, own: OwnAddress) {
        let mut addressed = BTreeMap::new();
        self.each_permission(|name, Permission { insecure, address, said_elsewhere }| {
            let ip = own.ip.filter(|_| said_elsewhere.is_none());
            insecure.said(Place::Argument, ip.is_some(), own.insecure);
            if let Some(ip) = ip {
                addressed.insert(format!("endpoints.{name}.{address}"), ip.to_string());
            }
        });
        self.each_setting(|name, setting| match (addressed.remove(&name), setting) {
            (Some(ip), Setting::Text(place)) => *place = Some(ip),
            (Some(ip), Setting::Placed(place)) => *place = Some(in_no_file(ip)),
            _ => {}
        });
    }

    /// Checks what the middlewares check of their settings when they start, as far as that needs no other program.
    /// Files that they name are as seen from `folder`, where they are to be read.
    pub(super) fn check(&mut self, folder: Option<&Path>) -> Vec<Problem> {
        let mut problems = Vec::new();
        for (name, section) in &mut self.sections {
            let checked = guarded(name, || {
                let found = folder.map_or(Ok(()), |folder| section.find_files(folder));
                [found, section.check()]
            });
            match checked {
                Ok(checked) => problems.extend(checked.into_iter().filter_map(Result::err)),
                Err(panic) => problems.push(Problem { position: None, message: panic.to_string() }),
            }
        }
        problems
    }

    /// Checks that nothing would listen where other machines reach it without permission. Parameters and arguments
    /// say where, and permit it, too: only what they have changed can be judged.
    ///
    /// # Errors
    /// Exit code 2 with the line of the address in `file`, where it is from there, and the word that permits it.
    pub fn check_permitted(&self, file: Option<&Path>) -> Result<()> {
        for (name, section) in &self.sections {
            let Err(problem) = guarded(name, || section.check_permitted(&self.hosts))? else {
                continue;
            };
            return Err(match (file, problem.position) {
                (Some(file), Some((1.., _))) => {
                    let file = file.display().to_string();
                    Failure::usage(ConfigError { file, problems: vec![problem] })
                }
                _ => Failure::Usage(problem.message),
            });
        }
        Ok(())
    }

    /// Checks routes together, as each middleware has its rules for that.
    pub(super) fn check_routes(routes: &[RouteFacts<'_>]) -> Result<(), (usize, String)> {
        for (name, driver) in drivers() {
            let checked = guarded(name, || driver.check_routes(routes));
            checked.unwrap_or_else(|panic| Err((usize::MAX, panic.to_string())))?;
        }
        Ok(())
    }

    /// Warnings about what routes lose, or settings leave without effect: each with the index of its route, where it is
    /// about one.
    pub fn warnings(
        &self,
        routes: &[RouteFacts<'_>],
        types: &mut TypeStore,
    ) -> Vec<(Option<usize>, String)> {
        let each = self.sections.iter().flat_map(|(name, section)| {
            guarded(name, || section.warnings(routes, types))
                .unwrap_or_else(|panic| vec![(None, panic.to_string())])
        });
        each.collect()
    }

    /// The middleware that the settings make for a purpose.
    ///
    /// # Errors
    /// Exit code 2 for settings and variables that cannot be, and a middleware that there is not.
    pub(crate) fn plan(
        &self,
        name: &str,
        largest_message: usize,
        purpose: Purpose,
    ) -> Result<Planned> {
        let section = self.section(name)?;
        let needs = StartNeeds { hosts: &self.hosts, largest_message, purpose };
        guarded(name, || section.plan(&needs))?.map_err(failure)
    }

    /// Starts a middleware with these settings, for a program that is no bridge.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when it does not start.
    pub(super) fn start(&self, name: &str, purpose: Purpose) -> Result<Arc<dyn Middleware>> {
        start(name, &self.plan(name, Limits::default().message_bytes, purpose)?)
    }

    /// Servers that a middleware needs: for topics, or for services.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot be, and where nothing says where the server is.
    pub fn servers(&self, name: &str, interaction: Interaction) -> Result<Vec<ServerAddress>> {
        let section = self.section(name)?;
        guarded(name, || section.servers(&self.hosts, interaction))?.map_err(failure)
    }
}

/// Example of `endpoints`: that of the first middleware.
pub(super) fn example() -> &'static str {
    static EXAMPLE: OnceLock<String> = OnceLock::new();
    EXAMPLE.get_or_init(|| {
        let first = drivers().first();
        let section = first.map(|(name, driver)| format!("{name}: {}", driver.section().example()));
        format!("{{ {} }}", section.unwrap_or_default())
    })
}

/// Failure of settings that cannot work.
pub(super) fn failure(error: StartError) -> Failure {
    match error {
        StartError::Absent(what) => Failure::Absent(what),
        StartError::Failed(why) => Failure::Failed(anyhow::Error::msg(why)),
        refused => Failure::Usage(refused.to_string()),
    }
}

/// Starts a middleware that is called `name`; its log, where it has one, has the lines of this program from then on.
///
/// # Errors
/// Exit code 2 for settings that cannot work, 1 when it does not start.
pub(super) fn start(name: &str, planned: &Planned) -> Result<Arc<dyn Middleware>> {
    let started = guarded(name, || (planned.start)())?;
    let started = started.map_err(|error| of_start(name, error))?;
    if let Some(sink) = started.log_sink() {
        logging::write_to(name, Some(sink));
    }
    Ok(started)
}

/// Failure of a middleware that does not start.
pub(super) fn of_start(name: &str, error: StartError) -> Failure {
    match failure(error) {
        Failure::Failed(why) => Failure::Failed(why.context(name.to_owned())),
        Failure::Usage(refused) => Failure::Usage(format!("{name}: {refused}")),
        absent => absent,
    }
}

/// Text before its routes, where nothing stands behind them: a thousand routes are read once, and not again by each
/// section.
fn before_routes(text: &str) -> &str {
    // A carriage return alone ends a line of YAML too.
    if text.contains('\r') {
        return text;
    }
    let is_route = |line: &str| {
        line.trim_end().is_empty()
            || line.starts_with([' ', '#'])
            || (line.starts_with('-') && !line.starts_with("---"))
    };
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let (before, after) = text.split_at_checked(at).unwrap_or((text, ""));
        at += line.len();
        if line.starts_with("routes:") {
            let is_last = after.lines().skip(1).all(is_route);
            return if is_last { before } else { text };
        }
    }
    text
}

#[cfg(test)]
impl Endpoints {
    /// Value of a setting, such as `yarp.ip`, where it has one.
    pub(super) fn said(&self, wanted: &str) -> Option<String> {
        let mut said = None;
        self.clone().each_setting(|name, setting| {
            if name == format!("endpoints.{wanted}") {
                said = match setting {
                    Setting::Text(place) => place.clone(),
                    Setting::Placed(place) => place.as_ref().map(|text| text.value.clone()),
                    Setting::Port(place) => place.as_ref().map(|port| port.value.to_string()),
                    Setting::Switch(place) => Some(place.to_string()),
                };
            }
        });
        said
    }

    /// Reads sections that stand behind `endpoints: `.
    pub(super) fn of(sections: &str) -> Self {
        let route = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]";
        let text = format!("endpoints: {sections}\n{route}\n");
        super::load_text(&text, "test").unwrap().endpoints
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_are_read_without_the_routes_that_stand_behind_them() {
        let sections = "# /a\nendpoints:\n  yarp: { ip: x }\n";
        for routes in
            ["routes:\n  - { from: a }\n\n# end\n", "routes:\n- from: a\n  to: b", "routes: []"]
        {
            assert_eq!(before_routes(&format!("{sections}{routes}")), sections);
        }
        let behind = [
            "routes: []\nendpoints: {}\n",
            "routes: []\n---\nendpoints: {}\n",
            "{ routes: [] }\n",
            "",
        ];
        for whole in behind {
            assert_eq!(before_routes(whole), whole);
        }
        let at = "zeromq: { pub_port: 4711 }";
        let route = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]";
        for text in [
            format!("endpoints: {{ {at} }}\n{route}\n"),
            format!("{{ endpoints: {{ {at} }},\n{route} }}\n"),
            format!("{route}\nendpoints: {{ {at} }}\n"),
            format!("{route}\rendpoints: {{ {at} }}\r"),
        ] {
            let read = super::super::load_text(&text, "test").unwrap().endpoints;
            assert_eq!(read.said("zeromq.pub_port").as_deref(), Some("4711"), "{text:?}");
        }
    }
}
