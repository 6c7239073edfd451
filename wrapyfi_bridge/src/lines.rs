//! Lines that a thread of their own writes: a reader that stands still stops no other, and one that went ends
//! nothing.

use std::io::Write;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Condvar};
use std::time::Duration;

use wrapyfi_endpoint::Mutex;

/// A place to write lines to, without waiting.
#[derive(Debug)]
pub struct Lines {
    queue: SyncSender<Vec<u8>>,
    shared: Arc<LineTally>,
}

#[derive(Debug, Default)]
struct LineTally {
    counts: Mutex<Counts>,
    /// Tells that a line was written.
    written: Condvar,
}

#[derive(Debug, Default)]
struct Counts {
    /// Lines that wait, or are being written.
    waiting: u64,
    /// Lines for which there was no room, since the last one that was written.
    lost: u64,
}

impl Lines {
    /// Starts the thread, which is called `name`. `room` lines may wait for the reader; what is beyond is left out,
    /// and `gap` says so where the reader goes on.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(
        name: &str,
        mut out: impl Write + Send + 'static,
        room: usize,
        gap: fn(u64) -> String,
    ) -> std::io::Result<Self> {
        let (queue, lines) = sync_channel::<Vec<u8>>(room);
        let shared = Arc::<LineTally>::default();
        let told = Arc::clone(&shared);
        std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            for line in lines {
                // There is no reader left to report it to.
                _ = out.write_all(&line).and_then(|()| out.flush());
                let lost = {
                    let mut counts = told.counts.lock();
                    counts.waiting -= 1;
                    std::mem::take(&mut counts.lost)
                };
                told.written.notify_all();
                if lost > 0 {
                    _ = out.write_all(gap(lost).as_bytes());
                }
            }
        })?;
        Ok(Self { queue, shared })
    }

    /// Has a line written, with the break at its end.
    pub fn write(&self, line: Vec<u8>) {
        // Counted under the lock: its writer counts down once it is written.
        let mut counts = self.shared.counts.lock();
        match self.queue.try_send(line) {
            Ok(()) => counts.waiting += 1,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => counts.lost += 1,
        }
    }

    /// Waits until everything is written, at most `limit`.
    pub fn finish(&self, limit: Duration) {
        let waits = |counts: &mut Counts| counts.waiting > 0;
        drop(self.shared.written.wait_timeout_while(self.shared.counts.lock(), limit, waits));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};

    use super::*;

    /// A reader that takes one line each time that it is told to.
    struct Slow(Receiver<()>, Sender<String>);

    impl Write for Slow {
        fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
            self.0.recv().map_err(std::io::Error::other)?;
            self.1
                .send(String::from_utf8_lossy(line).into_owned())
                .map_err(std::io::Error::other)?;
            Ok(line.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_reader_that_stands_still_holds_nobody_up_and_is_told_what_it_missed() {
        let (go, told_to) = channel();
        let (out, read) = channel();
        let gap = |lost: u64| format!("{lost} left out\n");
        let lines = Lines::start("lines", Slow(told_to, out), 2, gap).unwrap();
        // One may be with the writer already, so that three or two find room.
        for number in 0..10 {
            lines.write(format!("{number}\n").into_bytes());
        }
        let mut got = Vec::new();
        while !got.last().is_some_and(|line: &String| line.ends_with("left out\n")) {
            go.send(()).unwrap();
            got.push(read.recv().unwrap());
        }
        let left_out: usize = got.last().unwrap().split(' ').next().unwrap().parse().unwrap();
        for _ in 0..10 - left_out - (got.len() - 1) {
            go.send(()).unwrap();
            got.push(read.recv().unwrap());
        }
        lines.finish(Duration::from_secs(60));
        assert_eq!(got.len() - 1 + left_out, 10, "{got:?}");
    }

    #[test]
    fn a_reader_that_went_ends_nothing() {
        let (_, told_to) = channel();
        let (out, _) = channel();
        let lines = Lines::start("lines", Slow(told_to, out), 2, |_| String::new()).unwrap();
        for _ in 0..10 {
            lines.write(b"x\n".to_vec());
            lines.finish(Duration::from_secs(60));
        }
    }
}
