//! Queue of what is to be written on one connection: words of the protocol, messages, and small messages of a publisher
//! of ours in batches.
//!
//! ```text
//!   push, push_small ─▶ [ first, of which a part is written │ … │ batch ] ── write ──▶ TCP
//!                                    spare memory ◀── a batch that has left
//! ```

use std::io::{IoSlice, Result as IoResult};
use std::sync::Arc;
use std::time::Instant;

use bytes::Bytes;

use super::message::{Batch, Message, Outgoing};
use super::own_messages::Fingerprint;
use wrapyfi_endpoint::{DropReason, Outbox, Overflow};

/// Queue of one connection.
#[derive(Default)]
pub(super) struct Queue {
    entries: Outbox<Outgoing>,
    /// Messages of publishers in it, those of the first entry that are written included.
    published: usize,
    /// Entries that have some of them; the others are words of the protocol.
    of_publishers: usize,
    /// Memory for the next batch.
    spare: Option<Box<Batch>>,
}

impl Queue {
    /// Takes bytes of the protocol, which go as they are.
    pub(super) fn push_word(&mut self, bytes: Vec<u8>) {
        _ = self.push_entry(Outgoing::Word(bytes.into()));
    }

    /// Takes a message, and its bytes for this connection alone where they are sealed.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn push(
        &mut self,
        message: &Arc<Message>,
        sealed: Option<Bytes>,
    ) -> Result<(), DropReason> {
        self.push_entry(Outgoing::Message(Arc::clone(message), sealed))?;
        let of_publisher = usize::from(message.of.is_some());
        self.published += of_publisher;
        self.of_publishers += of_publisher;
        Ok(())
    }

    /// Takes a small message of a publisher of ours, of `bytes` bytes as it counts them, which `append` writes.
    ///
    /// # Errors
    /// Why there is no room for it.
    pub(super) fn push_small<T>(
        &mut self,
        bytes: usize,
        print: Option<Fingerprint>,
        mut append: impl FnMut(&mut Vec<u8>) -> T,
    ) -> Result<Option<T>, DropReason> {
        let mut appended = None;
        let takes = |last: &mut Outgoing| {
            if let Outgoing::Batch(batch) = last {
                appended = batch.take(bytes, print, &mut append);
            }
            appended.is_some()
        };
        if !self.entries.extend(bytes, takes)? {
            let mut batch = self.spare.take().unwrap_or_default();
            appended = batch.take(bytes, print, append);
            self.push_entry(Outgoing::Batch(batch))?;
            self.of_publishers += 1;
        }
        self.published += 1;
        Ok(appended)
    }

    fn push_entry(&mut self, entry: Outgoing) -> Result<(), DropReason> {
        let pushed = self.entries.push(entry, usize::MAX, Overflow::DropNewest, drop);
        pushed.map_err(|(_, reason)| reason)
    }

    /// Number of messages that wait, which are counted against the high-water mark.
    pub(super) fn waiting(&self) -> usize {
        let first = self.entries.iter().next();
        let written = first.map_or(0, |first| first.written(self.entries.written()));
        self.published.saturating_sub(written)
    }

    /// Number of words of the protocol that wait.
    pub(super) fn words(&self) -> usize {
        self.entries.len().saturating_sub(self.of_publishers)
    }

    /// Messages of a publisher that were not sent as a whole: the size of each as its publisher counts it, and its
    /// fingerprint.
    pub(super) fn unsent(&self) -> impl Iterator<Item = (usize, Option<Fingerprint>)> {
        let mut written = self.entries.written();
        self.entries.iter().flat_map(move |one| one.published(std::mem::take(&mut written)))
    }

    /// Messages that are in no batch.
    pub(super) fn messages(&self) -> impl Iterator<Item = &Arc<Message>> {
        self.entries.iter().filter_map(Outgoing::message)
    }

    /// True where nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// True where the other side has taken nothing of what waits for too long.
    pub(super) fn stands_still(&self, now: Instant) -> bool {
        self.entries.stands_still(now)
    }

    /// Bytes of the batch that goes first, and how many of them are written, for a thread that writes them without the
    /// connection's lock and tells [`Self::note_written`].
    pub(super) fn batch(&mut self) -> Option<(Arc<Vec<u8>>, usize)> {
        let written = self.entries.written();
        let Some(Outgoing::Batch(batch)) = self.entries.first() else { return None };
        Some((batch.bytes(), written))
    }

    /// Writes until nothing waits, or until `write` would block, which is told as false.
    ///
    /// # Errors
    /// Those of `write`.
    pub(super) fn write(
        &mut self,
        write: impl FnMut(&[IoSlice<'_>]) -> IoResult<usize>,
    ) -> IoResult<bool> {
        let mut left = Left::default();
        let is_empty = self.entries.write(write, |sent| left.note(sent));
        self.note_left(left);
        is_empty
    }

    /// Takes note that the first `count` bytes of what waits were written by another than [`Self::write`].
    pub(super) fn note_written(&mut self, count: usize) {
        let mut left = Left::default();
        self.entries.note_written(count, |sent| left.note(sent));
        self.note_left(left);
    }

    fn note_left(&mut self, left: Left) {
        self.published = self.published.saturating_sub(left.messages);
        self.of_publishers = self.of_publishers.saturating_sub(left.entries);
        self.spare = left.spare.or(self.spare.take());
    }

    /// Gives the memory back that is kept for the next batch.
    pub(super) fn give_spare_back(&mut self) {
        self.spare = None;
    }
}

/// Entries that have left the queue, sent as a whole.
#[derive(Default)]
struct Left {
    /// Messages of a publisher.
    messages: usize,
    /// Entries that had some.
    entries: usize,
    /// Memory of a batch, for the next.
    spare: Option<Box<Batch>>,
}

impl Left {
    fn note(&mut self, sent: Outgoing) {
        let messages = sent.published(0).count();
        self.messages += messages;
        self.entries += usize::from(messages > 0);
        if let Outgoing::Batch(batch) = sent {
            self.spare = batch.emptied();
        }
    }
}

#[cfg(test)]
impl Queue {
    /// Takes out all that waits, and returns how many entries it was.
    pub(super) fn clear(&mut self) -> usize {
        (self.published, self.of_publishers) = (0, 0);
        self.entries.drain().count()
    }

    /// True where messages of the batch that goes first are written.
    pub(super) fn is_within_batch(&self) -> bool {
        self.waiting() < self.published
    }
}
