//! The data path of one route, and its state.
//!
//! ```text
//!   step(now):  reconcile   open what is missing, when its back-off is over
//!               review      fit quality of service to the peers, say who does not fit
//!               propagate   listener.take() ──▶ rate ──▶ publisher.publish()
//!               judge       waiting for … │ active │ degraded: … │ error: …
//! ```
//!
//! A relay has no threads and no clock of its own: the caller gives the time, and so does the clock of the
//! registry, so that a test can give any.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::candidate::Misfit;
use super::end::RouteEnd;
use super::losses::Losses;
use super::route::{Policy, Route};
use super::route_status::RouteState;
use super::stamping;
use super::tap::Tap;
use super::work::{Order, Progress, UNWANTED_FOR, Work, not_begun};
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::backoff::Backoff;
use wrapyfi_endpoint::{
    Absent, Cause, Clock, Context, DropReason, Listener, Publisher, Qos, Registry, Role,
    RoutingProperties, Sample, Throttle,
};

/// Largest number of messages moved in one step, so that a flooded route lets others have their
/// turn.
const BATCH: usize = 16;
/// Time without a message or a change after which the ends count as at rest; longer than [`UNWANTED_FOR`].
const CALM_AFTER: Duration = Duration::from_secs(3);

/// One route at work.
pub(crate) struct Relay {
    spec: Route,
    context: Context,
    source: RouteEnd<dyn Listener>,
    sink: RouteEnd<dyn Publisher>,
    backoff: Backoff,
    not_before: Option<Instant>,
    /// Instant since which a lazy route has no listener.
    unwanted_since: Option<Instant>,
    state: RouteState,
    has_source: bool,
    /// Instant of the last message or change.
    stirred_at: Option<Instant>,
    /// A listener of another type than the route's.
    misfits: Option<Misfit>,
    /// True while a message was taken, and is not counted yet.
    in_hand: bool,
    /// Cause for which the destination takes less than it is given.
    slowed: Option<Cause>,
    /// Number of messages that the destination took and did not deliver, as far as they are in
    /// `losses`.
    undelivered: u64,
    /// Number of messages that were too large, as far as they are in `losses`: the source drops them itself.
    oversize: u64,
    losses: Losses,
    /// Throttle for objects passed on as they came: all are counted, few are logged.
    unread: Throttle,
    pub(super) tap: Arc<Tap>,
    /// Circle over other bridges that the route would close: its ends stay closed.
    circle: Option<Cause>,
}

impl Relay {
    /// A route that has opened nothing yet. `seed` spreads its back-off; the counters of `context` may be those of an
    /// earlier route with these ends.
    pub(super) fn new(spec: Route, registry: &Registry, seed: u64, context: Context) -> Self {
        let source = RouteEnd::new(registry, &spec.from.middleware);
        let sink = RouteEnd::new(registry, &spec.to.middleware);
        Self {
            state: not_begun(),
            has_source: false,
            context,
            backoff: Backoff::new(seed),
            not_before: None,
            unwanted_since: None,
            stirred_at: None,
            misfits: None,
            in_hand: false,
            slowed: None,
            undelivered: 0,
            oversize: 0,
            losses: Losses::default(),
            unread: Throttle::default(),
            tap: Arc::default(),
            circle: None,
            source,
            sink,
            spec,
        }
    }

    /// True while its source is closed because no program listens at the destination.
    pub(super) fn is_at_rest(&self) -> bool {
        self.spec.policy.lazy && self.source.open.is_none()
    }

    /// State that waits for a listener, with the listeners that do not count.
    fn no_listener(&self) -> RouteState {
        let absent = Absent::at(Role::Listener, &self.spec.to);
        RouteState::Waiting(match self.misfits.clone() {
            Some(Misfit { peer, theirs }) => {
                let ours = self.spec.message_types().to.ros_type().to_owned();
                Cause::Type { absent, peer: Some(peer), theirs, ours }
            }
            None => absent.into(),
        })
    }

