//! Findings about servers and addresses at which nobody answers.

use wrapyfi_endpoint::EndpointAddress;

use super::server_check::{Answer, ServerCheck};
use super::{Cause, End, Finding, Registered, Step, Way};
use crate::middlewares::{Server, ServerAddress};

/// A server that answered, or the finding that it did not.
pub(super) fn opened(check: &ServerCheck, address: &EndpointAddress, way: &Way) -> Step {
    let server = check.address.server;
    let (words, ServerAddress { host, port, start, .. }) = (check.words(), &check.address);
    // One that runs the route would run the server, if it were to.
    let route = way.route.as_ref().filter(|_| way.running.is_none());
    let bridge = route.map(|route| format!("wrapyfi bridge --config {}", route.file));
    let (cause, what, who, remedy) = match &check.answer {
        Answer::Open => return Ok(()),
        Answer::Unresolved(reason) => (
            Cause::UnresolvedHost,
            format!("{words}: {reason}"),
            "whoever knows the machine's address".to_owned(),
            format!("`hosts: {{ {host}: ADDRESS }}` in the configuration, or /etc/hosts"),
        ),
        Answer::Refused if check.is_here => {
            let more = match (&bridge, server) {
                (Some(bridge), _) if check.address.is_own => {
                    format!("{bridge}    # it runs the server itself; or {start}")
                }
                // Who asks about a mere name may not have meant ROS 1.
                (None, Server::Master) if way.route.is_none() => format!(
                    "{start}; `ros:` is ROS 1, a name of ROS 2 is written ros2:{}",
                    address.name
                ),
                _ => start.clone(),
            };
            let what =
                format!("{words} does not answer: nothing listens on port {port} of this machine");
            (Cause::ServerAway, what, format!("a {server}"), more)
        }
        Answer::Refused => (
            Cause::LoopbackElsewhere,
            format!(
                "{words} does not answer: that machine does, and nothing listens on port {port} of its address {host}: \
                 it is not started, or listens on 127.0.0.1 of that machine alone"
            ),
            format!("a program on {host}"),
            match server {
                Server::Broker | Server::ServiceBroker => format!(
                    "on {host}: {start}    # Wrapyfi's own: WRAPYFI_ZEROMQ_SOCKET_IP={host}"
                ),
                Server::NameServer | Server::Router => format!("on {host}: {start}"),
                Server::Master => format!("on {host}: ROS_IP={host} {start}"),
            },
        ),
        Answer::Foreign(what) => (
            Cause::ServerAway,
            format!("{words} does not answer: {what} has port {port}"),
            "that program, or the settings of zeromq".to_owned(),
            format!("end that program, or choose another port (`endpoints: zeromq`); then {start}"),
        ),
        Answer::AcceptsOnly => (
            Cause::ServerAway,
            format!("{words} does not answer: what listens on port {port} hangs or is stopped"),
            format!("a {server}"),
            format!("kill -CONT PID, if it is stopped; else end it, and {start}"),
        ),
        Answer::Silent | Answer::NoWay(_) => {
            let why = match &check.answer {
                Answer::NoWay(why) => why,
                _ => "nothing comes back: the machine is off, or a firewall is between",
            };
            let remedy = format!("ping {host}; open port {port} there");
            let what = format!("{words} does not answer: {why}");
            (Cause::ServerAway, what, format!("the machine {host}"), remedy)
        }
    };
    Err(Finding::new(cause, what, who, remedy))
}

/// An address at which somebody can be reached, or the finding that nobody can.
pub(super) fn reachable(end: &End, one: &Registered) -> Step {
    let Registered { who, host, port, is_told_afar, answer, .. } = one;
    let address = &end.address;
    let is_yarp = address.middleware == "yarp";
    let variable = if is_yarp { "YARP_IP" } else { "ROS_IP" };
    let is_loopback =
        host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback());
    let registered = format!("{who} has registered {address} at {host}:{port}");
    let (cause, what, remedy) = match answer {
        _ if *is_told_afar && is_loopback => (
            Cause::LoopbackAddress,
            format!("{registered}, an address of its own machine alone"),
            format!("export {variable}=ADDRESS where {who} runs, and start it again"),
        ),
        // Only ports of brokers are asked what has them.
        Answer::Open | Answer::Foreign(_) => return Ok(()),
        Answer::Unresolved(reason) => (
            Cause::UnresolvedHost,
            format!("{registered}: {reason}"),
            format!(
                "`hosts: {{ {host}: ADDRESS }}` in the configuration, /etc/hosts, or export {variable}=ADDRESS where \
                 {who} runs"
            ),
        ),
        Answer::Refused => {
            let clean = if is_yarp { "yarp clean" } else { "rosnode cleanup" };
            (
                Cause::PeerUnreachable,
                format!(
                    "{registered}, and nothing listens there: it was killed, and its name remains"
                ),
                format!("start {who} again; `{clean}` takes the name away"),
            )
        }
        Answer::AcceptsOnly => (
            Cause::PeerUnreachable,
            format!(
                "{registered}, where connections are accepted and nobody answers: it hangs or is stopped, or another \
                 program has the port now"
            ),
            format!("kill -CONT PID where {who} runs, if it is stopped; else start it again"),
        ),
        Answer::Silent | Answer::NoWay(_) => (
            Cause::PeerUnreachable,
            format!(
                "{registered}, which cannot be reached from here: a firewall is between, or it is an address of another \
                 network"
            ),
            format!("ping {host}; open the port; or export {variable}=ADDRESS where {who} runs"),
        ),
    };
    Err(Finding::new(cause, what, who, remedy))
}
