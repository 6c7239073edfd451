//! The file that says where the name server is: `yarp.conf`.
//!
//! ```text
//!   $YARP_NAMESPACE, or yarp_namespace.conf ──▶ "/root" ──▶ yarp.conf
//!                                           └─▶ "/icub01" ─▶ _icub01.conf
//!   yarp.conf: "127.0.0.1 10000 yarp"  or  [name] host, port, mode
//! ```
//!
//! There is no address to fall back to: without a file no name server is known.

use std::fmt;
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::environment::{DEFAULT_PORT, Environment, EnvironmentError, safe_name};

/// The namespace where none is set, and so the port name of most name servers.
pub const DEFAULT_NAMESPACE: &str = "/root";

/// Largest size of a configuration file in bytes.
const MAX_CONF_BYTES: u64 = 64 * 1024;

/// Address of a name server.
///
/// ```
/// use wrapyfi_yarp::name::NameServerConf;
/// let here = NameServerConf::from(std::net::SocketAddr::from(([127, 0, 0, 1], 10000)));
/// assert_eq!((here.host.as_str(), here.port), ("127.0.0.1", 10000));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameServerConf {
    /// Address or name of its machine.
    pub host: String,
    /// TCP port of the name server, and the first of the range it gives to ports.
    pub port: u16,
}

/// A name server as this machine's configuration names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Located {
    /// Address of the name server.
    pub server: NameServerConf,
    /// Port name of the name server.
    pub namespace: String,
}

/// Error of the configuration that should name the name server.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfError {
    /// No variable says where configuration files are.
    #[error(
        "no folder for yarp.conf: set YARP_CONFIG_HOME, XDG_CONFIG_HOME or HOME, or give the \
         address of the name server"
    )]
    NoFolder,
    /// The file does not exist.
    #[error(
        "{} does not exist: start a name server with --write, or give its address", .0.display()
    )]
    Missing(PathBuf),
    /// The file cannot be read or written, or holds no address; the reason tells the form that would be right.
    #[error("{}: {reason}", file.display())]
    Faulty {
        /// File.
        file: PathBuf,
        /// Fault of the file, in words.
        reason: String,
    },
    /// A variable means nothing.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
}

impl ConfError {
    /// True when no setting says where a name server is, rather than a wrong one.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Missing(_) | Self::NoFolder)
    }

    fn faulty(file: &Path, reason: String) -> Self {
        Self::Faulty { file: file.to_owned(), reason }
    }
}

impl From<SocketAddr> for NameServerConf {
    fn from(address: SocketAddr) -> Self {
        Self { host: address.ip().to_string(), port: address.port() }
    }
}

/// The text of its configuration file.
impl fmt::Display for NameServerConf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} {} yarp", self.host, self.port)
    }
}

/// `HOST:PORT`.
impl FromStr for NameServerConf {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("{text:?} is no address: write it as 127.0.0.1:10000 or robot:10000");
        if let Ok(address) = text.parse::<SocketAddr>() {
            return if address.port() == 0 { Err(wrong()) } else { Ok(address.into()) };
        }
        let (host, port) = text.rsplit_once(':').ok_or_else(wrong)?;
        let letter = |letter: char| letter.is_ascii_alphanumeric() || "-._".contains(letter);
        match port.parse() {
            Ok(port @ 1..) if !host.is_empty() && host.chars().all(letter) => {
                Ok(Self { host: host.to_owned(), port })
            }
            _ => Err(wrong()),
        }
    }
}

