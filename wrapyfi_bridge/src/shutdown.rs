//! SIGINT and SIGTERM, turned into a flag that every loop looks at.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGINT, SIGTERM};

/// Set once the process is asked to end.
#[derive(Debug, Clone, Default)]
pub struct Shutdown(Arc<AtomicBool>);

/// How often a waiting command looks at the flag.
const LOOK_EVERY: Duration = Duration::from_millis(50);

impl Shutdown {
    /// Catches SIGINT and SIGTERM. A second one ends the process at once.
    ///
    /// # Errors
    /// When the system refuses a handler.
    pub fn on_signals() -> std::io::Result<Self> {
        let shutdown = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // Order matters: the second signal finds the flag set and exits.
            signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&shutdown.0))?;
            signal_hook::flag::register(signal, Arc::clone(&shutdown.0))?;
        }
        Ok(shutdown)
    }

    /// True once the process should end.
    #[must_use]
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Waits until asked to end or until `deadline`; true when asked to end.
    pub fn wait_until(&self, deadline: Option<Instant>) -> bool {
        loop {
            if self.requested() {
                return true;
            }
            let now = Instant::now();
            let rest = deadline.map_or(LOOK_EVERY, |at| at.saturating_duration_since(now));
            if rest.is_zero() {
                return false;
            }
            std::thread::sleep(rest.min(LOOK_EVERY));
        }
    }
}
