//! SIGINT and SIGTERM, turned into a flag that every loop looks at.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Set once the process is asked to end.
#[derive(Debug, Clone, Default)]
pub struct Shutdown(Arc<AtomicBool>);

/// How long after the first signal others mean the same.
const SAME_WISH: Duration = Duration::from_secs(1);
/// How often a waiting command looks at the flag.
const LOOK_EVERY: Duration = Duration::from_millis(50);

impl Shutdown {
    /// Catches SIGINT and SIGTERM. One that comes a second after the first, or later, ends the process at once
    /// with exit code 1; one that comes earlier is the same wish: a supervisor signals the group of processes,
    /// and `ros2 launch` in it passes the signal on.
    ///
    /// # Errors
    /// When the system refuses a handler or a thread.
    pub fn on_signals() -> std::io::Result<Self> {
        let shutdown = Self::default();
        let flag = Arc::clone(&shutdown.0);
        let mut signals = Signals::new([SIGINT, SIGTERM])?;
        std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
            let mut first = None;
            for _signal in signals.forever() {
                if first.get_or_insert_with(Instant::now).elapsed() >= SAME_WISH {
                    signal_hook::low_level::exit(1);
                }
                flag.store(true, Ordering::Relaxed);
            }
        })?;
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
