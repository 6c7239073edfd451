//! Requests and replies: a call in one program runs the method in another one, with the caller's
//! arguments.
//!
//! ```text
//!   --mode request                                        --mode reply
//!   describe([1, 2, 6]) ── numbers, scale ──▶ describe() runs ─┐ and returns the same
//!   Some({count, mean}) ◀─────── the reply ────────────────────┘
//! ```
//!
//! `--picture` asks for an image instead. On ZeroMQ a broker carries one service: run the two with
//! brokers of their own. `test/peers/request_reply.py` is the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use clap::Parser;
use serde::{Deserialize, Serialize};
use serde_json::json;
use wrapyfi_communicator_examples::{described_image, image, log_to_stderr};
use wrapyfi_core::communicator::{Mode, communicator};
use wrapyfi_core::types::Image;

/// Asks another program to compute, or does so for others.
#[derive(Parser)]
struct Options {
    /// request or reply; none computes here
    #[arg(long, default_value = "none")]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
    /// Asks for, or serves, a picture
    #[arg(long)]
    picture: bool,
    /// Multiplies the mean
    #[arg(long)]
    scale: Option<f64>,
    /// Numbers to describe, each time one more of them
    #[arg(default_values_t = [1.0, 2.0, 6.0])]
    numbers: Vec<f64>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Description {
    count: usize,
    mean: Option<f64>,
}

struct Calculator;

#[communicator]
impl Calculator {
    // A client that starts first waits so long for its server.
    #[register(NativeObject, "$0", "Calculator", "/example/describe", timeout_ms = 60_000)]
    fn describe(&self, mware: &str, numbers: &[f64], scale: Option<f64>) -> Description {
        _ = mware; // for #[register]
        let count = u32::try_from(numbers.len()).ok().filter(|count| *count > 0);
        let mean = count.map(|count| numbers.iter().sum::<f64>() / f64::from(count));
        Description { count: numbers.len(), mean: mean.map(|mean| mean * scale.unwrap_or(1.0)) }
    }

    #[register(Image, "$0", "Calculator", "/example/picture", timeout_ms = 60_000)]
    fn picture(&self, mware: &str, number: u8, width: u32, height: u32) -> Option<Image> {
        _ = mware;
        image(number, width, height)
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let Options { mode, mware, picture, scale, numbers } = Options::parse();
    let mut calculator = Calculator.communicator();
    calculator.activate(CalculatorMethod::Describe, mode)?;
    calculator.activate(CalculatorMethod::Picture, mode)?;
    let is_server = mode == Mode::Reply;
    for asked in (1_u8..=u8::MAX).cycle() {
        let place = usize::from(asked);
        let told = if picture {
            // A server passes what it likes: its clients' arguments count.
            calculator.picture(&mware, asked, 32, 24)?.flatten().as_ref().map(described_image)
        } else {
            let known = numbers.get(..place).unwrap_or(&numbers);
            let described = calculator.describe(&mware, known, scale)?;
            described.map(serde_json::to_value).transpose()?
        };
        println!("{}", json!({ "event": "message", "value": told }));
        if !is_server && place >= numbers.len() {
            break;
        }
    }
    Ok(())
}
