//! Subscribers whose connections were lost, not closed: they are told again who publishes the topic.
//!
//! ```text
//!   connection lost ─▶ master: who subscribes, who publishes ─▶ publisherUpdate of the subscriber's slave API
//!                                                                │ under an address of ours that it has not heard
//!                                                                ▼
//!                                                             it connects again
//! ```
//!
//! After a cut of the network a rospy subscriber may hold the lost connection open for a minute, and when it notices, it
//! does not connect again to a publisher whose address it knows. It does to an address with another path, which means
//! the same server.

use std::sync::Weak;
use std::time::Duration;

use tokio::time::timeout;

use super::core::Core;
use super::http;
use super::master::MasterResult;
use super::publication::Publication;
use super::xmlrpc::{Value, text};
use wrapyfi_endpoint::backoff::Backoff;

/// Longest time that a subscriber may take to answer: one on a network that comes back is asked again soon.
const ANSWER: Duration = Duration::from_secs(1);
/// Time that a subscriber which was told has to connect.
const CONNECTS: Duration = Duration::from_secs(2);

/// Tells a subscriber of a topic again who publishes it, until it has connected, subscribes no more, or no program
/// publishes here.
pub(super) async fn recall(core: &Core, publication: &Weak<Publication>, subscriber: &str) {
    // With the number of the connection no update of the master has the same address.
    let own = format!("{}{}", core.api, core.next_id());
    let mut backoff = Backoff::of_name(subscriber);
    loop {
        backoff.pause().await;
        let topic = match publication.upgrade() {
            Some(publication) if publication.awaits(subscriber) => publication.topic.clone(),
            _ => return,
        };
        match timeout(ANSWER, tell(core, &topic, subscriber, &own)).await {
            Ok(Ok(true)) => tokio::time::sleep(CONNECTS).await,
            Ok(Ok(false)) => return,
            Ok(Err(error)) => tracing::debug!("ROS 1: {subscriber} was not told: {error}"),
            // Its machine is away still.
            Err(_elapsed) => {}
        }
    }
}

/// Tells a subscriber who publishes a topic; false where the master knows of no such subscriber.
async fn tell(core: &Core, topic: &str, subscriber: &str, own: &str) -> MasterResult<bool> {
    let known = core.master.system_state().await?;
    let of = |all: &[(String, Vec<String>)]| {
        let found = all.iter().find(|(name, _)| name == topic);
        found.map(|(_, nodes)| nodes.clone()).unwrap_or_default()
    };
    if !of(&known.subscribers).iter().any(|node| node == subscriber) {
        return Ok(false);
    }
    let Some(place) = core.master.lookup_node(subscriber).await? else { return Ok(false) };
    let mut publishers = vec![text(own)];
    for node in of(&known.publishers).iter().filter(|node| *node != core.name.full()) {
        publishers.push(core.master.ask("lookupNode", [text(node)]).await?);
    }
    let params = vec![text(core.name.full()), text(topic), Value::Array(publishers)];
    http::call(&place, "publisherUpdate", params).await?;
    tracing::info!(topic, "ROS 1: {subscriber} lost its connection, and was told to connect again");
    Ok(true)
}
