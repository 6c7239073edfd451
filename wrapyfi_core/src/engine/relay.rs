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

use super::plan::RouteSpec;
use super::route::{RouteState, RouteStatus};
use super::stamping;
use crate::Throttle;
use crate::backoff::Backoff;
use crate::codec::convert_payload;
use crate::endpoint::{
    Context, Counters, DropReason, Listener, Middleware, OpenError, Publisher, Qos, QosChange,
    Registry, Review, RosClock, RosNow, Sample, Traits, Wake,
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
    /// Messages that the destination took and did not deliver, as far as they are in `last_loss`.
    undelivered: u64,
    /// Losses, and objects passed on as they came: all are counted, few are logged.
    losses: Throttle,
    unread: Throttle,
}

/// One end of a route: what opens it, and what is open.
struct End<T: ?Sized> {
    middleware: Option<Arc<dyn Middleware>>,
    traits: Traits,
    open: Option<Box<T>>,
    retry_at: Option<Instant>,
    /// Why it is not open.
    trouble: Option<RouteState>,
    /// Quality of service in use.
    qos: Option<Qos>,
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

    /// Opens the source whether somebody listens or not, from now on.
    pub(super) fn keep_open(&mut self) {
        self.spec.lazy = false;
        self.context.wake.ring();
    }

    /// Whether its source is closed, because nobody wants what it carries.
    pub(super) fn is_at_rest(&self) -> bool {
        self.spec.lazy && self.source.open.is_none()
    }

    /// Names listeners of another type than the route's, for as long as nobody else listens.
    pub(super) fn name_misfits(&mut self, named: Option<String>) {
        self.misfits = named;
        self.context.wake.ring();
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
            pattern: None,
        }
    }

    /// Brings the route one step on. Blocks only as long as a reliable destination does.
    pub fn step(&mut self, now: Instant) -> Step {
        let rested = self.is_at_rest();
        self.reconcile(now);
        let review_at = self.review(now);
        // The step that opens the source of a route at rest moves nothing: it may be on a thread that others
        // wait for.
        let moved = if rested { 0 } else { self.propagate(now) };
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
        let state = self.judge(now);
        if state != self.state {
            state.log(&self.spec.name, self.spec.mark.is_some());
            self.state = state;
        }
        let is_more = moved == BATCH || (rested && !self.is_at_rest());
        let next = match (is_more, self.is_at_rest()) {
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
        let sink = self.sink.open.as_mut().map(|publisher| publisher.review(now));
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
            if unwanted {
                // No consumer, no work: the message is not even decoded.
                let Some(lost) = listener.set_aside() else { break };
                moved += 1;
                self.context.counters.dropped_many(DropReason::NoConsumer, lost);
                continue;
            }
            let outcome = match listener.take() {
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

impl<T: ?Sized> End<T> {
    fn new(registry: &Registry, name: &str) -> Self {
        let (middleware, trouble) = match registry.get(name) {
            Ok(middleware) => (Some(Arc::clone(middleware)), None),
            Err(unknown) => (None, Some(RouteState::Error(unknown.to_string()))),
        };
        let traits = middleware.as_ref().map(|it| it.traits()).unwrap_or_default();
        Self { middleware, traits, open: None, retry_at: None, trouble, qos: None }
    }

    /// Forgets what went wrong while it was tried, except what will never work.
    fn at_rest(&mut self) {
        if matches!(self.trouble, Some(RouteState::Waiting(_))) {
            (self.trouble, self.retry_at) = (None, None);
        }
    }

    /// Keeps what a review found, and logs it.
    fn note(&mut self, review: Review, spec: &RouteSpec) -> Option<Instant> {
        let Review { qos, changed, warnings, next } = review;
        let route = &spec.name;
        match changed {
            // One of many.
            Some(QosChange { from, to, why }) if spec.mark.is_some() => {
                tracing::debug!(route, %from, %to, "quality of service changed: {why}");
            }
            Some(QosChange { from, to, why }) => {
                tracing::info!(route, %from, %to, "quality of service changed: {why}");
            }
            None => {}
        }
        for warning in warnings {
            tracing::warn!(route, "{warning}");
        }
        self.qos = qos;
        next
    }

    fn open_with(
        &mut self,
        now: Instant,
        backoff: &mut Backoff,
        open: impl FnOnce(&dyn Middleware) -> Result<Box<T>, OpenError>,
    ) {
        let Some(middleware) = &self.middleware else { return };
        let given_up = matches!(self.trouble, Some(RouteState::Error(_)));
        if self.open.is_some() || given_up || self.retry_at.is_some_and(|at| now < at) {
            return;
        }
        self.retry_at = None;
        match open(middleware.as_ref()) {
            Ok(opened) => {
                self.open = Some(opened);
                self.trouble = None;
            }
            Err(error) if error.is_transient() => {
                self.retry_at = Some(now + backoff.wait());
                self.trouble = Some(RouteState::Waiting(error.to_string()));
            }
            Err(error) => self.trouble = Some(RouteState::Error(error.to_string())),
        }
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
