//! Environment variables of discovery, read as every ROS 2 node reads them.
//!
//! ```text
//!   ROS_DOMAIN_ID ───────────────────┐
//!   ROS_LOCALHOST_ONLY ──────────────┤            domain id, DiscoverySettings,
//!   ROS_AUTOMATIC_DISCOVERY_RANGE ───┼─ read() ─▶ Cyclone sources,
//!   ROS_STATIC_PEERS ────────────────┤            why this DDS stack,
//!   RMW_IMPLEMENTATION, ROS_DISTRO ──┤            mapping of services, adapter, warnings to be logged
//!   WRAPYFI_ROS2_GRAPH ──────────────┤            whether keys of SROS 2 are asked for
//!   ROS_SECURITY_ENABLE, _STRATEGY ──┤
//!   CYCLONEDDS_URI ──────────────────┘
//! ```
//!
//! [`read`] is pure: it is given a lookup and logs nothing; [`Environment::log`] does.

use serde::Deserialize;
use wrapyfi_interfaces::named;

use super::graph::ServiceMapping;

/// Highest domain id: above it the port numbers of DDS leave their range.
pub const MAX_DOMAIN_ID: u32 = 232;

named! {
    /// Range in which a node looks for others, `ROS_AUTOMATIC_DISCOVERY_RANGE`.
    ///
    /// See [`Environment`].
    ///
    /// ```
    /// # mod wrapyfi_core {
    /// #     pub mod middleware { pub mod ros2 { pub use wrapyfi_ros2::environment::DiscoveryRange; } }
    /// # }
    /// use wrapyfi_core::middleware::ros2::DiscoveryRange;
    /// assert_eq!(DiscoveryRange::from_word("LOCALHOST"), Some(DiscoveryRange::Localhost));
    /// ```
    #[derive(Default)]
    #[non_exhaustive]
    pub enum DiscoveryRange {
        /// Every host that multicast reaches.
        #[default]
        Subnet => "SUBNET",
        /// Range of this host only, without multicast.
        Localhost => "LOCALHOST",
        /// Range of the process itself.
        Off => "OFF",
        /// Whatever the DDS stack does when nothing is said.
        SystemDefault => "SYSTEM_DEFAULT",
    }
    /// Word in the variable.
    pub fn word, from_word;
}

/// Settings by which other participants are found.
///
/// See [`Environment`].
///
/// ```
/// use wrapyfi_ros2::environment::{DiscoveryRange, DiscoverySettings};
/// let lab = DiscoverySettings { range: DiscoveryRange::Off, static_peers: vec!["robot.local".into()] };
/// assert_ne!(lab, DiscoverySettings::default());
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct DiscoverySettings {
    /// Range in which participants are looked for.
    pub range: DiscoveryRange,
    /// Addresses asked one by one, `ROS_STATIC_PEERS`.
    pub static_peers: Vec<String>,
}

named! {
    /// Library that carries the graph of a node.
    ///
    /// ```
    /// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_ros2 as ros2; } }
    /// use wrapyfi_core::middleware::ros2::Adapter;
    /// # use wrapyfi_ros2::environment;
    /// # let of_rmw = |name: &str| (name == "WRAPYFI_ROS2_GRAPH").then(|| "rmw".to_owned());
    /// # assert_eq!(environment::read(of_rmw)?.graph, Some(Adapter::Rmw));
    /// assert_eq!(Adapter::from_word("rmw"), Some(Adapter::Rmw));
    /// # Ok::<(), environment::EnvironmentError>(())
    /// ```
    #[derive(Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Adapter {
        /// CycloneDDS inside the program.
        Cyclone => "cyclone",
        /// The middleware of the installed ROS 2.
        Rmw => "rmw",
    }
    /// Word in `WRAPYFI_ROS2_GRAPH`.
    pub fn word, from_word;
}

/// Use of keys of SROS 2 that the environment asks for, `ROS_SECURITY_ENABLE` and `ROS_SECURITY_STRATEGY`.
///
/// ```
/// use wrapyfi_ros2::environment::{self, Security};
/// let enabled = |name: &str| (name == "ROS_SECURITY_ENABLE").then(|| "true".to_owned());
/// assert_eq!(environment::read(enabled)?.security, Security::Permissive);
/// assert_eq!(environment::read(|_| None)?.security, Security::Off);
/// # Ok::<(), environment::EnvironmentError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Security {
    /// Nodes without keys: everybody may join.
    #[default]
    Off,
    /// Keys where there are some; a node without keys starts all the same.
    Permissive,
    /// Keys always: no node starts without.
    Enforce,
}

