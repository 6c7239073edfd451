//! `endpoints.yarp` of a configuration, and the middleware that it makes.

use std::net::IpAddr;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_engine::{Available, Problem, Spanned};
pub(super) use wrapyfi_yarp_endpoint::NAME;
use wrapyfi_yarp_endpoint::{self as yarp, Convention, Dialect, NameServerConf, Yarp, YarpConfig};

use super::start::start;
use super::word::Word;
use crate::exit::{Failure, Result};
use crate::files::in_no_file;
use crate::logging;

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> = Available {
    name: NAME,
    check_topic: &yarp::check_topic,
    options: yarp::OPTIONS,
    check_option: &yarp::check_option,
    source_options: yarp::SOURCE_OPTIONS,
    destination_options: yarp::DESTINATION_OPTIONS,
    conventions: yarp::CONVENTIONS,
};

/// `endpoints.yarp`; what is left out comes from YARP's own configuration (`yarp.conf`).
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct YarpSection {
    pub name_server: Option<Spanned<String>>,
    pub embedded: bool,
    pub namespace: Option<String>,
    #[serde(deserialize_with = "dialect")]
    pub dialect: Option<Dialect>,
    pub ip: Option<Spanned<String>>,
    pub insecure: Word,
    pub types: Vec<NamedType>,
}

/// An entry of `types`: ports whose names tell the type of what they send.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NamedType {
    /// Names of the ports, as a regular expression.
    pub names: Spanned<String>,
    /// Type of the messages that they send.
    #[serde(rename = "type")]
    pub message_type: Spanned<String>,
}

impl NamedType {
    fn convention(&self) -> Result<Convention, Problem> {
        let Self { names, message_type } = self;
        let word = &message_type.value;
        // A type of ROS may be defined where nobody has looked yet.
        if !word.contains('/') {
            let read = word.parse::<MessageType>();
            read.map_err(|wrong| Problem::at(message_type.referenced, wrong.to_string()))?;
        }
        Convention::new(&names.value, word).map_err(|fault| {
            let text = format!("names {:?} {fault}", names.value);
            Problem::at(names.referenced, text)
        })
    }
}

/// Dialect in which bottles are encoded.
fn dialect<'de, D: Deserializer<'de>>(written: D) -> Result<Option<Dialect>, D::Error> {
    let word = Option::<String>::deserialize(written)?;
    word.map(|word| word.parse()).transpose().map_err(D::Error::custom)
}

impl YarpSection {
    /// Finds what can be found wrong before anything is started.
    pub fn check(&self) -> Result<(), Problem> {
        if let Some(written) = &self.name_server {
            let parsed = written.value.parse::<NameServerConf>();
            parsed
                .map_err(|wrong| Problem::at(written.referenced, format!("name_server {wrong}")))?;
        }
        for named in &self.types {
            named.convention()?;
        }
        self.own_ip().map(drop)
    }

    /// Ports of ours that other machines reach are refused before anything starts.
    pub fn check_permitted(&self) -> Result<(), Problem> {
        let Some((written, ip)) = self.own_ip()? else { return Ok(()) };
        let permitted = self.insecure.0.check(NAME, "a port", ip);
        permitted.map_err(|refused| Problem::at(written.referenced, refused.to_string()))
    }

    fn own_ip(&self) -> Result<Option<(&Spanned<String>, IpAddr)>, Problem> {
        let Some(written) = &self.ip else { return Ok(None) };
        let ip = written.value.parse::<IpAddr>().map_err(|_text| {
            let text = format!("ip {:?} is no address: write it as 127.0.0.1", written.value);
            Problem::at(written.referenced, text)
        })?;
        Ok(Some((written, ip)))
    }

    /// Says at which address ports are reached, in no file.
    pub fn say_ip(&mut self, ip: String) {
        self.ip = Some(in_no_file(ip));
    }

    /// All settings.
    ///
    /// # Errors
    /// Exit code 2 for variables of the environment and addresses that cannot be.
    pub(super) fn config(&self, largest_message: usize, hosts: &Hosts) -> Result<YarpConfig> {
        let mut config = YarpConfig::from_env().map_err(Failure::usage)?;
        if let Some(written) = &self.name_server {
            config.name_server = Some(written.value.parse().map_err(Failure::usage)?);
        }
        self.insecure.say(&mut config.insecure, self.ip.is_some());
        if let Some(written) = &self.ip {
            config.ip = Some(written.value.parse().map_err(Failure::usage)?);
        }
        // Those of the configuration come first.
        let own = self.types.iter().filter_map(|named| named.convention().ok());
        config.conventions = own.chain(std::mem::take(&mut config.conventions)).collect();
        config.embedded = self.embedded;
        config.hosts = hosts.clone();
        if let Some(namespace) = &self.namespace {
            config.namespace = Some(namespace.clone());
        }
        config.dialect = self.dialect.unwrap_or(config.dialect);
        config.max_message_bytes = config.max_message_bytes.max(largest_message);
        Ok(config)
    }

    /// Starts the middleware, where ports are opened that others connect to if it `listens`.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work or that name nothing, 1 when it does not start.
    pub(super) fn start_with(config: &YarpConfig, listens: bool) -> Result<Yarp> {
        let yarp = start(NAME, config)?;
        if listens {
            yarp.may_listen().map_err(Failure::usage)?;
        }
        if let Some(port) = yarp.log_port() {
            logging::write_to(Some(port));
        }
        Ok(yarp)
    }
}
