//! Ends, endpoints and remedies in words.

use wrapyfi_data::types::{DataType, MessageType, ServiceKind};
use wrapyfi_endpoint::{AnnouncedQos, CauseCode, Discovered, Qos, QosPolicy, Role, Traffic};
use wrapyfi_ros2::remedy;

use super::{Finding, WayEnd};
use crate::middlewares::{conventions, is_ros};
use crate::near_names::nearest;

pub(super) fn nobody(end: &WayEnd, role: Role) -> String {
    let address = &end.address;
    match role {
        // A silent publisher does not show.
        Role::Publisher if !conventions(&address.middleware).shows_publishers => {
            format!("no message has passed on {address}, so nobody publishes it, or is silent")
        }
        Role::Publisher => format!("nobody publishes {address}"),
        Role::Server | Role::ActionServer => format!("nobody offers {address}"),
        Role::Listener => format!("nobody listens to {address}"),
        Role::Client | Role::ActionClient => format!("nobody calls {address}"),
    }
}

/// Program that could be in a role at an end, in words.
pub(super) fn provider(end: &WayEnd, role: Role) -> String {
    let side = conventions(&end.address.middleware).program;
    match role {
        Role::Publisher => format!("{side} that publishes it"),
        Role::Server | Role::ActionServer => format!("{side} that offers it"),
        Role::Listener => format!("{side} that subscribes to it"),
        Role::Client | Role::ActionClient => format!("{side} that calls it"),
    }
}

/// Command that stands in for the program that is missing; a listener on YARP has the input `port` that a route writes
/// to.
pub(super) fn example(end: &WayEnd, role: Role, port: Option<&str>) -> String {
    let WayEnd { address, type_name, learned, .. } = end;
    let learned = learned.map(|it| it.to_string());
    let known = type_name.as_deref().or(learned.as_deref());
    let command = match role {
        // A route without a type takes any.
        Role::Publisher => {
            let known = known.filter(|known| *known != "std_msgs/msg/String").unwrap_or("Text");
            format!("pub {address} --type {known} {}", sample(known))
        }
        // On ZeroMQ there are functions of Wrapyfi alone, which services of ROS are called as.
        Role::Server | Role::ActionServer
            if !conventions(&address.middleware).has_service_names =>
        {
            let function = known.filter(|known| known.parse::<ServiceKind>().is_ok());
            format!("serve {address} --type {} --echo", function.unwrap_or("NativeObject"))
        }
        Role::ActionServer if is_ros(address) => {
            let known = known.unwrap_or("example_interfaces/action/Fibonacci");
            format!("action serve {address} --type {known}")
        }
        Role::Server | Role::ActionServer => {
            format!("serve {address} --type {} --echo", known.unwrap_or("std_srvs/srv/Trigger"))
        }
        Role::Listener => {
            let typed = known.map(|known| format!(" --type {known}")).unwrap_or_default();
            let port = port.map(|port| format!(" --option port={port}")).unwrap_or_default();
            format!("echo {address}{typed}{port}")
        }
        Role::Client => format!("call {address}"),
        Role::ActionClient => format!("action send {address}"),
    };
    let reach = end.servers.first().map(|check| check.address.reach.clone()).unwrap_or_default();
    format!("start it; to try: {}wrapyfi {command}{}", reach.variables, reach.options)
}

/// Argument of `wrapyfi pub` with a message of a type.
fn sample(type_name: &str) -> &'static str {
    match type_name.parse().map(MessageType::data_type) {
        Ok(DataType::Image) => "--file picture.png",
        Ok(DataType::AudioChunk) => "--file sound.wav",
        Ok(DataType::NativeObject) => "--value '\"hello\"'",
        // Fields that are left out have their default.
        _ => "--value '{}'",
    }
}

/// Endpoint's node, or what stands for it.
pub(super) fn owner(one: &Discovered) -> String {
    match &one.node {
        Some(node) => node.clone(),
        // Elsewhere endpoints have no nodes.
        None if one.qos.is_none() => format!("the {}", one.role.words()),
        None => format!("a {} whose node has not told its name", one.role.words()),
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
    format!("{count} {}{plural}{more}", role.words())
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
    let [slashes, others] = [one, other].map(|name| name.matches('/').count());
    if (slashes == 1) != (others == 1) && slashes > 0 && others > 0 {
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

/// A name that exists, and is nearly the one that is looked for.
pub(super) fn same_name_differently(end: &WayEnd, role: Role) -> Option<Finding> {
    let address = &end.address;
    let of_role = || end.found.iter().filter(|one| one.role == role);
    let (name, name_difference) = nearest(&address.name, of_role().map(|one| one.name.as_str()))?;
    let one = of_role().find(|one| one.name == name)?;
    let what = format!(
        "{}; {}:{name} has {}: the name differs by {}",
        nobody(end, role),
        address.middleware,
        people(&[one], role),
        name_difference.words()
    );
    let middleware = &address.middleware;
    let remedy = format!(
        "write {middleware}:{name} instead of {address}, or give it the name {} there",
        address.name
    );
    Some(Finding::new(CauseCode::OtherName, what, owner(one), remedy))
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;
    use wrapyfi_endpoint::TopicSpec;

    use super::*;
    use crate::cli::{Cli, Command, TypeName};
    use crate::input;

    /// Arguments of what is to be tried.
    fn typed(end: &WayEnd, role: Role) -> Command {
        let text = example(end, role, None);
        let words = text.strip_prefix("start it; to try: ").unwrap().split(' ');
        let words = words.map(|word| word.trim_matches('\''));
        Cli::try_parse_from(words).unwrap_or_else(|error| panic!("{text}: {error}")).command
    }

    #[test]
    fn what_is_to_be_tried_works_as_it_is_printed() {
        for (address, type_name, role) in [
            ("zeromq:/obj", Some("Text"), Role::Publisher),
            ("zeromq:/obj", None, Role::Publisher),
            ("ros2:/words", Some("std_msgs/msg/String"), Role::Publisher),
            ("ros2:/twist", Some("geometry_msgs/msg/Twist"), Role::Publisher),
            ("yarp:/grabber", Some("Image"), Role::Publisher),
            ("zeromq:/sound", Some("AudioChunk"), Role::Publisher),
            ("ros2:/lamp", Some("std_srvs/srv/SetBool"), Role::Server),
            ("ros2:/lamp", None, Role::Server),
            ("zeromq:/obj", Some("Text"), Role::Listener),
            ("ros2:/obj", None, Role::Listener),
            ("ros2:/lamp", None, Role::Client),
            ("ros:/dock", None, Role::ActionServer),
            ("zeromq:/dock", None, Role::ActionServer),
            ("yarp:/dock", None, Role::ActionServer),
            ("ros2:/dock", Some("demo/action/Dock"), Role::ActionServer),
            ("ros2:/dock", None, Role::ActionClient),
        ] {
            let type_name = type_name.map(str::to_owned);
            let end = WayEnd { type_name, ..WayEnd::new(address.parse().unwrap()) };
            let Command::Pub(args) = typed(&end, role) else { continue };
            let TypeName::Known(message_type) = args.message_type else { continue };
            let spec = TopicSpec::new("/x", message_type);
            match args.file {
                Some(file) => assert!(file.extension().is_some(), "{address}"),
                None => drop(input::from_json(&args.value.unwrap(), &spec).unwrap()),
            }
        }
    }
}
