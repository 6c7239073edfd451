//! Mirroring of a whole pipeline: the same program runs several times, and every one goes through the
//! same calls and gets the same results. The one that does the work, and those that mirror it, are
//! chosen when they start.
//!
//! ```text
//!                 --here sense         --here think          (neither)
//!   sense()       runs ─┬───────────▶ listens ┬──────────▶ listens
//!   think(number)       │  listens ◀──────────┼─ runs ───▶ listens
//!                       └─ /mirroring/sense   └─ /mirroring/think
//! ```
//!
//! `--config FILE` chooses the same by one of Wrapyfi's configuration files:
//!
//! ```yaml
//! Pipeline: { sense: "listen", think: "publish" }
//! ```
//!
//! `test/peers/mirroring.py` is the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use serde::{Deserialize, Serialize};
use wrapyfi_communicator_examples::{log_to_stderr, pause};
use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};

/// Does part of the work and mirrors the rest.
#[derive(Parser)]
struct Options {
    /// Steps that run here; the others are listened to
    #[arg(long, value_delimiter = ',')]
    here: Vec<Stage>,
    /// Modes of all steps, instead of --here
    #[arg(long, conflicts_with = "here")]
    config: Option<PathBuf>,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Stage {
    Sense,
    Think,
}

#[derive(Debug, Serialize, Deserialize)]
struct Thought {
    number: u64,
    square: u64,
}

#[derive(Default)]
struct Pipeline {
    sensed: u64,
}

#[communicator]
impl Pipeline {
    #[register(NativeObject, "$mware", "Pipeline", "/mirroring/sense", should_wait = true)]
    fn sense(&mut self, mware: &str) -> u64 {
        _ = mware; // for #[register]
        self.sensed += 1;
        self.sensed
    }

    // Without waiting: two programs that wait for each other's first message would wait for ever.
    #[register(NativeObject, "$mware", "Pipeline", "/mirroring/think", should_wait = false)]
    fn think(&mut self, mware: &str, number: u64) -> Thought {
        _ = mware;
        Thought { number, square: number.wrapping_mul(number) }
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let Options { here, config, mware } = Options::parse();
    let mode = |step| if here.contains(&step) { Mode::Publish } else { Mode::Listen };
    let mut pipeline = match config {
        Some(file) => {
            CommunicatorContext::global().load_config(file)?;
            Pipeline::default().communicator()
        }
        None => {
            let mut pipeline = Pipeline::default().communicator();
            pipeline.activate(PipelineMethod::Sense, mode(Stage::Sense))?;
            pipeline.activate(PipelineMethod::Think, mode(Stage::Think))?;
            pipeline
        }
    };
    loop {
        // From here on nothing depends on who does the work.
        if let Some(number) = pipeline.sense(&mware)?
            && let Some(thought) = pipeline.think(&mware, number)?
        {
            println!("{}", serde_json::to_string(&thought)?);
        }
        pause();
    }
}
