//! The configuration file: YAML to plain data, nothing resolved yet.
//!
//! ```text
//!   text ── from_yaml ──▶ Config ── Plan::new ──▶ Plan ── Engine::new ──▶ routes
//!            unknown keys,          names, types,
//!            wrong types: line      duplicates: line
//! ```
//!
//! `config/example.yaml` is the manual: every key, commented.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::de::{self, DeserializeOwned, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::config_devices::DevicesConfig;
use super::config_qos::QosConfig;
use super::config_words::word_or_map;
use super::stamping::StampSource;
use wrapyfi_endpoint::config::{ConfigError, Reading, Spanned};
use wrapyfi_endpoint::{Interaction, Overflow};

/// Largest number of entries in `routes`. An entry of two bytes takes some thousand in memory.
pub(crate) const MAX_ROUTES: usize = 10_000;

/// Keys of a route without which the others mean what they meant.
const SETTINGS: [&str; 12] = [
    "timeout_ms",
    "lazy",
    "qos",
    "encoding",
    "frame_id",
    "stamp",
    "queue_depth",
    "overflow",
    "max_rate_hz",
    "loop_guard",
    "max_message_mib",
    "devices",
];

/// A configuration file. `E` describes the endpoints section, because the program knows the
/// middlewares and the engine does not.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_engine as engine; }
/// use std::collections::BTreeMap;
/// use wrapyfi_core::engine::Config;
/// let text = "routes:\n  - from: zeromq:/camera\n    to: ros2:/camera\n    type: Image\n";
/// let config: Config<BTreeMap<String, String>> = Config::from_yaml(text, "bridge.yaml")?;
/// let from = config.routes[0].value.from.as_ref().unwrap();
/// assert_eq!((from.value.as_str(), from.referenced.line()), ("zeromq:/camera", 2));
/// # Ok::<(), wrapyfi_engine::ConfigError>(())
/// ```
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, bound = "E: DeserializeOwned + Default")]
pub struct Config<E> {
    /// Settings of each middleware, such as the address of its broker or master.
    #[serde(default)]
    pub endpoints: E,
    /// Names of machines and their addresses, beside those that the system knows.
    #[serde(default)]
    pub hosts: BTreeMap<String, Spanned<String>>,
    /// Values for routes that do not set their own.
    #[serde(default)]
    #[doc(hidden)]
    pub defaults: Defaults,
    /// Limits on the whole process.
    #[serde(default)]
    #[doc(hidden)]
    pub limits: ProcessLimits,
    /// The live page of the bridge.
    #[serde(default)]
    #[doc(hidden)]
    pub page: PageConfig,
    /// Folders with definitions of ROS types that are installed nowhere: `package/msg/Type.msg` below.
    #[serde(default)]
    pub definitions: Vec<Spanned<String>>,
    /// Routes and patterns: 10 000 entries at most.
    #[serde(deserialize_with = "routes")]
    #[doc(hidden)]
    pub routes: Vec<Spanned<RouteConfig>>,
}

/// Limits on the whole process.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProcessLimits {
    /// MiB that may wait in all queues together (default 1024).
    pub waiting_mib: Option<Spanned<usize>>,
}

/// The live page of a bridge.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PageConfig {
    /// Port of 127.0.0.1 at which it is served; 0 for any that is free (default: no page).
    pub port: Option<Spanned<u16>>,
}

/// Values for routes that do not set their own.
///
/// ```
/// use std::collections::BTreeMap;
/// use wrapyfi_engine::Config;
/// let text = "defaults:\n  queue_depth: 1\n  overflow: { block_ms: 50 }\nroutes: []\n";
/// let config: Config<BTreeMap<String, String>> = Config::from_yaml(text, "bridge.yaml")?;
/// assert_eq!(config.defaults.queue_depth.unwrap().value, 1);
/// # Ok::<(), wrapyfi_engine::ConfigError>(())
/// ```
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Defaults {
    /// Number of messages that a route's queue holds (default 10).
    pub queue_depth: Option<Spanned<usize>>,
    /// Policy of a full queue (default `drop_oldest`).
    pub overflow: OverflowConfig,
    /// Largest message in MiB (default 64, or a quarter of `waiting_mib` where that is less).
    pub max_message_mib: Option<Spanned<usize>>,
    /// Devices that received tensors are labelled with (default: they keep theirs).
    pub devices: Option<Spanned<DevicesConfig>>,
}

