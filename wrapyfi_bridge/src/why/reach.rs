//! Findings about servers and addresses at which no program answers.

use wrapyfi_endpoint::{CauseCode, EndpointAddress, NameService};

use super::server_check::{ConnectOutcome, ServerCheck};
use super::{Finding, Registered, StepResult, Way, WayEnd};
use crate::middlewares::{Server, ServerAddress, conventions};

/// A server that answered, or the finding that it did not.
pub(super) fn opened(check: &ServerCheck, address: &EndpointAddress, way: &Way) -> StepResult {
    let server = check.address.server;
    let (words, ServerAddress { host, port, start, .. }) = (check.words(), &check.address);
    // One that runs the route would run the server, if it were to.
    let route = way.route.as_ref().filter(|_| way.running.is_none());
    let bridge = route.map(|route| format!("wrapyfi bridge --config {}", route.file));
    let (cause, what, who, remedy) = match &check.answer {
        ConnectOutcome::Open => return Ok(()),
        ConnectOutcome::Unresolved(reason) => (
            CauseCode::UnresolvedHost,
            format!("{words}: {reason}"),
            "whoever knows the machine's address".to_owned(),
            format!("`hosts: {{ {host}: ADDRESS }}` in the configuration, or /etc/hosts"),
        ),
        ConnectOutcome::Refused if check.is_here => {
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
            (CauseCode::ServerAway, what, format!("a {server}"), more)
        }
        ConnectOutcome::Refused => (
            CauseCode::LoopbackElsewhere,
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
        ConnectOutcome::Foreign(what) => (
            CauseCode::ServerAway,
            format!("{words} does not answer: {what} has port {port}"),
            "that program, or the settings of zeromq".to_owned(),
            format!("end that program, or choose another port (`endpoints: zeromq`); then {start}"),
        ),
        ConnectOutcome::AcceptsOnly => (
            CauseCode::ServerAway,
            format!("{words} does not answer: what listens on port {port} hangs or is stopped"),
            format!("a {server}"),
            format!("kill -CONT PID, if it is stopped; else end it, and {start}"),
        ),
        ConnectOutcome::Silent | ConnectOutcome::NoWay(_) => {
            let why = match &check.answer {
                ConnectOutcome::NoWay(why) => why,
                _ => "nothing comes back: the machine is off, or a firewall is between",
            };
            let remedy = format!("ping {host}; open port {port} there");
            let what = format!("{words} does not answer: {why}");
            (CauseCode::ServerAway, what, format!("the machine {host}"), remedy)
        }
    };
    Err(Finding::new(cause, what, who, remedy))
}

/// An address at which a program can be reached, or the finding that no program can.
pub(super) fn reachable(end: &WayEnd, one: &Registered) -> StepResult {
    let Registered { who, host, port, is_told_afar, answer, .. } = one;
    let address = &end.address;
    let Some(server) = conventions(&address.middleware).name_service else { return Ok(()) };
    let NameService { address_variable: variable, clean, .. } = server;
    let is_loopback =
        host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback());
    let registered = format!("{who} has registered {address} at {host}:{port}");
    let (cause, what, remedy) = match answer {
        _ if *is_told_afar && is_loopback => (
            CauseCode::LoopbackAddress,
            format!("{registered}, an address of its own machine alone"),
            format!("export {variable}=ADDRESS where {who} runs, and start it again"),
        ),
        // Only ports of brokers are asked what has them.
        ConnectOutcome::Open | ConnectOutcome::Foreign(_) => return Ok(()),
        ConnectOutcome::Unresolved(reason) => (
            CauseCode::UnresolvedHost,
            format!("{registered}: {reason}"),
            format!(
                "`hosts: {{ {host}: ADDRESS }}` in the configuration, /etc/hosts, or export {variable}=ADDRESS where \
                 {who} runs"
            ),
        ),
        ConnectOutcome::Refused => (
            CauseCode::PeerUnreachable,
            format!("{registered}, and nothing listens there: it was killed, and its name remains"),
            format!("start {who} again; `{clean}` takes the name away"),
        ),
        ConnectOutcome::AcceptsOnly => (
            CauseCode::PeerUnreachable,
            format!(
                "{registered}, where connections are accepted and nobody answers: it hangs or is stopped, or another \
                 program has the port now"
            ),
            format!("kill -CONT PID where {who} runs, if it is stopped; else start it again"),
        ),
        ConnectOutcome::Silent | ConnectOutcome::NoWay(_) => (
            CauseCode::PeerUnreachable,
            format!(
                "{registered}, which cannot be reached from here: a firewall is between, or it is an address of another \
                 network"
            ),
            format!("ping {host}; open the port; or export {variable}=ADDRESS where {who} runs"),
        ),
    };
    Err(Finding::new(cause, what, who, remedy))
}
