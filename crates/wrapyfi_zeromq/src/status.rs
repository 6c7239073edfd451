//! Brokers at one moment: written by their threads, shown to who asks.

use std::collections::BTreeMap;

use serde::Serialize;

use super::traffic::TopicTraffic;

/// A broker at one moment.
///
/// See [`ZeroMq::broker_status`](super::ZeroMq::broker_status).
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct BrokerStatus {
    /// Messages passed on to listeners.
    pub messages: u64,
    /// Bytes passed on, all frames.
    pub bytes: u64,
    /// Messages dropped because they pretended to be the broker's counts.
    pub forged: u64,
    /// Frames from listeners dropped because they were no subscription, or one too many.
    pub ignored: u64,
    /// Messages that listeners missed, by reason: one that two listeners miss counts twice, one that the broker did not
    /// take (`oversize`, `over_budget`) once.
    pub missed: BTreeMap<&'static str, u64>,
    /// Subscriptions and messages refused because the CURVE keys of their clients may not have the topic.
    pub denied: u64,
    /// Connections that were refused or ended, by reason: `too_many`, `oversize`, `over_budget`; with CURVE
    /// `mechanism` (a client without it), `curve` (a wrong server key, a forged command), `unknown_key`.
    pub cut: BTreeMap<&'static str, u64>,
    /// Listeners by topic.
    pub subscriptions: BTreeMap<String, u64>,
    /// Traffic of each topic; as old as `subscriptions`.
    pub topics: BTreeMap<String, TopicTraffic>,
    /// Messages of topics that are not listed: beyond 4096 of them, or named by no text.
    pub unlisted: u64,
    /// Reason why the broker does not work now; it goes on trying.
    pub failure: Option<String>,
}

/// A broker of requests and replies at one moment.
///
/// See [`ZeroMq::service_broker_status`](super::ZeroMq::service_broker_status).
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ServiceBrokerStatus {
    /// Requests passed on to servers.
    pub requests: u64,
    /// Replies passed on to clients.
    pub replies: u64,
    /// Bytes passed on both ways, all frames.
    pub bytes: u64,
    /// Requests that wait for a server now.
    pub waiting: u64,
    /// Requests answered with an error because too many waited.
    pub overloaded: u64,
    /// Requests dropped because their callers had given up.
    pub expired: u64,
    /// Messages dropped because they were no request or no reply.
    pub malformed: u64,
    /// Replies dropped because their clients were gone, or did not read.
    pub unheard: u64,
    /// Connections that were refused or ended, by reason: `too_many`, `oversize`, `over_budget`; with CURVE
    /// `mechanism`, `curve`, `unknown_key`, `not_allowed` (to call or to serve).
    pub cut: BTreeMap<&'static str, u64>,
    /// Reason why the broker does not work now; it goes on trying.
    pub failure: Option<String>,
}
