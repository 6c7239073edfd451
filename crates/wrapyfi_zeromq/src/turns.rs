//! The life of a broker's thread: turn after turn, until it is told to stop.

use std::os::fd::AsRawFd as _;
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread::JoinHandle;
use std::time::Instant;

use wrapyfi_endpoint::Throttle;
use wrapyfi_endpoint::backoff::Backoff;

/// A broker at work.
pub(super) trait Turns: Sized + Send + 'static {
    /// Name of the broker in logs.
    const NAME: &'static str;

    /// Waits for something to happen, and handles it; false when it is time to stop, which is when `stop` is readable.
    fn turn(&mut self, stop: &Stop) -> zmq::Result<bool>;

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

    pub(super) fn poll_item(&self) -> zmq::PollItem<'_> {
        zmq::PollItem::from_fd(self.0.as_raw_fd(), zmq::POLLIN)
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
            Ok(Ok(false) | Err(zmq::Error::ETERM)) => return,
            Ok(Err(zmq::Error::EINTR | zmq::Error::EAGAIN)) => continue,
            Ok(Err(error)) => error.to_string(),
            Err(_) => "a panic".to_owned(),
        };
        if let Some(unlogged_before) = faults.pass(Instant::now()) {
            tracing::error!(unlogged_before, "{fault} in {}: it goes on after a pause", T::NAME);
        }
        broker.failed(Some(fault));
        // Not asleep: it may be told to end.
        let pause = i64::try_from(backoff.wait().as_millis()).unwrap_or(0);
        if !matches!(zmq::poll(&mut [stop.poll_item()], pause), Ok(0)) {
            return;
        }
        broker.failed(None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Scripted {
        outcomes: Vec<fn() -> zmq::Result<bool>>,
        failures: Vec<Option<String>>,
    }

    impl Turns for Scripted {
        const NAME: &'static str = "a script";

        fn turn(&mut self, _: &Stop) -> zmq::Result<bool> {
            self.outcomes.remove(0)()
        }

        fn failed(&mut self, why: Option<String>) {
            self.failures.push(why);
        }
    }

    #[test]
    fn faults_and_panics_do_not_end_it() {
        let (_running, stop) = Stop::pair().unwrap();
        let outcomes: [fn() -> zmq::Result<bool>; 5] = [
            || Ok(true),
            || Err(zmq::Error::EINTR),
            || panic!("on purpose"),
            || Err(zmq::Error::ENOTSOCK),
            || Ok(false),
        ];
        let mut broker = Scripted { outcomes: outcomes.into(), failures: Vec::new() };
        run(&mut broker, &stop);
        let said = zmq::Error::ENOTSOCK.to_string();
        let expected = [Some("a panic".to_owned()), None, Some(said), None];
        assert_eq!(broker.failures, expected);
        assert!(broker.outcomes.is_empty());
    }
}
