//! The endpoints of other participants, by topic, as discovery tells of them.
//!
//! ```text
//!   DCPSPublication ──┐ callback: take what is new             ┌─▶ watches of that topic and side:
//!   DCPSSubscription ─┴──────────▶ PeerIndex { topic ▶ peers } ┴   changes + 1, notify
//! ```
//!
//! One for a node, whatever the number of its topics: an event wakes only those who asked about its topic.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Weak};

use super::cyclone::{BuiltinReader, EndpointFound, Entity, ReturnCode};
use super::dds_terms::discovered;
use super::discovery_info::{Announcing, Gid};
use super::graph::{DiscoveredEndpoint, Notify, PeerWatch};
use wrapyfi_endpoint::Mutex;

/// Endpoints that are kept: strangers announce them.
const MAX_ENDPOINTS: usize = 65_536;

/// A DDS topic, and which side of it: true for writers.
type Side = (String, bool);

/// Index of the endpoints that discovery has found.
#[derive(Default)]
pub(super) struct PeerIndex {
    own: Gid,
    readers: Mutex<Vec<BuiltinReader>>,
    known: Mutex<Known>,
    /// Number of changes of any of the endpoints.
    changes: AtomicU64,
    overflowed: AtomicBool,
}

#[derive(Default)]
struct Known {
    /// Endpoints, by the side of the topic on which they are and their numbers.
    peers: BTreeMap<(Side, u64), EndpointFound>,
    /// Side of the topic on which an endpoint is, by the endpoint's number.
    places: HashMap<u64, Side>,
    watches: Vec<(Side, Weak<Watched>)>,
}

struct Watched {
    changes: AtomicU64,
    notify: Notify,
}

impl PeerIndex {
    /// Begins to listen; `own` is the participant's GUID, whose endpoints are no peers.
    pub(super) fn new(participant: &Entity, own: Gid) -> Result<Arc<Self>, ReturnCode> {
        let index = Arc::new(Self { own, ..Self::default() });
        let mut readers = Vec::new();
        for is_writer in [true, false] {
            // Weak, because the index owns the readers that own the callback.
            let weak = Arc::downgrade(&index);
            let notify = Arc::new(move || {
                if let Some(index) = weak.upgrade() {
                    index.drain();
                }
            });
            readers.push(BuiltinReader::new(participant, is_writer, notify)?);
        }
        *index.readers.lock() = readers;
        // Samples may have come before the readers were in their place, when the callback found
        // none.
        index.drain();
        Ok(index)
    }

    /// Watches one side of a DDS topic, and keeps `node` for as long.
    pub(super) fn watch(
        self: Arc<Self>,
        node: Arc<dyn Announcing>,
        topic: String,
        publishers: bool,
        notify: Notify,
    ) -> Watch {
        let (side, watched) = self.add_watch((topic, publishers), notify);
        Watch { index: self, side, watched, _node: node }
    }

    fn add_watch(&self, side: Side, notify: Notify) -> (Side, Arc<Watched>) {
        let watched = Arc::new(Watched { changes: AtomicU64::new(1), notify });
        let watches = &mut self.known.lock().watches;
        watches.retain(|(_, watch)| watch.strong_count() > 0);
        watches.push((side.clone(), Arc::downgrade(&watched)));
        (side, watched)
    }

    /// Hears no more. Called by the owner: readers must not be dropped by a callback that held the
    /// last share of the index, because dropping them waits for that callback.
    pub(super) fn close(&self) {
        let readers = std::mem::take(&mut *self.readers.lock());
        drop(readers);
    }

    fn drain(&self) {
        let mut rung = Vec::new();
        // Held all the while, so that two threads do not apply news in the wrong order.
        for reader in self.readers.lock().iter() {
            let taken = reader.take(|number, endpoint| rung.extend(self.apply(number, endpoint)));
            if let Err(error) = taken {
                self.changes.fetch_add(1, Relaxed);
                tracing::warn!(%error, "cannot read what discovery found");
            }
        }
        for watched in rung {
            (watched.notify)();
        }
    }

    /// Enters an endpoint, or removes it; those to be watched.
    fn apply(&self, number: u64, endpoint: Option<EndpointFound>) -> Vec<Arc<Watched>> {
        let mut known = self.known.lock();
        let Known { peers, places, watches } = &mut *known;
        let side = match endpoint {
            Some(endpoint) => {
                if endpoint.guid.first_chunk::<12>() == self.own.first_chunk() {
                    return Vec::new();
                }
                if places.len() >= MAX_ENDPOINTS && !places.contains_key(&number) {
                    if !self.overflowed.swap(true, Relaxed) {
                        tracing::warn!(
                            "more than {MAX_ENDPOINTS} endpoints: routes are not fitted to further \
                             ones"
                        );
                    }
                    return Vec::new();
                }
                let side = (endpoint.topic.clone(), endpoint.is_writer);
                places.insert(number, side.clone());
                peers.insert((side.clone(), number), endpoint);
                side
            }
            None => {
                // Each look at all endpoints opens readers of its own, which go again and are no peers.
                let Some(side) = places.remove(&number) else { return Vec::new() };
                peers.remove(&(side.clone(), number));
                side
            }
        };
        self.changes.fetch_add(1, Relaxed);
        let meant = watches.iter().filter(|(watched, _)| *watched == side);
        let watched: Vec<_> = meant.filter_map(|(_, watch)| watch.upgrade()).collect();
        for watch in &watched {
            watch.changes.fetch_add(1, Relaxed);
        }
        watched
    }

