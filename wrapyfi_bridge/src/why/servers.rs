//! Step of the walk at the servers of a service or an action on ROS 2, which sends a request to every one of them.

use std::collections::BTreeSet;

use wrapyfi_endpoint::{CauseCode, Interaction};

use super::judge::Walk;
use super::{Finding, StepResult, WayEnd};
use crate::node::GRAPH;

impl Walk<'_> {
    /// The node that alone offers a service or an action on ROS 2.
    pub(super) fn only_server(&self, end: &WayEnd) -> StepResult {
        let (address, interaction) = (&end.address, self.way.interaction);
        // A topic may have as many publishers as it likes.
        if address.middleware != GRAPH || interaction == Interaction::Topic {
            return Ok(());
        }
        // Endpoints of one node may be several, and one that has not told its name yet may be of a node that has.
        let nodes: BTreeSet<_> =
            end.of(interaction.provider()).filter_map(|one| one.node.as_deref()).collect();
        let Some(last) = nodes.last().filter(|_| nodes.len() > 1) else { return Ok(()) };
        let comes_to = match interaction {
            Interaction::Action => "each goal to all of them, and each does it",
            _ => "each request to all of them, and the client takes the answer that comes first",
        };
        let all = nodes.iter().copied().collect::<Vec<_>>().join(" and ");
        let what = format!("{all} offer the {interaction} {address}: ROS 2 sends {comes_to}");
        let name = &address.name;
        let remedy = format!(
            "end all of them but one, or start the others with another name for it: --ros-args -r {name}:=/other{name}"
        );
        Err(Finding::new(CauseCode::NameTaken, what, *last, remedy))
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_endpoint::{Discovered, Role};

    use super::super::Way;
    use super::super::judge::judge;
    use super::*;

    fn server(node: Option<&str>, role: Role) -> Discovered {
        let (node, type_name) = (node.map(str::to_owned), Some("a/srv/Do".to_owned()));
        Discovered { node, type_name, ..Discovered::new("/do", role) }
    }

    fn found(
        middleware: &str,
        interaction: Interaction,
        nodes: &[Option<&str>],
    ) -> Option<Finding> {
        let role = interaction.provider();
        let found = nodes.iter().map(|node| server(*node, role)).collect();
        let address = format!("{middleware}:/do").parse().unwrap();
        let source = Some(WayEnd { found, ..WayEnd::new(address) });
        judge(&Way { interaction, source, ..Way::default() }).finding
    }

    #[test]
    fn two_nodes_that_offer_one_name_on_ros_2_are_told() {
        for (interaction, words) in [
            (Interaction::Service, "offer the service ros2:/do: ROS 2 sends each request to all"),
            (Interaction::Action, "offer the action ros2:/do: ROS 2 sends each goal to all"),
        ] {
            let two = found(GRAPH, interaction, &[Some("/b"), Some("/a"), Some("/b")]).unwrap();
            assert_eq!(two.cause, CauseCode::NameTaken);
            assert!(two.what.starts_with("/a and /b ") && two.what.contains(words), "{}", two.what);
            assert!(two.remedy.ends_with("-r /do:=/other/do"), "{}", two.remedy);
            for alone in [&[Some("/a"), Some("/a")][..], &[Some("/a"), None]] {
                assert_eq!(found(GRAPH, interaction, alone), None, "{alone:?}");
            }
        }
        let publishers = found(GRAPH, Interaction::Topic, &[Some("/a"), Some("/b")]);
        assert_ne!(publishers.map(|it| it.cause), Some(CauseCode::NameTaken));
        // The master knows one server of a service.
        assert_eq!(found("ros", Interaction::Service, &[Some("/a"), Some("/b")]), None);
    }
}
