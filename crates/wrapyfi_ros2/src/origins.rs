//! Writers of the publishers at the other end of a route that keep their last message: one each, as
//! on a graph of their own.
//!
//! ```text
//!   origin 1 ─▶ writer, transient local, replays its last message ┐
//!   origin 2 ─▶ writer …                                          ┴▶ late readers: one of each
//!   the others ─▶ the publisher's own writer
//! ```
//!
//! One writer for all could keep only the last messages, whosever they are. A reader that asks for
//! what was sent before is given it by a writer that is new as well; one that does not has to know the
//! writer first, so messages wait where such readers are.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use wrapyfi_interfaces::cdr::CdrParts;

use super::graph::{CdrWriter, GraphError, QosEvents};

/// Origins that have a writer of their own.
pub(super) const MAX_ORIGINS: usize = 128;
/// Messages that wait for readers to know a new writer.
const MAX_HELD: usize = 100;

/// The writers.
#[derive(Default)]
pub(super) struct Origins {
    open: BTreeMap<u64, Own>,
    /// Writers whose origins are gone, each with the time at which it is closed.
    closing: Vec<(Own, Instant)>,
}

/// The writer of one origin.
struct Own {
    writer: Box<dyn CdrWriter>,
    /// Time until which messages are held.
    opens: Option<Instant>,
    held: VecDeque<CdrParts>,
    written: Option<Instant>,
}

impl Origins {
    pub(super) fn has(&self, origin: u64) -> bool {
        self.open.contains_key(&origin)
    }

    pub(super) fn is_full(&self) -> bool {
        self.open.len() >= MAX_ORIGINS
    }

    /// Enters a writer that is new; messages are held until `opens`.
    pub(super) fn enter(
        &mut self,
        origin: u64,
        writer: Box<dyn CdrWriter>,
        opens: Option<Instant>,
    ) {
        let (held, written) = (VecDeque::new(), None);
        self.open.insert(origin, Own { writer, opens, held, written });
    }

    /// Writes a message through the writer of its origin, or holds it; how many are lost by that.
    /// `None` where the origin has no writer.
    pub(super) fn write(
        &mut self,
        origin: u64,
        cdr: CdrParts,
        now: Instant,
    ) -> Option<Result<usize, GraphError>> {
        let own = self.open.get_mut(&origin)?;
        Some(own.write(cdr, now))
    }

    /// An origin has gone: its writer goes when readers that are there have what they were sent
    /// within the last `linger`.
    pub(super) fn forget(&mut self, origin: u64, now: Instant, linger: Duration) {
        let Some(own) = self.open.remove(&origin) else { return };
        let since = own.opens.or(own.written);
        let closes = since.map_or(now, |since| since + linger);
        if closes > now {
            self.closing.push((own, closes));
        }
    }

    /// All origins have gone.
    pub(super) fn forget_all(&mut self, now: Instant, linger: Duration) {
        let all: Vec<u64> = self.open.keys().copied().collect();
        all.into_iter().for_each(|origin| self.forget(origin, now, linger));
    }

    /// Writes what was held for long enough, and closes what is due; when to ask again, and what
    /// went wrong.
    pub(super) fn look(&mut self, now: Instant) -> (Option<Instant>, Vec<GraphError>) {
        let mut faults = Vec::new();
        let going = self.closing.iter_mut().map(|(own, _)| own);
        for own in self.open.values_mut().chain(going) {
            if own.opens.is_some_and(|opens| now >= opens) {
                faults.extend(own.flush(now).err());
            }
        }
        self.closing.retain(|(_, closes)| now < *closes);
        let opens = self.open.values().filter_map(|own| own.opens);
        let closing = self.closing.iter().map(|(own, closes)| own.opens.unwrap_or(*closes));
        (opens.chain(closing).min(), faults)
    }

    /// Most readers that one of them is matched with.
    pub(super) fn matched(&self) -> usize {
        self.open.values().map(|own| own.writer.matched()).max().unwrap_or(0)
    }

    /// Number of events of all these writers since the last call.
    pub(super) fn qos_events(&self) -> QosEvents {
        self.open.values().map(|own| own.writer.qos_events()).fold(
            QosEvents::default(),
            |all, one| QosEvents {
                deadlines_missed: all.deadlines_missed.saturating_add(one.deadlines_missed),
                liveliness_lost: all.liveliness_lost.saturating_add(one.liveliness_lost),
            },
        )
    }
}

impl Own {
    fn write(&mut self, cdr: CdrParts, now: Instant) -> Result<usize, GraphError> {
        if self.opens.is_some_and(|opens| now < opens) {
            self.held.push_back(cdr);
            let lost = self.held.len().saturating_sub(MAX_HELD);
            self.held.drain(..lost);
            return Ok(lost);
        }
        self.flush(now)?;
        self.put(&cdr, now)?;
        Ok(0)
    }

