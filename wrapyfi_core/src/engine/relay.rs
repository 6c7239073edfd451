//! The data path of one route, and the state it is in.
//!
//! ```text
//!   step(now):  reconcile   open what is missing, when its back-off is over
//!               review      fit quality of service to the peers, say who does not fit
//!               propagate   listener.take() ──▶ rate ──▶ publisher.publish()
//!               judge       waiting for … │ active │ degraded: … │ error: …
//! ```
//!
//! No threads, no clock of its own: the caller says what time it is, so a test can say anything.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::end::End;
use super::plan::RouteSpec;
use super::route::{RouteState, RouteStatus};
use super::stamping;
use super::work::Work;
use crate::Throttle;
use crate::backoff::Backoff;
use crate::codec::convert_payload;
use crate::endpoint::{
    Context, Counters, DropReason, Listener, Publisher, Qos, Registry, RosClock, RosNow, Sample,
    Traits, Wake,
};
use crate::types::Payload;

/// Messages moved in one step, so that a flooded route lets the others have their turn.
const BATCH: usize = 16;
/// How long a loss keeps a route `degraded`.
pub(super) const DEGRADED_FOR: Duration = Duration::from_secs(5);
/// How long nobody may want what a lazy route carries before it closes its source.
pub(super) const UNWANTED_FOR: Duration = Duration::from_secs(2);
/// How often links are looked at when nothing rings.
pub(super) const REVIEW_EVERY: Duration = Duration::from_millis(500);
/// How often a route at rest looks: a listener that comes rings.
pub(super) const REST_REVIEW_EVERY: Duration = Duration::from_secs(2);

/// One route at work.
pub struct Relay {
    spec: RouteSpec,
    context: Context,
    clock: RosClock,
    source: End<dyn Listener>,
    sink: End<dyn Publisher>,
    backoff: Backoff,
    not_before: Option<Instant>,
    /// Since when nobody wants what a lazy route carries.
    unwanted_since: Option<Instant>,
    state: RouteState,
    /// Listeners of another type than the route's, in words.
    misfits: Option<String>,
    last_loss: Option<(Instant, String)>,
    /// A message was taken, and is not counted yet.
    in_hand: bool,
    /// Why the destination takes less than it is given.
    slowed: Option<String>,
    /// Messages that the destination took and did not deliver, as far as they are in `last_loss`.
    undelivered: u64,
    /// Losses, and objects passed on as they came: all are counted, few are logged.
    losses: Throttle,
    unread: Throttle,
}

/// What a step did, and when the next one is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Messages taken, delivered or not.
    pub moved: usize,
    /// When to step again if the doorbell does not ring before.
    pub next: Instant,
}

impl Relay {
    /// A route that has opened nothing yet. `seed` spreads its back-off.
    #[must_use]
    pub fn new(spec: RouteSpec, registry: &Registry, seed: u64) -> Self {
        let source = End::new(registry, &spec.from.middleware);
        let sink = End::new(registry, &spec.to.middleware);
        Self {
            state: RouteState::Waiting("its first step".to_owned()),
            context: Context::default(),
            clock: registry.clock().clone(),
            backoff: Backoff::new(seed),
            not_before: None,
            unwanted_since: None,
            misfits: None,
            last_loss: None,
            in_hand: false,
            slowed: None,
            undelivered: 0,
            losses: Throttle::default(),
            unread: Throttle::default(),
            source,
            sink,
            spec,
        }
    }

    /// Counts where somebody else counted before.
    #[must_use]
    pub(super) fn counting(mut self, counters: Arc<Counters>) -> Self {
        self.context.counters = counters;
        self
    }

    /// Whether its source is closed, because nobody wants what it carries.
    pub(super) fn is_at_rest(&self) -> bool {
        self.spec.lazy && self.source.open.is_none()
    }

    /// Waits for a listener, and says who does not count as one.
    fn no_listener(&self) -> RouteState {
        let (to, carried) = (&self.spec.to, self.spec.message_type.ros_type());
        RouteState::Waiting(match &self.misfits {
            Some(misfits) => format!("a listener on {to} of {carried}: {misfits}"),
            None => format!("a listener on {to}"),
        })
    }

    /// Rings when the route has work.
    #[must_use]
    pub fn wake(&self) -> &Wake {
        &self.context.wake
    }

    /// The route now.
    #[must_use]
    pub fn status(&self) -> RouteStatus {
        RouteStatus {
            name: self.spec.name.clone(),
            from: self.spec.from.to_string(),
            to: self.spec.to.to_string(),
            message_type: self.spec.message_type.label(),
            state: self.state.clone(),
            from_qos: self.source.qos,
            to_qos: self.sink.qos,
            counters: self.context.counters.snapshot(),
            panics: 0,
            pattern: None,
        }
    }

