//! State of one route, in the status that a bridge prints.

use serde_json::Value;

use crate::{Output, Process, Result};

/// The last status of a route; `None` where it is not among the bridge's routes.
pub fn route_status(output: &Output, name: &str) -> Option<Value> {
    let last = output.objects().next_back()?;
    let routes = last.get("routes")?.as_array()?;
    routes.iter().find(|route| route.get("name").is_some_and(|it| it == name)).cloned()
}

/// Waits until a route is as wanted; `None` stands for one that is not there.
pub fn until_route(
    bridge: &Process,
    name: &str,
    wanted: impl Fn(Option<&Value>) -> bool,
) -> Result {
    bridge.wait_until(&format!("a state of {name}"), |output| {
        output.objects().next()?;
        wanted(route_status(output, name).as_ref()).then_some(())
    })
}
