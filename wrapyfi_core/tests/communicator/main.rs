//! Registered methods over the memory middleware: every mode, and what is said about mistakes.
#![allow(
    clippy::unwrap_used,
    clippy::indexing_slicing,
    reason = "in a test a panic is the right answer"
)]

mod mistakes;
mod modes;
mod requests;
mod robot;
