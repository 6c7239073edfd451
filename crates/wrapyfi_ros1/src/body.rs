//! Bodies of requests and replies: so many bytes, which are announced before they come.
//!
//! ```text
//!   size ─▶ within the limit? ── no ──▶ passed over, and why
//!              └─ yes ─▶ bytes, counted in the budget as they come ── no room ──▶ passed over, and why
//! ```
//!
//! A body that has begun goes on, or the connection ends: a peer that stands still in the middle of a body holds its memory
//! no longer than that.

use std::time::Duration;

use bytes::{BufMut as _, Bytes, BytesMut};
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::splitter::Ended;
use wrapyfi_endpoint::{DropReason, Share};

/// Bytes that are passed over at once.
const SKIP: usize = 16 * 1024;

/// Outcome of reading a body.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Body {
    Whole(Bytes),
    /// Body that was read and thrown away, with the reason for the other side.
    Passed {
        why: DropReason,
        reason: String,
    },
}

/// Reader of the bodies on a connection.
#[derive(Debug)]
pub(super) struct Bodies {
    /// Largest body in bytes.
    limit: usize,
    /// Longest time until the next byte.
    progress: Duration,
    share: Share,
}

impl Bodies {
    /// Reader of bodies of at most `limit` bytes, whose next byte comes within `progress`, or never.
    pub(super) fn new(limit: usize, progress: Duration, share: Share) -> Self {
        Self { limit, progress, share }
    }

    /// Reads the size in front of the next body, which may be long in coming; none at the end of the connection.
    pub(super) async fn size(&self, stream: &mut TcpStream) -> Result<Option<usize>, Ended> {
        let mut size = [0; 4];
        let (first, rest) = size.split_at_mut(1);
        if stream.read(first).await? == 0 {
            return Ok(None);
        }
        self.on(stream.read_exact(rest)).await?;
        Ok(Some(usize::try_from(u32::from_le_bytes(size)).unwrap_or(usize::MAX)))
    }

    /// Reads a body of `size` bytes, which is called `what` where it is passed over; an error has how much of it came.
    pub(super) async fn read(
        &self,
        stream: &mut TcpStream,
        size: usize,
        what: &str,
    ) -> Result<Body, (Ended, usize)> {
        if size > self.limit {
            self.pass_over(stream, size).await.map_err(|ended| (ended, 0))?;
            let reason = format!("{what} is {size} bytes long, the limit is {}", self.limit);
            return Ok(Body::Passed { why: DropReason::Oversize, reason });
        }
        let mut body = BytesMut::with_capacity(size);
        while body.len() < size {
            let begun = body.len();
            if !self.share.hold(begun) {
                drop(body);
                _ = self.share.hold(0);
                self.pass_over(stream, size - begun).await.map_err(|ended| (ended, begun))?;
                let reason = Ended::OverBudget(begun).to_string();
                return Ok(Body::Passed { why: DropReason::OverBudget, reason });
            }
            let mut space = (&mut body).limit(size - begun);
            match self.on(stream.read_buf(&mut space)).await {
                Ok(1..) => {}
                Ok(0) => return Err((Ended::Closed, begun)),
                Err(ended) => return Err((ended, begun)),
            }
        }
        // From here on it counts where it waits.
        _ = self.share.hold(0);
        Ok(Body::Whole(body.freeze()))
    }

    async fn pass_over(&self, stream: &mut TcpStream, size: usize) -> Result<(), Ended> {
        let (mut left, mut scratch) = (size, vec![0; size.min(SKIP)]);
        while left > 0 {
            let now = left.min(SKIP);
            match self.on(stream.read(scratch.get_mut(..now).unwrap_or_default())).await? {
                0 => return Err(Ended::Closed),
                count => left -= count,
            }
        }
        Ok(())
    }

    /// Reads on within a body.
    async fn on<T>(&self, read: impl Future<Output = std::io::Result<T>>) -> Result<T, Ended> {
        let limit = self.progress;
        Ok(timeout(limit, read).await.map_err(|_elapsed| Ended::NoProgress(limit))??)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncWriteExt as _;
    use tokio::net::TcpListener;

    use super::*;
    use wrapyfi_endpoint::Budget;

    /// Reads from a peer that sends `bytes` and then nothing.
    fn read(bytes: &[u8], budget: &'static Budget) -> Result<Vec<Body>, (Ended, usize)> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let mut peer = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
            let (mut stream, _) = listener.accept().await.unwrap();
            let share = Share::of(budget);
            let bodies = Bodies::new(1 << 20, Duration::from_millis(100), share);
            let mut all = Vec::new();
            let reading = async {
                while let Some(size) = bodies.size(&mut stream).await.map_err(|it| (it, 0))? {
                    all.push(bodies.read(&mut stream, size, "the request").await?);
                    if all.len() == 2 {
                        break;
                    }
                }
                Ok(())
            };
            let (read, _) = tokio::join!(reading, peer.write_all(bytes));
            read.map(|()| all)
        })
    }

    fn framed(size: u32) -> Vec<u8> {
        [&size.to_le_bytes()[..], &vec![7; size as usize]].concat()
    }

    #[test]
    fn a_body_that_has_begun_goes_on() {
        static BUDGET: Budget = Budget::new(1 << 30);
        let half = framed(500_000);
        let ended = read(&half[..300_000], &BUDGET).unwrap_err();
        assert!(matches!(ended, (Ended::NoProgress(_), 299_996)), "{ended:?}");
        let ended = read(&half[..3], &BUDGET).unwrap_err();
        assert!(matches!(ended, (Ended::NoProgress(_), 0)), "half a size: {ended:?}");
        let ended = read(&framed(2 << 20)[..3000], &BUDGET).unwrap_err();
        assert!(matches!(ended, (Ended::NoProgress(_), 0)), "nothing of it is kept: {ended:?}");
        assert_eq!(BUDGET.used(), 0);
    }

    #[test]
    fn what_has_no_room_is_passed_over_with_its_reason() {
        static BUDGET: Budget = Budget::new(400_000);
        let next = || Body::Whole(vec![7; 3].into());
        let all = read(&[framed(900_000), framed(3)].concat(), &BUDGET).unwrap();
        let [Body::Passed { why: DropReason::OverBudget, reason }, whole] = &all[..] else {
            panic!("{all:?}")
        };
        assert!(reason.ends_with("waits in this process (limits: waiting_mib)"), "{reason}");
        assert_eq!((whole, BUDGET.used()), (&next(), 0));
        let all = read(&[framed(2 << 20), framed(3)].concat(), &BUDGET).unwrap();
        let reason = "the request is 2097152 bytes long, the limit is 1048576".to_owned();
        assert_eq!(all, [Body::Passed { why: DropReason::Oversize, reason }, next()]);
    }
}
