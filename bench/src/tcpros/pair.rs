//! A stream of images from our publisher to our listener, beside a bare stream of the same bytes.
//!
//! ```text
//!   near ══ images ═══▶ far        bare: tokio, one buffer      ours: two nodes of ROS 1
//!   near ◀─ a byte for each batch, over a connection of its own
//! ```

use std::io::{BufRead as _, Read as _, Write as _};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::runtime::Runtime;
use wrapyfi_core::endpoint::{
    Context, History, Listener, Middleware as _, Overflow, Publisher, TopicSpec,
};
use wrapyfi_core::middleware::ros1::{Ros1, Ros1Config};
use wrapyfi_core::types::Encoding;
use wrapyfi_core::types::{Image, MessageType, Payload, Pixels, RawPixels, Stamp};

use crate::clock;
use crate::worker::{Order, Report, micros, say};

/// Images of one batch: far acknowledges the last of them.
pub(super) const BATCH: u32 = 100;
const SIZE: (u32, u32) = (640, 480);
const TOPIC: &str = "/images";
/// Longest time that a node may look for the other.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Kind of the two ends' sockets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Pair {
    /// Sockets of tokio.
    Tokio,
    /// Our nodes.
    Ours,
}

impl Pair {
    /// Name on the command line and in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Tokio => "tokio",
            Self::Ours => "ours",
        }
    }
}

/// Addresses of the two ends.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Place {
    #[arg(long)]
    pub(crate) pair: Pair,
    /// Address of the master.
    #[arg(long)]
    pub(crate) master: String,
    /// Port that far listens on, which near is told.
    #[arg(long, default_value_t = 0)]
    pub(crate) peer: u16,
}

/// Report of far that near may come.
#[derive(Serialize, Deserialize)]
pub(super) struct Ready {
    pub(super) peer: u16,
}

fn runtime() -> Result<Runtime> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    Ok(builder.worker_threads(2).enable_all().build()?)
}

fn node(place: &Place, name: &str) -> Result<Ros1> {
    let config = Ros1Config {
        master_uri: place.master.clone(),
        hostname: Some(Ipv4Addr::LOCALHOST.to_string()),
        node: Some(format!("{name}{}", std::process::id())),
        ..Ros1Config::default()
    };
    Ok(Ros1::start(&config)?)
}

fn spec(place: &Place) -> TopicSpec {
    let mut spec = TopicSpec::new(topic(place), MessageType::Image);
    // Nothing may be dropped: what is measured is how fast all of it goes.
    spec.qos.history = History::KeepAll;
    spec.queue.overflow = Overflow::Block(TIMEOUT);
    spec
}

/// Topic of this turn alone: the master remembers nodes that ended without a word.
fn topic(place: &Place) -> String {
    format!("{TOPIC}_{}", place.peer)
}

fn pixels() -> Vec<u8> {
    vec![7; (SIZE.0 * SIZE.1 * 3) as usize]
}

/// Bytes of a message as our publisher sends it: size, fields, pixels.
fn message() -> Vec<u8> {
    let bytes = crate::ros1::image(SIZE.0, SIZE.1);
    [&(bytes.len() as u32).to_le_bytes()[..], &bytes].concat()
}

/// Runs far until its stdin ends.
pub(crate) fn far(place: &Place) -> Result<()> {
    std::thread::spawn(|| {
        let _end = std::io::stdin().read(&mut [0; 1]);
        std::process::exit(0);
    });
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    let peer = listener.local_addr()?.port();
    say(&serde_json::to_value(Ready { peer })?)?;
    let (told, _) = listener.accept()?;
    told.set_nodelay(true)?;
    match place.pair {
        Pair::Tokio => {
            let (stream, _) = listener.accept()?;
            runtime()?.block_on(async move { tokio::spawn(read_bare(stream, told)).await })?
        }
        Pair::Ours => {
            let place = Place { peer, ..place.clone() };
            let (ros1, context) = (node(&place, "far")?, Context::default());
            let listener = ros1.open_listener(&spec(&place), &context)?;
            read_ours(listener, &context, told)
        }
    }
}

