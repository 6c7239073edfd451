//! Breaker of a route whose messages come back to it through other programs.
//!
//! ```text
//!   watching ─ the same content again and again ─▶ trial ─ nothing came ─▶ messages pass ┐
//!      ▲                                             ▲     while held       and are back │ some rounds
//!      ├── it came all the same, or not again ◀──────┤                                   ▼
//!      │                                             └────────────────────────── round ──┤
//!      └── mending ◀─ the time is over ── open: what comes is dropped as `loop` ◀────────┘
//! ```
//!
//! A publisher that says one thing a thousand times a second looks like a loop. So a trial holds the route's
//! messages back for a moment: a publisher goes on, a loop has nothing to go round. Held messages go on in
//! their order, none is lost. All bridges hold at the same moments of the system's clock, because several may
//! be part of one loop. Decision 009 says what was weighed.

use std::collections::VecDeque;
use std::fmt::{self, Write as _};
use std::hash::{DefaultHasher, Hasher as _};
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::lanes::{Answer, Lane, Lanes, PUBLISHES};
use super::route::Route;
use super::route_status::RouteState;
use wrapyfi_data::types::{Payload, Pixels};
use wrapyfi_endpoint::{Counters, DropReason, EndpointAddress, Sample};

/// Time over which messages and repeated contents are counted.
const WINDOW: Duration = Duration::from_millis(500);
/// Number of messages in a window from which on contents are compared.
const HOT: u32 = 50;
/// Number of contents that a window remembers.
const CONTENTS: usize = 1024;
/// Number of messages of a window whose contents are compared, the first ones: what goes round comes again among
/// them, and a content of an object takes longer to look at than all else that a route does with it.
const MOST_COMPARED: u32 = 1024;
/// Number of bytes of a content that are looked at, at its beginning and at its end.
const LOOKED_AT: usize = 128;
/// Longest time that messages stay in a loop once they are held back, in the first trial.
const DRAIN: Duration = Duration::from_millis(20);
/// Number of rounds after which the breaker opens.
const ROUNDS: u32 = 8;
/// Shortest time in which nothing may come.
const QUIET: Duration = Duration::from_millis(20);
/// Number of messages that a publisher would have sent in the quiet time, at least.
const EXPECTED: f64 = 4.0;
/// Longest pause that a busy machine makes in a loop.
const LONGEST_PAUSE: Duration = Duration::from_millis(200);
/// Distance of two rounds.
const SLOT: Duration = Duration::from_millis(125);
/// Number of different contents from which on queues are taken to be full of messages that go round, as where
/// the route's own is.
const SATURATED_CONTENTS: u32 = 8;
/// Times for these: they have to run empty first.
const SATURATED: Pace =
    Pace { drain: Duration::from_millis(320), slot: Duration::from_millis(750), rounds: 5 };
/// Times of a trial of others.
const USUAL: Pace = Pace { drain: DRAIN, slot: SLOT, rounds: ROUNDS };
/// Largest number of messages that are held, and of their bytes; others wait in the route's queue.
const MOST_HELD: usize = 256;
const MOST_HELD_BYTES: usize = 8 << 20;
/// Time from a trial that found no loop to the next one.
const FIRST_GAP: Duration = Duration::from_secs(2);
/// Number of trials after which that time doubles: a busy machine delays messages.
const FIRST_GAPS: u32 = 3;
/// Number of rounds of a trial after which messages may be late.
const LATE_ROUNDS: u32 = 2;
const LONGEST_GAP: Duration = Duration::from_secs(300);
/// Time for which the breaker is open, which doubles while the loop is there again each time.
const FIRST_OPEN: Duration = Duration::from_secs(5);
const LONGEST_OPEN: Duration = Duration::from_secs(60);
/// Time without another trial after which a loop counts as mended, if messages have passed.
const MENDED_AFTER: Duration = Duration::from_secs(10);

/// Decision about a message.
pub(super) enum Passage {
    /// It goes on.
    Pass(Sample),
    /// It is held, and will be released.
    Held,
    /// It is dropped.
    Looped,
}

