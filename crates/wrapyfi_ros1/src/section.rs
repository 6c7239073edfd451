//! `endpoints.ros` of a configuration, and the middleware that it makes.

use std::any::Any;
use std::collections::BTreeMap;
use std::net::IpAddr;
use std::path::Path;

use serde::Deserialize;
use wrapyfi_data::types::Value;
use wrapyfi_endpoint::config::{
    InsecureWord, MAX_CONFIG_BYTES, NamedSection, Problem, Spanned, in_no_file, read_file,
};
use wrapyfi_endpoint::driver::{
    Available, Carries, Driver, Permission, Purpose, Reach, RouteFacts, Section, Server,
    ServerAddress, Setting, StartNeeds, WholeBridge, WholeRoute, start_at,
};
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_endpoint::{Interaction, MiddlewareSettings as _, Planned, StartError};
use wrapyfi_interfaces::ros1::{Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

use super::action_client::{PREEMPTED, check_preempted};
use super::config::{MASTER_PORT, NAME, Ros1Config, Ros1ConfigError};
use super::names::{NodeName, check_name};
use super::{CONVENTIONS, OPTIONS, Ros1, differences};

/// The middleware `ros` for programs that are configured by a file.
pub const DRIVER: &dyn Driver = &Ros1Driver;

/// Starts a nameless node with the settings of a section, which looks and asks: the name of a bridge's node would end
/// that node.
///
/// # Errors
/// When the settings cannot work, or the system gives no sockets.
pub fn observe(section: &dyn Section, hosts: &Hosts) -> Result<Ros1, StartError> {
    let section = (section as &dyn Any).downcast_ref::<Ros1Section>();
    let mut config = section.cloned().unwrap_or_default().config(hosts)?;
    config.node = None;
    config.start()
}

/// Checks the value of an option.
fn check_option(name: &str, value: &Value) -> Result<(), String> {
    match name {
        PREEMPTED => check_preempted(value.as_str())
            .map(drop)
            .map_err(|wanted| format!("option {PREEMPTED} must be {wanted}")),
        _ => Ok(()),
    }
}

struct Ros1Driver;

impl Driver for Ros1Driver {
    fn available(&self) -> Available<'static> {
        let (check_topic, options, conventions) = (&check_name, OPTIONS, CONVENTIONS);
        Available {
            name: NAME,
            check_topic,
            options,
            check_option: &check_option,
            source_options: &[PREEMPTED],
            interactions: &Interaction::ALL,
            conventions,
            ..Available::default()
        }
    }

    fn section(&self) -> Box<dyn Section> {
        Box::new(Ros1Section::default())
    }

    fn whole_bridge(&self) -> Option<WholeBridge> {
        const BOTH: [WholeRoute; 2] = [
            WholeRoute::topic("ros:/(.*)", "$1", ""),
            WholeRoute::topic("ros:/$1", "(.*)", "").back(),
        ];
        /// The time of a simulator. Its name is the same for every node, wherever that is.
        const CLOCK: WholeRoute = WholeRoute {
            is_fixed: true,
            ..WholeRoute::topic("ros:/clock", "clock", ", type: rosgraph_msgs/msg/Clock")
        };
        let routes = |switches: &[&'static str], _has_hidden| {
            let services = BOTH.map(WholeRoute::service);
            let clock = (!switches.is_empty()).then_some(CLOCK);
            let actions = BOTH.map(WholeRoute::action);
            BOTH.into_iter().chain(services).chain(actions).chain(clock).collect()
        };
        let switches = &[("clock", "Carries /clock from ROS 1.")];
        Some(WholeBridge { executable: "ros1_bridge", title: "ROS 1", switches, routes })
    }

    fn is_expected(&self) -> bool {
        std::env::var_os("ROS_MASTER_URI").is_some()
    }
}

/// `endpoints.ros`; what is left out comes from `ROS_MASTER_URI`, `ROS_HOSTNAME`, `ROS_IP` and
/// `ROS_NAMESPACE`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
struct Ros1Section {
    master_uri: Option<Spanned<String>>,
    hostname: Option<String>,
    namespace: Option<Spanned<String>>,
    node: Option<Spanned<String>>,
    remap: BTreeMap<String, String>,
    mapping_rules: Vec<Spanned<String>>,
    insecure: InsecureWord,
    /// Mapping rules of those files, once they were read.
    #[serde(skip)]
    rules: Rules,
}

impl NamedSection for Ros1Section {
    const NAME: &'static str = NAME;

    fn example_of(key: &str) -> Option<&'static str> {
        match key {
            NAME => Some("{ master_uri: \"http://localhost:11311\" }"),
            "insecure" => Some("true"),
            _ => None,
        }
    }
}

