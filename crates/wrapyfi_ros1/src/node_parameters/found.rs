//! Nodes that have parameters, and the services and topic that they are listed with.

use std::collections::{BTreeMap, BTreeSet};

use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::rcl_interfaces::msg::ParameterEvent;
use wrapyfi_interfaces::rcl_interfaces::srv::{
    DescribeParameters, GetParameterTypes, GetParameters, ListParameters, SetParameters,
    SetParametersAtomically,
};

use super::reconfigure::DESCRIPTION;
use crate::master::{Master, MasterResult};
use wrapyfi_data::types::{RosService, RosType, RosTypeError};
use wrapyfi_endpoint::{Discovered, Role};
use wrapyfi_node::parameters::ParameterService;

/// Last parts of the names of the topics and the service of a server of dynamic_reconfigure.
const DESCRIPTIONS: &str = "/parameter_descriptions";
const RECONFIGURE: &str = "/set_parameters";
/// Last part of the name of a node's events.
const EVENTS: &str = "/parameter_events";

/// Lists the services and events of the nodes that have parameters, in place of the service of dynamic_reconfigure.
pub(crate) fn add(found: &mut Vec<Discovered>, keys: &BTreeSet<String>) {
    let nodes = nodes(found, keys);
    found.retain(|one| {
        let replaced = one.name.strip_suffix(RECONFIGURE);
        one.role != Role::Server || !replaced.is_some_and(|name| nodes.contains_key(name))
    });
    for (name, node) in nodes {
        let list = |role, last: &str, type_name: &str| Discovered {
            type_name: Some(type_name.to_owned()),
            node: Some(node.clone()),
            ..Discovered::new(format!("{name}/{last}"), role)
        };
        let services = ParameterService::ALL
            .map(|service| list(Role::Server, service.name(), service.type_name()));
        found.extend(services);
        found.push(list(Role::Publisher, EVENTS.trim_start_matches('/'), ParameterEvent::ROS_TYPE));
    }
}

/// Names under which there are parameters, and the node of each. A node that has such services itself is none.
fn nodes(found: &[Discovered], keys: &BTreeSet<String>) -> BTreeMap<String, String> {
    let named = |role: Role| {
        let of_role = found.iter().filter(move |one| one.role == role);
        of_role.map(|one| (one.name.as_str(), one))
    };
    let servers: BTreeMap<&str, &Discovered> = named(Role::Server).collect();
    let has_keys = |node: &str| {
        let begin = format!("{node}/");
        keys.range(begin.clone()..).next().is_some_and(|key| key.starts_with(&begin))
    };
    let with_keys = found.iter().filter_map(|one| one.node.as_deref()).filter(|it| has_keys(it));
    let mut nodes: BTreeMap<String, String> =
        with_keys.map(|node| (node.to_owned(), node.to_owned())).collect();
    let mut reconfigured = BTreeSet::new();
    for (topic, one) in named(Role::Publisher) {
        if one.type_name.as_deref() == Some(DESCRIPTION)
            && let Some(name) = topic.strip_suffix(DESCRIPTIONS)
            && servers.contains_key(format!("{name}{RECONFIGURE}").as_str())
            && let Some(node) = &one.node
        {
            nodes.insert(name.to_owned(), node.clone());
            reconfigured.insert(name.to_owned());
        }
    }
    nodes.retain(|name, _| {
        let taken = |service: &ParameterService| {
            let is_reconfigure = *service == ParameterService::Set && reconfigured.contains(name);
            !is_reconfigure && servers.contains_key(format!("{name}/{}", service.name()).as_str())
        };
        !name.is_empty() && !ParameterService::ALL.iter().any(taken)
    });
    nodes
}

/// True for what [`add`] lists.
pub(crate) fn is_answered_here(found: &Discovered) -> bool {
    let type_name = found.type_name.as_deref().unwrap_or_default();
    match found.role {
        Role::Server => ParameterService::ALL.iter().any(|it| it.type_name() == type_name),
        Role::Publisher => type_name == ParameterEvent::ROS_TYPE,
        _ => false,
    }
}

/// The service of a node's parameters that a name and a type mean, with the name of the node.
pub(crate) fn service_of(name: &str, service: RosService) -> Option<(&str, ParameterService)> {
    let (node, last) = name.rsplit_once('/')?;
    let known = ParameterService::ALL.into_iter().find(|it| it.name() == last)?;
    (!node.is_empty() && known.type_name() == service.name()).then_some((node, known))
}