/// Detector and breaker of one route.
pub(super) struct Tripwire {
    from: EndpointAddress,
    to: EndpointAddress,
    is_on: bool,
    lanes: Arc<Lanes>,
    /// Entry among the lanes, once the route was busy.
    lane: Option<Arc<Lane>>,
    window: Window,
    phase: Phase,
    held: VecDeque<Sample>,
    held_bytes: usize,
    /// Number of messages that the full queue had dropped at the last look.
    queue_full: u64,
    /// Time between trials that find nothing, and the earliest instant of the next one.
    gap: Duration,
    not_before: Option<Instant>,
    /// Number of trials that found nothing, from which the next one takes longer.
    acquitted: u32,
    /// Number of times that the breaker opened, since the loop was last mended.
    opened: u32,
    mending: Option<Mending>,
}

enum Phase {
    Watching,
    Trial(Box<Trial>),
    Open { until: Instant, reason: String },
}

/// Loop that was there, and whether it is still.
struct Mending {
    reason: String,
    since: Instant,
    has_passed: bool,
}

#[derive(Clone, Copy)]
struct Pace {
    drain: Duration,
    slot: Duration,
    rounds: u32,
}

impl Pace {
    /// Longest time in which a message comes back, once nothing else is under way.
    fn back(self) -> Duration {
        self.drain.min(2 * DRAIN)
    }
}

struct Trial {
    pace: Pace,
    quiet: Duration,
    rate_hz: f64,
    round: u32,
    late_rounds: u32,
    step: Step,
    answers: Vec<Answer>,
}

/// Step of a round, with the instant of its beginning and the number of messages received then.
#[derive(Clone, Copy)]
enum Step {
    /// Messages pass until the instant.
    Armed { at: Instant },
    /// Messages are held; those that are still under way arrive.
    Draining { since: Instant, drain: Duration },
    /// Messages are held, and none should come.
    Quiet { since: Instant, received: u64 },
    /// Messages pass, and should come back.
    Back { since: Instant, received: u64 },
}

impl Tripwire {
    pub(super) fn new(spec: &Route, lanes: Arc<Lanes>) -> Self {
        Self {
            from: spec.from.clone(),
            to: spec.to.clone(),
            is_on: spec.policy.loop_guard,
            lanes,
            lane: None,
            window: Window::default(),
            phase: Phase::Watching,
            held: VecDeque::new(),
            held_bytes: 0,
            queue_full: 0,
            gap: FIRST_GAP,
            not_before: None,
            acquitted: 0,
            opened: 0,
            mending: None,
        }
    }

    /// Moves on with time; to be called in each step before messages are taken.
    pub(super) fn poll(&mut self, now: Instant, counters: &Arc<Counters>) {
        match std::mem::replace(&mut self.phase, Phase::Watching) {
            Phase::Watching => {
                // Routes back are known before a trial begins.
                if self.lane.is_none() && !self.window.contents.is_empty() {
                    let counters = Arc::clone(counters);
                    self.lane = Some(self.lanes.enter(&self.from, &self.to, counters));
                }
                if let Some(seen) = self.window.finished.take() {
                    self.look(&seen, now, counters);
                }
            }
            Phase::Trial(trial) => self.try_on(trial, now, counters),
            Phase::Open { until, reason } if now < until => {
                self.phase = Phase::Open { until, reason };
            }
            Phase::Open { reason, .. } => {
                self.mending = Some(Mending { reason, since: now, has_passed: false });
                (self.gap, self.not_before, self.acquitted) = (FIRST_GAP, None, 0);
            }
        }
    }

    /// Instant of the next step, where nothing comes before.
    pub(super) fn due(&self) -> Option<Instant> {
        match &self.phase {
            Phase::Watching => None,
            Phase::Open { until, .. } => Some(*until),
            Phase::Trial(trial) => Some(match trial.step {
                Step::Armed { at } => at,
                Step::Draining { since, drain } => since + drain,
                Step::Quiet { since, .. } => since + trial.quiet,
                Step::Back { since, .. } => since + trial.pace.back(),
            }),
        }
    }

