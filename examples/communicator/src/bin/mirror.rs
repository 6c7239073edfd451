//! The program of docs/rust.md, as it stands there: mirroring, in the mode that is the first argument.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

// Listing of docs/rust.md
use serde::{Deserialize, Serialize};
use wrapyfi_core::communicator::communicator;

#[derive(Serialize, Deserialize)]
struct Message {
    text: String,
}

struct Mirror;

#[communicator]
impl Mirror {
    #[register(NativeObject, "$mware", "/example/read_msg", should_wait = true)]
    fn read(&self, mware: &str) -> Message {
        _ = mware; // for #[register]
        println!("Type a message:");
        let text = std::io::stdin().lines().next().and_then(Result::ok);
        Message { text: text.unwrap_or_else(|| "exit".to_owned()) }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mode = std::env::args().nth(1); // publish, listen, request or reply
    let mut mirror = Mirror.communicator();
    mirror.activate(MirrorMethod::Read, mode.as_deref().unwrap_or("publish"))?;
    while let Some(message) = mirror.read("zeromq")? {
        println!("{}", message.text);
        if message.text == "exit" {
            break;
        }
    }
    Ok(())
}
// End
