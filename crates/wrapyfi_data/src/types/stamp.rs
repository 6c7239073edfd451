//! Points in time as ROS 2 writes them.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A point in time since 1970-01-01T00:00:00 UTC, laid out as `builtin_interfaces/msg/Time`.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::Stamp;
/// assert_eq!(Stamp::from_secs_f64(1.5), Stamp { sec: 1, nanosec: 500_000_000 });
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp {
    /// Whole seconds; negative before 1970.
    pub sec: i32,
    /// Nanoseconds to add to `sec`, below 1 000 000 000.
    pub nanosec: u32,
}

impl Stamp {
    /// The wall clock now; zero when the clock stands before 1970 or after 2038.
    pub fn now() -> Self {
        SystemTime::now().duration_since(UNIX_EPOCH).map_or_else(|_| Self::default(), Self::from)
    }

    /// Seconds since 1970 as Python's `time.time()` gives them; zero for values a
    /// `builtin_interfaces/msg/Time` cannot hold.
    pub fn from_secs_f64(seconds: f64) -> Self {
        if !(0.0..f64::from(i32::MAX)).contains(&seconds) {
            return Self::default();
        }
        Duration::try_from_secs_f64(seconds).map_or_else(|_| Self::default(), Self::from)
    }

    /// Seconds since 1970 with the precision of a double (about 0.2 µs today).
    pub fn as_secs_f64(self) -> f64 {
        f64::from(self.sec) + f64::from(self.nanosec) / 1e9
    }
}

impl From<Duration> for Stamp {
    fn from(since_epoch: Duration) -> Self {
        i32::try_from(since_epoch.as_secs()).map_or_else(
            |_| Self::default(),
            |sec| Self { sec, nanosec: since_epoch.subsec_nanos() },
        )
    }
}