    /// Opens what is to be open, the destination first, so that a message finds it open.
    fn reconcile(&mut self, now: Instant) {
        if self.circle.is_some() {
            return;
        }
        let Self { spec, context, source, sink, backoff, .. } = self;
        sink.open_with(now, backoff, |middleware| {
            let conventions = |to: &mut _, at| middleware.follow_conventions(to, at);
            middleware.open_publisher(&spec.topic_spec_by(&spec.to, conventions), context)
        });
        if let Some(publisher) = &sink.open
            && spec.policy.lazy
        {
            let link = publisher.link();
            if link.peers == Some(0) && !link.keeps_last {
                let since = *self.unwanted_since.get_or_insert(now);
                let open = source.open.is_some();
                if open && now.saturating_duration_since(since) >= UNWANTED_FOR {
                    tracing::debug!(route = %spec.name, "nobody listens: {} is closed", spec.from);
                    (source.open, source.qos) = (None, None);
                    if let Some(publisher) = sink.open.as_mut().and_then(|it| it.forwarding()) {
                        publisher.forget_all();
                    }
                }
                // A source that no program wants is not tried again.
                if source.open.is_none() {
                    source.at_rest();
                }
                return;
            }
            self.unwanted_since = None;
        }
        if sink.open.is_some() {
            source.open_with(now, backoff, |middleware| {
                let conventions = |from: &mut _, at| middleware.follow_conventions(from, at);
                middleware.open_listener(&spec.topic_spec_by(&spec.from, conventions), context)
            });
        }
        if sink.open.is_some() && source.open.is_some() {
            backoff.reset();
        }
    }

    /// Lets both ends look at their peers; instant of the next look.
    fn review(&mut self, now: Instant) -> Option<Instant> {
        let source = self.source.open.as_mut().and_then(|listener| listener.forwarding());
        let sink = self.sink.open.as_mut().and_then(|publisher| publisher.forwarding());
        if let (Some(listener), Some(publisher)) = (source, sink) {
            publisher.follow_source(listener.durability());
        }
        let source = self.source.open.as_mut().map(|listener| listener.review(now));
        let mut sink = self.sink.open.as_mut().map(|publisher| publisher.review(now));
        self.slowed = sink.as_mut().and_then(|found| found.slowed.take());
        let source = source.and_then(|found| self.source.note(found, &self.spec));
        let sink = sink.and_then(|found| self.sink.note(found, &self.spec));
        source.into_iter().chain(sink).min()
    }

    fn propagate(&mut self, now: Instant) -> usize {
        let ends = [self.source.traits, self.sink.traits];
        let (Some(listener), Some(publisher)) = (&mut self.source.open, &mut self.sink.open) else {
            return 0;
        };
        let link = publisher.link();
        let unwanted = link.peers == Some(0) && !link.keeps_last;
        let mut moved = 0;
        while moved < BATCH {
            self.in_hand = false;
            if unwanted {
                // Without a consumer the message is not even decoded.
                let lost = match listener.forwarding() {
                    Some(listener) => listener.discard_except_latched(),
                    None => listener.discard().then_some(1),
                };
                let Some(lost) = lost else { break };
                moved += 1;
                self.context.counters.dropped_many(DropReason::NoConsumer, lost);
                continue;
            }
            // A message is in hand from here on: where taking it panics, it is lost and counted.
            self.in_hand = true;
            let outcome = match listener.take() {
                Ok(None) => break,
                Ok(Some(_))
                    if !rate_allows(self.spec.policy.max_rate_hz, &mut self.not_before, now) =>
                {
                    moved += 1;
                    self.context.counters.dropped(DropReason::RateLimit);
                    continue;
                }
                Ok(Some(sample)) => {
                    if let Payload::NativeObject(value) = &sample.payload {
                        for (_, reason) in value.refusals() {
                            self.context.counters.unread();
                            if let Some(unlogged_before) = self.unread.pass(now) {
                                let route = &self.spec.name;
                                tracing::warn!(
                                    route,
                                    unlogged_before,
                                    "passed on an object unread: {reason}"
                                );
                            }
                        }
                    }
                    self.tap.show(&sample.payload);
                    forward(&self.spec, sample, publisher.as_mut(), ends, &self.context.clock)
                }
                Err(error) => Err((DropReason::from(&error), error.to_string())),
            };
            moved += 1;
            match outcome {
                Ok((bytes, received_at)) => {
                    let Context { counters, clock, .. } = &self.context;
                    counters.sent(bytes, clock.age(received_at));
                }
                Err((reason @ DropReason::NoConsumer, _)) => self.context.counters.dropped(reason),
                Err((reason, text)) => {
                    self.context.counters.dropped(reason);
                    let what = format_args!("dropped a message ({reason})");
                    self.losses.note(now, &self.spec.name, what, reason, text);
                }
            }
        }
        self.in_hand = false;
        if let (Some(listener), Some(publisher)) = (listener.forwarding(), publisher.forwarding()) {
            while let Some(gone) = listener.ended_publisher() {
                publisher.forget(gone);
            }
        }
        moved
    }

