//! Transports that a source sends on and a sink receives from.
//!
//! | wire | is |
//! | --- | --- |
//! | `zmq` | plain PUB and SUB of the crate `zmq`, messages encoded beforehand |
//! | `dds` | plain CDR writer and reader on CycloneDDS, messages encoded beforehand |
//! | `wrapyfi` | publisher and listener of our library over ZeroMQ, coding included |

mod dds;
mod end;
mod wrapyfi;
pub(crate) mod zmq;

use anyhow::Result;

pub(crate) use self::end::{Incoming, Outgoing, Place};
use crate::payload::Maker;

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
pub(crate) fn incoming(wire: Wire, place: &Place) -> Result<Incoming> {
    match wire {
        Wire::Zmq => zmq::incoming(place),
        Wire::Dds => dds::incoming(place),
        Wire::Wrapyfi => wrapyfi::incoming(place),
    }
}
