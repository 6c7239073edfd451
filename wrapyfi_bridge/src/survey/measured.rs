//! Rates and sizes of topics: each is subscribed to for some seconds, and its messages are counted unread.

use std::sync::Arc;
use std::time::{Duration, Instant};

use wrapyfi_data::types::{MessageType, RosType};
use wrapyfi_endpoint::{Context, Listener, Middleware, Overflow, QueueSpec, TopicSpec, Wake};
use wrapyfi_interfaces::store::ResolvedType;

use super::facts::Traffic;
use crate::shutdown::Shutdown;

/// Longest time until all topics are connected.
const CONNECT_WITHIN: Duration = Duration::from_secs(4);
/// Pause between two looks.
const PAUSE: Duration = Duration::from_millis(20);

/// A topic that is measured.
struct Measured {
    listener: Box<dyn Listener>,
    context: Context,
    /// Messages and bytes when the measurement began.
    begin: (u64, u64),
}

impl Measured {
    fn open(middleware: &dyn Middleware, topic: &str, resolved: &ResolvedType) -> Option<Self> {
        let kind = MessageType::Ros(RosType::new(resolved).ok()?);
        let queue = QueueSpec { depth: 1, overflow: Overflow::DropOldest };
        let spec = TopicSpec { queue, ..TopicSpec::new(topic, kind) };
        let context = Context::default();
        let listener = middleware.open_listener(&spec, &context);
        let listener = listener
            .inspect_err(|error| tracing::warn!("{topic} is not measured: {error}"))
            .ok()?;
        Some(Self { listener, context, begin: (0, 0) })
    }

    fn so_far(&self) -> (u64, u64) {
        let counted = self.context.counters.snapshot();
        (counted.received, counted.received_bytes)
    }
}

/// Messages of each topic within `time`, in the same order; `None` for one that cannot be subscribed to, or where
/// nobody was connected. A latched message that waits for new subscribers does not count as traffic, and its size is told.
pub(super) fn traffic(
    middleware: &Arc<dyn Middleware>,
    topics: &[(&str, Option<&ResolvedType>)],
    time: Duration,
    shutdown: &Shutdown,
) -> Vec<Option<Traffic>> {
    if time.is_zero() {
        return vec![None; topics.len()];
    }
    let open = |(topic, resolved): &(&str, Option<&ResolvedType>)| {
        Measured::open(&**middleware, topic, (*resolved)?)
    };
    let mut all: Vec<Option<Measured>> = topics.iter().map(open).collect();
    let wake = Wake::new();
    let until = |end: Instant, is_done: &dyn Fn() -> bool| {
        while Instant::now() < end && !shutdown.requested() && !is_done() {
            wake.wait(PAUSE.min(end.saturating_duration_since(Instant::now())));
        }
    };
    let is_connected = |one: &Measured| one.listener.link().peers.is_none_or(|peers| peers > 0);
    let all_connected = || all.iter().flatten().all(is_connected);
    until(Instant::now() + CONNECT_WITHIN, &all_connected);
    for one in all.iter_mut().flatten() {
        one.begin = one.so_far();
    }
    let begun = Instant::now();
    until(begun + time, &|| false);
    let seconds = begun.elapsed().as_secs_f64();
    let told = |one: &Measured| {
        let (messages, bytes) = one.so_far();
        let since = messages.saturating_sub(one.begin.0);
        let mean = bytes.checked_div(messages)?;
        Some(Traffic { rate_hz: since as f64 / seconds, bytes: mean })
    };
    let none = Traffic { rate_hz: 0.0, bytes: 0 };
    all.iter()
        .map(|one| one.as_ref().and_then(|one| told(one).or(is_connected(one).then_some(none))))
        .collect()
}