/// One entry of `routes`.
///
/// See [`Config`].
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RouteConfig {
    /// Source, as `middleware:/name`.
    pub from: Option<Spanned<String>>,
    /// Destination, as `middleware:/name`.
    pub to: Option<Spanned<String>>,
    /// Address at which a service has its server, in place of `from` and `to`.
    pub service: Option<Spanned<String>>,
    /// Address at which an action has its server, in place of `from` and `to`.
    pub action: Option<Spanned<String>>,
    /// Address at which the bridge offers that service or action.
    #[serde(rename = "as")]
    pub offered: Option<Spanned<String>>,
    /// Address at which a robot is offered as a control board: its states come from `from`, the movements that clients
    /// ask for go to `to`. Two routes, one for each direction.
    pub board: Option<Spanned<String>>,
    /// Time that a call of the service has, in milliseconds.
    pub timeout_ms: Option<Spanned<u64>>,
    /// Message type: see [`wrapyfi_data::types::MessageType`]; of a service [`wrapyfi_data::types::ServiceKind`].
    /// If left out, it is learned from the endpoints that exist.
    #[serde(rename = "type")]
    pub message_type: Option<Spanned<String>>,
    /// Type where none is given and no endpoint announces one.
    pub type_if_unknown: Option<Spanned<String>>,
    /// Names that a pattern takes, as regular expressions (default: all).
    pub allow: Option<Spanned<Vec<Spanned<String>>>>,
    /// Names that a pattern leaves out, also where they are allowed.
    pub deny: Option<Spanned<Vec<Spanned<String>>>>,
    /// True where a pattern leaves out hidden names and those that every node has (default: true).
    pub default_deny: Option<Spanned<bool>>,
    /// Largest number of routes that a pattern makes (default: 1000).
    pub max_routes: Option<Spanned<usize>>,
    /// True where the source is open only while a program listens (default: true for patterns, else
    /// false).
    pub lazy: Option<Spanned<bool>>,
    /// Message type at the source, where it is another than at the destination (default: `type`).
    pub from_type: Option<Spanned<String>>,
    /// Name in tables and logs (default `from -> to`).
    pub name: Option<String>,
    /// Quality of service where a middleware has one (default: fitted to the peers, and ROS 2's
    /// default profile while there are none).
    pub qos: Option<QosConfig>,
    /// Channel order of three-channel frames on Wrapyfi's side: `bgr8` (default) or `rgb8`.
    pub encoding: Option<Spanned<String>>,
    /// Coordinate frame in the header of every message (default: the source's).
    pub frame_id: Option<Spanned<String>>,
    /// Source of the time in the header (default: [`StampSource::Source`], with `use_sim_time`
    /// [`StampSource::RosTime`] for sources outside ROS).
    pub stamp: Option<Spanned<StampSource>>,
    /// Number of messages that the route's queue holds.
    pub queue_depth: Option<Spanned<usize>>,
    /// Policy of a full queue.
    pub overflow: Option<OverflowConfig>,
    /// Highest rate passed on, in messages per second; others are dropped and counted.
    pub max_rate_hz: Option<Spanned<f64>>,
    /// True where the route stays closed that would close a circle over other bridges (default: true).
    pub loop_guard: Option<bool>,
    /// Largest message in MiB.
    pub max_message_mib: Option<Spanned<usize>>,
    /// Devices that received tensors are labelled with; a library that stands here is not looked up
    /// in the defaults.
    pub devices: Option<Spanned<DevicesConfig>>,
    /// Settings that only some middlewares have, by name: `carrier`, `joints`, …
    pub options: BTreeMap<String, Spanned<serde_json::Value>>,
    /// True where another route may have the same destination.
    pub merge: bool,
}

/// Policy of a full queue: `drop_oldest`, `drop_newest` or `{ block_ms: N }`.
///
/// See [`Defaults`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OverflowConfig(pub Overflow);

impl RouteConfig {
    /// Interaction that the keys of the entry are about.
    pub fn interaction(&self) -> Interaction {
        match self {
            Self { action: Some(_), .. } => Interaction::Action,
            Self { service: None, offered: None, .. } => Interaction::Topic,
            _ => Interaction::Service,
        }
    }

    /// Addresses of source and destination, under the keys of the entry's interaction.
    pub fn ends(&self) -> [Option<&Spanned<String>>; 2] {
        match self.interaction() {
            Interaction::Topic => [self.from.as_ref(), self.to.as_ref()],
            Interaction::Service => [self.service.as_ref(), self.offered.as_ref()],
            Interaction::Action => [self.action.as_ref(), self.offered.as_ref()],
        }
    }
}

impl<E: DeserializeOwned + Default> Config<E> {
    /// Reads a configuration; `file` is its name in errors.
    ///
    /// # Errors
    /// When the file is wrong; the error names file, line and column, the fault, and the nearest
    /// spelling of an unknown key.
    pub fn from_yaml(text: &str, file: &str) -> Result<Self, ConfigError> {
        Self::read(text, |_| None).whole(file)
    }

