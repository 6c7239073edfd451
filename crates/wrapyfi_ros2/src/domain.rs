//! The Cyclone domains of this process: the only process-wide state.
//!
//! ```text
//!   node ──┐
//!   node ──┼─ DomainLease ──▶ DOMAINS[id] { configuration, users, domain, relays of its peers }
//!   node ──┘                  last lease gone ──▶ domain deleted
//! ```
//!
//! Cyclone has one configuration per domain id and process, so a second node that asks for another
//! one is refused rather than silently given the first.

use std::collections::BTreeMap;
use std::sync::RwLock;

use super::config::CycloneConfig;
use super::cyclone::Entity;
use super::peer_names::{PeerError, relayed};
use super::peer_relay::Relay;
use wrapyfi_endpoint::Mutex;

/// Files that Cyclone has open for a domain.
const FILES: usize = 12;
/// Threads that it has, and the bytes of the stack of one.
const THREADS: usize = 8;
const STACK: usize = 8 << 20;

static DOMAINS: Mutex<BTreeMap<u32, DomainInUse>> = Mutex::new(BTreeMap::new());

struct DomainInUse {
    configuration: String,
    users: usize,
    _domain: Entity,
    /// After the domain, which announces its end through them.
    _relays: Vec<Relay>,
}

/// Error of joining a DDS domain.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DomainError {
    /// A node of this process is on the domain with another configuration.
    #[error(
        "domain {id} is already in use in this process with another configuration; all nodes of a process on one domain must share discovery settings and CYCLONEDDS_URI (in use: {in_use}; asked for: {asked})"
    )]
    Clash {
        /// Domain id.
        id: u32,
        /// Configuration in use.
        in_use: String,
        /// Configuration asked for.
        asked: String,
    },
    /// Other code of this process created the domain.
    #[error(
        "domain {id} was created by other code of this process; its configuration cannot be ours"
    )]
    Foreign {
        /// Domain id.
        id: u32,
    },
    /// The process has no room for what Cyclone takes, and Cyclone ends it then.
    #[error("there is no room for CycloneDDS, which takes {wanted}: {reason} ({remedy})")]
    NoRoom {
        /// Resources that Cyclone takes at least, in words.
        wanted: &'static str,
        /// Words of the system.
        reason: String,
        /// Limit to raise.
        remedy: &'static str,
    },
    /// A peer that Cyclone cannot be told.
    #[error(transparent)]
    Peer(#[from] PeerError),
    /// Cyclone refused; its log says why.
    #[error(
        "CycloneDDS could not open domain {id}: {reason}; its log lines say why, CYCLONEDDS_URI is the usual cause"
    )]
    Refused {
        /// Domain id.
        id: u32,
        /// Cyclone's words.
        reason: String,
    },
}

/// A share in a domain, given back on drop.
#[derive(Debug)]
pub(super) struct DomainLease(u32);

impl DomainLease {
    /// Opens the domain of `config`, or joins it where its configuration is the same.
    pub(super) fn acquire(config: &CycloneConfig) -> Result<Self, DomainError> {
        let (id, configuration) = (config.domain_id, config.sources());
        let mut domains = DOMAINS.lock();
        match domains.get_mut(&id) {
            Some(shared) if shared.configuration == configuration => shared.users += 1,
            Some(shared) => {
                return Err(DomainError::Clash {
                    id,
                    in_use: shared.configuration.clone(),
                    asked: configuration,
                });
            }
            None => {
                find_room()?;
                let (relayed, relays) = relayed(config)?;
                let domain = Entity::domain(id, &relayed.sources()).map_err(|code| {
                    if code.is_precondition() {
                        DomainError::Foreign { id }
                    } else {
                        DomainError::Refused { id, reason: code.to_string() }
                    }
                })?;
                log_receive_buffer();
                let shared =
                    DomainInUse { configuration, users: 1, _domain: domain, _relays: relays };
                domains.insert(id, shared);
            }
        }
        Ok(Self(id))
    }
}

impl Drop for DomainLease {
    fn drop(&mut self) {
        // The lock is held while Cyclone stops its threads, so that no thread opens the domain half
        // closed. Callbacks never take this lock.
        let mut domains = DOMAINS.lock();
        if let Some(shared) = domains.get_mut(&self.0) {
            shared.users -= 1;
            if shared.users == 0 {
                domains.remove(&self.0);
            }
        }
    }
}

/// Looks for what Cyclone takes and does not check, or cannot give back in order when it is refused.
fn find_room() -> Result<(), DomainError> {
    let no_room = |wanted, error: &std::io::Error, remedy| DomainError::NoRoom {
        wanted,
        reason: error.to_string(),
        remedy,
    };
    let files: Result<Vec<_>, _> = (0..FILES).map(|_| std::fs::File::open("/dev/null")).collect();
    let files = files.map_err(|error| no_room("12 files", &error, "ulimit -n"))?;
    // All threads at once: each begins with waiting.
    let gate = RwLock::new(());
    let threads = std::thread::scope(|scope| {
        let closed = gate.write();
        let start = |_| {
            let thread = std::thread::Builder::new().stack_size(STACK);
            thread.spawn_scoped(scope, || drop(gate.read()))
        };
        let started: Result<Vec<_>, _> = (0..THREADS).map(start).collect();
        drop(closed);
        started.map(drop)
    });
    drop(files);
    threads.map_err(|error| no_room("8 threads of 8 MiB", &error, "ulimit -u, ulimit -v"))
}

/// Says once what the kernel grants of the receive buffer we ask for: Cyclone does not tell.
fn log_receive_buffer() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let wanted = super::config::RECEIVE_BUFFER;
        let limit = std::fs::read_to_string("/proc/sys/net/core/rmem_max")
            .ok()
            .and_then(|text| text.trim().parse::<u64>().ok());
        match limit {
            Some(limit) if limit < wanted => tracing::info!(
                granted = limit,
                wanted,
                "the kernel caps socket receive buffers; for large messages raise it: sysctl -w net.core.rmem_max={wanted}"
            ),
            Some(_) => tracing::debug!(granted = wanted, "socket receive buffer"),
            None => {}
        }
    });
}
