//! Large messages to readers on Fast DDS, one after the other.
//!
//! ```text
//!   message ─▶ small, or nobody is on Fast DDS ────────────────────────────▶ written
//!          └─▶ large ─▶ the large one before it is acknowledged ───────────▶ written
//!                  └──▶ it is not within MAX_BLOCKING ─▶ dropped, counted; once its time is over: written
//! ```
//!
//! A Fast DDS node leaves its receive buffer as the kernel makes it: `net.core.rmem_default`, 212 992
//! bytes, which is three datagrams of ours. An image of 0.9 MB is fifteen, so most are lost and asked for
//! again, a few at a time. Where the next image begins before that has ended, its fragments push out those
//! that were asked for; a reader whose history is full gives the older image up; and Fast DDS 2.14, which then
//! looks for what it has given up under the lock of the reader, may never come back: the program that
//! subscribes stands still. So a large message waits until the readers have the one before it.
//!
//! Best-effort readers acknowledge nothing and ask for nothing: their messages are kept apart in time, so that
//! one does not fall into the buffer with the one before it, and what is longer than the buffer mostly is
//! lost. The user is told.

use std::time::{Duration, Instant};

use super::cyclone::RawWriter;
use super::discovery_info::Gid;
use super::graph::{NodeWatch, ServiceMapping, TopicDescription};
use super::vendor;
use wrapyfi_endpoint::Reliability;

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

/// Time for which a report waits for the name of the subscriber's node: Fast DDS repeats its
/// announcement every three seconds.
const NAME_TIMEOUT: Duration = Duration::from_secs(5);

/// Over which time the waiting is added up.
const WINDOW: Duration = Duration::from_secs(1);
/// Time for which a topic counts as slowed down after such a window.
const SLOW_FOR: Duration = Duration::from_secs(5);

/// Readers on Fast DDS that a writer is matched with, one of each kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Readers {
    reliable: Option<Gid>,
    best_effort: Option<Gid>,
}

/// Begins to watch the names of nodes.
type Nodes = Box<dyn Fn() -> Option<Box<dyn NodeWatch>> + Send>;

/// Decides when a large message of one writer may go.
pub(super) struct Pacing {
    /// Watch of the names of nodes, begun when a reader is slow.
    nodes: Nodes,
    /// Topic with the names of DDS.
    topic: TopicDescription,
    /// Bytes that any reader's socket holds.
    room: usize,
    /// Number of changes of matches that were seen, and the readers at that time.
    seen: Option<(u64, Readers)>,
    last: Option<Last>,
    /// Reports about a reliable reader, and about one that is best effort.
    slow_readers: [Option<SlowReader>; 2],
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

struct SlowReader {
    reader: Gid,
    /// Time since which the report waits for the name of the node; `None` once the user was told.
    unreported: Option<(Instant, Option<Box<dyn NodeWatch>>)>,
    /// Name of the reader's node, where it is known.
    name: Option<String>,
}

impl Pacing {
    pub(super) fn new(
        nodes: impl Fn() -> Option<Box<dyn NodeWatch>> + Send + 'static,
        topic: &TopicDescription,
    ) -> Self {
        let (nodes, topic) = (Box::new(nodes), topic.clone());
        let (seen, last, slow_readers) = (None, None, [None, None]);
        Self { nodes, topic, room: room(), seen, last, slow_readers, load: Load::default() }
    }

    /// Waits until a message of `bytes` may be written through `raw`; false where it may not be.
    pub(super) fn admit(&mut self, raw: &RawWriter, bytes: usize) -> bool {
        if bytes <= self.room {
            return true;
        }
        let readers = self.readers(raw);
        self.report(readers, bytes);
        if readers == Readers::default() {
            self.last = None;
            return true;
        }
        let begun = Instant::now();
        let is_admitted = self.wait(raw, readers, begun);
        let now = Instant::now();
        self.load.waited(begun, now, is_admitted);
        if is_admitted {
            self.last = Some(Last { written: now, bytes, is_late: false });
        } else if let Some(last) = &mut self.last {
            last.is_late = true;
        }
        is_admitted
    }