    /// Reads a configuration as far as it can be read: entries that are wrong are left out, with the whole route that
    /// they belong to unless they are settings of it. `endpoint_example` is an example of what to write for a key of the endpoints, for errors.
    #[doc(hidden)]
    pub fn read(
        text: &str,
        endpoint_example: impl Fn(&str) -> Option<&'static str>,
    ) -> Reading<Self> {
        let examples = |key: &str| example(key).or_else(|| endpoint_example(key));
        let mut reading = Reading::<Self>::new(text, &examples);
        if let Some(config) = &mut reading.value {
            let place = |route: &Spanned<_>| (route.referenced.line(), route.referenced.column());
            let is_setting =
                |key: &Option<String>| key.as_deref().is_some_and(|key| SETTINGS.contains(&key));
            config.routes.retain(|route| {
                let wrong = reading.wrong_items.get(&place(route));
                wrong.is_none_or(|wrong| wrong.iter().all(is_setting))
            });
        }
        reading
    }
}

/// Example of a value that a key of routes, limits or the whole file may have.
fn example(key: &str) -> Option<&'static str> {
    Some(match key {
        "page" => "{ port: 8642 }",
        "limits" => "{ waiting_mib: 1024 }",
        "defaults" => "{ queue_depth: 10 }",
        "hosts" => "{ robot-base: 192.168.1.7 }",
        "definitions" => "[interfaces]",
        "allow" | "deny" => "[\"/camera/.*\"]",
        "options" => "{ carrier: udp }",
        "devices" => "{ load_torch_device: \"cuda:0\" }",
        "waiting_mib" => "1024",
        "overflow" => "{ block_ms: 100 }",
        "qos" => "sensor_data",
        "stamp" => "source",
        "timeout_ms" => "5000",
        "block_ms" => "100",
        "queue_depth" | "depth" => "10",
        "max_rate_hz" => "30",
        "max_message_mib" => "64",
        "max_routes" => "1000",
        "port" => "8642",
        "lazy" | "merge" | "loop_guard" | "default_deny" => "true",
        _ => return None,
    })
}

/// Reads the list of routes, and stops where there are too many.
fn routes<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<Spanned<RouteConfig>>, D::Error> {
    struct Routes;

    impl<'de> Visitor<'de> for Routes {
        type Value = Vec<Spanned<RouteConfig>>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of routes")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Self::Value, A::Error> {
            let mut all = Vec::new();
            while let Some(route) = entries.next_element()? {
                if all.len() == MAX_ROUTES {
                    return Err(de::Error::custom(format!(
                        "more than {MAX_ROUTES} routes: one route by pattern means many topics"
                    )));
                }
                all.push(route);
            }
            Ok(all)
        }
    }

    deserializer.deserialize_seq(Routes)
}

