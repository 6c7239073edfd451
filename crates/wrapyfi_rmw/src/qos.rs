//! Quality of service, to and from rmw.

use std::time::Duration;

use super::sys;
use wrapyfi_endpoint::{
    AnnouncedDurability, AnnouncedQos, Durability, History, Liveliness, Qos, Reliability,
};

/// Profile of an endpoint: names without a slash in front are not changed.
pub(crate) fn to_rmw(qos: &Qos, name: &str) -> sys::rmw_qos_profile_t {
    let (history, depth) = match qos.history {
        History::KeepLast(depth) => (sys::RMW_QOS_POLICY_HISTORY_KEEP_LAST, depth),
        History::KeepAll => (sys::RMW_QOS_POLICY_HISTORY_KEEP_ALL, 0),
    };
    sys::rmw_qos_profile_t {
        history,
        depth: depth as usize,
        reliability: match qos.reliability {
            Reliability::Reliable => sys::RMW_QOS_POLICY_RELIABILITY_RELIABLE,
            Reliability::BestEffort => sys::RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT,
        },
        durability: match qos.durability {
            Durability::Volatile => sys::RMW_QOS_POLICY_DURABILITY_VOLATILE,
            Durability::TransientLocal => sys::RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL,
        },
        deadline: time(qos.deadline),
        lifespan: time(qos.lifespan),
        liveliness: match qos.liveliness {
            Liveliness::Automatic => sys::RMW_QOS_POLICY_LIVELINESS_AUTOMATIC,
            // ROS 2 has no liveliness of whole participants: the publisher's own is what satisfies it.
            Liveliness::ManualByParticipant | Liveliness::ManualByTopic => {
                sys::RMW_QOS_POLICY_LIVELINESS_MANUAL_BY_TOPIC
            }
        },
        liveliness_lease_duration: time(qos.lease),
        avoid_ros_namespace_conventions: !name.starts_with('/'),
    }
}

/// Quality of service that another endpoint announces. The default stands for policies that a
/// middleware does not know.
pub(crate) fn from_rmw(qos: &sys::rmw_qos_profile_t) -> AnnouncedQos {
    AnnouncedQos {
        reliability: match qos.reliability {
            sys::RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT => Reliability::BestEffort,
            _ => Reliability::Reliable,
        },
        durability: match qos.durability {
            sys::RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL => AnnouncedDurability::TransientLocal,
            _ => AnnouncedDurability::Volatile,
        },
        history: (qos.history == sys::RMW_QOS_POLICY_HISTORY_KEEP_LAST)
            .then(|| History::KeepLast(u32::try_from(qos.depth).unwrap_or(u32::MAX))),
        deadline: duration(qos.deadline),
        lifespan: duration(qos.lifespan),
        liveliness: match qos.liveliness {
            sys::RMW_QOS_POLICY_LIVELINESS_MANUAL_BY_TOPIC => Liveliness::ManualByTopic,
            _ => Liveliness::Automatic,
        },
        lease: duration(qos.liveliness_lease_duration),
    }
}

/// Seconds from which on rmw means "for ever": `RMW_DURATION_INFINITE`, and what DDS makes of it.
const FOR_EVER_S: u64 = 0x7FFF_FFFF;

pub(crate) fn time(duration: Option<Duration>) -> sys::rmw_time_t {
    match duration {
        Some(time) => sys::rmw_time_t { sec: time.as_secs(), nsec: u64::from(time.subsec_nanos()) },
        // Unspecified: the middleware's own default, which is none.
        None => sys::rmw_time_t { sec: 0, nsec: 0 },
    }
}

fn duration(time: sys::rmw_time_t) -> Option<Duration> {
    let is_finite = time.sec < FOR_EVER_S && (time.sec, time.nsec) != (0, 0);
    is_finite.then(|| Duration::from_secs(time.sec).saturating_add(Duration::from_nanos(time.nsec)))
}

/// Name of the policy over which two endpoints did not match, as ROS 2 prints it.
pub(crate) fn policy(kind: sys::rmw_qos_policy_kind_t) -> &'static str {
    match kind {
        sys::RMW_QOS_POLICY_DURABILITY => "durability",
        sys::RMW_QOS_POLICY_DEADLINE => "deadline",
        sys::RMW_QOS_POLICY_LIVELINESS | sys::RMW_QOS_POLICY_LIVELINESS_LEASE_DURATION => {
            "liveliness"
        }
        sys::RMW_QOS_POLICY_RELIABILITY => "reliability",
        sys::RMW_QOS_POLICY_HISTORY | sys::RMW_QOS_POLICY_DEPTH => "history",
        sys::RMW_QOS_POLICY_LIFESPAN => "lifespan",
        _ => "quality of service",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_of_service_returns_as_it_was() {
        let qos = Qos {
            reliability: Reliability::Reliable,
            durability: Durability::TransientLocal,
            history: History::KeepLast(7),
            deadline: Some(Duration::from_millis(1500)),
            lifespan: None,
            liveliness: Liveliness::ManualByTopic,
            lease: Some(Duration::from_secs(2)),
        };
        assert_eq!(from_rmw(&to_rmw(&qos, "/a")), qos.into());
        let other = Qos {
            reliability: Reliability::BestEffort,
            history: History::KeepAll,
            lifespan: Some(Duration::from_nanos(1)),
            ..Qos::default()
        };
        assert_eq!(
            from_rmw(&to_rmw(&other, "/a")),
            AnnouncedQos { history: None, ..other.into() },
            "what is kept is not announced"
        );
    }

    #[test]
    fn for_ever_is_no_time() {
        for (sec, nsec) in [(0, 0), (9_223_372_036, 854_775_807), (0x7FFF_FFFF, 0xFFFF_FFFF)] {
            assert_eq!(duration(sys::rmw_time_t { sec, nsec }), None);
        }
    }
}
