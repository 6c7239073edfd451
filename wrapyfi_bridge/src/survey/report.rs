//! The report as Markdown, for people and for the ticket of a move.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use wrapyfi_endpoint::Interaction;

use super::facts::{Entry, Facts, LOG};
use crate::learned::is_common;
use crate::visible::escaped;

/// The report. `routes` is the name of the configuration that was written with it.
pub(super) fn report(facts: &Facts, routes: &str) -> String {
    let mut text = String::new();
    head(&mut text, facts, routes);
    heed(&mut text, facts);
    topics(&mut text, facts);
    if !facts.is_bag {
        offered(&mut text, facts, Interaction::Service, "Services", "Server");
        offered(&mut text, facts, Interaction::Action, "Actions", "Server");
        reconfigured(&mut text, facts);
        parameters(&mut text, facts);
    }
    nodes(&mut text, facts);
    text
}

/// A cell of a table.
fn cell(text: &str) -> String {
    escaped(text).replace('|', "\\|").replace('\n', " ")
}

fn table(text: &mut String, heads: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
    let _infallible = writeln!(text, "| {} |", heads.join(" | "));
    let _infallible = writeln!(text, "|{}", " --- |".repeat(heads.len()));
    for row in rows {
        let cells: Vec<String> = row.iter().map(|one| cell(one)).collect();
        let _infallible = writeln!(text, "| {} |", cells.join(" | "));
    }
    text.push('\n');
}

fn section(text: &mut String, title: &str) {
    let _infallible = writeln!(text, "## {title}\n");
}

fn head(text: &mut String, facts: &Facts, routes: &str) {
    let (count, routes) = (|interaction| facts.own(interaction).count(), escaped(routes));
    let [topics, services, actions] = Interaction::ALL.map(count);
    let measured = match (facts.is_bag, facts.seconds > 0.0) {
        (true, _) => format!("Rates and sizes are those of the bag, of {:.1} s", facts.seconds),
        (_, true) => format!("Rates and sizes were measured over {:.0} s", facts.seconds),
        _ => "Rates and sizes were not measured".to_owned(),
    };
    let types = match facts.knows_ros2 {
        true => {
            "types count as known where the ROS 2 that is sourced, or a folder of definitions, has them"
        }
        false => {
            "no ROS 2 is sourced here: types of the packages that every ROS has count as known"
        }
    };
    let (of, nodes) = (escaped(&facts.of), facts.nodes().len());
    let found = match facts.is_bag {
        true => format!(
            "{topics} topics of {nodes} nodes. A bag tells neither who hears them nor services, actions and parameters"
        ),
        false => format!(
            "{topics} topics, {services} services, {actions} actions and {} parameters of {nodes} nodes",
            facts.parameters.len()
        ),
    };
    let _infallible = writeln!(
        text,
        "# Survey of {of}\n\n{found}. {measured}; {types}. The routes of `{routes}` carry what is here: \
         `wrapyfi check {routes}`, `wrapyfi bridge --config {routes}`.\n",
    );
}

/// Decisions and repairs that go before the move.
fn heed(text: &mut String, facts: &Facts) {
    section(text, "To decide first");
    let mut lines = facts.conflicts.clone();
    let taken = facts.taken_names();
    for entry in facts.entries.iter().filter(|entry| !entry.is_of_ros1()) {
        let (kind, name, ros2) = (entry.interaction, &entry.name, entry.ros2_name());
        if let Some(other) = taken.get(&(kind, name.as_str())) {
            lines.push(format!(
                "{kind} `{name}` would be `{ros2}` on ROS 2, which is what `{other}` has there: rename one"
            ));
        } else if ros2 != *name {
            lines.push(format!("{kind} `{name}` is no name of ROS 2: it is `{ros2}` there"));
        }
        if let Some(fault) = entry.name_fault() {
            lines.push(format!("{kind} `{name}` has no name on ROS 2: {fault}"));
        }
        if let Err(why) = &entry.ros2_type {
            lines.push(format!("{kind} `{name}`: its type is not known: {why}"));
        }
        // The log has its rule.
        let differences = entry.differences.iter().filter(|_| name != LOG);
        lines.extend(differences.map(|it| format!("{kind} `{name}`: {it}")));
    }
    for (package, types) in facts.missing_packages() {
        let types: Vec<&str> = types.into_iter().collect();
        lines.push(format!(
            "package `{package}` is not on ROS 2 here ({}): {}",
            types.join(", "),
            match types.iter().all(|name| is_common(name)) {
                true => "install it".to_owned(),
                false => format!(
                    "install it, or write it with `wrapyfi export ros: --package {package}`{}",
                    match facts.is_bag {
                        true => ", while its nodes run or `wrapyfi play --to ros:` plays the bag",
                        false => "",
                    }
                ),
            }
        ));
    }
    if facts.simulates_time {
        lines.push("time comes from `/clock`: nodes on ROS 2 need `use_sim_time`".to_owned());
    }
    if lines.is_empty() {
        lines.push("nothing: names and types are those of ROS 2".to_owned());
    }
    for line in lines {
        let _infallible = writeln!(text, "- {}", escaped(&line).replace('\n', " "));
    }
    text.push('\n');
}

