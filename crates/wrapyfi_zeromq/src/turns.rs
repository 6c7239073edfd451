//! The life of a broker's thread: turn after turn, until it is told to stop.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread::JoinHandle;
use std::time::Instant;

use super::options::StopSignal;
use wrapyfi_endpoint::Throttle;
use wrapyfi_endpoint::backoff::Backoff;

/// A broker at work.
pub(super) trait Turns: Sized + Send + 'static {
    /// Name of the broker in logs.
    const NAME: &'static str;

    /// Waits for something to happen, and handles it; false when it is time to stop.
    fn turn(&mut self) -> zmq::Result<bool>;

    /// Socket that stops the broker when it is written to.
    fn stop(&self) -> &zmq::Socket;

    /// Shows the reason why the broker does not work now; `None` when it does again.
    fn failed(&mut self, why: Option<String>);

    /// Ends the broker, which takes no more turns.
    fn end(self) {}
}

/// The thread of a broker, which is told to stop when this is dropped.
#[derive(Debug)]
pub(super) struct Runs {
    stop_signal: StopSignal,
    broker: &'static str,
    thread: Option<JoinHandle<()>>,
}

impl Runs {
    /// Starts the thread `name` of a broker, whose stop socket `stop_signal` rings.
    pub(super) fn start<T: Turns>(
        name: &str,
        stop_signal: StopSignal,
        mut broker: T,
    ) -> std::io::Result<Self> {
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            run(&mut broker);
            broker.end();
        })?;
        Ok(Self { stop_signal, broker: T::NAME, thread: Some(thread) })
    }
}

impl Drop for Runs {
    fn drop(&mut self) {
        self.stop_signal.ring();
        match self.thread.take().map(JoinHandle::join) {
            Some(Err(_)) => tracing::error!("{} panicked at its end", self.broker),
            _ => tracing::debug!("{} ended", self.broker),
        }
    }
}

/// Runs turns until the broker is told to stop. A fault, a panic too, is logged; the next turn
/// follows after a pause.
fn run<T: Turns>(broker: &mut T) {
    let (mut backoff, mut faults) = (Backoff::of_process(1), Throttle::default());
    loop {
        let fault = match catch_unwind(AssertUnwindSafe(|| broker.turn())) {
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
        if !matches!(broker.stop().poll(zmq::POLLIN, pause), Ok(0)) {
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
        stop: zmq::Socket,
        failures: Vec<Option<String>>,
    }

    impl Turns for Scripted {
        const NAME: &'static str = "a script";

        fn turn(&mut self) -> zmq::Result<bool> {
            self.outcomes.remove(0)()
        }

        fn stop(&self) -> &zmq::Socket {
            &self.stop
        }

        fn failed(&mut self, why: Option<String>) {
            self.failures.push(why);
        }
    }

    #[test]
    fn faults_and_panics_do_not_end_it() {
        let stop = zmq::Context::new().socket(zmq::PAIR).unwrap();
        let outcomes: [fn() -> zmq::Result<bool>; 5] = [
            || Ok(true),
            || Err(zmq::Error::EINTR),
            || panic!("on purpose"),
            || Err(zmq::Error::ENOTSOCK),
            || Ok(false),
        ];
        let mut broker = Scripted { outcomes: outcomes.into(), stop, failures: Vec::new() };
        run(&mut broker);
        let said = zmq::Error::ENOTSOCK.to_string();
        let expected = [Some("a panic".to_owned()), None, Some(said), None];
        assert_eq!(broker.failures, expected);
        assert!(broker.outcomes.is_empty());
    }
}
