//! Mirroring, Wrapyfi's hello world: one program, run several times. The method of the one that
//! publishes asks for a message; everywhere else it returns what was typed there.
//!
//! ```text
//!   hello_world --mode publish   read_msg() asks ─┬─▶ returns {msg, msg_ip}
//!                                                 └─▶ zeromq:/example/read_msg
//!   hello_world --mode listen    read_msg() ◀───────────┘ returns the same
//! ```
//!
//! With `--mode reply` here and `--mode request` elsewhere each call there asks anew.
//!
//! `test/peers/hello_world.py` is the same program in Python; any mixture of the two works.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::io::Write as _;

use clap::Parser;
use serde::{Deserialize, Serialize};
use wrapyfi_communicator_examples::{log_to_stderr, pause};
use wrapyfi_core::communicator::communicator;

/// Mirrors what is typed in one program to all others.
#[derive(Parser)]
struct Options {
    /// publish, listen, request, reply, none or disable
    #[arg(long, default_value = "none")]
    mode: String,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
    /// Goes with every message
    #[arg(long, default_value = "hello")]
    msg: String,
    /// Wait for the other side in each call
    #[arg(long, default_value_t = true, action = clap::ArgAction::Set)]
    blocking: bool,
}

#[derive(Debug, Serialize, Deserialize)]
struct Message {
    msg: String,
    msg_ip: String,
}

struct MirrorCls;

#[communicator]
impl MirrorCls {
    // The user has ten minutes to type.
    #[register(
        NativeObject,
        "$0",
        "MirrorCls",
        "/example/read_msg",
        carrier = "tcp",
        should_wait = "$blocking",
        timeout_ms = 600_000
    )]
    fn read_msg(
        &self,
        mware: &str,
        #[default("")] msg: &str,
        #[default(true)] blocking: bool,
    ) -> Message {
        _ = (mware, blocking); // for #[register]
        print!("Type message: ");
        let mut line = String::new();
        let read = std::io::stdout().flush().and_then(|()| std::io::stdin().read_line(&mut line));
        // The end of the input ends all mirrors.
        let msg_ip = if read.is_ok_and(|read| read > 0) { line.trim_end() } else { "exit" };
        Message { msg: msg.to_owned(), msg_ip: msg_ip.to_owned() }
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let options = Options::parse();
    let mut mirror = MirrorCls.communicator();
    mirror.activate(MirrorClsMethod::ReadMsg, options.mode.as_str())?;
    loop {
        match mirror.read_msg(&options.mware, &options.msg, options.blocking)? {
            Some(message) => {
                println!("Method result: {}", serde_json::to_string(&message)?);
                if message.msg_ip == "exit" {
                    return Ok(());
                }
            }
            None if options.mode == "disable" => return Ok(()),
            None => pause(),
        }
    }
}
