//! The time of a node: the system's, or that of a simulation or recording from `/clock`.
//!
//! ```text
//!   use_sim_time ──▶ ┌─────────┐ ◀── rosgraph_msgs/Clock
//!                    │ RosTime │ ──▶ how far the clock went back
//!   system time ───▶ └─────────┘ ──▶ now
//! ```
//!
//! While simulated time is on and no clock has come, it is zero, as in other nodes of ROS 2.

use std::time::Duration;

use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;

use wrapyfi_data::types::Stamp;

/// Nanoseconds of a second.
const SECOND: i64 = 1_000_000_000;

/// The time of a node. It asks no clock itself: the caller gives the system's time.
///
/// ```
/// use std::time::Duration;
/// use wrapyfi_node::RosTime;
/// use wrapyfi_data::types::Stamp;
/// use wrapyfi_interfaces::builtin_interfaces::msg::Time;
/// use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;
///
/// let mut time = RosTime::new(true);
/// assert_eq!(time.now(Stamp::now()), Stamp::default());
/// time.on_clock(&Clock { clock: Time { sec: 5, nanosec: 0 } })?;
/// assert_eq!(time.now(Stamp::now()), Stamp { sec: 5, nanosec: 0 });
/// let back = time.on_clock(&Clock { clock: Time { sec: 1, nanosec: 0 } })?;
/// assert_eq!(back, Some(Duration::from_secs(4)));
/// # Ok::<(), wrapyfi_node::ClockError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RosTime {
    simulated: bool,
    /// Time of the last message of `/clock`, in nanoseconds.
    clock_ns: Option<i64>,
}

/// Error of a message of `/clock` that is not used.
///
/// ```
/// use wrapyfi_interfaces::{builtin_interfaces::msg::Time, rosgraph_msgs::msg::Clock};
/// use wrapyfi_node::{ClockError, RosTime};
/// let before = Clock { clock: Time { sec: -1, nanosec: 0 } };
/// let error = RosTime::new(true).on_clock(&before).unwrap_err();
/// assert_eq!(error, ClockError(-1));
/// assert!(error.to_string().starts_with("/clock says -1 s; ROS time is not negative"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "/clock says {0} s; ROS time is not negative, so the message is dropped: correct its publisher"
)]
pub struct ClockError(
    /// Seconds of the message, which are negative.
    pub i32,
);

impl RosTime {
    /// Topic of the clock.
    pub const TOPIC: &'static str = "/clock";

    /// Makes the time of a node from its parameter `use_sim_time`.
    pub fn new(use_sim_time: bool) -> Self {
        Self { simulated: use_sim_time, ..Self::default() }
    }

    /// Takes a value of `use_sim_time`; true where it has changed.
    pub fn set_simulated(&mut self, use_sim_time: bool) -> bool {
        std::mem::replace(&mut self.simulated, use_sim_time) != use_sim_time
    }

    /// True while the time is simulated.
    pub fn is_simulated(&self) -> bool {
        self.simulated
    }

    /// Takes a message of `/clock`, whose time is kept also while the system's is used. Returns by
    /// how much simulated time went back, where it did: the simulation was reset, or the recording
    /// began anew. Buffers and deadlines that are kept by time are to be dropped then.
    ///
    /// # Errors
    /// When the time of the message is negative. The node's time stays.
    pub fn on_clock(&mut self, message: &Clock) -> Result<Option<Duration>, ClockError> {
        let clock = &message.clock;
        if clock.sec < 0 {
            return Err(ClockError(clock.sec));
        }
        // Both are 32 bits: their sum fits. Nanoseconds beyond a second are carried.
        let now = i64::from(clock.sec) * SECOND + i64::from(clock.nanosec);
        let before = self.clock_ns.replace(now).unwrap_or(0);
        let went_back = self.simulated && now < before;
        Ok(went_back.then(|| Duration::from_nanos(now.abs_diff(before))))
    }

    /// Time of the node, given the `system` time.
    pub fn now(&self, system: Stamp) -> Stamp {
        if !self.simulated {
            return system;
        }
        let ns = self.clock_ns.unwrap_or(0);
        // Carried nanoseconds can lead beyond the last second that a stamp can hold.
        let (sec, nanosec) = (i32::try_from(ns / SECOND), u32::try_from(ns % SECOND));
        Stamp { sec: sec.unwrap_or(i32::MAX), nanosec: nanosec.unwrap_or(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use wrapyfi_interfaces::builtin_interfaces::msg::Time;

    const SYSTEM: Stamp = Stamp { sec: 1_700_000_000, nanosec: 5 };

    fn clock(sec: i32, nanosec: u32) -> Clock {
        Clock { clock: Time { sec, nanosec } }
    }

    #[test]
    fn simulated_time_is_zero_until_the_first_clock() {
        let mut time = RosTime::new(true);
        assert_eq!(time.now(SYSTEM), Stamp::default());
        assert_eq!(time.on_clock(&clock(7, 9)), Ok(None));
        assert_eq!(time.on_clock(&clock(7, 9)), Ok(None));
        assert_eq!(time.now(SYSTEM), Stamp { sec: 7, nanosec: 9 });
        assert_eq!(time.on_clock(&clock(7, 8)), Ok(Some(Duration::from_nanos(1))));
    }

    #[test]
    fn use_sim_time_switches_while_the_node_runs() {
        let mut time = RosTime::new(false);
        assert_eq!(time.on_clock(&clock(3, 0)), Ok(None));
        assert_eq!(time.now(SYSTEM), SYSTEM);
        assert!(!time.set_simulated(false));
        assert!(time.set_simulated(true));
        assert_eq!(time.now(SYSTEM), Stamp { sec: 3, nanosec: 0 });
        assert_eq!(time.on_clock(&clock(1, 0)), Ok(Some(Duration::from_secs(2))));
        assert!(time.set_simulated(false));
        assert!(!time.is_simulated());
        assert_eq!(time.now(SYSTEM), SYSTEM);
    }

    #[test]
    fn odd_clocks_do_no_harm() {
        let mut time = RosTime::new(true);
        time.on_clock(&clock(1, 0)).unwrap();
        let error = time.on_clock(&clock(-1, 0)).unwrap_err();
        assert!(error.to_string().starts_with("/clock says -1 s"));
        assert_eq!(time.now(SYSTEM).sec, 1);
        // Nanoseconds beyond a second are carried.
        time.on_clock(&clock(1, 2_500_000_000)).unwrap();
        assert_eq!(time.now(SYSTEM), Stamp { sec: 3, nanosec: 500_000_000 });
        time.on_clock(&clock(i32::MAX, u32::MAX)).unwrap();
        assert_eq!(time.now(SYSTEM).sec, i32::MAX);
    }

    proptest! {
        #[test]
        fn steps_back_are_told(clocks in proptest::collection::vec((0..i32::MAX - 1, 0..1_000_000_000_u32), 1..20)) {
            let mut time = RosTime::new(true);
            for (sec, nanosec) in clocks {
                let (before, now) = (time.now(SYSTEM), Stamp { sec, nanosec });
                let back = time.on_clock(&clock(sec, nanosec)).unwrap();
                prop_assert_eq!(time.now(SYSTEM), now);
                let ns = |at: Stamp| i128::from(at.sec) * 1_000_000_000 + i128::from(at.nanosec);
                let by = ns(before) - ns(now);
                prop_assert_eq!(back.map(|by| by.as_nanos() as i128), (by > 0).then_some(by));
            }
        }
    }
}
