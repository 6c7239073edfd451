//! `endpoints.zeromq` of a configuration, and the middleware that it makes.

use std::net::IpAddr;
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::{Deserialize, Deserializer};
use wrapyfi_endpoint::Conventions;
use wrapyfi_endpoint::network::{Hosts, ReachedByOthers};
use wrapyfi_engine::{Available, Problem, Spanned};
use wrapyfi_zeromq::{
    self as zeromq, BrokerMode, CurveClient, CurveConfig, CurveError, ZeroMqConfig,
};

use super::start::Role;
use super::word::Word;
use crate::exit::{Failure, Result};

/// The middleware as routes and commands address it, with its rules for topics.
pub(super) const AVAILABLE: Available<'static> = Available {
    name: "zeromq",
    check_topic: &zeromq::check_topic,
    options: &[],
    check_option: &|_, _| Ok(()),
    source_options: &[],
    destination_options: &[],
    conventions: Conventions::NONE,
};

/// `endpoints.zeromq`; what is left out comes from the `WRAPYFI_ZEROMQ_*` variables, else from
/// Wrapyfi's defaults.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)] // config/example.yaml is the manual
pub struct ZeroMqSection {
    pub ip: Option<Spanned<String>>,
    pub pub_port: Option<Spanned<u16>>,
    pub sub_port: Option<Spanned<u16>>,
    pub rep_port: Option<Spanned<u16>>,
    pub req_port: Option<Spanned<u16>>,
    pub broker: Option<BrokerMode>,
    pub monitor_topic: Option<String>,
    pub send_hwm: Option<u16>,
    pub max_connections: Option<NonZeroU16>,
    pub insecure: Word,
    // Without keys below it, the word asks for keys all the same: nothing would be encrypted.
    #[serde(deserialize_with = "present")]
    pub curve: Option<Spanned<CurveSection>>,
}

/// `endpoints.zeromq.curve`: a [`CurveConfig`] in which each client has its line.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CurveSection {
    pub secret_key_file: Option<PathBuf>,
    pub server_key: Option<String>,
    pub clients: Option<Vec<Spanned<CurveClient>>>,
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

/// Ports of the ZeroMQ broker of requests and replies.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct ServicePorts {
    /// On ZeroMQ, port that clients connect to; default from WRAPYFI_ZEROMQ_SOCKET_REP_PORT for call,
    /// …_REQ_PORT for serve and broker, else 5558.
    #[arg(long, value_name = "PORT")]
    pub rep_port: Option<u16>,
    /// On ZeroMQ, port that servers connect to; default from WRAPYFI_ZEROMQ_SOCKET_REP_PORT for serve
    /// and broker, else 5559.
    #[arg(long, value_name = "PORT")]
    pub req_port: Option<u16>,
}

impl ServicePorts {
    /// True where one was given.
    pub fn any(&self) -> bool {
        self.rep_port.is_some() || self.req_port.is_some()
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

impl ZeroMqSection {
    /// Finds the files of keys, whose paths are as seen from `folder`.
    pub(super) fn find_keys(&mut self, folder: &Path) {
        let Some(Spanned { value: curve, .. }) = &mut self.curve else { return };
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
    }

    /// A broker of ours that other machines reach is refused before anything starts.
    pub fn check_permitted(&self, hosts: &Hosts) -> Result<(), Problem> {
        let Some(written) = &self.ip else { return Ok(()) };
        let mut config = of_environment()?;
        config.hosts = hosts.clone();
        self.say(&mut config);
        let refused = |refused: ReachedByOthers| refused.to_string();
        let checked = config.check().map_err(refused);
        checked.map_err(|text| Problem::at(written.referenced, text))
    }

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

    /// The same settings, where their keys can be.
    ///
    /// # Errors
    /// Exit code 2 with the variable that is at fault.
    pub fn checked(&self, config: ZeroMqConfig) -> Result<ZeroMqConfig> {
        self.check_keys(&config).map_err(|fault| Failure::Usage(fault.message))?;
        Ok(config)
    }

    /// Refuses what no broker can start with, and nobody can connect to.
    pub(super) fn check(&self) -> Result<(), Problem> {
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
        for (at, (other, same, second)) in ports.iter().enumerate() {
            for (before, (one, port, first)) in ports.iter().enumerate().take(at) {
                // Of the default ports for services nothing is known that they are used.
                let first = first.filter(|_| before / 2 == at / 2);
                if let Some(written) = second.or(first)
                    && port == same
                    && **port != 0
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

    /// All settings, for a command in the `role` that is given, else for routes.
    ///
    /// # Errors
    /// Exit code 2 for variables of the environment that cannot be.
    pub fn config(
        &self,
        role: Option<Role>,
        largest_message: usize,
        hosts: &Hosts,
    ) -> Result<ZeroMqConfig> {
        let config = match role {
            Some(Role::Client) => ZeroMqConfig::from_env_of_client(),
            _ => ZeroMqConfig::from_env(),
        };
        let mut config = config.map_err(Failure::usage)?;
        config.hosts = hosts.clone();
        if role.is_none() {
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
        config.max_frame_bytes = config.max_frame_bytes.max(largest_message);
        let is_left_open = self.broker.is_none() || role == Some(Role::Observer);
        if is_left_open && matches!(role, Some(Role::Observer | Role::Client)) {
            config.service_broker = BrokerMode::Foreign;
        }
        // A broker that a command does not use is not started for it.
        if is_left_open && !matches!(role, None | Some(Role::Publisher)) {
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
