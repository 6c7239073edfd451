//! Queue of messages that wait to be written to one peer, with its share of the budget of waiting bytes.
//!
//! ```text
//!   push ─▶ [ begun │ … │ newest ] ── write, or first and pop ──▶ the peer
//!           full: the oldest that has not begun, or the newest, gives way
//! ```

use std::collections::VecDeque;
use std::io::{ErrorKind, IoSlice, Result as IoResult};
use std::time::Instant;

use super::budget::{PROGRESS, Share};
use super::counters::DropReason;
use super::inbox::{Overflow, Waits};

/// Number of pieces that one write is given at most.
const SLICES: usize = 64;

/// A message as it goes on the wire.
pub trait Pieces: Waits {
    /// Its bytes, in pieces.
    fn pieces(&self) -> impl Iterator<Item = &[u8]>;
}

/// Queue of messages for one peer.
#[derive(Debug)]
pub struct Outbox<M> {
    waiting: VecDeque<M>,
    has_begun: bool,
    /// Number of bytes of the first message that are written.
    written: usize,
    share: Share,
    /// Time at which the first message came, one left or a byte was written, whichever is latest.
    moved_at: Option<Instant>,
    messages: u64,
    bytes: u64,
}

impl<M> Default for Outbox<M> {
    fn default() -> Self {
        Self::of(Share::default())
    }
}

impl<M> Outbox<M> {
    /// A queue whose bytes count in `share`.
    pub fn of(share: Share) -> Self {
        let waiting = VecDeque::new();
        Self { waiting, has_begun: false, written: 0, share, moved_at: None, messages: 0, bytes: 0 }
    }

    /// A queue for another peer, within the same budget.
    #[must_use]
    pub fn beside<N>(&self) -> Outbox<N> {
        Outbox::of(self.share.beside())
    }
}

impl<M: Waits> Outbox<M> {
    /// Puts a message behind the others, of which at most `depth` wait. `lose` is given the one that gives way: the
    /// oldest under [`Overflow::DropOldest`], unless it has begun.
    ///
    /// # Errors
    /// The given message, and why it is not taken: `depth` messages wait, or the budget of waiting bytes has no room.
    pub fn push(
        &mut self,
        message: M,
        depth: usize,
        overflow: Overflow,
        lose: impl FnOnce(M),
    ) -> Result<(), (M, DropReason)> {
        if self.waiting.len() >= depth.max(1) {
            let oldest = match overflow {
                Overflow::DropOldest => self.waiting.remove(usize::from(self.has_begun)),
                Overflow::DropNewest | Overflow::Block(_) => None,
            };
            let Some(oldest) = oldest else { return Err((message, DropReason::SendQueueFull)) };
            self.share.give(oldest.bytes());
            lose(oldest);
        }
        if !self.share.take(message.bytes()) {
            return Err((message, DropReason::OverBudget));
        }
        if self.waiting.is_empty() {
            self.moved_at = Some(Instant::now());
        }
        self.waiting.push_back(message);
        Ok(())
    }

    /// Has the newest message take `bytes` bytes more, as which it then counts; false where there is none that `takes` them.
    ///
    /// # Errors
    /// The budget of waiting bytes has no room.
    pub fn extend(
        &mut self,
        bytes: usize,
        takes: impl FnOnce(&mut M) -> bool,
    ) -> Result<bool, DropReason> {
        let Some(last) = self.waiting.back_mut() else { return Ok(false) };
        if !self.share.take(bytes) {
            return Err(DropReason::OverBudget);
        }
        let is_taken = takes(last);
        if !is_taken {
            self.share.give(bytes);
        }
        Ok(is_taken)
    }

    /// The first message, which has begun and does not give way any more.
    pub fn first(&mut self) -> Option<&M> {
        let first = self.waiting.front();
        self.has_begun = first.is_some();
        first
    }

    /// Takes the first message out.
    pub fn pop(&mut self) -> Option<M> {
        let first = self.remove()?;
        self.share.give(first.bytes());
        self.moved_at = Some(Instant::now());
        Some(first)
    }

