//! Numbers that one test has to itself, also among test programs that run at the same time.

use std::fs::{File, TryLockError};
use std::net::TcpListener;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use anyhow::{Context as _, bail};

use crate::Result;

/// A number reserved until this is dropped: the lock ends with the file, even if the process is killed.
#[derive(Debug)]
pub(crate) struct Reserved {
    pub(crate) number: u16,
    _lock: File,
}

/// A DDS domain id from 1 to 100. Port numbers of higher ones would reach the ephemeral range.
pub(crate) fn domain() -> Result<Reserved> {
    first_free("domain", 1, 100, |_| true)
}

/// A free TCP port below the ephemeral range.
pub(crate) fn port() -> Result<Reserved> {
    first_free("port", 20_000, 12_000, |port| TcpListener::bind(("127.0.0.1", port)).is_ok())
}

/// The tests of the crates lock the same files (`crates/wrapyfi_conformance/src/reserve.rs`).
fn first_free(
    kind: &str,
    first: u16,
    count: u16,
    usable: impl Fn(u16) -> bool,
) -> Result<Reserved> {
    static TURN: AtomicU32 = AtomicU32::new(0);
    let folder = std::env::temp_dir().join("wrapyfi_test_reserved");
    std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
    // Neighbouring runs start far apart, so that they rarely meet.
    let start =
        std::process::id().wrapping_mul(2_654_435_761).wrapping_add(TURN.fetch_add(1, Relaxed));
    for step in 0..u32::from(count) {
        let offset = start.wrapping_add(step) % u32::from(count);
        let number = first + u16::try_from(offset)?;
        let lock = File::create(folder.join(format!("{kind}_{number}")))?;
        match lock.try_lock() {
            Ok(()) if usable(number) => return Ok(Reserved { number, _lock: lock }),
            Ok(()) | Err(TryLockError::WouldBlock) => {}
            Err(TryLockError::Error(error)) => return Err(error.into()),
        }
    }
    bail!("no free {kind} left")
}