/// Feature and environment that a build needs for a middleware other than CycloneDDS, in words for
/// an error.
macro_rules! build {
    () => {
        "build wrapyfi_bridge where a ROS 2 that has it is sourced: `colcon build --packages-up-to wrapyfi_bridge`, which turns the feature rmw on (-DWRAPYFI_RMW=ON)"
    };
}
pub(super) use build;

/// Settings that were read from the environment.
///
/// ```
/// use wrapyfi_ros2::environment::{self, DiscoveryRange};
/// let environment = environment::read(|name| match name {
///     "ROS_DOMAIN_ID" => Some("7".to_owned()),
///     "ROS_AUTOMATIC_DISCOVERY_RANGE" => Some("LOCALHOST".to_owned()),
///     _ => None,
/// })?;
/// assert_eq!(environment.domain_id, 7);
/// assert_eq!(environment.discovery.range, DiscoveryRange::Localhost);
/// # Ok::<(), environment::EnvironmentError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Environment {
    /// DDS domain.
    pub domain_id: u32,
    /// Settings by which other participants are found.
    pub discovery: DiscoverySettings,
    /// `CYCLONEDDS_URI`, where set: sources that override our configuration.
    pub cyclonedds_uri: Option<String>,
    /// The only form in which services are mapped to DDS, where `RMW_IMPLEMENTATION` or a sourced ROS 2 names a vendor: topics of all
    /// vendors understand each other, services do not. `None`: both forms.
    pub services: Option<ServiceMapping>,
    /// True where a program that has the rmw of an installed ROS 2 is to speak through it: another vendor than
    /// CycloneDDS is named, or a ROS 2 is sourced and none is.
    pub means_rmw: bool,
    /// Reason for the choice of the DDS stack, for the log at start.
    pub stack_reason: String,
    /// Library that carries the graph, `WRAPYFI_ROS2_GRAPH`; `None` where it is not set.
    pub graph: Option<Adapter>,
    /// Use of keys that is asked for.
    pub security: Security,
    /// Lines to be logged as warnings.
    pub warnings: Vec<String>,
}

impl Environment {
    /// Writes the warnings to the log.
    pub fn log(&self) {
        for warning in &self.warnings {
            tracing::warn!("{warning}");
        }
    }
}

/// A value with which no ROS 2 node starts.
///
/// ```
/// use wrapyfi_ros2::environment;
/// let error = environment::read(|name| (name == "ROS_DOMAIN_ID").then(|| "300".to_owned()));
/// let error = error.unwrap_err().to_string();
/// assert_eq!(error, "ROS_DOMAIN_ID=300 is out of range: domains are 0 to 232");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// The domain is not a number.
    #[error("ROS_DOMAIN_ID is not an integral number: {0:?}")]
    DomainNotIntegral(String),
    /// Ports for this domain do not exist.
    #[error("ROS_DOMAIN_ID={0} is out of range: domains are 0 to {MAX_DOMAIN_ID}")]
    DomainOutOfRange(String),
    /// Zenoh is another network than DDS.
    #[error(
        "RMW_IMPLEMENTATION=rmw_zenoh_cpp is no DDS, and this program was built without it: {build}; else set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp for all nodes",
        build = build!()
    )]
    Zenoh,
    /// A middleware of an unknown name.
    #[error(
        "RMW_IMPLEMENTATION={0} is not known here: set rmw_cyclonedds_cpp or rmw_fastrtps_cpp, unset it, or {build}",
        build = build!()
    )]
    UnknownRmw(String),
    /// Neither of the two adapters.
    #[error("WRAPYFI_ROS2_GRAPH={0} is neither cyclone nor rmw")]
    UnknownGraph(String),
    /// A word for keys that ROS 2 takes for none.
    #[error(
        "{variable}={value:?} is no word that ROS 2 knows, and its nodes would start unprotected: write {variable}={word}, or {other}"
    )]
    SecurityWord {
        /// Name of the variable.
        variable: &'static str,
        /// Value that it has.
        value: String,
        /// Value that is meant.
        word: &'static str,
        /// Value that turns it off.
        other: &'static str,
    },
}

