//! CycloneDDS behind safe types: the only modules that call C.
//!
//! ```text
//!   entity    domain, participant, topic: a handle that deletes itself
//!   topic     topics of opaque CDR, and the functions Cyclone calls for their samples
//!   qos       Cyclone's QoS object, filled from ours
//!   events    listener callbacks ──▶ counters and a doorbell
//!   serdata   pieces ──▶ Cyclone's sample;  Cyclone's sample ──▶ Bytes, without a copy
//!   spacing   pauses between the fragments of a sample
//!   sequence  numbers of received samples ──▶ how many are missing between them
//!   endpoint  writer and reader of serialised messages
//!   builtin   the endpoints that discovery has found, at once and as they come and go
//!   matched   the peers of an endpoint
//!   log       Cyclone's log lines ──▶ tracing
//! ```
//!
//! # Contract
//!
//! Everything `unsafe` is inside; the types handed out are safe to use in any order, with these
//! rules kept by their `Drop`s: an endpoint clears its listener, which waits for callbacks under
//! way, before it is deleted; what callbacks point to is freed after the deletion; a sample owns
//! its reference to Cyclone's buffer and may outlive reader, participant and domain.
//!
//! A callback may drop any of them, also the endpoint it was called for: the deletion runs after it, on another
//! thread.

mod builtin;
mod endpoint;
mod entity;
mod events;
mod log;
mod matched;
mod qos;
mod sequence;
mod serdata;
mod spacing;
#[cfg(test)]
mod tests;
mod topic;

pub(super) use builtin::{BuiltinReader, EndpointFound, endpoints, participants};
pub(super) use endpoint::{RawReader, RawWriter, Taken, WriteFault};
pub(super) use entity::{Entity, ReturnCode};
pub(super) use events::Events;
pub(super) use qos::EndpointQos;
