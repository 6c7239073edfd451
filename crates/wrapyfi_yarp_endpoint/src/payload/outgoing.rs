//! A message to write.

use wrapyfi_yarp::port::PortPayload as Bytewise;
use wrapyfi_yarp::sig;

use wrapyfi_data::types::Stamp;

/// A message to write: its bytes, and the time that goes with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Outgoing {
    /// The bytes.
    pub payload: Bytewise,
    /// Time at which the payload was made, where it says so. The stamp's count is 0: the writer
    /// counts.
    pub stamp: Option<sig::Stamp>,
}

/// The stamp that goes with a message; none where it has no time.
pub(super) fn envelope(stamp: Option<Stamp>) -> Option<sig::Stamp> {
    let stamp = stamp.filter(|stamp| *stamp != Stamp::default())?;
    Some(sig::Stamp { count: 0, time_s: stamp.as_secs_f64() })
}
