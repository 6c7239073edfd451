//! Circles over the routes of several bridges, found from what bridges tell each other before messages go round.
//!
//! ```text
//!   routes that run ─▶ /_wrapyfi_routes, hidden and latched ─▶ other bridges
//!   theirs ─▶ BridgeRoutes::closing ─▶ routes that stay closed, with the reason
//! ```
//!
//! A bridge that has no route on ROS 2 has no node there: a circle over it is not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use wrapyfi_data::Limits;
use wrapyfi_data::types::{MessageType, Payload, RosType};
use wrapyfi_endpoint::{EndpointAddress, Listener, Qos, QueueSpec, Registry, Throttle, TopicSpec};
use wrapyfi_engine::{BridgeRoutes, CarriedTopic, CarryingRoute, NetworkAddress};
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::std_msgs::msg::String as Text;

use super::{Advertise, Topic};
use crate::in_force::Running;
use crate::node::GRAPH;

/// Topic on which bridges tell what they carry, as JSON.
pub(crate) const TOPIC: &str = "/_wrapyfi_routes";
/// Largest message of a bridge, some ten thousand routes.
const MAX_BYTES: usize = 4 << 20;
/// Most bridges that are listened to.
const MAX_BRIDGES: usize = 256;

/// Network of each middleware by its name, where it has one.
type Networks = BTreeMap<String, Option<String>>;

/// The bridge among others.
pub(super) struct Circles {
    topic: Option<Topic>,
    listener: Option<Box<dyn Listener>>,
    /// Routes at the last look, and the network of each of their middlewares: where they are the same, nothing is to be done.
    seen: (Vec<CarryingRoute>, Networks),
    /// Routes as they were told last.
    own: BridgeRoutes,
    /// Other bridges by the number of their publisher.
    others: BTreeMap<u64, BridgeRoutes>,
    complaints: Throttle,
}

impl Circles {
    /// Begins to tell and to listen. What the middleware refuses is missing, which is logged.
    pub(super) fn new(own: &Advertise<'_>, latched: Qos) -> Self {
        let opened = || -> anyhow::Result<_> {
            let ros_type = RosType::of::<Text>()?;
            let spec = TopicSpec {
                qos: Qos {
                    history: wrapyfi_endpoint::History::KeepLast(MAX_BRIDGES as u32),
                    ..latched
                },
                queue: QueueSpec { depth: MAX_BRIDGES, ..QueueSpec::default() },
                limits: Limits { message_bytes: MAX_BYTES, ..Limits::default() },
                ..TopicSpec::new(TOPIC, MessageType::Ros(ros_type))
            };
            Ok(own.registry.get(GRAPH)?.open_listener(&spec, own.context)?)
        };
        let listener = opened();
        let listener = listener.inspect_err(|why| tracing::warn!("{TOPIC} is not heard: {why}"));
        let (bridge, node) = (own.number, own.node.name().fqn());
        Self {
            topic: own.open::<Text>(TOPIC, latched),
            listener: listener.ok(),
            seen: Default::default(),
            own: BridgeRoutes { bridge, node, topics: Vec::new() },
            others: BTreeMap::new(),
            complaints: Throttle::default(),
        }
    }

    /// Tells what has changed here, and closes the routes that close a circle with what others have told.
    pub(super) fn look(&mut self, bridge: &Running) {
        let are_new = self.listen();
        let registry = bridge.routes.registry();
        let mut carrying = bridge.routes.carrying();
        carrying.sort_by(|one, other| one.key.cmp(&other.key));
        let ends = carrying.iter().flat_map(|route| [&route.key.from, &route.key.to]);
        let names: BTreeSet<&str> = ends.map(|end| end.middleware.as_str()).collect();
        let networks: Networks =
            names.into_iter().map(|name| (name.to_owned(), network(&registry, name))).collect();
        let seen = (carrying, networks);
        if !are_new && seen == self.seen {
            return;
        }
        let (carrying, networks) = seen.clone();
        self.seen = seen;
        let carried = carrying.into_iter().filter_map(|route| {
            let end = |address: &EndpointAddress| {
                let network = networks.get(&address.middleware)?.clone()?;
                Some(NetworkAddress { address: bridge.node.resolve(address).to_string(), network })
            };
            let (from, to) = (end(&route.key.from)?, end(&route.key.to)?);
            Some((CarriedTopic { from, to, by_pattern: route.by_pattern }, route))
        });
        let (topics, routes): (Vec<_>, Vec<_>) = carried.unzip();
        if topics != self.own.topics {
            self.own.topics = topics;
            self.tell();
        } else if !are_new {
            return;
        }
        let others: Vec<_> = self.others.values().collect();
        let closing = self.own.closing(&others);
        let closing =
            closing.into_iter().filter_map(|(place, reason)| Some((routes.get(place)?, reason)));
        let guarded = closing.filter(|(route, _)| route.guarded);
        bridge
            .routes
            .keep_closed(&guarded.map(|(route, reason)| (route.key.clone(), reason)).collect());
    }

    /// Reads what others have told; true where it is new.
    fn listen(&mut self) -> bool {
        let Some(listener) = &mut self.listener else { return false };
        let mut are_new = false;
        for _ in 0..MAX_BRIDGES {
            let sample = match listener.take() {
                Ok(None) => break,
                Ok(Some(sample)) => sample,
                Err(error) => {
                    complain(&mut self.complaints, &error.to_string());
                    continue;
                }
            };
            let Some(origin) = sample.origin else { continue };
            let Payload::RosMessage(message) = sample.payload else { continue };
            let told = Text::decode(&message.cdr, MAX_BYTES).map_err(|error| error.to_string());
            let told = told.and_then(|text| {
                serde_json::from_str::<BridgeRoutes>(&text.data).map_err(|error| error.to_string())
            });
            match told {
                Ok(told)
                    if self.others.len() < MAX_BRIDGES
                        || self.others.contains_key(&origin.publisher) =>
                {
                    self.others.insert(origin.publisher, told);
                    are_new = true;
                }
                Ok(told) => {
                    let text =
                        format!("{} is left out: {MAX_BRIDGES} bridges are known", told.node);
                    complain(&mut self.complaints, &text);
                }
                Err(error) => complain(&mut self.complaints, &error),
            }
        }
        // It looks who has gone.
        listener.review(Instant::now());
        if let Some(listener) = listener.forwarding() {
            while let Some(gone) = listener.ended_publisher() {
                are_new |= self.others.remove(&gone).is_some();
            }
        }
        are_new
    }

    fn tell(&mut self) {
        let Some(topic) = &mut self.topic else { return };
        let mut text = serde_json::to_string(&self.own).unwrap_or_default();
        if text.len() >= MAX_BYTES {
            tracing::warn!(
                "{TOPIC} leaves out the routes that patterns made: {} bytes",
                text.len()
            );
            let written = self.own.topics.iter().filter(|it| !it.by_pattern).cloned().collect();
            let own = BridgeRoutes { topics: written, ..self.own.clone() };
            text = serde_json::to_string(&own).unwrap_or_default();
        }
        topic.publish(&Text { data: text });
    }
}

fn network(registry: &Registry, middleware: &str) -> Option<String> {
    registry.get(middleware).ok()?.network()
}

fn complain(complaints: &mut Throttle, error: &str) {
    if let Some(unlogged_before) = complaints.pass(Instant::now()) {
        tracing::warn!(
            unlogged_before,
            "what another bridge says on {TOPIC} is not understood: {error}"
        );
    }
}
