//! ZeroMQ: publishers run the broker where there is none, listeners never do.

use std::sync::Arc;

use super::config::{BrokerMode, NAME, ZeroMqConfig};
use wrapyfi_endpoint::method::{EndpointNeeds, Source};
use wrapyfi_endpoint::network::Place;
use wrapyfi_endpoint::{Planned, Role, StartError};

/// ZeroMQ for registered methods, by their options, then by the environment.
pub fn source() -> Arc<dyn Source> {
    Arc::new(ZeroMqSource)
}

struct ZeroMqSource;

impl Source for ZeroMqSource {
    fn name(&self) -> &str {
        NAME
    }

    fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
        let options = wanted.options;
        // Wrapyfi's clients and servers read the names of the two ports crosswise.
        let read = match wanted.role {
            Role::Client | Role::ActionClient => ZeroMqConfig::from_env_of_client(),
            _ => ZeroMqConfig::from_env(),
        };
        let mut config = read.map_err(StartError::refused)?;
        let ip = options.text("socket_ip")?;
        if let Some(ip) = ip {
            ip.clone_into(&mut config.ip);
        }
        let is_insecure = options.switch("insecure")?.unwrap_or(false);
        config.insecure.said(Place::Keyword, ip.is_some(), is_insecure);
        if let Some(topic) = options.text("pubsub_monitor_topic")? {
            topic.clone_into(&mut config.monitor_topic);
        }
        config.pub_port = options.number("socket_pub_port")?.unwrap_or(config.pub_port);
        config.sub_port = options.number("socket_sub_port")?.unwrap_or(config.sub_port);
        config.rep_port = options.number("socket_rep_port")?.unwrap_or(config.rep_port);
        config.req_port = options.number("socket_req_port")?.unwrap_or(config.req_port);
        config.monitor = options.switch("start_pubsub_monitor_broker")?.unwrap_or(config.monitor);
        config.max_frame_bytes = config.max_frame_bytes.max(wanted.max_message_bytes);
        let may_start = match options.switch("start_proxy_broker")? {
            Some(may_start) => may_start,
            None => config.broker == BrokerMode::Embedded,
        };
        let mode = |role| match may_start && wanted.role == role {
            true => BrokerMode::Embedded,
            false => BrokerMode::Foreign,
        };
        config.broker = mode(Role::Publisher);
        config.service_broker = mode(Role::Server);
        // Two directions, two instances: one instance does not hear itself.
        Ok(Planned::new(format!("{} {config:?}", wanted.role.is_provider()), config))
    }
}
