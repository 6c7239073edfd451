//! Numbers of messages received, sent, and dropped by reason.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use serde::Serialize;

use wrapyfi_interfaces::named;
use wrapyfi_retry::Mutex;

use super::Role;
use super::latency::{Latency, LatencySummary};
use crate::codec::{ConvertError, DecodeError, EncodeError};

/// Writes an enum of `named!` by its name.
macro_rules! serialized_by_name {
    ($($named:ident),*) => {
        $(impl Serialize for $named {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.as_str())
            }
        })*
    };
}

serialized_by_name!(DropReason, GoalEvent, QosEvent);

named! {
    /// Reason that a message was not delivered. Every lost message is counted under one of these.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use {wrapyfi_data::{Limits, codec}, wrapyfi_endpoint as endpoint}; }
    /// use wrapyfi_core::Limits;
    /// use wrapyfi_core::codec::json;
    /// use wrapyfi_core::endpoint::DropReason;
    /// let error = json::decode(&"{".into(), &Limits::default(), &wrapyfi_plugins::standard()).unwrap_err();
    /// assert_eq!(DropReason::from(&error), DropReason::Malformed);
    /// assert_eq!(DropReason::NoConsumer.to_string(), "no_consumer");
    /// ```
    #[non_exhaustive]
    pub enum DropReason {
        /// The route's queue was full: its policy chose this message.
        QueueFull => "queue_full",
        /// The route's queue stayed full for the whole deadline of policy `block`.
        BlockDeadline => "block_deadline",
        /// The message was larger than `max_message_mib`.
        Oversize => "oversize",
        /// The bytes were no valid message of the route's type.
        Malformed => "malformed",
        /// Values, bottles or types were nested deeper than the limit.
        Nesting => "nesting",
        /// The message was valid, but the route does not carry its kind, channels or encoding.
        Mismatch => "mismatch",
        /// A client of another DDS vendor sent the request, whose mapping of services is not ours.
        ServiceMapping => "service_mapping",
        /// The message was for another topic, and came by ZeroMQ's match of prefixes.
        WrongTopic => "wrong_topic",
        /// The message was our own publication, which came back from a broker.
        OwnPublication => "own_publication",
        /// The value has no form in the destination's encoding.
        Unencodable => "unencodable",
        /// The destination's send queue was full.
        SendQueueFull => "send_queue_full",
        /// The destination failed to send.
        SendFailed => "send_failed",
        /// The destination did not accept the message: a node refused to set a parameter.
        Refused => "refused",
        /// A program that `from_peers`, `to_peers` or the CURVE keys of `clients` do not let in was refused: counted for
        /// each connection, whose messages this program does not see, or each message.
        RefusedPeer => "refused_peer",
        /// No program listens at the destination.
        NoConsumer => "no_consumer",
        /// The middleware reported that it lost the message before we saw it.
        LostUpstream => "lost_upstream",
        /// The message exceeded the route's `max_rate_hz`.
        RateLimit => "rate_limit",
        /// The message was delivered before, and came again because the listener was opened with
        /// another quality of service.
        Duplicate => "duplicate",
        /// The reply came after its call had ended.
        Late => "late",
        /// The request exceeded the number that may be under way at once.
        Overloaded => "overloaded",
        /// The request was not answered in time.
        Expired => "expired",
        /// The message waited in the route, or was on its way through it, when the route closed.
        Closed => "closed",
        /// The queue of a peer was full, because the peer read more slowly than it was sent to.
        Stalled => "stalled",
        /// The connection was lost with the message in its queue.
        ConnectionLost => "connection_lost",
        /// The budget of waiting bytes (`limits: { waiting_mib }`) was full, and this peer or queue
        /// held most.
        OverBudget => "over_budget",
    }
    /// Name in logs, tables and JSON.
    pub fn as_str;
}

impl From<&DecodeError> for DropReason {
    fn from(error: &DecodeError) -> Self {
        match error {
            DecodeError::Mismatch { .. } => Self::Mismatch,
            DecodeError::TooLarge { what: "nesting", .. } => Self::Nesting,
            DecodeError::TooLarge { .. } => Self::Oversize,
            _ => Self::Malformed,
        }
    }
}

