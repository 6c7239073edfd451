//! Buffers of large messages, to be used again: a new one for each image costs more than the image.
//!
//! ```text
//!   payload ──▶ reader        when the reader has dropped it,
//!      └─ a second handle ──▶ the next payload is read into the same memory
//! ```

use std::collections::VecDeque;

use bytes::{Bytes, BytesMut};

/// Payloads of fewer bytes are not kept: the allocator is good at those.
const LARGE: usize = 64 * 1024;
/// Most bytes that one connection keeps.
const MAX_KEPT: usize = 8 << 20;

/// Large payloads that a connection has delivered.
#[derive(Debug, Default)]
pub(super) struct Spare {
    kept: VecDeque<Bytes>,
    bytes: usize,
}

impl Spare {
    /// Takes note of a payload that is delivered.
    pub(super) fn keep(&mut self, payload: &Bytes) {
        if !(LARGE..=MAX_KEPT).contains(&payload.len()) {
            return;
        }
        self.kept.push_back(payload.clone());
        self.bytes += payload.len();
        while self.bytes > MAX_KEPT {
            let oldest = self.kept.pop_front().map_or(0, |payload| payload.len());
            self.bytes = self.bytes.saturating_sub(oldest);
        }
    }

    /// Makes room for `more` bytes behind those in `buffer`: in memory that is not used any more,
    /// where there is some.
    pub(super) fn make_room(&mut self, buffer: &mut BytesMut, more: usize) {
        let size = buffer.len().saturating_add(more);
        if more >= LARGE && buffer.capacity() < size {
            // The one that was used last is the likeliest to be in a cache.
            let free = self.kept.iter().rposition(|kept| kept.is_unique() && kept.len() >= size);
            if let Some(kept) = free.and_then(|at| self.kept.remove(at)) {
                self.bytes = self.bytes.saturating_sub(kept.len());
                if let Ok(mut memory) = kept.try_into_mut() {
                    memory.clear();
                    memory.extend_from_slice(buffer);
                    *buffer = memory;
                }
            }
        }
        buffer.reserve(more);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A payload as a connection reads it.
    fn payload(spare: &mut Spare, size: usize) -> Bytes {
        let mut buffer = BytesMut::from(&b"begun"[..]);
        let begun = buffer.len();
        spare.make_room(&mut buffer, size - begun);
        buffer.resize(size, 7);
        let payload = buffer.split_to(size).freeze();
        spare.keep(&payload);
        assert_eq!(payload[..5], *b"begun");
        payload
    }

    #[test]
    fn memory_is_used_again_once_it_is_free() {
        let mut spare = Spare::default();
        let first = payload(&mut spare, 100_000);
        let place = first.as_ptr();
        let second = payload(&mut spare, 100_000);
        assert_ne!(second.as_ptr(), place, "the first one is in use");
        assert!(first[5..].iter().all(|&byte| byte == 7));
        drop(first);
        assert_eq!(payload(&mut spare, 90_000).as_ptr(), place);
        assert_eq!(second.len(), 100_000);
    }

    #[test]
    fn a_connection_keeps_no_more_than_its_share() {
        let mut spare = Spare::default();
        let held: Vec<_> = (0..20).map(|_| payload(&mut spare, 1 << 20)).collect();
        assert_eq!(held.len(), 20);
        assert_eq!((spare.kept.len(), spare.bytes), (8, MAX_KEPT));
        payload(&mut spare, 1000);
        payload(&mut spare, 9 << 20);
        assert_eq!(spare.kept.len(), 8);
    }
}