fn kind_of(entry: &Entry) -> String {
    let ros1 = entry.ros1_type.as_deref().unwrap_or("?");
    match &entry.ros2_type {
        Ok(ros2) if entry.is_defined => format!("{ros1} → {ros2}"),
        Ok(ros2) => format!("{ros1} → {ros2} (not on ROS 2 here)"),
        Err(_) => format!("{ros1} → ?"),
    }
}

fn names<'n>(of: impl IntoIterator<Item = &'n String>) -> String {
    let names: Vec<&str> = of.into_iter().map(String::as_str).collect();
    if names.is_empty() { "–".to_owned() } else { names.join(", ") }
}

/// `6.2 MB`, as `rostopic bw` rounds.
fn size(bytes: f64) -> String {
    match bytes {
        bytes if bytes >= 1e6 => format!("{:.1} MB", bytes / 1e6),
        bytes if bytes >= 1e3 => format!("{:.1} kB", bytes / 1e3),
        bytes => format!("{bytes:.0} B"),
    }
}

fn topics(text: &mut String, facts: &Facts) {
    section(text, "Topics");
    let is_heard = !facts.is_bag;
    let rows = facts.own(Interaction::Topic).map(|entry| {
        let [rate, each, each_second] = match entry.traffic {
            None => ["–", "–", "–"].map(str::to_owned),
            Some(it) => [
                format!("{:.1}", it.rate_hz),
                size(it.bytes as f64),
                format!("{}/s", size(it.bytes as f64 * it.rate_hz)),
            ],
        };
        let latched = if entry.is_latched { "yes" } else { "" };
        let ends = [Some(names(&entry.providers)), is_heard.then(|| names(&entry.takers))];
        let cells =
            [entry.name.clone(), kind_of(entry)].into_iter().chain(ends.into_iter().flatten());
        cells.chain([rate, each, each_second, latched.to_owned(), entry.qos()]).collect()
    });
    let ends = [Some("Publishers"), is_heard.then_some("Subscribers")];
    let heads = ["Topic", "Type"].into_iter().chain(ends.into_iter().flatten());
    let measured = ["Hz", "Message", "Data", "Latched", "Quality of service on ROS 2"];
    table(text, &heads.chain(measured).collect::<Vec<_>>(), rows);
}

fn offered(text: &mut String, facts: &Facts, interaction: Interaction, title: &str, role: &str) {
    section(text, title);
    let mut all = facts.own(interaction).peekable();
    if all.peek().is_none() {
        text.push_str("None.\n\n");
        return;
    }
    let rows = all.map(|entry| {
        vec![entry.name.clone(), kind_of(entry), names(&entry.providers), names(&entry.takers)]
    });
    table(text, &["Name", "Type", role, "Clients (of actions)"], rows);
}

