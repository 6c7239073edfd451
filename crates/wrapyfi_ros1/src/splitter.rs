//! A TCPROS stream as messages: `u32 size │ body │ u32 size │ body …`
//!
//! ```text
//!   socket ─▶ small buffer (many messages a read) ─▶ Message
//!        └─▶ buffer of the declared size (large messages, read straight into place) ─▶ Message
//!                    ▲ one of a few, the first whose message is gone
//! ```
//!
//! The splitter has no socket: [`Splitter::space`] says where bytes go, [`Splitter::next`] what they make. A message is
//! a part of the buffer it was read into, never a copy; a buffer is used again once its messages are
//! gone.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use bytes::buf::Limit;
use bytes::{BufMut as _, Bytes, BytesMut};
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpStream;
use tokio::time::timeout;

use wrapyfi_endpoint::{DropReason, Share};

/// Bytes of the size in front of a message.
const SIZE: usize = 4;
/// Space for small messages; what is larger gets a buffer of its own.
const SMALL: usize = 64 * 1024;
/// Buffers for large messages that are kept: one is being filled while the messages in others are
/// still at work. Memory that is new for each message costs more than to receive it.
const KEPT: usize = 4;
/// Size beyond which no node sends: it means a stream that lost its place. roscpp draws the line at
/// the same size.
const ABSURD: usize = 1_000_000_000;

/// Result of taking the next message out of the stream.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Piece {
    /// A message without its size.
    Message(Bytes),
    /// A message over the limit, so many bytes large. It is read and thrown away.
    Oversize(usize),
}

/// A size that cannot be one.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("a message of {0} bytes is announced: the stream has lost its place")]
pub(super) struct Lost(pub(super) usize);

/// Reason why no more bytes come.
#[derive(Debug, thiserror::Error)]
pub(super) enum Ended {
    #[error("it closed the connection")]
    Closed,
    #[error("the connection broke: {0}")]
    Broken(#[from] io::Error),
    #[error("a message has begun, and nothing more of it came for {0:?}")]
    NoProgress(Duration),
    #[error(
        "no room for a message of {0} bytes so far: too much waits in this process (limits: waiting_mib)"
    )]
    OverBudget(usize),
}

impl Ended {
    /// Reason as which the message is counted that had begun.
    pub(super) fn drop_reason(&self) -> DropReason {
        match self {
            Self::OverBudget(_) => DropReason::OverBudget,
            Self::Closed | Self::Broken(_) | Self::NoProgress(_) => DropReason::ConnectionLost,
        }
    }
}

/// Reads at least a byte. A message that has begun counts in `share`, and its next byte comes within `limit`,
/// or never.
pub(super) async fn read(
    stream: &mut TcpStream,
    splitter: &mut Splitter,
    share: &Share,
    limit: Duration,
) -> Result<(), Ended> {
    if !share.hold(splitter.begun()) {
        return Err(Ended::OverBudget(splitter.begun()));
    }
    let is_within = splitter.is_within();
    let mut space = splitter.space();
    let read = stream.read_buf(&mut space);
    let read = if is_within {
        timeout(limit, read).await.map_err(|_elapsed| Ended::NoProgress(limit))?
    } else {
        read.await
    };
    match read? {
        0 => Err(Ended::Closed),
        bytes => {
            splitter.filled(bytes);
            Ok(())
        }
    }
}

#[derive(Debug)]
pub(super) struct Splitter {
    limit: usize,
    small: BytesMut,
    large: BytesMut,
    /// Buffers of large messages before, the oldest first.
    kept: VecDeque<BytesMut>,
    /// Bytes that the large buffer still waits for.
    missing: usize,
    /// Bytes to throw away.
    skip: usize,
}

impl Splitter {
    /// Messages of at most `limit` bytes.
    pub(super) fn new(limit: usize) -> Self {
        let (small, large, kept) = (BytesMut::new(), BytesMut::new(), VecDeque::new());
        Self { limit, small, large, kept, missing: 0, skip: 0 }
    }

    /// Buffer for the next bytes of the connection.
    pub(super) fn space(&mut self) -> Limit<&mut BytesMut> {
        if self.missing > 0 {
            return (&mut self.large).limit(self.missing);
        }
        // Takes the same memory again where no message in it is held.
        if self.small.capacity() - self.small.len() < SMALL / 2 {
            self.small.reserve(SMALL);
        }
        let room = self.small.capacity() - self.small.len();
        (&mut self.small).limit(room)
    }

    /// Notes that `bytes` bytes were put into [`Splitter::space`].
    pub(super) fn filled(&mut self, bytes: usize) {
        self.missing = self.missing.saturating_sub(bytes);
    }

