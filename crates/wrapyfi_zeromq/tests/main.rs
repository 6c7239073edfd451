//! Tests of what users of ZeroMQ see: one program, a module for each subject.

#![allow(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

mod broker;
mod captures;
mod common;
mod conformance;
#[cfg(feature = "curve")]
mod curve;
mod endpoints;
mod floods;
mod request_captures;
mod requests;
