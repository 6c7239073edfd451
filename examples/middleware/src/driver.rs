//! The middleware for programs: its name, its section of a configuration, and its start.

use std::sync::Arc;

use serde::Deserialize;
use wrapyfi_endpoint::config::{NamedSection, Spanned};
use wrapyfi_endpoint::driver::{Available, Driver, Section, Setting, StartNeeds};
use wrapyfi_endpoint::{Interaction, Planned, StartError};

use super::Udp;

/// Name in addresses: `udp:/chatter`.
pub const NAME: &str = "udp";

/// The middleware, for the list of a program.
pub const DRIVER: &dyn Driver = &UdpDriver;

struct UdpDriver;

impl Driver for UdpDriver {
    fn available(&self) -> Available<'static> {
        let interactions = &[Interaction::Topic];
        Available { name: NAME, check_topic: &check_topic, interactions, ..Available::default() }
    }

    fn section(&self) -> Box<dyn Section> {
        Box::new(UdpSection::default())
    }
}

/// Refuses a name that no topic can have.
pub(crate) fn check_topic(topic: &str) -> Result<(), String> {
    let is_wrong = topic.is_empty() || topic.contains(char::is_control);
    if is_wrong { Err("it is empty, or contains a control character".to_owned()) } else { Ok(()) }
}

/// `endpoints: { udp: { port: 7700 } }`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct UdpSection {
    port: Option<Spanned<u16>>,
}

impl NamedSection for UdpSection {
    const NAME: &'static str = NAME;

    fn example_of(key: &str) -> Option<&'static str> {
        Some(if key == "port" { "7700" } else { "{ port: 7700 }" })
    }
}

impl Section for UdpSection {
    /// `-p endpoints.udp.port:=7701`.
    fn settings(&mut self) -> Vec<(&'static str, Setting<'_>)> {
        vec![("port", Setting::Port(&mut self.port))]
    }

    fn plan(&self, _needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        let port = self.port.as_ref().map_or(7700, |port| port.value);
        let failed = |error: std::io::Error| StartError::Failed(error.to_string());
        let start = move || Ok(Arc::new(Udp::join(port).map_err(failed)?) as _);
        Ok(Planned { key: port.to_string(), start: Arc::new(start) })
    }
}
