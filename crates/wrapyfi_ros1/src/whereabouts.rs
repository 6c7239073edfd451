//! Machines that the addresses of other nodes mean.
//!
//! ```text
//!   http://robot:4567/ ─▶ hosts of the configuration ─▶ the master's own name is its address ─▶ the system
//! ```
//!
//! Nodes announce the host name of their machine unless `ROS_IP` is set there. The one of the robot is
//! often known to no other program; but the master is on it, and where the master is we know.

use std::net::IpAddr;
use std::sync::OnceLock;

use super::config::NodeUri;
use super::xmlrpc::Value;
use wrapyfi_endpoint::network::Hosts;

/// Addresses of machines that are known by name.
#[derive(Debug)]
pub(super) struct Whereabouts {
    hosts: Hosts,
    /// Address of the master where it is on another machine.
    pub(super) afar: Option<IpAddr>,
    /// Host name under which the master announces its own machine.
    master: OnceLock<String>,
}

impl Whereabouts {
    pub(super) fn new(hosts: Hosts, afar: Option<IpAddr>) -> Self {
        Self { hosts, afar, master: OnceLock::new() }
    }

    /// The host, or its address where that is known here.
    pub(super) fn of_host(&self, host: &str) -> String {
        match (self.hosts.get(host), self.afar, self.master.get()) {
            (Some(ip), ..) => ip.to_string(),
            (None, Some(ip), Some(name)) if name.eq_ignore_ascii_case(host) => ip.to_string(),
            _ => host.to_owned(),
        }
    }

    /// As [`Whereabouts::of_host`], for the address of a node.
    pub(super) fn of(&self, mut uri: NodeUri) -> NodeUri {
        uri.host = self.of_host(&uri.host);
        uri
    }

    /// Hint for the error about a node that announced `host` and does not answer: the remedy where
    /// `host` is a loopback address of another machine, else an empty text.
    pub(super) fn hint(&self, host: &str) -> &'static str {
        let is_loopback = host == "localhost"
            || host.parse::<IpAddr>().is_ok_and(|announced| announced.is_loopback());
        if self.afar.is_some() && is_loopback {
            "; that is an address of its own machine alone: set ROS_IP where it runs"
        } else {
            ""
        }
    }

    /// Takes note of what the master says its address is.
    pub(super) fn note_master(&self, uri: &Value) {
        let Value::String(uri) = uri else { return };
        let Ok(NodeUri { host, .. }) = NodeUri::parse(uri) else { return };
        let is_name = host != "localhost" && host.parse::<IpAddr>().is_err();
        if let (true, Some(ip)) = (is_name, self.afar)
            && self.master.set(host.clone()).is_ok()
        {
            tracing::debug!("ROS 1: {host} is the master's machine, {ip}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_mean_what_is_written_then_the_master() {
        let robot = IpAddr::from([192, 0, 2, 7]);
        let arm = IpAddr::from([192, 0, 2, 8]);
        let hosts: Hosts = [("arm".to_owned(), arm)].into_iter().collect();
        let known = Whereabouts::new(hosts, Some(robot));
        let uri = NodeUri::parse("http://robot:4567/").unwrap();
        assert_eq!(known.of(uri.clone()), uri);
        known.note_master(&Value::String("http://Robot:11311/".to_owned()));
        assert_eq!(known.of(uri.clone()).to_string(), "http://192.0.2.7:4567/");
        assert_eq!(known.of_host("arm"), "192.0.2.8");
        assert_eq!(known.of_host("leg"), "leg");
        assert!(known.hint("127.0.1.1").contains("ROS_IP") && known.hint("robot").is_empty());
        // A master on this machine says nothing about others.
        let near = Whereabouts::new(Hosts::default(), None);
        near.note_master(&Value::String("http://robot:11311/".to_owned()));
        assert_eq!(near.of(uri.clone()), uri);
        assert_eq!(near.hint("localhost"), "");
    }
}
