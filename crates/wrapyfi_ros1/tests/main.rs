//! Tests of ROS 1's topics, services and actions against a small master: one program, a module for each subject.

#![allow(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "in a test a panic is the right answer"
)]

mod action_goals;
mod action_offers;
mod actions;
mod common;
mod conformance;
mod faults;
mod hostile;
