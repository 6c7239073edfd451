//! Settings of middlewares as parameters of the node: `-p endpoints.yarp.ip:=192.168.1.7`.
//!
//! They go before those of the file, and have its names. All that are not at their default are declared, so that others
//! can read what is in force.

use serde_saphyr::{Location, Spanned};
use wrapyfi_core::network::{Insecure, Place};
use wrapyfi_core::node::ParameterValue;
use wrapyfi_core::node::parameters::{ParameterDescriptor, ParameterStore};

use super::load::Endpoints;
use crate::exit::Failure;

/// Prefix of the parameters' names.
const PREFIX: &str = "endpoints.";

/// Names of the parameters that there are.
const NAMES: [&str; 14] = [
    "endpoints.ros.hostname",
    "endpoints.ros.insecure",
    "endpoints.ros.master_uri",
    "endpoints.ros.namespace",
    "endpoints.ros.node",
    "endpoints.yarp.embedded",
    "endpoints.yarp.insecure",
    "endpoints.yarp.ip",
    "endpoints.yarp.name_server",
    "endpoints.yarp.namespace",
    "endpoints.zeromq.insecure",
    "endpoints.zeromq.ip",
    "endpoints.zeromq.pub_port",
    "endpoints.zeromq.sub_port",
];

/// Changes `endpoints` by the parameters that are given, also where they were declared before.
///
/// # Errors
/// Exit code 2 for a name that there is not, or a value that it cannot have.
pub(crate) fn take_parameters(
    endpoints: &mut Endpoints,
    store: &mut ParameterStore,
) -> Result<(), Failure> {
    let given = store.overrides().keys().filter(|name| name.starts_with(PREFIX));
    let given: Vec<String> = given.cloned().collect();
    // By section: whether the address is among them, and the word.
    let (mut ros, mut yarp, mut zeromq) = ((false, false), (false, false), (false, false));
    for name in given {
        if !NAMES.contains(&name.as_str()) {
            return Err(Failure::Usage(format!(
                "there is no parameter {name}; those of middlewares are {}",
                NAMES.join(", ")
            )));
        }
        let value = match store.get(&name) {
            Ok(declared) => declared.clone(),
            Err(_) => {
                store.declare(descriptor(&name), ParameterValue::NotSet).map_err(Failure::usage)?
            }
        };
        match name.strip_prefix(PREFIX).unwrap_or_default() {
            "ros.hostname" => (endpoints.ros.hostname, ros.0) = (Some(text(&name, value)?), true),
            "ros.insecure" => ros.1 = switch(&name, &value)?,
            "ros.master_uri" => endpoints.ros.master_uri = Some(text(&name, value)?),
            "ros.namespace" => endpoints.ros.namespace = Some(text(&name, value)?),
            "ros.node" => endpoints.ros.node = Some(text(&name, value)?),
            "yarp.embedded" => endpoints.yarp.embedded = switch(&name, &value)?,
            "yarp.insecure" => yarp.1 = switch(&name, &value)?,
            "yarp.ip" => {
                endpoints.yarp.say_ip(text(&name, value)?);
                yarp.0 = true;
            }
            "yarp.name_server" => {
                endpoints.yarp.name_server = Some(unplaced(text(&name, value)?));
            }
            "yarp.namespace" => endpoints.yarp.namespace = Some(text(&name, value)?),
            "zeromq.insecure" => zeromq.1 = switch(&name, &value)?,
            "zeromq.ip" => {
                (endpoints.zeromq.ip, zeromq.0) = (Some(unplaced(text(&name, value)?)), true);
            }
            "zeromq.pub_port" => endpoints.zeromq.pub_port = Some(port(&name, &value)?),
            _ => endpoints.zeromq.sub_port = Some(port(&name, &value)?),
        }
    }
    let said = |insecure: &mut Insecure, (address, word)| {
        insecure.said(Place::Parameter, address, word);
    };
    said(&mut endpoints.ros.insecure.0, ros);
    said(&mut endpoints.yarp.insecure.0, yarp);
    said(&mut endpoints.zeromq.insecure.0, zeromq);
    endpoints
        .yarp
        .check()
        .map_err(|problem| Failure::Usage(format!("parameters {PREFIX}…: {}", problem.message)))
}

/// Has the parameters say what `endpoints` are, those that were declared and those that were not.
pub(crate) fn show_endpoints(endpoints: &Endpoints, store: &mut ParameterStore) {
    for name in NAMES {
        let value = value_of(endpoints, name).unwrap_or(ParameterValue::NotSet);
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

/// Value of a setting, where it is not the default.
fn value_of(endpoints: &Endpoints, name: &str) -> Option<ParameterValue> {
    let Endpoints { zeromq, ros, yarp, .. } = endpoints;
    let text = |text: &Option<String>| text.as_deref().map(ParameterValue::from);
    let placed = |text: &Option<Spanned<String>>| {
        text.as_ref().map(|text| ParameterValue::from(text.value.as_str()))
    };
    let switch = |is_on: bool| is_on.then_some(ParameterValue::Bool(true));
    let port = |port: Option<u16>| port.map(|port| ParameterValue::from(i64::from(port)));
    match name.strip_prefix(PREFIX)? {
        "ros.hostname" => text(&ros.hostname),
        "ros.insecure" => switch(ros.insecure.0.is_allowed),
        "ros.master_uri" => text(&ros.master_uri),
        "ros.namespace" => text(&ros.namespace),
        "ros.node" => text(&ros.node),
        "yarp.embedded" => switch(yarp.embedded),
        "yarp.insecure" => switch(yarp.insecure.0.is_allowed),
        "yarp.ip" => placed(&yarp.ip),
        "yarp.name_server" => placed(&yarp.name_server),
        "yarp.namespace" => text(&yarp.namespace),
        "zeromq.insecure" => switch(zeromq.insecure.0.is_allowed),
        "zeromq.ip" => placed(&zeromq.ip),
        "zeromq.pub_port" => port(zeromq.pub_port),
        "zeromq.sub_port" => port(zeromq.sub_port),
        _ => None,
    }
}

fn descriptor(name: &str) -> ParameterDescriptor {
    ParameterDescriptor::new(name)
        .with_description("Setting of the configuration file, in its place.")
        .read_only()
        .dynamic()
}

/// A value that stands in no file.
fn unplaced(value: String) -> Spanned<String> {
    Spanned::new(value, Location::UNKNOWN, Location::UNKNOWN)
}

fn text(name: &str, value: ParameterValue) -> Result<String, Failure> {
    match value {
        ParameterValue::String(text) => Ok(text),
        other => Err(wrong(name, &other, "a text")),
    }
}

fn switch(name: &str, value: &ParameterValue) -> Result<bool, Failure> {
    match value {
        ParameterValue::Bool(value) => Ok(*value),
        other => Err(wrong(name, other, "true or false")),
    }
}

fn port(name: &str, value: &ParameterValue) -> Result<u16, Failure> {
    let port = match value {
        ParameterValue::Integer(number) => u16::try_from(*number).ok().filter(|port| *port > 0),
        _ => None,
    };
    port.ok_or_else(|| wrong(name, value, "a port from 1 to 65535"))
}

fn wrong(name: &str, value: &ParameterValue, wanted: &str) -> Failure {
    Failure::Usage(format!("parameter {name} is {value}; it must be {wanted}"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use wrapyfi_core::node::NodeName;

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
        endpoints.zeromq.pub_port = Some(7000);
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
        endpoints.zeromq.pub_port = Some(7001);
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
