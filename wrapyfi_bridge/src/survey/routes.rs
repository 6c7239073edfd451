//! The configuration to start from: a route for each topic, service and action, the other direction beside it.

use std::fmt::Write as _;

use wrapyfi_endpoint::Interaction;

use super::facts::{Entry, Facts};
use crate::visible::escaped;

/// Messages of this size in bytes fill a queue that nobody needs.
const LARGE: u64 = 1 << 20;

/// The configuration. Types are learned from the nodes, so that none is written.
pub(super) fn routes(facts: &Facts, report: &str) -> String {
    let mut text = format!(
        "# Routes of what {} had, to start from: {}. Check them with `wrapyfi check`.\n\
         # Types are learned from the nodes. A line that begins with # is off. lazy: messages are fetched while somebody listens.\n",
        escaped(&facts.of),
        escaped(report),
    );
    if !facts.is_bag {
        let master = quoted(&facts.of);
        let _infallible = writeln!(text, "endpoints:\n  ros: {{ master_uri: {master} }}\n");
    }
    text.push_str("routes:\n");
    let taken = facts.taken_names();
    let of_topics = match facts.is_bag {
        true => {
            "Topics. A bag does not tell who hears them: what nodes on ROS 1 hear needs a line with both sides exchanged when its publisher has moved"
        }
        false => "Topics; the second line is for the time when their publisher has moved",
    };
    for (interaction, title) in [
        (Interaction::Topic, of_topics),
        (Interaction::Service, "Services"),
        (Interaction::Action, "Actions"),
    ] {
        let mut all = facts.of(interaction).filter(|entry| !is_left_out(entry, facts)).peekable();
        if all.peek().is_some() {
            let _infallible = writeln!(text, "  # {title}");
        }
        for entry in all {
            let is_off = taken.contains_key(&(interaction, entry.name.as_str()))
                || entry.name_fault().is_some();
            route(&mut text, entry, is_off);
        }
    }
    if facts.has_parameters {
        text.push_str(PARAMETERS);
    }
    if !text.contains("\n  - ") {
        // A file without routes is refused.
        text.push_str("  # Nothing was there: all that comes.\n  - { from: \"ros:/(.*)\", to: \"ros2:/$1\" }\n");
    }
    text
}

/// Routes of the services and events of all nodes that have parameters.
const PARAMETERS: &str = r#"  # Parameters of nodes, those of dynamic_reconfigure among them
  - { service: "ros:/(.*/(list|get|set|describe)_parameter.*)", as: "ros2:/$1" }
  - { from: "ros:/(.*/parameter_events)", to: "ros2:/$1" }
"#;

/// True for what a bridge has no use for.
fn is_left_out(entry: &Entry, facts: &Facts) -> bool {
    entry.is_of_ros1() || entry.name == "/clock" && !facts.simulates_time
}

fn route(text: &mut String, entry: &Entry, is_off: bool) {
    let (ros1, ros2) = (format!("ros:{}", entry.name), format!("ros2:{}", entry.ros2_name()));
    let [source, destination] = entry.interaction.keys();
    let depth = match (entry.name.as_str(), entry.traffic) {
        ("/tf", _) => ", queue_depth: 100",
        (_, Some(it)) if it.bytes >= LARGE => ", queue_depth: 2",
        _ => "",
    };
    let lazy = if entry.interaction == Interaction::Topic { ", lazy: true" } else { "" };
    let extra = format!("{depth}{lazy}");
    let mut line = |from: &str, to: &str, is_off: bool, comment: &str| {
        let mark = if is_off { "# " } else { "" };
        let (from, to) = (quoted(from), quoted(to));
        let _infallible =
            writeln!(text, "  {mark}- {{ {source}: {from}, {destination}: {to}{extra} }}{comment}");
    };
    let kind = entry.ros1_type.as_deref().map(|it| format!("  # {}", escaped(it)));
    let kind = kind.unwrap_or_default();
    if entry.interaction != Interaction::Topic {
        return line(&ros1, &ros2, is_off, &kind);
    }
    let (is_published, is_heard) = (!entry.providers.is_empty(), !entry.takers.is_empty());
    if is_published {
        line(&ros1, &ros2, is_off, &kind);
    }
    // What only listens on ROS 1 hears nodes of ROS 2.
    let is_both_ways = entry.name == "/tf";
    if is_heard {
        line(&ros2, &ros1, is_off || is_published && !is_both_ways, &kind);
    }
}

/// A text of YAML in quotes: names from a network may have any letters.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::super::facts::tests::entry;
    use super::*;
    use crate::middlewares::load_text;

    #[test]
    fn a_bridge_takes_what_is_written() {
        let mut heard = entry(Interaction::Topic, "/cmd_vel", "geometry_msgs/msg/Twist");
        heard.takers = BTreeSet::from(["/base".to_owned()]);
        heard.providers.clear();
        let mut both = entry(Interaction::Topic, "/cam/1st", "demo/msg/Odd");
        both.takers = BTreeSet::from(["/view".to_owned()]);
        let entries = vec![
            entry(Interaction::Topic, "/scan \"x\"", "sensor_msgs/msg/LaserScan"),
            heard,
            both,
            entry(Interaction::Topic, "/rosout_agg", "rcl_interfaces/msg/Log"),
            entry(Interaction::Service, "/go", "demo/srv/Go"),
            entry(Interaction::Service, "/go/get_loggers", "roscpp/srv/GetLoggers"),
            entry(Interaction::Action, "/move", "demo/action/Move"),
        ];
        let of = "http://base:11311".to_owned();
        let facts = Facts { of, entries, has_parameters: true, ..Facts::default() };
        let text = routes(&facts, "survey.md");
        for line in [
            "  - { from: \"ros2:/cmd_vel\", to: \"ros:/cmd_vel\", lazy: true }  # geometry_msgs/Twist\n",
            "  - { from: \"ros:/cam/1st\", to: \"ros2:/cam/_1st\", lazy: true }  # demo/Odd\n",
            "  # - { from: \"ros2:/cam/_1st\", to: \"ros:/cam/1st\", lazy: true }  # demo/Odd\n",
            "  - { service: \"ros:/go\", as: \"ros2:/go\" }",
            "  - { action: \"ros:/move\", as: \"ros2:/move\" }",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        assert!(!text.contains("get_loggers") && !text.contains("rosout_agg"), "{text}");
        let text = text.replace("/scan \\\"x\\\"", "/scan");
        assert_eq!(load_text(&text, "survey.yaml").unwrap().plan.routes.len(), 7, "{text}");
        for is_bag in [false, true] {
            let facts = Facts { of: facts.of.clone(), is_bag, ..Facts::default() };
            let none = routes(&facts, "survey.md");
            assert_eq!(load_text(&none, "survey.yaml").unwrap().plan.routes.len(), 1, "{none}");
            assert_eq!(none.contains("master_uri"), !is_bag, "{none}");
        }
    }
}