    /// Number that grows with each change of the endpoints; `None` once there were too many to know all of them.
    pub(super) fn changes(&self) -> Option<u64> {
        (!self.overflowed.load(Relaxed)).then(|| self.changes.load(Relaxed))
    }

    fn peers(&self, side: &Side) -> Vec<DiscoveredEndpoint> {
        let numbers = (side.clone(), 0)..=(side.clone(), u64::MAX);
        let found: Vec<_> =
            self.known.lock().peers.range(numbers).map(|(_, found)| found.clone()).collect();
        let mut peers: Vec<_> =
            found.into_iter().map(|endpoint| discovered(endpoint, &self.own)).collect();
        peers.sort_by_key(|peer| peer.gid);
        peers
    }
}

/// Watches one side of a topic until it is dropped. Fields drop in this order: the index before
/// the node whose participant it reads from.
pub(super) struct Watch {
    watched: Arc<Watched>,
    side: Side,
    index: Arc<PeerIndex>,
    _node: Arc<dyn Announcing>,
}

impl PeerWatch for Watch {
    fn peers(&self) -> Vec<DiscoveredEndpoint> {
        self.index.peers(&self.side)
    }

    fn changes(&self) -> u64 {
        self.watched.changes.load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::Qos;

    const OWN: Gid = [7; 16];

    fn endpoint(topic: &str, is_writer: bool, participant: u8) -> EndpointFound {
        EndpointFound {
            is_writer,
            guid: [participant; 16],
            topic: topic.to_owned(),
            type_name: "std_msgs::msg::dds_::String_".to_owned(),
            user_data: Vec::new(),
            qos: Qos::default().into(),
            service_mapping: None,
        }
    }

    fn watch(index: &PeerIndex, topic: &str, publishers: bool) -> (Side, Arc<Watched>) {
        index.add_watch((topic.to_owned(), publishers), Arc::new(|| {}))
    }

    #[test]
    fn only_the_side_concerned_is_told() {
        let index = PeerIndex { own: OWN, ..PeerIndex::default() };
        let (side, watched) = watch(&index, "rt/a", true);
        assert_eq!(index.apply(1, Some(endpoint("rt/a", true, 1))).len(), 1);
        for other in [
            endpoint("rt/b", true, 1),
            endpoint("rt/a", false, 1),
            endpoint("rt/a", true, 7), // our own
        ] {
            assert_eq!(index.apply(2, Some(other)).len(), 0);
        }
        assert_eq!(watched.changes.load(Relaxed), 2);
        assert_eq!(index.changes(), Some(3), "each but our own");
        let peers = index.peers(&side);
        assert_eq!(peers.len(), 1);
        assert_eq!((peers[0].topic.as_str(), peers[0].is_publisher), ("/a", true));
        assert_eq!(peers[0].type_name, "std_msgs/msg/String");
    }

    #[test]
    fn what_changes_is_replaced_and_what_goes_is_gone() {
        let index = PeerIndex { own: OWN, ..PeerIndex::default() };
        let (side, watched) = watch(&index, "rt/a", false);
        index.apply(5, Some(endpoint("rt/a", false, 1)));
        let mut changed = endpoint("rt/a", false, 1);
        changed.qos.deadline = Some(std::time::Duration::from_secs(1));
        index.apply(5, Some(changed.clone()));
        assert_eq!(index.peers(&side)[0].qos, changed.qos);
        index.apply(5, None);
        index.apply(5, None);
        assert_eq!(index.peers(&side), []);
        assert_eq!(watched.changes.load(Relaxed), 4);
        // Readers of our own go without ever having been peers.
        index.apply(6, None);
        assert_eq!(index.changes(), Some(3));
    }

    #[test]
    fn nothing_is_left_of_topics_that_are_over() {
        let index = PeerIndex { own: OWN, ..PeerIndex::default() };
        drop(watch(&index, "rt/a", true));
        index.apply(1, Some(endpoint("rt/a", true, 1)));
        index.apply(1, None);
        for number in 0..500 {
            index.apply(number, Some(endpoint(&format!("rt/t{number}"), true, 1)));
        }
        for number in 0..500 {
            index.apply(number, None);
        }
        drop(watch(&index, "rt/b", true));
        let known = index.known.lock();
        assert!(known.peers.is_empty() && known.places.is_empty());
        assert_eq!(known.watches.len(), 1, "the watch of a topic that is over is gone");
    }
}