impl NameServerConf {
    /// Reads what a configuration file says: `HOST PORT [MODE]`, or the group `[name]` of an ini
    /// file with `host`, `port` and `mode`.
    ///
    /// # Errors
    /// The fault of the text, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text.trim_start().starts_with('[') {
            return Self::parse_ini(text);
        }
        let mut words = text.split(['"', ' ', '\t', '\r', '\n']).filter(|word| !word.is_empty());
        let (Some(host), Some(port)) = (words.next(), words.next()) else {
            return Err(
                "names no host and port: write for instance 127.0.0.1 10000 yarp".to_owned()
            );
        };
        Self::checked(host, port, words.next())
    }

    fn parse_ini(text: &str) -> Result<Self, String> {
        let (mut group, mut host, mut port, mut mode) = ("", None, None, None);
        for line in text.lines().map(str::trim) {
            if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
                group = name.trim();
                continue;
            }
            if group != "name" || line.starts_with('#') || line.starts_with("//") {
                continue;
            }
            let mut words = line.splitn(2, [' ', '\t', '=']);
            let key = words.next().unwrap_or_default();
            let value = words.next().unwrap_or_default().trim_matches([' ', '\t', '=', '"']);
            match key {
                "host" => host = Some(value),
                "port" => port = Some(value),
                "mode" => mode = Some(value),
                _ => {}
            }
        }
        match (host, port) {
            (Some(host), Some(port)) if !host.is_empty() => Self::checked(host, port, mode),
            _ => Err("has no group [name] with host and port".to_owned()),
        }
    }

    fn checked(host: &str, port: &str, mode: Option<&str>) -> Result<Self, String> {
        if host.contains(|c: char| c.is_whitespace() || c.is_control() || "\"[]".contains(c)) {
            return Err(format!(
                "{host:?} is no host: write one name or address, without brackets"
            ));
        }
        let number = match port.parse() {
            Ok(number) if number != 0 => number,
            _ => return Err(format!("{port:?} is not a port: write a number from 1 to 65535")),
        };
        match mode {
            None | Some("yarp" | "//") => Ok(Self { host: host.to_owned(), port: number }),
            Some(other) => Err(format!(
                "mode {other:?} is a name server of another kind: only yarp is known here"
            )),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When it is missing, unreadable, or no configuration; the error names it.
    pub fn read(file: &Path) -> Result<Self, ConfError> {
        let text = read_text(file)?.ok_or_else(|| ConfError::Missing(file.to_owned()))?;
        Self::parse(&text).map_err(|reason| ConfError::faulty(file, reason))
    }

    /// Writes the file that [`Self::read`] and YARP's own programs read, and its folder.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write(&self, file: &Path) -> Result<(), ConfError> {
        let refused = |error| ConfError::faulty(file, format!("cannot be written: {error}"));
        if let Some(folder) = file.parent() {
            std::fs::create_dir_all(folder).map_err(refused)?;
        }
        std::fs::write(file, self.to_string()).map_err(refused)
    }
}

/// The namespace: `$YARP_NAMESPACE`, else the first word of `yarp_namespace.conf`, else
/// [`DEFAULT_NAMESPACE`].
///
/// # Errors
/// When that file is there and cannot be read.
pub fn namespace(environment: &Environment) -> Result<String, ConfError> {
    let first = |text: &str| {
        text.split_ascii_whitespace().next().map(|word| word.trim_matches('"').to_owned())
    };
    if let Some(name) = environment.text("YARP_NAMESPACE").and_then(first) {
        return Ok(name);
    }
    let Some(folder) = environment.config_home() else { return Ok(DEFAULT_NAMESPACE.to_owned()) };
    let text = read_text(&folder.join("yarp_namespace.conf"))?;
    Ok(text.as_deref().and_then(first).unwrap_or_else(|| DEFAULT_NAMESPACE.to_owned()))
}

/// The file that says where the name server of `namespace` is.
///
/// # Errors
/// When no variable names a folder.
pub fn file_of(environment: &Environment, namespace: &str) -> Result<PathBuf, ConfError> {
    let folder = environment.config_home().ok_or(ConfError::NoFolder)?;
    Ok(folder.join(if namespace == DEFAULT_NAMESPACE {
        "yarp.conf".to_owned()
    } else {
        safe_name(namespace) + ".conf"
    }))
}

/// Finds the name server as a YARP program does.
///
/// # Errors
/// When the configuration does not say where it is; the error names the file.
pub fn locate(environment: &Environment) -> Result<Located, ConfError> {
    let namespace = namespace(environment)?;
    let file = file_of(environment, &namespace)?;
    Ok(Located { server: NameServerConf::read(&file)?, namespace })
}

