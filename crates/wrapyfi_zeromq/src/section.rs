//! `endpoints.zeromq` of a configuration, and the middleware that it makes.

use std::net::IpAddr;
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Deserializer};
use wrapyfi_endpoint::config::{InsecureWord, NamedSection, Problem, Spanned};
use wrapyfi_endpoint::driver::{
    Available, Carries, Driver, Permission, Purpose, Reach, RouteFacts, Section, Server,
    ServerAddress, Setting, StartNeeds, WholeBridge, WholeRoute, start_at,
};
use wrapyfi_endpoint::network::{Hosts, ReachedByOthers};
use wrapyfi_endpoint::{
    Conventions, EndpointAddress, Interaction, MiddlewareSettings as _, Planned, Role, StartError,
};

use super::config::{BrokerMode, NAME, ZeroMqConfig};
use super::curve_config::{CurveClient, CurveConfig, CurveError};

/// The middleware `zeromq` for programs that are configured by a file.
pub const DRIVER: &dyn Driver = &ZeroMqDriver;

struct ZeroMqDriver;

impl Driver for ZeroMqDriver {
    fn available(&self) -> Available<'static> {
        let conventions = Conventions {
            has_service_names: false,
            shows_publishers: false,
            program: "a Wrapyfi script, or another program on ZeroMQ",
            keys: Some(
                "`endpoints: zeromq: curve`, at the broker and here, and of WRAPYFI_ZEROMQ_CURVE_SERVER_KEY and \
                 WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE for what that leaves out",
            ),
            ..Conventions::NONE
        };
        let check_topic = &super::check_topic;
        Available { name: NAME, check_topic, conventions, ..Available::default() }
    }

    fn section(&self) -> Box<dyn Section> {
        Box::new(ZeroMqSection::default())
    }

    fn whole_bridge(&self) -> Option<WholeBridge> {
        const ROUTES: [WholeRoute; 2] = [
            WholeRoute::topic("zeromq:/(.*)", "$1", ""),
            WholeRoute::topic("zeromq:/$1", "(.*)", "").back(),
        ];
        let (executable, title) = ("zeromq_bridge", "ZeroMQ");
        Some(WholeBridge { executable, title, switches: &[], routes: |_, _| ROUTES.into() })
    }

    /// Services that cannot be told apart are refused; routes that call one name share its server.
    fn check_routes(&self, routes: &[RouteFacts<'_>]) -> Result<(), (usize, String)> {
        let is_zeromq = |end: &EndpointAddress| end.middleware == NAME;
        let mut services = routes.iter().enumerate().filter(|(_, it)| {
            matches!(it.carries, Carries::Service(_)) && (is_zeromq(it.from) || is_zeromq(it.to))
        });
        let is_nameless = |it: &RouteFacts<'_>| !it.is_whole && (is_zeromq(it.from) || it.is_many);
        if let Some((index, pattern)) = services.clone().find(|(_, it)| is_nameless(it)) {
            let fault = format!(
                "{}: services of zeromq have no names, and tell no types: a pair of ports is one service; \
                 write a route for it, with a type",
                pattern.name
            );
            return Err((index, fault));
        }
        let Some((_, one)) = services.next() else { return Ok(()) };
        let shares_server = |it: &RouteFacts<'_>| is_zeromq(it.from) && it.from == one.from;
        match services.find(|(_, it)| !shares_server(it)) {
            Some((index, other)) => Err((
                index,
                format!(
                    "{} and {}: a pair of ports of zeromq is one service, and each would get the requests of the other; \
                     give one of them to another bridge, on other ports (endpoints.zeromq.rep_port, req_port)",
                    one.ends, other.ends
                ),
            )),
            None => Ok(()),
        }
    }
}

