//! The life of a broker's thread: turn after turn, until it is told to stop.

use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::options;
use wrapyfi_endpoint::Throttle;
use wrapyfi_endpoint::backoff::Backoff;

/// A broker at work.
pub(super) trait Turns: Sized + Send + 'static {
    /// Name of the broker in logs.
    const NAME: &'static str;

    /// Waits for something to happen, and handles it; false when it is time to stop, which is when `stop` is readable.
    fn turn(&mut self, stop: &Stop) -> std::io::Result<bool>;

    /// Shows the reason why the broker does not work now; `None` when it does again.
    fn failed(&mut self, why: Option<String>);

    /// Ends the broker, which takes no more turns.
    fn end(self) {}
}

/// The end that a broker's thread has of the connection that is closed to stop it.
pub(super) struct Stop(UnixStream);

impl Stop {
    /// The end that keeps a thread running, and the one that this thread has.
    pub(super) fn pair() -> std::io::Result<(UnixStream, Self)> {
        let (running, stop) = UnixStream::pair()?;
        Ok((running, Self(stop)))
    }

    /// Waits at most `time`; true when it is time to stop.
    pub(super) fn within(&self, time: Duration) -> std::io::Result<bool> {
        options::readable([self.as_fd()], time).map(|[stops]| stops)
    }
}

impl AsFd for Stop {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// The thread of a broker, which is told to stop when this is dropped.
#[derive(Debug)]
pub(super) struct Runs {
    running: Option<UnixStream>,
    broker: &'static str,
    thread: Option<JoinHandle<()>>,
}

impl Runs {
    /// Starts the thread `name` of a broker.
    pub(super) fn start<T: Turns>(name: &str, mut broker: T) -> std::io::Result<Self> {
        let (running, stop) = Stop::pair()?;
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            run(&mut broker, &stop);
            broker.end();
        })?;
        Ok(Self { running: Some(running), broker: T::NAME, thread: Some(thread) })
    }
}

impl Drop for Runs {
    fn drop(&mut self) {
        drop(self.running.take());
        match self.thread.take().map(JoinHandle::join) {
            Some(Err(_)) => tracing::error!("{} panicked at its end", self.broker),
            _ => tracing::debug!("{} ended", self.broker),
        }
    }
}

/// Runs turns until the broker is told to stop. A fault, a panic too, is logged; the next turn
/// follows after a pause.
fn run<T: Turns>(broker: &mut T, stop: &Stop) {
    let (mut backoff, mut faults) = (Backoff::of_process(1), Throttle::default());
    loop {
        let fault = match catch_unwind(AssertUnwindSafe(|| broker.turn(stop))) {
            Ok(Ok(true)) => {
                backoff.reset();
                continue;
            }
            Ok(Ok(false)) => return,
            Ok(Err(error)) => error.to_string(),
            Err(_) => "a panic".to_owned(),
        };
        if let Some(unlogged_before) = faults.pass(Instant::now()) {
            tracing::error!(unlogged_before, "{fault} in {}: it goes on after a pause", T::NAME);
        }
        broker.failed(Some(fault));
        // Not asleep: it may be told to end.
        if !matches!(stop.within(backoff.wait()), Ok(false)) {
            return;
        }
        broker.failed(None);
    }
}

#[cfg(test)]
mod tests {
    use std::io::ErrorKind;

    use super::*;

    struct Scripted {
        outcomes: Vec<fn() -> std::io::Result<bool>>,
        failures: Vec<Option<String>>,
    }

    impl Turns for Scripted {
        const NAME: &'static str = "a script";

        fn turn(&mut self, _: &Stop) -> std::io::Result<bool> {
            self.outcomes.remove(0)()
        }

        fn failed(&mut self, why: Option<String>) {
            self.failures.push(why);
        }
    }

    #[test]
    fn faults_and_panics_do_not_end_it() {
        let (_running, stop) = Stop::pair().unwrap();
        let outcomes: [fn() -> std::io::Result<bool>; 4] = [
            || Ok(true),
            || panic!("on purpose"),
            || Err(ErrorKind::NotConnected.into()),
            || Ok(false),
        ];
        let mut broker = Scripted { outcomes: outcomes.into(), failures: Vec::new() };
        run(&mut broker, &stop);
        let said = std::io::Error::from(ErrorKind::NotConnected).to_string();
        let expected = [Some("a panic".to_owned()), None, Some(said), None];
        assert_eq!(broker.failures, expected);
        assert!(broker.outcomes.is_empty());
    }
}
