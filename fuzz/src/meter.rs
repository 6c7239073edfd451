//! Memory that a piece of work takes: an allocator that counts what each thread holds.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

#[global_allocator]
static METER: Meter = Meter;

struct Meter;

thread_local! {
    /// Bytes that this thread allocated and did not free; negative where it frees for others.
    static HELD: Cell<isize> = const { Cell::new(0) };
    /// Most that was held since it was last reset.
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn change(by: isize) {
    HELD.set(HELD.get().wrapping_add(by));
    PEAK.set(PEAK.get().max(HELD.get()));
}

fn signed(size: usize) -> isize {
    isize::try_from(size).unwrap_or(isize::MAX)
}

// SAFETY: every call goes to the system's allocator unchanged; counting neither allocates nor
// unwinds, because the counters are constants without destructors.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Meter {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        change(signed(layout.size()));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        change(signed(layout.size()));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        change(-signed(layout.size()));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // The old block and the new one may exist side by side.
        change(signed(size));
        change(-signed(layout.size()));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(place, layout, size) }
    }
}

/// Does `work`; its result, and the most bytes it held at once.
pub fn measure<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let (before, outer) = (HELD.get(), PEAK.get());
    PEAK.set(before);
    let result = work();
    let peak = PEAK.get();
    // Measurements may stand inside each other.
    PEAK.set(peak.max(outer));
    (result, usize::try_from(peak - before).unwrap_or(0))
}

/// Does `work`, which may hold `factor` times `input` bytes at once, and 64 KiB for what every
/// message costs.
///
/// # Panics
/// When it holds more.
#[track_caller]
pub fn bounded<T>(input: usize, factor: usize, work: impl FnOnce() -> T) -> T {
    const FLOOR: usize = 64 << 10;
    let (result, peak) = measure(work);
    let allowed = input * factor + FLOOR;
    assert!(peak <= allowed, "{input} bytes of input took {peak} bytes, allowed are {allowed}");
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_what_was_held_at_once() {
        let (_, peak) = measure(|| {
            drop(vec![0_u8; 1000]);
            drop(vec![0_u8; 3000]);
            vec![0_u8; 500]
        });
        assert_eq!(peak, 3000);
        let (_, peak) = measure(|| (vec![0_u8; 1000], vec![0_u8; 3000]));
        assert_eq!(peak, 4000);
        let (_, peak) = measure(|| {
            drop(vec![0_u8; 5000]);
            measure(|| drop(vec![0_u8; 1000]))
        });
        assert_eq!(peak, 5000);
    }

    #[test]
    #[should_panic(expected = "10 bytes of input took 100000 bytes")]
    fn too_much_is_said() {
        bounded(10, 2, || vec![0_u8; 100_000]);
    }
}
