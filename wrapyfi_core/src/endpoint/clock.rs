//! The time of the node that routes run in.

use std::fmt;
use std::sync::Arc;

use crate::types::Stamp;

/// The time of a node at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RosNow {
    /// The time.
    pub stamp: Stamp,
    /// It comes from `/clock`, not from the system.
    pub simulated: bool,
}

/// The clock of a node; the system's by default.
#[derive(Clone)]
pub struct RosClock(Arc<dyn Fn() -> RosNow + Send + Sync>);

impl RosClock {
    /// A clock that shows what `now` returns.
    #[must_use]
    pub fn new(now: impl Fn() -> RosNow + Send + Sync + 'static) -> Self {
        Self(Arc::new(now))
    }

    /// What it shows.
    #[must_use]
    pub fn now(&self) -> RosNow {
        (self.0)()
    }
}

impl Default for RosClock {
    fn default() -> Self {
        Self::new(|| RosNow { stamp: Stamp::now(), simulated: false })
    }
}

impl fmt::Debug for RosClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("RosClock").field(&self.now()).finish()
    }
}
