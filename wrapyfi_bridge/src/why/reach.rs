//! Findings about servers and addresses at which nobody answers.

use wrapyfi_core::endpoint::EndpointAddress;

use super::door::{Answer, Knock, name as server_name};
use super::{Cause, End, Finding, Registered, RouteFacts, Step};
use crate::middlewares::Server;

/// A server that answered, or the finding that it did not.
pub(super) fn opened(knock: &Knock, address: &EndpointAddress, route: Option<&RouteFacts>) -> Step {
    let server = knock.door.server;
    let (words, host, port) = (knock.words(), &knock.door.host, knock.door.port);
    let bridge = route.map(|route| format!("wrapyfi bridge --config {}", route.file));
    let here = match server {
        Server::Broker | Server::ServiceBroker => "wrapyfi broker",
        Server::NameServer => "wrapyfi yarpserver (or yarpserver)",
        Server::Master => "roscore",
    };
    match &knock.answer {
        Answer::Open => Ok(()),
        Answer::Unresolved(reason) => {
            let what = format!("{words}: {reason}");
            let remedy =
                format!("`hosts: {{ {host}: ADDRESS }}` in the configuration, or /etc/hosts");
            let who = "whoever knows the machine's address";
            Err(Finding::new(Cause::UnresolvedHost, what, who, remedy))
        }
        Answer::Refused if knock.is_here => {
            let what =
                format!("{words} does not answer: nothing listens on port {port} of this machine");
            let remedy = match (bridge, knock.door.is_own) {
                (Some(bridge), true) => {
                    format!("{bridge}    # it runs the server itself; or {here}")
                }
                _ => match server {
                    // Who asks about a mere name may not have meant ROS 1.
                    Server::Master if route.is_none() => format!(
                        "{here}    # or set ROS_MASTER_URI to where it runs; `ros:` is ROS 1, a name of \
                         ROS 2 is written ros2:{}",
                        address.name
                    ),
                    Server::Master => format!("{here}    # or set ROS_MASTER_URI to where it runs"),
                    _ => here.to_owned(),
                },
            };
            Err(Finding::new(Cause::ServerAway, what, format!("a {}", server_name(server)), remedy))
        }
        Answer::Refused => {
            let what = format!(
                "{words} does not answer: that machine does, and nothing listens on port {port} of its \
                 address {host}: it is not started, or listens on 127.0.0.1 of that machine alone"
            );
            let remedy = match server {
                Server::Broker | Server::ServiceBroker => format!(
                    "on {host}: wrapyfi broker --ip {host} --insecure    # Wrapyfi's own: \
                     WRAPYFI_ZEROMQ_SOCKET_IP={host}"
                ),
                Server::NameServer => {
                    format!("on {host}: wrapyfi yarpserver --ip {host} --insecure (or yarpserver)")
                }
                Server::Master => format!("on {host}: ROS_IP={host} roscore"),
            };
            Err(Finding::new(
                Cause::LoopbackElsewhere,
                what,
                format!("a program on {host}"),
                remedy,
            ))
        }
        Answer::Silent | Answer::NoWay(_) => {
            let why = match &knock.answer {
                Answer::NoWay(why) => why.clone(),
                _ => "nothing comes back: the machine is off, or a firewall is between".to_owned(),
            };
            let what = format!("{words} does not answer: {why}");
            let remedy = format!("ping {host}; open port {port} there");
            Err(Finding::new(Cause::ServerAway, what, format!("the machine {host}"), remedy))
        }
    }
}

/// An address at which somebody can be reached, or the finding that nobody can.
pub(super) fn reachable(end: &End, one: &Registered) -> Step {
    let Registered { who, host, port, is_told_afar, answer, .. } = one;
    let address = &end.address;
    let is_yarp = address.middleware == "yarp";
    let variable = if is_yarp { "YARP_IP" } else { "ROS_IP" };
    let is_loopback =
        host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback());
    if *is_told_afar && is_loopback {
        let what = format!(
            "{who} has registered {address} at {host}:{port}, an address of its own machine alone"
        );
        let remedy = format!("export {variable}=ADDRESS where {who} runs, and start it again");
        return Err(Finding::new(Cause::LoopbackAddress, what, who.clone(), remedy));
    }
    match answer {
        Answer::Open => Ok(()),
        Answer::Unresolved(reason) => {
            let what = format!("{who} has registered {address} at {host}:{port}: {reason}");
            let remedy = format!(
                "`hosts: {{ {host}: ADDRESS }}` in the configuration, /etc/hosts, or export \
                 {variable}=ADDRESS where {who} runs"
            );
            Err(Finding::new(Cause::UnresolvedHost, what, who.clone(), remedy))
        }
        Answer::Refused => {
            let what = format!(
                "{who} has registered {address} at {host}:{port}, and nothing listens there: it was \
                 killed, and its name remains"
            );
            let clean = match is_yarp {
                true => "yarp clean",
                false => "rosnode cleanup",
            };
            let remedy = format!("start {who} again; `{clean}` takes the name away");
            Err(Finding::new(Cause::PeerUnreachable, what, who.clone(), remedy))
        }
        Answer::Silent | Answer::NoWay(_) => {
            let what = format!(
                "{who} has registered {address} at {host}:{port}, which cannot be reached from here: a \
                 firewall is between, or it is an address of another network"
            );
            let remedy = format!(
                "ping {host}; open the port; or export {variable}=ADDRESS where {who} runs"
            );
            Err(Finding::new(Cause::PeerUnreachable, what, who.clone(), remedy))
        }
    }
}