impl<'de> Deserialize<'de> for OverflowConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(rename_all = "snake_case")]
        enum Word {
            DropOldest,
            DropNewest,
        }
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Block {
            block_ms: u64,
        }
        word_or_map(
            deserializer,
            "drop_oldest, drop_newest or { block_ms: N }",
            |word: Word| {
                Ok(Self(match word {
                    Word::DropOldest => Overflow::DropOldest,
                    Word::DropNewest => Overflow::DropNewest,
                }))
            },
            |Block { block_ms }| Ok(Self(Overflow::Block(Duration::from_millis(block_ms)))),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MAX_CONFIG_BYTES;
    use wrapyfi_endpoint::{Durability, History, QosPreset};

    #[derive(Debug, Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct NoEndpoints {}

    fn parse(text: &str) -> Result<Config<NoEndpoints>, ConfigError> {
        Config::from_yaml(text, "bridge.yaml")
    }

    #[test]
    fn a_route_reads_with_defaults() {
        let config =
            parse("routes:\n  - { from: 'a:/x', to: 'b:/y', type: Image, qos: sensor_data }\n")
                .unwrap();
        let route = &config.routes[0].value;
        assert_eq!(
            [&route.from, &route.to].map(|end| end.as_ref().map(|end| end.value.as_str())),
            [Some("a:/x"), Some("b:/y")]
        );
        assert_eq!(route.qos, Some(QosConfig::Fixed(QosPreset::SensorData.into())));
        assert_eq!(config.routes[0].referenced.line(), 2);
        assert!(config.defaults.queue_depth.is_none());
    }

    #[test]
    fn policies_and_blocking_are_spelled_out() {
        let text = "routes:\n  - from: 'a:/x'\n    to: 'b:/y'\n    type: Image\n    overflow: { block_ms: 50 }\n    qos: { durability: transient_local, depth: 3 }\n";
        let config = parse(text).unwrap();
        let route = &config.routes[0].value;
        assert_eq!(
            route.overflow,
            Some(OverflowConfig(Overflow::Block(Duration::from_millis(50))))
        );
        let qos = route.qos.unwrap().qos();
        assert_eq!(qos.durability, Durability::TransientLocal);
        assert_eq!(qos.history, History::KeepLast(3));
    }

    #[test]
    fn an_unknown_key_is_refused_with_line_and_suggestion() {
        let error =
            parse("routes:\n  - from: 'a:/x'\n    two: 'b:/y'\n    type: Image\n").unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("bridge.yaml:3:"), "{text}");
        assert!(
            text.contains("unknown key `two`") && text.contains("did you mean `to`?"),
            "{text}"
        );
    }

    #[test]
    fn a_wrong_word_lists_the_right_ones() {
        let text =
            parse("routes:\n  - { from: 'a:/x', to: 'b:/y', type: Image, overflow: drop_oldes }\n")
                .unwrap_err()
                .to_string();
        assert!(text.contains("drop_oldest"), "{text}");
        let text = parse("routes:\n  - { from: 'a:/x', to: 'b:/y', type: Image, qos: 3 }\n")
            .unwrap_err()
            .to_string();
        assert!(text.contains("sensor_data"), "{text}");
    }

    #[test]
    fn a_value_of_another_kind_is_told_what_to_write() {
        for (text, words) in [
            (
                "page: 8642\nroutes: []\n",
                "bridge.yaml:1:7: expected keys with values; write for example `page: { port: 8642 }`",
            ),
            ("routes:\n- overflow: block\n", "`overflow: { block_ms: 100 }`"),
            (
                "routes:\n- { timeout_ms: 5s }\n",
                "expected a whole number; write for example `timeout_ms: 5000`",
            ),
            ("routes:\n- { lazy: ja }\n", "expected true or false; write for example `lazy: true`"),
            ("routes:\n- { allow: /a }\n", "expected a list; write for example `allow: "),
        ] {
            let told = parse(text).unwrap_err().to_string();
            assert!(told.contains(words), "{told}");
        }
    }

    #[test]
    fn all_entries_that_cannot_be_read_are_told_at_once() {
        let text = "page: 8642\nroutes:\n  - { from: 'a:/x', queue_depth: many, typ: Text }\n  - from: 'a:/x'\n    timeout_ms: 5s\n    overflow: block\n    to: 'b:/x'\n  - { from: 'a:/x', lazy: ja }\n";
        let lines = |text: &str| -> Vec<u64> {
            let problems = parse(text).unwrap_err().problems;
            problems.iter().filter_map(|problem| Some(problem.position?.0)).collect()
        };
        assert_eq!(lines(text), [1, 3, 3, 5, 6, 8]);
        // Nothing is told of what only follows from a fault.
        assert_eq!(lines("page:\n  prot: 1\nroutes: []\n"), [2]);
        assert_eq!(lines("routes:\n- typ: Text\n- { lazy: ja }\n"), [2, 3]);
        assert_eq!(lines("page: 8642\n"), [1]);
    }

    #[test]
    fn too_many_routes_are_refused_before_they_fill_the_memory() {
        let text = format!("routes: [{}]", "{},".repeat(MAX_ROUTES + 1));
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains("more than 10000 routes"), "{error}");
        assert_eq!(parse("routes: [{}, {}]").unwrap().routes.len(), 2);
    }

    #[test]
    fn what_is_missing_is_named() {
        let text = parse("routes:\n  - { to: 'b:/y', overflow: {} }\n").unwrap_err().to_string();
        assert!(text.contains("`block_ms`"), "{text}");
        assert!(parse("endpoints: {}\n").unwrap_err().to_string().contains("routes"));
        assert!(parse("routes: [\n").is_err());
        assert!(
            parse(&" ".repeat(MAX_CONFIG_BYTES + 1)).unwrap_err().to_string().contains("1048576")
        );
    }

    #[test]
    fn faults_of_yaml_are_told_in_words_of_a_user() {
        let deep = format!("routes: {}", "[".repeat(5000));
        for (text, words) in [
            ("", "no configuration is written here"),
            ("# to do\n", "no configuration is written here"),
            ("routes: &r [*r]", "the value contains itself"),
            ("routes: *r", "`*` names a value that nothing above it names"),
            ("routes: !!binary aGVsbG8=", "`!!binary` has no place"),
            ("routes: !!binary ???", "`!!binary` has no place"),
            ("routes:\n- from: !!binary /w==\n", "`!!binary` has no place"),
            ("? [a]\n: b", "expected a text"),
            (&deep, "lists and keys stand too deep inside each other"),
        ] {
            let error = Config::<BTreeMap<String, String>>::from_yaml(text, "file").unwrap_err();
            let told = error.to_string();
            assert!(told.contains(words), "{text:.40}: {told}");
            for jargon in ["serial", "recursi", "span", "scalar", "weak", "enum", "input"] {
                assert!(!told.contains(jargon), "{text:.40}: {told}");
            }
        }
    }
}
