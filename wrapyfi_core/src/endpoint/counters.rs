//! What went in, what came out, and why anything was dropped.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use serde::Serialize;

use super::latency::{Latency, LatencySummary};

macro_rules! drop_reasons {
    ($($(#[$doc:meta])* $name:ident => $key:literal,)*) => {
        /// Why a message was not delivered. Every lost message is counted under one of these.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum DropReason { $($(#[$doc])* $name,)* }

        impl DropReason {
            /// Every reason, in the order in which tables show them.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// Name in logs, tables and JSON.
            #[must_use]
            pub fn as_str(self) -> &'static str {
                match self { $(Self::$name => $key,)* }
            }
        }
    };
}

drop_reasons! {
    /// The route's queue was full: its policy chose this message.
    QueueFull => "queue_full",
    /// The route's queue stayed full for the whole deadline of policy `block`.
    BlockDeadline => "block_deadline",
    /// Larger than `max_message_mib`.
    Oversize => "oversize",
    /// Bytes that are no valid message of the route's type.
    Malformed => "malformed",
    /// Values, bottles or types nested deeper than the limit.
    Nesting => "nesting",
    /// A valid message whose kind, channels or encoding the route does not carry.
    Mismatch => "mismatch",
    /// Arrived by ZeroMQ's prefix match for another topic.
    WrongTopic => "wrong_topic",
    /// Our own publication, come back from a broker.
    OwnPublication => "own_publication",
    /// The value has no form in the destination's encoding.
    Unencodable => "unencodable",
    /// The destination's send queue was full.
    SendQueueFull => "send_queue_full",
    /// The destination failed to send.
    SendFailed => "send_failed",
    /// The destination did not accept what the message says: a node would not set a parameter.
    Refused => "refused",
    /// Nobody listens at the destination.
    NoConsumer => "no_consumer",
    /// The middleware reported that it lost the message before we saw it.
    LostUpstream => "lost_upstream",
    /// Above the route's `max_rate_hz`.
    RateLimit => "rate_limit",
    /// Delivered before, and once more when the listener was opened again with another quality of
    /// service.
    Duplicate => "duplicate",
    /// A reply that came when its call had ended already.
    Late => "late",
    /// A request beyond those that may be under way at once.
    Overloaded => "overloaded",
    /// A request that was not answered in time.
    Expired => "expired",
    /// It waited in the route, or was on its way through it, when the route closed.
    Closed => "closed",
    /// A peer read more slowly than was sent to it: its queue was full.
    Stalled => "stalled",
    /// The connection was lost with the message in its queue.
    ConnectionLost => "connection_lost",
    /// As much waits in this process as may (`limits: { waiting_mib }`), and this peer or queue holds most.
    OverBudget => "over_budget",
}

/// What happened to an endpoint's quality of service. No message is lost by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum QosEvent {
    /// A publisher let its deadline pass: the next message did not come in time.
    DeadlineMissed,
    /// We let the deadline pass that our publisher promises.
    OwnDeadlineMissed,
    /// A publisher that the listener hears did not say within its lease that it is alive. One that
    /// leaves in good order is not counted.
    PublisherNotAlive,
    /// Our publisher did not say in time that it is alive.
    OwnLivelinessLost,
    /// An endpoint was opened again with another quality of service, to fit its peers.
    Changed,
}

impl QosEvent {
    /// Every event, in the order in which tables show them.
    pub const ALL: &'static [Self] = &[
        Self::DeadlineMissed,
        Self::OwnDeadlineMissed,
        Self::PublisherNotAlive,
        Self::OwnLivelinessLost,
        Self::Changed,
    ];

    /// Name in logs, tables and JSON.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::DeadlineMissed => "deadline_missed",
            Self::OwnDeadlineMissed => "own_deadline_missed",
            Self::PublisherNotAlive => "publisher_not_alive",
            Self::OwnLivelinessLost => "own_liveliness_lost",
            Self::Changed => "qos_changed",
        }
    }
}

