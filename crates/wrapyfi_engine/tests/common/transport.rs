//! Transports that delay, repeat and lose messages, and hold them for peers that do not read.
//!
//! ```text
//!   wire ─▶ Unsteady: late, twice, lost (best effort), cut ─▶ route ─▶ Paced: a queue for slow and stopped readers ─▶ wire
//! ```

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{
    Cause, Context, Counters, DropReason, Link, Listener, PublishError, Publisher, Reliability,
    Review, Sample, TakeError, TopicSpec,
};

use super::{Faults, FaultyState, Readers, lock};

/// Number of messages that a transport holds for a peer that does not read.
const ROOM: usize = 4;

fn may_lose(spec: &TopicSpec) -> bool {
    spec.qos.reliability == Reliability::BestEffort
}

/// Link of an end whose connection is `cut`, otherwise as it is.
fn link_of(shared: &FaultyState, link: Link) -> Link {
    let is_cut = lock(&shared.faults).is_cut;
    let waiting_for = is_cut.then(|| Cause::Transport("injected: the connection".to_owned()));
    Link { waiting_for: waiting_for.or(link.waiting_for), ..link }
}

/// A listener whose transport delays, repeats and loses messages as told.
pub(super) struct Unsteady {
    inner: Box<dyn Listener>,
    shared: Arc<FaultyState>,
    counters: Arc<Counters>,
    may_lose: bool,
    came: usize,
    /// Messages that have come, and are delivered after others.
    held: VecDeque<Sample>,
}

impl Unsteady {
    pub(super) fn new(
        inner: Box<dyn Listener>,
        shared: &Arc<FaultyState>,
        spec: &TopicSpec,
        context: &Context,
    ) -> Self {
        Self {
            inner,
            shared: Arc::clone(shared),
            counters: Arc::clone(&context.counters),
            may_lose: may_lose(spec),
            came: 0,
            held: VecDeque::new(),
        }
    }
}

impl Listener for Unsteady {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let faults: Faults = lock(&self.shared.faults).clone();
        loop {
            let Some(sample) = self.inner.take()? else { break };
            self.came += 1;
            if faults.is_cut {
                self.counters.dropped(DropReason::ConnectionLost);
            } else if faults.messages_are_lost && self.may_lose && self.came.is_multiple_of(5) {
                self.counters.dropped(DropReason::LostUpstream);
            } else {
                if faults.messages_come_twice && self.came.is_multiple_of(4) {
                    self.counters.received(0);
                    self.held.push_back(sample.clone());
                }
                if !faults.messages_are_late || !self.came.is_multiple_of(3) {
                    return Ok(Some(sample));
                }
                self.held.push_back(sample);
            }
        }
        if faults.is_cut {
            let lost = std::mem::take(&mut self.held).len();
            self.counters.dropped_many(DropReason::ConnectionLost, lost as u64);
        }
        Ok(if faults.messages_are_late { None } else { self.held.pop_front() })
    }

    fn discard(&mut self) -> bool {
        self.held.pop_front().is_some() || self.inner.discard()
    }

    fn link(&self) -> Link {
        link_of(&self.shared, self.inner.link())
    }
}

impl Drop for Unsteady {
    fn drop(&mut self) {
        self.held.iter().for_each(|_| self.counters.dropped(DropReason::Closed));
    }
}

/// A publisher whose transport holds messages for peers that read slowly or not at all. Once full, the
/// message that waited longest is lost under best effort; under reliable the publisher is refused.
pub(super) struct Paced {
    inner: Box<dyn Publisher>,
    shared: Arc<FaultyState>,
    counters: Arc<Counters>,
    topic: String,
    may_lose: bool,
    held: VecDeque<Payload>,
}

impl Paced {
    pub(super) fn new(
        inner: Box<dyn Publisher>,
        shared: &Arc<FaultyState>,
        spec: &TopicSpec,
        context: &Context,
    ) -> Self {
        Self {
            inner,
            shared: Arc::clone(shared),
            counters: Arc::clone(&context.counters),
            topic: spec.topic.clone(),
            may_lose: may_lose(spec),
            held: VecDeque::new(),
        }
    }

    /// Sends what the peers read now.
    fn send(&mut self, count: usize) -> Result<(), PublishError> {
        for payload in self.held.drain(..count.min(self.held.len())) {
            self.inner.publish(&payload)?;
        }
        Ok(())
    }

    fn lose(&mut self, why: DropReason) {
        self.held.drain(..).for_each(|_| self.counters.undelivered(why, 0));
    }
}

impl Publisher for Paced {
    fn publish(&mut self, payload: &Payload) -> Result<usize, PublishError> {
        let (is_cut, readers) = {
            let faults = lock(&self.shared.faults);
            (faults.is_cut, faults.readers)
        };
        let topic = self.topic.clone();
        if is_cut {
            let reason = "injected: there is no connection".to_owned();
            return Err(PublishError::Transport { topic, reason });
        }
        if readers == Readers::Read {
            self.send(usize::MAX)?;
            return self.inner.publish(payload);
        }
        if self.held.len() >= ROOM {
            if !self.may_lose {
                return Err(PublishError::QueueFull { topic, depth: ROOM });
            }
            self.held.pop_front();
            self.counters.undelivered(DropReason::Stalled, 0);
        }
        self.held.push_back(payload.clone());
        Ok(0)
    }

    fn link(&self) -> Link {
        link_of(&self.shared, self.inner.link())
    }

    fn review(&mut self, now: Instant) -> Review {
        let (is_cut, readers) = {
            let faults = lock(&self.shared.faults);
            (faults.is_cut, faults.readers)
        };
        if is_cut {
            self.lose(DropReason::ConnectionLost);
        }
        let count = match readers {
            Readers::Read => usize::MAX,
            Readers::Slow => 1,
            Readers::Stopped => 0,
        };
        self.send(count).unwrap();
        self.inner.review(now)
    }
}

impl Drop for Paced {
    fn drop(&mut self) {
        self.lose(DropReason::Closed);
    }
}
