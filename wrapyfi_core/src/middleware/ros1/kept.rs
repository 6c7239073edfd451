//! The messages that a publisher here keeps for who subscribes later.
//!
//! ```text
//!   origin 1 ─▶ a1 ─▶ a2        [ b1, a2 ]  the last of each origin, the one that is kept longest first
//!   origin 2 ─▶ b1              forget(2) ─▶ [ a2 ]
//! ```
//!
//! In ROS 1 each node keeps its own. A route keeps those of all nodes that publish at its other end.

use super::outlet::Frame;

/// Origins whose last message is kept.
const MAX_ORIGINS: usize = 256;

/// The last message of each origin; `None` is the publisher itself.
#[derive(Debug)]
pub(super) struct Kept {
    frames: Vec<(Option<u64>, Frame)>,
    max_bytes: usize,
    warned: bool,
}

impl Kept {
    /// Nothing yet, and never more than `max_bytes` bytes, but for a single message.
    pub(super) fn new(max_bytes: usize) -> Self {
        Self { frames: Vec::new(), max_bytes, warned: false }
    }

    /// Keeps a message instead of the one before it of the same origin.
    pub(super) fn keep(&mut self, origin: Option<u64>, frame: &Frame, topic: &str) {
        self.forget(origin);
        self.frames.push((origin, frame.clone()));
        while self.frames.len() > 1
            && (self.frames.len() > MAX_ORIGINS || self.bytes() > self.max_bytes)
        {
            self.frames.remove(0);
            if !std::mem::replace(&mut self.warned, true) {
                tracing::warn!(
                    topic,
                    "ROS 1: of the latched messages of many publishers the oldest are not kept: \
                     {MAX_ORIGINS} of together {} bytes are the limit (max_message_mib)",
                    self.max_bytes
                );
            }
        }
    }

    /// Keeps nothing of this origin any more.
    pub(super) fn forget(&mut self, origin: Option<u64>) {
        self.frames.retain(|(kept, _)| *kept != origin);
    }

    /// Keeps nothing any more but what the publisher itself said.
    pub(super) fn forget_origins(&mut self) {
        self.frames.retain(|(kept, _)| kept.is_none());
    }

    /// What is kept, oldest first.
    pub(super) fn frames(&self) -> impl Iterator<Item = &Frame> {
        self.frames.iter().map(|(_, frame)| frame)
    }

    fn bytes(&self) -> usize {
        self.frames().map(Frame::len).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(size: usize) -> Frame {
        Frame::new(vec![vec![0; size].into()]).unwrap()
    }

    fn sizes(kept: &Kept) -> Vec<usize> {
        kept.frames().map(|frame| frame.len() - 4).collect()
    }

    #[test]
    fn the_last_of_each_origin_is_kept_until_it_goes() {
        let mut kept = Kept::new(1000);
        for (origin, size) in [(Some(1), 10), (Some(2), 20), (None, 5), (Some(1), 11)] {
            kept.keep(origin, &frame(size), "/t");
        }
        assert_eq!(sizes(&kept), [20, 5, 11]);
        kept.forget(Some(2));
        kept.forget(Some(7));
        assert_eq!(sizes(&kept), [5, 11]);
        kept.forget_origins();
        assert_eq!(sizes(&kept), [5]);
    }

    #[test]
    fn bytes_and_origins_are_bounded_and_one_message_always_stays() {
        let mut kept = Kept::new(100);
        for (origin, size) in [(1, 50), (2, 30), (3, 40)] {
            kept.keep(Some(origin), &frame(size), "/t");
        }
        assert_eq!(sizes(&kept), [30, 40]);
        kept.keep(Some(4), &frame(500), "/t");
        assert_eq!(sizes(&kept), [500]);
        let mut kept = Kept::new(1 << 20);
        for origin in 0..MAX_ORIGINS as u64 + 3 {
            kept.keep(Some(origin), &frame(1), "/t");
        }
        assert_eq!(sizes(&kept).len(), MAX_ORIGINS);
    }
}
