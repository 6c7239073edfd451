//! Large messages to readers for which the kernel holds little.
//!
//! ```text
//!   message ─▶ fits, or nobody runs Fast DDS ─▶ writer ────────▶ all fragments at once
//!          └─▶ a Fast DDS node is subscribed ─▶ second writer ─▶ two fragments, then what is asked for
//! ```
//!
//! A Fast DDS node leaves its receive buffer as the kernel makes it: `net.core.rmem_default`, 212 992
//! bytes, which is three datagrams of ours. An image of 0.9 MB is fifteen, sent within half a
//! millisecond. Twelve of them were lost, and so was most of what was repeated, because the next image
//! came in between; the reader gave up a message when as many newer ones as its history is deep had begun.
//!
//! CycloneDDS limits bursts by the buffer of the readers, but of readers of another make it assumes
//! that they have what it has itself, and the setting is that of a whole domain. So messages that do
//! not fit are written by a second participant, on a domain of the process that has the same number on the
//! network and small bursts. It exists from the first such message on, and for images and point clouds
//! from when a Fast DDS node subscribes. What only CycloneDDS nodes are subscribed to is never sent that
//! way.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use super::config::CycloneConfig;
use super::cyclone::{EndpointQos, Entity, Events, RawWriter};
use super::cyclone_endpoints::Listed;
use super::cyclone_graph::{CycloneGraph, MAX_BLOCKING, Node};
use super::dds_terms::user_data;
use super::discovery_info::{EndpointKind, Gid};
use super::domain::DomainLease;
use super::graph::{Graph as _, NodeWatch, Replay, ServiceMapping, TopicDescription};
use super::vendor;
use crate::endpoint::{Durability, Reliability};

/// What Linux gives a socket that asks for nothing.
const RMEM_DEFAULT: usize = 212_992;

/// Added to the number of a domain for the one with small bursts: numbers on the network are below.
const SECOND_DOMAIN: u32 = 1 << 16;

/// Types, by their DDS names, whose messages are large as a rule.
const LARGE: [&str; 2] = ["sensor_msgs::msg::dds_::Image_", "sensor_msgs::msg::dds_::PointCloud2_"];

/// How long a second writer is given to be known to all subscribers.
const HANDOVER: Duration = Duration::from_secs(1);

/// How long the name of the subscriber's node is waited for: Fast DDS repeats what it announced every
/// three seconds.
const NAME_PATIENCE: Duration = Duration::from_secs(5);

/// The second participant of a node, once it is needed.
pub(super) struct SmallBursts {
    domain_id: u32,
    sources: String,
    way: OnceLock<Option<Way>>,
    gid: Arc<OnceLock<Gid>>,
}

/// Fields drop in this order.
struct Way {
    participant: Entity,
    _domain: DomainLease,
}

impl SmallBursts {
    /// Nothing is created yet.
    pub(super) fn new(config: &CycloneConfig) -> Self {
        Self {
            domain_id: SECOND_DOMAIN.saturating_add(config.domain_id),
            sources: config.sources_for_small_bursts(),
            way: OnceLock::new(),
            gid: Arc::default(),
        }
    }

    /// GUID of the second participant, from when there is one.
    pub(super) fn gid(&self) -> &Arc<OnceLock<Gid>> {
        &self.gid
    }

    /// Whether an endpoint is on the second participant.
    pub(super) fn owns(&self, guid: &[u8; 16]) -> bool {
        self.gid.get().is_some_and(|own| own.first_chunk::<12>() == guid.first_chunk::<12>())
    }

    /// True where there is a second participant.
    pub(super) fn is_open(&self) -> bool {
        self.gid.get().is_some()
    }

    fn participant(&self) -> Option<&Entity> {
        let open = || -> Result<Way, String> {
            let domain = DomainLease::acquire(self.domain_id, &self.sources);
            let domain = domain.map_err(|error| error.to_string())?;
            let participant = Entity::participant(self.domain_id, "enclave=/;");
            let participant = participant.map_err(|code| code.to_string())?;
            let gid = participant.guid().map_err(|code| code.to_string())?;
            // Known before it has an endpoint that could be taken for a stranger's.
            _ = self.gid.set(gid);
            Ok(Way { participant, _domain: domain })
        };
        let way = self.way.get_or_init(|| {
            let opened = open();
            if let Err(reason) = &opened {
                tracing::warn!(
                    reason,
                    "no second participant: large messages reach Fast DDS nodes with gaps; raise \
                     net.core.rmem_default before they start"
                );
            }
            opened.ok()
        });
        way.as_ref().map(|way| &way.participant)
    }
}

/// Decides which way the messages of one writer take.
pub(super) struct Ways {
    node: Arc<Node>,
    /// With the names of DDS.
    topic: TopicDescription,
    /// Bytes that any reader's socket holds; none where a second writer would change what the
    /// topic promises.
    room: Option<usize>,
    second: Option<Second>,
    /// How many changes of matches were seen, and the reader on Fast DDS that there was then.
    seen: Option<(u64, Option<Gid>)>,
}

struct Second {
    raw: RawWriter,
    since: Instant,
    is_used: bool,
    /// Until the user was told.
    untold: Option<Untold>,
    _listed: Listed,
}