impl Section for Ros1Section {
    /// Reads the files of mapping rules.
    fn find_files(&mut self, folder: &Path) -> Result<(), Problem> {
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
    fn check(&self) -> Result<(), Problem> {
        for (key, written, example) in
            [("namespace", &self.namespace, "/robot"), ("node", &self.node, "wrapyfi_bridge")]
        {
            let Some(written) = written else { continue };
            let name = &written.value;
            let checked = match key {
                "node" => NodeName::new(name, "/"),
                _ => NodeName::new("node", name),
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
                Ros1ConfigError::MasterUri { uri, reason } => format!(
                    "master_uri {uri:?} is no address of a master: {reason}; write it as http://host:11311"
                ),
                other => other.to_string(),
            };
            Problem::at(written.referenced, text)
        })
    }

    /// A node of ours that other machines reach is refused before anything starts. A name that has no address yet is
    /// looked at when the node starts.
    fn check_permitted(&self, hosts: &Hosts) -> Result<(), Problem> {
        let ip = self.hostname.as_ref().map(|host| hosts.or_same(host).parse::<IpAddr>());
        let Some(Ok(ip)) = ip else { return Ok(()) };
        let permitted = self.insecure.0.check(NAME, "a ROS 1 node", ip);
        permitted.map_err(|refused| Problem { position: None, message: refused.to_string() })
    }

    fn settings(&mut self) -> Vec<(&'static str, Setting<'_>)> {
        vec![
            ("hostname", Setting::Text(&mut self.hostname)),
            ("insecure", Setting::Switch(&mut self.insecure.0.is_allowed)),
            ("master_uri", Setting::Placed(&mut self.master_uri)),
            ("namespace", Setting::Placed(&mut self.namespace)),
            ("node", Setting::Placed(&mut self.node)),
        ]
    }

    fn permission(&mut self) -> Option<Permission<'_>> {
        let insecure = &mut self.insecure.0;
        Some(Permission { insecure, address: "hostname", said_elsewhere: None })
    }

    fn name_node(&mut self, node: &str) {
        self.node.get_or_insert_with(|| in_no_file(node.to_owned()));
    }

    fn plan(&self, needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        let mut config = self.config(needs.hosts)?;
        if needs.purpose == Purpose::Look {
            // The name of the bridge's node would end that node.
            config.node = None;
        }
        let insecure = config.insecure.is_allowed.into();
        let key = format!("{:?}", Ros1Config { insecure, ..config.clone() });
        Ok(Planned::new(key, config))
    }

    fn servers(
        &self,
        hosts: &Hosts,
        _interaction: Interaction,
    ) -> Result<Vec<ServerAddress>, StartError> {
        let (host, port) = self.config(hosts)?.master().map_err(StartError::refused)?;
        // What the file says goes before the environment.
        let place = match &self.master_uri {
            Some(_) => "have `master_uri` say",
            None => "set ROS_MASTER_URI to",
        };
        let roscore = start_at("roscore", "*", &[("-p", port, MASTER_PORT)]);
        let start = format!("{roscore}    # or {place} where it runs");
        let variables = match &self.master_uri {
            Some(uri) => format!("ROS_MASTER_URI={} ", uri.value),
            None => String::new(),
        };
        let reach = Reach { variables, options: String::new() };
        Ok(vec![ServerAddress { server: Server::Master, host, port, is_own: false, start, reach }])
    }

    /// Mapping rules without effect, and fields that routes lose because definitions of ROS 1 and ROS 2 differ.
    fn warnings(
        &self,
        routes: &[RouteFacts<'_>],
        types: &mut TypeStore,
    ) -> Vec<(Option<usize>, String)> {
        let mut warnings = Vec::new();
        if self.rules != Rules::built_in() {
            let mut known = Types::from_environment(self.rules.clone());
            warnings.extend(known.check_rules(types).iter().map(|it| (None, it.to_string())));
        }
        let mut types = None;
        for (at, route) in routes.iter().enumerate() {
            let is_source = route.from.middleware == NAME;
            if !route.is_typed || !(is_source || route.to.middleware == NAME) {
                continue;
            }
            let types = types.get_or_insert_with(|| {
                Types::from_environment(self.rules.clone().then(Rules::built_in()))
            });
            let found = match route.carries {
                Carries::Topic(from, to) => {
                    differences::of_topic(types, if is_source { from } else { to })
                }
                Carries::Service(kind) => differences::of_service(types, kind),
                Carries::Action(kind) => {
                    kind.map_or_else(Vec::new, |kind| differences::of_action(types, kind))
                }
            };
            warnings.extend(found.into_iter().map(|difference| (Some(at), difference)));
        }
        warnings
    }
}

impl Ros1Section {
    /// All settings.
    fn config(&self, hosts: &Hosts) -> Result<Ros1Config, StartError> {
        let mut config = Ros1Config::from_env().map_err(StartError::refused)?;
        let Self { master_uri, hostname, namespace, node, remap, insecure, rules, .. } =
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