    /// Bytes of a message that has begun; none while one is passed over.
    pub(super) fn begun(&self) -> usize {
        if self.missing > 0 { self.large.len() + SIZE } else { self.small.len() }
    }

    /// True while a message has begun and has not ended.
    pub(super) fn is_within(&self) -> bool {
        self.begun() > 0 || self.skip > 0
    }

    /// Takes the next message out of the bytes so far; `None` where more are needed.
    pub(super) fn next(&mut self) -> Result<Option<Piece>, Lost> {
        if self.missing > 0 {
            return Ok(None);
        }
        if !self.large.is_empty() {
            let message = self.large.split().freeze();
            self.kept.push_back(std::mem::take(&mut self.large));
            return Ok(Some(Piece::Message(message)));
        }
        let thrown = self.skip.min(self.small.len());
        drop(self.small.split_to(thrown));
        self.skip -= thrown;
        let Some(size) = self.small.first_chunk::<SIZE>() else { return Ok(None) };
        let size = usize::try_from(u32::from_le_bytes(*size)).unwrap_or(usize::MAX);
        if size > ABSURD {
            return Err(Lost(size));
        }
        if size > self.limit {
            drop(self.small.split_to(SIZE));
            self.skip = size;
            return Ok(Some(Piece::Oversize(size)));
        }
        if self.small.len() - SIZE >= size {
            drop(self.small.split_to(SIZE));
            return Ok(Some(Piece::Message(self.small.split_to(size).freeze())));
        }
        if size > SMALL / 2 {
            drop(self.small.split_to(SIZE));
            let begun = self.small.split();
            self.large = self.buffer(size);
            self.large.extend_from_slice(&begun);
            self.missing = size - begun.len();
        }
        Ok(None)
    }

    /// Room for a message of `size` bytes, in memory that was used before where there is some.
    fn buffer(&mut self, size: usize) -> BytesMut {
        if let Some(free) = self.kept.iter_mut().position(|buffer| buffer.try_reclaim(size))
            && let Some(buffer) = self.kept.remove(free)
        {
            return buffer;
        }
        // The memory of a dropped buffer lives on in its message.
        if self.kept.len() >= KEPT {
            self.kept.pop_front();
        }
        BytesMut::with_capacity(size)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Feeds `stream` in portions of at most `portion` bytes.
    fn split(stream: &[u8], portion: usize, limit: usize) -> Result<Vec<Piece>, Lost> {
        let mut splitter = Splitter::new(limit);
        let mut pieces = Vec::new();
        let mut rest = stream;
        while !rest.is_empty() {
            let mut space = splitter.space();
            let bytes = portion.min(rest.len()).min(space.remaining_mut());
            assert!(bytes > 0, "no space");
            let (now, later) = rest.split_at(bytes);
            space.put_slice(now);
            splitter.filled(bytes);
            rest = later;
            while let Some(piece) = splitter.next()? {
                pieces.push(piece);
            }
        }
        Ok(pieces)
    }

    fn framed(body: &[u8]) -> Vec<u8> {
        [&u32::try_from(body.len()).unwrap().to_le_bytes()[..], body].concat()
    }

    /// Feeds one message and hands it out.
    fn feed(splitter: &mut Splitter, body: &[u8]) -> Bytes {
        let mut stream = &framed(body)[..];
        loop {
            if let Some(Piece::Message(message)) = splitter.next().unwrap() {
                assert!(stream.is_empty());
                return message;
            }
            let mut space = splitter.space();
            let (now, later) = stream.split_at(space.remaining_mut().min(stream.len()));
            space.put_slice(now);
            splitter.filled(now.len());
            stream = later;
        }
    }

    /// Reads from a peer that sends `begun` and then nothing.
    async fn read_from(begun: &[u8], share: &Share) -> (Ended, usize) {
        use tokio::io::AsyncWriteExt as _;
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let mut peer = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        let (mut stream, _) = listener.accept().await.unwrap();
        let begun = begun.to_vec();
        tokio::spawn(async move {
            peer.write_all(&begun).await.unwrap();
            std::future::pending::<()>().await;
        });
        let mut splitter = Splitter::new(1 << 20);
        loop {
            let limit = Duration::from_millis(100);
            if let Err(ended) = read(&mut stream, &mut splitter, share, limit).await {
                return (ended, splitter.begun());
            }
            assert_eq!(splitter.next(), Ok(None));
        }
    }

    #[test]
    fn a_message_that_has_begun_goes_on_and_counts_in_the_budget() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let begun = &framed(&[7; 500_000])[..300_000];
        runtime.block_on(async {
            let share = Share::default();
            let (ended, held) = read_from(begun, &share).await;
            assert!(matches!(ended, Ended::NoProgress(_)), "{ended}");
            assert_eq!((held, share.used()), (300_000, 300_000));
            static SMALL: wrapyfi_endpoint::Budget = wrapyfi_endpoint::Budget::new(400_000);
            let (ended, held) = read_from(begun, &Share::of(&SMALL)).await;
            assert!(matches!(ended, Ended::OverBudget(_)), "{ended}");
            assert!(held > 100_000, "a quarter was taken: {held}");
            assert_eq!(SMALL.used(), 0);
        });
    }

