//! A camera on one side, a display on the other.
//!
//! ```text
//!   --mode publish                                       --mode listen
//!   look() ◀─ folder of PNG files, V4L2, or drawn        look() ─▶ a line, a sketch, PNG files
//!      └────────── zeromq:/sensors/camera ──────────────────▲
//! ```
//!
//! Without a window: a program over SSH shows its sketch too. `test/peers/camera.py` is the same
//! program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use serde_json::{Value as Json, json};
use wrapyfi_communicator_examples::camera::Camera;
use wrapyfi_communicator_examples::{described_image, log_to_stderr, picture};
use wrapyfi_core::communicator::{Mode, communicator};
use wrapyfi_core::types::{Image, RawPixels};

/// Sends frames of a camera, or shows them.
#[derive(Parser)]
struct Options {
    /// publish, listen, or none: both in this program
    #[arg(long, default_value = "none")]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
    /// Topic
    #[arg(long, default_value = "/sensors/camera")]
    topic: String,
    /// Folder of PNG files, or /dev/video0 (built with --features v4l2); left out, frames are drawn
    #[arg(long)]
    source: Option<PathBuf>,
    /// Ends after the last file
    #[arg(long)]
    once: bool,
    /// Columns to ask a device for
    #[arg(long, default_value_t = 640)]
    width: u32,
    /// Rows to ask a device for
    #[arg(long, default_value_t = 480)]
    height: u32,
    /// Frames per second of files and drawings
    #[arg(long, default_value_t = 20.0)]
    rate: f64,
    /// Sends JPEG files
    #[arg(long)]
    jpg: bool,
    /// Shows frames as letters, so many in a line
    #[arg(long)]
    sketch: Option<u32>,
    /// Saves frames here, as 00001.png, 00002.png, …
    #[arg(long)]
    save: Option<PathBuf>,
}

#[derive(Default)]
struct Eye {
    camera: Option<Camera>,
    /// Fault for which there is no frame.
    fault: Option<anyhow::Error>,
    has_ended: bool,
}

#[communicator]
impl Eye {
    #[register(Image, "$mware", "Eye", "$topic", carrier = "tcp", rgb = true, jpg = "$jpg")]
    fn look(&mut self, mware: &str, topic: &str, jpg: bool) -> Option<Image> {
        _ = (mware, topic, jpg); // for #[register]
        match self.camera.as_mut()?.frame() {
            Ok(Some(frame)) => return Some(picture::taken_now(frame)),
            Ok(None) => self.has_ended = true,
            Err(fault) => self.fault = Some(fault),
        }
        None
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let options = Options::parse();
    let mut eye = Eye::default();
    let mut interval = None;
    if options.mode != Mode::Listen {
        let Options { source, once, width, height, rate, .. } = &options;
        let camera = Camera::open(source.as_deref(), !once, *width, *height)?;
        // A device keeps the pace by itself.
        if camera.is_unpaced() {
            let pause = Duration::try_from_secs_f64(rate.recip());
            interval = Some(pause.with_context(|| format!("--rate {rate} has no interval"))?);
        }
        eye.camera = Some(camera);
    }
    let mut eye = eye.communicator();
    eye.activate(EyeMethod::Look, options.mode)?;
    let mut shown = 0_u32;
    while !eye.inner().has_ended {
        let frame = eye.look(&options.mware, &options.topic, options.jpg)?.flatten();
        if let Some(fault) = eye.inner_mut().fault.take() {
            return Err(fault);
        }
        if let Some(frame) = frame {
            // A publisher that sends what is no picture must not end the program that looks.
            match picture::pixels(&frame) {
                Ok(pixels) => {
                    shown = shown.wrapping_add(1);
                    display(&frame, &pixels, shown, &options)?;
                }
                Err(reason) => tracing::warn!("a frame that cannot be shown: {reason:#}"),
            }
        }
        if let Some(interval) = interval {
            std::thread::sleep(interval);
        }
    }
    Ok(())
}

/// A line for each frame; a sketch and a file where asked for.
fn display(
    frame: &Image,
    pixels: &RawPixels,
    number: u32,
    options: &Options,
) -> anyhow::Result<()> {
    let mut told = described_image(frame);
    if let Some(folder) = &options.save {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let path = folder.join(format!("{number:05}.png"));
        picture::save(pixels, &path)?;
        if let Json::Object(told) = &mut told {
            told.insert("file".to_owned(), json!(path));
        }
    }
    if let Some(columns) = options.sketch {
        println!("{}", picture::sketch(pixels, columns));
    }
    if let Json::Object(told) = &mut told {
        told.insert("event".to_owned(), "message".into());
    }
    println!("{told}");
    Ok(())
}