impl std::fmt::Display for QosEvent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl std::fmt::Display for DropReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Live counters of one route or endpoint, shared with the I/O threads that feed it.
#[derive(Debug, Default)]
pub struct Counters {
    received: AtomicU64,
    received_bytes: AtomicU64,
    sent: AtomicU64,
    sent_bytes: AtomicU64,
    unread: AtomicU64,
    undelivered: AtomicU64,
    drops: [AtomicU64; DropReason::ALL.len()],
    qos_events: [AtomicU64; QosEvent::ALL.len()],
    latency: Latency,
}

impl Counters {
    /// Counts a message that arrived, `bytes` long on the wire, whatever becomes of it.
    pub fn received(&self, bytes: usize) {
        self.received.fetch_add(1, Relaxed);
        self.received_bytes.fetch_add(bytes as u64, Relaxed);
    }

    /// Counts a message handed to the destination, `bytes` long on its wire, `added` after it
    /// arrived here.
    pub fn sent(&self, bytes: usize, added: Duration) {
        self.sent.fetch_add(1, Relaxed);
        self.sent_bytes.fetch_add(bytes as u64, Relaxed);
        self.latency.record(added);
    }

    /// Counts a message that was handed over, and then not delivered to everybody who was to have it. It is no
    /// longer counted as sent.
    pub fn undelivered(&self, reason: DropReason, bytes: usize) {
        // A transport may find out before the message is counted as sent: these wrap, and are whole again then.
        self.sent.fetch_sub(1, Relaxed);
        self.sent_bytes.fetch_sub(bytes as u64, Relaxed);
        self.dropped(reason);
        self.undelivered.fetch_add(1, Relaxed);
    }

    /// Messages that [`Self::undelivered`] counted.
    pub(crate) fn undelivered_messages(&self) -> u64 {
        self.undelivered.load(Relaxed)
    }

    /// Counts one object that was passed on unread, because its plug-in refused it.
    pub fn unread(&self) {
        self.unread.fetch_add(1, Relaxed);
    }

    /// Counts one dropped message.
    pub fn dropped(&self, reason: DropReason) {
        self.dropped_many(reason, 1);
    }

    /// Counts `count` messages dropped for the same reason.
    pub fn dropped_many(&self, reason: DropReason, count: u64) {
        if let Some(counter) = self.drops.get(reason as usize) {
            counter.fetch_add(count, Relaxed);
        }
    }

    /// Counts what happened to the quality of service, `count` times.
    pub fn qos_event(&self, event: QosEvent, count: u64) {
        if let Some(counter) = self.qos_events.get(event as usize) {
            counter.fetch_add(count, Relaxed);
        }
    }

    /// The counters now. Counters move on while they are read: sums may differ by what is in flight.
    #[must_use]
    pub fn snapshot(&self) -> CountersSnapshot {
        CountersSnapshot {
            received: self.received.load(Relaxed),
            received_bytes: self.received_bytes.load(Relaxed),
            sent: at_least_none(self.sent.load(Relaxed)),
            sent_bytes: at_least_none(self.sent_bytes.load(Relaxed)),
            unread: self.unread.load(Relaxed),
            drops: DropReason::ALL
                .iter()
                .zip(&self.drops)
                .map(|(&reason, count)| (reason, count.load(Relaxed)))
                .filter(|&(_, count)| count > 0)
                .collect(),
            qos_events: QosEvent::ALL
                .iter()
                .zip(&self.qos_events)
                .map(|(&event, count)| (event, count.load(Relaxed)))
                .filter(|&(_, count)| count > 0)
                .collect(),
            latency: self.latency.summary(),
        }
    }
}

