//! Tests against recorded YARP and live sockets: one program, a module for each subject.

#![allow(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    reason = "in a test a panic is the right answer"
)]

mod framing;
mod golden;
mod golden_bottle;
mod golden_datagrams;
mod golden_name_events;
mod golden_names;
mod golden_ports;
mod golden_sig;
mod hostile_ports;
mod input;
mod limits;
mod lookup;
mod name_live;
mod name_properties;
mod name_tools;
mod names;
mod ports;
mod properties;
mod queued;
mod unix_stream;
