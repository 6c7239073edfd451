//! Settings of middlewares as parameters of the node: `-p endpoints.yarp.ip:=192.168.1.7`.
//!
//! They go before those of the file, and have its names. All that are not at their default are declared, so that others
//! can read what is in force.

use std::collections::BTreeMap;

use wrapyfi_endpoint::config::in_no_file;
use wrapyfi_endpoint::driver::Setting;
use wrapyfi_endpoint::network::{Insecure, Place};
use wrapyfi_node::ParameterValue;
use wrapyfi_node::parameters::{ParameterDescriptor, ParameterStore};

use super::endpoints::Endpoints;
use crate::exit::{Failure, Result};

/// Prefix of the parameters' names.
const PREFIX: &str = "endpoints.";

/// Gives a setting the value of the parameter `name`.
fn take(setting: Setting<'_>, name: &str, value: ParameterValue) -> Result<()> {
    match (setting, value) {
        (Setting::Text(place), ParameterValue::String(text)) => *place = Some(text),
        (Setting::Placed(place), ParameterValue::String(text)) => *place = Some(in_no_file(text)),
        (Setting::Port(place), ParameterValue::Integer(port @ 1..=65535)) => {
            *place = u16::try_from(port).ok().map(in_no_file);
        }
        (Setting::Switch(place), ParameterValue::Bool(is_on)) => *place = is_on,
        (setting, value) => {
            let wanted = match setting {
                Setting::Text(_) | Setting::Placed(_) => "a text",
                Setting::Port(_) => "a port from 1 to 65535",
                Setting::Switch(_) => "true or false",
            };
            let text = format!("parameter {name} is {value}; it must be {wanted}");
            return Err(Failure::Usage(text));
        }
    }
    Ok(())
}

/// Value of the parameter of a setting, where it is not the default.
fn value(setting: &Setting<'_>) -> Option<ParameterValue> {
    match setting {
        Setting::Text(place) => place.as_deref().map(ParameterValue::from),
        Setting::Placed(place) => place.as_ref().map(|text| text.value.as_str().into()),
        Setting::Port(place) => place.as_ref().map(|port| i64::from(port.value).into()),
        Setting::Switch(place) => place.then_some(ParameterValue::Bool(true)),
    }
}

/// Changes `endpoints` by the parameters that are given, also where they were declared before.
///
/// # Errors
/// Exit code 2 for a name that there is not, or a value that it cannot have.
pub(crate) fn take_parameters(endpoints: &mut Endpoints, store: &mut ParameterStore) -> Result<()> {
    let given = store.overrides().keys().filter(|name| name.starts_with(PREFIX));
    let given: Vec<String> = given.cloned().collect();
    let mut known = Vec::new();
    endpoints.each_setting(|name, _| known.push(name));
    let mut values = BTreeMap::new();
    for name in &given {
        if !known.contains(name) {
            return Err(Failure::Usage(format!(
                "there is no parameter {name}; those of middlewares are {}",
                known.join(", ")
            )));
        }
        let value = match store.get(name) {
            Ok(declared) => declared.clone(),
            Err(_) => {
                store.declare(descriptor(name), ParameterValue::NotSet).map_err(Failure::usage)?
            }
        };
        values.insert(name.as_str(), value);
    }
    let mut before = BTreeMap::<String, Insecure>::new();
    endpoints.each_permission(|name, it| _ = before.insert(name.to_owned(), *it.insecure));
    let mut taken = Ok(());
    endpoints.each_setting(|name, setting| {
        if let (Some(value), Ok(())) = (values.remove(name.as_str()), &taken) {
            taken = take(setting, &name, value);
        }
    });
    taken?;
    let is_given = |section: &str, key: &str| given.contains(&format!("{PREFIX}{section}.{key}"));
    endpoints.each_permission(|name, it| {
        // The word permits the address of its own place, else adds to what was said before.
        let is_allowed = is_given(name, "insecure") && it.insecure.is_allowed;
        *it.insecure = before.get(name).copied().unwrap_or_default();
        it.insecure.said(Place::Parameter, is_given(name, it.address), is_allowed);
    });
    match endpoints.check(None).into_iter().next() {
        None => Ok(()),
        Some(problem) => Err(Failure::Usage(format!("parameters {PREFIX}…: {}", problem.message))),
    }
}

/// Has the parameters say what `endpoints` are, those that were declared and those that were not.
pub(crate) fn show_endpoints(endpoints: &Endpoints, store: &mut ParameterStore) {
    // The one way to a setting is that by which it is also changed.
    endpoints.clone().each_setting(|name, setting| {
        let value = value(&setting).unwrap_or(ParameterValue::NotSet);
        let told = match store.get(&name) {
            Ok(same) if *same == value => return,
            Ok(_) => store.set_own(&name, value).map_err(|error| error.to_string()),
            Err(_) if value == ParameterValue::NotSet => return,
            Err(_) => {
                store.declare(descriptor(&name), value).map(drop).map_err(|error| error.to_string())
            }
        };
        if let Err(error) = told {
            tracing::warn!("parameter {name} does not say what is in force: {error}");
        }
    });
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
        let of_file = "{ zeromq: { pub_port: 7000 }, yarp: { embedded: true, namespace: /file } }";
        let mut endpoints = Endpoints::of(of_file);
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
        let mut endpoints = Endpoints::of("{ zeromq: { pub_port: 7001 } }");
        take_parameters(&mut endpoints, &mut store).unwrap();
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
        assert_eq!(endpoints.said("yarp.ip").as_deref(), Some("192.0.2.7"));
        let server = ("endpoints.yarp.name_server", ParameterValue::from("robot:10000"));
        let server = taken(&[server]).unwrap().said("yarp.name_server");
        assert_eq!(server.as_deref(), Some("robot:10000"));
        let unknown = taken(&[("endpoints.yarp.pi", ParameterValue::from("x"))]).unwrap_err();
        assert!(unknown.contains("endpoints.yarp.ip"), "{unknown}");
        let wrong = taken(&[("endpoints.yarp.ip", ParameterValue::Integer(3))]).unwrap_err();
        assert!(wrong.contains("it must be a text"), "{wrong}");
    }
}
