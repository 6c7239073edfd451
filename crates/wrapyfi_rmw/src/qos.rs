//! Quality of service, to and from rmw.

use std::time::Duration;

use super::sys;

/// Quality of service of an endpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// True when every message is delivered.
    pub reliable: bool,
    /// Messages that readers which come later get.
    pub durability: Durability,
    /// Number of messages kept; all where `None`.
    pub depth: Option<u32>,
    /// Longest time between two messages.
    pub deadline: Option<Duration>,
    /// Age at which a message is no longer delivered.
    pub lifespan: Option<Duration>,
    /// Party that says that a publisher is alive.
    pub liveliness: Liveliness,
    /// Silence after which it counts as dead.
    pub lease: Option<Duration>,
}

/// Messages that readers which come later get.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "ROS 2's own terms")]
pub enum Durability {
    Volatile,
    TransientLocal,
}

/// Party that says that a publisher is alive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "ROS 2's own terms")]
pub enum Liveliness {
    Automatic,
    ManualByTopic,
}

impl Qos {
    /// True when a publisher with this quality of service satisfies a subscription with `asked`.
    pub(crate) fn satisfies(&self, asked: &Self) -> bool {
        let within = |offered: Option<Duration>, asked: Option<Duration>| match (offered, asked) {
            (_, None) => true,
            (None, Some(_)) => false,
            (Some(offered), Some(asked)) => offered <= asked,
        };
        (self.reliable || !asked.reliable)
            && (self.durability == Durability::TransientLocal
                || asked.durability == Durability::Volatile)
            && within(self.deadline, asked.deadline)
            && (self.liveliness == Liveliness::ManualByTopic
                || asked.liveliness == Liveliness::Automatic)
            && within(self.lease, asked.lease)
    }

    /// Profile of a publisher or a subscription: names without a slash in front are not changed.
    pub(crate) fn to_rmw_of(self, topic: &str) -> sys::rmw_qos_profile_t {
        let avoid_ros_namespace_conventions = !topic.starts_with('/');
        sys::rmw_qos_profile_t { avoid_ros_namespace_conventions, ..self.to_rmw() }
    }

    pub(crate) fn to_rmw(self) -> sys::rmw_qos_profile_t {
        sys::rmw_qos_profile_t {
            history: match self.depth {
                Some(_) => sys::RMW_QOS_POLICY_HISTORY_KEEP_LAST,
                None => sys::RMW_QOS_POLICY_HISTORY_KEEP_ALL,
            },
            depth: self.depth.unwrap_or(0) as usize,
            reliability: if self.reliable {
                sys::RMW_QOS_POLICY_RELIABILITY_RELIABLE
            } else {
                sys::RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT
            },
            durability: match self.durability {
                Durability::Volatile => sys::RMW_QOS_POLICY_DURABILITY_VOLATILE,
                Durability::TransientLocal => sys::RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL,
            },
            deadline: time(self.deadline),
            lifespan: time(self.lifespan),
            liveliness: match self.liveliness {
                Liveliness::Automatic => sys::RMW_QOS_POLICY_LIVELINESS_AUTOMATIC,
                Liveliness::ManualByTopic => sys::RMW_QOS_POLICY_LIVELINESS_MANUAL_BY_TOPIC,
            },
            liveliness_lease_duration: time(self.lease),
            avoid_ros_namespace_conventions: false,
        }
    }

    /// Quality of service that another endpoint announces. The default stands for policies that a
    /// middleware does not know.
    pub(crate) fn from_rmw(qos: &sys::rmw_qos_profile_t) -> Self {
        Self {
            reliable: qos.reliability != sys::RMW_QOS_POLICY_RELIABILITY_BEST_EFFORT,
            durability: if qos.durability == sys::RMW_QOS_POLICY_DURABILITY_TRANSIENT_LOCAL {
                Durability::TransientLocal
            } else {
                Durability::Volatile
            },
            depth: (qos.history == sys::RMW_QOS_POLICY_HISTORY_KEEP_LAST)
                .then(|| u32::try_from(qos.depth).unwrap_or(u32::MAX)),
            deadline: duration(qos.deadline),
            lifespan: duration(qos.lifespan),
            liveliness: if qos.liveliness == sys::RMW_QOS_POLICY_LIVELINESS_MANUAL_BY_TOPIC {
                Liveliness::ManualByTopic
            } else {
                Liveliness::Automatic
            },
            lease: duration(qos.liveliness_lease_duration),
        }
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
            reliable: true,
            durability: Durability::TransientLocal,
            depth: Some(7),
            deadline: Some(Duration::from_millis(1500)),
            lifespan: None,
            liveliness: Liveliness::ManualByTopic,
            lease: Some(Duration::from_secs(2)),
        };
        assert_eq!(Qos::from_rmw(&qos.to_rmw()), qos);
        let other = Qos {
            reliable: false,
            durability: Durability::Volatile,
            depth: None,
            deadline: None,
            lifespan: Some(Duration::from_nanos(1)),
            liveliness: Liveliness::Automatic,
            lease: None,
        };
        assert_eq!(Qos::from_rmw(&other.to_rmw()), other);
    }

    #[test]
    fn for_ever_is_no_time() {
        for (sec, nsec) in [(0, 0), (9_223_372_036, 854_775_807), (0x7FFF_FFFF, 0xFFFF_FFFF)] {
            assert_eq!(duration(sys::rmw_time_t { sec, nsec }), None);
        }
    }
}