/// `endpoints.zeromq`; what is left out comes from the `WRAPYFI_ZEROMQ_*` variables, else from
/// Wrapyfi's defaults.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
struct ZeroMqSection {
    ip: Option<Spanned<String>>,
    pub_port: Option<Spanned<u16>>,
    sub_port: Option<Spanned<u16>>,
    rep_port: Option<Spanned<u16>>,
    req_port: Option<Spanned<u16>>,
    broker: Option<BrokerMode>,
    monitor_topic: Option<String>,
    send_hwm: Option<u16>,
    max_connections: Option<NonZeroU16>,
    insecure: InsecureWord,
    // Without keys below it, the word asks for keys all the same: nothing would be encrypted.
    #[serde(deserialize_with = "present")]
    curve: Option<Spanned<CurveSection>>,
}

impl NamedSection for ZeroMqSection {
    const NAME: &'static str = NAME;

    fn example_of(key: &str) -> Option<&'static str> {
        Some(match key {
            NAME => "{ broker: foreign }",
            "pub_port" => "5555",
            "sub_port" => "5556",
            "rep_port" => "5558",
            "req_port" => "5559",
            "insecure" => "true",
            _ => return None,
        })
    }
}

/// `endpoints.zeromq.curve`: a [`CurveConfig`] in which each client has its line.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CurveSection {
    secret_key_file: Option<PathBuf>,
    server_key: Option<String>,
    clients: Option<Vec<Spanned<CurveClient>>>,
}

impl CurveSection {
    /// The settings, and those of the environment for what is left out.
    fn or(&self, of_environment: CurveConfig) -> CurveConfig {
        let Self { secret_key_file, server_key, clients } = self.clone();
        CurveConfig {
            secret_key_file: secret_key_file.or(of_environment.secret_key_file),
            server_key: server_key.or(of_environment.server_key),
            clients: clients.map(|each| each.into_iter().map(|client| client.value).collect()),
        }
    }
}

/// A port: its key, its number, and what is written.
type Port<'c> = (&'static str, &'c mut u16, Option<&'c Spanned<u16>>);

/// A section that is there even where nothing stands below it.
fn present<'de, D: Deserializer<'de>>(
    written: D,
) -> Result<Option<Spanned<CurveSection>>, D::Error> {
    Spanned::deserialize(written).map(Some)
}

/// Settings that the environment makes.
fn of_environment() -> Result<ZeroMqConfig, Problem> {
    let config = ZeroMqConfig::from_env().map(running_broker);
    config.map_err(|wrong| Problem { position: None, message: wrong.to_string() })
}

/// The settings of a bridge, which runs the broker where the variable keeps scripts from it: who exports it in a shell, as
/// their guide has it, would have no broker at all.
fn running_broker(config: ZeroMqConfig) -> ZeroMqConfig {
    let broker = BrokerMode::Embedded;
    ZeroMqConfig { broker, service_broker: broker, broker_by_variable: false, ..config }
}

impl ZeroMqConfig {
    /// Checks that a broker of ours can have these keys, or who connects to one.
    ///
    /// # Errors
    /// The fault, with the variable of the environment that is at fault.
    pub fn check_keys(&self) -> Result<(), String> {
        ZeroMqSection::default().check_keys(self).map_err(|fault| fault.message)
    }
}

impl Section for ZeroMqSection {
    /// Finds the files of keys.
    fn find_files(&mut self, folder: &Path) -> Result<(), Problem> {
        let Some(Spanned { value: curve, .. }) = &mut self.curve else { return Ok(()) };
        if let Some(file) = &mut curve.secret_key_file {
            *file = folder.join(&*file);
        }
        let keys = curve.clients.iter_mut().flatten().map(|client| &mut client.value.key);
        for key in curve.server_key.iter_mut().chain(keys) {
            // What names no file is the key itself.
            let file = folder.join(&*key);
            if file.is_file() {
                *key = file.display().to_string();
            }
        }
        Ok(())
    }

