//! An end of a wire: its address, and what sends and receives there.

use std::time::Duration;

use anyhow::Result;

use crate::payload::Kind;

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

/// The receiving end: waits for the next message, and gives its number and the time when it was there.
pub(crate) type Incoming = Box<dyn FnMut() -> Result<(u32, u64)>>;

/// Time after which a receiving end looks again, whether anything rang or not.
pub(super) const LOOK: Duration = Duration::from_secs(1);
