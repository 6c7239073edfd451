//! The demo's ROS 2 node: receives every topic and calls the service as any node would, and measures.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_core::endpoint::{
    Context, Latency, LatencySummary, Listener, Middleware, TopicSpec, Wake,
};
use wrapyfi_core::types::{MessageType, Payload, Stamp, Value};

use super::caller::Caller;
use super::routes::{self, LIGHT, LIGHT_SERVICE, TOPICS};
use super::scenes::SENT_AT;
use crate::shutdown::Shutdown;

/// Listens to the demo's topics, and calls its service.
pub(super) struct Viewer {
    wake: Wake,
    topics: Vec<Seen>,
    caller: Caller,
    called: (u64, u64),
}

/// A topic and what was seen of it.
struct Seen {
    route: &'static str,
    name: &'static str,
    message_type: MessageType,
    listener: Box<dyn Listener>,
    received: u64,
    bytes: u64,
    shown: (u64, u64),
    latency: Latency,
}

impl Viewer {
    pub(super) fn open(middleware: &dyn Middleware) -> anyhow::Result<Self> {
        let wake = Wake::new();
        let context = || Context { wake: wake.clone(), ..Context::default() };
        let open = |topic: &routes::Topic| {
            let listener = middleware
                .open_listener(&TopicSpec::new(topic.to, topic.message_type), &context())
                .with_context(|| format!("viewer of {}", topic.to))?;
            anyhow::Ok(Seen {
                route: topic.name,
                name: topic.to,
                message_type: topic.message_type,
                listener,
                received: 0,
                bytes: 0,
                shown: (0, 0),
                latency: Latency::default(),
            })
        };
        let topics = TOPICS.iter().map(open).collect::<anyhow::Result<_>>()?;
        let caller = Caller::open(middleware, (LIGHT_SERVICE, routes::light()?), &context())?;
        Ok(Self { wake, topics, caller, called: (0, 0) })
    }

    /// Receives and calls until `until`; true when the process was asked to end.
    pub(super) fn watch(&mut self, until: Instant, shutdown: &Shutdown) -> bool {
        loop {
            for topic in &mut self.topics {
                topic.drain();
            }
            self.caller.step(Instant::now());
            if shutdown.requested() {
                return true;
            }
            let rest = until.saturating_duration_since(Instant::now());
            if rest.is_zero() {
                return false;
            }
            self.wake.wait(rest.min(crate::command::WAIT_SLICE));
        }
    }

    /// Names of routes that did not deliver, and what is missing.
    pub(super) fn faults(&self) -> Vec<(&'static str, String)> {
        let silent = self.topics.iter().filter(|topic| topic.received == 0);
        let silent =
            silent.map(|topic| (topic.route, format!("nothing arrived on {}", topic.name)));
        silent.chain(self.caller.fault().map(|fault| (LIGHT, fault))).collect()
    }

    /// Table of the messages that arrived, with rates over `elapsed`, the time since the last call.
    pub(super) fn table(&mut self, elapsed: Duration) -> String {
        let mut out = format!(
            "{:<28}  {:<27} {:>6} {:>6} {:>6} {:>6} {:>6}\n",
            "a ROS 2 node receives", "type", "got", "Hz", "MB/s", "p50 ms", "p99 ms"
        );
        for topic in &mut self.topics {
            let total = (topic.received, topic.bytes);
            let before = std::mem::replace(&mut topic.shown, total);
            let type_name = topic.message_type.ros_type().replace("/msg", "");
            let latency = topic.latency.summary();
            row(&mut out, topic.name, &type_name, (before, total, elapsed), latency);
        }
        let total = self.caller.answered();
        let before = std::mem::replace(&mut self.called, total);
        let (name, type_name) = (self.caller.service(), self.caller.type_name());
        row(&mut out, name, &type_name, (before, total, elapsed), self.caller.latency());
        out
    }
}

/// Writes a row: how many and how many bytes there were before, are now, and the time between.
fn row(
    out: &mut String,
    name: &str,
    type_name: &str,
    (before, total, elapsed): ((u64, u64), (u64, u64), Duration),
    latency: LatencySummary,
) {
    let seconds = elapsed.as_secs_f64().max(1e-9);
    // Writing to a String cannot fail.
    let _infallible = writeln!(
        out,
        "{name:<28}  {type_name:<27} {:>6} {:>6.1} {:>6.2} {:>6.2} {:>6.2}",
        total.0,
        (total.0 - before.0) as f64 / seconds,
        (total.1 - before.1) as f64 / seconds / 1e6,
        latency.p50_us as f64 / 1e3,
        latency.p99_us as f64 / 1e3,
    );
}

impl Seen {
    fn drain(&mut self) {
        loop {
            match self.listener.take() {
                Ok(None) => return,
                Ok(Some(sample)) => {
                    self.received += 1;
                    self.bytes += sample.wire_bytes as u64;
                    if let Some(sent) = sent_at(&sample.payload) {
                        let now = Stamp::now().as_secs_f64();
                        self.latency
                            .record(Duration::try_from_secs_f64(now - sent).unwrap_or_default());
                    }
                }
                Err(error) => tracing::warn!("{}: {error}", self.name),
            }
        }
    }
}

/// Time at which the source sent the message, in seconds since 1970.
fn sent_at(payload: &Payload) -> Option<f64> {
    match payload {
        Payload::Image(image) => Some(image.stamp.as_secs_f64()),
        Payload::AudioChunk(chunk) => Some(chunk.stamp.as_secs_f64()),
        Payload::NativeObject(object) => match &object.value {
            Value::Map(map) => match map.get(SENT_AT) {
                Some(Value::Float(seconds)) => Some(*seconds),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    }
}