    #[test]
    fn memory_is_used_again_though_the_last_message_is_still_at_work() {
        let mut splitter = Splitter::new(1 << 20);
        let mut places = std::collections::BTreeSet::new();
        let mut at_work = VecDeque::new();
        for n in 0..50_u8 {
            let message = feed(&mut splitter, &vec![n; 300_000]);
            assert!(message.iter().all(|byte| *byte == n));
            places.insert(message.as_ptr() as usize);
            at_work.push_back(message);
            if at_work.len() > 2 {
                at_work.pop_front();
            }
        }
        assert!((2..=KEPT).contains(&places.len()), "{places:?}");
        // A consumer that holds more messages than that gets new memory, and loses nothing.
        let held: Vec<Bytes> = (0..20_u8).map(|n| feed(&mut splitter, &vec![n; 100_000])).collect();
        for (n, message) in (0_u8..).zip(&held) {
            assert!(message.iter().all(|byte| *byte == n));
        }
        assert!(splitter.kept.len() <= KEPT);
    }

    #[test]
    fn a_large_message_is_read_into_place() {
        let body = vec![7; 300_000];
        let stream = [framed(&body), framed(b"after")].concat();
        let mut splitter = Splitter::new(1 << 20);
        splitter.space().put_slice(&stream[..1000]);
        splitter.filled(1000);
        assert_eq!(splitter.next(), Ok(None));
        assert_eq!(splitter.space().remaining_mut(), 300_004 - 1000, "and not a byte of the next");
        let pieces = split(&stream, 100_000, 1 << 20).unwrap();
        assert_eq!(pieces, [Piece::Message(body.into()), Piece::Message("after".into())]);
    }

    #[test]
    fn memory_is_used_again_when_the_message_is_gone() {
        let mut splitter = Splitter::new(1 << 20);
        let mut places = Vec::new();
        for _ in 0..3 {
            let stream = framed(&vec![1; 200_000]);
            let mut rest = &stream[..];
            while !rest.is_empty() {
                let bytes = rest.len().min(splitter.space().remaining_mut());
                splitter.space().put_slice(&rest[..bytes]);
                splitter.filled(bytes);
                rest = &rest[bytes..];
                if let Some(Piece::Message(message)) = splitter.next().unwrap() {
                    places.push(message.as_ptr());
                }
            }
        }
        assert_eq!(places.len(), 3);
        assert_eq!(places[1], places[2]);
    }

    #[test]
    fn what_is_too_large_is_passed_over_and_what_is_absurd_ends_it() {
        let stream = [framed(&[1; 90_000]), framed(b"next"), framed(b"")].concat();
        let pieces = split(&stream, 5000, 80_000).unwrap();
        let expected =
            [Piece::Oversize(90_000), Piece::Message("next".into()), Piece::Message("".into())];
        assert_eq!(pieces, expected);
        assert_eq!(split(b"\xff\xff\xff\xff....", 8, 100), Err(Lost(0xffff_ffff)));
    }

    proptest! {
        #[test]
        fn however_the_stream_is_cut_the_messages_are_the_same(
            bodies in proptest::collection::vec((0_usize..100_000, any::<u8>()), 1..6),
            portion in 1_usize..70_000,
        ) {
            const LIMIT: usize = 80_000;
            let portion = portion.max(50);
            let bodies: Vec<Vec<u8>> =
                bodies.into_iter().map(|(size, fill)| vec![fill; size]).collect();
            let stream: Vec<u8> = bodies.iter().flat_map(|body| framed(body)).collect();
            let expected: Vec<Piece> = bodies
                .into_iter()
                .map(|body| if body.len() > LIMIT {
                    Piece::Oversize(body.len())
                } else {
                    Piece::Message(body.into())
                })
                .collect();
            prop_assert_eq!(split(&stream, portion, LIMIT).unwrap(), expected);
        }
    }
}