    /// Refuses what no broker can start with, and no program can connect to.
    fn check(&self) -> Result<(), Problem> {
        if let Some(ip) = &self.ip
            && ip.value.trim_matches(['[', ']']).parse::<IpAddr>().is_err()
            && ip.value.contains([':', '/', ' '])
        {
            let text = format!(
                "ip {:?} is neither an address nor the name of a host: write ports as pub_port and sub_port",
                ip.value
            );
            return Err(Problem::at(ip.referenced, text));
        }
        let mut config = of_environment()?;
        self.say_ports(&mut config);
        let ports = self.ports(&mut config);
        let usual = ["5555", "5556", "5558", "5559"];
        for ((key, _, written), usual) in ports.iter().zip(usual) {
            if let Some(written) = written.filter(|it| it.value == 0) {
                let text = format!(
                    "{key} is 0, it must be a port from 1 to 65535: write for example {key}: {usual}"
                );
                return Err(Problem::at(written.referenced, text));
            }
        }
        for (at, (other, same, second)) in ports.iter().enumerate() {
            for (before, (one, port, first)) in ports.iter().enumerate().take(at) {
                // Of the default ports for services nothing is known that they are used.
                let first = first.filter(|_| before / 2 == at / 2);
                if let Some(written) = second.or(first)
                    && port == same
                {
                    let taken: Vec<u16> = ports.iter().map(|(_, port, _)| **port).collect();
                    let free = (**port..=u16::MAX).find(|port| !taken.contains(port));
                    let text = format!(
                        "{one} and {other} are both {port}: give each a port of its own, such as {other}: {}",
                        free.unwrap_or(5560)
                    );
                    return Err(Problem::at(written.referenced, text));
                }
            }
        }
        self.say(&mut config);
        // Variables alone concern no file, which may be read where another program is to have them.
        if self.curve.is_some() { self.check_keys(&config) } else { Ok(()) }
    }

    /// A broker of ours that other machines reach is refused before anything starts.
    fn check_permitted(&self, hosts: &Hosts) -> Result<(), Problem> {
        let Some(written) = &self.ip else { return Ok(()) };
        let mut config = of_environment()?;
        config.hosts = hosts.clone();
        self.say(&mut config);
        let refused = |refused: ReachedByOthers| refused.to_string();
        let checked = config.check().map_err(refused);
        checked.map_err(|text| Problem::at(written.referenced, text))
    }

    fn settings(&mut self) -> Vec<(&'static str, Setting<'_>)> {
        vec![
            ("insecure", Setting::Switch(&mut self.insecure.0.is_allowed)),
            ("ip", Setting::Placed(&mut self.ip)),
            ("pub_port", Setting::Port(&mut self.pub_port)),
            ("rep_port", Setting::Port(&mut self.rep_port)),
            ("req_port", Setting::Port(&mut self.req_port)),
            ("sub_port", Setting::Port(&mut self.sub_port)),
        ]
    }

