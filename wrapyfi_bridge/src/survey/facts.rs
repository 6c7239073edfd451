//! Facts of a graph of ROS 1 that a move to ROS 2 depends on.

use std::collections::{BTreeMap, BTreeSet};

use wrapyfi_endpoint::pattern::ros_name;
use wrapyfi_endpoint::{EndpointAddress, Interaction};
use wrapyfi_interfaces::ros1::{PairPlan, Types};

use crate::middlewares::check_topic;
use crate::node::GRAPH;

/// Package of dynamic_reconfigure, and the type of the services with which its servers take values.
const RECONFIGURE_PACKAGE: &str = "dynamic_reconfigure/";
pub(super) const RECONFIGURE: &str = "dynamic_reconfigure/Reconfigure";
/// Services by which the log of a node of ROS 1 is set, and the topic that gathers what is in `/rosout`.
const OF_LOG: [&str; 3] = ["/get_loggers", "/set_logger_level", "/rosout_agg"];
/// Topic of the log, which each node has, and whose fields have other names on ROS 2.
pub(super) const LOG: &str = "/rosout";
/// Size in bytes from which a message is large for DDS, which sends it in many pieces.
const LARGE: u64 = 64 << 10;
/// Rate in hertz below which a sensor is no stream.
const STREAM_HZ: f64 = 1.0;

/// A graph as it was seen.
#[derive(Debug, Default)]
pub(super) struct Facts {
    /// Address of the master, or the name of the bag.
    pub(super) of: String,
    /// True where it is a bag.
    pub(super) is_bag: bool,
    /// Time that was measured, or that the bag has, in seconds; 0 where nothing was measured.
    pub(super) seconds: f64,
    /// True where a ROS 2 is sourced, or folders of definitions are given.
    pub(super) knows_ros2: bool,
    pub(super) entries: Vec<Entry>,
    /// Names of parameters, without those of bridges.
    pub(super) parameters: Vec<String>,
    /// True where a bridge shows parameters of nodes, with services that ROS 1 lacks.
    pub(super) has_parameters: bool,
    /// True where nodes take the time from `/clock`.
    pub(super) simulates_time: bool,
    /// Types of which nodes show different definitions, a sentence each.
    pub(super) conflicts: Vec<String>,
}

/// A topic, a service or an action.
#[derive(Debug)]
pub(super) struct Entry {
    pub(super) interaction: Interaction,
    pub(super) name: String,
    /// Type by its name on ROS 1.
    pub(super) ros1_type: Option<String>,
    /// Type by its name on ROS 2, or the reason why it is not known.
    pub(super) ros2_type: Result<String, String>,
    /// True where ROS 2 here has the type.
    pub(super) is_defined: bool,
    /// Nodes that publish it, or offer it.
    pub(super) providers: BTreeSet<String>,
    /// Nodes that listen to it, or call it, as far as the master knows.
    pub(super) takers: BTreeSet<String>,
    pub(super) is_latched: bool,
    /// Messages as they were measured.
    pub(super) traffic: Option<Traffic>,
    /// Fields that only one of the two definitions has, a sentence each.
    pub(super) differences: Vec<String>,
}

/// Messages of a topic over the time that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Traffic {
    pub(super) rate_hz: f64,
    /// Mean size of a message in bytes.
    pub(super) bytes: u64,
}

impl Entry {
    /// Name that it has on ROS 2.
    pub(super) fn ros2_name(&self) -> String {
        ros_name(&self.name)
    }

    /// Rule of ROS 2 that even the changed name breaks.
    pub(super) fn name_fault(&self) -> Option<String> {
        let name = self.ros2_name();
        let address = EndpointAddress { middleware: GRAPH.to_owned(), name };
        check_topic(&address).err().map(|fault| fault.to_string())
    }

    /// Looks for fields that a message of a topic loses between the definitions of ROS 1 and ROS 2.
    pub(super) fn find_differences(&mut self, types: &mut Types) {
        let Some(name) = self.ros1_type.as_ref().filter(|_| self.is_defined) else { return };
        if self.interaction != Interaction::Topic {
            return;
        }
        let definition = types.definition(name).ok();
        let plan = definition.and_then(|definition| types.plan(&definition).ok());
        let notes = plan.iter().flat_map(PairPlan::notes).filter(|note| note.is_loss());
        self.differences = notes.map(ToString::to_string).collect();
    }

    /// True for the service by which a dynamic_reconfigure server is set.
    pub(super) fn is_reconfigure(&self) -> bool {
        self.ros1_type.as_deref() == Some(RECONFIGURE)
    }

    /// True for what nodes of ROS 1 have beside their own: ROS 2 has it in another way, or not at all.
    pub(super) fn is_of_ros1(&self) -> bool {
        let is_of =
            |package: &str| self.ros1_type.as_deref().is_some_and(|it| it.starts_with(package));
        is_of(RECONFIGURE_PACKAGE) || OF_LOG.iter().any(|end| self.name.ends_with(end))
    }

    /// Quality of service that nodes of ROS 2 need at the topic once they publish it.
    pub(super) fn qos(&self) -> String {
        let is_sensor = self.ros2_type.as_ref().is_ok_and(|it| it.starts_with("sensor_msgs/"));
        let traffic = self.traffic.unwrap_or(Traffic { rate_hz: 0.0, bytes: 0 });
        match self.name.as_str() {
            "/tf" => return "reliable, depth 100".to_owned(),
            "/tf_static" => return "reliable, transient_local, depth 100".to_owned(),
            _ => {}
        }
        if self.is_latched {
            let depth = self.providers.len().max(1);
            return format!("reliable, transient_local, depth {depth}");
        }
        if is_sensor && (traffic.rate_hz >= STREAM_HZ || traffic.bytes >= LARGE) {
            return "sensor_data (best_effort, depth 5)".to_owned();
        }
        // A tenth of a second, as long as a busy subscriber may be away.
        let depth = (traffic.rate_hz / 10.0).ceil().clamp(10.0, 1000.0);
        format!("reliable, depth {depth}")
    }
}