    /// Decides about a message that was taken.
    pub(super) fn judge(&mut self, sample: Sample, now: Instant) -> Passage {
        match &self.phase {
            Phase::Open { .. } => return Passage::Looped,
            Phase::Watching if self.is_on => self.window.note(&sample.payload, now),
            Phase::Trial(_) if self.holds() => {
                self.held_bytes += sample.wire_bytes;
                self.held.push_back(sample);
                return Passage::Held;
            }
            Phase::Watching | Phase::Trial(_) => {}
        }
        if let Some(mending) = &mut self.mending {
            mending.has_passed = true;
        }
        Passage::Pass(sample)
    }

    fn holds(&self) -> bool {
        matches!(&self.phase, Phase::Trial(trial)
            if matches!(trial.step, Step::Draining { .. } | Step::Quiet { .. }))
    }

    /// True while no more is to be taken from the source.
    pub(super) fn is_full(&self) -> bool {
        self.holds() && (self.held.len() >= MOST_HELD || self.held_bytes >= MOST_HELD_BYTES)
    }

    /// The next message that was held and may go on.
    pub(super) fn release(&mut self) -> Option<Sample> {
        if self.holds() { None } else { self.give_up_one() }
    }

    /// The next message that is held, for whom nobody waits any more.
    pub(super) fn give_up_one(&mut self) -> Option<Sample> {
        let sample = self.held.pop_front()?;
        self.held_bytes = self.held_bytes.saturating_sub(sample.wire_bytes);
        Some(sample)
    }

    /// Forgets what was seen, at the end of the route's endpoints; number of messages held.
    pub(super) fn close(&mut self) -> usize {
        if matches!(self.phase, Phase::Trial(_)) {
            self.end_trial();
        }
        self.window = Window::default();
        self.held_bytes = 0;
        std::mem::take(&mut self.held).len()
    }

    /// State of a route whose breaker is open, or was open lately.
    pub(super) fn state(&mut self, now: Instant) -> Option<RouteState> {
        if let Phase::Open { reason, .. } = &self.phase {
            return Some(RouteState::Error(reason.clone()));
        }
        let mending = self.mending.as_ref()?;
        let is_calm = now.saturating_duration_since(mending.since) >= MENDED_AFTER;
        if is_calm && mending.has_passed && matches!(self.phase, Phase::Watching) {
            (self.mending, self.opened) = (None, 0);
            return None;
        }
        let Mending { reason, .. } = mending;
        Some(RouteState::Degraded(format!("messages pass again after a {reason}")))
    }

    /// Looks at a window that has ended.
    fn look(&mut self, seen: &Seen, now: Instant, counters: &Counters) {
        let Some(lane) = self.lane.as_ref().filter(|_| seen.messages >= HOT) else { return };
        let queue_full = counters.snapshot().dropped_for(DropReason::QueueFull);
        let is_full = queue_full > std::mem::replace(&mut self.queue_full, queue_full);
        let repeats = seen.repeated >= HOT / 2 && seen.repeated * 2 >= seen.compared;
        let is_suspect = repeats && !seen.is_bursts();
        if !is_suspect || self.not_before.is_some_and(|at| now < at) {
            return;
        }
        let Some(answers) = self.lanes.begin(lane, now) else { return };
        let [_, second] = seen.gaps;
        let rate_hz = f64::from(seen.messages) / seen.time.as_secs_f64();
        let is_saturated = is_full || seen.contents() >= SATURATED_CONTENTS;
        let mut pace = if is_saturated { SATURATED } else { USUAL };
        // A loop that was slower than the last trial is found by a longer one.
        pace.drain *=
            if is_saturated { 1 << self.acquitted.min(2) } else { 1 + self.acquitted.min(1) };
        self.phase = Phase::Trial(Box::new(Trial {
            quiet: QUIET.max(Duration::from_secs_f64(EXPECTED / rate_hz)).max(second * 5 / 2),
            step: Step::Armed { at: next_slot(now, pace.slot).0 },
            round: 0,
            late_rounds: 0,
            answers,
            rate_hz,
            pace,
        }));
    }