    /// Brings the route one step on. Blocks only as long as a reliable destination does.
    pub fn step(&mut self, now: Instant) -> Step {
        self.reconcile(now);
        let review_at = self.review(now);
        let moved = self.propagate(now);
        let undelivered = self.context.counters.undelivered_messages();
        if undelivered > self.undelivered {
            let text = format!(
                "{} messages did not reach everybody who listens on {}",
                undelivered - self.undelivered,
                self.spec.to
            );
            self.undelivered = undelivered;
            self.last_loss = Some((now, text));
        }
        self.state = self.judge(now);
        let next = match (moved == BATCH, self.is_at_rest()) {
            (true, _) => now,
            (false, true) => now + REST_REVIEW_EVERY,
            (false, false) => now + REVIEW_EVERY,
        };
        let due = [self.source.retry_at, self.sink.retry_at, review_at];
        Step { moved, next: due.into_iter().flatten().fold(next, Instant::min).max(now) }
    }

    /// The destination first: a message must find it open.
    fn reconcile(&mut self, now: Instant) {
        let Self { spec, context, source, sink, backoff, .. } = self;
        let to = spec.topic_spec(&spec.to);
        sink.open_with(now, backoff, |middleware| middleware.open_publisher(&to, context));
        if let Some(publisher) = &sink.open
            && spec.lazy
        {
            let link = publisher.link();
            if link.peers == Some(0) && !link.keeps_last {
                let since = *self.unwanted_since.get_or_insert(now);
                let open = source.open.is_some();
                if open && now.saturating_duration_since(since) >= UNWANTED_FOR {
                    tracing::debug!(route = %spec.name, "nobody listens: {} is closed", spec.from);
                    (source.open, source.qos) = (None, None);
                    if let Some(publisher) = &mut sink.open {
                        publisher.forget_all();
                    }
                }
                // Nobody has to be asked for what nobody wants.
                if source.open.is_none() {
                    source.at_rest();
                }
                return;
            }
            self.unwanted_since = None;
        }
        if sink.open.is_some() {
            let from = spec.topic_spec(&spec.from);
            source.open_with(now, backoff, |middleware| middleware.open_listener(&from, context));
        }
        if sink.open.is_some() && source.open.is_some() {
            backoff.reset();
        }
    }

    /// Lets both ends look at their peers; when they want to look again.
    fn review(&mut self, now: Instant) -> Option<Instant> {
        if let (Some(listener), Some(publisher)) = (&self.source.open, &mut self.sink.open) {
            publisher.follow_source(listener.keeping());
        }
        let source = self.source.open.as_mut().map(|listener| listener.review(now));
        let mut sink = self.sink.open.as_mut().map(|publisher| publisher.review(now));
        self.slowed = sink.as_mut().and_then(|found| found.slowed.take());
        let source = source.and_then(|found| self.source.note(found, &self.spec));
        let sink = sink.and_then(|found| self.sink.note(found, &self.spec));
        source.into_iter().chain(sink).min()
    }

    fn propagate(&mut self, now: Instant) -> usize {
        let (Some(listener), Some(publisher)) = (&mut self.source.open, &mut self.sink.open) else {
            return 0;
        };
        let ends = [self.source.traits, self.sink.traits];
        let link = publisher.link();
        let unwanted = link.peers == Some(0) && !link.keeps_last;
        let mut moved = 0;
        while moved < BATCH {
            self.in_hand = false;
            if unwanted {
                // No consumer, no work: the message is not even decoded.
                let Some(lost) = listener.set_aside() else { break };
                moved += 1;
                self.context.counters.dropped_many(DropReason::NoConsumer, lost);
                continue;
            }
            // Where taking panics, the message is gone.
            self.in_hand = true;
            let taken = listener.take();
            let outcome = match taken {
                Ok(None) => break,
                Ok(Some(_)) if !rate_allows(self.spec.max_rate_hz, &mut self.not_before, now) => {
                    moved += 1;
                    self.context.counters.dropped(DropReason::RateLimit);
                    continue;
                }
                Ok(Some(sample)) => {
                    if let Payload::NativeObject(value) = &sample.payload {
                        for (_, reason) in value.refusals() {
                            self.context.counters.unread();
                            if let Some(before) = self.unread.pass(now) {
                                let what = "passed on an object unread";
                                log(&self.spec.name, before, what, reason);
                            }
                        }
                    }
                    forward(&self.spec, sample, publisher.as_mut(), ends, self.clock.now())
                }
                Err(error) => Err((error.drop_reason(), error.to_string())),
            };
            moved += 1;
            match outcome {
                Ok((bytes, received_at)) => {
                    self.context.counters.sent(bytes, received_at.elapsed());
                }
                Err((reason @ DropReason::NoConsumer, _)) => self.context.counters.dropped(reason),
                Err((reason, text)) => {
                    self.context.counters.dropped(reason);
                    if let Some(before) = self.losses.pass(now) {
                        let what = format!("dropped a message ({reason})");
                        log(&self.spec.name, before, &what, &text);
                    }
                    self.last_loss = Some((now, text));
                }
            }
        }
        self.in_hand = false;
        while let Some(gone) = listener.departed() {
            publisher.forget(gone);
        }
        moved
    }

