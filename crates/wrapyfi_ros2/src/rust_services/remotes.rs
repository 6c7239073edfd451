//! Remote endpoints that a client or server is matched with, and the state of its peers that
//! follows.
//!
//! ```text
//!   request readers ┐  by participant:
//!   reply writers ──┴─▶ both halves ─▶ a server;  one half ─▶ not yet;  GUID 0110… ─▶ Cyclone's
//! ```
//!
//! GUIDs come from strangers, so the sets are bounded.

use std::collections::{BTreeMap, BTreeSet};

use crate::discovery_info::Gid;
use crate::graph::{Peers, ServiceMapping};

/// Remote endpoints kept on each side of a service.
const MAX_REMOTES: usize = 4096;
/// First bytes of GUIDs of Cyclone DDS: its vendor id.
const CYCLONE: [u8; 2] = [0x01, 0x10];
/// Bytes of a GUID that name the participant.
pub(super) const PREFIX: usize = 12;

/// Remote endpoints of one service.
#[derive(Debug, Default)]
pub(super) struct Remotes {
    readers: BTreeSet<Gid>,
    writers: BTreeSet<Gid>,
}

impl Remotes {
    /// A reader has matched our writer. False when it is one too many.
    pub(super) fn add_reader(&mut self, gid: Gid) -> bool {
        add(&mut self.readers, gid)
    }

    /// A writer has matched our reader. False when it is one too many.
    pub(super) fn add_writer(&mut self, gid: Gid) -> bool {
        add(&mut self.writers, gid)
    }

    /// An endpoint is gone; true when it was known.
    pub(super) fn remove(&mut self, gid: &Gid) -> bool {
        // Both, because a GUID is in one of them at most.
        self.readers.remove(gid) | self.writers.remove(gid)
    }

    /// Forgets those that `stays` does not name; true when there were some.
    pub(super) fn retain(&mut self, stays: impl Fn(&Gid) -> bool) -> bool {
        let before = self.readers.len() + self.writers.len();
        self.readers.retain(&stays);
        self.writers.retain(&stays);
        before != self.readers.len() + self.writers.len()
    }

    /// True when samples of our writer reach this reader.
    pub(super) fn has_reader(&self, gid: &Gid) -> bool {
        self.readers.contains(gid)
    }

    /// True when samples of our writer reach the reader that belongs to `writer`: a participant has one for each of
    /// its writers, and no message says which is whose.
    pub(super) fn has_reader_beside(&self, writer: &Gid) -> bool {
        let beside = |gid: &&Gid| prefix(gid) == prefix(writer) && *gid != writer;
        let others = self.writers.iter().filter(beside).count();
        self.readers.iter().filter(beside).count() > others
    }

    /// Readiness of the other end.
    pub(super) fn peers(&self) -> Peers {
        let mut halves: BTreeMap<&[u8], (usize, usize)> = BTreeMap::new();
        for gid in &self.readers {
            halves.entry(prefix(gid)).or_default().0 += 1;
        }
        for gid in &self.writers {
            halves.entry(prefix(gid)).or_default().1 += 1;
        }
        let (mut ready, mut half, mut foreign) = (0_usize, false, false);
        for (prefix, (readers, writers)) in halves {
            let whole = readers.min(writers);
            match (prefix.starts_with(&CYCLONE), whole) {
                (true, 1..) => foreign = true,
                (false, 1..) => ready += whole,
                (_, 0) => half = true,
            }
        }
        if ready > 0 {
            Peers::Ready(ready)
        } else if half {
            Peers::Half
        } else if foreign {
            Peers::Foreign(ServiceMapping::Cyclone)
        } else {
            Peers::None
        }
    }
}

/// True when the endpoint is of Cyclone DDS, whose ROS 2 maps services in another way.
pub(super) fn is_cyclone(gid: &Gid) -> bool {
    gid.starts_with(&CYCLONE)
}

fn add(set: &mut BTreeSet<Gid>, gid: Gid) -> bool {
    if set.len() >= MAX_REMOTES && !set.contains(&gid) {
        return false;
    }
    set.insert(gid);
    true
}

