//! A microphone on one side, a loudspeaker on the other.
//!
//! ```text
//!   --mode publish --source voice.wav                     --mode listen --play heard.wav
//!   hear() ◀─ WAV file, or alsa:default                   hear() ─▶ WAV file, or alsa:default
//!      └────────── zeromq:/sensors/microphone ───────────────▲
//! ```
//!
//! `test/peers/microphone.py` is the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::time::Duration;

use anyhow::Context as _;
use clap::Parser;
use serde_json::Value as Json;
use wrapyfi_communicator_examples::audio::{Loudspeaker, Microphone, Sound};
use wrapyfi_communicator_examples::{described_sound, log_to_stderr};
use wrapyfi_core::communicator::{Mode, communicator};
use wrapyfi_core::types::AudioChunk;

/// Sends sound of a microphone, or plays it.
#[derive(Parser)]
struct Options {
    /// publish, listen, or none: both in this program
    #[arg(long, default_value = "none")]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
    /// Topic
    #[arg(long, default_value = "/sensors/microphone")]
    topic: String,
    /// WAV file, or a device of ALSA such as alsa:default (needs alsa-utils)
    #[arg(long, default_value = "alsa:default")]
    source: String,
    /// Ends after the last chunk of the file
    #[arg(long)]
    once: bool,
    /// WAV file to write, or a device of ALSA
    #[arg(long)]
    play: Option<String>,
    /// Samples per second of a device; a listener takes any
    #[arg(long, default_value_t = 16_000)]
    rate: u32,
    /// Channels of a device
    #[arg(long, default_value_t = 1)]
    channels: u8,
    /// Frames of a chunk
    #[arg(long, default_value_t = 1600)]
    chunk: u32,
}

#[derive(Default)]
struct Ear {
    microphone: Option<Microphone>,
    /// Fault for which there is no sound.
    fault: Option<anyhow::Error>,
    has_ended: bool,
}

#[communicator]
impl Ear {
    // A queue of some seconds: sound with holes is worse than late sound.
    #[register(
        AudioChunk,
        "$mware",
        "Ear",
        "$topic",
        carrier = "tcp",
        rate = -1,
        chunk = -1,
        queue_size = 100
    )]
    fn hear(&mut self, mware: &str, topic: &str) -> Option<AudioChunk> {
        _ = (mware, topic); // for #[register]
        match self.microphone.as_mut()?.chunk() {
            Ok(Some(chunk)) => return Some(chunk),
            Ok(None) => self.has_ended = true,
            Err(fault) => self.fault = Some(fault),
        }
        None
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let Options { mode, mware, topic, source, once, play, rate, channels, chunk } =
        Options::parse();
    let mut ear = Ear::default();
    let mut interval = None;
    if mode != Mode::Listen {
        let microphone = Microphone::open(&source, !once, Sound { rate, channels, chunk })?;
        // A device keeps the pace by itself.
        if microphone.is_file() {
            let seconds = f64::from(chunk) / f64::from(microphone.sound().rate);
            interval = Some(
                Duration::try_from_secs_f64(seconds)
                    .with_context(|| format!("{source} has a rate of 0"))?,
            );
        }
        ear.microphone = Some(microphone);
    }
    let mut loudspeaker = play.as_deref().map(Loudspeaker::new);
    let mut ear = ear.communicator();
    ear.activate(EarMethod::Hear, mode)?;
    while !ear.inner().has_ended {
        let heard = ear.hear(&mware, &topic)?.flatten();
        if let Some(fault) = ear.inner_mut().fault.take() {
            return Err(fault);
        }
        if let Some(chunk) = heard {
            if let Some(loudspeaker) = &mut loudspeaker {
                loudspeaker.play(&chunk)?;
            }
            let mut told = described_sound(&chunk);
            if let Json::Object(told) = &mut told {
                told.insert("event".to_owned(), "message".into());
            }
            println!("{told}");
        }
        if let Some(interval) = interval {
            std::thread::sleep(interval);
        }
    }
    Ok(())
}
