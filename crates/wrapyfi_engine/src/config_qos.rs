//! The key `qos` of a route: a word, or policies one by one.
//!
//! ```text
//!   qos: match                     fitted to the peers that exist (also when the key is absent)
//!   qos: sensor_data               a profile by its name
//!   qos: { depth: 50, … }          ROS 2's default profile with these policies
//!   qos: { match: true, depth: 50 }  fitted, with what peers cannot tell
//! ```

use std::time::Duration;

use serde::{Deserialize, Deserializer, de};

use super::config_words::word_or_map;
use wrapyfi_endpoint::{Durability, History, Liveliness, PinnedQos, Qos, QosPreset, Reliability};

/// Quality of service of a route's ends, where their middleware has one.
///
/// ```
/// # mod wrapyfi_core { pub use {wrapyfi_endpoint as endpoint, wrapyfi_engine as engine}; }
/// use std::collections::BTreeMap;
/// use wrapyfi_core::endpoint::QosPreset;
/// use wrapyfi_core::engine::{Config, QosConfig};
/// let text = "routes:\n  - { from: ros2:/a, to: zeromq:/a, qos: sensor_data }\n";
/// let config: Config<BTreeMap<String, String>> = Config::from_yaml(text, "bridge.yaml")?;
/// assert_eq!(config.routes[0].value.qos, Some(QosConfig::Fixed(QosPreset::SensorData.into())));
/// # Ok::<(), wrapyfi_engine::ConfigError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QosConfig {
    /// Follows the peers when they come and change. The value is used while there are none; its
    /// history and lifespan always.
    Match(Qos),
    /// Stays as written.
    Fixed(Qos),
}

impl Default for QosConfig {
    fn default() -> Self {
        Self::Match(Qos::default())
    }
}

impl QosConfig {
    /// Quality of service; the one used while there are no peers, where it follows them.
    pub fn qos(self) -> Qos {
        match self {
            Self::Match(qos) | Self::Fixed(qos) => qos,
        }
    }
}

/// Quality of service that one end of a route is given outside the configuration, for instance by
/// the parameters `qos_overrides` of a ROS 2 node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct QosOverride {
    /// Policies that hold in place of those of the route and its peers.
    pub pinned: PinnedQos,
    /// True where the other policies follow the peers, also where the route's are written.
    pub follows: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Word {
    Match,
    Default,
    SensorData,
    Latched,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Policies {
    #[serde(rename = "match")]
    matched: bool,
    reliability: Option<Reliability>,
    durability: Option<Durability>,
    history: Option<HistoryWord>,
    depth: Option<u32>,
    deadline_ms: Option<Milliseconds>,
    lifespan_ms: Option<Milliseconds>,
    liveliness: Option<Liveliness>,
    lease_ms: Option<Milliseconds>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum HistoryWord {
    KeepLast,
    KeepAll,
}

/// A time of at least one millisecond; 49 days at most.
struct Milliseconds(Duration);

impl<'de> Deserialize<'de> for Milliseconds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match u32::deserialize(deserializer)? {
            0 => Err(de::Error::custom("a time of 0 ms can never be kept: write 1 or more")),
            ms => Ok(Self(Duration::from_millis(ms.into()))),
        }
    }
}

impl<'de> Deserialize<'de> for QosConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        word_or_map(
            deserializer,
            "match, default, sensor_data, latched or { match, reliability, durability, history, \
             depth, deadline_ms, lifespan_ms, liveliness, lease_ms }",
            |word: Word| {
                Ok(Self::Fixed(Qos::from(match word {
                    Word::Match => return Ok(Self::default()),
                    Word::Default => QosPreset::Default,
                    Word::SensorData => QosPreset::SensorData,
                    Word::Latched => QosPreset::Latched,
                })))
            },
            Policies::config,
        )
    }
}