    fn judge(&mut self, now: Instant) -> RouteState {
        self.has_source = false;
        if let Some(circle) = &self.circle {
            return RouteState::Error(circle.clone());
        }
        if let Some(trouble) = self.sink.trouble.as_ref().or(self.source.trouble.as_ref()) {
            return trouble.clone();
        }
        if self.spec.policy.lazy && self.source.open.is_none() && self.sink.open.is_some() {
            let source = self.source.middleware.as_ref().and_then(|source| source.waiting_for());
            // A route of a pattern lasts no longer than what is found at its source.
            self.has_source = self.spec.mark.is_some() && source.is_none();
            return source.map_or_else(|| self.no_listener(), RouteState::Waiting);
        }
        let (Some(listener), Some(publisher)) = (&self.source.open, &self.sink.open) else {
            return self.state.clone();
        };
        let (source, mut sink) = (listener.link(), publisher.link());
        self.has_source = source.peers > Some(0);
        if self.misfits.is_some() && sink.peers == Some(0) {
            // The names of those who are there say more.
            sink.waiting_for = None;
        }
        if let Some(what) = source.waiting_for.or(sink.waiting_for) {
            return RouteState::Waiting(what);
        }
        if let Some(why) = &self.slowed {
            return RouteState::Degraded(why.clone());
        }
        if let Some(degraded) = self.losses.state(now) {
            return degraded;
        }
        if source.peers == Some(0) {
            return RouteState::Waiting(Absent::at(Role::Publisher, &self.spec.from).into());
        }
        if sink.peers == Some(0) {
            return self.no_listener();
        }
        RouteState::Active
    }
}

impl Work for Relay {
    fn step(&mut self, now: Instant) -> Progress {
        self.reconcile(now);
        let review_at = self.review(now);
        let oversize = self.context.counters.dropped_so_far(DropReason::Oversize);
        if oversize > self.oversize {
            let limit_mib = self.spec.policy.limits.message_bytes >> 20;
            let cause = Cause::Oversize { at: self.spec.from.to_string(), limit_mib };
            self.losses.last = Some((now, cause));
        }
        let moved = self.propagate(now);
        self.oversize = self.context.counters.dropped_so_far(DropReason::Oversize);
        let undelivered = self.context.counters.undelivered_messages();
        if undelivered > self.undelivered {
            let (messages, to) = (undelivered - self.undelivered, self.spec.to.to_string());
            self.undelivered = undelivered;
            self.losses.last = Some((now, Cause::Undelivered { messages, to }));
        }
        let state = self.judge(now);
        if moved > 0 || state != self.state {
            self.stirred_at = Some(now);
        }
        self.state = state;
        let stirred_at = *self.stirred_at.get_or_insert(now);
        let is_calm = now.saturating_duration_since(stirred_at) >= CALM_AFTER
            && !matches!(self.state, RouteState::Degraded(_));
        let due = [self.source.retry_at, self.sink.retry_at, review_at];
        Progress::new(now, moved, moved == BATCH, is_calm || self.is_at_rest(), due)
    }

    fn state(&self) -> (&RouteState, [Option<Qos>; 2], bool) {
        (&self.state, [self.source.qos, self.sink.qos], self.has_source)
    }

    fn is_open(&self) -> bool {
        self.sink.open.is_some() && (self.spec.policy.lazy || self.source.open.is_some())
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::KeepOpen => self.spec.policy.lazy = false,
            Order::NameMisfits(named) => self.misfits = named,
            Order::StayClosed(circle) => {
                self.circle = circle;
                if self.circle.is_some() {
                    self.close();
                }
            }
        }
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

/// Hands a message on in the type of the destination; its size there, and the instant it came.
fn forward(
    spec: &Route,
    sample: Sample,
    publisher: &mut dyn Publisher,
    ends: [RoutingProperties; 2],
    clock: &Clock,
) -> Result<(usize, Instant), (DropReason, String)> {
    let Sample { payload, received_at, origin, .. } = sample;
    let Policy { color_order, limits, .. } = spec.policy;
    let conversion = Conversion { to: spec.message_types().to, color_order, limits };
    let converted = conversion.convert(payload, || clock.ros_now().stamp);
    let mut payload = converted.map_err(|error| ((&error).into(), error.to_string()))?;
    stamping::apply(spec, &mut payload, ends, received_at, clock)
        .map_err(|error| (DropReason::Malformed, error.to_string()))?;
    let sent = match publisher.forwarding() {
        Some(publisher) => publisher.forward(&payload, origin),
        None => publisher.publish(&payload),
    };
    match sent {
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
    // The interval counts from the time booked, not from now, or a source slightly above the limit
    // would be halved.
    let base = not_before.filter(|at| now.saturating_duration_since(*at) < interval).unwrap_or(now);
    *not_before = base.checked_add(interval);
    true
}

#[cfg(test)]
#[path = "relay_tests.rs"]
mod tests;
