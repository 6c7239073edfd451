//! Steps of the walk at the server of an action: its parts, its status, its time.

use std::collections::BTreeSet;

use wrapyfi_endpoint::{CauseCode, Discovered, Role};

use super::actions::{ActionTime, CLOCK, MOST_APART_S, half, parts, statuses};
use super::judge::{Walk, may_be_bridge};
use super::words::owner;
use super::{Finding, StepResult, WayEnd};
use crate::middlewares::is_ros;
use crate::node::GRAPH;

impl Walk<'_> {
    /// All five parts of a server: fails where a node has only some.
    pub(super) fn parts_of_action(&self, end: &WayEnd) -> StepResult {
        let Some((node, has)) = half(end) else { return Ok(()) };
        let short = |word: &&'static str| word.rsplit('/').next().unwrap_or(word).to_owned();
        let all = parts(&end.address.middleware).map(|(word, _)| word);
        let lacks: Vec<_> = all.iter().filter(|word| !has.contains(&**word)).map(short).collect();
        let node = node.unwrap_or_else(|| "a node that has not told its name".to_owned());
        let has = has.iter().map(short).collect::<Vec<_>>().join(", ");
        let address = &end.address;
        let what = format!(
            "{node} has only {has} of the action {address}; a server has all five parts, and {} are not found",
            lacks.join(", ")
        );
        let remedy = format!(
            "ask again where it has just begun; else look at that program: `wrapyfi list {}` shows what it has",
            address.middleware
        );
        Err(Finding::new(CauseCode::NotReady, what, node, remedy))
    }

    /// Status and time of an action's server.
    pub(super) fn server_of_action(&mut self, end: &WayEnd) -> StepResult {
        self.only_status(end)?;
        let address = &end.address;
        let mut servers: Vec<_> = end.of(Role::ActionServer).map(owner).collect();
        servers.sort_by_key(|server| end.was_killed(server));
        let Some(server) = servers.first() else { return Ok(()) };
        let ActionTime { simulated_by, has_clock, ahead_s } = &end.action_time;
        let is_ros2 = address.middleware == GRAPH;
        if let Some(by) = simulated_by {
            if *has_clock {
                self.pass(format!(
                    "{server} has simulated time: the bridge needs use_sim_time, too (--ros-args -p use_sim_time:=true)"
                ));
                return Ok(());
            }
            let what = format!(
                "use_sim_time of {by} is true, and nobody publishes {}:{CLOCK}: the time of {server} stands still, and \
                 what it does by time never ends",
                address.middleware
            );
            let unset = match is_ros2 {
                true => format!("ros2 param set {server} use_sim_time false"),
                false => "rosparam set /use_sim_time false, and start its nodes again".to_owned(),
            };
            let remedy =
                format!("start the simulation, or what plays the bag with --clock; or {unset}");
            return Err(Finding::new(CauseCode::Setting, what, "whoever starts the nodes", remedy));
        }
        let Some(ahead_s) = ahead_s.filter(|ahead_s| ahead_s.abs() >= MOST_APART_S) else {
            return Ok(());
        };
        let (ahead, past) = match ahead_s > 0.0 {
            true => ("ahead of", "sent from here"),
            false => ("behind", "of its own machine"),
        };
        let what = format!(
            "the clock of {server} is {:.0} s {ahead} the one here: goals {past} have stamps in the past, and a server \
             gives up one that is older than another",
            ahead_s.abs()
        );
        let remedy = "let both machines follow one clock (chrony, ntpd); where one has simulated time, set use_sim_time \
                      for the other, too";
        Err(Finding::new(CauseCode::Setting, what, "either machine", remedy))
    }

    /// The node that alone publishes the status of an action on ROS 1; where a route offers the action, the bridge.
    pub(super) fn only_status(&self, end: &WayEnd) -> StepResult {
        let address = &end.address;
        if address.middleware == GRAPH || !is_ros(address) {
            return Ok(());
        }
        let alive = || statuses(end).filter(|one| !end.was_killed(&owner(one)));
        let nodes: BTreeSet<_> = alive().map(owner).collect();
        let is_offered = self.way.destination.as_ref().is_some_and(|it| it.address == *address);
        let is_rival = |one: &Discovered| !may_be_bridge(one, &address.middleware, &self.way.node);
        let has_rival = alive().any(is_rival);
        if !(nodes.len() > 1 || (is_offered && has_rival)) {
            return Ok(());
        }
        let all: Vec<_> = nodes.into_iter().collect();
        let what = match is_offered {
            true => format!(
                "{} offers the action {address}: beside it the bridge does not, because every client takes a goal as lost \
                 that the status of one of them lacks",
                all.join(", ")
            ),
            false => format!(
                "{} publish the status of the action {address}: every client takes a goal as lost that one of them lacks",
                all.join(" and ")
            ),
        };
        let who = all.last().cloned().unwrap_or_default();
        let remedy =
            "end all servers of the action but one, or give the others, or the route, another name";
        Err(Finding::new(CauseCode::NameTaken, what, who, remedy))
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::Interaction;

    use super::super::judge::judge;
    use super::super::server_check::ConnectOutcome;
    use super::super::{Registered, Way};
    use super::*;

    fn one(node: &str, name: &str, role: Role, type_name: &str) -> Discovered {
        let (node, type_name) = (Some(node.to_owned()), Some(type_name.to_owned()));
        Discovered { node, type_name, ..Discovered::new(name, role) }
    }

    /// Parts of a server of `/do`, but for the first ones.
    fn server(middleware: &str, node: &str, without: usize) -> Vec<Discovered> {
        let types = match middleware {
            GRAPH => ["a/action/Do_SendGoal"; 5],
            _ => [
                "a/DoActionGoal",
                "actionlib_msgs/GoalID",
                "actionlib_msgs/GoalStatusArray",
                "a/DoActionFeedback",
                "a/DoActionResult",
            ],
        };
        let all = parts(middleware).into_iter().zip(types).skip(without);
        let made = |((word, role), kind): ((&str, Role), &str)| {
            one(node, &format!("/do{word}"), role, kind)
        };
        let mut made: Vec<_> = all.map(made).collect();
        if without == 0 {
            made.push(one(node, "/do", Role::ActionServer, "a/action/Do"));
        }
        made
    }

    fn way(middleware: &str, found: Vec<Discovered>) -> Way {
        let address = format!("{middleware}:/do").parse().unwrap();
        let source = Some(WayEnd { found, ..WayEnd::new(address) });
        Way { interaction: Interaction::Action, source, ..Way::default() }
    }

    fn found(way: &Way) -> Option<(CauseCode, String, String)> {
        judge(way).finding.map(|it| (it.cause, it.what, it.remedy))
    }

    #[test]
    fn a_server_with_some_parts_is_told_with_those_that_lack() {
        for (middleware, lacks) in
            [(GRAPH, "send_goal, cancel_goal are not found"), ("ros", "goal, cancel are not found")]
        {
            let (cause, what, _) = found(&way(middleware, server(middleware, "/arm", 2))).unwrap();
            assert_eq!(cause, CauseCode::NotReady);
            assert!(what.starts_with("/arm has only ") && what.contains(lacks), "{what}");
            assert_eq!(found(&way(middleware, server(middleware, "/arm", 0))), None);
            // The parts of two nodes are no server.
            let mut two = server(middleware, "/arm", 2);
            two.extend(server(middleware, "/leg", 0).into_iter().take(2));
            assert_eq!(found(&way(middleware, two)).unwrap().0, CauseCode::NotReady);
        }
        // Topics of ROS 1 that are called so by chance.
        let status = one("/arm", "/do/status", Role::Publisher, "std_msgs/String");
        assert_eq!(found(&way("ros", vec![status])).unwrap().0, CauseCode::NobodyOffers);
    }

    #[test]
    fn a_second_status_is_told() {
        let mut two = server("ros", "/arm", 0);
        two.push(one("/bag", "/do/status", Role::Publisher, "actionlib_msgs/GoalStatusArray"));
        let (cause, what, _) = found(&way("ros", two)).unwrap();
        assert_eq!(cause, CauseCode::NameTaken);
        assert!(
            what.starts_with("/arm and /bag publish the status of the action ros:/do"),
            "{what}"
        );
        // Of one that was killed the name remains, which its successor is not blamed for.
        let mut one_more =
            way("ros", [server("ros", "/arm_1", 0), server("ros", "/arm_2", 0)].concat());
        assert_eq!(found(&one_more).map(|it| it.0), Some(CauseCode::NameTaken));
        let killed = Registered {
            role: Role::Publisher,
            who: "/arm_1".to_owned(),
            host: "127.0.0.1".to_owned(),
            port: 4711,
            is_told_afar: false,
            answer: ConnectOutcome::Refused,
        };
        one_more.source.as_mut().unwrap().registered.push(killed);
        assert_eq!(found(&one_more).map(|it| it.0), None);
        // The bridge that offers it is one, and another node is one too many.
        for (node, is_told) in [("/wrapyfi_4711", false), ("/arm", true)] {
            let mut way = way(GRAPH, server(GRAPH, "/far", 0));
            let end = WayEnd::new("ros:/do".parse().unwrap());
            way.destination = Some(WayEnd { found: server("ros", node, 0), ..end });
            assert_eq!(found(&way).map(|it| it.0), is_told.then_some(CauseCode::NameTaken));
        }
    }

    #[test]
    fn simulated_time_without_a_clock_is_told() {
        let of = |middleware: &str, has_clock| {
            let mut way = way(middleware, server(middleware, "/arm", 0));
            let simulated_by = Some("/arm".to_owned());
            way.source.as_mut().unwrap().action_time =
                ActionTime { simulated_by, has_clock, ahead_s: None };
            found(&way)
        };
        for (middleware, mends) in [
            (GRAPH, "ros2 param set /arm use_sim_time false"),
            ("ros", "rosparam set /use_sim_time false"),
        ] {
            let (cause, what, remedy) = of(middleware, false).unwrap();
            assert_eq!(cause, CauseCode::Setting);
            assert!(what.contains(&format!("nobody publishes {middleware}:/clock")), "{what}");
            assert!(remedy.contains(mends), "{remedy}");
            assert_eq!(of(middleware, true), None);
        }
    }

    #[test]
    fn clocks_that_do_not_agree_are_told() {
        let of = |ahead_s| {
            let mut way = way("ros", server("ros", "/arm", 0));
            way.source.as_mut().unwrap().action_time.ahead_s = Some(ahead_s);
            found(&way)
        };
        for (ahead_s, words) in [(7.2, "is 7 s ahead of the one here"), (-40.0, "is 40 s behind")] {
            let (cause, what, _) = of(ahead_s).unwrap();
            assert_eq!(cause, CauseCode::Setting);
            assert!(what.contains(words) && what.contains("stamps in the past"), "{what}");
        }
        assert_eq!(of(0.3), None);
    }
}
