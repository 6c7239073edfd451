//! `endpoints.yarp` of a configuration, and the middleware that it makes.

use std::net::IpAddr;
use std::sync::Arc;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::config::{InsecureWord, NamedSection, Problem, Spanned};
use wrapyfi_endpoint::driver::{
    Available, Driver, Permission, Purpose, Reach, Section, Server, ServerAddress, Setting,
    StartNeeds, WholeBridge, WholeRoute, start_at,
};
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_endpoint::{Interaction, MiddlewareSettings as _, Planned, Role, StartError};
use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::name::conf::locate;
use wrapyfi_yarp::name::environment::DEFAULT_PORT;
use wrapyfi_yarp::name::{Environment, NameServerConf};

use super::CONVENTIONS;
use super::config::YarpConfig;
use super::name::{NAME, check_topic};
use super::options::{DESTINATION_OPTIONS, OPTIONS, SOURCE_OPTIONS, check_option};
use super::types::Convention;

/// The middleware `yarp` for programs that are configured by a file.
pub const DRIVER: &dyn Driver = &YarpDriver;

struct YarpDriver;

impl Driver for YarpDriver {
    fn available(&self) -> Available<'static> {
        Available {
            name: NAME,
            check_topic: &check_topic,
            options: OPTIONS,
            check_option: &check_option,
            source_options: SOURCE_OPTIONS,
            destination_options: DESTINATION_OPTIONS,
            conventions: CONVENTIONS,
            ..Available::default()
        }
    }

    fn section(&self) -> Box<dyn Section> {
        Box::new(YarpSection::default())
    }

    fn whole_bridge(&self) -> Option<WholeBridge> {
        let switches =
            &[("joint_states", "Carries the joints of all control boards to /joint_states, too.")];
        Some(WholeBridge {
            executable: "yarp_bridge",
            title: "YARP",
            switches,
            routes: whole_routes,
        })
    }

    fn is_expected(&self) -> bool {
        YarpConfig::from_env().is_ok()
    }
}

/// Routes of all that there is, with the joints of all control boards where a switch is on.
fn whole_routes(switches: &[&'static str], has_hidden: bool) -> Vec<WholeRoute> {
    let mut routes = Vec::new();
    // The time of a simulation is left out elsewhere: on YARP no program has such a port by accident.
    if !has_hidden {
        const CLOCK: &str = ", type: rosgraph_msgs/msg/Clock, default_deny: false";
        routes.push(WholeRoute::topic("yarp:/(clock)", "$1", CLOCK));
        routes.push(WholeRoute::topic("yarp:/$1", "(clock)", CLOCK).back());
    }
    if !switches.is_empty() {
        const JOINTS: &str = ", type: sensor_msgs/msg/JointState, merge: true";
        routes.push(WholeRoute::topic("yarp:/(?:.*/)?state:o", "joint_states", JOINTS));
    }
    // A name server does not tell all types. Names of ROS have no colon: /head/state:o is /head/state/o there. An input
    // port whose name is meant is written to: /head/command/i to /head/command:i.
    const UNKNOWN: &str = ", type_if_unknown: NativeObject";
    routes.push(WholeRoute::topic("yarp:/([^:]*)", "$1", UNKNOWN));
    routes.push(WholeRoute::topic("yarp:/([^:]*):(.*)", "${1}/$2", UNKNOWN));
    routes.push(WholeRoute::topic("yarp:/$1", "(.*)", "").back());
    // Robots take bottles, functions of Wrapyfi JSON.
    const UNKNOWN_CALLS: &str = ", type_if_unknown: NativeObject, options: { bottle: auto }";
    routes.push(WholeRoute::topic("yarp:/([^:]*)", "$1", UNKNOWN_CALLS).service());
    routes.push(WholeRoute::topic("yarp:/([^:]*):(.*)", "${1}/$2", UNKNOWN_CALLS).service());
    let calls = ", options: { bottle: auto }";
    routes.push(WholeRoute::topic("yarp:/$1", "(.*)", calls).back().service());
    routes
}

/// `endpoints.yarp`; what is left out comes from YARP's own configuration (`yarp.conf`).
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
struct YarpSection {
    name_server: Option<Spanned<String>>,
    embedded: bool,
    namespace: Option<String>,
    #[serde(deserialize_with = "dialect")]
    dialect: Option<Dialect>,
    ip: Option<Spanned<String>>,
    insecure: InsecureWord,
    types: Vec<NamedType>,
}

/// An entry of `types`: ports whose names tell the type of what they send.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct NamedType {
    /// Names of the ports, as a regular expression.
    names: Spanned<String>,
    /// Type of the messages that they send.
    #[serde(rename = "type")]
    message_type: Spanned<String>,
}