    /// Takes the first message out, whose bytes are still to be given back.
    fn remove(&mut self) -> Option<M> {
        let first = self.waiting.pop_front()?;
        (self.has_begun, self.written) = (false, 0);
        self.messages += 1;
        Some(first)
    }

    /// Takes out the messages that do not stay.
    pub fn retain(&mut self, stays: impl Fn(&M) -> bool) {
        let share = &self.share;
        self.waiting.retain(|message| {
            let stays = stays(message);
            share.give(if stays { 0 } else { message.bytes() });
            stays
        });
    }

    /// Takes all messages out.
    pub fn drain(&mut self) -> impl Iterator<Item = M> + use<M> {
        _ = self.share.hold(0);
        (self.has_begun, self.written) = (false, 0);
        std::mem::take(&mut self.waiting).into_iter()
    }

    /// Messages that wait, the oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &M> {
        self.waiting.iter()
    }

    /// Number of messages that wait.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// True where no message waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// True where messages wait, of which for [`PROGRESS`] no byte was written.
    pub fn stands_still(&self, now: Instant) -> bool {
        let quiet = self.moved_at.map(|at| now.saturating_duration_since(at));
        !self.waiting.is_empty() && quiet.is_some_and(|quiet| quiet >= PROGRESS)
    }

    /// Number of bytes of the first message that are written.
    pub fn written(&self) -> usize {
        self.written
    }

    /// Number of messages and of bytes that were ever written.
    pub fn sent(&self) -> (u64, u64) {
        (self.messages, self.bytes)
    }
}

