//! Ends, endpoints and remedies in words.

use wrapyfi_core::endpoint::{AnnouncedQos, Discovered, Qos, QosPolicy, Role, Traffic};
use wrapyfi_core::middleware::ros2::remedy;

use super::End;

pub(super) fn nobody(end: &End, role: Role) -> String {
    let address = &end.address;
    match role {
        // A silent publisher does not show.
        Role::Publisher if address.middleware == "zeromq" => {
            format!("no message has passed on {address}, so nobody publishes it, or is silent")
        }
        Role::Publisher => format!("nobody publishes {address}"),
        Role::Server => format!("nobody offers {address}"),
        Role::Listener => format!("nobody listens to {address}"),
        Role::Client => format!("nobody calls {address}"),
    }
}

/// Program that could be in a role at an end, in words.
pub(super) fn provider(end: &End, role: Role) -> String {
    let side = match end.address.middleware.as_str() {
        "ros2" => "a ROS 2 node",
        "ros" => "a ROS 1 node",
        "yarp" => "a program with a YARP port",
        _ => "a Wrapyfi script, or another program on ZeroMQ",
    };
    match role {
        Role::Publisher => format!("{side} that publishes it"),
        Role::Server => format!("{side} that offers it"),
        Role::Listener => format!("{side} that subscribes to it"),
        Role::Client => format!("{side} that calls it"),
    }
}

/// Command that stands in for whoever is missing.
pub(super) fn example(end: &End, role: Role) -> String {
    let End { address, type_name, .. } = end;
    let given = type_name.as_deref().unwrap_or("TYPE");
    match role {
        Role::Publisher => {
            format!("start it; to try: wrapyfi pub {address} --type {given} --value '…'")
        }
        Role::Server => {
            format!("start it; to try: wrapyfi serve {address} --type {given} --value '…'")
        }
        Role::Listener => format!("start it; to try: wrapyfi echo {address} --type {given}"),
        Role::Client => format!("start it; to try: wrapyfi call {address}"),
    }
}

/// Endpoint's node, or what stands for it.
pub(super) fn owner(one: &Discovered) -> String {
    match &one.node {
        Some(node) => node.clone(),
        None => format!("a {} whose node has not told its name", one.role),
    }
}

/// Endpoints in words: `2 publishers (/talker, …)`.
pub(super) fn people(all: &[&Discovered], role: Role) -> String {
    let count: u64 = all.iter().map(|one| one.count.max(1)).sum();
    let plural = if count == 1 { "" } else { "s" };
    let node = all.iter().find_map(|one| one.node.as_deref());
    let messages = all.iter().find_map(|one| one.traffic).map(|Traffic { messages, .. }| messages);
    let more = match (node, messages) {
        (Some(node), _) if all.len() == 1 => format!(" ({node})"),
        (Some(node), _) => format!(" ({node}, …)"),
        (None, Some(messages)) => format!(" ({messages} messages so far)"),
        (None, None) => String::new(),
    };
    format!("{count} {role}{plural}{more}")
}

/// True when two endpoints have types that are surely not the same.
pub(super) fn types_differ(one: &Discovered, other: &Discovered) -> bool {
    match (&one.type_name, &other.type_name) {
        (Some(one), Some(other)) => !is_same_type(one, other),
        _ => false,
    }
}

/// True when both name one type: ROS 1 writes `std_msgs/String`, ROS 2 `std_msgs/msg/String`; a bridge
/// between them may change the package, but never the name.
pub(super) fn is_same_type(one: &str, other: &str) -> bool {
    let is_short = |name: &str| name.matches('/').count() == 1;
    if is_short(one) != is_short(other) && one.contains('/') && other.contains('/') {
        return one.rsplit('/').next() == other.rsplit('/').next();
    }
    one == other
}

/// Remedy between two programs whose quality of service does not fit.
pub(super) fn between(policy: QosPolicy, offered: &AnnouncedQos, asked: &AnnouncedQos) -> String {
    let own = |qos: &AnnouncedQos| {
        let default = Qos::default();
        Qos { reliability: qos.reliability, deadline: qos.deadline, lease: qos.lease, ..default }
    };
    format!("{}, or {}", remedy(policy, true, &own(asked)), remedy(policy, false, &own(offered)))
}
