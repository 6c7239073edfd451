//! The route that a name means.
//!
//! ```text
//!   name of a route, or its ends ─▶ written, or made by a pattern ─┐
//!   one end: middleware:/name ─▶ written, running, made            ├─▶ Route, and why a pattern leaves it out
//!                                └ left out of a pattern ──────────┘
//! ```

use wrapyfi_endpoint::{EndpointAddress, Interaction};
use wrapyfi_engine::{LeftOut, Plan, Route, RouteIndex};
use wrapyfi_interfaces::wrapyfi_msgs::msg::RouteInfo;

use super::running;
use crate::middlewares::{self, is_ros};
use crate::near_names::is_absolute;
use crate::on_graph::info::{is_destination, is_source};

/// Reads an address; a middleware may be called as its executable is: `ros1` by `ros1_bridge`.
pub(super) fn address(text: &str) -> Result<EndpointAddress, String> {
    let mut address: EndpointAddress =
        text.parse().map_err(|error: wrapyfi_endpoint::ParseAddressError| error.to_string())?;
    if middlewares::names().iter().all(|known| *known != address.middleware) {
        let executable = format!("{}_bridge", address.middleware);
        let all = middlewares::whole_bridges();
        let Some((name, _)) = all.iter().find(|(_, whole)| whole.executable == executable) else {
            return Err(middlewares::unknown(&address.middleware).to_string());
        };
        address.middleware = (*name).to_owned();
    }
    // Elsewhere a name is what is written.
    if is_ros(&address) && !is_absolute(&address.name) {
        address.name.insert(0, '/');
    }
    Ok(address)
}

pub(super) type LeftOutName = Option<(String, LeftOut)>;

/// Route that a name means: by its name, its ends, or one of them; of a pattern the route that it makes for
/// the name, or the reason that it makes none. Of two routes with the same end it is the one that is `running`.
pub(super) fn route(
    plan: &Plan,
    index: &RouteIndex<'_>,
    running: &[RouteInfo],
    name: &str,
) -> Option<(Route, LeftOutName)> {
    let named = plan.routes.iter().find(|route| route.name == name || route.ends() == name);
    let between = || made_between(plan, name, running.iter().find(|one| one.key == name));
    let with_written = |route: Route| {
        let one = index.instead_of(&route).filter(|_| !route.is_many());
        let left_out = one.map(|one| (route.ends(), LeftOut::Written(one.name.clone())));
        Some((route, left_out))
    };
    if let Some(route) = named.cloned().or_else(between) {
        return with_written(route);
    }
    let address = address(name).ok()?;
    let text = address.to_string();
    let runs = || {
        let from = running.iter().find(|one| is_source(one, &text));
        let one = from.or_else(|| running.iter().find(|one| is_destination(one, &text)))?;
        made_between(plan, &one.key, Some(one))
    };
    let make = |made: fn(&Route, &EndpointAddress) -> Option<Route>| {
        plan.routes.iter().find_map(|pattern| made(pattern, &address))
    };
    // A bridge may have another name for it than the file.
    let is_written = |one: &&Route| one.from == address || one.to == address;
    let written = index.written_at(&address).or_else(|| plan.routes.iter().find(is_written));
    let written = written.cloned();
    let any = || make(Route::made_from).or_else(|| make(Route::made_to));
    if let Some(route) = written.or_else(runs).or_else(any) {
        return with_written(route);
    }
    left_out(plan, &address)
}

/// Pattern that leaves a name out, at either end, and why.
pub(super) fn left_out(plan: &Plan, address: &EndpointAddress) -> Option<(Route, LeftOutName)> {
    let text = address.to_string();
    let mut many = plan.routes.iter().filter(|one| one.from.middleware == address.middleware);
    let left_out = |pattern: &Route| Some((pattern.clone(), pattern.left_out(&address.name)?));
    if let Some((pattern, why)) = many.find_map(left_out) {
        return Some((pattern, Some((text, why))));
    }
    let mut many = plan.routes.iter().filter(|one| one.to.middleware == address.middleware);
    many.find_map(|pattern| Some((pattern.clone(), Some(pattern.left_out_to(&address.name)?))))
}

/// Route that a pattern makes, by its name: its ends. Topics and services may have the same ones: its interaction is that
/// of the route that is `running`.
fn made_between(plan: &Plan, name: &str, running: Option<&RouteInfo>) -> Option<Route> {
    let (first, second) = Route::read_ends(name)?;
    let (first, second) = (address(first).ok()?, address(second).ok()?);
    let is_meant =
        |pattern: &&Route| running.is_none_or(|running| running::is_alike(pattern, running));
    plan.routes.iter().filter(is_meant).find_map(|pattern| {
        let [from, to] = pattern.interaction().in_direction(&first, &second);
        pattern.made_between(from, to)
    })
}

