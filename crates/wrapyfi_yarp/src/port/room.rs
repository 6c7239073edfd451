//! Room for what waits: begun messages, and queues of outputs.
//!
//! ```text
//!   Begun:  bytes of a message that has begun ─┐
//!   Outbox: messages for a target ─────────────┴─▶ Room ─▶ the embedding program counts all that waits
//! ```

use std::future::Future;
use std::time::Duration;

use tokio::time::timeout;

use crate::wire::Fault;

/// Bytes that wait for one peer, or of one. Dropping it gives everything back.
pub trait Room: std::fmt::Debug + Send + Sync {
    /// Takes room for so many bytes; false where there is none.
    fn take(&self, bytes: usize) -> bool;

    /// Gives room back.
    fn give(&self, bytes: usize);
}

/// Makes the room of a peer.
pub type Rooms = fn() -> Box<dyn Room>;

/// Room without end: for programs that count nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Boundless;

impl Room for Boundless {
    fn take(&self, _bytes: usize) -> bool {
        true
    }

    fn give(&self, _bytes: usize) {}
}

/// Room of a message that has begun to come.
#[derive(Debug)]
pub(super) struct Begun {
    room: Box<dyn Room>,
    held: usize,
}

impl Begun {
    pub(super) fn new(rooms: Rooms) -> Self {
        Self { room: rooms(), held: 0 }
    }

    /// Takes or gives what is missing until just so many bytes are counted.
    ///
    /// # Errors
    /// [`Fault::OverBudget`] where there is no room; as many as before are counted then.
    pub(super) fn hold(&mut self, bytes: usize) -> Result<(), Fault> {
        if bytes > self.held && !self.room.take(bytes - self.held) {
            return Err(Fault::OverBudget(bytes));
        }
        self.room.give(self.held.saturating_sub(bytes));
        self.held = bytes;
        Ok(())
    }
}

/// Reads on: where a message has begun, its next byte comes within `limit`, or never.
pub(super) async fn progress<T>(
    has_begun: bool,
    limit: Duration,
    read: impl Future<Output = T>,
) -> Result<T, Fault> {
    if has_begun {
        timeout(limit, read).await.map_err(|_elapsed| Fault::NoProgress(limit))
    } else {
        Ok(read.await)
    }
}