impl NamedType {
    fn convention(&self) -> Result<Convention, Problem> {
        let Self { names, message_type } = self;
        let word = &message_type.value;
        // A type of ROS may be defined where this program has not looked yet.
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

impl NamedSection for YarpSection {
    const NAME: &'static str = NAME;

    fn example_of(key: &str) -> Option<&'static str> {
        match key {
            NAME => Some("{ name_server: \"127.0.0.1:10000\" }"),
            "insecure" | "embedded" => Some("true"),
            _ => None,
        }
    }
}

impl Section for YarpSection {
    /// Finds what can be found wrong before anything is started.
    fn check(&self) -> Result<(), Problem> {
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
    fn check_permitted(&self, _hosts: &Hosts) -> Result<(), Problem> {
        let Some((written, ip)) = self.own_ip()? else { return Ok(()) };
        let permitted = self.insecure.0.check(NAME, "a port", ip);
        permitted.map_err(|refused| Problem::at(written.referenced, refused.to_string()))
    }

    fn settings(&mut self) -> Vec<(&'static str, Setting<'_>)> {
        vec![
            ("embedded", Setting::Switch(&mut self.embedded)),
            ("insecure", Setting::Switch(&mut self.insecure.0.is_allowed)),
            ("ip", Setting::Placed(&mut self.ip)),
            ("name_server", Setting::Placed(&mut self.name_server)),
            ("namespace", Setting::Text(&mut self.namespace)),
        ]
    }

    fn permission(&mut self) -> Option<Permission<'_>> {
        Some(Permission { insecure: &mut self.insecure.0, address: "ip", said_elsewhere: None })
    }

    fn plan(&self, needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        let mut config = self.config(needs.largest_message, needs.hosts)?;
        let listens = match needs.purpose {
            Purpose::Routes { is_reached, .. } => {
                config = config.located();
                is_reached
            }
            Purpose::Endpoint(role) => role != Role::Client,
            Purpose::Look => {
                config.embedded = false;
                false
            }
        };
        let insecure = config.insecure.is_allowed.into();
        let key = format!("{:?} {listens}", YarpConfig { insecure, ..config.clone() });
        let start = move || {
            let yarp = config.start()?;
            if listens {
                yarp.may_listen().map_err(StartError::refused)?;
            }
            Ok(Arc::new(yarp) as _)
        };
        Ok(Planned { key, start: Arc::new(start) })
    }

    fn servers(
        &self,
        hosts: &Hosts,
        _interaction: Interaction,
    ) -> Result<Vec<ServerAddress>, StartError> {
        let config = self.config(0, hosts)?;
        let found = match config.name_server {
            Some(written) => written,
            None => match locate(&Environment::from_process()) {
                Ok(located) => located.server,
                Err(_) if config.embedded => {
                    NameServerConf { host: "127.0.0.1".to_owned(), port: DEFAULT_PORT }
                }
                Err(error) => return Err(StartError::Absent(error.to_string())),
            },
        };
        let (host, port, is_own) = (found.host, found.port, config.embedded);
        let on = |option| [(option, port, DEFAULT_PORT)];
        let ours = start_at("wrapyfi yarpserver", &host, &on("--port"));
        let start = format!("{ours}    # or {}", start_at("yarpserver", "*", &on("--socket")));
        let (server, reach) = (Server::NameServer, Reach::default());
        Ok(vec![ServerAddress { server, host, port, is_own, start, reach }])
    }
}

impl YarpSection {
    fn own_ip(&self) -> Result<Option<(&Spanned<String>, IpAddr)>, Problem> {
        let Some(written) = &self.ip else { return Ok(None) };
        let ip = written.value.parse::<IpAddr>().map_err(|_text| {
            let text = format!("ip {:?} is no address: write it as 127.0.0.1", written.value);
            Problem::at(written.referenced, text)
        })?;
        Ok(Some((written, ip)))
    }

    /// All settings.
    fn config(&self, largest_message: usize, hosts: &Hosts) -> Result<YarpConfig, StartError> {
        let mut config = YarpConfig::from_env().map_err(StartError::refused)?;
        if let Some(written) = &self.name_server {
            config.name_server = Some(written.value.parse().map_err(StartError::refused)?);
        }
        self.insecure.say(&mut config.insecure, self.ip.is_some());
        if let Some(written) = &self.ip {
            config.ip = Some(written.value.parse().map_err(StartError::refused)?);
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
}