/// Reads the variables through `lookup`, for instance `|name| std::env::var(name).ok()`.
///
/// # Errors
/// Values with which no node can start; each says what to change.
pub fn read(lookup: impl Fn(&str) -> Option<String>) -> Result<Environment, EnvironmentError> {
    let set = |name: &str| lookup(name).filter(|value| !value.is_empty());
    let mut warnings = Vec::new();
    let rmw = set("RMW_IMPLEMENTATION");
    let distro = set("ROS_DISTRO");
    let services = services(rmw.as_deref(), distro.is_some())?;
    let graph = set("WRAPYFI_ROS2_GRAPH")
        .map(|word| Adapter::from_word(&word).ok_or(EnvironmentError::UnknownGraph(word)));
    Ok(Environment {
        domain_id: domain_id(set("ROS_DOMAIN_ID"))?,
        discovery: discovery(&set, &mut warnings),
        cyclonedds_uri: set("CYCLONEDDS_URI"),
        services,
        means_rmw: rmw.as_ref().map_or(distro.is_some(), |rmw| rmw != "rmw_cyclonedds_cpp"),
        stack_reason: stack_reason(rmw.as_deref(), distro.as_deref()),
        graph: graph.transpose()?,
        security: security(&set, &mut warnings)?,
        warnings,
    })
}

/// True where nodes find each other through a Zenoh router on this machine: `RMW_IMPLEMENTATION` is rmw_zenoh_cpp with
/// the settings that it comes with.
///
/// ```
/// use wrapyfi_ros2::environment::needs_zenoh_router;
/// assert!(needs_zenoh_router(|name| (name == "RMW_IMPLEMENTATION").then(|| "rmw_zenoh_cpp".to_owned())));
/// ```
pub fn needs_zenoh_router(lookup: impl Fn(&str) -> Option<String>) -> bool {
    let set = |name: &str| lookup(name).filter(|value| !value.is_empty());
    let is_cyclone = set("WRAPYFI_ROS2_GRAPH").is_some_and(|word| word == Adapter::Cyclone.word());
    let is_elsewhere = ["ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE"];
    set("RMW_IMPLEMENTATION").is_some_and(|rmw| rmw == "rmw_zenoh_cpp")
        && !is_cyclone
        && is_elsewhere.iter().all(|name| set(name).is_none())
        // A negative number: a user who sets that runs no router.
        && !set("ZENOH_ROUTER_CHECK_ATTEMPTS").is_some_and(|count| count.trim().starts_with('-'))
}

/// Keys that are asked for. rcl knows the words `true` and `Enforce` alone, and takes every other for off and
/// permissive: there a node of `TRUE` with `Enforce` starts unprotected. Such a word is refused here.
fn security(
    set: &impl Fn(&str) -> Option<String>,
    warnings: &mut Vec<String>,
) -> Result<Security, EnvironmentError> {
    let refused = |variable, value, word, other| {
        Err(EnvironmentError::SecurityWord { variable, value, word, other })
    };
    let strategy = set("ROS_SECURITY_STRATEGY").unwrap_or_default();
    let is_enforced = strategy.trim().eq_ignore_ascii_case("Enforce");
    match set("ROS_SECURITY_ENABLE") {
        Some(on) if on == "true" => match &*strategy {
            "Enforce" => Ok(Security::Enforce),
            "" => Ok(Security::Permissive),
            other if other.eq_ignore_ascii_case("Permissive") => Ok(Security::Permissive),
            _ => refused("ROS_SECURITY_STRATEGY", strategy, "Enforce", "Permissive"),
        },
        None => Ok(Security::Off),
        Some(off) if OFF.iter().any(|word| off.eq_ignore_ascii_case(word)) => Ok(Security::Off),
        Some(unknown) if is_enforced => refused("ROS_SECURITY_ENABLE", unknown, "true", "false"),
        Some(unknown) => {
            warnings.push(format!(
                "ROS_SECURITY_ENABLE={unknown:?} has no effect, as in every ROS 2 node: the word is true"
            ));
            Ok(Security::Off)
        }
    }
}

/// Words by which `ROS_SECURITY_ENABLE` is meant to be off.
const OFF: [&str; 4] = ["false", "0", "no", "off"];

