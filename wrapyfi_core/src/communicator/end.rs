//! State and settings that endpoints of all roles have in common.

use std::sync::Arc;
use std::time::Duration;

use super::missing::Missing;
use super::notifier::Notifier;
use super::rules::Rules;
use wrapyfi_endpoint::{Counters, CountersSnapshot, EndpointAddress, Link};

/// An endpoint of a value without what its role adds: address, options, counters, and the bell that it waits for.
pub(super) struct EndCommon {
    pub(super) endpoint: EndpointAddress,
    pub(super) counters: Arc<Counters>,
    /// True where a call waits.
    pub(super) should_wait: bool,
    pub(super) timeout: Option<Duration>,
    pub(super) rules: Rules,
    pub(super) notifier: Notifier,
    pub(super) missing: Missing,
}

/// One end of a value, for status tables.
///
/// See [`ValueStatus`](super::ValueStatus).
///
/// ```
/// use wrapyfi_core::communicator::{EndStatus, ValueStatus};
/// fn heard(status: &ValueStatus) -> u64 {
///     status.ends.iter().map(|EndStatus { counters, .. }| counters.received).sum()
/// }
/// ```
#[derive(Debug, Clone)]
pub struct EndStatus {
    /// Address of the endpoint.
    pub endpoint: EndpointAddress,
    /// Connection of the endpoint.
    pub link: Link,
    /// Numbers of messages that went through the endpoint and that it dropped.
    pub counters: CountersSnapshot,
}

impl EndCommon {
    /// True where the middleware is one of several and has been missing for a while.
    pub(super) fn is_given_up(&self) -> bool {
        self.missing.is_given_up(&self.endpoint)
    }

    pub(super) fn status(&self, link: Link) -> EndStatus {
        EndStatus { endpoint: self.endpoint.clone(), link, counters: self.counters.snapshot() }
    }
}

#[cfg(test)]
impl EndCommon {
    /// An endpoint of a middleware that is never missing, with no rules.
    pub(super) fn of_test(address: &str, should_wait: bool) -> Self {
        Self {
            endpoint: address.parse().unwrap(),
            counters: Arc::default(),
            should_wait,
            timeout: None,
            rules: Rules::default(),
            notifier: Notifier::default(),
            missing: Missing::default(),
        }
    }
}