impl From<&ConvertError> for DropReason {
    fn from(error: &ConvertError) -> Self {
        match error {
            ConvertError::From(error) => error.into(),
            ConvertError::To(EncodeError::Mismatch { .. }) => Self::Mismatch,
            _ => Self::Unencodable,
        }
    }
}

named! {
    /// Event of an endpoint's quality of service, such as a missed deadline. No message is lost by it.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
    /// use wrapyfi_core::endpoint::{Counters, QosEvent};
    /// let counters = Counters::default();
    /// counters.qos_event(QosEvent::DeadlineMissed, 2);
    /// assert_eq!(counters.snapshot().qos_events, [(QosEvent::DeadlineMissed, 2)]);
    /// ```
    pub enum QosEvent {
        /// A publisher let its deadline pass: the next message did not come in time.
        DeadlineMissed => "deadline_missed",
        /// Our publisher let the deadline pass that it promises.
        OwnDeadlineMissed => "own_deadline_missed",
        /// A publisher of the listener did not assert within its lease that it is alive. A publisher
        /// that leaves in good order is not counted.
        PublisherNotAlive => "publisher_not_alive",
        /// Our publisher did not assert in time that it is alive.
        OwnLivelinessLost => "own_liveliness_lost",
        /// An endpoint was opened again with another quality of service, to fit its peers.
        Changed => "qos_changed",
    }
    /// Name in logs, tables and JSON.
    pub fn as_str;
}

named! {
    /// Event in the life of an action's goals. Each goal is rejected, or accepted and later ended.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
    /// use wrapyfi_core::endpoint::{Counters, GoalEvent};
    /// let counters = Counters::default();
    /// counters.goal_event(GoalEvent::Accepted);
    /// assert_eq!(counters.snapshot().goals, [(GoalEvent::Accepted, 1)]);
    /// ```
    pub enum GoalEvent {
        /// A server accepted the goal.
        Accepted => "accepted",
        /// The server rejected the goal, or there was none.
        Rejected => "rejected",
        /// Feedback of the goal was passed on.
        Feedback => "feedback",
        /// A client asked for the end of the goal.
        CancelAsked => "cancel_asked",
        /// The server refused to cancel the goal.
        CancelRefused => "cancel_refused",
        /// The goal was reached.
        Succeeded => "succeeded",
        /// The goal was given up because a client asked for that.
        Canceled => "canceled",
        /// The goal was given up for another reason.
        Aborted => "aborted",
    }
    /// Name in logs, tables and JSON.
    pub fn as_str;
}

/// A program that was refused at an endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Counters, Refused, Role};
/// let counters = Counters::default();
/// let (who, allow) = ("192.168.1.7".to_owned(), "from_peers: [192.168.1.7]".to_owned());
/// counters.refused_peer(Refused { who, allow, roles: vec![Role::Publisher] });
/// assert_eq!(counters.snapshot().refused.unwrap().allow, "from_peers: [192.168.1.7]");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Refused {
    /// The program, and the reason, in words.
    pub who: String,
    /// Line of the configuration that would let it in.
    pub allow: String,
    /// Role of the program; of several that are told as one, each that there is.
    pub roles: Vec<Role>,
}

impl Refused {
    /// Programs that are kept: those that differ in the line that would let them in.
    const MOST: usize = 4;

    /// All of them as one, the last first; `None` where there is none.
    fn joined(all: &[Self]) -> Option<Self> {
        let each =
            |text: fn(&Self) -> &str| all.iter().rev().map(text).collect::<Vec<_>>().join("; ");
        let roles: BTreeSet<Role> = all.iter().flat_map(|it| &it.roles).copied().collect();
        (!all.is_empty()).then(|| Self {
            who: each(|it| &it.who),
            allow: each(|it| &it.allow),
            roles: roles.into_iter().collect(),
        })
    }
}