impl Facts {
    /// Topics, services or actions.
    pub(super) fn of(&self, interaction: Interaction) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(move |entry| entry.interaction == interaction)
    }

    /// Those without what nodes of ROS 1 have beside their own.
    pub(super) fn own(&self, interaction: Interaction) -> impl Iterator<Item = &Entry> {
        self.of(interaction).filter(|entry| !entry.is_of_ros1())
    }

    /// Entries whose name on ROS 2 an entry before them has.
    pub(super) fn taken_names(&self) -> BTreeMap<(Interaction, &str), &str> {
        let mut first = BTreeMap::<(Interaction, String), &str>::new();
        let mut taken = BTreeMap::new();
        // A name that ROS 2 allows has it.
        let (same, changed): (Vec<&Entry>, Vec<&Entry>) =
            self.entries.iter().partition(|entry| entry.ros2_name() == entry.name);
        for entry in same.into_iter().chain(changed) {
            let key = (entry.interaction, entry.ros2_name());
            match first.get(&key) {
                Some(other) => _ = taken.insert((entry.interaction, entry.name.as_str()), *other),
                None => _ = first.insert(key, entry.name.as_str()),
            }
        }
        taken
    }

    /// Packages of types that ROS 2 here lacks, each with its types.
    pub(super) fn missing_packages(&self) -> BTreeMap<&str, BTreeSet<&str>> {
        let mut missing = BTreeMap::<&str, BTreeSet<&str>>::new();
        let lacking = self.entries.iter().filter(|one| !one.is_defined && !one.is_of_ros1());
        for entry in lacking {
            if let Ok(name) = &entry.ros2_type
                && let Some((package, _)) = name.split_once('/')
            {
                missing.entry(package).or_default().insert(name);
            }
        }
        missing
    }

    /// Each node with the numbers of topics that it publishes and hears, services and actions that it offers. What nodes
    /// have beside their own is not counted.
    pub(super) fn nodes(&self) -> BTreeMap<&str, [usize; 4]> {
        let mut nodes = BTreeMap::<&str, [usize; 4]>::new();
        for entry in &self.entries {
            let [provides, takes] = match entry.interaction {
                Interaction::Topic => [Some(0), Some(1)],
                Interaction::Service => [Some(2), None],
                Interaction::Action => [Some(3), None],
            };
            for (who, place) in [(&entry.providers, provides), (&entry.takers, takes)] {
                for node in who {
                    let counts = nodes.entry(node).or_default();
                    let own = place.filter(|_| !entry.is_of_ros1() && entry.name != LOG);
                    if let Some(number) = own.and_then(|place| counts.get_mut(place)) {
                        *number += 1;
                    }
                }
            }
        }
        nodes
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn entry(interaction: Interaction, name: &str, kind: &str) -> Entry {
        Entry {
            interaction,
            name: name.to_owned(),
            ros1_type: Some(kind.replace("/msg/", "/").replace("/srv/", "/")),
            ros2_type: Ok(kind.to_owned()),
            is_defined: true,
            providers: BTreeSet::from(["/base".to_owned()]),
            takers: BTreeSet::new(),
            is_latched: false,
            traffic: None,
            differences: Vec::new(),
        }
    }

    #[test]
    fn the_quality_of_service_follows_what_was_seen() {
        let topic = |name: &str, kind: &str| entry(Interaction::Topic, name, kind);
        let mut scan = topic("/scan", "sensor_msgs/msg/LaserScan");
        scan.traffic = Some(Traffic { rate_hz: 10.0, bytes: 3000 });
        assert_eq!(scan.qos(), "sensor_data (best_effort, depth 5)");
        let mut map = topic("/map", "nav_msgs/msg/OccupancyGrid");
        map.is_latched = true;
        assert_eq!(map.qos(), "reliable, transient_local, depth 1");
        let mut fast = topic("/joints", "demo/msg/Joints");
        assert_eq!(fast.qos(), "reliable, depth 10");
        fast.traffic = Some(Traffic { rate_hz: 500.0, bytes: 100 });
        assert_eq!(fast.qos(), "reliable, depth 50");
        assert_eq!(topic("/tf", "tf2_msgs/msg/TFMessage").qos(), "reliable, depth 100");
    }

    #[test]
    fn a_name_that_ros_2_allows_goes_before_one_that_becomes_it() {
        let names = ["/cam-1/x", "/cam_1/x", "/1st"];
        let entries = names.map(|name| entry(Interaction::Topic, name, "demo/msg/A")).into();
        let facts = Facts { entries, ..Facts::default() };
        let taken = facts.taken_names();
        assert_eq!(taken[&(Interaction::Topic, "/cam-1/x")], "/cam_1/x");
        assert_eq!((taken.len(), facts.entries[2].ros2_name().as_str()), (1, "/_1st"));
    }

    #[test]
    fn what_every_node_has_is_none_of_its_connections() {
        let entries = vec![
            entry(Interaction::Topic, "/scan", "sensor_msgs/msg/LaserScan"),
            entry(Interaction::Topic, "/rosout", "rcl_interfaces/msg/Log"),
            entry(Interaction::Service, "/base/get_loggers", "roscpp/srv/GetLoggers"),
        ];
        let facts = Facts { entries, ..Facts::default() };
        assert_eq!(facts.nodes()["/base"], [1, 0, 0, 0]);
        assert_eq!(facts.own(Interaction::Service).count(), 0);
    }
}