/// [`Counters`] at one moment, printable and serialisable.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CountersSnapshot {
    /// Messages that arrived.
    pub received: u64,
    /// Bytes that arrived, as the source's wire counts them.
    pub received_bytes: u64,
    /// Messages handed to the destination.
    pub sent: u64,
    /// Bytes handed to the destination.
    pub sent_bytes: u64,
    /// Objects inside messages that were passed on as they came, because their plug-in refused to
    /// read them: a pickle that names a function, a frame that no table holds.
    pub unread: u64,
    /// Dropped messages by reason; reasons that never happened are left out.
    #[serde(serialize_with = "drops_as_map")]
    pub drops: Vec<(DropReason, u64)>,
    /// What happened to the quality of service; events that never happened are left out.
    #[serde(serialize_with = "events_as_map")]
    pub qos_events: Vec<(QosEvent, u64)>,
    /// Time from arrival here to hand-over.
    pub latency: LatencySummary,
}

/// A counter that something may have been taken from before it was added.
fn at_least_none(counter: u64) -> u64 {
    if counter > u64::MAX / 2 { 0 } else { counter }
}

impl CountersSnapshot {
    /// Dropped messages, all reasons together.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.drops.iter().map(|&(_, count)| count).sum()
    }

    /// Messages dropped for `reason`.
    #[must_use]
    pub fn dropped_for(&self, reason: DropReason) -> u64 {
        self.drops.iter().filter(|&&(r, _)| r == reason).map(|&(_, count)| count).sum()
    }

    /// How often `event` happened.
    #[must_use]
    pub fn qos_events_of(&self, event: QosEvent) -> u64 {
        self.qos_events.iter().filter(|&&(e, _)| e == event).map(|&(_, count)| count).sum()
    }
}

fn drops_as_map<S: serde::Serializer>(
    drops: &[(DropReason, u64)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(drops.iter().map(|(reason, count)| (reason.as_str(), count)))
}

fn events_as_map<S: serde::Serializer>(
    events: &[(QosEvent, u64)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(events.iter().map(|(event, count)| (event.as_str(), count)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drop_is_found_under_its_reason() {
        let counters = Counters::default();
        counters.dropped(DropReason::Malformed);
        counters.dropped_many(DropReason::LostUpstream, 3);
        let now = counters.snapshot();
        assert_eq!(now.dropped(), 4);
        assert_eq!(now.dropped_for(DropReason::LostUpstream), 3);
        assert_eq!(now.dropped_for(DropReason::Oversize), 0);
        let json = serde_json::to_value(&now).unwrap();
        assert_eq!(json["drops"]["malformed"], 1);
    }

    #[test]
    fn what_is_not_delivered_is_not_sent_whichever_is_counted_first() {
        let counters = Counters::default();
        counters.sent(10, Duration::ZERO);
        counters.undelivered(DropReason::Stalled, 10);
        counters.undelivered(DropReason::Stalled, 5);
        let now = counters.snapshot();
        assert_eq!((now.sent, now.sent_bytes, now.dropped()), (0, 0, 2));
        counters.sent(5, Duration::ZERO);
        counters.sent(7, Duration::ZERO);
        let now = counters.snapshot();
        assert_eq!((now.sent, now.sent_bytes, now.dropped()), (1, 7, 2));
    }

    #[test]
    fn reasons_index_their_counters() {
        for (index, &reason) in DropReason::ALL.iter().enumerate() {
            assert_eq!(reason as usize, index);
        }
        for (index, &event) in QosEvent::ALL.iter().enumerate() {
            assert_eq!(event as usize, index);
        }
    }

    #[test]
    fn an_event_is_no_drop() {
        let counters = Counters::default();
        counters.qos_event(QosEvent::DeadlineMissed, 2);
        let now = counters.snapshot();
        assert_eq!((now.dropped(), now.qos_events_of(QosEvent::DeadlineMissed)), (0, 2));
        let json = serde_json::to_value(&now).unwrap();
        assert_eq!(json["qos_events"], serde_json::json!({ "deadline_missed": 2 }));
    }
}
