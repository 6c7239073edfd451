//! Settings of middlewares as parameters of the node: `-p endpoints.yarp.ip:=192.168.1.7`.
//!
//! They go before those of the file, and have its names. All that are not at their default are declared, so that others
//! can read what is in force.

use serde_saphyr::Spanned;
use wrapyfi_endpoint::network::{Insecure, Place};
use wrapyfi_node::ParameterValue;
use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};

use super::load::Endpoints;
use crate::exit::{Failure, Result};
use crate::files::in_no_file;

/// Prefix of the parameters' names.
const PREFIX: &str = "endpoints.";

/// Place of a setting, by the type of its value.
enum Setting {
    Text(fn(&mut Endpoints) -> &mut Option<String>),
    Placed(fn(&mut Endpoints) -> &mut Option<Spanned<String>>),
    Port(fn(&mut Endpoints) -> &mut Option<Spanned<u16>>),
    Switch(fn(&mut Endpoints) -> &mut bool),
}

/// The parameters that there are.
const SETTINGS: [(&str, Setting); 14] = [
    ("endpoints.ros.hostname", Setting::Text(|it| &mut it.ros.hostname)),
    ("endpoints.ros.insecure", Setting::Switch(|it| &mut it.ros.insecure.0.is_allowed)),
    ("endpoints.ros.master_uri", Setting::Placed(|it| &mut it.ros.master_uri)),
    ("endpoints.ros.namespace", Setting::Placed(|it| &mut it.ros.namespace)),
    ("endpoints.ros.node", Setting::Placed(|it| &mut it.ros.node)),
    ("endpoints.yarp.embedded", Setting::Switch(|it| &mut it.yarp.embedded)),
    ("endpoints.yarp.insecure", Setting::Switch(|it| &mut it.yarp.insecure.0.is_allowed)),
    ("endpoints.yarp.ip", Setting::Placed(|it| &mut it.yarp.ip)),
    ("endpoints.yarp.name_server", Setting::Placed(|it| &mut it.yarp.name_server)),
    ("endpoints.yarp.namespace", Setting::Text(|it| &mut it.yarp.namespace)),
    ("endpoints.zeromq.insecure", Setting::Switch(|it| &mut it.zeromq.insecure.0.is_allowed)),
    ("endpoints.zeromq.ip", Setting::Placed(|it| &mut it.zeromq.ip)),
    ("endpoints.zeromq.pub_port", Setting::Port(|it| &mut it.zeromq.pub_port)),
    ("endpoints.zeromq.sub_port", Setting::Port(|it| &mut it.zeromq.sub_port)),
];

type WordOf = fn(&mut Endpoints) -> &mut Insecure;

/// Words that permit an address which other machines reach, each with the parameter that gives the address.
const WORDS: [(&str, WordOf, &str); 3] = [
    ("endpoints.ros.insecure", |it| &mut it.ros.insecure.0, "endpoints.ros.hostname"),
    ("endpoints.yarp.insecure", |it| &mut it.yarp.insecure.0, "endpoints.yarp.ip"),
    ("endpoints.zeromq.insecure", |it| &mut it.zeromq.insecure.0, "endpoints.zeromq.ip"),
];

impl Setting {
    /// Takes the value of the parameter `name`.
    fn take(&self, endpoints: &mut Endpoints, name: &str, value: ParameterValue) -> Result<()> {
        match (self, value) {
            (Self::Text(place), ParameterValue::String(text)) => *place(endpoints) = Some(text),
            (Self::Placed(place), ParameterValue::String(text)) => {
                *place(endpoints) = Some(in_no_file(text));
            }
            (Self::Port(place), ParameterValue::Integer(port @ 1..=65535)) => {
                *place(endpoints) = u16::try_from(port).ok().map(in_no_file);
            }
            (Self::Switch(place), ParameterValue::Bool(is_on)) => *place(endpoints) = is_on,
            (setting, value) => {
                let wanted = match setting {
                    Self::Text(_) | Self::Placed(_) => "a text",
                    Self::Port(_) => "a port from 1 to 65535",
                    Self::Switch(_) => "true or false",
                };
                let text = format!("parameter {name} is {value}; it must be {wanted}");
                return Err(Failure::Usage(text));
            }
        }
        Ok(())
    }

    /// Value of the parameter, where it is not the default.
    fn value(&self, endpoints: &mut Endpoints) -> Option<ParameterValue> {
        match self {
            Self::Text(place) => place(endpoints).as_deref().map(ParameterValue::from),
            Self::Placed(place) => place(endpoints).as_ref().map(|text| text.value.as_str().into()),
            Self::Port(place) => place(endpoints).as_ref().map(|port| i64::from(port.value).into()),
            Self::Switch(place) => place(endpoints).then_some(ParameterValue::Bool(true)),
        }
    }
}

