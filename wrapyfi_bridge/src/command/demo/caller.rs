//! The viewer's client: switches the robot's light once a second, as any node would.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Payload, ServiceKind, Value};
use wrapyfi_endpoint::{Client, Context, Middleware, Reply, Request, ServiceSpec, Ticket};

use super::tally::Tally;
use crate::canonical::canonical;

/// Time between calls.
const EVERY: Duration = Duration::from_secs(1);

/// Calls one service of ROS 2.
pub(super) struct Caller {
    pub(super) service: &'static str,
    pub(super) kind: ServiceKind,
    /// Answer, and the time that it took.
    pub(super) tally: Tally,
    client: Box<dyn Client>,
    under_way: Option<(Ticket, Instant)>,
    next: Instant,
    light: bool,
    failed: u64,
    last_failure: String,
}

impl Caller {
    pub(super) fn open(
        middleware: &dyn Middleware,
        (service, kind): (&'static str, ServiceKind),
        context: &Context,
    ) -> anyhow::Result<Self> {
        let client = middleware
            .open_client(&ServiceSpec::new(service, kind), context)
            .with_context(|| format!("client of {service}"))?;
        Ok(Self {
            service,
            kind,
            tally: Tally::default(),
            client,
            under_way: None,
            next: Instant::now(),
            light: false,
            failed: 0,
            last_failure: String::new(),
        })
    }

    /// Takes the reply that came, and calls where it is time to. One call is under way at a time.
    pub(super) fn step(&mut self, now: Instant) {
        while let Some((ticket, ended)) = self.client.take() {
            let sent_at = self.under_way.take_if(|(sent, _)| *sent == ticket).map(|(_, at)| at);
            match ended.map_err(|error| error.to_string()).and_then(|reply| agreed(&reply)) {
                Ok(bytes) => {
                    let took = sent_at.map(|at| now.saturating_duration_since(at));
                    self.tally.add(bytes, took);
                }
                Err(reason) => self.fail(reason),
            }
        }
        if self.under_way.is_some() || now < self.next {
            return;
        }
        self.next = now + EVERY;
        self.light = !self.light;
        match self.client.send(&Request::new([self.light.into()]), ServiceSpec::TIMEOUT) {
            Ok(ticket) => self.under_way = Some((ticket, now)),
            Err(error) => self.fail(error.to_string()),
        }
    }

    fn fail(&mut self, reason: String) {
        tracing::warn!("{}: {reason}", self.service);
        self.failed += 1;
        self.last_failure = reason;
    }

    /// Fault of the calls so far, in words; `None` where they are answered.
    pub(super) fn fault(&self) -> Option<String> {
        let Self { service, tally: Tally { count: answered, .. }, failed, last_failure, .. } = self;
        match (answered, failed) {
            (0, 0) => Some(format!("no call of {service} was answered")),
            (_, 0) => None,
            _ => Some(format!(
                "{failed} of {} calls of {service} failed, the last: {last_failure}",
                answered + failed
            )),
        }
    }
}

/// The size of a reply in which the robot did what it was asked.
fn agreed(reply: &Reply) -> Result<usize, String> {
    let value = match &reply.payload {
        Payload::NativeObject(object) => object.value.clone(),
        Payload::RosMessage(message) => message
            .to_value(Limits::default().message_bytes)
            .map_err(|error| format!("the robot's answer cannot be read: {error}"))?,
        other => return Err(format!("the robot answered a {}", other.data_type())),
    };
    match value.get("success").and_then(Value::as_bool) {
        Some(true) => Ok(reply.wire_bytes),
        _ => Err(format!("the robot answered {}", canonical(&value))),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use wrapyfi_endpoint::memory::Memory;

    use super::super::{robot, routes};
    use super::*;

    const DEADLINE: Duration = Duration::from_secs(20);

    fn caller(memory: &Memory) -> (Caller, Context) {
        let context = Context::default();
        let service = (routes::LIGHT_SERVICE, routes::light().unwrap());
        (Caller::open(memory, service, &context).unwrap(), context)
    }

    #[test]
    fn a_robot_that_answers_is_no_fault_and_is_called_once_a_second() {
        let memory = Memory::new("memory");
        let (mut caller, context) = caller(&memory);
        let served = Context::default();
        let spec = ServiceSpec::new(routes::LIGHT_SERVICE, routes::light().unwrap());
        let server = memory.open_server(&spec, &served).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let (wake, ended) = (served.wake.clone(), Arc::clone(&stop));
        let robot = std::thread::spawn(move || robot::serve(server, &wake, &ended));
        let begun = Instant::now();
        caller.step(begun);
        let until_answered = |caller: &mut Caller, count| {
            while caller.tally.count < count && begun.elapsed() < DEADLINE {
                context.wake.wait(Duration::from_millis(10));
                // The clock stands still: nothing more is due.
                caller.step(begun);
            }
            assert_eq!(caller.tally.count, count, "{:?}", caller.fault());
        };
        until_answered(&mut caller, 1);
        assert!(caller.under_way.is_none());
        caller.step(begun + EVERY);
        until_answered(&mut caller, 2);
        assert_eq!(caller.fault(), None);
        stop.store(true, Ordering::Relaxed);
        robot.join().unwrap();
    }

    #[test]
    fn calls_without_a_reply_are_a_fault_with_its_reason() {
        let memory = Memory::new("memory");
        let (mut caller, _context) = caller(&memory);
        caller.step(Instant::now());
        assert_eq!(caller.fault().as_deref(), Some("no call of /robot/light was answered"));
        caller.fail("nobody is there".to_owned());
        caller.tally.count = 3;
        let told = "1 of 4 calls of /robot/light failed, the last: nobody is there";
        assert_eq!(caller.fault().as_deref(), Some(told));
    }
}
