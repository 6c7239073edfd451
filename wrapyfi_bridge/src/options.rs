//! `--option NAME=VALUE`: settings of one endpoint that only some middlewares have.

use std::str::FromStr;

use bytes::Bytes;
use clap::Args;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Map, Value};
use wrapyfi_endpoint::codec::json;
use wrapyfi_engine::known_option;

use crate::exit::{Failure, Result};
use crate::middlewares::option_names;
use crate::own_address::OwnAddress;

/// Settings of the endpoint, as `options` of a route.
#[derive(Debug, Clone, Default, Args)]
pub struct EndpointOptions {
    /// Setting of the endpoint that its middleware knows, such as carrier=udp on yarp; may be given more
    /// than once. Values are JSON, or text as it stands.
    #[arg(long = "option", value_name = "NAME=VALUE")]
    pub options: Vec<EndpointOption>,
    /// Address at which others reach the endpoint.
    #[command(flatten)]
    pub own: OwnAddress,
}

/// One setting.
#[derive(Debug, Clone, PartialEq)]
pub struct EndpointOption {
    name: String,
    value: Value,
}

impl FromStr for EndpointOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text
            .split_once('=')
            .filter(|(name, _)| !name.is_empty())
            .ok_or_else(|| format!("{text:?} is no setting: write it as carrier=udp"))?;
        let read = json::decode(
            &Bytes::copy_from_slice(value.as_bytes()),
            &Limits::default(),
            &wrapyfi_core::plugin::standard(),
        );
        let value = read.unwrap_or_else(|_text| value.into());
        Ok(Self { name: name.to_owned(), value })
    }
}

impl EndpointOptions {
    /// Options as an endpoint of `middleware` takes them; the last one of a name counts.
    ///
    /// # Errors
    /// Exit code 2 for an option that the middleware does not know, and an address that it has not.
    pub fn of(&self, middleware: &str) -> Result<Map> {
        self.own.check(middleware)?;
        let (known, place) = (option_names(middleware), format!("on {middleware}"));
        for option in &self.options {
            known_option(&option.name, known, &place).map_err(Failure::Usage)?;
        }
        Ok(self.options.iter().map(|option| (option.name.as_str(), option.value.clone())).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_json_or_text() {
        let read = |text: &str| text.parse::<EndpointOption>().unwrap();
        let options = EndpointOptions {
            options: ["carrier=udp", "persistent=false", "joints=[\"a\", \"b\"]", "carrier=mcast"]
                .map(read)
                .to_vec(),
            ..EndpointOptions::default()
        };
        let map = options.of("yarp").unwrap();
        assert_eq!(map.get("carrier"), Some(&"mcast".into()));
        assert_eq!(map.get("persistent"), Some(&false.into()));
        assert_eq!(map.get("joints"), Some(&Value::from_iter(["a", "b"])));
        let refused = options.of("zeromq").unwrap_err().to_string();
        assert_eq!(refused, "option carrier is unknown on zeromq; options here: none");
        let slip = EndpointOptions { options: vec![read("carier=udp")], ..options };
        let slip = slip.of("yarp").unwrap_err().to_string();
        assert!(slip.contains("did you mean `carrier`?"), "{slip}");
        assert!("udp".parse::<EndpointOption>().unwrap_err().contains("carrier=udp"));
    }
}
