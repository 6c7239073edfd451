//! Tests of the engine on middlewares that fail: one program, a module for each subject.

#![allow(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

mod common;
mod driver;
mod examples;
mod simulation;
mod simulation_services;
mod threads;
mod yarp_discovery;
