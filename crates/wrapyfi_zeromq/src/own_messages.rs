//! Knows our own messages again when the broker sends them back.
//!
//! ```text
//!   publish ──▶ remember(frames) ──▶ broker ──▶ is_own(frames) ──▶ dropped, token spent
//!                      └── one token per message, for some seconds ──┘
//! ```
//!
//! Wrapyfi's frames have no room for a sender's mark, so a message is known by length and hash.
//! Each token is spent once: an equal message from another program still arrives.

use std::collections::{HashMap, VecDeque};
use std::hash::{BuildHasher, RandomState};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use wrapyfi_endpoint::{Clock, Mutex};

/// Longest time that a message may be under way to the broker and back.
const LIFETIME: Duration = Duration::from_secs(10);
/// Messages remembered at most per topic; beyond, the oldest are forgotten.
const MAX_TOKENS: usize = 16_384;

/// Tokens of all topics of one ZeroMQ instance.
#[derive(Default)]
pub(super) struct OwnMessages(Mutex<HashMap<String, Arc<OwnTopic>>>);

impl OwnMessages {
    /// The tokens of `topic`, shared by its publishers and listeners here.
    pub(super) fn of(&self, topic: &str) -> Arc<OwnTopic> {
        let mut topics = self.0.lock();
        topics.retain(|_, own| Arc::strong_count(own) > 1);
        Arc::clone(topics.entry(topic.to_owned()).or_default())
    }
}

/// Tokens of one topic.
#[derive(Default)]
pub(super) struct OwnTopic {
    listeners: AtomicUsize,
    hasher: RandomState,
    tokens: Mutex<VecDeque<Token>>,
}

/// Length and hash of all frames. The hash is seeded per topic, so no other program can make a
/// message that is taken for ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fingerprint {
    length: usize,
    hash: u64,
}

struct Token {
    print: Fingerprint,
    /// Listeners here that have still to see it.
    left: usize,
    sent_at: Instant,
}

/// Marks a topic as listened to here, while it lives.
pub(super) struct Listening(Arc<OwnTopic>);

impl Listening {
    pub(super) fn new(own: Arc<OwnTopic>) -> Self {
        own.listeners.fetch_add(1, Relaxed);
        Self(own)
    }

    /// True when these frames were published here; its token is spent then.
    pub(super) fn is_own<B: AsRef<[u8]>>(&self, frames: &[B], clock: &Clock) -> bool {
        if self.0.tokens.lock().is_empty() {
            return false;
        }
        let (print, now) = (self.0.fingerprint(frames), clock.now());
        let mut tokens = self.0.tokens.lock();
        // Usually the first: a broker keeps the order.
        let found = tokens.iter().position(|token| token.print == print && !token.expired(now));
        let Some(at) = found else { return false };
        if let Some(token) = tokens.get_mut(at) {
            token.left = token.left.saturating_sub(1);
            if token.left == 0 {
                tokens.remove(at);
            }
        }
        true
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.0.listeners.fetch_sub(1, Relaxed);
    }
}

impl OwnTopic {
    /// Remembers a message about to be published. Costs nothing, and gives `None`, where no
    /// listener is here.
    pub(super) fn remember<B: AsRef<[u8]>>(
        &self,
        frames: &[B],
        clock: &Clock,
    ) -> Option<Fingerprint> {
        let listeners = self.listeners.load(Relaxed);
        if listeners == 0 {
            return None;
        }
        let (print, now) = (self.fingerprint(frames), clock.now());
        let mut tokens = self.tokens.lock();
        while tokens.len() >= MAX_TOKENS || tokens.front().is_some_and(|token| token.expired(now)) {
            tokens.pop_front();
        }
        tokens.push_back(Token { print, left: listeners, sent_at: now });
        Some(print)
    }

    /// Takes back the token of a message that was not sent after all, where it has one.
    pub(super) fn forget(&self, print: Option<Fingerprint>) {
        let Some(print) = print else { return };
        let mut tokens = self.tokens.lock();
        if let Some(at) = tokens.iter().rposition(|token| token.print == print) {
            tokens.remove(at);
        }
    }