fn reconfigured(text: &mut String, facts: &Facts) {
    let servers: Vec<&Entry> =
        facts.of(Interaction::Service).filter(|entry| entry.is_reconfigure()).collect();
    if servers.is_empty() {
        return;
    }
    section(text, "Servers of dynamic_reconfigure");
    text.push_str("Their values are parameters of a node on ROS 2.\n\n");
    let rows = servers.into_iter().map(|entry| {
        let namespace = entry.name.strip_suffix("/set_parameters").unwrap_or(&entry.name);
        vec![namespace.to_owned(), names(&entry.providers)]
    });
    table(text, &["Namespace", "Node"], rows);
}

fn parameters(text: &mut String, facts: &Facts) {
    section(text, "Parameters");
    let mut spaces = BTreeMap::<&str, usize>::new();
    for name in &facts.parameters {
        let space =
            name.match_indices('/').nth(1).map_or("/", |(end, _)| name.get(..end).unwrap_or(name));
        *spaces.entry(space).or_default() += 1;
    }
    if spaces.is_empty() {
        text.push_str("None.\n\n");
        return;
    }
    text.push_str(
        "A namespace of the parameter server becomes the parameters of the node of its name.\n\n",
    );
    let rows = spaces.into_iter().map(|(space, count)| vec![space.to_owned(), count.to_string()]);
    table(text, &["Namespace", "Parameters"], rows);
}

fn nodes(text: &mut String, facts: &Facts) {
    section(text, "Nodes");
    let mut nodes: Vec<(&str, [usize; 4])> = facts.nodes().into_iter().collect();
    // Those on which the least hangs move first.
    nodes.sort_by_key(|(name, counts)| (counts.iter().sum::<usize>(), *name));
    text.push_str("Those with the fewest connections first: they are the easiest to move.\n\n");
    let heads = ["Node", "Publishes", "Hears", "Services", "Actions"];
    // A bag tells what nodes published, and no more.
    let heads = heads.get(..2).filter(|_| facts.is_bag).unwrap_or(&heads);
    let rows = nodes.into_iter().map(|(name, counts)| {
        let counts = counts.iter().map(ToString::to_string);
        std::iter::once(name.to_owned()).chain(counts).take(heads.len()).collect()
    });
    table(text, heads, rows);
}

#[cfg(test)]
mod tests {
    use super::super::facts::Traffic;
    use super::super::facts::tests::entry;
    use super::*;

    #[test]
    fn what_is_to_be_decided_stands_first() {
        let mut scan = entry(Interaction::Topic, "/scan", "sensor_msgs/msg/LaserScan");
        scan.traffic = Some(Traffic { rate_hz: 10.0, bytes: 2_900 });
        let mut odd = entry(Interaction::Topic, "/cam/1st", "demo/msg/Odd");
        (odd.is_defined, odd.is_latched) = (false, true);
        let mut unknown = entry(Interaction::Service, "/go", "demo/srv/Go");
        unknown.ros2_type = Err("nobody shows it".to_owned());
        let set = entry(
            Interaction::Service,
            "/arm/set_parameters",
            "dynamic_reconfigure/srv/Reconfigure",
        );
        let facts = Facts {
            of: "http://base:11311".to_owned(),
            seconds: 3.0,
            entries: vec![scan, odd, unknown, set],
            parameters: ["/arm/gain", "/arm/rate", "/name"].map(str::to_owned).into(),
            conflicts: vec!["demo/msg/Odd has 2 definitions".to_owned()],
            ..Facts::default()
        };
        let text = report(&facts, "survey.yaml");
        for line in [
            "2 topics, 1 services, 0 actions and 3 parameters of 1 nodes.",
            "- demo/msg/Odd has 2 definitions\n",
            "- topic `/cam/1st` is no name of ROS 2: it is `/cam/_1st` there\n",
            "- service `/go`: its type is not known: nobody shows it\n",
            "`wrapyfi export ros: --package demo`",
            "| /scan | sensor_msgs/LaserScan → sensor_msgs/msg/LaserScan | /base | – | 10.0 | 2.9 kB | 29.0 kB/s |  | sensor_data",
            "| yes | reliable, transient_local, depth 1 |",
            "| /arm | /base |",
            "| /arm | 2 |\n",
            "| / | 1 |\n",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        assert!(text.find("To decide").unwrap() < text.find("## Topics").unwrap());
    }
}