    /// Moves a trial on.
    fn try_on(&mut self, mut trial: Box<Trial>, now: Instant, counters: &Counters) {
        let received = || counters.received_so_far();
        let elapsed = |since| now.saturating_duration_since(since);
        trial.step = match trial.step {
            Step::Armed { at } if now >= at => {
                if trial.round > 0 {
                    trial.answers.iter_mut().for_each(|it| it.has_passed(now));
                }
                let (_, jitter) = next_slot(now, trial.pace.slot);
                Step::Draining { since: now, drain: trial.pace.drain.mul_f64(1.0 + jitter / 2.0) }
            }
            Step::Draining { since, drain } if elapsed(since) >= drain => {
                for answer in &mut trial.answers {
                    answer.since(now);
                }
                Step::Quiet { since: now, received: received() }
            }
            Step::Quiet { since, received: before } => {
                let came = received().saturating_sub(before) as f64;
                if came > (trial.rate_hz * trial.quiet.as_secs_f64() * PUBLISHES).max(1.0) {
                    return self.acquit(now);
                }
                if elapsed(since) >= trial.quiet {
                    trial.answers.iter_mut().for_each(|it| it.was_quiet(now));
                    Step::Back { since: now, received: received() }
                } else {
                    trial.step
                }
            }
            Step::Back { received: before, .. } if received() > before => {
                trial.round += 1;
                if trial.round >= trial.pace.rounds {
                    return match trial.answers.iter().any(|it| it.fell_silent(trial.rate_hz)) {
                        true => self.acquit(now),
                        false => self.open(trial.rate_hz, now),
                    };
                }
                Step::Armed { at: next_slot(now, trial.pace.slot).0 }
            }
            Step::Back { since, .. } if elapsed(since) >= trial.pace.back() => {
                trial.late_rounds += 1;
                if trial.late_rounds > LATE_ROUNDS {
                    return self.acquit(now);
                }
                Step::Armed { at: next_slot(now, trial.pace.slot).0 }
            }
            waits => waits,
        };
        self.phase = Phase::Trial(trial);
    }

    fn end_trial(&mut self) {
        self.phase = Phase::Watching;
        self.window = Window::default();
        if let Some(lane) = &self.lane {
            lane.is_in_trial.store(false, Relaxed);
        }
    }

    /// Ends a trial that found no loop.
    fn acquit(&mut self, now: Instant) {
        self.end_trial();
        self.not_before = Some(now + self.gap);
        self.acquitted += 1;
        if self.acquitted >= FIRST_GAPS {
            self.gap = (self.gap * 2).min(LONGEST_GAP);
        }
    }

    /// Opens the breaker.
    fn open(&mut self, rate_hz: f64, now: Instant) {
        self.end_trial();
        let time = (FIRST_OPEN * (1 << self.opened.min(6))).min(LONGEST_OPEN);
        self.opened += 1;
        let (Self { from, to, .. }, seconds) = (&*self, time.as_secs());
        let reason = format!(
            "loop: what this route sends to {to} comes back to {from} through other programs, {rate_hz:.0} \
             messages a second; leave out the route from {to} to {from}, or end the bridge that has it; \
             tried again after {seconds} s"
        );
        self.phase = Phase::Open { until: now + time, reason };
        self.mending = None;
    }
}

impl Drop for Tripwire {
    fn drop(&mut self) {
        self.close();
    }
}

/// Beginning of the next slot of the system's clock, which is the same for all programs, and a number between 0
/// and 1 that differs from slot to slot.
fn next_slot(now: Instant, slot: Duration) -> (Instant, f64) {
    static START: OnceLock<(Instant, Duration)> = OnceLock::new();
    let (start, wall) = *START.get_or_init(|| {
        (Instant::now(), SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default())
    });
    let now_ns = match now.checked_duration_since(start) {
        Some(since) => wall + since,
        None => wall.saturating_sub(start.saturating_duration_since(now)),
    }
    .as_nanos();
    let slot_ns = slot.as_nanos().max(1);
    let rest = slot_ns - now_ns % slot_ns;
    // Golden-ratio steps spread evenly, whatever the period of a publisher.
    let number = (now_ns / slot_ns % 1_000_000) as f64;
    let jitter = (number * 0.618_033_988_749_895).fract();
    (now + Duration::from_nanos(u64::try_from(rest).unwrap_or(0)), jitter)
}

