//! Both ways at once: one side sends and gets back what the other made of it.
//!
//! ```text
//!   --mode transceive  (sends /ping, hears /pong)       --mode reemit  (hears /ping, sends /pong)
//!   exchange() runs ─▶ {by, number} ─────────────────▶ heard ─▶ exchange(heard) runs
//!   returns          ◀───── {by, number, answers} ◀──────────────────┘ returns the same
//! ```
//!
//! `--mode receive` takes what came without sending anything on. `test/peers/transceive_reemit.py` is
//! the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use clap::Parser;
use serde::{Deserialize, Serialize};
use serde_json::json;
use wrapyfi_communicator_examples::{log_to_stderr, pause};
use wrapyfi_core::communicator::{Mode, communicator};

/// Speaks and is answered, or answers.
#[derive(Parser)]
struct Options {
    /// transceive, reemit or receive
    #[arg(long)]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Note {
    by: String,
    number: u64,
    /// The number of the note that this one answers.
    answers: Option<u64>,
}

struct Partner {
    name: String,
    said: u64,
}

#[communicator]
impl Partner {
    // Without waiting: each side would wait for the other's first note.
    #[register(
        NativeObject,
        "$mware",
        "Partner",
        "$way_in",
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out"),
        should_wait = false
    )]
    fn exchange(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        #[received] heard: Option<Note>,
    ) -> Note {
        _ = (mware, way_in, way_out); // for #[register]
        self.said += 1;
        Note { by: self.name.clone(), number: self.said, answers: heard.map(|heard| heard.number) }
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let Options { mode, mware } = Options::parse();
    let mut partner = Partner { name: mode.to_string(), said: 0 }.communicator();
    partner.activate(PartnerMethod::Exchange, mode)?;
    let (way_in, way_out) = match mode {
        Mode::Transceive => ("/example/pong", "/example/ping"),
        _ => ("/example/ping", "/example/pong"),
    };
    loop {
        // The answers of both ways: both sides see them.
        let note = partner.exchange(&mware, way_in, way_out, None)?;
        if let Some(note) = note.filter(|note| note.answers.is_some()) {
            println!("{}", json!({ "event": "message", "note": note }));
        }
        pause();
    }
}
