//! Pauses between the fragments of one sample.
//!
//! ```text
//!   spaced(pause, || dds_writecdr(…)) ─▶ fragment ─ pause ─▶ fragment ─ pause ─▶ …
//! ```
//!
//! Cyclone asks the sample for each fragment right before it sends it, on the thread that writes, and sends the one
//! before it first: a pause in that call is a pause between two datagrams. The writer is locked meanwhile, between two
//! pauses it is not. Fragments that a reader asks for again are made by other threads, which make no pause.

use std::cell::Cell;
use std::time::Duration;

thread_local! {
    static PAUSE: Cell<Option<Duration>> = const { Cell::new(None) };
}

/// Runs `write`, in which the fragments of a sample go out with `pause` between two.
pub(super) fn spaced<T>(pause: Option<Duration>, write: impl FnOnce() -> T) -> T {
    PAUSE.set(pause);
    let written = write();
    PAUSE.set(None);
    written
}

/// Makes the pause before the fragment at `offset`; none before the first one, nor where this thread writes nothing
/// with pauses. True when a pause was made.
pub(super) fn before_fragment(offset: usize) -> bool {
    // While a thread ends its variables are gone: then it writes nothing.
    let pause = PAUSE.try_with(Cell::get).ok().flatten().filter(|_| offset > 0);
    pause.inspect(|&pause| std::thread::sleep(pause)).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_fragments_behind_the_first_of_a_spaced_write_come_after_a_pause() {
        assert!(!before_fragment(64_000), "nothing is written");
        spaced(Some(Duration::from_micros(1)), || {
            assert!(!before_fragment(0));
            assert!(before_fragment(64_000));
            assert!(!std::thread::spawn(|| before_fragment(64_000)).join().unwrap(), "sent again");
        });
        assert!(!before_fragment(64_000), "the write is over");
    }
}