/// Messages of the last half second, and their contents.
#[derive(Default)]
struct Window {
    since: Option<Instant>,
    /// Instant of the last message.
    last: Option<Instant>,
    seen: Seen,
    /// Fingerprints, each at the place that its value says; empty while the route is not busy.
    contents: Vec<u64>,
    finished: Option<Seen>,
}

/// Numbers of a window.
#[derive(Default)]
struct Seen {
    time: Duration,
    messages: u32,
    /// Number of messages whose contents were compared, and of those that were there before.
    compared: u32,
    repeated: u32,
    /// The longest times without a message, the longest first.
    gaps: [Duration; 2],
}

impl Window {
    fn note(&mut self, payload: &Payload, now: Instant) {
        let since = *self.since.get_or_insert(now);
        let gap = now.saturating_duration_since(self.last.replace(now).unwrap_or(now));
        let [longest, second] = self.seen.gaps;
        if gap > second {
            self.seen.gaps = [longest.max(gap), longest.min(gap)];
        }
        let time = now.saturating_duration_since(since);
        if time >= WINDOW {
            let seen = Seen { time, ..std::mem::take(&mut self.seen) };
            // A window of a busy route begins with all contents unknown, one of a calm route with none.
            if seen.messages >= HOT {
                self.contents.fill(0);
            } else {
                self.contents = Vec::new();
            }
            (self.finished, self.since) = (Some(seen), Some(now));
        }
        self.seen.messages += 1;
        if self.contents.is_empty() {
            if self.seen.messages < HOT {
                return;
            }
            self.contents = vec![0; CONTENTS];
        }
        if self.seen.compared >= MOST_COMPARED {
            return;
        }
        self.seen.compared += 1;
        let content = fingerprint(payload).max(1);
        let place = usize::try_from(content % CONTENTS as u64).unwrap_or(0);
        if let Some(known) = self.contents.get_mut(place)
            && std::mem::replace(known, content) == content
        {
            self.seen.repeated += 1;
        }
    }
}

impl Seen {
    /// Number of different contents.
    fn contents(&self) -> u32 {
        self.compared - self.repeated
    }

    /// True where messages come in bursts, as none do that go round. A busy machine may make one pause.
    fn is_bursts(&self) -> bool {
        let [longest, second] = self.gaps;
        longest > LONGEST_PAUSE || second > 2 * DRAIN
    }
}

/// Hash of the ends of a content and of its length. Contents that differ in their middle alone may share one, which
/// costs a trial.
fn fingerprint(payload: &Payload) -> u64 {
    let mut into = Fingerprint { hasher: DefaultHasher::new(), left: 2 * LOOKED_AT };
    match payload {
        Payload::RosMessage(message) => into.bytes(&message.cdr),
        Payload::AudioChunk(sound) => {
            into.hasher.write_i32(sound.stamp.sec);
            into.hasher.write_u32(sound.stamp.nanosec);
            into.bytes(&sound.data);
        }
        Payload::Image(image) => {
            into.hasher.write_i32(image.stamp.sec);
            into.hasher.write_u32(image.stamp.nanosec);
            into.bytes(match &image.pixels {
                Pixels::Raw(raw) => &raw.data,
                Pixels::Compressed { data, .. } => data,
            });
        }
        // Writing ends with an error where enough has been looked at.
        Payload::NativeObject(object) => drop(write!(into, "{object:?}")),
        Payload::Properties(properties) => drop(write!(into, "{properties:?}")),
    }
    into.hasher.finish()
}

struct Fingerprint {
    hasher: DefaultHasher,
    left: usize,
}

impl Fingerprint {
    fn bytes(&mut self, bytes: &[u8]) {
        self.hasher.write_usize(bytes.len());
        let (begin, rest) = bytes.split_at(bytes.len().min(LOOKED_AT));
        self.hasher.write(begin);
        self.hasher.write(rest.split_at(rest.len().saturating_sub(LOOKED_AT)).1);
    }
}

impl fmt::Write for Fingerprint {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.hasher.write(text.as_bytes());
        self.left = self.left.checked_sub(text.len()).ok_or(fmt::Error)?;
        Ok(())
    }
}

#[cfg(test)]
#[path = "tripwire_tests.rs"]
mod tests;
