//! `endpoints.yarp` of a configuration, and the middleware that it makes.

use std::net::{IpAddr, SocketAddr};

use serde::Deserialize;
use wrapyfi_core::engine::{Available, Problem, Spanned};
pub(super) use wrapyfi_core::middleware::yarp::NAME;
use wrapyfi_core::middleware::yarp::{self, Dialect, StartError, Yarp, YarpConfig};

use crate::exit::Failure;

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> =
    Available { name: NAME, check_topic: &yarp::check_topic, options: yarp::OPTIONS };

/// `endpoints.yarp`; what is left out comes from YARP's own configuration (`yarp.conf`).
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct YarpSection {
    pub name_server: Option<Spanned<String>>,
    pub embedded: bool,
    pub namespace: Option<String>,
    pub dialect: Option<DialectWord>,
    pub ip: Option<Spanned<String>>,
    pub insecure: bool,
}

/// How bottles are encoded.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum DialectWord {
    V3,
    V4,
}

impl YarpSection {
    /// Finds what can be found wrong before anything is started.
    pub fn check(&self) -> Result<(), Problem> {
        if let Some(written) = &self.name_server
            && written.value.parse::<SocketAddr>().is_err()
        {
            let text = format!(
                "name_server {:?} is no address: write it as 127.0.0.1:10000",
                written.value
            );
            return Err(Problem::at(written.referenced, text));
        }
        let Some(written) = &self.ip else { return Ok(()) };
        let text = match written.value.parse::<IpAddr>() {
            Err(_) => format!("ip {:?} is no address: write it as 127.0.0.1", written.value),
            Ok(ip) if !ip.is_loopback() && !self.insecure => format!(
                "ip {ip} is open to other machines, and nothing is encrypted there; use 127.0.0.1, or \
                 write insecure: true"
            ),
            Ok(_) => return Ok(()),
        };
        Err(Problem::at(written.referenced, text))
    }

    /// Starts the middleware.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when it does not start.
    pub fn start(&self, largest_message: usize) -> Result<Yarp, Failure> {
        let mut config = match &self.name_server {
            // The environment need not know a name server where the file does.
            Some(_) => YarpConfig::default(),
            None if self.embedded => YarpConfig::from_env().unwrap_or_default(),
            None => YarpConfig::from_env().map_err(Failure::usage)?,
        };
        if let Some(written) = &self.name_server {
            config.name_server = Some(written.value.parse().map_err(Failure::usage)?);
        }
        if let Some(written) = &self.ip {
            config.ip = written.value.parse().map_err(Failure::usage)?;
        }
        config.embedded = self.embedded;
        config.insecure |= self.insecure;
        if let Some(namespace) = &self.namespace {
            config.namespace = Some(namespace.clone());
        }
        match self.dialect {
            Some(DialectWord::V3) => config.dialect = Dialect::V3,
            Some(DialectWord::V4) => config.dialect = Dialect::V4,
            None => {}
        }
        config.max_message_bytes = config.max_message_bytes.max(largest_message);
        Yarp::start(&config).map_err(|error| match error {
            StartError::NameServer(_) | StartError::NotLoopback { .. } => Failure::usage(error),
            other => Failure::Failed(anyhow::Error::new(other).context("yarp")),
        })
    }
}
