//! SIGINT and SIGTERM, turned into a flag that every loop looks at.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use wrapyfi_data::Limits;

use crate::exit::{Failure, Result};
use crate::logging;

/// Set once the process is asked to end.
#[derive(Debug, Clone, Default)]
pub struct Shutdown(Arc<AtomicBool>);

/// Time after the first signal in which further signals mean the same.
const SAME_WISH: Duration = Duration::from_secs(1);
/// Longest time that ending in good order may take; the last word fits into the two seconds that
/// are promised.
const TIME_TO_END: Duration = Limits::SHUTDOWN.saturating_sub(Duration::from_millis(200));
const LAST_WORD: Duration = Duration::from_millis(50);
/// Time between two looks of a waiting command at the flag.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Ends the process with exit code 0 if it has not ended by itself when its time is over.
fn end_in_time() {
    let watch = std::thread::Builder::new().name("shutdown".to_owned()).spawn(|| {
        std::thread::sleep(TIME_TO_END);
        tracing::warn!("ends now: something did not end in time");
        logging::finish(LAST_WORD);
        signal_hook::low_level::exit(0);
    });
    if let Err(error) = watch {
        tracing::warn!(%error, "nobody watches that the process ends in time");
    }
}

impl Shutdown {
    /// Catches SIGINT and SIGTERM. A process in the middle of something that cannot be interrupted, such as
    /// waiting for a name server, ends all the same in time, with exit code 0. A signal that comes a second
    /// after the first, or later, ends the process at once with exit code 1; one that comes earlier is the same
    /// wish: a supervisor signals the group of processes, and `ros2 launch` in it passes the signal on.
    ///
    /// # Errors
    /// When the system refuses a handler or a thread.
    pub fn on_signals() -> std::io::Result<Self> {
        let shutdown = Self::default();
        let flag = Arc::clone(&shutdown.0);
        let mut signals = Signals::new([SIGINT, SIGTERM])?;
        std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
            let mut first: Option<Instant> = None;
            for _signal in signals.forever() {
                flag.store(true, Ordering::Relaxed);
                match first {
                    None => {
                        first = Some(Instant::now());
                        end_in_time();
                    }
                    Some(first) if first.elapsed() >= SAME_WISH => {
                        signal_hook::low_level::exit(1);
                    }
                    Some(_) => {}
                }
            }
        })?;
        Ok(shutdown)
    }

    /// Result of a program that runs until it is asked to end: where it was asked to while it
    /// started, a failure of the start is none.
    ///
    /// # Errors
    /// As `outcome`, where the process was not asked to end, or the settings are wrong.
    pub fn outcome(&self, outcome: Result<()>) -> Result<()> {
        match outcome {
            Err(failure @ (Failure::Absent(_) | Failure::Failed(_))) if self.requested() => {
                tracing::info!("ends while it starts: {failure}");
                Ok(())
            }
            other => other,
        }
    }

    /// Asks the process to end, as a signal does.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// True once the process should end.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Waits until asked to end or until `deadline`; true when asked to end.
    pub fn wait_until(&self, deadline: Instant) -> bool {
        loop {
            if self.requested() {
                return true;
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return false;
            }
            std::thread::sleep(rest.min(LOOK_EVERY));
        }
    }
}