    /// The word is about the broker's address: no program is told one of ours.
    fn permission(&mut self) -> Option<Permission<'_>> {
        let said_elsewhere = Some("; where ZeroMQ's broker is, WRAPYFI_ZEROMQ_SOCKET_IP says");
        Some(Permission { insecure: &mut self.insecure.0, address: "ip", said_elsewhere })
    }

    fn plan(&self, needs: &StartNeeds<'_>) -> Result<Planned, StartError> {
        let config = self.config(needs)?;
        self.check_keys(&config).map_err(|fault| StartError::Refused(fault.message))?;
        let serves = matches!(needs.purpose, Purpose::Routes { has_services: true, .. });
        let insecure = config.insecure.is_allowed.into();
        let key = format!("{:?} {serves}", ZeroMqConfig { insecure, ..config.clone() });
        let start = move || {
            let zeromq = config.start()?;
            if serves {
                // A server of Wrapyfi's that was told not to start one relies on it.
                zeromq.start_services().map_err(|error| StartError::Failed(error.to_string()))?;
            }
            Ok(Arc::new(zeromq) as _)
        };
        Ok(Planned { key, start: Arc::new(start) })
    }

    fn servers(
        &self,
        hosts: &Hosts,
        interaction: Interaction,
    ) -> Result<Vec<ServerAddress>, StartError> {
        // An action is a function here.
        let is_service = interaction != Interaction::Topic;
        let purpose = Purpose::Routes { has_services: is_service, is_reached: false };
        let config = self.config(&StartNeeds { hosts, largest_message: 0, purpose })?;
        let (server, mode, ports) = match is_service {
            false => (Server::Broker, config.broker, [config.pub_port, config.sub_port]),
            true => {
                (Server::ServiceBroker, config.service_broker, [config.rep_port, config.req_port])
            }
        };
        let (is_own, host) = (mode == BrokerMode::Embedded, config.ip);
        let usual = ZeroMqConfig::default();
        let options = [
            ("--pub-port", config.pub_port, usual.pub_port),
            ("--sub-port", config.sub_port, usual.sub_port),
            ("--rep-port", config.rep_port, usual.rep_port),
            ("--req-port", config.req_port, usual.req_port),
        ];
        let start = start_at("wrapyfi broker", &host, &options);
        let shell = ZeroMqConfig::from_env().unwrap_or(usual);
        let mut reach = Reach::default();
        // A broker on all interfaces is reached at the usual address.
        if host != shell.ip && host != "*" {
            reach.variables = format!("WRAPYFI_ZEROMQ_SOCKET_IP={host} ");
        }
        for (kind, port, of_shell) in
            [("PUB", config.pub_port, shell.pub_port), ("SUB", config.sub_port, shell.sub_port)]
        {
            if !is_service && port != of_shell {
                reach.variables += &format!("WRAPYFI_ZEROMQ_SOCKET_{kind}_PORT={port} ");
            }
        }
        for (option, port, of_shell) in [
            ("--rep-port", config.rep_port, shell.rep_port),
            ("--req-port", config.req_port, shell.req_port),
        ] {
            if is_service && port != of_shell {
                reach.options += &format!(" {option} {port}");
            }
        }
        let at = ServerAddress { server, host, port: 0, is_own, start, reach };
        Ok(ports.map(|port| ServerAddress { port, ..at.clone() }).into())
    }
}

impl ZeroMqSection {
    /// Keys that a broker, or who connects to one, cannot have are refused, with their line or their variable.
    fn check_keys(&self, config: &ZeroMqConfig) -> Result<(), Problem> {
        let Some(curve) = &config.curve else { return Ok(()) };
        let serves = config.broker == BrokerMode::Embedded;
        curve.check(serves).map_err(|fault| {
            let file = self.curve.as_ref();
            // The file by itself has it.
            let own = file.filter(|it| {
                it.value.or(CurveConfig::default()).check(serves) == Err(fault.clone())
            });
            let entry = || match fault {
                CurveError::Client { index, .. } => file?.value.clients.as_ref()?.get(index),
                _ => None,
            };
            match entry().map(|it| it.referenced).or(own.map(|it| it.referenced)) {
                Some(written) => Problem::at(written, fault.to_string()),
                None => {
                    let message = format!("{}: {fault}", fault.variable());
                    Problem { position: None, message }
                }
            }
        })
    }

    /// Writes the ports into `config`.
    fn say_ports(&self, config: &mut ZeroMqConfig) {
        for (_, port, written) in self.ports(config) {
            *port = written.map_or(*port, |written| written.value);
        }
    }