impl<M: Pieces> Outbox<M> {
    /// Writes until nothing waits, or until `write` would block, which is told as false. `sent` is given each message
    /// that is written whole.
    ///
    /// # Errors
    /// Those of `write`, [`ErrorKind::WriteZero`] where it takes nothing.
    pub fn write(
        &mut self,
        mut write: impl FnMut(&[IoSlice<'_>]) -> IoResult<usize>,
        mut sent: impl FnMut(M),
    ) -> IoResult<bool> {
        while !self.waiting.is_empty() {
            let (mut slices, mut count) = ([IoSlice::new(&[]); SLICES], 0);
            let mut skip = self.written;
            for piece in self.waiting.iter().flat_map(M::pieces) {
                let rest = piece.get(skip..).unwrap_or_default();
                skip = skip.saturating_sub(piece.len());
                if !rest.is_empty() {
                    let Some(place) = slices.get_mut(count) else { break };
                    *place = IoSlice::new(rest);
                    count += 1;
                }
            }
            match write(slices.get(..count).unwrap_or_default()) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(bytes) => self.note_written(bytes, &mut sent),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(true)
    }

    /// Takes note that the next `count` bytes of what waits are written; bytes beyond that do not count. `sent` is given
    /// each message that is written whole.
    pub fn note_written(&mut self, count: usize, mut sent: impl FnMut(M)) {
        if count == 0 {
            return;
        }
        let (mut left, mut bytes) = (self.written + count, 0);
        while let Some(first) = self.waiting.front()
            && let Some(rest) = left.checked_sub(first.pieces().map(<[u8]>::len).sum())
        {
            bytes += first.bytes();
            self.remove().into_iter().for_each(&mut sent);
            left = rest;
        }
        self.share.give(bytes);
        let beyond = if self.waiting.is_empty() { std::mem::take(&mut left) } else { 0 };
        self.bytes += count.saturating_sub(beyond) as u64;
        (self.written, self.has_begun) = (left, left > 0);
        self.moved_at = Some(Instant::now());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    impl Waits for &'static str {
        fn bytes(&self) -> usize {
            self.len()
        }
    }

    impl Pieces for &'static str {
        fn pieces(&self) -> impl Iterator<Item = &[u8]> {
            let (head, body) = self.split_at(1);
            [head.as_bytes(), b"", body.as_bytes()].into_iter()
        }
    }

    /// Writes at most `room` bytes, and then no more.
    fn socket<'o>(
        out: &'o mut Vec<u8>,
        mut room: usize,
    ) -> impl FnMut(&[IoSlice<'_>]) -> IoResult<usize> + 'o {
        move |slices| {
            let bytes: Vec<u8> = slices.iter().flat_map(|one| one.iter().copied()).collect();
            let count = bytes.len().min(room);
            room -= count;
            out.extend_from_slice(&bytes[..count]);
            if count == 0 { Err(ErrorKind::WouldBlock.into()) } else { Ok(count) }
        }
    }

    #[test]
    fn a_message_that_has_begun_ends_and_others_give_way() {
        let (mut outbox, mut lost, mut out) = (Outbox::default(), Vec::new(), Vec::new());
        for message in ["one", "two"] {
            outbox.push(message, 2, Overflow::DropOldest, |_| panic!("there is room")).unwrap();
        }
        assert!(!outbox.write(socket(&mut out, 2), |_| panic!("it is not whole")).unwrap());
        for message in ["three", "four"] {
            outbox.push(message, 2, Overflow::DropOldest, |gone| lost.push(gone)).unwrap();
        }
        assert_eq!(lost, ["two", "three"]);
        let newest = outbox.push("five", 2, Overflow::DropNewest, |_| panic!("it is refused"));
        assert_eq!(newest, Err(("five", DropReason::SendQueueFull)));
        let mut sent = Vec::new();
        assert!(outbox.write(socket(&mut out, 99), |whole| sent.push(whole)).unwrap());
        assert_eq!((out.as_slice(), sent), (&b"onefour"[..], vec!["one", "four"]));
        assert_eq!((outbox.sent(), outbox.is_empty(), outbox.share.used()), ((2, 7), true, 0));
    }

    #[test]
    fn the_newest_message_takes_more_where_there_is_room() {
        static SMALL: crate::budget::Budget = crate::budget::Budget::new(30);
        let mut outbox = Outbox::of(Share::of(&SMALL));
        let grow = |outbox: &mut Outbox<&'static str>, to| {
            outbox.extend(2, |last| {
                *last = to;
                true
            })
        };
        assert_eq!(grow(&mut outbox, "none"), Ok(false));
        outbox.push("one", 9, Overflow::DropNewest, drop).unwrap();
        assert_eq!(outbox.extend(2, |_| false), Ok(false));
        assert_eq!(grow(&mut outbox, "oneup"), Ok(true));
        assert_eq!(outbox.extend(3, |_| panic!("no room")), Err(DropReason::OverBudget));
        let mut out = Vec::new();
        assert!(!outbox.write(socket(&mut out, 4), |_| panic!("it is not whole")).unwrap());
        assert_eq!(grow(&mut outbox, "oneuply"), Ok(true));
        assert!(outbox.write(socket(&mut out, 99), drop).unwrap());
        assert_eq!((out.as_slice(), outbox.share.used()), (&b"oneuply"[..], 0));
    }

    #[test]
    fn the_only_message_does_not_give_way_once_it_has_begun() {
        let mut outbox = Outbox::default();
        outbox.push("one", 1, Overflow::DropOldest, drop).unwrap();
        assert_eq!(outbox.first(), Some(&"one"));
        let full = outbox.push("two", 1, Overflow::DropOldest, |_| panic!("it has begun"));
        assert_eq!(full, Err(("two", DropReason::SendQueueFull)));
        assert_eq!((outbox.pop(), outbox.share.used()), (Some("one"), 0));
    }

    #[test]
    fn a_peer_that_takes_nothing_stands_still() {
        let (mut outbox, now) = (Outbox::default(), Instant::now());
        let late = now + PROGRESS + Duration::from_secs(1);
        assert!(!outbox.stands_still(late), "nothing waits for it");
        outbox.push("one", 1, Overflow::DropOldest, drop).unwrap();
        assert!(!outbox.stands_still(now));
        assert!(outbox.stands_still(late));
        assert_eq!(outbox.drain().collect::<Vec<_>>(), ["one"]);
        assert_eq!((outbox.stands_still(late), outbox.share.used()), (false, 0));
    }
}
