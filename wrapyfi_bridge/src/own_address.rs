//! `--ip ADDRESS`: where others reach what a command opens on YARP and ROS 1.

use std::net::IpAddr;

use clap::Args;

use crate::exit::{Failure, Result};
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
    pub fn check(&self, middleware: &str) -> Result<()> {
        if *self == Self::default() {
            return Ok(());
        }
        let (mut taking, mut elsewhere) = (Vec::new(), "");
        Endpoints::default().each_permission(|name, permission| match permission.said_elsewhere {
            None => taking.push(name.to_owned()),
            Some(said) if name == middleware => elsewhere = said,
            Some(_) => {}
        });
        if taking.iter().any(|name| name == middleware) {
            return Ok(());
        }
        let taking = taking.join(" and ");
        let text = format!("{middleware}: --ip and --insecure are for {taking}{elsewhere}");
        Err(Failure::Usage(text))
    }
}

fn address(text: &str) -> Result<IpAddr, String> {
    text.parse().map_err(|_text| "is no address: write it as 192.168.1.7".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

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