    /// The ports of `config`, the two of each broker side by side, with their keys and what is written.
    fn ports<'c>(&'c self, config: &'c mut ZeroMqConfig) -> [Port<'c>; 4] {
        [
            ("pub_port", &mut config.pub_port, self.pub_port.as_ref()),
            ("sub_port", &mut config.sub_port, self.sub_port.as_ref()),
            ("rep_port", &mut config.rep_port, self.rep_port.as_ref()),
            ("req_port", &mut config.req_port, self.req_port.as_ref()),
        ]
    }

    /// Writes into `config` who runs the broker, its address, and who may reach it.
    fn say(&self, config: &mut ZeroMqConfig) {
        self.insecure.say(&mut config.insecure, self.ip.is_some());
        if let Some(Spanned { value: written, .. }) = &self.curve {
            let of_environment = config.curve.take().unwrap_or_default();
            config.curve = Some(written.or(of_environment));
        }
        if let Some(ip) = &self.ip {
            config.ip.clone_from(&ip.value);
        }
        match self.broker {
            Some(written) => config.broker = written,
            None => return config.follow_keys(),
        }
        config.service_broker = config.broker;
    }

    /// All settings.
    fn config(&self, needs: &StartNeeds<'_>) -> Result<ZeroMqConfig, StartError> {
        let StartNeeds { hosts, largest_message, purpose } = needs;
        let is_of_routes = matches!(purpose, Purpose::Routes { .. });
        let is_client = *purpose == Purpose::Endpoint(Role::Client);
        let config = match is_client {
            true => ZeroMqConfig::from_env_of_client(),
            false => ZeroMqConfig::from_env(),
        };
        let mut config = config.map_err(StartError::refused)?;
        config.hosts = (*hosts).clone();
        if is_of_routes {
            config = running_broker(config);
        }
        self.say(&mut config);
        if let Some(topic) = &self.monitor_topic {
            config.monitor_topic.clone_from(topic);
        }
        self.say_ports(&mut config);
        config.send_hwm = self.send_hwm.unwrap_or(config.send_hwm);
        if let Some(most) = self.max_connections {
            config.max_connections = usize::from(most.get());
        }
        config.max_frame_bytes = config.max_frame_bytes.max(*largest_message);
        let is_left_open = self.broker.is_none() || *purpose == Purpose::Look;
        if is_left_open && (is_client || *purpose == Purpose::Look) {
            config.service_broker = BrokerMode::Foreign;
        }
        // A broker that a command does not use is not started for it.
        if is_left_open && !is_of_routes && *purpose != Purpose::Endpoint(Role::Publisher) {
            config.broker = BrokerMode::Foreign;
        }
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECRET: &str = "JTKVSB%%)wK0E.X)V>+}o?pNmC{O&4W4b!Ni{Lh6\n";
    const CLIENT: &str = "0q:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7";

    fn refused(yaml: &str, of_environment: CurveConfig) -> (Option<u64>, String) {
        let section: ZeroMqSection = serde_saphyr::from_str(yaml).unwrap();
        let curve = Some(of_environment);
        let mut config = ZeroMqConfig { curve, ..ZeroMqConfig::default() };
        section.say(&mut config);
        let Problem { position, message } = section.check_keys(&config).unwrap_err();
        (position.map(|(line, _)| line), message)
    }

    #[test]
    fn a_fault_of_keys_has_its_line_or_its_variable() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("own");
        std::fs::write(&file, SECRET).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        let own = format!("broker: embedded\ncurve:\n  secret_key_file: {}\n", file.display());
        let listed = |line: &str| {
            let clients =
                format!("  clients:\n    - {{ key: \"{CLIENT}\", publish: [/a] }}\n{line}\n");
            refused(&format!("{own}{clients}"), CurveConfig::default())
        };
        for (line, words) in [
            (format!("    - key: \"{CLIENT}\""), "is listed twice"),
            ("    - key: nowhere.key".to_owned(), "is no CURVE public key"),
        ] {
            let (at, told) = listed(&line);
            assert!(at == Some(6) && told.contains(words), "{at:?} {told}");
        }
        let [secret, server] =
            ["SECRET_KEY_FILE", "SERVER_KEY"].map(|name| format!("WRAPYFI_ZEROMQ_CURVE_{name}: "));
        let nowhere =
            || CurveConfig { secret_key_file: Some("/nowhere".into()), ..Default::default() };
        let short = || CurveConfig { server_key: Some("short".to_owned()), ..Default::default() };
        let both = CurveConfig { secret_key_file: Some(file.clone()), ..short() };
        for (yaml, of_environment, at, words) in [
            ("broker: embedded", nowhere(), None, &*secret),
            ("broker: foreign", both, None, &server),
            ("broker: embedded", short(), None, &server),
            (&own, short(), None, &server),
            ("curve: { server_key: short }", nowhere(), Some(1), "\"short\""),
            (
                "broker: foreign\ncurve:\n\n  server_key: short",
                CurveConfig::default(),
                Some(4),
                "\"short\"",
            ),
        ] {
            let (line, told) = refused(yaml, of_environment);
            assert!(line == at && told.starts_with(words), "{line:?} {told}");
        }
    }
}