/// Route that a pattern makes to an address, where `made` is what another one makes from there.
pub(super) fn other_way(plan: &Plan, made: &Route, address: &EndpointAddress) -> Option<Route> {
    let is_written = plan.routes.iter().any(|one| one.name == made.name && !one.is_many());
    let is_from = made.from == *address && !made.is_many() && !is_written;
    let mut patterns =
        plan.routes.iter().filter(|one| is_from && one.interaction() == made.interaction());
    patterns.find_map(|pattern| pattern.made_to(address))
}

/// Routes of other interactions with the ends of one that a pattern makes, the first of each.
pub(super) fn of_other_kinds(plan: &Plan, made: &Route) -> Vec<Route> {
    let is_written = plan.routes.iter().any(|one| one.name == made.name && !one.is_many());
    let of = |interaction: Interaction| {
        let mut patterns = plan.routes.iter().filter(|one| one.interaction() == interaction);
        patterns.find_map(|pattern| pattern.made_from(&made.from).filter(|it| it.to == made.to))
    };
    let is_other = |one: &Interaction| *one != made.interaction() && !is_written;
    Interaction::ALL.into_iter().filter(is_other).filter_map(of).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::middlewares::load_text;
    use crate::node::Node;

    pub(in crate::why) fn plan(routes: &[&str]) -> Plan {
        let lines = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect::<String>();
        load_text(&format!("routes:\n{lines}"), "x.yaml").unwrap().plan
    }

    pub(in crate::why) fn index(plan: &Plan) -> RouteIndex<'_> {
        let node = Node::bridge().unwrap();
        plan.index(|address| node.resolve(address))
    }

    fn found(plan: &Plan, name: &str) -> Option<(String, bool)> {
        found_beside(plan, &[], name)
    }

    /// As [`found`], where routes run.
    fn found_beside(plan: &Plan, keys: &[&str], name: &str) -> Option<(String, bool)> {
        let info = |key: &&str| {
            let [source, destination] =
                key.split(" -> ").map(str::to_owned).collect::<Vec<_>>().try_into().unwrap();
            RouteInfo { key: (*key).to_owned(), source, destination, ..RouteInfo::default() }
        };
        let running: Vec<_> = keys.iter().map(info).collect();
        let found = route(plan, &index(plan), &running, name);
        found.map(|(route, left_out)| (route.ends(), left_out.is_some()))
    }

    #[test]
    fn a_route_is_found_by_name_and_by_either_end() {
        let plan = plan(&[
            "name: cam, from: 'zeromq:/cam', to: 'ros2:cam', type: Image",
            "from: 'ros:/(.*)', to: 'ros2:/one/$1', deny: ['raw']",
        ]);
        let cam = Some(("zeromq:/cam -> ros2:cam".to_owned(), false));
        for name in ["cam", "zeromq:/cam -> ros2:cam", "zeromq:/cam", "ros2:/cam"] {
            assert_eq!(found(&plan, name), cam, "{name}");
        }
        assert_eq!(found(&plan, "ros1:/x"), Some(("ros:/x -> ros2:/one/x".to_owned(), false)));
        for left_out in ["ros:/raw", "ros2:/one/raw"] {
            assert!(found(&plan, left_out).is_some_and(|(_, is_left_out)| is_left_out));
        }
        assert_eq!(found(&plan, "yarp:/x"), None);
    }

    #[test]
    fn what_a_written_route_takes_from_a_pattern_is_told() {
        let plan = plan(&[
            "name: chat, from: 'ros:/chat', to: 'ros2:/words'",
            "from: 'ros:/(.*)', to: 'ros2:/one/$1'",
        ]);
        let (_, left_out) = route(&plan, &index(&plan), &[], "ros2:/one/chat").unwrap();
        let ends = "ros:/chat -> ros2:/one/chat".to_owned();
        assert_eq!(left_out, Some((ends, LeftOut::Written("chat".to_owned()))));
        assert_eq!(found(&plan, "ros:/chat"), Some(("ros:/chat -> ros2:/words".to_owned(), false)));
    }

    #[test]
    fn names_that_ros_2_lacks_are_found_at_either_end() {
        let both =
            plan(&["from: 'ros2:/(.*)', to: 'ros:/$1'", "from: 'ros:/(.*)', to: 'ros2:/$1'"]);
        for (runs, names) in [
            ("ros2:/robot_1/cmd -> ros:/robot-1/cmd", ["ros2:/robot_1/cmd", "ros:/robot-1/cmd"]),
            ("ros:/robot-1/x -> ros2:/robot_1/x", ["ros2:/robot_1/x", "ros:/robot-1/x"]),
        ] {
            for name in names {
                assert_eq!(found_beside(&both, &[runs], name), Some((runs.to_owned(), false)));
            }
        }
    }

    #[test]
    fn the_other_way_is_that_to_the_name() {
        let both =
            plan(&["from: 'ros2:/(.*)', to: 'ros:/$1'", "from: 'ros:/(.*)', to: 'ros2:/$1'"]);
        let (made, _) = route(&both, &index(&both), &[], "ros2:/x").unwrap();
        let other = |name: &str| other_way(&both, &made, &address(name).unwrap());
        assert_eq!(other("ros2:/x").unwrap().ends(), "ros:/x -> ros2:/x");
        assert!(other("ros:/x").is_none());
    }

    /// A name may be that of a topic, of a service and of an action at once.
    #[test]
    fn patterns_of_all_interactions_have_a_name() {
        let all = plan(&[
            "from: 'ros:/(.*)', to: 'ros2:/$1'",
            "service: 'ros2:/(.*)', as: 'ros:/$1'",
            "action: 'ros2:/(.*)', as: 'ros:/$1'",
            "action: 'ros:/(.*)', as: 'ros2:/$1'",
        ]);
        for place in [0, 3] {
            let made = all.routes[place].made_from(&address("ros:/x").unwrap()).unwrap();
            let others = of_other_kinds(&all, &made);
            let kinds: Vec<_> = others.iter().map(Route::interaction).collect();
            assert!(others.iter().all(|it| (&it.from, &it.to) == (&made.from, &made.to)));
            let other = if place == 0 { Interaction::Action } else { Interaction::Topic };
            assert_eq!(kinds, [other]);
        }
        let both = plan(&[
            "from: 'ros2:/(.*)', to: 'ros:/$1'",
            "service: 'ros2:/(.*)', as: 'ros:/$1'",
            "action: 'ros2:/(.*)', as: 'ros:/$1'",
        ]);
        let made = both.routes[0].made_from(&address("ros2:/x").unwrap()).unwrap();
        let kinds: Vec<_> = of_other_kinds(&both, &made).iter().map(Route::interaction).collect();
        assert_eq!(kinds, [Interaction::Service, Interaction::Action]);
    }

    #[test]
    fn written_routes_with_an_end_in_common_are_told_each() {
        let mixed = plan(&[
            "from: 'zeromq:/a', to: 'ros2:/c', type: Text, merge: true",
            "from: 'zeromq:/b', to: 'ros2:/c', type: Text, merge: true",
        ]);
        assert_eq!(found(&mixed, "zeromq:/b"), Some(("zeromq:/b -> ros2:/c".to_owned(), false)));
    }

    #[test]
    fn a_route_of_a_pattern_is_found_by_its_name_and_in_the_direction_that_runs() {
        let both = plan(&[
            "from: 'ros2:/(.*)', to: 'ros:/$1'",
            "from: 'ros:/(.*)', to: 'ros2:/$1'",
            "service: 'ros2:/(.*)', as: 'ros:/$1'",
            "from: 'yarp:/(.*)', to: 'ros2:/of_yarp/$1', type: Text",
        ]);
        let (there, back) = ("ros2:/x -> ros:/x", "ros:/x -> ros2:/x");
        let only = |ends: &str| Some((ends.to_owned(), false));
        for name in [there, back, "ros:/ask -> ros2:/ask"] {
            assert_eq!(found(&both, name), only(name));
        }
        for (runs, name, meant) in
            [(back, "ros2:/x", back), (there, "ros2:/x", there), (there, "ros:/x", there)]
        {
            assert_eq!(found_beside(&both, &[runs], name), only(meant), "{name} beside {runs}");
        }
        let [key, source, destination, kind] =
            [back, "ros:/x", "ros2:/x", "service"].map(str::to_owned);
        let service = RouteInfo { key, source, destination, kind, ..RouteInfo::default() };
        for name in ["ros2:/x", "ros:/x", back] {
            let found = route(&both, &index(&both), std::slice::from_ref(&service), name);
            assert_eq!(found.unwrap().0.interaction(), Interaction::Service, "{name}");
        }
        // Of one of two ways nothing runs.
        assert_eq!(found(&both, "ros2:/x"), only(there));
        let of_yarp = plan(&["from: 'yarp:/(.*)', to: 'ros2:/of_yarp/$1', type: Text"]);
        let wanted = only("yarp:/x -> ros2:/of_yarp/x");
        assert_eq!(found(&of_yarp, "ros2:/of_yarp/x"), wanted);
    }
}
