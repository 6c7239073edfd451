//! The demo's ROS 2 node: receives every topic and calls the service as any node would, and measures.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_data::types::{Payload, Stamp, Value};
use wrapyfi_endpoint::{Context, Listener, Middleware, TopicSpec, Wake};

use super::caller::Caller;
use super::routes::{self, LIGHT, LIGHT_SERVICE, TOPICS, Topic};
use super::scenes::SENT_AT;
use super::tally::Tally;
use crate::shutdown::Shutdown;

/// Listens to the demo's topics, and calls its service.
pub(super) struct Viewer {
    wake: Wake,
    topics: Vec<Seen>,
    caller: Caller,
}

/// A topic and what was seen of it.
struct Seen {
    topic: &'static Topic,
    listener: Box<dyn Listener>,
    tally: Tally,
}

impl Viewer {
    pub(super) fn open(middleware: &dyn Middleware) -> anyhow::Result<Self> {
        let wake = Wake::new();
        let context = || Context { wake: wake.clone(), ..Context::default() };
        let open = |topic: &'static Topic| {
            let listener = middleware
                .open_listener(&TopicSpec::new(topic.to, topic.message_type), &context())
                .with_context(|| format!("viewer of {}", topic.to))?;
            anyhow::Ok(Seen { topic, listener, tally: Tally::default() })
        };
        let topics = TOPICS.iter().map(open).collect::<anyhow::Result<_>>()?;
        let caller = Caller::open(middleware, (LIGHT_SERVICE, routes::light()?), &context())?;
        Ok(Self { wake, topics, caller })
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
        let silent = self.topics.iter().filter(|seen| seen.tally.count == 0);
        let silent = silent
            .map(|Seen { topic, .. }| (topic.name, format!("nothing arrived on {}", topic.to)));
        silent.chain(self.caller.fault().map(|fault| (LIGHT, fault))).collect()
    }

    /// Table of the messages that arrived, with rates over `elapsed`, the time since the last call.
    pub(super) fn table(&mut self, elapsed: Duration) -> String {
        let mut out = format!(
            "{:<28}  {:<27} {:>6} {:>6} {:>6} {:>6} {:>6}\n",
            "a ROS 2 node receives", "type", "got", "Hz", "MB/s", "p50 ms", "p99 ms"
        );
        for Seen { topic: Topic { to, message_type, .. }, tally, .. } in &mut self.topics {
            tally.row(&mut out, to, &message_type.ros_type().replace("/msg", ""), elapsed);
        }
        let Caller { service, kind, tally, .. } = &mut self.caller;
        tally.row(&mut out, service, &kind.ros_type().replace("/srv", ""), elapsed);
        out
    }
}

impl Seen {
    fn drain(&mut self) {
        loop {
            match self.listener.take() {
                Ok(None) => return,
                Ok(Some(sample)) => {
                    let now = Stamp::now().as_secs_f64();
                    let age = sent_at(&sample.payload)
                        .map(|sent| Duration::try_from_secs_f64(now - sent).unwrap_or_default());
                    self.tally.add(sample.wire_bytes, age);
                }
                Err(error) => tracing::warn!("{}: {error}", self.topic.to),
            }
        }
    }
}

/// Time at which the source sent the message, in seconds since 1970.
fn sent_at(payload: &Payload) -> Option<f64> {
    match payload {
        Payload::Image(image) => Some(image.stamp.as_secs_f64()),
        Payload::AudioChunk(chunk) => Some(chunk.stamp.as_secs_f64()),
        Payload::NativeObject(object) => object.value.get(SENT_AT).and_then(Value::as_f64),
        _ => None,
    }
}