impl Policies {
    fn config(self) -> Result<QosConfig, String> {
        let decided_by_peers = [
            ("reliability", self.reliability.is_some()),
            ("durability", self.durability.is_some()),
            ("deadline_ms", self.deadline_ms.is_some()),
            ("liveliness", self.liveliness.is_some()),
            ("lease_ms", self.lease_ms.is_some()),
        ];
        if let Some((key, _)) = decided_by_peers.iter().find(|&&(_, given)| self.matched && given) {
            return Err(format!(
                "match: true takes {key} from the peers: leave out one of the two (history, depth \
                 and lifespan_ms may stand beside it)"
            ));
        }
        let base = Qos::default();
        let qos = Qos {
            reliability: self.reliability.unwrap_or(base.reliability),
            durability: self.durability.unwrap_or(base.durability),
            history: match (self.history, self.depth) {
                (Some(HistoryWord::KeepAll), _) => History::KeepAll,
                (_, Some(depth)) => History::KeepLast(depth.max(1)),
                (_, None) => base.history,
            },
            deadline: self.deadline_ms.map(|Milliseconds(time)| time),
            lifespan: self.lifespan_ms.map(|Milliseconds(time)| time),
            liveliness: self.liveliness.unwrap_or(base.liveliness),
            lease: self.lease_ms.map(|Milliseconds(time)| time),
        };
        Ok(if self.matched { QosConfig::Match(qos) } else { QosConfig::Fixed(qos) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, ConfigError};

    #[derive(Debug, Default, Deserialize)]
    struct NoEndpoints {}

    fn qos(text: &str) -> Result<Option<QosConfig>, ConfigError> {
        let text = format!("routes:\n  - from: 'a:/x'\n    to: 'b:/y'\n    type: Image\n{text}");
        let config = Config::<NoEndpoints>::from_yaml(&text, "bridge.yaml")?;
        Ok(config.routes[0].value.qos)
    }

    #[test]
    fn profiles_have_names() {
        assert_eq!(qos("").unwrap(), None);
        assert_eq!(qos("    qos: match\n").unwrap(), Some(QosConfig::Match(Qos::default())));
        for (word, preset) in [
            ("default", QosPreset::Default),
            ("sensor_data", QosPreset::SensorData),
            ("latched", QosPreset::Latched),
        ] {
            let read = qos(&format!("    qos: {word}\n")).unwrap();
            assert_eq!(read, Some(QosConfig::Fixed(preset.into())), "{word}");
        }
    }

    #[test]
    fn every_policy_can_be_written() {
        let text = "    qos: { reliability: best_effort, durability: transient_local, history: keep_last, depth: 7, deadline_ms: 100, lifespan_ms: 2000, liveliness: manual_by_topic, lease_ms: 1500 }\n";
        let ms = |ms| Some(Duration::from_millis(ms));
        assert_eq!(
            qos(text).unwrap(),
            Some(QosConfig::Fixed(Qos {
                reliability: Reliability::BestEffort,
                durability: Durability::TransientLocal,
                history: History::KeepLast(7),
                deadline: ms(100),
                lifespan: ms(2000),
                liveliness: Liveliness::ManualByTopic,
                lease: ms(1500),
            }))
        );
        let keep_all = qos("    qos: { history: keep_all }\n").unwrap().unwrap().qos();
        assert_eq!(keep_all, Qos { history: History::KeepAll, ..Qos::default() });
    }

    #[test]
    fn what_peers_cannot_tell_stands_beside_match() {
        let read = qos("    qos: { match: true, depth: 50, lifespan_ms: 20 }\n").unwrap();
        let base = Qos {
            history: History::KeepLast(50),
            lifespan: Some(Duration::from_millis(20)),
            ..Qos::default()
        };
        assert_eq!(read, Some(QosConfig::Match(base)));
        let text = qos("    qos:\n      match: true\n      reliability: reliable\n").unwrap_err();
        let text = text.to_string();
        assert!(text.contains("match: true takes reliability from the peers"), "{text}");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (given, line, words) in [
            ("    qos:\n      deadline: 5\n", 6, "did you mean `deadline_ms`?"),
            ("    qos:\n      depth: 5\n      lease_ms: 0\n", 7, "write 1 or more"),
            ("    qos:\n      liveliness: manual\n", 6, "values here: automatic, manual_by_topic"),
            ("    qos: sensordata\n", 5, "did you mean `sensor_data`?"),
            ("    qos:\n      deadline_ms: 4294967296\n", 6, "whole number"),
        ] {
            let text = qos(given).unwrap_err().to_string();
            assert!(text.starts_with(&format!("bridge.yaml:{line}:")), "{text}");
            assert!(text.contains(words), "{text}");
        }
    }
}
