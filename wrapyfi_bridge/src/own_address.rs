//! `--ip ADDRESS`: where others reach what a command opens on YARP and ROS 1.

use std::net::IpAddr;

use clap::Args;
use wrapyfi_core::middleware::{ros1, yarp};
use wrapyfi_core::network::Place;

use crate::exit::Failure;
use crate::middlewares::Endpoints;

/// The address that others are told of this program's ports on YARP and of its node on ROS 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Args)]
pub struct OwnAddress {
    /// Address of this machine that others are told: of ports on YARP, and of the node on ROS 1. By default
    /// what YARP_IP, ROS_HOSTNAME or ROS_IP says, else the address that leads to the name server or master.
    #[arg(long, value_name = "IP", value_parser = address)]
    pub ip: Option<IpAddr>,
    /// Allow other machines to reach them. Nothing is encrypted or authenticated.
    #[arg(long)]
    pub insecure: bool,
}

impl OwnAddress {
    /// Checks that `middleware` has an address that can be said so.
    ///
    /// # Errors
    /// Exit code 2 with where the address of the others is said.
    pub fn check(&self, middleware: &str) -> Result<(), Failure> {
        if *self == Self::default() || [yarp::NAME, ros1::NAME].contains(&middleware) {
            return Ok(());
        }
        let elsewhere = match middleware {
            "zeromq" => "; where ZeroMQ's broker is, WRAPYFI_ZEROMQ_SOCKET_IP says",
            _ => "",
        };
        Err(Failure::Usage(format!(
            "{middleware}: --ip and --insecure are for {} and {}{elsewhere}",
            yarp::NAME,
            ros1::NAME
        )))
    }

    /// Goes before what the sections say.
    pub fn enter(&self, endpoints: &mut Endpoints) {
        let Endpoints { yarp, ros, .. } = endpoints;
        for insecure in [&mut yarp.insecure.0, &mut ros.insecure.0] {
            insecure.said(Place::Argument, self.ip.is_some(), self.insecure);
        }
        if let Some(ip) = self.ip {
            yarp.say_ip(ip.to_string());
            ros.hostname = Some(ip.to_string());
        }
    }
}

fn address(text: &str) -> Result<IpAddr, String> {
    text.parse().map_err(|_text| "is no address: write it as 192.168.1.7".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_argument_goes_before_the_file_and_needs_its_own_word() {
        let mut endpoints = Endpoints::default();
        endpoints.yarp.insecure.0.is_allowed = true;
        let own = OwnAddress { ip: Some([192, 0, 2, 7].into()), insecure: false };
        own.enter(&mut endpoints);
        assert_eq!(endpoints.yarp.ip.as_ref().unwrap().value, "192.0.2.7");
        assert_eq!(endpoints.ros.hostname.as_deref(), Some("192.0.2.7"));
        let refused = endpoints.yarp.check().unwrap_err().message;
        assert!(refused.contains("192.0.2.7") && refused.contains("give --insecure"), "{refused}");
        OwnAddress { insecure: true, ..own }.enter(&mut endpoints);
        endpoints.yarp.check().unwrap();
    }

    #[test]
    fn only_middlewares_with_such_an_address_take_it() {
        let own = OwnAddress { insecure: true, ..OwnAddress::default() };
        assert!(own.check("yarp").is_ok() && own.check("ros").is_ok());
        assert!(OwnAddress::default().check("ros2").is_ok());
        let refused = own.check("zeromq").unwrap_err().to_string();
        assert!(refused.contains("WRAPYFI_ZEROMQ_SOCKET_IP"), "{refused}");
        assert!(address("10.0.0").unwrap_err().contains("192.168.1.7"));
    }
}
