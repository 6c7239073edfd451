//! Transports that a source sends on and a sink receives from.
//!
//! | wire | is |
//! | --- | --- |
//! | `zmq` | plain PUB and SUB of the crate `zmq`, messages encoded beforehand |
//! | `dds` | plain CDR writer and reader on CycloneDDS, messages encoded beforehand |
//! | `wrapyfi` | publisher and listener of our library over ZeroMQ, coding included |

mod dds;
mod wrapyfi;
pub(crate) mod zmq;

use std::time::Duration;

use anyhow::Result;

use crate::payload::{Kind, Maker};

/// Kind of a wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Wire {
    /// Raw ZeroMQ.
    Zmq,
    /// Raw CycloneDDS.
    Dds,
    /// Our library on ZeroMQ.
    Wrapyfi,
}

/// Address of a wire, and the messages on it.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Place {
    /// Payload of the messages.
    #[arg(long)]
    pub(crate) payload: Kind,
    /// Topic.
    #[arg(long)]
    pub(crate) topic: String,
    /// Port of the broker for listeners.
    #[arg(long, default_value_t = 0)]
    pub(crate) pub_port: u16,
    /// Port of the broker for publishers.
    #[arg(long, default_value_t = 0)]
    pub(crate) sub_port: u16,
    /// DDS domain.
    #[arg(long, default_value_t = 0)]
    pub(crate) domain: u32,
}

/// The sending end.
pub(crate) trait Outgoing {
    /// Gets message `seq` ready, outside of what is measured.
    fn prepare(&mut self, seq: u32) -> Result<()>;
    /// Sends what was prepared.
    fn send(&mut self) -> Result<()>;
}

/// The receiving end.
pub(crate) trait Incoming {
    /// Number of the next message and the time when it was there; `None` after `patience`.
    fn next(&mut self, patience: Duration) -> Result<Option<(u32, u64)>>;
}

/// Opens the sending end.
pub(crate) fn outgoing(wire: Wire, place: &Place) -> Result<Box<dyn Outgoing>> {
    let maker = Maker::new(place.payload)?;
    Ok(match wire {
        Wire::Zmq => Box::new(zmq::Out::new(&maker, place)?),
        Wire::Dds => Box::new(dds::Out::new(&maker, place)?),
        Wire::Wrapyfi => Box::new(wrapyfi::Out::new(maker, place)?),
    })
}

/// Opens the receiving end.
pub(crate) fn incoming(wire: Wire, place: &Place) -> Result<Box<dyn Incoming>> {
    Ok(match wire {
        Wire::Zmq => Box::new(zmq::In::new(place)?),
        Wire::Dds => Box::new(dds::In::new(place)?),
        Wire::Wrapyfi => Box::new(wrapyfi::In::new(place)?),
    })
}
