//! A configuration as a bridge runs it: the file, changed by the parameters and arguments of its node.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use wrapyfi_data::types::{MessageType, RosAction};
use wrapyfi_endpoint::Mutex;
use wrapyfi_engine::{Applier, Plan, Route, RouteIndex, RouteTypes};
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;
use wrapyfi_node::parameters::ParameterStore;

use crate::exit::{Failure, Result};
use crate::middlewares::{Endpoints, Loaded, show_endpoints, take_parameters};
use crate::node::{GRAPH, Node};
use crate::on_graph::info;
use crate::overrides;
use crate::own_address::OwnAddress;

/// Duration and output of a bridge's run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Time to run; without end where `None`.
    pub seconds: Option<Duration>,
    /// One JSON object a second on stdout.
    pub json: bool,
    /// Port of the live page; as the configuration says where `None`.
    pub page_port: Option<u16>,
    /// True where the node waits for others to configure and activate it.
    pub no_autostart: bool,
    /// Address at which others reach the endpoints of the routes.
    pub own: OwnAddress,
    /// The middleware without which the node has nothing to do: when another program ends it, the node ends
    /// with an error, so that it is started again where that is wished.
    pub lives_with: Option<&'static str>,
}

/// Settings that a running bridge has, beside its routes.
#[derive(Debug, Clone)]
pub struct InForce {
    /// Name of the configuration.
    pub file: String,
    /// True where the parameters of the node are the configuration.
    pub is_of_parameters: bool,
    /// Settings of the middlewares, with what parameters and arguments changed.
    pub endpoints: Endpoints,
    /// Folders of definitions.
    pub definitions: Vec<PathBuf>,
    /// Routes of the file that were left out since.
    pub removed: Plan,
}

/// A bridge that runs, as those who ask about it need it.
#[derive(Clone)]
pub struct Running {
    /// The bridge's node.
    pub node: Node,
    /// The routes.
    pub routes: Applier,
    /// Settings beside the routes.
    pub in_force: Arc<Mutex<InForce>>,
}

impl Running {
    /// Present statuses of the routes as messages, with the names that the node has for their ends.
    pub fn infos(&self) -> Vec<RouteInfo> {
        info::of_all(&self.routes.status(), &self.node)
    }
}

/// Changes a configuration by what the parameters and arguments of the bridge's `node` say.
///
/// # Errors
/// Exit code 2 for a name that there is not, a value that it cannot have, or an address that other machines reach
/// without permission.
pub fn change_by(
    loaded: &mut Loaded,
    node: &Node,
    parameters: &mut ParameterStore,
    options: &Options,
) -> Result<()> {
    change_endpoints(&mut loaded.endpoints, node, parameters, options)?;
    loaded.endpoints.check_permitted(loaded.file.as_deref())?;
    show_endpoints(&loaded.endpoints, parameters);
    overrides::apply(&mut loaded.plan, node, parameters).map_err(Failure::usage)
}

/// Changes settings of middlewares as [`change_by`] does; once more changes nothing.
///
/// # Errors
/// Exit code 2 for a name that there is not, or a value that it cannot have.
pub fn change_endpoints(
    endpoints: &mut Endpoints,
    node: &Node,
    parameters: &mut ParameterStore,
    options: &Options,
) -> Result<()> {
    if let Some(middleware) = options.lives_with {
        // One name on both sides, unless the file says another.
        endpoints.name_node(middleware, &node.name().fqn());
    }
    take_parameters(endpoints, parameters)?;
    endpoints.reached_at(options.own);
    Ok(())
}

/// Warns of routes that do not hear what others of the plan publish; `lines` are those of the routes in
/// their file.
pub(crate) fn warn_of_unheard(routes: &RouteIndex<'_>, lines: &[u64]) {
    for unheard in routes.unheard() {
        tracing::warn!("{}: {unheard}", in_lines(&unheard.places, lines));
    }
}

/// Lines of routes by their places in the plan, as `lines 3, 4 and 7`; those that were added stand in none.
pub(crate) fn in_lines(places: &[usize], lines: &[u64]) -> String {
    let lines = places.iter().filter_map(|place| lines.get(*place)).filter(|line| **line > 0);
    let mut each: Vec<_> = lines.map(u64::to_string).collect();
    match (each.pop(), each.is_empty()) {
        (None, _) => "routes that were added".to_owned(),
        (Some(only), true) => format!("line {only}"),
        (Some(last), false) => format!("lines {} and {last}", each.join(", ")),
    }
}

/// ROS types of the endpoints that routes have on ROS 2.
pub(crate) fn ros2_types(plan: &Plan) -> BTreeSet<&'static str> {
    let ends = |route: &Route| {
        let types = match route.types {
            RouteTypes::Service(kind) => [Some(kind.ros_type()); 2],
            RouteTypes::Action(kind) => [kind.map(RosAction::name); 2],
            // Properties are on no topic of ours.
            RouteTypes::Topic(types) => [types.from, types.to]
                .map(|it| (it != MessageType::Properties).then(|| it.ros_type())),
        };
        let named = [&route.from, &route.to].into_iter().zip(types);
        named.filter_map(|(end, name)| name.filter(|_| end.middleware == GRAPH)).collect::<Vec<_>>()
    };
    plan.routes.iter().filter(|route| route.is_whole()).flat_map(ends).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_those_of_the_file_alone() {
        let of = |places: &[usize]| in_lines(places, &[3, 4, 7, 0]);
        assert_eq!(of(&[0, 1, 2]), "lines 3, 4 and 7");
        assert_eq!(of(&[1, 3]), "line 4");
        assert_eq!(of(&[3]), "routes that were added");
    }
}
