//! The demo's camera, microphone and object publisher, each a thread with its own socket.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_core::codec::jpeg;
use wrapyfi_core::endpoint::{Context, Middleware, Publisher, TopicSpec};
use wrapyfi_core::types::{
    AudioChunk, CompressedFormat, Encoding, Image, Map, MessageType, Payload, Pixels, RawPixels,
    SampleFormat, Stamp, Tensor, Value,
};

const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;
const SAMPLE_RATE: u32 = 44_100;
/// A tenth of a second of sound.
const FRAMES: u32 = SAMPLE_RATE / 10;

/// Running sources; dropping it stops them.
pub(super) struct Sources {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

type Make = fn(u64) -> anyhow::Result<Payload>;

impl Sources {
    pub(super) fn start(middleware: &dyn Middleware) -> anyhow::Result<Self> {
        let mut sources = Self { stop: Arc::default(), threads: Vec::new() };
        let all: [(&str, MessageType, u64, Make); 5] = [
            ("/demo/camera", MessageType::Image, 30, frame),
            ("/demo/jpeg", MessageType::CompressedImage, 10, jpeg_frame),
            ("/demo/microphone", MessageType::AudioChunk, 10, sound),
            ("/demo/object", MessageType::NativeObject, 10, object),
            ("/demo/text", MessageType::NativeObject, 10, object),
        ];
        for (topic, message_type, rate_hz, make) in all {
            let context = Context::default();
            let publisher =
                middleware.open_publisher(&TopicSpec::new(topic, message_type), &context)?;
            let stop = Arc::clone(&sources.stop);
            let interval = Duration::from_secs(1) / u32::try_from(rate_hz)?;
            let thread = std::thread::Builder::new()
                .name(topic.to_owned())
                .spawn(move || publish(publisher, interval, make, &stop))
                .context("cannot start a source")?;
            sources.threads.push(thread);
        }
        Ok(sources)
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

/// A colour wheel that turns, so that a wrong channel order or a torn frame is seen at once.
fn pixels(sequence: u64) -> anyhow::Result<RawPixels> {
    let shift = u32::try_from(sequence % 256)?;
    let byte = |value: u32| u8::try_from(value % 256).unwrap_or_default();
    let mut data = Vec::with_capacity((WIDTH * HEIGHT * 3) as usize);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            data.extend([byte(x * 256 / WIDTH + shift), byte(y * 256 / HEIGHT), byte(255 - shift)]);
        }
    }
    Ok(RawPixels::new(WIDTH, HEIGHT, Encoding::Bgr8, WIDTH * 3, data)?)
}

fn frame(sequence: u64) -> anyhow::Result<Payload> {
    let pixels = Pixels::Raw(pixels(sequence)?);
    Ok(Payload::Image(Image { stamp: Stamp::now(), frame_id: String::new(), pixels }))
}

fn jpeg_frame(sequence: u64) -> anyhow::Result<Payload> {
    let data = jpeg::encode(&pixels(sequence)?, 95)?;
    let pixels = Pixels::Compressed { format: CompressedFormat::Jpeg, data };
    Ok(Payload::Image(Image { stamp: Stamp::now(), frame_id: String::new(), pixels }))
}

/// A 440 Hz tone.
fn sound(sequence: u64) -> anyhow::Result<Payload> {
    let first = sequence * u64::from(FRAMES);
    let sample = |index: u64| {
        let turns = (first + index) as f64 * 440.0 / f64::from(SAMPLE_RATE);
        (0.5 * (turns * std::f64::consts::TAU).sin()) as f32
    };
    let data: Vec<u8> =
        (0..u64::from(FRAMES)).flat_map(|index| sample(index).to_le_bytes()).collect();
    let chunk = AudioChunk::new(Stamp::now(), FRAMES, 1, SAMPLE_RATE, SampleFormat::F32Le, data)?;
    Ok(Payload::AudioChunk(chunk))
}

/// What a Python script would send as `{"sequence": ..., "sent_at": time.time(), "joints": np.array(...)}`.
fn object(sequence: u64) -> anyhow::Result<Payload> {
    let joints: Vec<f64> = (0..6).map(|joint| f64::from(joint) * 0.1 + sequence as f64).collect();
    let mut map = Map::default();
    map.insert(Value::from("sequence"), Value::Int(i64::try_from(sequence)?));
    map.insert(Value::from(super::viewer::SENT_AT), Value::Float(Stamp::now().as_secs_f64()));
    map.insert(Value::from("label"), Value::from("grüße"));
    map.insert(Value::from("joints"), Value::Tensor(Tensor::from_elements(&[6], joints)?));
    Ok(Payload::NativeObject(Box::new(Value::Map(map))))
}
