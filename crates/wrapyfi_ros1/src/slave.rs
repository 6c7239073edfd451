//! Methods that other nodes and the master may call on this node: the slave API.
//!
//! Source: the page `Slave API` of the ROS 1 documentation; the shapes of `getBusInfo` and
//! `getBusStats` are those that `rosnode info` and `rostopic info` read.

use std::sync::{Arc, Weak};

use super::core::Core;
use super::http::Answers;
use super::master::string_list;
use super::xmlrpc::{Call, ERROR, Reply, Value, text, texts};

pub(super) struct Slave(pub(super) Weak<Core>);

impl Answers for Slave {
    fn answer(&self, Call { method, params }: Call) -> Option<Reply> {
        let Some(core) = self.0.upgrade() else { return Some(Reply::error("the node has ended")) };
        Some(match (method.as_str(), params.as_slice()) {
            ("publisherUpdate", [_caller, Value::String(topic), publishers]) => {
                match string_list(publishers) {
                    Some(publishers) => {
                        core.updated(topic, &publishers);
                        Reply::success("", Value::Integer(0))
                    }
                    None => Reply::error("publishers must be a list of addresses"),
                }
            }
            ("requestTopic", [_caller, Value::String(topic), protocols]) => {
                request_topic(&core, topic, protocols)
            }
            ("paramUpdate", [_caller, Value::String(key), _value]) => {
                super::parameters::changed(&core, key);
                Reply::success("", Value::Integer(0))
            }
            ("getPid", [_caller]) => {
                // Linux has no larger ones.
                let pid = i32::try_from(std::process::id()).unwrap_or(i32::MAX);
                Reply::success("", Value::Integer(pid))
            }
            ("getMasterUri", [_caller]) => Reply::success("", text(core.master.uri().to_string())),
            ("getName", [_caller]) => Reply::success("", text(core.name.full())),
            ("getPublications", [_caller]) => Reply::success("publications", publications(&core)),
            ("getSubscriptions", [_caller]) => {
                Reply::success("subscriptions", subscriptions(&core))
            }
            ("getBusInfo", [_caller]) => Reply::success("bus info", bus_info(&core)),
            ("getBusStats", [_caller]) => Reply::success("bus stats", bus_stats(&core)),
            ("shutdown", [Value::String(caller), words @ ..]) => {
                let words = match words {
                    [Value::String(words), ..] if !words.is_empty() => format!(": {words}"),
                    _ => String::new(),
                };
                let reason = format!("{caller} told this node to shut down{words}");
                tracing::warn!("ROS 1: {reason}");
                core.end(reason);
                Reply::success("shutdown", Value::Integer(0))
            }
            (known, _) if METHODS.contains(&known) => Reply {
                status: ERROR,
                text: format!("{known} is not called with {} such parameters", params.len()),
                value: Value::Integer(0),
            },
            _ => return None,
        })
    }
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
fn request_topic(core: &Arc<Core>, topic: &str, protocols: &Value) -> Reply {
    if !core.state().topics.contains_key(topic) {
        return Reply::error(format!("{} does not publish {topic}", core.name.full()));
    }
    let named = |protocol: &Value| match protocol {
        Value::Array(parts) => {
            matches!(parts.first(), Some(Value::String(name)) if name == "TCPROS")
        }
        _ => false,
    };
    let speaks = matches!(protocols, Value::Array(all) if all.iter().any(named));
    if !speaks {
        return Reply {
            status: 0,
            text: "only TCPROS is spoken here".to_owned(),
            value: Value::Array(Vec::new()),
        };
    }
    let way =
        vec![text("TCPROS"), text(&core.tcpros.host), Value::Integer(i32::from(core.tcpros.port))];
    Reply::success("ready on TCPROS", Value::Array(way))
}

fn publications(core: &Arc<Core>) -> Value {
    let state = core.state();
    let of = |(topic, all): (&String, &Vec<Arc<super::publication::Publication>>)| {
        all.first().map(|one| texts([topic.clone(), one.wire_type().name.clone()]))
    };
    Value::Array(state.topics.iter().filter_map(of).collect())
}

fn subscriptions(core: &Arc<Core>) -> Value {
    let state = core.state();
    let of = |(topic, one): (&String, &super::core::Subscription)| {
        one.listeners().first().map(|intake| texts([topic.clone(), intake.type_name().to_owned()]))
    };
    Value::Array(state.subscriptions.iter().filter_map(of).collect())
}

fn int(number: u64) -> Value {
    Value::Integer(i32::try_from(number).unwrap_or(i32::MAX))
}

/// `[id, other end, "o" or "i", "TCPROS", topic, connected, words]` for every connection.
fn bus_info(core: &Arc<Core>) -> Value {
    let state = core.state();
    let mut all = Vec::new();
    for publication in state.topics.values().flatten() {
        for link in publication.links() {
            let words =
                format!("TCPROS connection on port {} to [{}]", core.tcpros.port, link.address);
            all.push(Value::Array(vec![
                int(link.id),
                text(link.peer),
                text("o"),
                text("TCPROS"),
                text(publication.topic()),
                Value::Boolean(true),
                text(words),
            ]));
        }
    }
    for (topic, subscription) in &state.subscriptions {
        for link in subscription.listeners().iter().flat_map(|intake| intake.links()) {
            let words = format!("TCPROS connection to [{}]", link.address);
            all.push(Value::Array(vec![
                int(link.id),
                text(link.peer),
                text("i"),
                text("TCPROS"),
                text(topic),
                Value::Boolean(link.connected),
                text(words),
            ]));
        }
    }
    Value::Array(all)
}

/// `[publishers, subscribers, services]`, each with the connections of its topics.
fn bus_stats(core: &Arc<Core>) -> Value {
    let state = core.state();
    let mut publishers = Vec::new();
    for publication in state.topics.values().flatten() {
        let (mut links, mut bytes) = (Vec::new(), 0_u64);
        for link in publication.links() {
            bytes = bytes.saturating_add(link.bytes);
            links.push(Value::Array(vec![
                int(link.id),
                int(link.bytes),
                int(link.messages),
                Value::Boolean(true),
            ]));
        }
        let topic = text(publication.topic());
        publishers.push(Value::Array(vec![topic, int(bytes), Value::Array(links)]));
    }
    let mut subscribers = Vec::new();
    for (topic, subscription) in &state.subscriptions {
        let links = subscription.listeners().iter().flat_map(|intake| intake.links());
        let links = links.map(|link| {
            Value::Array(vec![
                int(link.id),
                int(link.bytes),
                int(link.messages),
                // Nobody knows what was dropped before it came here.
                Value::Integer(-1),
                Value::Boolean(link.connected),
            ])
        });
        subscribers.push(Value::Array(vec![text(topic), Value::Array(links.collect())]));
    }
    let none = Value::Array(vec![Value::Integer(0), Value::Integer(0), Value::Integer(0)]);
    Value::Array(vec![Value::Array(publishers), Value::Array(subscribers), none])
}