/// The type of a service that [`add`] lists.
pub(crate) fn service_kind(type_name: &str) -> Option<Result<RosService, RosTypeError>> {
    let service = ParameterService::ALL.into_iter().find(|it| it.type_name() == type_name)?;
    Some(match service {
        ParameterService::Describe => RosService::of::<DescribeParameters>(),
        ParameterService::Get => RosService::of::<GetParameters>(),
        ParameterService::GetTypes => RosService::of::<GetParameterTypes>(),
        ParameterService::List => RosService::of::<ListParameters>(),
        ParameterService::Set => RosService::of::<SetParameters>(),
        ParameterService::SetAtomically => RosService::of::<SetParametersAtomically>(),
    })
}

/// The node whose events a topic of this type has.
pub(crate) fn node_of_events(topic: &str, ros_type: RosType) -> Option<&str> {
    let node = topic.strip_suffix(EVENTS).filter(|node| !node.is_empty())?;
    (ros_type.name() == ParameterEvent::ROS_TYPE).then_some(node)
}

/// The type of events.
pub(crate) fn event_type() -> Result<RosType, RosTypeError> {
    RosType::of::<ParameterEvent>()
}

/// True where the master lists a server of dynamic_reconfigure of this name.
pub(super) async fn has_server(master: &Master, name: &str) -> MasterResult<bool> {
    if master.lookup_service(&format!("{name}{RECONFIGURE}")).await?.is_none() {
        return Ok(false);
    }
    let topic = format!("{name}{DESCRIPTIONS}");
    let types = master.topic_types().await?;
    Ok(types.iter().any(|(known, type_name)| *known == topic && type_name == DESCRIPTION))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(role: Role, name: &str, node: &str, type_name: Option<&str>) -> Discovered {
        let (node, type_name) = (Some(node.to_owned()), type_name.map(str::to_owned));
        Discovered { node, type_name, ..Discovered::new(name, role) }
    }

    fn listed(found: &[Discovered]) -> Vec<(&str, &str)> {
        let here = found.iter().filter(|one| is_answered_here(one));
        here.map(|one| (one.name.as_str(), one.node.as_deref().unwrap())).collect()
    }

    #[test]
    fn servers_and_nodes_with_parameters_are_listed_with_six_services_and_events() {
        let mut found = vec![
            of(Role::Publisher, "/move/dwa/parameter_descriptions", "/move", Some(DESCRIPTION)),
            of(Role::Server, "/move/dwa/set_parameters", "/move", None),
            of(Role::Publisher, "/rosout", "/camera", None),
            of(Role::Publisher, "/rosout", "/cam", None),
            // A service of that name, and descriptions without one.
            of(Role::Server, "/lamp/set_parameters", "/lamp", None),
            of(Role::Publisher, "/half/parameter_descriptions", "/half", Some(DESCRIPTION)),
        ];
        let keys = ["/camera/rate", "/camera_2/rate", "/lamp/on", "/run_id", "/gone/a"];
        add(&mut found, &keys.into_iter().map(str::to_owned).collect());
        let names = listed(&found);
        assert_eq!(names.len(), 14, "{names:?}");
        for (name, node) in [("/camera", "/camera"), ("/move/dwa", "/move")] {
            for last in ["list_parameters", "set_parameters", "parameter_events"] {
                assert!(names.contains(&(&*format!("{name}/{last}"), node)), "{name}/{last}");
            }
        }
        let sets = found.iter().filter(|one| one.name.ends_with("/set_parameters")).count();
        assert_eq!(sets, 3, "that of the server has given way");
    }

    #[test]
    fn services_and_events_are_known_by_name_and_type() {
        let list = service_kind("rcl_interfaces/srv/ListParameters").unwrap().unwrap();
        assert_eq!(
            service_of("/a/b/list_parameters", list),
            Some(("/a/b", ParameterService::List))
        );
        assert_eq!(service_of("/a/b/get_parameters", list), None);
        assert_eq!(service_of("/list_parameters", list), None);
        let events = event_type().unwrap();
        assert_eq!(node_of_events("/a/parameter_events", events), Some("/a"));
        assert_eq!(node_of_events("/parameter_events", events), None);
        assert!(service_kind("std_srvs/srv/Empty").is_none());
    }
}
