//! `endpoints.ros` of a configuration, and the middleware that it makes.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::path::Path;

use serde::Deserialize;
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_engine::{Available, MAX_CONFIG_BYTES, Problem, Spanned};
use wrapyfi_interfaces::ros1::Rules;
pub(super) use wrapyfi_ros1::NAME;
use wrapyfi_ros1::{self as ros1, Ros1Config};

use super::word::Word;
use crate::exit::{Failure, Result};
use crate::files::read_file;

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> = Available {
    name: NAME,
    check_topic: &ros1::check_name,
    options: ros1::OPTIONS,
    check_option: &|_, _| Ok(()),
    source_options: &[],
    destination_options: &[],
    conventions: ros1::CONVENTIONS,
};

/// `endpoints.ros`; what is left out comes from `ROS_MASTER_URI`, `ROS_HOSTNAME`, `ROS_IP` and
/// `ROS_NAMESPACE`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct Ros1Section {
    pub master_uri: Option<Spanned<String>>,
    pub hostname: Option<String>,
    pub namespace: Option<Spanned<String>>,
    pub node: Option<Spanned<String>>,
    pub remap: BTreeMap<String, String>,
    pub mapping_rules: Vec<Spanned<String>>,
    pub insecure: Word,
    /// Mapping rules of those files, once they were read.
    #[serde(skip)]
    pub rules: Rules,
}

impl Ros1Section {
    /// Reads the files of mapping rules, whose paths are as seen from `folder`.
    ///
    /// # Errors
    /// The first file that cannot be read or is wrong.
    pub fn read_rules(&mut self, folder: &Path) -> Result<(), Problem> {
        for file in &self.mapping_rules {
            let wrong = |reason: &dyn std::fmt::Display| {
                let text = format!("mapping_rules {:?}: {reason}", file.value);
                Problem::at(file.referenced, text)
            };
            let path = folder.join(&file.value);
            let text = read_file(&path).map_err(|error| wrong(&error))?;
            if text.len() > MAX_CONFIG_BYTES {
                return Err(wrong(&format!("the limit is {MAX_CONFIG_BYTES} bytes")));
            }
            let rules: Option<Rules> =
                serde_saphyr::from_str(&text).map_err(|error| wrong(&error))?;
            self.rules = std::mem::take(&mut self.rules).then(rules.unwrap_or_default());
        }
        Ok(())
    }

    /// Checks the node's name and the address of the master as the node does at its start, which asks the net as
    /// well.
    pub(super) fn check(&self) -> Result<(), Problem> {
        for (key, written, example) in
            [("namespace", &self.namespace, "/robot"), ("node", &self.node, "wrapyfi_bridge")]
        {
            let Some(written) = written else { continue };
            let name = &written.value;
            let checked = match key {
                "node" => ros1::NodeName::new(name, "/"),
                _ => ros1::NodeName::new("node", name),
            };
            if let Err(error) = checked {
                let text = format!(
                    "{key} {name:?} cannot be: {error}; write for example {key}: {example}"
                );
                return Err(Problem::at(written.referenced, text));
            }
        }
        let Some(written) = &self.master_uri else { return Ok(()) };
        let config = Ros1Config { master_uri: written.value.clone(), ..Ros1Config::default() };
        config.master().map(drop).map_err(|error| {
            let text = match error {
                ros1::Ros1ConfigError::MasterUri { uri, reason } => format!(
                    "master_uri {uri:?} is no address of a master: {reason}; write it as http://host:11311"
                ),
                other => other.to_string(),
            };
            Problem::at(written.referenced, text)
        })
    }

    /// A node of ours that other machines reach is refused before anything starts. A name that has no address yet is
    /// looked at when the node starts.
    pub fn check_permitted(&self, hosts: &Hosts) -> Result<(), Problem> {
        let ip = self.hostname.as_ref().map(|host| hosts.or_same(host).parse::<IpAddr>());
        let Some(Ok(ip)) = ip else { return Ok(()) };
        let permitted = self.insecure.0.check(NAME, "a ROS 1 node", ip);
        permitted.map_err(|refused| Problem { position: None, message: refused.to_string() })
    }

    /// All settings.
    ///
    /// # Errors
    /// Exit code 2 for variables of the environment that cannot be.
    pub(super) fn config(&self, hosts: &Hosts) -> Result<Ros1Config> {
        let mut config = Ros1Config::from_env().map_err(Failure::usage)?;
        let Ros1Section { master_uri, hostname, namespace, node, remap, insecure, rules, .. } =
            self.clone();
        config.master_uri = master_uri.map_or(config.master_uri, |uri| uri.value);
        insecure.say(&mut config.insecure, hostname.is_some());
        config.hostname = hostname.or(config.hostname);
        config.hosts = hosts.clone();
        config.namespace = namespace.map_or(config.namespace, |namespace| namespace.value);
        config.node = node.map_or(config.node, |node| Some(node.value));
        config.remaps = remap.into_iter().collect();
        config.mapping_rules = rules;
        Ok(config)
    }
}
