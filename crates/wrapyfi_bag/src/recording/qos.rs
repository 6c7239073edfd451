//! `offered_qos_profiles`: quality of service as text.

use std::fmt::Write as _;
use std::time::Duration;

use serde::Deserialize;
use wrapyfi_endpoint::{Durability, History, Liveliness, Qos, Reliability};

/// Seconds and nanoseconds of a time without an end, as ROS 2 writes it.
const INFINITE: (u64, u32) = (9_223_372_036, 854_775_807);

/// Times without an end of programs of ROS 2 before Galactic.
const INFINITE_BEFORE: [(u64, u32); 2] = [(0x7fff_ffff, 0xffff_ffff), (0x7fff_ffff, 0x7fff_ffff)];

/// A policy: by its name, or as ROS 2 before Jazzy has it, by its number.
#[derive(Deserialize)]
#[serde(untagged)]
enum Policy {
    Number(u8),
    Name(String),
}

impl Policy {
    /// Name of the policy; `names` are those from 1 on.
    fn name<'n>(&'n self, names: &[&'static str]) -> &'n str {
        match self {
            Self::Name(name) => name,
            Self::Number(number) => {
                let place = usize::from(*number).checked_sub(1);
                place.and_then(|place| names.get(place)).copied().unwrap_or_default()
            }
        }
    }
}

#[derive(Deserialize, Default, Clone, Copy)]
struct Time {
    sec: u64,
    nsec: u64,
}

impl Time {
    fn duration(self) -> Option<Duration> {
        let nsec = u32::try_from(self.nsec).unwrap_or(u32::MAX);
        let known = [(0, 0), INFINITE].into_iter().chain(INFINITE_BEFORE);
        let is_none = known.into_iter().any(|endless| endless == (self.sec, nsec));
        (!is_none).then(|| {
            Duration::from_secs(self.sec).saturating_add(Duration::from_nanos(nsec.into()))
        })
    }
}

#[derive(Deserialize)]
struct Profile {
    history: Policy,
    depth: u64,
    reliability: Policy,
    durability: Policy,
    #[serde(default)]
    deadline: Time,
    #[serde(default)]
    lifespan: Time,
    liveliness: Policy,
    #[serde(default)]
    liveliness_lease_duration: Time,
}

impl From<Profile> for Qos {
    fn from(profile: Profile) -> Self {
        let depth = u32::try_from(profile.depth).unwrap_or(u32::MAX);
        let default = Self::default();
        Self {
            reliability: match profile.reliability.name(&["reliable", "best_effort"]) {
                "best_effort" => Reliability::BestEffort,
                _ => Reliability::Reliable,
            },
            durability: match profile.durability.name(&["transient_local", "volatile"]) {
                "transient_local" => Durability::TransientLocal,
                _ => Durability::Volatile,
            },
            history: match profile.history.name(&["keep_last", "keep_all"]) {
                "keep_all" => History::KeepAll,
                "keep_last" if depth > 0 => History::KeepLast(depth),
                _ => default.history,
            },
            deadline: profile.deadline.duration(),
            lifespan: profile.lifespan.duration(),
            liveliness: match profile.liveliness.name(&["automatic", "", "manual_by_topic"]) {
                "manual_by_topic" => Liveliness::ManualByTopic,
                _ => Liveliness::Automatic,
            },
            lease: profile.liveliness_lease_duration.duration(),
        }
    }
}

/// Profiles that are written in a file; none where they cannot be read, or there are none.
pub(super) fn parsed(text: &str) -> Vec<Qos> {
    let profiles: Vec<Profile> = serde_saphyr::from_str(text).unwrap_or_default();
    profiles.into_iter().map(Qos::from).collect()
}

/// The profiles as YAML, each line behind `indent`.
pub(super) fn profiles(all: &[Qos], indent: &str) -> String {
    let mut text = String::new();
    for qos in all {
        let (history, depth) = match qos.history {
            History::KeepLast(depth) => ("keep_last", depth),
            History::KeepAll => ("keep_all", 0),
        };
        let reliability = match qos.reliability {
            Reliability::Reliable => "reliable",
            Reliability::BestEffort => "best_effort",
        };
        let durability = match qos.durability {
            Durability::Volatile => "volatile",
            Durability::TransientLocal => "transient_local",
        };
        let liveliness = match qos.liveliness {
            Liveliness::ManualByTopic => "manual_by_topic",
            Liveliness::Automatic | Liveliness::ManualByParticipant => "automatic",
        };
        // Writing into a string cannot fail.
        _ = writeln!(text, "{indent}- history: {history}");
        _ = writeln!(text, "{indent}  depth: {depth}");
        _ = writeln!(text, "{indent}  reliability: {reliability}");
        _ = writeln!(text, "{indent}  durability: {durability}");
        time(&mut text, indent, "deadline", qos.deadline);
        time(&mut text, indent, "lifespan", qos.lifespan);
        _ = writeln!(text, "{indent}  liveliness: {liveliness}");
        time(&mut text, indent, "liveliness_lease_duration", qos.lease);
        _ = writeln!(text, "{indent}  avoid_ros_namespace_conventions: false");
    }
    text
}

fn time(text: &mut String, indent: &str, name: &str, time: Option<Duration>) {
    let (sec, nsec) = time.map_or(INFINITE, |time| (time.as_secs(), time.subsec_nanos()));
    _ = writeln!(text, "{indent}  {name}:\n{indent}    sec: {sec}\n{indent}    nsec: {nsec}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let some = Qos {
            reliability: Reliability::BestEffort,
            durability: Durability::TransientLocal,
            history: History::KeepLast(3),
            deadline: Some(Duration::from_millis(1500)),
            lifespan: Some(Duration::from_nanos(7)),
            liveliness: Liveliness::ManualByTopic,
            lease: Some(Duration::from_secs(4)),
        };
        let all = [some, Qos::default(), Qos { history: History::KeepAll, ..Qos::default() }];
        assert_eq!(parsed(&profiles(&all, "")), all);
        assert_eq!(parsed(""), []);
        assert_eq!(parsed("[]"), []);
        assert_eq!(parsed("nonsense: [1"), []);
    }

    #[test]
    fn numbers_of_older_ros_2_are_read() {
        let text = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 2147483647\n    \
                    nsec: 4294967295\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  \
                    liveliness_lease_duration:\n    sec: 0\n    nsec: 0\n  avoid_ros_namespace_conventions: false";
        let latched = Qos { durability: Durability::TransientLocal, ..Qos::default() };
        assert_eq!(parsed(text), [latched]);
    }
}