fn prefix(gid: &Gid) -> &[u8] {
    gid.get(..PREFIX).unwrap_or(gid)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An endpoint of participant `who` of a vendor.
    fn gid(vendor: u8, who: u8, entity: u8) -> Gid {
        let mut gid = [0; 16];
        gid[0] = 1;
        (gid[1], gid[11], gid[15]) = (vendor, who, entity);
        gid
    }

    const FAST: u8 = 0x0f;
    const CYCLONEDDS: u8 = 0x10;
    const RUST: u8 = 0x12;

    #[test]
    fn a_peer_is_ready_with_both_halves() {
        let mut remotes = Remotes::default();
        assert_eq!(remotes.peers(), Peers::None);
        remotes.add_reader(gid(FAST, 1, 4));
        assert_eq!(remotes.peers(), Peers::Half);
        remotes.add_writer(gid(FAST, 2, 3));
        assert_eq!(remotes.peers(), Peers::Half, "two halves of two participants");
        remotes.add_writer(gid(FAST, 1, 3));
        assert_eq!(remotes.peers(), Peers::Ready(1));
        remotes.add_reader(gid(FAST, 2, 4));
        assert_eq!(remotes.peers(), Peers::Ready(2));
        assert!(remotes.remove(&gid(FAST, 1, 3)));
        assert!(!remotes.remove(&gid(FAST, 1, 3)));
        assert_eq!(remotes.peers(), Peers::Ready(1));
        assert!(remotes.retain(|known| !known.starts_with(&gid(FAST, 2, 0)[..12])));
        assert_eq!(remotes.peers(), Peers::Half);
    }

    #[test]
    fn a_beginning_that_is_heard_after_its_end_leaves_no_ghost() {
        let mut remotes = Remotes::default();
        let (reader, writer) = (gid(FAST, 1, 4), gid(FAST, 1, 3));
        let discovered = [writer];
        assert!(!remotes.remove(&reader), "its end comes first");
        remotes.add_reader(reader);
        remotes.add_writer(writer);
        assert_eq!(remotes.peers(), Peers::Ready(1));
        assert!(remotes.retain(|known| discovered.contains(known)));
        assert!(!remotes.retain(|known| discovered.contains(known)), "nothing more");
        assert_eq!(remotes.peers(), Peers::Half);
        assert!(!remotes.has_reader(&reader));
    }

    #[test]
    fn two_of_one_participant_count_twice() {
        let mut remotes = Remotes::default();
        for entity in [1, 2] {
            remotes.add_reader(gid(RUST, 1, entity));
            remotes.add_writer(gid(RUST, 1, entity + 10));
        }
        assert_eq!(remotes.peers(), Peers::Ready(2));
    }

    #[test]
    fn cyclone_is_foreign_only_when_alone() {
        let mut remotes = Remotes::default();
        remotes.add_reader(gid(CYCLONEDDS, 1, 4));
        assert_eq!(remotes.peers(), Peers::Half);
        remotes.add_writer(gid(CYCLONEDDS, 1, 3));
        assert_eq!(remotes.peers(), Peers::Foreign(ServiceMapping::Cyclone));
        remotes.add_writer(gid(RUST, 2, 3));
        assert_eq!(remotes.peers(), Peers::Half);
        remotes.add_reader(gid(RUST, 2, 4));
        assert_eq!(remotes.peers(), Peers::Ready(1));
    }

    #[test]
    fn readers_are_known_by_name_and_by_participant() {
        let mut remotes = Remotes::default();
        remotes.add_reader(gid(FAST, 1, 4));
        assert!(remotes.has_reader(&gid(FAST, 1, 4)) && !remotes.has_reader(&gid(FAST, 1, 5)));
        assert!(remotes.has_reader_beside(&gid(FAST, 1, 3)));
        assert!(!remotes.has_reader_beside(&gid(FAST, 2, 3)));
        remotes.add_writer(gid(FAST, 1, 3));
        assert!(remotes.has_reader_beside(&gid(FAST, 1, 3)));
        assert!(!remotes.has_reader_beside(&gid(FAST, 1, 7)), "the reader may be of the other one");
        remotes.add_reader(gid(FAST, 1, 8));
        assert!(remotes.has_reader_beside(&gid(FAST, 1, 7)));
    }

    #[test]
    fn strangers_cannot_fill_the_memory() {
        let mut remotes = Remotes::default();
        let nth = |n: usize| {
            let mut gid = [1; 16];
            gid[..8].copy_from_slice(&n.to_le_bytes());
            gid
        };
        assert!((0..MAX_REMOTES).all(|n| remotes.add_reader(nth(n))));
        assert!(!remotes.add_reader(nth(MAX_REMOTES)));
        assert!(remotes.add_reader(nth(0)), "known already");
    }
}
