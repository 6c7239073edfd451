//! Chunks packed by bz2 are unpacked before reading comes to them, by as many threads as there are processors: unpacking takes
//! ten times as long as all the rest. LZ4 is left to the reader: handing its chunks over took as long as it saved.
//!
//! ```text
//!   chunk that is read ┆ chunk ┆ chunk ┆ …
//!                        └───────┴─ packed bytes ─▶ threads ─▶ records, kept by their place in the file
//! ```
//!
//! Chunks ahead are a guess: reading asks by place and sizes, and unpacks itself what was not found. So does it with a chunk
//! that does not unpack to just what it claims: it reads what is whole, and finds where it breaks.

use std::collections::VecDeque;
use std::io::{Cursor, ErrorKind, Read as _};
use std::num::NonZero;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use super::chunk::{Compression, Unpacked};

/// Most threads.
const MAX_THREADS: usize = 16;
/// Largest chunk that is unpacked as a whole, in bytes.
const MAX_CHUNK: u64 = 16 << 20;
/// Most bytes of chunks under way, packed and unpacked.
const MAX_BYTES: u64 = 64 << 20;

/// A chunk packed by bz2, as its header tells it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Packed {
    /// Offset of its data in the file.
    pub(super) begin: u64,
    /// Size in the file, in bytes.
    pub(super) size: u64,
    /// Size of its records, as it claims.
    pub(super) claimed: u64,
}

impl Packed {
    /// Offset behind its data.
    fn end(&self) -> u64 {
        self.begin.saturating_add(self.size)
    }

    fn bytes(&self) -> u64 {
        self.size.saturating_add(self.claimed)
    }
}

/// Work of a thread.
#[derive(Debug)]
struct Job {
    claimed: usize,
    packed: Vec<u8>,
    /// Memory for the records.
    records: Vec<u8>,
    done: Sender<Done>,
}

/// Outcome of a chunk: its records, where they are as many bytes as it claims.
#[derive(Debug)]
struct Done {
    is_exact: bool,
    packed: Vec<u8>,
    records: Vec<u8>,
}

#[derive(Debug)]
struct UnderWay {
    chunk: Packed,
    done: Receiver<Done>,
}

/// Chunks ahead of reading, in the order of the file.
#[derive(Debug)]
pub(super) struct Ahead {
    most_threads: usize,
    threads: usize,
    jobs: Sender<Job>,
    /// The other end of `jobs`: each thread takes from it.
    taken: Arc<Mutex<Receiver<Job>>>,
    under_way: VecDeque<UnderWay>,
    /// Offset at which something other than such a chunk stands: nothing is looked for behind it until reading has passed it.
    stopped_at: u64,
    /// Memory to be used again.
    spare: Vec<Vec<u8>>,
}

impl Ahead {
    pub(super) fn new() -> Self {
        let (jobs, taken) = channel();
        Self {
            most_threads: thread::available_parallelism().map_or(1, NonZero::get).min(MAX_THREADS),
            threads: 0,
            jobs,
            taken: Arc::new(Mutex::new(taken)),
            under_way: VecDeque::new(),
            stopped_at: 0,
            spare: Vec::new(),
        }
    }

    /// Memory of an earlier chunk, else none.
    pub(super) fn memory(&mut self) -> Vec<u8> {
        self.spare.pop().unwrap_or_default()
    }

    /// Keeps memory for the next chunk. That of a very large one goes back to the system.
    pub(super) fn keep(&mut self, memory: Vec<u8>) {
        if self.spare.len() < 2 * self.most() && memory.capacity() as u64 <= 2 * MAX_CHUNK {
            self.spare.push(memory);
        }
    }

    /// Offset from which more chunks are wanted by a reader that goes on at `at`; none where there are enough.
    pub(super) fn wants_from(&self, at: u64) -> Option<u64> {
        let is_low = 2 * self.under_way.len() <= self.most() && 2 * self.bytes() <= MAX_BYTES;
        let from = self.under_way.back().map_or(at, |last| last.chunk.end().max(at));
        (is_low && from >= self.stopped_at && self.most_threads > 1).then_some(from)
    }

    /// True where this chunk may be [given](Self::give), too.
    pub(super) fn takes(&self, chunk: &Packed) -> bool {
        let is_small = chunk.size.max(chunk.claimed) <= MAX_CHUNK && chunk.size > 0;
        let has_room = self.bytes().saturating_add(chunk.bytes()) <= MAX_BYTES;
        is_small && has_room && self.under_way.len() < self.most()
    }

    /// Looks for nothing more until reading has passed `at`.
    pub(super) fn stop_at(&mut self, at: u64) {
        self.stopped_at = at.saturating_add(1);
    }

    /// Has a chunk unpacked; false where no thread can be started.
    pub(super) fn give(&mut self, chunk: Packed, packed: Vec<u8>) -> bool {
        if self.threads < self.most_threads {
            let taken = Arc::clone(&self.taken);
            let thread = thread::Builder::new().name("bag-unpack".to_owned());
            match thread.spawn(move || work(&taken)) {
                Ok(_) => self.threads += 1,
                Err(_) if self.threads == 0 => return false,
                Err(_) => {}
            }
        }
        let (give_done, done) = channel();
        let claimed = usize::try_from(chunk.claimed).unwrap_or(usize::MAX);
        let job = Job { claimed, packed, records: self.memory(), done: give_done };
        self.under_way.push_back(UnderWay { chunk, done });
        self.jobs.send(job).is_ok()
    }

    /// The chunk, where it was given before: its records, or its decoder where it is not what it claims.
    pub(super) fn take(&mut self, chunk: &Packed) -> Option<Unpacked> {
        while self.under_way.front().is_some_and(|first| first.chunk.begin <= chunk.begin) {
            let UnderWay { chunk: first, done } = self.under_way.pop_front()?;
            if first != *chunk {
                continue;
            }
            // A thread that has ended in a panic gives nothing.
            let Done { is_exact, packed, records } = done.recv().ok()?;
            let (unpacked, memory) = match is_exact {
                true => (Unpacked::Records(Cursor::new(records)), packed),
                false => (Unpacked::new(Compression::Bz2, packed), records),
            };
            self.keep(memory);
            return Some(unpacked);
        }
        None
    }

    /// Most chunks under way: one for each thread, and one that waits for it.
    fn most(&self) -> usize {
        2 * self.most_threads
    }

    fn bytes(&self) -> u64 {
        self.under_way.iter().map(|it| it.chunk.bytes()).fold(0, u64::saturating_add)
    }
}

/// Unpacks chunks until no more can come.
fn work(taken: &Mutex<Receiver<Job>>) {
    loop {
        let job = taken.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(Job { claimed, packed, records, done }) = job else { return };
        // The reader may have gone on without it.
        _ = done.send(unpack(claimed, packed, records));
    }
}

fn unpack(claimed: usize, packed: Vec<u8>, mut records: Vec<u8>) -> Done {
    // One more byte shows whether the chunk goes on behind what it claims.
    records.resize(claimed.saturating_add(1), 0);
    let mut decoder = Unpacked::new(Compression::Bz2, packed);
    let mut filled = 0;
    let is_exact = loop {
        match decoder.read(records.get_mut(filled..).unwrap_or_default()) {
            Ok(0) => break filled == claimed,
            Ok(count) => filled += count,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => break false,
        }
    };
    records.truncate(claimed);
    Done { is_exact, packed: decoder.into_memory(), records }
}
