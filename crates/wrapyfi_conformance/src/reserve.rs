//! DDS domains that one test has to itself, also among test programs that run at the same time.

use std::fs::{File, TryLockError};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// First and number of the ids given out here: above those of the end-to-end tests, below those
/// written into the tests of `wrapyfi_core`.
const FIRST: u32 = 101;
const COUNT: u32 = 38;

/// A DDS domain id, reserved until this is dropped, even if the process is killed.
#[derive(Debug)]
pub struct Domain {
    /// The id.
    pub id: u32,
    _lock: File,
}

/// Reserves a domain id. Waits while all are taken.
pub fn reserve_domain() -> Domain {
    static TURN: AtomicU32 = AtomicU32::new(0);
    let folder = std::env::temp_dir().join("wrapyfi_conformance_reserved");
    std::fs::create_dir_all(&folder).unwrap();
    // Neighbouring processes start far apart.
    let start =
        std::process::id().wrapping_mul(2_654_435_761).wrapping_add(TURN.fetch_add(1, Relaxed));
    let place = |step: u32| {
        let id = FIRST + start.wrapping_add(step) % COUNT;
        (id, File::create(folder.join(id.to_string())).unwrap())
    };
    for step in 0..COUNT {
        let (id, lock) = place(step);
        match lock.try_lock() {
            Ok(()) => return Domain { id, _lock: lock },
            Err(TryLockError::WouldBlock) => {}
            Err(TryLockError::Error(error)) => panic!("cannot lock: {error}"),
        }
    }
    let (id, lock) = place(0);
    lock.lock().unwrap();
    Domain { id, _lock: lock }
}
