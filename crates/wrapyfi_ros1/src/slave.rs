//! Methods that other nodes and the master may call on this node: the slave API.
//!
//! Source: the page `Slave API` of the ROS 1 documentation; the shapes of `getBusInfo` and
//! `getBusStats` are those that `rosnode info` and `rostopic info` read.

use std::net::SocketAddr;
use std::sync::{Arc, Weak};

use dxr::TryFromValue;

use super::node::Node;
use super::subscriber::BusLink;
use super::xmlrpc::{Reply, Value, XmlRpcCall, items, text, texts};

/// Answer of the node `core` to a call of `peer`; `None` where there is no such method.
pub(super) fn answer(
    node: &Weak<Node>,
    XmlRpcCall { method, params }: XmlRpcCall,
    peer: SocketAddr,
) -> Option<Reply> {
    let Some(node) = node.upgrade() else { return Some(Reply::error("the node has ended")) };
    Some(match (method.as_str(), params.as_slice()) {
        ("publisherUpdate", [_caller, Value::String(topic), publishers]) => {
            match Vec::<String>::try_from_value(publishers) {
                Ok(publishers) => {
                    node.set_publishers(topic, &publishers, None);
                    Reply::success("", Value::Integer(0))
                }
                Err(_) => Reply::error("publishers must be a list of addresses"),
            }
        }
        ("requestTopic", [_caller, Value::String(topic), protocols]) => {
            request_topic(&node, topic, protocols)
        }
        ("paramUpdate", [_caller, Value::String(key), _value]) => {
            super::parameters::changed(&node, key);
            Reply::success("", Value::Integer(0))
        }
        ("getPid", [_caller]) => {
            // Linux has no larger ones.
            let pid = i32::try_from(std::process::id()).unwrap_or(i32::MAX);
            Reply::success("", Value::Integer(pid))
        }
        ("getMasterUri", [_caller]) => Reply::success("", text(node.master.uri.to_string())),
        ("getName", [_caller]) => Reply::success("", text(node.name.full())),
        ("getPublications", [_caller]) => Reply::success("publications", publications(&node)),
        ("getSubscriptions", [_caller]) => Reply::success("subscriptions", subscriptions(&node)),
        ("getBusInfo", [_caller]) => Reply::success("bus info", bus_info(&node)),
        ("getBusStats", [_caller]) => Reply::success("bus stats", bus_stats(&node)),
        ("shutdown", [Value::String(caller), words @ ..]) => {
            let words = match words {
                [Value::String(words), ..] if !words.is_empty() => format!(": {words}"),
                _ => String::new(),
            };
            let reason = format!("{caller} at {peer} told this node to shut down{words}");
            tracing::warn!("ROS 1: {reason}");
            node.end(reason);
            Reply::success("shutdown", Value::Integer(0))
        }
        (known, _) if METHODS.contains(&known) => {
            Reply::error(format!("{known} is not called with {} such parameters", params.len()))
        }
        _ => return None,
    })
}

const METHODS: [&str; 11] = [
    "publisherUpdate",
    "requestTopic",
    "paramUpdate",
    "getPid",
    "getMasterUri",
    "getName",
    "getPublications",
    "getSubscriptions",
    "getBusInfo",
    "getBusStats",
    "shutdown",
];

/// Answers a subscriber with the host and port of our TCPROS server; refuses every other protocol.
fn request_topic(node: &Arc<Node>, topic: &str, protocols: &Value) -> Reply {
    if !node.state().topics.contains_key(topic) {
        return Reply::error(format!("{} does not publish {topic}", node.name.full()));
    }
    let is_ours = |one: &Value| matches!(items(one), [Value::String(name), ..] if name == "TCPROS");
    if !items(protocols).iter().any(is_ours) {
        return Reply::failure("only TCPROS is spoken here", Value::Array(Vec::new()));
    }
    let way =
        vec![text("TCPROS"), text(&node.tcpros.host), Value::Integer(i32::from(node.tcpros.port))];
    Reply::success("ready on TCPROS", Value::Array(way))
}

fn publications(node: &Arc<Node>) -> Value {
    let state = node.state();
    let of = |(topic, all): (&String, &Vec<Arc<super::publication::Publication>>)| {
        all.first().map(|one| texts([topic.clone(), one.wire_type.name.clone()]))
    };
    Value::Array(state.topics.iter().filter_map(of).collect())
}

fn subscriptions(node: &Arc<Node>) -> Value {
    let state = node.state();
    let of = |(topic, one): (&String, &super::node::Subscription)| {
        one.listeners
            .first()
            .map(|connections| texts([topic.clone(), connections.type_name().to_owned()]))
    };
    Value::Array(state.subscriptions.iter().filter_map(of).collect())
}

fn int(number: u64) -> Value {
    Value::Integer(i32::try_from(number).unwrap_or(i32::MAX))
}

/// `[id, other end, "o" or "i", "TCPROS", topic, connected, words]` for every connection.
fn bus_info(node: &Arc<Node>) -> Value {
    let state = node.state();
    let entry = |link: BusLink, way: &str, topic: &str| {
        let port = node.tcpros.port;
        let words = match way {
            "o" => format!("TCPROS connection on port {port} to [{}]", link.address),
            _ => format!("TCPROS connection to [{}]", link.address),
        };
        let (id, connected) = (int(link.id), Value::Boolean(link.connected));
        let (peer, way, topic) = (text(link.peer), text(way), text(topic));
        Value::Array(vec![id, peer, way, text("TCPROS"), topic, connected, text(words)])
    };
    let mut all = Vec::new();
    for publication in state.topics.values().flatten() {
        let links = publication.links().into_iter();
        all.extend(links.map(|link| entry(link, "o", &publication.topic)));
    }
    for (topic, subscription) in &state.subscriptions {
        let links = subscription.listeners.iter().flat_map(|connections| connections.links());
        all.extend(links.map(|link| entry(link, "i", topic)));
    }
    Value::Array(all)
}

/// `[publishers, subscribers, services]`, each with the connections of its topics.
fn bus_stats(node: &Arc<Node>) -> Value {
    let state = node.state();
    let publishers = state.topics.values().flatten().map(|publication| {
        let links = publication.links();
        let bytes = links.iter().fold(0_u64, |sum, link| sum.saturating_add(link.bytes));
        let links = links.into_iter().map(|link| {
            let connected = Value::Boolean(link.connected);
            Value::Array(vec![int(link.id), int(link.bytes), int(link.messages), connected])
        });
        Value::Array(vec![text(&publication.topic), int(bytes), Value::Array(links.collect())])
    });
    let subscribers = state.subscriptions.iter().map(|(topic, subscription)| {
        let links = subscription.listeners.iter().flat_map(|connections| connections.links());
        let links = links.map(|BusLink { id, messages, bytes, connected, .. }| {
            // Messages dropped before they came here cannot be counted.
            let (dropped, connected) = (Value::Integer(-1), Value::Boolean(connected));
            Value::Array(vec![int(id), int(bytes), int(messages), dropped, connected])
        });
        Value::Array(vec![text(topic), Value::Array(links.collect())])
    });
    let none = Value::Array(vec![Value::Integer(0); 3]);
    let (publishers, subscribers) = (publishers.collect(), subscribers.collect());
    Value::Array(vec![Value::Array(publishers), Value::Array(subscribers), none])
}