/// The text of a file; none where there is no such file.
fn read_text(file: &Path) -> Result<Option<String>, ConfError> {
    let unreadable = |error| ConfError::faulty(file, format!("cannot be read: {error}"));
    match std::fs::metadata(file) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(unreadable(error)),
        Ok(meta) if meta.len() > MAX_CONF_BYTES => {
            let (bytes, most) = (meta.len(), MAX_CONF_BYTES);
            let reason = format!("has {bytes} bytes, more than the {most} a configuration has");
            return Err(ConfError::faulty(file, reason));
        }
        Ok(_) => {}
    }
    let bytes = std::fs::read(file).map_err(unreadable)?;
    let text = String::from_utf8(bytes).map(Some);
    text.map_err(|_other| ConfError::faulty(file, "is not UTF-8 text".to_owned()))
}

impl Default for NameServerConf {
    /// Address that `yarpserver --write` writes on a machine of its own.
    fn default() -> Self {
        Self { host: "127.0.0.1".to_owned(), port: DEFAULT_PORT }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conf(host: &str, port: u16) -> NameServerConf {
        NameServerConf { host: host.to_owned(), port }
    }

    #[test]
    fn both_forms_are_read() {
        assert_eq!(NameServerConf::parse("127.0.0.1 10000 yarp\n"), Ok(conf("127.0.0.1", 10_000)));
        assert_eq!(NameServerConf::parse("icub\t10010\n"), Ok(conf("icub", 10_010)));
        assert_eq!(NameServerConf::parse("10.0.0.1\r\n10000\r\n"), Ok(conf("10.0.0.1", 10_000)));
        let ini =
            "[other]\nhost wrong\n[name]\n// where it is\nhost 10.0.0.2\nport 10020\nmode yarp\n";
        assert_eq!(NameServerConf::parse(ini), Ok(conf("10.0.0.2", 10_020)));
    }

    #[test]
    fn what_is_no_configuration_is_explained() {
        for (text, says) in [
            ("", "names no host"),
            ("onlyhost", "names no host"),
            ("host 70000", "\"70000\" is not a port"),
            ("host 0", "\"0\" is not a port"),
            ("host 11311 ros", "mode \"ros\""),
            ("[group]\nhost a\nport 1\n", "no group [name]"),
            ("[name]\nhost a\nport x\n", "\"x\" is not a port"),
        ] {
            let error = NameServerConf::parse(text).unwrap_err();
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }

    #[test]
    fn files_are_found_by_namespace_and_errors_name_them() {
        let folder = tempfile::tempdir().unwrap();
        let environment = Environment::default().with("YARP_CONFIG_HOME", folder.path());
        let missing = locate(&environment).unwrap_err().to_string();
        assert!(missing.contains("yarp.conf does not exist"), "{missing}");

        let file = file_of(&environment, "/root").unwrap();
        conf("127.0.0.1", 10_000).write(&file).unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "127.0.0.1 10000 yarp\n");
        let located = locate(&environment).unwrap();
        assert_eq!((located.namespace.as_str(), located.server.port), ("/root", 10_000));

        std::fs::write(folder.path().join("yarp_namespace.conf"), "/icub01 /other\n").unwrap();
        let missing = locate(&environment).unwrap_err().to_string();
        assert!(missing.contains("_icub01.conf does not exist"), "{missing}");
        let renamed = environment.clone().with("YARP_NAMESPACE", "/root");
        assert_eq!(locate(&renamed).unwrap().namespace, "/root");

        std::fs::write(folder.path().join("_icub01.conf"), b"\xff\xfe").unwrap();
        let text = locate(&environment).unwrap_err().to_string();
        assert!(text.contains("_icub01.conf: is not UTF-8"), "{text}");
        std::fs::remove_file(folder.path().join("_icub01.conf")).unwrap();
        std::fs::create_dir(folder.path().join("_icub01.conf")).unwrap();
        let unreadable = locate(&environment).unwrap_err();
        assert!(unreadable.to_string().contains("_icub01.conf: cannot be read: "), "{unreadable}");
    }

    #[test]
    fn without_a_home_there_is_no_folder() {
        assert!(matches!(locate(&Environment::default()), Err(ConfError::NoFolder)));
    }
}
