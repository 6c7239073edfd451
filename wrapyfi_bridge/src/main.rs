//! `wrapyfi`: the program with the middlewares that come with it.

use std::process::ExitCode;

fn main() -> ExitCode {
    wrapyfi_bridge::main(&wrapyfi_bridge::BUNDLED)
}
