//! The time that endpoints and routes go by.
//!
//! Deadlines, expiry, back-off and ages are told by [`Clock::now`], so that a simulation can say what time it is. A
//! thread that waits in the system, for a socket or a process, goes by the system's time: nothing else would end
//! its wait. So the I/O threads of the middlewares do, their brokers and their tasks.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_data::types::Stamp;

/// The time of a node at one moment.
///
/// ```
/// use wrapyfi_endpoint::{Clock, RosNow};
/// use wrapyfi_data::types::Stamp;
/// let stamp = Stamp { sec: 12, nanosec: 0 };
/// let clock = Clock::default().with_ros_time(move || RosNow { stamp, simulated: true });
/// assert_eq!(clock.ros_now(), RosNow { stamp, simulated: true });
/// assert!(!Clock::default().ros_now().simulated);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RosNow {
    /// The time.
    pub stamp: Stamp,
    /// True for time from `/clock`, false for that of the system.
    pub simulated: bool,
}

/// A monotonic clock, and the one of the node; both the system's by default.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use std::time::{Duration, Instant};
/// use wrapyfi_core::endpoint::Clock;
/// let noon = Instant::now();
/// let clock = Clock::new(move || noon + Duration::from_secs(60));
/// assert_eq!(clock.age(noon), Duration::from_secs(60));
/// ```
#[derive(Clone, Default)]
pub struct Clock {
    now: Option<Arc<dyn Fn() -> Instant + Send + Sync>>,
    ros_now: Option<Arc<dyn Fn() -> RosNow + Send + Sync>>,
}

impl Clock {
    /// A clock that shows what `now` returns, which never goes back.
    pub fn new(now: impl Fn() -> Instant + Send + Sync + 'static) -> Self {
        Self { now: Some(Arc::new(now)), ros_now: None }
    }

    /// Sets the time in headers, that of a node.
    #[doc(hidden)]
    #[must_use]
    pub fn with_ros_time(self, now: impl Fn() -> RosNow + Send + Sync + 'static) -> Self {
        Self { ros_now: Some(Arc::new(now)), ..self }
    }

    /// Time that decides: of deadlines, expiry and back-off.
    pub fn now(&self) -> Instant {
        self.now.as_ref().map_or_else(Instant::now, |now| now())
    }

    /// Time since `then`; none where that is to come.
    pub fn age(&self, then: Instant) -> Duration {
        self.now().saturating_duration_since(then)
    }

    /// Time in headers.
    #[doc(hidden)]
    pub fn ros_now(&self) -> RosNow {
        let system = || RosNow { stamp: Stamp::now(), simulated: false };
        self.ros_now.as_ref().map_or_else(system, |now| now())
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Clock").field(&self.now()).field(&self.ros_now()).finish()
    }
}