    /// Writes what was held.
    fn flush(&mut self, now: Instant) -> Result<(), GraphError> {
        self.opens = None;
        while let Some(cdr) = self.held.pop_front() {
            self.put(&cdr, now)?;
        }
        Ok(())
    }

    fn put(&mut self, cdr: &CdrParts, now: Instant) -> Result<(), GraphError> {
        let parts: Vec<&[u8]> = cdr.pieces().iter().map(AsRef::as_ref).collect();
        self.writer.write(&parts)?;
        self.written = Some(now);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use wrapyfi_interfaces::cdr::CdrWriter as Maker;

    /// Notes what is written, and that it was closed.
    #[derive(Clone, Default)]
    struct Notes(Arc<Mutex<Vec<String>>>);

    struct Noting(Notes, u64);

    impl CdrWriter for Noting {
        fn write(&mut self, parts: &[&[u8]]) -> Result<(), GraphError> {
            let last = parts.concat().last().copied().unwrap_or_default();
            self.0.0.lock().unwrap().push(format!("{}:{last}", self.1));
            Ok(())
        }

        fn matched(&self) -> usize {
            1
        }

        fn incompatible(&self) -> Option<&'static str> {
            None
        }
    }

    impl Drop for Noting {
        fn drop(&mut self) {
            self.0.0.lock().unwrap().push(format!("{}:closed", self.1));
        }
    }

    fn message(number: u8) -> CdrParts {
        let mut maker = Maker::new();
        maker.write_primitive(number);
        maker.finish()
    }

    struct Bench {
        origins: Origins,
        notes: Notes,
        now: Instant,
    }

    impl Bench {
        fn new() -> Self {
            Self { origins: Origins::default(), notes: Notes::default(), now: Instant::now() }
        }

        fn enter(&mut self, origin: u64, waits: u64) {
            let opens = (waits > 0).then(|| self.now + Duration::from_millis(waits));
            self.origins.enter(origin, Box::new(Noting(self.notes.clone(), origin)), opens);
        }

        fn write(&mut self, origin: u64, number: u8) -> Option<usize> {
            let written = self.origins.write(origin, message(number), self.now);
            written.map(|written| written.unwrap())
        }

        fn look_after(&mut self, ms: u64) -> Option<Instant> {
            self.now += Duration::from_millis(ms);
            let (next, faults) = self.origins.look(self.now);
            assert_eq!(faults, []);
            next
        }

        fn notes(&self) -> Vec<String> {
            std::mem::take(&mut *self.notes.0.lock().unwrap())
        }
    }

    const LINGER: Duration = Duration::from_millis(100);

    #[test]
    fn each_origin_writes_through_its_own_writer() {
        let mut bench = Bench::new();
        bench.enter(1, 0);
        bench.enter(2, 0);
        assert_eq!(
            [bench.write(1, 7), bench.write(2, 8), bench.write(3, 9)],
            [Some(0), Some(0), None]
        );
        assert_eq!(bench.notes(), ["1:7", "2:8"]);
    }

    #[test]
    fn what_is_held_is_written_in_order_when_readers_know_the_writer() {
        let mut bench = Bench::new();
        bench.enter(1, 50);
        for number in 0..=u8::try_from(MAX_HELD).unwrap() {
            assert_eq!(bench.write(1, number), Some(usize::from(number) / MAX_HELD));
        }
        assert_eq!(bench.look_after(49), Some(bench.now + Duration::from_millis(1)));
        assert_eq!(bench.notes(), <[&str; 0]>::default());
        bench.look_after(1);
        let notes = bench.notes();
        assert_eq!((notes.len(), notes[0].as_str()), (MAX_HELD, "1:1"), "the oldest was lost");
        bench.write(1, 5);
        assert_eq!(bench.notes(), ["1:5"]);
    }

    #[test]
    fn a_writer_goes_with_its_origin_when_its_messages_have_arrived() {
        let mut bench = Bench::new();
        bench.enter(1, 0);
        bench.enter(2, 0);
        bench.enter(3, 20);
        bench.write(1, 1);
        bench.write(3, 3);
        bench.origins.forget(1, bench.now, LINGER);
        bench.origins.forget(2, bench.now, LINGER);
        bench.origins.forget(3, bench.now, LINGER);
        assert_eq!(bench.notes(), ["1:1", "2:closed"]);
        assert_eq!(bench.look_after(20), Some(bench.now + Duration::from_millis(80)));
        assert_eq!(bench.notes(), ["3:3"]);
        bench.origins.forget_all(bench.now, LINGER);
        bench.look_after(80);
        assert_eq!(bench.notes(), ["1:closed"]);
        assert_eq!(bench.look_after(20), None);
        assert_eq!(bench.notes(), ["3:closed"]);
    }
}
