//! Large messages to readers on Fast DDS, one after the other, and so their fragments.
//!
//! ```text
//!   message ─▶ small, or no reader is on Fast DDS ──────────────────────────▶ written
//!          └─▶ large ─▶ the large one before it is acknowledged ───────────▶ written, with a pause between fragments
//!                  └──▶ it is not within MAX_BLOCKING ─▶ dropped, counted; once its time is over: written, and
//!                       the program that has not acknowledged it is waited for no longer where there are other readers
//! ```
//!
//! A Fast DDS node leaves its receive buffer as the kernel makes it: `net.core.rmem_default`, 212 992
//! bytes, which is three datagrams of ours. An image of 0.9 MB is fifteen: sent at once, most are lost and asked for
//! again, a few at a time. So fragments go out with a pause between two, in which the reader empties its socket. Some
//! are lost all the same on a busy machine. If the next image begins before those have been sent again, its fragments
//! push out those that were asked for; a reader whose history is full gives the older image up; and Fast DDS 2.14, which
//! then looks for what it has given up under the lock of the reader, may never come back: the program that
//! subscribes stands still. So a large message waits until the readers have the one before it.
//!
//! Best-effort readers acknowledge nothing and ask for nothing: their messages are kept apart in time, so that
//! one does not fall into the buffer with the one before it. A message that misses a fragment is lost to them; the log
//! names such a reader, and the remedy.

use std::time::{Duration, Instant};

use super::cyclone::{EndpointFound, RawWriter};
use super::discovery_info::Gid;
use super::graph::{NodeWatch, ServiceMapping, TopicDescription};
use super::vendor;
use wrapyfi_endpoint::{Cause, Reliability};

/// Longest time that a write waits for reliable readers; only keep-all writers wait, the others
/// overwrite their oldest. A lost acknowledgement is repeated with the next heartbeat, 100 ms later,
/// so less would drop messages that were about to go; much more would let one stopped subscriber hold
/// up everything that the same thread propagates.
pub(super) const MAX_BLOCKING: Duration = Duration::from_millis(500);

/// Receive buffer in bytes that Linux gives a socket that asks for nothing.
const RMEM_DEFAULT: usize = 212_992;

/// Time that a message has to be acknowledged, to which the time of its bytes at [`SLOWEST`] is
/// added. Then the next one goes all the same, since a program that was stopped must not keep the
/// others from their messages.
const LEAST_TIMEOUT: Duration = Duration::from_millis(500);
/// Bytes per second at which a reader that works gets its fragments again, with room to spare.
const SLOWEST: usize = 4_000_000;
/// Bytes per second at which a best-effort reader empties its buffer.
const BEST_EFFORT: usize = 200_000_000;

/// Pause between two fragments, in which a reader takes the one before out of its socket. Linux adds up to 50 us to
/// a pause of a thread that is not real-time: a 1080p image of a hundred fragments takes 8 ms, where readers lost all
/// but the first of them when they came at once.
const FRAGMENT_PAUSE: Duration = Duration::from_micros(20);

/// Time for which a report waits for the name of the subscriber's node: Fast DDS repeats its
/// announcement every three seconds.
const NAME_TIMEOUT: Duration = Duration::from_secs(5);

/// Over which time the waiting is added up.
const WINDOW: Duration = Duration::from_secs(1);
/// Time for which a topic counts as slowed down after such a window.
const SLOW_FOR: Duration = Duration::from_secs(5);

/// Time after which a reader that was late is waited for again, where the others no longer wait for it.
const REST: Duration = Duration::from_secs(2);
/// Time that it then has: one that runs again and takes a little longer than there is between two messages would not
/// catch up otherwise, and the others hardly notice.
const LATE_TIMEOUT: Duration = Duration::from_millis(60);

/// Begins to watch the names of nodes.
type Nodes = Box<dyn Fn() -> Option<Box<dyn NodeWatch>> + Send>;

/// Decides when a large message of one writer may go.
pub(super) struct Pacing {
    nodes: Nodes,
    /// Watch of the names of nodes, while the name of a reader's node is unknown.
    watch: Option<Box<dyn NodeWatch>>,
    /// Topic with the names of DDS.
    topic: TopicDescription,
    /// Bytes that any reader's socket holds.
    room: usize,
    /// Number of changes of matches that were seen, and of matched readers of any kind at that time.
    seen: Option<(u64, usize)>,
    /// Those of them on Fast DDS.
    readers: Vec<FastReader>,
    last: Option<Last>,
    /// The reader that was waited for last.
    slowest: Option<Gid>,
    load: Load,
}

/// The last large message.
#[derive(Debug, Clone, Copy)]
struct Last {
    written: Instant,
    bytes: usize,
    /// True when a message was dropped because this one was not acknowledged: those behind it do
    /// not wait, too.
    is_late: bool,
}

/// A reader on Fast DDS that a writer is matched with.
struct FastReader {
    gid: Gid,
    is_reliable: bool,
    found: Instant,
    /// True once the user was told of it.
    is_told: bool,
    /// Name of its node, where it is known.
    name: Option<String>,
    /// Instant until which the others do not wait for the reader, because it was late.
    rests_until: Option<Instant>,
}

