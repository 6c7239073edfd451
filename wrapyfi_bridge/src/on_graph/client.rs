//! Questions to a bridge that runs elsewhere on the graph.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_data::types::{Map, Payload, RosService, ServiceKind};
use wrapyfi_endpoint::{
    CallError, Client, Context, DiscoverError, Middleware as _, Request, Role, ServiceSpec, Wake,
};
use wrapyfi_interfaces::wrapyfi_msgs::srv::ListRoutes_Response;
use wrapyfi_interfaces::{Message as _, Service};
use wrapyfi_ros2::Ros2;
use wrapyfi_ros2::graph::{Graph, ServiceMapping};

use crate::discovery_watch::DiscoveryWatch;
use crate::exit::{Failure, Result};
use crate::why::stopped;

/// Name of the service that tells the routes, within a bridge's node.
pub const LIST_ROUTES: &str = "list_routes";
/// Time between two looks for bridges.
const LOOK: Duration = Duration::from_millis(50);
/// Time in which a bridge is looked for; twice as long where ROS 2 has not told all by then.
const FOUND_WITHIN: Duration = Duration::from_millis(1500);
/// Most bytes of a reply that are read.
const MAX_BYTES: usize = 16 << 20;

/// Node of the bridge whose status is published on a topic.
pub fn node_of_status(topic: &str) -> Option<&str> {
    topic.strip_suffix("/status")
}

/// Names of the nodes of bridges, each with the number of bridges that have it, as they are found until it `is_over`,
/// which is told them and whether ROS 2 has told all.
///
/// # Errors
/// When ROS 2 tells no endpoints.
pub fn bridges(
    ros2: &Ros2,
    is_over: impl Fn(&BTreeMap<String, usize>, bool) -> bool,
) -> Result<BTreeMap<String, usize>, DiscoverError> {
    let (mut watch, wake) = (DiscoveryWatch::new(ros2.discover()?), Wake::new());
    let kind = ListRoutes_Response::ROS_TYPE.trim_end_matches("_Response");
    loop {
        watch.look()?;
        let all = watch.found.iter();
        let servers = all
            .filter(|one| one.role == Role::Server && one.type_name.as_deref() == Some(kind))
            .filter_map(|one| one.name.strip_suffix(LIST_ROUTES)?.strip_suffix('/'));
        let mut nodes = BTreeMap::new();
        for node in servers {
            *nodes.entry(node.to_owned()).or_default() += 1;
        }
        if is_over(&nodes, watch.has_told_all()) {
            return Ok(nodes);
        }
        wake.wait(LOOK);
    }
}

/// Full name of the node of the bridge that a `command` is for, the one that is `named` or the only one on the graph, and
/// the number of bridges that have it.
///
/// # Errors
/// Exit code 2 where there are several and none was named, or this program maps services otherwise; 3 where it is not there, once it has been looked for or
/// `is_ended`.
pub fn the_bridge(
    ros2: &Ros2,
    named: Option<&str>,
    command: &str,
    is_ended: &dyn Fn() -> bool,
) -> Result<(String, usize)> {
    let begin = Instant::now();
    let named = named.map(|node| format!("/{}", node.trim_matches('/')));
    let is_over = |nodes: &BTreeMap<String, usize>, has_told: bool| {
        let is_there = match &named {
            Some(node) => nodes.contains_key(node),
            None => !nodes.is_empty() && has_told,
        };
        let late = if has_told { FOUND_WITHIN } else { 2 * FOUND_WITHIN };
        is_there || begin.elapsed() >= late || is_ended()
    };
    let found = bridges(ros2, is_over).context("cannot look for bridges")?;
    let all = found.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| "0".to_owned());
    let mut each = found.into_iter();
    let chosen = match (named, each.next(), each.len()) {
        (Some(node), first, _) => {
            let bridge = first.into_iter().chain(each).find(|(one, _)| *one == node);
            let there = if all.is_empty() { "none is" } else { &all };
            let text = format!("no bridge has the node {node} (domain {domain}); there: {there}");
            let missing = Failure::TimedOut(text);
            bridge.ok_or_else(|| if all.is_empty() { stopped::or(missing) } else { missing })
        }
        (None, Some(only), 0) => Ok(only),
        (None, Some((first, _)), more) => Err(Failure::Usage(format!(
            "there are {} bridges: name one, for instance `wrapyfi {command} {first}`; all: {all}",
            more + 1
        ))),
        (None, None, _) => Err(stopped::or(Failure::TimedOut(format!(
            "no bridge is on the graph (domain {domain}): start one with `wrapyfi bridge --config FILE`, or export the \
             ROS_DOMAIN_ID of the one that runs"
        )))),
    }?;
    let (graph, node) = (ros2.graph(), &chosen.0);
    let theirs = mappings(graph.as_ref(), &format!("{node}/{LIST_ROUTES}"), false);
    match only_foreign(graph.service_mapping(), &theirs) {
        Some(theirs) => Err(Failure::Usage(format!(
            "{node} answers on services in the way of {theirs}, and this shell asks in that of {}: export \
             RMW_IMPLEMENTATION={theirs} here",
            theirs.other().rmw(),
            theirs = theirs.rmw()
        ))),
        None => Ok(chosen),
    }
}