/// What it takes to name the subscriber.
struct Untold(Option<Box<dyn NodeWatch>>);

impl Untold {
    fn name(&mut self, reader: &Gid) -> Option<&str> {
        let nodes = self.0.as_mut()?;
        nodes.update();
        nodes.owner(reader)
    }
}

impl Ways {
    pub(super) fn new(node: &Arc<Node>, topic: &TopicDescription) -> Self {
        let qos = &topic.qos;
        // Who keeps messages for late readers, or promises times, does so with one writer. What is lost
        // of best effort is not asked for again.
        let applies = qos.reliability == Reliability::Reliable
            && qos.durability == Durability::Volatile
            && qos.deadline.is_none()
            && qos.lease.is_none();
        let room = applies.then(room);
        Self { node: Arc::clone(node), topic: topic.clone(), room, second: None, seen: None }
    }

    /// Opens the second writer before there is a message for it, so that the first one is not late for
    /// those who have just subscribed.
    pub(super) fn prepare(&mut self, first: &RawWriter) {
        let large = self.room.is_some() && LARGE.contains(&self.topic.type_name.as_str());
        if large && self.second.is_none() && self.small_reader(first).is_some() {
            self.open_second();
        }
    }

    fn open_second(&mut self) {
        self.second = self.open();
        if self.second.is_none() {
            self.room = None;
        }
    }

    /// The second writer, where a message of `bytes` shall go through it and not through `first`.
    pub(super) fn second(&mut self, first: &RawWriter, bytes: usize) -> Option<&RawWriter> {
        let room = self.room?;
        // Once it is in use, small ones go with the large ones: their order stays.
        let is_used = self.second.as_ref().is_some_and(|second| second.is_used);
        if bytes <= room && !is_used {
            return None;
        }
        match (self.small_reader(first), &mut self.second) {
            (None, None) => None,
            (None, Some(second)) => {
                // What it sent last goes first.
                if second.is_used && !second.raw.all_acknowledged() {
                    return self.second.as_ref().map(|second| &second.raw);
                }
                self.second = None;
                None
            }
            (Some(_), None) => {
                self.open_second();
                None
            }
            (Some(reader), Some(second)) => {
                if !second.is_used {
                    let all = second.raw.events().matched() >= first.events().matched();
                    if !all || second.since.elapsed() < HANDOVER {
                        return None;
                    }
                    second.is_used = true;
                }
                if let Some(untold) = &mut second.untold {
                    let name = untold.name(&reader);
                    if name.is_some() || second.since.elapsed() > NAME_PATIENCE {
                        tell(&self.topic, name, bytes, room);
                        second.untold = None;
                    }
                }
                self.second.as_ref().map(|second| &second.raw)
            }
        }
    }

    /// A reader on Fast DDS that `first` is matched with.
    fn small_reader(&mut self, first: &RawWriter) -> Option<Gid> {
        let changes = first.events().changes();
        if let Some((seen, found)) = self.seen
            && seen == changes
        {
            return found;
        }
        let readers = first.readers().unwrap_or_default();
        let fast = |guid: &Gid| vendor::mapping_of(guid) == Some(ServiceMapping::FastDds);
        let found = readers.into_iter().map(|peer| peer.guid).find(fast);
        self.seen = Some((changes, found));
        found
    }

    fn open(&self) -> Option<Second> {
        let participant = self.node.small_bursts().participant()?;
        let topic = &self.topic;
        let user_data = user_data(topic);
        let qos = EndpointQos {
            qos: topic.qos,
            max_blocking: MAX_BLOCKING,
            user_data: &user_data,
            ignore_local: true,
            replay: Replay::History,
        };
        let events = Events::new(&topic.name, topic.qos.reliability, Arc::new(|| {}));
        let names = (topic.name.as_str(), topic.type_name.as_str());
        let raw = RawWriter::new(participant, names, &qos, events)
            .inspect_err(|error| tracing::warn!(%error, topic = topic.name, "no second writer"))
            .ok()?;
        let listed = Listed::new(&self.node, EndpointKind::Writer, raw.guid().ok()?);
        let untold = Some(Untold(CycloneGraph::of(&self.node).nodes().ok()));
        Some(Second { raw, since: Instant::now(), is_used: false, untold, _listed: listed })
    }
}

/// Bytes that the socket of a reader holds which asks the kernel for nothing. Of other machines the
/// same is assumed.
fn room() -> usize {
    let default = std::fs::read_to_string("/proc/sys/net/core/rmem_default");
    let default = default.ok().and_then(|text| text.trim().parse().ok()).unwrap_or(RMEM_DEFAULT);
    // The kernel counts its own overhead of a datagram too.
    default - default / 8
}

fn tell(topic: &TopicDescription, node: Option<&str>, bytes: usize, room: usize) {
    let name = super::names::topic_from_dds(&topic.name).unwrap_or(&topic.name);
    let node = node.unwrap_or("a subscriber of an unknown node");
    let wanted = bytes.saturating_mul(4).next_power_of_two();
    tracing::warn!(
        "{node} on {name} runs Fast DDS, whose socket holds {room} bytes, and a message has {bytes}: \
         they are sent in small bursts from now on, which takes longer; to have them at once, run \
         sysctl -w net.core.rmem_default={wanted} before both programs start (docs/qos.md)"
    );
}