impl Pacing {
    pub(super) fn new(
        nodes: impl Fn() -> Option<Box<dyn NodeWatch>> + Send + 'static,
        topic: &TopicDescription,
    ) -> Self {
        Self {
            nodes: Box::new(nodes),
            watch: None,
            topic: topic.clone(),
            room: room(),
            seen: None,
            readers: Vec::new(),
            last: None,
            slowest: None,
            load: Load::default(),
        }
    }

    /// Waits until a message of `bytes` may be written through `raw`; false where it may not be.
    pub(super) fn admit(&mut self, raw: &RawWriter, bytes: usize) -> bool {
        if bytes <= self.room {
            return true;
        }
        let begun = Instant::now();
        self.look(raw, begun);
        self.report(bytes, begun);
        if self.readers.is_empty() {
            self.last = None;
            return true;
        }
        let is_admitted = self.wait(raw, begun);
        let now = Instant::now();
        self.load.waited(begun, now, is_admitted);
        if is_admitted {
            self.last = Some(Last { written: now, bytes, is_late: false });
        } else if let Some(last) = &mut self.last {
            last.is_late = true;
        }
        is_admitted
    }

    /// Pause between two fragments of a message of `bytes` bytes; none where its readers' sockets hold it whole, or
    /// none of them is on Fast DDS.
    pub(super) fn pause(&self, bytes: usize) -> Option<Duration> {
        (bytes > self.room && !self.readers.is_empty()).then_some(FRAGMENT_PAUSE)
    }

    /// Cause for which fewer messages go out than are given, or a reader is left behind; `None` where all go to all.
    pub(super) fn slowed(&self) -> Option<Cause> {
        let (now, bytes) = (Instant::now(), self.last?.bytes);
        let rests =
            |reader: &&FastReader| reader.rests_until.is_some_and(|until| now < until + WINDOW);
        let name = |reader: Option<&FastReader>| reader.and_then(|reader| reader.name.clone());
        let remedy = remedy(bytes);
        if let resting @ Some(_) = self.readers.iter().find(rests) {
            return Some(Cause::Unacknowledged { reader: name(resting), bytes, remedy });
        }
        let slowest = self.readers.iter().find(|reader| Some(reader.gid) == self.slowest);
        self.load.is_slow(now).then(|| Cause::SlowReader { reader: name(slowest), bytes, remedy })
    }

    /// Waits for the readers that have not acknowledged the last message. One that is late holds up the others once:
    /// then they do not wait for it until it has everything.
    fn wait(&mut self, raw: &RawWriter, now: Instant) -> bool {
        let Some(Last { written, bytes, is_late }) = self.last else { return true };
        if self.readers.iter().any(|reader| !reader.is_reliable) {
            let due = written + time(bytes, BEST_EFFORT);
            std::thread::sleep(due.saturating_duration_since(now).min(MAX_BLOCKING));
        }
        let resting = self.readers.iter().filter(|reader| reader.rests_until.is_some()).count();
        let has_others = self.seen.is_some_and(|(_, matched)| matched > resting);
        let mut awaited = Vec::new();
        for reader in self.readers.iter_mut().filter(|reader| reader.is_reliable) {
            if !(reader.has_all(raw, now) || has_others && reader.rests_until.is_some()) {
                awaited.push(reader);
            }
        }
        if awaited.is_empty() {
            return true;
        }
        let timeout = LEAST_TIMEOUT + time(bytes, SLOWEST);
        let rest = (written + timeout).saturating_duration_since(Instant::now());
        if is_late && !rest.is_zero() {
            return false;
        }
        let until = Instant::now() + rest.min(MAX_BLOCKING);
        let has_time_left = rest > MAX_BLOCKING;
        let mut is_acknowledged = true;
        for reader in awaited {
            self.slowest = Some(reader.gid);
            if !raw.acknowledged_by(&reader.gid, until.saturating_duration_since(Instant::now())) {
                is_acknowledged = false;
                if !has_time_left {
                    reader.rests_until = Some(Instant::now() + REST);
                }
            }
        }
        is_acknowledged || !has_time_left
    }

    /// Finds the readers on Fast DDS that `raw` is matched with.
    fn look(&mut self, raw: &RawWriter, now: Instant) {
        let changes = raw.events().changes();
        if self.seen.is_some_and(|(seen, _)| seen == changes) {
            return;
        }
        let peers = raw.readers().unwrap_or_default();
        self.seen = Some((changes, peers.len()));
        let mut known = std::mem::take(&mut self.readers);
        let fast = |peer: &&EndpointFound| {
            vendor::mapping_of(&peer.guid, None) == Some(ServiceMapping::FastDds)
        };
        for peer in peers.iter().filter(fast) {
            let found = known.iter().position(|reader| reader.gid == peer.guid);
            self.readers.push(found.map(|at| known.swap_remove(at)).unwrap_or_else(|| {
                FastReader {
                    gid: peer.guid,
                    is_reliable: [peer.qos.reliability, self.topic.qos.reliability]
                        == [Reliability::Reliable; 2],
                    found: now,
                    is_told: false,
                    name: None,
                    rests_until: None,
                }
            }));
        }
    }