/// Changes `endpoints` by the parameters that are given, also where they were declared before.
///
/// # Errors
/// Exit code 2 for a name that there is not, or a value that it cannot have.
pub(crate) fn take_parameters(endpoints: &mut Endpoints, store: &mut ParameterStore) -> Result<()> {
    let given = store.overrides().keys().filter(|name| name.starts_with(PREFIX));
    let given: Vec<String> = given.cloned().collect();
    let before = WORDS.map(|(_, word, _)| *word(endpoints));
    for name in &given {
        let Some((_, setting)) = SETTINGS.iter().find(|(known, _)| known == name) else {
            let known = SETTINGS.map(|(name, _)| name).join(", ");
            return Err(Failure::Usage(format!(
                "there is no parameter {name}; those of middlewares are {known}"
            )));
        };
        let value = match store.get(name) {
            Ok(declared) => declared.clone(),
            Err(_) => {
                store.declare(descriptor(name), ParameterValue::NotSet).map_err(Failure::usage)?
            }
        };
        setting.take(endpoints, name, value)?;
    }
    let is_given = |name: &str| given.iter().any(|given| given == name);
    for ((name, word, address), before) in WORDS.into_iter().zip(before) {
        let word = word(endpoints);
        // The word permits the address of its own place, else adds to what was said before.
        let is_allowed = is_given(name) && word.is_allowed;
        *word = before;
        word.said(Place::Parameter, is_given(address), is_allowed);
    }
    match endpoints.check().next() {
        None => Ok(()),
        Some(problem) => Err(Failure::Usage(format!("parameters {PREFIX}…: {}", problem.message))),
    }
}

/// Has the parameters say what `endpoints` are, those that were declared and those that were not.
pub(crate) fn show_endpoints(endpoints: &Endpoints, store: &mut ParameterStore) {
    // The table has one way to a setting, by which it is also changed.
    let mut endpoints = endpoints.clone();
    for (name, setting) in SETTINGS {
        let value = setting.value(&mut endpoints).unwrap_or(ParameterValue::NotSet);
        let told = match store.get(name) {
            Ok(same) if *same == value => continue,
            Ok(_) => store.set_own(name, value).map_err(|error| error.to_string()),
            Err(_) if value == ParameterValue::NotSet => continue,
            Err(_) => {
                store.declare(descriptor(name), value).map(drop).map_err(|error| error.to_string())
            }
        };
        if let Err(error) = told {
            tracing::warn!("parameter {name} does not say what is in force: {error}");
        }
    }
}

fn descriptor(name: &str) -> ParameterDescriptor {
    ParameterDescriptor::new(name)
        .with_description("Setting of the configuration file, in its place.")
        .read_only()
        .dynamic()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use wrapyfi_node::NodeName;

    fn taken(given: &[(&str, ParameterValue)]) -> Result<Endpoints, String> {
        let given: BTreeMap<_, _> =
            given.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
        let name = NodeName::new("bridge", "/").unwrap();
        let mut store = ParameterStore::new(&name, given).unwrap();
        let mut endpoints = Endpoints::default();
        take_parameters(&mut endpoints, &mut store).map_err(|failure| failure.to_string())?;
        assert_eq!(store.unused_overrides().count(), 0);
        endpoints.check_permitted(None).map_err(|failure| failure.to_string())?;
        Ok(endpoints)
    }

    #[test]
    fn parameters_say_what_is_in_force_and_follow_it() {
        let name = NodeName::new("bridge", "/").unwrap();
        let given = ("endpoints.yarp.namespace".to_owned(), ParameterValue::from("/lab"));
        let mut store = ParameterStore::new(&name, [given].into()).unwrap();
        let mut endpoints = Endpoints::default();
        endpoints.zeromq.pub_port = Some(in_no_file(7000));
        endpoints.yarp.embedded = true;
        endpoints.yarp.namespace = Some("/of_the_file".to_owned());
        take_parameters(&mut endpoints, &mut store).unwrap();
        show_endpoints(&endpoints, &mut store);
        let shown = |store: &ParameterStore| {
            let ours = store.names().filter(|name| name.starts_with(PREFIX));
            let line = |name: &str| format!("{name} {}", store.get(name).unwrap());
            ours.map(line).collect::<Vec<_>>()
        };
        let told = ["yarp.namespace /lab", "yarp.embedded true", "zeromq.pub_port 7000"];
        assert_eq!(shown(&store), told.map(|it| format!("{PREFIX}{it}")));
        assert!(store.describe("endpoints.yarp.embedded").unwrap().read_only);
        assert!(store.set("endpoints.zeromq.pub_port", 1).is_err());
        // As after another file was read.
        endpoints.zeromq.pub_port = Some(in_no_file(7001));
        endpoints.yarp.embedded = false;
        show_endpoints(&endpoints, &mut store);
        let told = ["yarp.namespace /lab", "zeromq.pub_port 7001"];
        assert_eq!(shown(&store), told.map(|it| format!("{PREFIX}{it}")));
    }

    #[test]
    fn settings_are_parameters_and_one_rule_holds_for_addresses() {
        let ip = ("endpoints.yarp.ip", ParameterValue::from("192.0.2.7"));
        let refused = taken(std::slice::from_ref(&ip)).unwrap_err();
        assert!(refused.contains("-p endpoints.yarp.insecure:=true"), "{refused}");
        let word = ("endpoints.yarp.insecure", ParameterValue::Bool(true));
        let endpoints = taken(&[ip, word]).unwrap();
        assert_eq!(endpoints.yarp.ip.unwrap().value, "192.0.2.7");
        let server = ("endpoints.yarp.name_server", ParameterValue::from("robot:10000"));
        assert_eq!(taken(&[server]).unwrap().yarp.name_server.unwrap().value, "robot:10000");
        let unknown = taken(&[("endpoints.yarp.pi", ParameterValue::from("x"))]).unwrap_err();
        assert!(unknown.contains("endpoints.yarp.ip"), "{unknown}");
        let wrong = taken(&[("endpoints.yarp.ip", ParameterValue::Integer(3))]).unwrap_err();
        assert!(wrong.contains("it must be a text"), "{wrong}");
    }
}
