//! Messages of this process's publishers that a broker in the same process lost, reported to those
//! publishers.
//!
//! Topics alone tell whose a message is. Where another process publishes on the same topic through
//! this broker, its losses are counted here too.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use wrapyfi_endpoint::{Counters, DropReason, Mutex};

/// The counters of the publishers of one instance, by topic. Looked at only where something is lost.
#[derive(Debug, Default)]
pub(super) struct Ledger(Mutex<BTreeMap<Vec<u8>, Weak<Counters>>>);

impl Ledger {
    /// Enters a publisher.
    pub(super) fn enter(&self, topic: &[u8], counters: &Arc<Counters>) {
        let mut entries = self.0.lock();
        entries.retain(|_, counters| counters.strong_count() > 0);
        entries.insert(topic.to_vec(), Arc::downgrade(counters));
    }

    /// Counts a message, `bytes` long, that not everybody got who was to have it.
    pub(super) fn undelivered(&self, topic: &[u8], reason: DropReason, bytes: usize) {
        let entries = self.0.lock();
        if let Some(counters) = entries.get(topic).and_then(Weak::upgrade) {
            counters.undelivered(reason, bytes);
        }
    }
}
