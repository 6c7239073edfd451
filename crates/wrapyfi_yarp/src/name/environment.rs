//! Environment variables of YARP programs, read once.
//!
//! ```text
//!   YARP_CONFIG_HOME, XDG_CONFIG_HOME, HOME ──▶ folder of yarp.conf
//!   YARP_RUNTIME_DIR, XDG_RUNTIME_DIR, USER ──▶ folder of unix sockets
//!   YARP_NAMESPACE                          ──▶ name of the name server
//!   YARP_PORT_PREFIX, YARP_RENAME…          ──▶ names of our ports
//!   YARP_IP, YARP_PORTNUMBER…               ──▶ where they listen
//! ```
//!
//! A snapshot, because a variable that changes between two ports would make one program speak with
//! two networks, and because tests must not change the process.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::path::PathBuf;

/// The port of a name server where nothing else is said, and the first of its range.
pub const DEFAULT_PORT: u16 = 10_000;

/// The variables YARP reads, as they were at one moment.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Environment {
    variables: BTreeMap<String, OsString>,
}

/// Error of a variable of the environment.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("environment variable {name}={value:?} {reason}")]
pub struct EnvironmentError {
    /// Variable.
    pub name: String,
    /// Value of the variable.
    pub value: String,
    /// Fault of the value, and the form that would be right.
    pub reason: &'static str,
}

/// Name of a port after the environment has changed the one that its program gave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PortNaming {
    /// Name to register.
    pub name: String,
    /// Port number to listen on instead of one that the name server chooses.
    pub port: Option<u16>,
}

impl Environment {
    /// The environment of this process.
    pub fn from_process() -> Self {
        let others = ["XDG_CONFIG_HOME", "XDG_RUNTIME_DIR", "HOME", "USER"];
        let ours = |name: &str| name.starts_with("YARP_") || others.contains(&name);
        let variables = std::env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value)))
            .filter(|(name, _)| ours(name))
            .collect();
        Self { variables }
    }

    /// The same with one variable changed; an empty value takes it away.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<OsString>) -> Self {
        let value = value.into();
        if value.is_empty() {
            self.variables.remove(name);
        } else {
            self.variables.insert(name.to_owned(), value);
        }
        self
    }

    /// A variable that is set to something that is text.
    pub(crate) fn text(&self, name: &str) -> Option<&str> {
        self.variables.get(name)?.to_str().filter(|value| !value.is_empty())
    }

    /// True when a variable is a switch that is on: `1` or `true`.
    pub fn is_on(&self, name: &str) -> bool {
        self.text(name).is_some_and(|value| matches!(value.trim(), "1" | "true"))
    }

    /// The folder of YARP's configuration files: `$YARP_CONFIG_HOME`, else `yarp` in
    /// `$XDG_CONFIG_HOME`, else `.config/yarp` in `$HOME`. None without any of them.
    pub fn config_home(&self) -> Option<PathBuf> {
        let config = || {
            let parent = self.folder("XDG_CONFIG_HOME");
            parent.or_else(|| Some(self.folder("HOME")?.join(".config")))
        };
        self.folder("YARP_CONFIG_HOME").or_else(|| Some(config()?.join("yarp")))
    }

    fn folder(&self, name: &str) -> Option<PathBuf> {
        self.variables.get(name).filter(|value| !value.is_empty()).map(PathBuf::from)
    }

    /// The folder where ports of this machine meet on unix sockets: `$YARP_RUNTIME_DIR`, else `yarp` in
    /// `$XDG_RUNTIME_DIR`, else `/tmp/runtime-$USER/yarp`. None without any of them.
    pub fn runtime_folder(&self) -> Option<PathBuf> {
        let parent = || {
            let own = || Some(format!("/tmp/runtime-{}", self.text("USER")?).into());
            self.folder("XDG_RUNTIME_DIR").or_else(own)
        };
        self.folder("YARP_RUNTIME_DIR").or_else(|| Some(parent()?.join("yarp")))
    }

    /// The first port of the range of a name server: `$YARP_PORT_RANGE`, else [`DEFAULT_PORT`].
    ///
    /// # Errors
    /// When the variable is no port.
    pub fn base_port(&self) -> Result<u16, EnvironmentError> {
        Ok(self.port("YARP_PORT_RANGE")?.unwrap_or(DEFAULT_PORT))
    }

    /// The address at which ports of this machine are reached, where `$YARP_IP` says so: it is one, or
    /// the beginning of one that this machine has. `server` is where the name server is, if that is
    /// known.
    ///
    /// # Errors
    /// When no address of this machine that leads anywhere begins so.
    pub fn own_ip(&self, server: Option<IpAddr>) -> Result<Option<IpAddr>, EnvironmentError> {
        let Some(prefix) = self.text("YARP_IP") else { return Ok(None) };
        let found = own_address(prefix, server).ok_or_else(|| EnvironmentError {
            name: "YARP_IP".to_owned(),
            value: prefix.to_owned(),
            reason: "begins none of this machine's addresses: write the whole address, or unset it",
        });
        found.map(Some)
    }

    /// The name and the number under which a port called `name` is opened here: `$YARP_RENAME…`
    /// changes the name, `$YARP_PORT_PREFIX` goes before it, `$YARP_PORTNUMBER…` (by the name as
    /// given) sets the number. Names that the name server completes (`...`, `=tail`) keep theirs.
    ///
    /// # Errors
    /// When the number is no port.
    pub fn port_naming(&self, name: &str) -> Result<PortNaming, EnvironmentError> {
        let safe = safe_name(name);
        let port = self.port(&format!("YARP_PORTNUMBER{safe}"))?;
        let mut name = self.text(&format!("YARP_RENAME{safe}")).unwrap_or(name).to_owned();
        let completed = name.is_empty() || name.starts_with("...") || name.starts_with('=');
        if !completed && let Some(prefix) = self.text("YARP_PORT_PREFIX") {
            name.insert_str(0, prefix);
        }
        Ok(PortNaming { name, port })
    }

    fn port(&self, name: &str) -> Result<Option<u16>, EnvironmentError> {
        let Some(value) = self.text(name) else { return Ok(None) };
        match value.trim().parse() {
            Ok(port) if port != 0 => Ok(Some(port)),
            _ => Err(EnvironmentError {
                name: name.to_owned(),
                value: value.to_owned(),
                reason: "is not a port: write a number from 1 to 65535, or unset it",
            }),
        }
    }
}