    /// Reason, in words, for which fewer messages go out than are given; `None` where all do.
    pub(super) fn slowed(&self) -> Option<String> {
        let now = Instant::now();
        let Last { bytes, .. } = self.last.filter(|_| self.load.is_slow(now))?;
        let slow = self.slow_readers.iter().flatten().next()?;
        let node = slow.name.as_deref().unwrap_or("a subscriber");
        Some(format!(
            "{node} runs Fast DDS and takes longer for messages of {bytes} bytes than there is between two: \
             the newest go, one after the other; {}",
            remedy(bytes)
        ))
    }

    fn wait(&self, raw: &RawWriter, readers: Readers, now: Instant) -> bool {
        let Some(Last { written, bytes, is_late }) = self.last else { return true };
        if readers.best_effort.is_some() {
            let due = written + time(bytes, BEST_EFFORT);
            std::thread::sleep(due.saturating_duration_since(now).min(MAX_BLOCKING));
        }
        if readers.reliable.is_none() || raw.all_acknowledged() {
            return true;
        }
        let timeout = LEAST_TIMEOUT + time(bytes, SLOWEST);
        let rest = (written + timeout).saturating_duration_since(Instant::now());
        if rest.is_zero() || is_late {
            return rest.is_zero();
        }
        let wait = rest.min(MAX_BLOCKING);
        let wait_ns = i64::try_from(wait.as_nanos()).unwrap_or(i64::MAX);
        raw.wait_for_acks(wait_ns).is_ok() || rest <= MAX_BLOCKING
    }

    /// Readers on Fast DDS that `raw` is matched with.
    fn readers(&mut self, raw: &RawWriter) -> Readers {
        let changes = raw.events().changes();
        if let Some((seen, found)) = self.seen
            && seen == changes
        {
            return found;
        }
        let mut found = Readers::default();
        for peer in raw.readers().unwrap_or_default() {
            if vendor::mapping_of(&peer.guid) == Some(ServiceMapping::FastDds) {
                let both = [peer.reliability, self.topic.qos.reliability];
                let is_reliable = both == [Reliability::Reliable; 2];
                let kind = if is_reliable { &mut found.reliable } else { &mut found.best_effort };
                *kind = Some(peer.guid);
            }
        }
        self.seen = Some((changes, found));
        found
    }

    /// Warns once about the readers.
    fn report(&mut self, readers: Readers, bytes: usize) {
        let topic = super::names::topic_from_dds(&self.topic.name).unwrap_or(&self.topic.name);
        let kinds = [
            (readers.reliable, "one waits until the one before it has arrived, which takes longer"),
            (
                readers.best_effort,
                "most of them are lost to it, which is best effort and asks for none again",
            ),
        ];
        for (entry, (reader, what)) in self.slow_readers.iter_mut().zip(kinds) {
            let Some(reader) = reader else {
                *entry = None;
                continue;
            };
            let slow = match entry {
                Some(slow) if slow.reader == reader => slow,
                entry => entry.insert(SlowReader::new((self.nodes)(), reader)),
            };
            if let Some(node) = slow.now() {
                let (room, remedy) = (self.room, remedy(bytes));
                tracing::warn!(
                    "{node} on {topic} runs Fast DDS (rmw_fastrtps_cpp), whose socket holds {room} bytes, and \
                     messages have {bytes}: {what}; {remedy}"
                );
            }
        }
    }
}

impl SlowReader {
    fn new(nodes: Option<Box<dyn NodeWatch>>, reader: Gid) -> Self {
        Self { reader, unreported: Some((Instant::now(), nodes)), name: None }
    }

    /// The reader's node, once: as soon as its name is known, or has been waited for.
    fn now(&mut self) -> Option<&str> {
        let (since, nodes) = self.unreported.as_mut()?;
        if let Some(nodes) = nodes {
            nodes.update();
            self.name = nodes.owner(&self.reader).map(str::to_owned);
        }
        if self.name.is_none() && since.elapsed() < NAME_TIMEOUT {
            return None;
        }
        self.unreported = None;
        Some(self.name.as_deref().unwrap_or("a subscriber of an unknown node"))
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
