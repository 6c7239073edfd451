//! An action: a goal that takes its time, tells how far it is, and can be given up.
//!
//! ```text
//!   --mode request                                            --mode reply, or rclcpp, rclpy, actionlib
//!   fibonacci(5) ─────── goal ─────────────────────────────▶ fibonacci() runs, sends feedback
//!   Feedback::channel() ◀── [0, 1, 1], [0, 1, 1, 2], … ─────────┤ asks whether its goal is cancelled
//!   Some(Sequence) ◀──────── result ────────────────────────────┘
//!   the call is dropped ──── cancel ──────────────────────▶
//! ```
//!
//! `--asynchronous` does the same with the `async` method: dropping its future cancels the goal.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::time::Duration;

use clap::Parser;
use serde::{Deserialize, Serialize};
use serde_json::json;
use wrapyfi_communicator_examples::log_to_stderr;
use wrapyfi_core::communicator::{Feedback, MethodError, Mode, communicator};
use wrapyfi_core::types::{Value, from_value};

/// Time that each number takes.
const STEP: Duration = Duration::from_millis(50);

/// Sends a goal, or works on those of others.
#[derive(Parser)]
struct Options {
    /// request or reply; none computes here
    #[arg(long, default_value = "none")]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "ros2")]
    mware: String,
    /// Name of the action
    #[arg(long, default_value = "/fibonacci")]
    action: String,
    /// Type of the action, whose fields are `order`, `sequence` and `sequence`
    #[arg(long, default_value = "example_interfaces/action/Fibonacci")]
    kind: String,
    /// Number of numbers
    #[arg(long, default_value_t = 5)]
    order: i32,
    /// Gives the goal up after so many messages of feedback; 0: never
    #[arg(long, default_value_t = 0)]
    cancel_after: usize,
    /// Uses the async method
    #[arg(long)]
    asynchronous: bool,
}

/// Result and feedback of the action.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Sequence {
    sequence: Vec<i32>,
}

impl Sequence {
    fn begin() -> Self {
        Self { sequence: vec![0, 1] }
    }

    fn grow(&mut self) {
        let last_two = self.sequence.iter().rev().take(2);
        let next = last_two.fold(0, |sum: i32, number| sum.wrapping_add(*number));
        self.sequence.push(next);
    }
}

struct Fibonacci;

#[communicator]
impl Fibonacci {
    #[register(Action, "$mware", "$action", action_type = "$kind")]
    fn compute(
        &self,
        mware: &str,
        action: &str,
        kind: &str,
        order: i32,
        #[feedback] progress: &Feedback,
    ) -> Sequence {
        _ = (mware, action, kind); // for #[register]
        let mut numbers = Sequence::begin();
        for _ in 0..order {
            if progress.is_canceled() {
                break;
            }
            numbers.grow();
            send(progress, &numbers);
            std::thread::sleep(STEP);
        }
        numbers
    }

    #[register(Action, "$mware", "$action", action_type = "$kind")]
    async fn compute_async(
        &self,
        mware: &str,
        action: &str,
        kind: &str,
        order: i32,
        #[feedback] progress: &Feedback,
    ) -> Sequence {
        _ = (mware, action, kind);
        let mut numbers = Sequence::begin();
        for _ in 0..order {
            if progress.is_canceled() {
                break;
            }
            numbers.grow();
            send(progress, &numbers);
            tokio::time::sleep(STEP).await;
        }
        numbers
    }
}

fn send(progress: &Feedback, numbers: &Sequence) {
    if let Err(error) = progress.send(numbers) {
        tracing::warn!("{error}");
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let options = Options::parse();
    let mut fibonacci = Fibonacci.communicator();
    let method = match options.asynchronous {
        true => FibonacciMethod::ComputeAsync,
        false => FibonacciMethod::Compute,
    };
    fibonacci.activate(method, options.mode)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
    loop {
        let ended = match options.asynchronous {
            true => runtime.block_on(ask_async(&fibonacci, &options)),
            false => ask(&fibonacci, &options),
        };
        let numbers = ended?.map(|numbers| numbers.sequence);
        println!("{}", json!({ "event": "end", "sequence": numbers }));
        if options.mode != Mode::Reply {
            return Ok(());
        }
    }
}

/// Sends a goal, or works on one that comes. Another thread hears the feedback, and gives the goal up: then there are no
/// numbers.
fn ask(
    fibonacci: &FibonacciCommunicator,
    options: &Options,
) -> Result<Option<Sequence>, MethodError> {
    let Options { mware, action, kind, order, cancel_after, .. } = options;
    let (feedback, mut heard) = Feedback::channel();
    let control = fibonacci.control();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut count = 0;
            while let Some(value) = heard.recv_timeout(Duration::MAX) {
                count += 1;
                show(&value);
                if count == *cancel_after {
                    control.cancel(FibonacciMethod::Compute);
                }
            }
        });
        let numbers = fibonacci.compute(mware, action, kind, *order, &feedback);
        // The thread ends when nobody can send any more.
        drop(feedback);
        match numbers {
            Err(MethodError::Cancelled { .. }) => Ok(None),
            other => other,
        }
    })
}

/// As [`ask`], in one task.
async fn ask_async(
    fibonacci: &FibonacciCommunicator,
    options: &Options,
) -> Result<Option<Sequence>, MethodError> {
    let Options { mware, action, kind, order, cancel_after, .. } = options;
    let (feedback, mut heard) = Feedback::channel();
    let call = fibonacci.compute_async(mware, action, kind, *order, &feedback);
    let mut call = std::pin::pin!(call);
    let mut count = 0;
    let numbers = loop {
        tokio::select! {
            biased;
            Some(value) = heard.recv() => {
                count += 1;
                show(&value);
                if count == *cancel_after {
                    // The future is dropped on return.
                    return Ok(None);
                }
            }
            numbers = &mut call => break numbers,
        }
    };
    while let Some(value) = heard.try_recv() {
        show(&value);
    }
    numbers
}

fn show(value: &Value) {
    match from_value::<Sequence>(value.clone()) {
        Ok(numbers) => println!("{}", json!({ "event": "feedback", "sequence": numbers.sequence })),
        Err(error) => tracing::warn!("{error}"),
    }
}