/// Mapping of those who serve something, where none of them has the only one that this node has.
pub(crate) fn only_foreign(
    ours: Option<ServiceMapping>,
    servers: &[ServiceMapping],
) -> Option<ServiceMapping> {
    let ours = ours?;
    servers.first().copied().filter(|_| !servers.contains(&ours))
}

/// Mappings of those who serve a name on ROS 2, or of those who call it.
pub(crate) fn mappings(ros2: &dyn Graph, service: &str, is_client: bool) -> Vec<ServiceMapping> {
    let requests = format!("rq{service}Request");
    let all = ros2.endpoints().unwrap_or_default().into_iter();
    let of_side = all.filter(|one| one.is_publisher == is_client && one.dds_topic == requests);
    of_side.filter_map(|one| one.service_mapping).collect()
}

/// A service of a bridge's node, to be asked again and again.
pub struct Asker<S> {
    client: Box<dyn Client>,
    service: String,
    kind: std::marker::PhantomData<S>,
}

impl<S: Service> Asker<S> {
    /// Opens a client for a service (`explain`, `list_routes`) of the bridge whose node has this name.
    ///
    /// # Errors
    /// Exit code 2 when the name is none of a node.
    pub fn open(ros2: &Ros2, node: &str, service: &str) -> Result<Self> {
        let kind = ServiceKind::Ros(RosService::of::<S>().map_err(Failure::usage)?);
        let service = format!("/{}/{service}", node.trim_matches('/'));
        let spec = ServiceSpec::new(&service, kind);
        let client = ros2.open_client(&spec, &Context::default()).map_err(Failure::usage)?;
        Ok(Self { client, service, kind: std::marker::PhantomData })
    }

    /// Asks, and waits for the answer.
    ///
    /// # Errors
    /// Exit code 3 when there is none in time, 1 when it is none that can be read.
    pub fn ask(&mut self, fields: Map, timeout: Duration) -> Result<S::Response> {
        let request = Request::default().with(fields);
        let reply = self.client.call(&request, timeout).map_err(|error| match error {
            CallError::TimedOut { .. } => Failure::TimedOut(format!(
                "{error}; `wrapyfi list ros2` shows what there is: a bridge has a service of this name"
            )),
            other => Failure::Failed(anyhow::Error::new(other)),
        })?;
        match &reply.payload {
            Payload::RosMessage(message) => {
                S::Response::decode(&message.cdr, MAX_BYTES).map_err(|error| {
                    Failure::Failed(anyhow::Error::new(error).context(self.service.clone()))
                })
            }
            _ => Err(Failure::Failed(anyhow::anyhow!("{} answered otherwise", self.service))),
        }
    }
}