async fn read_bare(stream: TcpStream, mut told: TcpStream) -> Result<()> {
    stream.set_nonblocking(true)?;
    let mut stream = tokio::net::TcpStream::from_std(stream)?;
    let mut image = message();
    loop {
        for _ in 0..BATCH {
            if stream.read_exact(&mut image).await.is_err() {
                return Ok(());
            }
        }
        told.write_all(&[1])?;
    }
}

/// Takes images as a program does, which share the memory of what was received.
fn read_ours(
    mut listener: Box<dyn Listener>,
    context: &Context,
    mut told: TcpStream,
) -> Result<()> {
    let mut left = BATCH;
    loop {
        let Some(sample) = listener.take()? else {
            context.wake.wait(Duration::from_secs(1));
            continue;
        };
        let Payload::Image(image) = &sample.payload else { continue };
        ensure!(matches!(image.pixels, Pixels::Raw(_)), "an image without pixels");
        left -= 1;
        if left == 0 {
            told.write_all(&[1])?;
            left = BATCH;
        }
    }
}

/// End that sends a batch.
enum Near {
    Bare(tokio::net::TcpStream, Vec<u8>, Runtime),
    Ours {
        // Before the node it came from: dropped in this order.
        publisher: Box<dyn Publisher>,
        image: Payload,
        _ros1: Ros1,
    },
}

impl Near {
    fn open(place: &Place) -> Result<Self> {
        if place.pair == Pair::Tokio {
            let runtime = runtime()?;
            let stream = runtime.block_on(async {
                let stream =
                    tokio::net::TcpStream::connect((Ipv4Addr::LOCALHOST, place.peer)).await?;
                stream.set_nodelay(true)?;
                anyhow::Ok(stream)
            })?;
            return Ok(Self::Bare(stream, message(), runtime));
        }
        let (ros1, context) = (node(place, "near")?, Context::default());
        let publisher = ros1.open_publisher(&spec(place), &context)?;
        let deadline = Instant::now() + TIMEOUT;
        while publisher.link().peers != Some(1) {
            ensure!(Instant::now() < deadline, "far does not subscribe");
            context.wake.wait(Duration::from_millis(100));
        }
        let (width, height) = SIZE;
        let pixels = RawPixels::dense(width, height, Encoding::Bgr8, pixels())?;
        let image = Image::new(Stamp::default(), pixels);
        Ok(Self::Ours { publisher, image: image.into(), _ros1: ros1 })
    }

    fn batch(&mut self) -> Result<()> {
        match self {
            Self::Bare(stream, image, runtime) => runtime.block_on(async {
                for _ in 0..BATCH {
                    stream.write_all(image).await?;
                }
                anyhow::Ok(())
            }),
            Self::Ours { publisher, image, .. } => {
                for _ in 0..BATCH {
                    publisher.publish(image)?;
                }
                Ok(())
            }
        }
    }
}

/// Runs near: obeys orders for batches, one under way at a time.
pub(crate) fn near(place: &Place) -> Result<()> {
    let mut told = TcpStream::connect((Ipv4Addr::LOCALHOST, place.peer))?;
    told.set_nodelay(true)?;
    told.set_read_timeout(Some(TIMEOUT))?;
    let mut near = Near::open(place)?;
    for line in std::io::stdin().lock().lines() {
        let count = match serde_json::from_str(&line?)? {
            Order::Warm => 1,
            Order::Paced { count, .. } | Order::Window { count, .. } => count,
        };
        let (mut report, begin) = (Report::default(), clock::now());
        for _ in 0..count {
            let start = clock::now();
            near.batch()?;
            told.read_exact(&mut [0]).context("a batch that did not arrive")?;
            report.sent += BATCH;
            report.received += BATCH;
            report.latency_us.push(micros(clock::now() - start) / f64::from(BATCH));
        }
        report.span_ns = clock::now() - begin;
        say(&serde_json::to_value(report)?)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_carry_as_many_bytes() {
        // Fields before the pixels: some 60 bytes.
        let (bare, pixels) = (message().len(), pixels().len());
        assert!((pixels..pixels + 100).contains(&bare), "{bare}");
    }
}