fn domain_id(value: Option<String>) -> Result<u32, EnvironmentError> {
    let Some(text) = value else { return Ok(0) };
    let number = text.trim_start();
    // rcl reads the number in C's notation: 0x10 and 010 are numbers too.
    let unsigned = number.strip_prefix('+').unwrap_or(number);
    let parsed = if let Some(hex) = unsigned.strip_prefix("0x").or(unsigned.strip_prefix("0X")) {
        i128::from_str_radix(hex, 16)
    } else if unsigned.len() > 1 && unsigned.starts_with('0') {
        i128::from_str_radix(unsigned, 8)
    } else {
        unsigned.parse()
    };
    match parsed {
        Ok(-1) => Ok(0),
        Ok(id) => u32::try_from(id)
            .ok()
            .filter(|&id| id <= MAX_DOMAIN_ID)
            .ok_or(EnvironmentError::DomainOutOfRange(text)),
        Err(error) => Err(match error.kind() {
            std::num::IntErrorKind::PosOverflow | std::num::IntErrorKind::NegOverflow => {
                EnvironmentError::DomainOutOfRange(text)
            }
            _ => EnvironmentError::DomainNotIntegral(text),
        }),
    }
}

fn discovery(
    set: &impl Fn(&str) -> Option<String>,
    warnings: &mut Vec<String>,
) -> DiscoverySettings {
    if let Some(value) = set("ROS_LOCALHOST_ONLY") {
        warnings.push(
            "ROS_LOCALHOST_ONLY is deprecated but still honored if it is enabled. Use \
             ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_STATIC_PEERS instead."
                .into(),
        );
        let enabled = value == "1";
        warnings.push(format!(
            "'localhost_only' is {}, 'automatic_discovery_range' and 'static_peers' will be {}.",
            if enabled { "enabled" } else { "disabled" },
            if enabled { "ignored" } else { "used" },
        ));
        if enabled {
            return DiscoverySettings {
                range: DiscoveryRange::Localhost,
                static_peers: Vec::new(),
            };
        }
    }
    let range = set("ROS_AUTOMATIC_DISCOVERY_RANGE").map_or(DiscoveryRange::default(), |word| {
        DiscoveryRange::from_word(&word).unwrap_or_else(|| {
            warnings.push(format!(
                "Invalid value '{word}' specified for 'ROS_AUTOMATIC_DISCOVERY_RANGE', \
                 assuming localhost only"
            ));
            DiscoveryRange::Localhost
        })
    });
    let peers = set("ROS_STATIC_PEERS").unwrap_or_default();
    let mut static_peers: Vec<String> =
        peers.split(';').map(str::trim).filter(|peer| !peer.is_empty()).map(Into::into).collect();
    match range {
        DiscoveryRange::Off => static_peers.clear(),
        DiscoveryRange::SystemDefault if !static_peers.is_empty() => {
            warnings.push(format!(
                "{} static peers were specified, but discovery is set to use the RMW \
                 implementation default, so these static peers will be ignored.",
                static_peers.len()
            ));
            static_peers.clear();
        }
        _ => {}
    }
    DiscoverySettings { range, static_peers }
}

fn stack_reason(rmw: Option<&str>, distro: Option<&str>) -> String {
    match (rmw, distro) {
        (None, None) => "RMW_IMPLEMENTATION and ROS_DISTRO are not set".to_owned(),
        (None, Some(distro)) => {
            format!("RMW_IMPLEMENTATION is not set; Fast DDS is the default of {distro}")
        }
        (Some(rmw), _) => format!("RMW_IMPLEMENTATION={rmw}"),
    }
}