    /// Finds the names of the readers' nodes, and warns once about each best-effort reader: as soon as the name of its
    /// node is known, or has been waited for.
    fn report(&mut self, bytes: usize, now: Instant) {
        if self.readers.iter().all(|reader| reader.is_told && reader.name.is_some()) {
            self.watch = None;
            return;
        }
        if self.watch.is_none() {
            self.watch = (self.nodes)();
        }
        let Some(watch) = &mut self.watch else { return };
        watch.update();
        let topic = super::names::topic_from_dds(&self.topic.name).unwrap_or(&self.topic.name);
        for reader in self.readers.iter_mut().filter(|reader| reader.name.is_none()) {
            reader.name = watch.owner(&reader.gid).map(str::to_owned);
            let is_due = reader.name.is_some() || now >= reader.found + NAME_TIMEOUT;
            let is_news = is_due && !std::mem::replace(&mut reader.is_told, is_due);
            if is_news && !reader.is_reliable {
                let node = reader.name.as_deref().unwrap_or("a subscriber of an unknown node");
                let (room, remedy) = (self.room, remedy(bytes));
                tracing::warn!(
                    "{node} on {topic} runs Fast DDS (rmw_fastrtps_cpp), whose socket holds {room} bytes, and \
                     messages have {bytes}: those of which a fragment finds no room are lost to it, which is best effort \
                     and asks for none again; {remedy}"
                );
            }
        }
    }
}

impl FastReader {
    /// True when it has acknowledged every message. One that was late has a little time for it now and then.
    fn has_all(&mut self, raw: &RawWriter, now: Instant) -> bool {
        let is_due = self.rests_until.is_some_and(|until| now >= until);
        let timeout = if is_due { LATE_TIMEOUT } else { Duration::ZERO };
        let has_all = raw.acknowledged_by(&self.gid, timeout);
        if has_all {
            self.rests_until = None;
        } else if is_due {
            self.rests_until = Some(Instant::now() + REST);
        }
        has_all
    }
}

/// Remedy for a reader on Fast DDS that receives messages of `bytes` bytes slowly.
fn remedy(bytes: usize) -> String {
    let wanted = bytes.saturating_mul(4).next_power_of_two();
    format!(
        "run sysctl -w net.core.rmem_default={wanted} before both programs start, or build this one where that \
         ROS 2 is sourced, to speak through Fast DDS (docs/reference/qos.md)"
    )
}

fn time(bytes: usize, per_second: usize) -> Duration {
    Duration::from_secs_f64(bytes as f64 / per_second as f64)
}

/// Bytes that the socket of a reader holds which asks the kernel for nothing. Of other machines the
/// same is assumed.
fn room() -> usize {
    let default = std::fs::read_to_string("/proc/sys/net/core/rmem_default");
    let default = default.ok().and_then(|text| text.trim().parse().ok()).unwrap_or(RMEM_DEFAULT);
    // The kernel counts its own overhead of a datagram too.
    default - default / 8
}

/// Share of the time that is spent waiting.
#[derive(Debug, Default)]
struct Load {
    /// Begin of the time that is looked at, and how much of it was waited.
    window: Option<(Instant, Duration)>,
    slow_until: Option<Instant>,
}

impl Load {
    fn waited(&mut self, begun: Instant, ended: Instant, is_admitted: bool) {
        let (start, waited) = self.window.unwrap_or((begun, Duration::ZERO));
        let waited = waited + ended.saturating_duration_since(begun);
        let length = ended.saturating_duration_since(start);
        self.window = Some((start, waited));
        if !is_admitted {
            self.slow_until = Some(ended + SLOW_FOR);
        }
        if length >= WINDOW {
            // Nothing but waiting: the next message was there already whenever one had gone.
            if waited >= length.mul_f64(0.8) {
                self.slow_until = Some(ended + SLOW_FOR);
            }
            self.window = None;
        }
    }

    fn is_slow(&self, now: Instant) -> bool {
        self.slow_until.is_some_and(|until| now < until)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_topic_is_slow_where_all_the_time_is_spent_waiting_or_messages_are_dropped() {
        let start = Instant::now();
        let run = |wait: u32, every: u32, is_admitted: bool| {
            let mut load = Load::default();
            let mut now = start;
            for _ in 0..60 {
                load.waited(now, now + wait * MS, is_admitted);
                now += every * MS;
            }
            load.is_slow(now)
        };
        assert!(!run(5, 33, true), "it keeps up");
        assert!(run(36, 36, true), "it does not");
        assert!(run(1, 100, false), "messages are dropped");
        let mut load = Load::default();
        load.waited(start, start + 500 * MS, false);
        assert!(load.is_slow(start + SLOW_FOR));
        assert!(!load.is_slow(start + SLOW_FOR + 500 * MS));
    }

    #[test]
    fn the_remedy_holds_four_messages() {
        assert!(remedy(921_600).contains("rmem_default=4194304 "), "{}", remedy(921_600));
    }
}
