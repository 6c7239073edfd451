//! YARP: the name server that YARP's own configuration names, as Wrapyfi's programs find it.

use std::sync::Arc;

use super::config::YarpConfig;
use super::name::NAME;
use wrapyfi_endpoint::method::{EndpointNeeds, Options, Source};
use wrapyfi_endpoint::network::Place;
use wrapyfi_endpoint::{Planned, StartError};

/// YARP for registered methods, by their options, then by the environment.
pub fn source() -> Arc<dyn Source> {
    Arc::new(YarpSource)
}

struct YarpSource;

impl Source for YarpSource {
    fn name(&self) -> &str {
        NAME
    }

    fn absent(&self, options: &Options) -> Option<String> {
        // `plan` reports an option that cannot be read.
        let kwargs = options.map("yarp_kwargs").ok().flatten();
        if kwargs.is_some_and(|kwargs| matches!(kwargs.text("name_server"), Ok(Some(_)) | Err(_))) {
            return None;
        }
        match YarpConfig::default().check_name_server() {
            Err(error) if error.is_missing() => Some(error.to_string()),
            _ => None,
        }
    }

    fn plan(&self, wanted: &EndpointNeeds<'_>) -> Result<Planned, StartError> {
        let kwargs = wanted.options.part("yarp_kwargs")?;
        let mut config = YarpConfig::from_env().map_err(StartError::refused)?;
        config.name_server = kwargs.word("name_server")?.or(config.name_server);
        let ip = kwargs.word("ip")?;
        let is_insecure = kwargs.switch("insecure")?.unwrap_or(false);
        config.insecure.said(Place::Keyword, ip.is_some(), is_insecure);
        config.ip = ip.or(config.ip);
        config.is_wrapyfi = true;
        config.dialect = kwargs.word("dialect")?.unwrap_or(config.dialect);
        config.max_message_bytes = config.max_message_bytes.max(wanted.max_message_bytes);
        // Two sides, two instances: one instance does not hear itself.
        Ok(Planned::new(format!("{} {config:?}", wanted.role.is_provider()), config))
    }
}