/// Live counters of one route or endpoint, shared with the I/O threads that feed it.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::{Counters, DropReason};
/// let counters = Counters::default();
/// counters.received(100);
/// counters.received(100);
/// counters.sent(90, Duration::from_millis(1));
/// counters.dropped(DropReason::Malformed);
/// let now = counters.snapshot();
/// assert_eq!((now.received_bytes, now.sent, now.dropped()), (200, 1, 1));
/// ```
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
    goals: [AtomicU64; GoalEvent::ALL.len()],
    latency: Latency,
    refused: Mutex<Vec<Refused>>,
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

    /// Counts a message that was handed over, and then not delivered to all its receivers. It no
    /// longer counts as sent.
    pub fn undelivered(&self, reason: DropReason, bytes: usize) {
        // A transport may find out before the message is counted as sent: these wrap, and are whole again then.
        self.sent.fetch_sub(1, Relaxed);
        self.sent_bytes.fetch_sub(bytes as u64, Relaxed);
        self.dropped(reason);
        self.undelivered.fetch_add(1, Relaxed);
    }

    /// Number of messages that [`Self::undelivered`] counted.
    pub fn undelivered_messages(&self) -> u64 {
        self.undelivered.load(Relaxed)
    }

    /// Number of messages dropped for a reason.
    pub fn dropped_so_far(&self, reason: DropReason) -> u64 {
        self.drops.get(reason as usize).map_or(0, |count| count.load(Relaxed))
    }

    /// Takes the numbers of dropped messages, to be counted elsewhere: they begin again at none.
    pub fn take_drops(&self) -> impl Iterator<Item = (DropReason, u64)> {
        let taken = DropReason::ALL.iter().zip(&self.drops);
        taken
            .map(|(&reason, count)| (reason, count.swap(0, Relaxed)))
            .filter(|(_, count)| *count > 0)
    }

    /// Number of messages handed to the destination, and of their bytes.
    pub fn sent_so_far(&self) -> (u64, u64) {
        let [sent, bytes] =
            [&self.sent, &self.sent_bytes].map(|it| at_least_none(it.load(Relaxed)));
        (sent, bytes)
    }

    /// Counts one object that was passed on unread, because its plug-in refused it.
    pub fn unread(&self) {
        self.unread.fetch_add(1, Relaxed);
    }

    /// Counts the connection or the message of a program that may not, and keeps who were the last, each once.
    pub fn refused_peer(&self, refused: Refused) {
        self.received(0);
        self.dropped(DropReason::RefusedPeer);
        let mut kept = self.refused.lock();
        kept.retain(|other| other.allow != refused.allow);
        if kept.len() >= Refused::MOST {
            kept.remove(0);
        }
        kept.push(refused);
    }

    /// Takes the programs that were refused last.
    pub fn take_refused(&self) -> Vec<Refused> {
        std::mem::take(&mut self.refused.lock())
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

    /// Counts an event of the quality of service, `count` times.
    pub fn qos_event(&self, event: QosEvent, count: u64) {
        if let Some(counter) = self.qos_events.get(event as usize) {
            counter.fetch_add(count, Relaxed);
        }
    }

    /// Counts an event of a goal.
    pub fn goal_event(&self, event: GoalEvent) {
        if let Some(counter) = self.goals.get(event as usize) {
            counter.fetch_add(1, Relaxed);
        }
    }

    /// The counters now. Counters move on while they are read: sums may differ by what is in flight.
    pub fn snapshot(&self) -> CountersSnapshot {
        CountersSnapshot {
            received: self.received.load(Relaxed),
            received_bytes: self.received_bytes.load(Relaxed),
            sent: at_least_none(self.sent.load(Relaxed)),
            sent_bytes: at_least_none(self.sent_bytes.load(Relaxed)),
            unread: self.unread.load(Relaxed),
            drops: happened(&DropReason::ALL, &self.drops),
            qos_events: happened(&QosEvent::ALL, &self.qos_events),
            goals: happened(&GoalEvent::ALL, &self.goals),
            latency: self.latency.summary(),
            refused: Refused::joined(&self.refused.lock()),
        }
    }
}