/// `name` with an underscore for whatever is no ASCII letter or digit, as YARP writes names into
/// variables and file names.
pub fn safe_name(name: &str) -> String {
    // Bytes, not characters: YARP knows no other.
    name.bytes()
        .map(|byte| if byte.is_ascii_alphanumeric() { char::from(byte) } else { '_' })
        .collect()
}

/// An address of this machine that begins with `prefix`: the prefix itself where it is a whole one.
fn own_address(prefix: &str, server: Option<IpAddr>) -> Option<IpAddr> {
    if let Ok(whole) = prefix.parse() {
        return Some(whole);
    }
    // Nothing is sent: the system only says from which address it would be.
    let leads = |to: IpAddr| {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
        socket.connect((to, 9)).ok()?;
        Some(socket.local_addr().ok()?.ip())
    };
    // Towards addresses that would lie in the network meant, the name server, everything else.
    let inside = ["1", "0"].map(|filling| {
        let mut parts: Vec<&str> = prefix.trim_end_matches('.').split('.').collect();
        parts.resize(3, filling);
        parts.push("1");
        parts.join(".").parse().ok()
    });
    let outside = Some(IpAddr::V4(super::DISCOVERY_GROUP));
    let mut found = inside.into_iter().chain([server, outside]).flatten().filter_map(leads);
    found.find(|address| address.to_string().starts_with(prefix))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of<const N: usize>(pairs: [(&str, &str); N]) -> Environment {
        pairs.into_iter().fold(Environment::default(), |all, (name, value)| all.with(name, value))
    }

    #[test]
    fn the_folder_is_found_in_yarps_order() {
        let all =
            of([("YARP_CONFIG_HOME", "/own"), ("XDG_CONFIG_HOME", "/xdg"), ("HOME", "/home/me")]);
        assert_eq!(all.config_home(), Some("/own".into()));
        if cfg!(target_os = "linux") {
            let xdg = all.with("YARP_CONFIG_HOME", "");
            assert_eq!(xdg.config_home(), Some("/xdg/yarp".into()));
            let home = xdg.with("XDG_CONFIG_HOME", "");
            assert_eq!(home.config_home(), Some("/home/me/.config/yarp".into()));
            assert_eq!(home.with("HOME", "").config_home(), None);
        }
    }

    #[test]
    fn the_folder_of_sockets_is_that_of_yarp() {
        let all =
            of([("YARP_RUNTIME_DIR", "/own"), ("XDG_RUNTIME_DIR", "/run/user/7"), ("USER", "me")]);
        assert_eq!(all.runtime_folder(), Some("/own".into()));
        let xdg = all.with("YARP_RUNTIME_DIR", "");
        assert_eq!(xdg.runtime_folder(), Some("/run/user/7/yarp".into()));
        let user = xdg.with("XDG_RUNTIME_DIR", "");
        assert_eq!(user.runtime_folder(), Some("/tmp/runtime-me/yarp".into()));
        assert_eq!(user.with("USER", "").runtime_folder(), None);
    }

    #[test]
    fn ports_are_renamed_prefixed_and_numbered() {
        let environment = of([
            ("YARP_PORT_PREFIX", "/left"),
            ("YARP_RENAME_cam_rgb", "/picture"),
            ("YARP_PORTNUMBER_cam_rgb", "10444"),
        ]);
        let naming = |name| environment.port_naming(name).unwrap();
        assert_eq!(
            naming("/cam:rgb"),
            PortNaming { name: "/left/picture".into(), port: Some(10_444) }
        );
        assert_eq!(naming("/other"), PortNaming { name: "/left/other".into(), port: None });
        assert_eq!(naming("..."), PortNaming { name: "...".into(), port: None });
        assert_eq!(naming("=tail"), PortNaming { name: "=tail".into(), port: None });
    }

    #[test]
    fn an_address_may_be_given_by_its_beginning() {
        let ip = |text: &str| of([("YARP_IP", text)]).own_ip(None);
        assert_eq!(Environment::default().own_ip(None), Ok(None));
        assert_eq!(ip("127."), Ok(Some(Ipv4Addr::LOCALHOST.into())));
        assert_eq!(ip("192.0.2.7"), Ok(Some([192, 0, 2, 7].into())));
        let error = ip("9.9.9.").unwrap_err().to_string();
        assert!(error.contains("YARP_IP=\"9.9.9.\""), "{error}");
    }

    #[test]
    fn numbers_that_are_no_ports_are_named() {
        let environment = of([("YARP_PORT_RANGE", "70000")]);
        let error = environment.base_port().unwrap_err().to_string();
        assert!(error.contains("YARP_PORT_RANGE=\"70000\""), "{error}");
        assert_eq!(Environment::default().base_port(), Ok(10_000));
    }
}
