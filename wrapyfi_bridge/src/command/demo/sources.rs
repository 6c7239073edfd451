//! The demo's sources: threads that publish and one that serves, each with its own socket or port.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_data::types::{MessageType, Payload};
use wrapyfi_endpoint::{
    Context, EndpointAddress, Publisher, Registry, ServiceSpec, TopicSpec, Wake,
};

use super::{robot, routes, scenes};

/// Running sources; dropping it stops them.
pub(super) struct Sources {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

type Make = fn(u64) -> anyhow::Result<Payload>;

/// Publishers of the demo: endpoint, type, messages per second, and the function that makes a
/// message.
const PUBLISHERS: [(&str, MessageType, u32, Make); 7] = [
    ("zeromq:/demo/camera", MessageType::Image, 30, scenes::frame),
    ("zeromq:/demo/jpeg", MessageType::CompressedImage, 10, scenes::jpeg_frame),
    ("zeromq:/demo/microphone", MessageType::AudioChunk, 10, scenes::sound),
    ("zeromq:/demo/object", MessageType::NativeObject, 10, scenes::object),
    ("zeromq:/demo/text", MessageType::NativeObject, 10, scenes::object),
    ("yarp:/robot/cam/left", MessageType::Image, 30, scenes::robot_frame),
    ("yarp:/robot/ears", MessageType::AudioChunk, 10, scenes::robot_sound),
];

impl Sources {
    /// Starts them on `middlewares`, which are not those of the bridge.
    pub(super) fn start(middlewares: &Registry) -> anyhow::Result<Self> {
        let mut sources = Self { stop: Arc::default(), threads: Vec::new() };
        for (address, message_type, rate_hz, make) in PUBLISHERS {
            let at: EndpointAddress = address.parse()?;
            let spec = TopicSpec::new(&at.name, message_type);
            let publisher =
                middlewares.get(&at.middleware)?.open_publisher(&spec, &Context::default())?;
            let stop = Arc::clone(&sources.stop);
            let interval = Duration::from_secs(1) / rate_hz;
            sources.spawn(address, move || publish(publisher, interval, make, &stop))?;
        }
        let at: EndpointAddress = routes::LIGHT_PORT.parse()?;
        let spec = ServiceSpec::new(&at.name, routes::light()?);
        let wake = Wake::new();
        let context = Context { wake: wake.clone(), ..Context::default() };
        let server = middlewares.get(&at.middleware)?.open_server(&spec, &context)?;
        let stop = Arc::clone(&sources.stop);
        sources.spawn(routes::LIGHT_PORT, move || robot::serve(server, &wake, &stop))?;
        Ok(sources)
    }

    fn spawn(&mut self, name: &str, run: impl FnOnce() + Send + 'static) -> anyhow::Result<()> {
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(run);
        self.threads.push(thread.context("cannot start a source")?);
        Ok(())
    }
}

impl Drop for Sources {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a demo source panicked");
            }
        }
    }
}

fn publish(mut publisher: Box<dyn Publisher>, interval: Duration, make: Make, stop: &AtomicBool) {
    while publisher.link().peers != Some(1) && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(10)); // as Wrapyfi's should_wait
    }
    let start = Instant::now();
    for sequence in 0.. {
        let due = start + interval * u32::try_from(sequence).unwrap_or(u32::MAX);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let sent = make(sequence).and_then(|payload| Ok(publisher.publish(&payload)?));
        if let Err(error) = sent {
            tracing::warn!("demo source: {error:#}");
        }
    }
}
