//! DDS domains and ports that one test has to itself, also among test programs that run at the same time.

use std::fs::{File, TryLockError};
use std::net::TcpListener;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// A number reserved until this is dropped: the lock ends with the file, even if the process is killed.
#[derive(Debug)]
pub struct Reserved {
    /// The DDS domain id, or the port.
    pub number: u16,
    _lock: File,
}

/// A DDS domain id from 1 to 100. Port numbers of higher ones would reach the ephemeral range.
///
/// # Panics
/// When all are reserved, and when the file of a number cannot be locked.
pub fn reserve_domain() -> Reserved {
    first_free("domain", 1, 100, |_| true)
}

/// A free TCP port below the ephemeral range, where no socket that asks for any port can take it before the test binds it.
///
/// # Panics
/// As [`reserve_domain`].
pub fn reserve_port() -> Reserved {
    first_free("port", 20_000, 12_000, |port| TcpListener::bind(("127.0.0.1", port)).is_ok())
}

/// The end-to-end tests lock the same files (`test/src/reserve.rs`).
fn first_free(kind: &str, first: u16, count: u16, usable: impl Fn(u16) -> bool) -> Reserved {
    static TURN: AtomicU32 = AtomicU32::new(0);
    let folder = std::env::temp_dir().join("wrapyfi_test_reserved");
    std::fs::create_dir_all(&folder).unwrap();
    // Neighbouring processes start far apart.
    let start =
        std::process::id().wrapping_mul(2_654_435_761).wrapping_add(TURN.fetch_add(1, Relaxed));
    for step in 0..u32::from(count) {
        let offset = start.wrapping_add(step) % u32::from(count);
        let number = first + u16::try_from(offset).unwrap();
        let lock = File::create(folder.join(format!("{kind}_{number}"))).unwrap();
        match lock.try_lock() {
            Ok(()) if usable(number) => return Reserved { number, _lock: lock },
            Ok(()) | Err(TryLockError::WouldBlock) => {}
            Err(TryLockError::Error(error)) => panic!("cannot lock: {error}"),
        }
    }
    panic!("no free {kind} left")
}
