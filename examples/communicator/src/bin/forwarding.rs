//! Forwarding: a chain of methods, each on a middleware of its own.
//!
//! ```text
//!   --role source                 --role forward                    --role sink
//!   send_a(msg) publishes ──▶ A ──▶ send_a() listens
//!                                   send_b(msg) publishes ──▶ B ──▶ send_b() listens
//! ```
//!
//! The one in the middle is the only one that needs both middlewares. `test/peers/forwarding.py` is
//! the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use clap::{Parser, ValueEnum};
use wrapyfi_communicator_examples::{log_to_stderr, pause};
use wrapyfi_core::communicator::{Mode, communicator};

/// Passes messages on from one middleware to another.
#[derive(Parser)]
struct Options {
    /// Place in the chain
    #[arg(long)]
    role: Role,
    /// First middleware
    #[arg(long, default_value = "zeromq")]
    mware_a: String,
    /// Second middleware
    #[arg(long, default_value = "ros2")]
    mware_b: String,
    /// Carrier of the first middleware, where it is YARP
    #[arg(long, default_value = "tcp")]
    carrier: String,
}

#[derive(Clone, Copy, ValueEnum)]
enum Role {
    Source,
    Forward,
    Sink,
}

struct ForwardCls;

#[communicator]
impl ForwardCls {
    #[register(NativeObject, "$mware", "ForwardCls", "/example/native_a_msg",
               carrier = "$carrier", should_wait = true)]
    fn send_a(&self, mware: &str, carrier: &str, msg: &str) -> String {
        _ = (mware, carrier);
        msg.to_owned()
    }

    #[register(NativeObject, "$mware", "ForwardCls", "/example/native_b_msg", should_wait = true)]
    fn send_b(&self, mware: &str, msg: &str) -> String {
        _ = mware;
        msg.to_owned()
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let Options { role, mware_a, mware_b, carrier } = Options::parse();
    let mut chain = ForwardCls.communicator();
    let (first, second) = match role {
        Role::Source => (Mode::Publish, Mode::Disable),
        Role::Forward => (Mode::Listen, Mode::Publish),
        Role::Sink => (Mode::Disable, Mode::Listen),
    };
    chain.activate(ForwardClsMethod::SendA, first)?;
    chain.activate(ForwardClsMethod::SendB, second)?;
    let mut number = 0;
    loop {
        number += 1;
        let passed = match role {
            Role::Source => {
                pause();
                chain.send_a(&mware_a, &carrier, &format!("message {number}"))?
            }
            Role::Forward => match chain.send_a(&mware_a, &carrier, "")? {
                Some(msg) => chain.send_b(&mware_b, &msg)?,
                None => None,
            },
            Role::Sink => chain.send_b(&mware_b, "")?,
        };
        match passed {
            Some(msg) => println!("{msg}"),
            None => pause(),
        }
    }
}
