//! Receives a topic: takes from the inbox and decodes.
//!
//! ```text
//!   Intake ─▶ inbox ─▶ take ─▶ ROS 1 bytes ─▶ payload
//!                └─ set_aside ─▶ the newest of each publisher that latches ─┘
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;

use super::core::Core;
use super::form;
use super::intake::{Arrival, Intake, Wanted};
use crate::codec::ros1::Ros1Type;
use crate::endpoint::{
    Context, DropReason, Keeping, Link, Listener, Origin, Receiver, Sample, TakeError, TopicSpec,
    inbox,
};

/// Receives one topic.
pub(super) struct Ros1Listener {
    core: Arc<Core>,
    topic: String,
    intake: Arc<Intake>,
    inbox: Receiver<Arrival>,
    spec: TopicSpec,
    /// By publisher.
    aside: BTreeMap<u64, Arrival>,
}

impl Ros1Listener {
    pub(super) fn open(
        core: &Arc<Core>,
        topic: &str,
        wire_type: Ros1Type,
        spec: &TopicSpec,
        context: &Context,
    ) -> Self {
        let (sender, receiver) =
            inbox(spec.queue, Arc::clone(&context.counters), context.wake.clone());
        let (limit, wake) = (spec.limits.message_bytes, context.wake.clone());
        let type_name = wire_type.name.clone();
        let shun = spec.shun.clone();
        let wanted = Wanted { wire_type, message_type: spec.message_type, limit, shun };
        let intake = Intake::new(core, topic, wanted, sender, wake);
        core.listen(topic, &type_name, &intake);
        Self {
            core: Arc::clone(core),
            topic: topic.to_owned(),
            intake,
            inbox: receiver,
            spec: spec.clone(),
            aside: BTreeMap::new(),
        }
    }

    fn next(&mut self) -> Option<Arrival> {
        if let Some((_, arrival)) = self.aside.pop_first() {
            return Some(arrival);
        }
        let arrival = self.inbox.pop()?;
        self.intake.room.notify_waiters();
        Some(arrival)
    }
}

impl Listener for Ros1Listener {
    fn take(&mut self) -> Result<Option<Sample>, TakeError> {
        let Some(arrival) = self.next() else { return Ok(None) };
        let Arrival { message, received_at, plan, source, latched } = arrival;
        let payload = form::decode(&message, plan.as_ref(), &self.spec)?;
        let origin = Some(Origin { publisher: source, keeps: u32::from(latched) });
        Ok(Some(Sample { payload, wire_bytes: message.len() + 4, received_at, origin }))
    }

    fn discard(&mut self) -> bool {
        self.next().is_some()
    }

    fn set_aside(&mut self) -> Option<u64> {
        let arrival = self.inbox.pop()?;
        self.intake.room.notify_waiters();
        if !arrival.latched {
            return Some(1);
        }
        Some(u64::from(self.aside.insert(arrival.source, arrival).is_some()))
    }

    fn departed(&mut self) -> Option<u64> {
        // Not before the last of its messages.
        if !self.inbox.is_empty() {
            return None;
        }
        let gone = self.intake.departed()?;
        if self.aside.remove(&gone).is_some() {
            self.intake.counters().dropped(DropReason::NoConsumer);
        }
        Some(gone)
    }

    fn keeping(&self) -> Keeping {
        self.intake.keeping()
    }

    fn link(&self) -> Link {
        let (peers, why) = self.intake.connected();
        let waiting_for = (peers == 0).then(|| {
            self.core
                .fault()
                .or(why)
                .unwrap_or_else(|| format!("a ROS 1 node that publishes {}", self.topic))
        });
        Link { peers: Some(peers), waiting_for, keeps_last: false }
    }
}

impl Drop for Ros1Listener {
    fn drop(&mut self) {
        self.core.unlisten(&self.topic, &self.intake);
    }
}
