//! The demo's ROS 2 node: receives every topic as any node would, and measures.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_core::endpoint::{Context, Latency, Listener, Middleware, TopicSpec, Wake};
use wrapyfi_core::types::{MessageType, Payload, Stamp, Value};

use crate::shutdown::Shutdown;

/// Key under which the demo's objects carry the time they were sent.
pub(super) const SENT_AT: &str = "sent_at";

/// Listens to the demo's topics.
pub(super) struct Viewer {
    wake: Wake,
    topics: Vec<Topic>,
}

struct Topic {
    name: &'static str,
    message_type: MessageType,
    listener: Box<dyn Listener>,
    received: u64,
    bytes: u64,
    shown: (u64, u64),
    latency: Latency,
}

impl Viewer {
    pub(super) fn open(
        middleware: &dyn Middleware,
        routes: &[(&'static str, &'static str, &'static str, MessageType)],
    ) -> anyhow::Result<Self> {
        let wake = Wake::new();
        let open = |&(_, _, name, message_type): &(&str, &str, &'static str, MessageType)| {
            let context = Context { wake: wake.clone(), ..Context::default() };
            let listener = middleware
                .open_listener(&TopicSpec::new(name, message_type), &context)
                .with_context(|| format!("viewer of {name}"))?;
            let latency = Latency::default();
            anyhow::Ok(Topic {
                name,
                message_type,
                listener,
                received: 0,
                bytes: 0,
                shown: (0, 0),
                latency,
            })
        };
        let topics = routes.iter().map(open).collect::<anyhow::Result<_>>()?;
        Ok(Self { wake, topics })
    }

    /// Receives until `until`; true when the process was asked to end.
    pub(super) fn watch(&mut self, until: Instant, shutdown: &Shutdown) -> bool {
        loop {
            for topic in &mut self.topics {
                topic.drain();
            }
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

    /// Topics on which nothing arrived.
    pub(super) fn silent(&self) -> Vec<&'static str> {
        self.topics.iter().filter(|topic| topic.received == 0).map(|topic| topic.name).collect()
    }

    /// What arrived, with rates over the time since the last call.
    pub(super) fn table(&mut self, elapsed: Duration) -> String {
        let seconds = elapsed.as_secs_f64().max(1e-9);
        let mut out = format!(
            "{:<28}  {:<27} {:>6} {:>6} {:>6} {:>6} {:>6}\n",
            "a ROS 2 node receives", "type", "got", "Hz", "MB/s", "p50 ms", "p99 ms"
        );
        for topic in &mut self.topics {
            let (received, bytes) =
                std::mem::replace(&mut topic.shown, (topic.received, topic.bytes));
            let latency = topic.latency.summary();
            // Writing to a String cannot fail.
            let _infallible = writeln!(
                out,
                "{:<28}  {:<27} {:>6} {:>6.1} {:>6.2} {:>6.2} {:>6.2}",
                topic.name,
                topic.message_type.ros_type().replace("/msg", ""),
                topic.received,
                (topic.received - received) as f64 / seconds,
                (topic.bytes - bytes) as f64 / seconds / 1e6,
                latency.p50_us as f64 / 1e3,
                latency.p99_us as f64 / 1e3,
            );
        }
        out
    }
}

impl Topic {
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

/// When the source sent it, in seconds since 1970.
fn sent_at(payload: &Payload) -> Option<f64> {
    match payload {
        Payload::Image(image) => Some(image.stamp.as_secs_f64()),
        Payload::AudioChunk(chunk) => Some(chunk.stamp.as_secs_f64()),
        Payload::NativeObject(value) => match value.as_ref() {
            Value::Map(map) => match map.get(SENT_AT) {
                Some(Value::Float(seconds)) => Some(*seconds),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    }
}
