//! The writer of a conversion on a thread of its own, so that reading and converting go on while it writes.
//!
//! ```text
//!   convert ── batch of messages ──▶ thread ─▶ recording::Writer
//!      ▲                               │
//!      └───── batches, empty again ────┘
//! ```
//!
//! A few batches are under way at most: memory stays that of some messages, whatever the size of the bag.

use std::io::{Seek, Write};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};

use crate::recording::{Topic, WriteError, Writer};

/// Bytes of messages with which a batch is handed over.
const BATCH_BYTES: usize = 1 << 20;
/// Most batches that wait for the writer.
const WAITING: usize = 2;

/// Messages one behind the other, and the topics that are new with them.
#[derive(Debug, Default)]
struct Batch {
    topics: Vec<Topic>,
    messages: Vec<Entry>,
    cdr: Vec<u8>,
}

/// A message of a batch.
#[derive(Debug, Clone, Copy)]
struct Entry {
    /// Number of its topic.
    topic: usize,
    time_ns: u64,
    /// Offset behind its last byte.
    end: usize,
}

/// The side that gives messages.
#[derive(Debug)]
pub(crate) struct Feed {
    full: SyncSender<Batch>,
    empty: Receiver<Batch>,
    batch: Batch,
    topics: usize,
}

/// The side that writes them.
#[derive(Debug)]
pub(crate) struct Drain {
    full: Receiver<Batch>,
    empty: Sender<Batch>,
}

/// Both sides.
pub(crate) fn pipe() -> (Feed, Drain) {
    let (give_full, full) = sync_channel(WAITING);
    let (give_empty, empty) = channel();
    let feed = Feed { full: give_full, empty, batch: Batch::default(), topics: 0 };
    (feed, Drain { full, empty: give_empty })
}

impl Feed {
    /// Adds a topic; its number.
    pub(crate) fn add_topic(&mut self, topic: Topic) -> usize {
        self.batch.topics.push(topic);
        self.topics += 1;
        self.topics - 1
    }

    /// Adds a message, whose bytes `put` appends; where it fails there is none. False where the writer has ended.
    pub(crate) fn add<E>(
        &mut self,
        (topic, time_ns): (usize, u64),
        put: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
    ) -> Result<bool, E> {
        put(&mut self.batch.cdr)?;
        let end = self.batch.cdr.len();
        self.batch.messages.push(Entry { topic, time_ns, end });
        Ok(end < BATCH_BYTES || self.hand_over())
    }

    /// Hands over what there is; false where the writer has ended.
    pub(crate) fn hand_over(&mut self) -> bool {
        let next = self.empty.try_recv().unwrap_or_default();
        self.full.send(std::mem::replace(&mut self.batch, next)).is_ok()
    }
}

impl Drain {
    /// Writes until the other side ends.
    pub(crate) fn write_to<W: Write + Seek>(self, out: &mut Writer<W>) -> Result<(), WriteError> {
        let mut ids = Vec::new();
        for mut batch in self.full {
            for topic in batch.topics.drain(..) {
                ids.push(out.add_topic(&topic)?);
            }
            let mut begin = 0;
            for Entry { topic, time_ns, end } in batch.messages.drain(..) {
                let id = ids.get(topic).copied().ok_or(WriteError::UnknownTopic(topic))?;
                let cdr = batch.cdr.get(begin..end).unwrap_or_default();
                out.write(id, time_ns, time_ns, cdr)?;
                begin = end;
            }
            batch.cdr.clear();
            // The other side may have ended.
            _ = self.empty.send(batch);
        }
        Ok(())
    }
}