    fn judge(&self, now: Instant) -> RouteState {
        if let Some(trouble) = self.sink.trouble.as_ref().or(self.source.trouble.as_ref()) {
            return trouble.clone();
        }
        if self.spec.lazy && self.source.open.is_none() && self.sink.open.is_some() {
            let source = self.source.middleware.as_ref().and_then(|source| source.waiting_for());
            return source.map_or_else(|| self.no_listener(), RouteState::Waiting);
        }
        let (Some(listener), Some(publisher)) = (&self.source.open, &self.sink.open) else {
            return self.state.clone();
        };
        let (source, sink) = (listener.link(), publisher.link());
        if let Some(what) = source.waiting_for.or(sink.waiting_for) {
            return RouteState::Waiting(what);
        }
        if let Some(why) = &self.slowed {
            return RouteState::Degraded(why.clone());
        }
        if let Some((at, text)) = &self.last_loss
            && now.saturating_duration_since(*at) < DEGRADED_FOR
        {
            return RouteState::Degraded(text.clone());
        }
        if source.peers == Some(0) {
            return RouteState::Waiting(format!("a publisher on {}", self.spec.from));
        }
        if sink.peers == Some(0) {
            return self.no_listener();
        }
        RouteState::Active
    }
}

impl Work for Relay {
    fn step(&mut self, now: Instant) -> Step {
        Self::step(self, now)
    }

    fn state(&self) -> (&RouteState, [Option<Qos>; 2]) {
        (&self.state, [self.source.qos, self.sink.qos])
    }

    fn is_open(&self) -> bool {
        self.sink.open.is_some() && (self.spec.lazy || self.source.open.is_some())
    }

    fn keep_open(&mut self) {
        self.spec.lazy = false;
    }

    fn name_misfits(&mut self, named: Option<String>) {
        self.misfits = named;
    }

    fn close(&mut self) {
        if std::mem::take(&mut self.in_hand) {
            self.context.counters.dropped(DropReason::Closed);
        }
        self.unwanted_since = None;
        self.source.close();
        self.sink.close();
    }
}

/// Hands a message on in the type that the destination carries; its size there and when it came.
fn forward(
    spec: &RouteSpec,
    sample: Sample,
    publisher: &mut dyn Publisher,
    ends: [Traits; 2],
    now: RosNow,
) -> Result<(usize, Instant), (DropReason, String)> {
    let Sample { payload, received_at, origin, .. } = sample;
    let mut payload =
        convert_payload(payload, spec.message_type, spec.color_order, &spec.limits, || now.stamp)
            .map_err(|error| (error.drop_reason(), error.to_string()))?;
    stamping::apply(spec, &mut payload, ends, received_at, now)
        .map_err(|error| (DropReason::Malformed, error.to_string()))?;
    match publisher.forward(&payload, origin) {
        Ok(bytes) => Ok((bytes, received_at)),
        Err(error) => Err((error.drop_reason(), error.to_string())),
    }
}

/// True when a message may pass at `now`; then books its interval.
fn rate_allows(max_rate_hz: Option<f64>, not_before: &mut Option<Instant>, now: Instant) -> bool {
    let Some(hz) = max_rate_hz else { return true };
    if not_before.is_some_and(|at| now < at) {
        return false;
    }
    let interval = Duration::try_from_secs_f64(1.0 / hz).unwrap_or(Duration::MAX);
    // From the booked time on, not from now: a source slightly above the limit is not halved.
    let base = not_before.filter(|at| now.saturating_duration_since(*at) < interval).unwrap_or(now);
    *not_before = base.checked_add(interval);
    true
}

fn log(route: &str, unlogged_before: u64, what: &str, text: &str) {
    tracing::warn!(route, unlogged_before, "{what}: {text}");
}

#[cfg(test)]
#[path = "relay_tests.rs"]
mod tests;