/// [`Counters`] at one moment, printable and serialisable.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Counters, DropReason};
/// let counters = Counters::default();
/// counters.dropped_many(DropReason::Oversize, 3);
/// let snapshot = counters.snapshot();
/// assert_eq!(snapshot.dropped_for(DropReason::Oversize), 3);
/// assert_eq!(snapshot.drops, [(DropReason::Oversize, 3)]);
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CountersSnapshot {
    /// Number of messages that arrived.
    pub received: u64,
    /// Number of bytes that arrived, as the source's wire counts them.
    pub received_bytes: u64,
    /// Number of messages handed to the destination.
    pub sent: u64,
    /// Number of bytes handed to the destination.
    pub sent_bytes: u64,
    /// Number of objects inside messages that were passed on as they came, because their plug-in
    /// refused to
    /// read them: a pickle that names a function, a frame that no table holds.
    pub unread: u64,
    /// Number of dropped messages by reason; reasons that never happened are left out.
    #[serde(serialize_with = "as_map")]
    pub drops: Vec<(DropReason, u64)>,
    /// Number of each event of the quality of service; events that never happened are left out.
    #[serde(serialize_with = "as_map")]
    pub qos_events: Vec<(QosEvent, u64)>,
    /// Number of each event of an action's goals; events that never happened are left out.
    #[serde(serialize_with = "as_map", skip_serializing_if = "Vec::is_empty")]
    pub goals: Vec<(GoalEvent, u64)>,
    /// Time from arrival here to hand-over.
    pub latency: LatencySummary,
    /// Programs that were refused, the last first, counted as [`DropReason::RefusedPeer`]: at most four that differ in
    /// the line that would let them in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<Refused>,
}

/// Value of a counter from which another thread may have subtracted before it added: 0 where the
/// counter has wrapped below zero.
fn at_least_none(counter: u64) -> u64 {
    if counter > u64::MAX / 2 { 0 } else { counter }
}

impl CountersSnapshot {
    /// Number of dropped messages, all reasons together.
    pub fn dropped(&self) -> u64 {
        self.drops.iter().map(|&(_, count)| count).sum()
    }

    /// Number of messages dropped for `reason`.
    pub fn dropped_for(&self, reason: DropReason) -> u64 {
        count_of(&self.drops, &reason)
    }

    /// Number of times that `event` happened.
    pub fn qos_events_of(&self, event: QosEvent) -> u64 {
        count_of(&self.qos_events, &event)
    }
}

/// Those that happened, with their numbers.
fn happened<T: Copy>(all: &[T], counters: &[AtomicU64]) -> Vec<(T, u64)> {
    let counts = all.iter().zip(counters).map(|(it, count)| (*it, count.load(Relaxed)));
    counts.filter(|(_, count)| *count > 0).collect()
}

/// Number of times that one happened.
fn count_of<T: PartialEq>(counts: &[(T, u64)], wanted: &T) -> u64 {
    counts.iter().find(|(it, _)| it == wanted).map_or(0, |(_, count)| *count)
}

fn as_map<T: Serialize, S: serde::Serializer>(
    counts: &[(T, u64)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(counts.iter().map(|(it, count)| (it, count)))
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
    fn programs_that_were_refused_are_kept_each_once_the_last_first() {
        let counters = Counters::default();
        assert_eq!(counters.snapshot().refused, None);
        let refuse = |who: &str, key: &str| {
            let (allow, roles) = (format!("key {key}"), vec![Role::Listener]);
            counters.refused_peer(Refused { who: who.to_owned(), allow, roles });
        };
        let all = || counters.snapshot().refused.map(|it| (it.who, it.allow)).unwrap();
        for (who, key) in [("a:1", "A"), ("b:1", "B"), ("a:2", "A")] {
            refuse(who, key);
        }
        assert_eq!(all(), ("a:2; b:1".to_owned(), "key A; key B".to_owned()));
        assert_eq!(counters.snapshot().dropped_for(DropReason::RefusedPeer), 3);
        for key in ["C", "D", "E"] {
            refuse(key, key);
        }
        assert_eq!(all().0, "E; D; C; a:2");
        assert_eq!(counters.take_refused().len(), 4);
    }

    #[test]
    fn reasons_index_their_counters() {
        for (index, &reason) in DropReason::ALL.iter().enumerate() {
            assert_eq!(reason as usize, index);
        }
        for (index, &event) in QosEvent::ALL.iter().enumerate() {
            assert_eq!(event as usize, index);
        }
        for (index, &event) in GoalEvent::ALL.iter().enumerate() {
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