/// The only service mapping of this environment, where it names one.
fn services(
    rmw: Option<&str>,
    is_sourced: bool,
) -> Result<Option<ServiceMapping>, EnvironmentError> {
    match rmw {
        // The default of ROS 2.
        None => Ok(is_sourced.then_some(ServiceMapping::FastDds)),
        Some("rmw_cyclonedds_cpp") => Ok(Some(ServiceMapping::Cyclone)),
        // A library that is missing says so when it is loaded.
        Some(_) if cfg!(feature = "rmw") => Ok(Some(ServiceMapping::FastDds)),
        Some("rmw_fastrtps_cpp" | "rmw_fastrtps_dynamic_cpp") => Ok(Some(ServiceMapping::FastDds)),
        Some("rmw_zenoh_cpp") => Err(EnvironmentError::Zenoh),
        Some(other) => Err(EnvironmentError::UnknownRmw(other.into())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(pairs: &[(&str, &str)]) -> Result<Environment, EnvironmentError> {
        read(|name| {
            pairs.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn domain_ids_are_read_as_rcl_reads_them() {
        for (text, id) in [("", 0), ("-1", 0), ("5", 5), (" 7", 7), ("0x10", 16), ("232", 232)] {
            assert_eq!(with(&[("ROS_DOMAIN_ID", text)]).unwrap().domain_id, id, "{text:?}");
        }
        assert_eq!(with(&[]).unwrap().domain_id, 0);
        let fault = |text: &str| with(&[("ROS_DOMAIN_ID", text)]).unwrap_err();
        assert_eq!(fault("abc"), EnvironmentError::DomainNotIntegral("abc".into()));
        assert_eq!(fault("5abc"), EnvironmentError::DomainNotIntegral("5abc".into()));
        for out in ["233", "-2", "4294967296", "99999999999999999999999999999999999999999"] {
            assert_eq!(fault(out), EnvironmentError::DomainOutOfRange(out.into()));
        }
        assert!(fault("abc").to_string().contains("ROS_DOMAIN_ID is not an integral number"));
    }

    #[test]
    fn ranges_and_peers() {
        let range = |value| with(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", value)]).unwrap();
        assert_eq!(range("").discovery.range, DiscoveryRange::Subnet);
        assert_eq!(range("SUBNET").discovery.range, DiscoveryRange::Subnet);
        assert_eq!(range("OFF").discovery.range, DiscoveryRange::Off);
        assert_eq!(range("SYSTEM_DEFAULT").discovery.range, DiscoveryRange::SystemDefault);
        let bogus = range("localhost");
        assert_eq!(bogus.discovery.range, DiscoveryRange::Localhost);
        assert_eq!(
            bogus.warnings,
            [
                "Invalid value 'localhost' specified for 'ROS_AUTOMATIC_DISCOVERY_RANGE', assuming localhost only"
            ]
        );
        let peers = |range| {
            with(&[
                ("ROS_AUTOMATIC_DISCOVERY_RANGE", range),
                ("ROS_STATIC_PEERS", "192.168.77.9;10.1.2.3;"),
            ])
            .unwrap()
        };
        assert_eq!(peers("SUBNET").discovery.static_peers, ["192.168.77.9", "10.1.2.3"]);
        assert_eq!(peers("LOCALHOST").discovery.static_peers.len(), 2);
        assert!(peers("OFF").discovery.static_peers.is_empty());
        assert!(peers("OFF").warnings.is_empty());
        let ignored = peers("SYSTEM_DEFAULT");
        assert!(ignored.discovery.static_peers.is_empty());
        assert!(ignored.warnings[0].starts_with("2 static peers were specified"));
    }

    #[test]
    fn localhost_only_wins_and_warns() {
        let on = with(&[
            ("ROS_LOCALHOST_ONLY", "1"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
            ("ROS_STATIC_PEERS", "10.0.0.1"),
        ])
        .unwrap();
        assert_eq!(on.discovery.range, DiscoveryRange::Localhost);
        assert!(on.discovery.static_peers.is_empty());
        assert_eq!(on.warnings.len(), 2);
        assert!(on.warnings[1].ends_with("will be ignored."));
        let off =
            with(&[("ROS_LOCALHOST_ONLY", "0"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")]).unwrap();
        assert_eq!(off.discovery.range, DiscoveryRange::Off);
        assert!(off.warnings[1].ends_with("will be used."));
    }

    #[test]
    fn security_is_read_as_rcl_reads_it_and_fails_closed() {
        let read = |enable, strategy| {
            let pairs = [("ROS_SECURITY_ENABLE", enable), ("ROS_SECURITY_STRATEGY", strategy)];
            with(&pairs)
        };
        for (enable, strategy, expected) in [
            ("", "Enforce", Security::Off),
            ("False", "Enforce", Security::Off),
            ("0", "Enforce", Security::Off),
            ("true", "", Security::Permissive),
            ("true", "permissive", Security::Permissive),
            ("true", "Enforce", Security::Enforce),
        ] {
            assert_eq!(read(enable, strategy).unwrap().security, expected, "{enable} {strategy}");
        }
        for (enable, strategy, variable) in [
            ("TRUE", "Enforce", "ROS_SECURITY_ENABLE=\"TRUE\""),
            ("1", "enforce", "ROS_SECURITY_ENABLE=\"1\""),
            ("true ", "Enforce", "ROS_SECURITY_ENABLE=\"true \""),
            ("true", "enforce", "ROS_SECURITY_STRATEGY=\"enforce\""),
            ("true", "Strict", "ROS_SECURITY_STRATEGY=\"Strict\""),
        ] {
            let told = read(enable, strategy).unwrap_err().to_string();
            assert!(told.starts_with(variable), "{told}");
        }
        let open = read("TRUE", "").unwrap();
        assert_eq!(open.security, Security::Off);
        assert!(open.warnings[0].contains("the word is true"), "{:?}", open.warnings);
    }

    #[test]
    fn the_graph_is_one_of_two() {
        let graph = |word| with(&[("WRAPYFI_ROS2_GRAPH", word)]).map(|found| found.graph);
        assert_eq!(graph(""), Ok(None));
        assert_eq!(graph("cyclone"), Ok(Some(Adapter::Cyclone)));
        assert_eq!(graph("rmw"), Ok(Some(Adapter::Rmw)));
        let fault = graph("zenoh").unwrap_err();
        assert_eq!(fault.to_string(), "WRAPYFI_ROS2_GRAPH=zenoh is neither cyclone nor rmw");
    }

    #[test]
    fn zenoh_needs_a_router_here_where_nothing_else_is_said() {
        let zenoh = ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp");
        let needs = |more: (&str, &str)| {
            needs_zenoh_router(|name| {
                let found = [zenoh, more].into_iter().find(|(key, _)| *key == name);
                found.map(|(_, value)| value.to_owned())
            })
        };
        assert!(needs(("ZENOH_ROUTER_CHECK_ATTEMPTS", "10")));
        assert!(needs(("ZENOH_SESSION_CONFIG_URI", "")));
        for other in [
            ("ZENOH_ROUTER_CHECK_ATTEMPTS", "-1"),
            ("ZENOH_SESSION_CONFIG_URI", "/etc/session.json5"),
            ("ZENOH_CONFIG_OVERRIDE", "connect/endpoints=[\"tcp/robot:7447\"]"),
            ("WRAPYFI_ROS2_GRAPH", "cyclone"),
        ] {
            assert!(!needs(other), "{other:?}");
        }
        assert!(!needs_zenoh_router(|_| None));
    }

    #[test]
    fn topics_are_on_cyclone_whatever_dds_is_asked_for() {
        for (rmw, services) in [
            ("", None),
            ("rmw_cyclonedds_cpp", Some(ServiceMapping::Cyclone)),
            ("rmw_fastrtps_cpp", Some(ServiceMapping::FastDds)),
        ] {
            let read = with(&[("RMW_IMPLEMENTATION", rmw)]).unwrap();
            assert_eq!(read.services, services, "{rmw}");
            assert_eq!(read.means_rmw, rmw == "rmw_fastrtps_cpp", "{rmw}");
        }
        let jazzy = with(&[("ROS_DISTRO", "jazzy")]).unwrap();
        assert_eq!((jazzy.services, jazzy.means_rmw), (Some(ServiceMapping::FastDds), true));
        assert!(jazzy.stack_reason.contains("jazzy"));
        let both = [("ROS_DISTRO", "jazzy"), ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")];
        let both = with(&both).unwrap();
        assert_eq!((both.services, both.means_rmw), (Some(ServiceMapping::Cyclone), false));
        #[cfg(not(feature = "rmw"))]
        {
            let zenoh = with(&[("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")]).unwrap_err();
            assert_eq!(zenoh, EnvironmentError::Zenoh);
            assert!(zenoh.to_string().contains("rmw_cyclonedds_cpp"));
            let unknown = with(&[("RMW_IMPLEMENTATION", "rmw_nope_cpp")]).unwrap_err();
            assert_eq!(unknown, EnvironmentError::UnknownRmw("rmw_nope_cpp".into()));
        }
    }
}
