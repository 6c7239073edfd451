//! Promises of the targets without a fuzzer: every corpus file once, and messages as large as the limit allows.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stderr)]

mod large;
mod replay;
