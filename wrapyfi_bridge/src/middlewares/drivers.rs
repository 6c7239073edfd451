//! The middlewares of this program: the only list of them that there is.
//!
//! A driver may come from another crate. What it panics about is an error of its own name, and the program goes on.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use wrapyfi_endpoint::driver::{Available, Driver, WholeBridge};
use wrapyfi_endpoint::{Cause, Conventions, EndpointAddress, Interaction, Registry};
use wrapyfi_retry::contained;

use crate::exit::{Failure, Result};

/// The middlewares of `wrapyfi`.
pub const BUNDLED: [&dyn Driver; 4] = [
    wrapyfi_zeromq::DRIVER,
    wrapyfi_ros2::DRIVER,
    wrapyfi_ros1::DRIVER,
    wrapyfi_yarp_endpoint::DRIVER,
];

/// Services that nodes of ROS 2, those of ROS 1 and a bridge offer about themselves, also where a bridge carries them.
/// The mark of a bridge's endpoint is no help: the mapping of Fast DDS shows none of a service, and the program that
/// calls `change_state` ends the bridge.
pub(crate) const NODE_SERVICES: &[&[&str]] = &[
    wrapyfi_node::NODE_SERVICES,
    &["get_loggers", "set_logger_level"],
    &["add_route", "remove_route", "list_routes", "explain", "reload"],
];

/// The drivers of this program, with their names; those of `wrapyfi` unless `main` was given others.
static DRIVERS: OnceLock<Vec<(&'static str, &'static dyn Driver)>> = OnceLock::new();

/// Sets the drivers of this program.
///
/// # Errors
/// Exit code 2 where two have one name, one has no name of an address, or one panics when it is asked for it.
pub fn set(drivers: &[&'static dyn Driver]) -> Result<()> {
    let mut named: Vec<(&'static str, &'static dyn Driver)> = Vec::new();
    for (at, driver) in drivers.iter().enumerate() {
        let name = contained(|| driver.available().name).map_err(|panic| {
            Failure::Usage(format!("driver {} of this program panicked: {panic}", at + 1))
        })?;
        let address = format!("{name}:/a").parse::<EndpointAddress>();
        if !address.is_ok_and(|address| address.middleware == name) {
            return Err(Failure::Usage(format!(
                "driver {} of this program calls its middleware {name:?}, which no address can have",
                at + 1
            )));
        }
        if let Some(before) = named.iter().position(|(other, _)| *other == name) {
            return Err(Failure::Usage(format!(
                "drivers {} and {} of this program are both called {name}: leave one out of its list",
                before + 1,
                at + 1
            )));
        }
        named.push((name, *driver));
    }
    _ = DRIVERS.set(named);
    let mut executables = BTreeMap::new();
    for (name, WholeBridge { executable, .. }) in whole_bridges() {
        if let Some(other) = executables.insert(executable, name) {
            return Err(Failure::Usage(format!(
                "the drivers of {other} and {name} both have an executable {executable}: leave one out of the list of \
                 this program"
            )));
        }
    }
    Ok(())
}

/// The drivers of this program by their names, in the order of its list.
pub(super) fn drivers() -> &'static [(&'static str, &'static dyn Driver)] {
    DRIVERS.get_or_init(|| BUNDLED.map(|driver| (driver.available().name, driver)).into())
}

/// Calls a driver or its section, which may come from another crate: a panic is an error that names it.
///
/// # Errors
/// Exit code 1 with the words of the panic.
pub(super) fn guarded<T>(name: &str, act: impl FnOnce() -> T) -> Result<T> {
    contained(act).map_err(|panic| {
        Failure::Failed(anyhow::anyhow!("middleware {name}: its driver panicked: {panic}"))
    })
}

/// Names under which routes and commands address the middlewares, with their rules for topics.
pub(crate) fn available() -> Vec<Available<'static>> {
    let known = drivers().iter().map(|(name, driver)| {
        let fallback = Available { name, ..Available::default() };
        let mut available = guarded(name, || driver.available()).unwrap_or(fallback);
        if available.conventions.node_services.is_empty() {
            available.conventions.node_services = NODE_SERVICES;
        }
        available
    });
    known.collect()
}

/// The middleware that is called `name`, with its rules.
fn known(name: &str) -> Option<Available<'static>> {
    available().into_iter().find(|known| known.name == name)
}

/// True where a middleware carries an interaction itself.
pub(crate) fn carries(name: &str, interaction: Interaction) -> bool {
    known(name).is_some_and(|known| known.interactions.contains(&interaction))
}

/// Refuses a name that no topic of its middleware can have.
///
/// # Errors
/// Exit code 2 with the rule.
pub fn check_topic(address: &EndpointAddress) -> Result<()> {
    let fault = |text| Failure::Usage(format!("{address}: {text}"));
    known(&address.middleware).map_or(Ok(()), |known| {
        guarded(known.name, || (known.check_topic)(&address.name))?.map_err(fault)
    })
}

/// Names of all that there are.
pub fn names() -> &'static [&'static str] {
    static NAMES: OnceLock<Vec<&'static str>> = OnceLock::new();
    NAMES.get_or_init(|| drivers().iter().map(|(name, _)| *name).collect())
}

/// Names of those that are expected to be there without being asked for.
pub(crate) fn expected() -> Vec<&'static str> {
    let all = drivers().iter();
    let expected =
        all.filter(|(name, driver)| guarded(name, || driver.is_expected()).is_ok_and(|is| is));
    expected.map(|(name, _)| *name).collect()
}

/// Executables that bridge all of a middleware, each with the name of that.
pub(crate) fn whole_bridges() -> Vec<(&'static str, WholeBridge)> {
    let all = drivers().iter();
    let whole = all
        .filter_map(|(name, driver)| Some((*name, guarded(name, || driver.whole_bridge()).ok()??)));
    whole.collect()
}

/// Conventions of a middleware.
pub(crate) fn conventions(middleware: &str) -> Conventions {
    known(middleware).map_or(Conventions::NONE, |known| known.conventions)
}

/// True for an address in ROS, whose programs tell the types of what they offer.
pub fn is_ros(address: &EndpointAddress) -> bool {
    conventions(&address.middleware).has_ros_names
}

/// The middlewares of `registry`, each with the cause that it waits or has ended.
pub(crate) fn wait_causes(registry: &Registry) -> BTreeMap<&'static str, Option<Cause>> {
    let all = names().iter().filter_map(|name| {
        let middleware = registry.get(name).ok()?;
        Some((*name, middleware.ended().or_else(|| middleware.waiting_for())))
    });
    all.collect()
}

/// Error for a name that none of them has.
pub(crate) fn unknown(name: &str) -> Failure {
    let all = names().join(", ");
    Failure::Usage(format!("middleware {name:?} is not available; available: {all}"))
}

/// Names of the settings of one endpoint that only this middleware has.
pub fn option_names(middleware: &str) -> &'static [&'static str] {
    known(middleware).map_or(&[], |known| known.options)
}
