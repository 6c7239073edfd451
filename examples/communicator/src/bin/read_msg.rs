//! The first listing of docs/reference/communicator.md, as it stands there: mirroring, in the mode that is the
//! first argument.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

// Listing 1
use serde::{Deserialize, Serialize};
use wrapyfi_core::communicator::communicator;

#[derive(Serialize, Deserialize)]
struct Message {
    msg: String,
    msg_ip: String,
}

struct MirrorCls;

#[communicator]
impl MirrorCls {
    #[register(
        NativeObject,
        "$0",
        "MirrorCls",
        "/example/read_msg",
        carrier = "tcp",
        should_wait = "$blocking"
    )]
    fn read_msg(
        &self,
        mware: &str,
        #[default("")] msg: &str,
        #[default(true)] blocking: bool,
    ) -> Message {
        _ = (mware, blocking); // for #[register]
        println!("Type message:");
        let typed = std::io::stdin().lines().next().and_then(Result::ok);
        Message { msg: msg.to_owned(), msg_ip: typed.unwrap_or_default() }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mode = std::env::args().nth(1); // publish, listen, request or reply
    let mut mirror = MirrorCls.communicator();
    mirror.activate(MirrorClsMethod::ReadMsg, mode.as_deref().unwrap_or("publish"))?;
    while let Some(message) = mirror.read_msg("zeromq", "hello", true)? {
        println!("{}", message.msg_ip);
    }
    Ok(())
}
// End

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]
mod tests {
    use std::sync::Arc;
    use std::thread;

    use wrapyfi_core::communicator::CommunicatorContext;
    use wrapyfi_core::middleware::memory::Memory;

    use super::*;

    #[test]
    fn a_message_is_mirrored() {
        let context = CommunicatorContext::builder().only(Arc::new(Memory::new("zeromq"))).build();
        for modes in [["publish", "listen"], ["reply", "request"]] {
            let mut mirrors = [(); 2].map(|()| MirrorCls.communicator_in(&context));
            for (mirror, mode) in mirrors.iter_mut().zip(modes) {
                mirror.activate(MirrorClsMethod::ReadMsg, mode).unwrap();
            }
            let [here, there] = &mirrors;
            thread::scope(|scope| {
                let there =
                    scope.spawn(|| there.read_msg("zeromq", "hello", true).unwrap().unwrap());
                let here = here.read_msg("zeromq", "hello", true).unwrap().unwrap();
                let there = there.join().unwrap();
                assert_eq!((&*here.msg, &*there.msg), ("hello", "hello"));
                assert_eq!(here.msg_ip, there.msg_ip);
            });
        }
    }
}
