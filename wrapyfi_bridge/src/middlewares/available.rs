//! Names of the middlewares.

use std::collections::BTreeMap;

use wrapyfi_endpoint::{EndpointAddress, Registry};
use wrapyfi_engine::Available;

use super::{ros1, ros2, yarp, zeromq};
use crate::exit::{Failure, Result};

/// Names under which routes and commands address the middlewares, with their rules for topics.
pub(super) fn available() -> [Available<'static>; 4] {
    [zeromq::AVAILABLE, ros2::AVAILABLE, ros1::AVAILABLE, yarp::AVAILABLE]
}

/// Refuses a name that no topic of its middleware can have.
///
/// # Errors
/// Exit code 2 with the rule.
pub fn check_topic(address: &EndpointAddress) -> Result<()> {
    let known = available().into_iter().find(|known| known.name == address.middleware);
    let fault = |text| Failure::Usage(format!("{address}: {text}"));
    known.map_or(Ok(()), |known| (known.check_topic)(&address.name).map_err(fault))
}

/// Names of all that there are.
pub fn names() -> Vec<&'static str> {
    available().map(|known| known.name).into()
}

/// True for an address in ROS, whose programs tell the types of what they offer.
pub fn is_ros(address: &EndpointAddress) -> bool {
    ["ros2", ros1::AVAILABLE.name].contains(&address.middleware.as_str())
}

/// The middlewares of `registry`, each with what it waits for, or the reason that it has ended.
pub(crate) fn waits(registry: &Registry) -> BTreeMap<&'static str, Option<String>> {
    let all = names().into_iter().filter_map(|name| {
        let middleware = registry.get(name).ok()?;
        Some((name, middleware.ended().or_else(|| middleware.waiting_for())))
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
    available().iter().find(|known| known.name == middleware).map_or(&[], |known| known.options)
}