    fn fingerprint<B: AsRef<[u8]>>(&self, frames: &[B]) -> Fingerprint {
        let seed = self.hasher.hash_one(frames.len());
        frames.iter().fold(Fingerprint { length: 0, hash: seed }, |print, frame| {
            let frame = frame.as_ref();
            Fingerprint { length: print.length + frame.len(), hash: mix(print.hash, frame) }
        })
    }
}

impl Token {
    fn expired(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.sent_at) > LIFETIME
    }
}

/// Multiply-and-fold over eight bytes at a time: images are hashed at memory speed, where the
/// standard library's hash would cost a millisecond per megabyte.
fn mix(mut hash: u64, bytes: &[u8]) -> u64 {
    const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;
    let fold = |hash: u64, word: u64| {
        let product = u128::from(hash ^ word ^ FACTOR) * u128::from(FACTOR);
        // Both halves are used.
        let folded = (product as u64) ^ ((product >> 64) as u64);
        folded.rotate_left(23)
    };
    let (words, rest) = bytes.as_chunks::<8>();
    for word in words {
        hash = fold(hash, u64::from_le_bytes(*word));
    }
    let tail = rest.iter().fold(0, |tail, &byte| tail << 8 | u64::from(byte));
    fold(fold(hash, tail), bytes.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_spent_once() {
        let clock = Clock::default();
        let own_messages = OwnMessages::default();
        let own = own_messages.of("/a");
        own.remember(&[b"/a", b"1 "], &clock);
        let listening = Listening::new(own_messages.of("/a"));
        assert!(!listening.is_own(&[b"/a", b"1 "], &clock), "nobody listened when it was sent");
        own.remember(&[b"/a", b"1 "], &clock);
        own.remember(&[b"/a", b"1 "], &clock);
        own.remember(&[b"/a", b"2 "], &clock);
        assert!(!listening.is_own(&[b"/a", b"3 "], &clock));
        assert!(listening.is_own(&[b"/a", b"2 "], &clock));
        assert!(!listening.is_own(&[b"/a", b"2 "], &clock));
        assert!(listening.is_own(&[b"/a", b"1 "], &clock));
        assert!(listening.is_own(&[b"/a", b"1 "], &clock));
        assert!(!listening.is_own(&[b"/a", b"1 "], &clock));
        own.forget(own.remember(&[b"/a", b"4 "], &clock));
        assert!(!listening.is_own(&[b"/a", b"4 "], &clock), "it was never sent");
    }

    #[test]
    fn each_listener_sees_it_once() {
        let clock = Clock::default();
        let own_messages = OwnMessages::default();
        let (one, two) =
            (Listening::new(own_messages.of("/a")), Listening::new(own_messages.of("/a")));
        own_messages.of("/a").remember(&[b"x"], &clock);
        assert!(one.is_own(&[b"x"], &clock));
        assert!(two.is_own(&[b"x"], &clock));
        assert!(!one.is_own(&[b"x"], &clock));
    }

    #[test]
    fn tokens_expire_and_are_bounded() {
        let own_messages = OwnMessages::default();
        let own = own_messages.of("/a");
        let listening = Listening::new(Arc::clone(&own));
        let now = Instant::now();
        let (then, later) = (Clock::new(move || now), Clock::new(move || now + 2 * LIFETIME));
        own.remember(&[b"old"], &then);
        assert!(!listening.is_own(&[b"old"], &later));
        for n in 0..2 * MAX_TOKENS {
            own.remember(&[n.to_le_bytes()], &then);
        }
        assert_eq!(own.tokens.lock().len(), MAX_TOKENS);
        drop(listening);
        assert!(Arc::strong_count(&own) == 2, "the map and this test");
    }

    #[test]
    fn frame_borders_and_order_matter() {
        let own = OwnTopic::default();
        assert_ne!(own.fingerprint(&[&b"ab"[..], b"c"]), own.fingerprint(&[&b"a"[..], b"bc"]));
        assert_ne!(
            own.fingerprint(&[b"12345678", b"abcdefgh"]),
            own.fingerprint(&[b"abcdefgh", b"12345678"])
        );
        assert_eq!(own.fingerprint(&[b"12345678"]), own.fingerprint(&[b"12345678"]));
    }
}
