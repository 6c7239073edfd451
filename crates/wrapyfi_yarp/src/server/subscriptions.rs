//! Subscriptions, which are connections that outlive their ports, and the ports that are live.
//!
//! ```text
//!   subscribe /a tcp://b ──▶ kept ──┐
//!   announce /a ──▶ /a is live ─────┼──▶ Link { connect, "/a", "tcp://b" }
//!   unregister /b ──▶ /b is gone ───┘──▶ Link { disconnect, "/a", "tcp://b" }
//! ```
//!
//! Nothing is connected here: the program that asks is told what to do.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use crate::name::Target;

/// Age that an announcement must have for a report that the port does not answer to end it. A port
/// that has just been opened again must not be taken for the one before.
const SETTLED: Duration = Duration::from_secs(30);

/// A connection to make or to end.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Link {
    /// Sender, perhaps with a carrier.
    pub(crate) src: String,
    /// Receiver, perhaps with a carrier.
    pub(crate) dest: String,
    /// True when they should be connected.
    pub(crate) connect: bool,
}

/// A connection that was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Subscription {
    src: String,
    dest: String,
    /// Sender as it was named, perhaps with a carrier.
    pub(crate) src_full: String,
    /// Receiver as it was named.
    pub(crate) dest_full: String,
    /// `from` and `to` end with the sender or the receiver; anything else does not end.
    pub(crate) mode: String,
}

/// One more than the limit of the things kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TooMany {
    pub(crate) limit: usize,
}

/// Everything kept about connections.
#[derive(Debug, Default)]
pub(crate) struct Subscriptions {
    kept: BTreeMap<(String, String), Subscription>,
    /// Time at which each port was first announced.
    live: BTreeMap<String, Duration>,
    /// Topics in the order in which they were made.
    pub(crate) topics: Vec<String>,
    types: BTreeMap<String, String>,
    limit: usize,
}

/// Source of the facts about a name.
pub(crate) trait Known {
    /// True when a port of that name is registered that can be connected.
    fn is_port(&self, name: &str) -> bool;
}

impl Subscriptions {
    /// Keeps at most `limit` of everything.
    pub(crate) fn new(limit: usize) -> Self {
        Self { limit, ..Self::default() }
    }

    /// Keeps a connection, and says what to connect now.
    pub(crate) fn subscribe(
        &mut self,
        src_full: &str,
        dest_full: &str,
        mode: &str,
        known: &impl Known,
    ) -> Result<Vec<Link>, TooMany> {
        let (src, dest) = (Target::parse(src_full), Target::parse(dest_full));
        let key = (src.name.clone(), dest.name.clone());
        if !self.kept.contains_key(&key) {
            self.room(self.kept.len())?;
        }
        let mut links = Vec::new();
        for end in [&src, &dest] {
            if end.carrier == "topic" && !self.is_topic(&end.name) {
                links.extend(self.add_topic(&end.name, known)?);
            }
        }
        let kept = Subscription {
            src: src.name.clone(),
            dest: dest.name.clone(),
            src_full: src_full.to_owned(),
            dest_full: dest_full.to_owned(),
            mode: mode.to_owned(),
        };
        self.kept.insert(key.clone(), kept.clone());
        match (src.carrier == "topic", dest.carrier == "topic") {
            (false, false) => {
                // Ports that are registered are connected, announced or not: as YARP does.
                links.extend(join(&kept, &kept, known));
                let ended = (mode == "from" && !known.is_port(&src.name))
                    || (mode == "to" && !known.is_port(&dest.name));
                if ended {
                    self.kept.remove(&key);
                }
            }
            (false, true) => links.extend(self.hook_up(&src.name, known)),
            (true, false) => links.extend(self.hook_up(&dest.name, known)),
            (true, true) => {}
        }
        Ok(links)
    }

    /// Forgets a connection that should be; one that exists stays.
    pub(crate) fn unsubscribe(&mut self, src: &str, dest: &str) {
        self.kept.remove(&(Target::parse(src).name, Target::parse(dest).name));
    }

    /// The connections kept, those of `name` where it is not empty, with whether their ends are
    /// topics.
    pub(crate) fn list(&self, name: &str) -> impl Iterator<Item = (&Subscription, bool, bool)> {
        self.kept
            .values()
            .filter(move |kept| name.is_empty() || kept.src == name || kept.dest == name)
            .map(|kept| (kept, self.is_topic(&kept.src), self.is_topic(&kept.dest)))
    }

    /// A port says that it is there.
    pub(crate) fn announce(
        &mut self,
        name: &str,
        now: Duration,
        known: &impl Known,
    ) -> Result<Vec<Link>, TooMany> {
        if !self.live.contains_key(name) {
            self.room(self.live.len())?;
            self.live.insert(name.to_owned(), now);
        }
        Ok(self.hook_up(name, known))
    }

    /// A program says that a port does not answer.
    pub(crate) fn verify(&mut self, name: &str, now: Duration) {
        if self.live.get(name).is_some_and(|&since| now.saturating_sub(since) > SETTLED) {
            self.live.remove(name);
        }
    }

    /// A port is about to be unregistered: what to disconnect. `known` still knows it.
    pub(crate) fn depart(&mut self, name: &str, known: &impl Known) -> Vec<Link> {
        self.live.remove(name);
        let mut links = BTreeSet::new();
        let mut ended = Vec::new();
        for (key, kept) in &self.kept {
            let (is_src, is_dest) = (kept.src == name, kept.dest == name);
            // A sender that goes closes its outputs itself; other senders must be told.
            if is_dest && known.is_port(name) && self.live.contains_key(&kept.src) {
                links.insert(link(&kept.src_full, &kept.dest_full, false));
            }
            if (is_src && kept.mode == "from") || (is_dest && !is_src && kept.mode == "to") {
                ended.push(key.clone());
            }
        }
        for (from, to) in self.through_topics() {
            if to.dest == name && self.live.contains_key(&from.src) {
                links.insert(link(&from.src_full, &to.dest_full, false));
            }
        }
        for key in ended {
            self.kept.remove(&key);
        }
        links.into_iter().collect()
    }

    /// Connections to make now that `name` is live.
    fn hook_up(&self, name: &str, known: &impl Known) -> Vec<Link> {
        let live = |name: &str| self.live.contains_key(name);
        let pairs = self.kept.values().map(|kept| (kept, kept)).chain(self.through_topics());
        let ready = pairs.filter(|(from, to)| {
            (from.src == name || to.dest == name) && live(&from.src) && live(&to.dest)
        });
        let links: BTreeSet<_> = ready.filter_map(|(from, to)| join(from, to, known)).collect();
        links.into_iter().collect()
    }

    /// Each publisher of a topic with each of its subscribers.
    fn through_topics(&self) -> impl Iterator<Item = (&Subscription, &Subscription)> {
        self.kept.values().filter(|from| self.is_topic(&from.dest)).flat_map(|from| {
            self.kept.values().filter(|to| to.src == from.dest).map(move |to| (from, to))
        })
    }

    fn is_topic(&self, name: &str) -> bool {
        self.topics.iter().any(|topic| topic == name)
    }

    /// Makes a topic, and says what to connect through it.
    pub(crate) fn add_topic(
        &mut self,
        name: &str,
        known: &impl Known,
    ) -> Result<Vec<Link>, TooMany> {
        if !self.is_topic(name) {
            self.room(self.topics.len())?;
            self.topics.push(name.to_owned());
        }
        let pairs = self.through_topics().filter(|(from, _)| from.dest == name);
        Ok(pairs.filter_map(|(from, to)| join(from, to, known)).collect())
    }

    /// Forgets a topic.
    pub(crate) fn remove_topic(&mut self, name: &str) {
        self.topics.retain(|topic| topic != name);
    }

    /// Stores what a type is made of.
    pub(crate) fn set_type(&mut self, name: &str, text: &str) -> Result<(), TooMany> {
        if !self.types.contains_key(name) {
            self.room(self.types.len())?;
        }
        self.types.insert(name.to_owned(), text.to_owned());
        Ok(())
    }

    /// Definition of a type.
    pub(crate) fn type_of(&self, name: &str) -> Option<&str> {
        self.types.get(name).map(String::as_str)
    }

    fn room(&self, kept: usize) -> Result<(), TooMany> {
        if kept < self.limit { Ok(()) } else { Err(TooMany { limit: self.limit }) }
    }
}

fn link(src: &str, dest: &str, connect: bool) -> Link {
    Link { src: src.to_owned(), dest: dest.to_owned(), connect }
}

/// The connection of two ports that are registered.
fn join(from: &Subscription, to: &Subscription, known: &impl Known) -> Option<Link> {
    let both = known.is_port(&from.src) && known.is_port(&to.dest);
    both.then(|| link(&from.src_full, &to.dest_full, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Registered ports.
    struct Ports(&'static [&'static str]);

    impl Known for Ports {
        fn is_port(&self, name: &str) -> bool {
            self.0.contains(&name)
        }
    }

    const NOW: Duration = Duration::from_secs(100);

    fn connect(src: &str, dest: &str) -> Vec<Link> {
        vec![link(src, dest, true)]
    }

    #[test]
    fn a_connection_is_made_when_both_ends_are_there() {
        let mut all = Subscriptions::new(10);
        // The receiver is open, the sender does not exist yet.
        assert_eq!(all.announce("/dst", NOW, &Ports(&["/dst"])), Ok(vec![]));
        assert_eq!(all.subscribe("/src", "tcp://dst", "", &Ports(&["/dst"])), Ok(vec![]));
        let both = Ports(&["/src", "/dst"]);
        assert_eq!(all.announce("/src", NOW, &both), Ok(connect("/src", "tcp://dst")));
        // It goes, and comes again.
        assert_eq!(all.depart("/src", &both), vec![]);
        assert_eq!(all.announce("/src", NOW, &both), Ok(connect("/src", "tcp://dst")));
        // The receiver goes: the sender is told.
        assert_eq!(all.depart("/dst", &both), vec![link("/src", "tcp://dst", false)]);
        all.unsubscribe("/src", "/dst");
        assert_eq!(all.announce("/dst", NOW, &both), Ok(vec![]));
    }

    #[test]
    fn registered_ports_are_connected_at_once() {
        let both = Ports(&["/wf", "/wf:in"]);
        let mut all = Subscriptions::new(10);
        assert_eq!(
            all.subscribe("tcp://wf", "tcp://wf:in", "", &both),
            Ok(connect("tcp://wf", "tcp://wf:in"))
        );
    }

    #[test]
    fn modes_end_subscriptions_with_one_of_their_ends() {
        let both = Ports(&["/a", "/b"]);
        let kept = |all: &Subscriptions| all.list("").count();
        for (mode, goes, stays) in [("from", "/a", "/b"), ("to", "/b", "/a")] {
            let mut all = Subscriptions::new(10);
            all.subscribe("/a", "/b", mode, &both).unwrap();
            all.depart(stays, &both);
            assert_eq!(kept(&all), 1, "{mode}");
            all.depart(goes, &both);
            assert_eq!(kept(&all), 0, "{mode}");
            // Without the port it should end with, it ends at once.
            all.subscribe("/a", "/b", mode, &Ports(&[])).unwrap();
            assert_eq!(kept(&all), 0, "{mode}");
        }
    }

    #[test]
    fn silence_counts_only_of_ports_that_settled() {
        let both = Ports(&["/a", "/b"]);
        let mut all = Subscriptions::new(10);
        all.announce("/a", NOW, &both).unwrap();
        all.subscribe("/a", "/b", "", &Ports(&[])).unwrap();
        all.verify("/a", NOW + Duration::from_secs(30));
        assert_eq!(all.announce("/b", NOW, &both), Ok(connect("/a", "/b")));
        all.verify("/a", NOW + Duration::from_secs(31));
        assert_eq!(all.announce("/b", NOW, &both), Ok(vec![]));
    }

    #[test]
    fn topics_connect_every_publisher_with_every_subscriber() {
        let ports = Ports(&["/p1", "/p2", "/s1"]);
        let mut all = Subscriptions::new(10);
        for name in ["/p1", "/p2", "/s1"] {
            all.announce(name, NOW, &ports).unwrap();
        }
        assert_eq!(all.subscribe("/p1", "topic://t", "", &ports), Ok(vec![]));
        assert_eq!(all.subscribe("topic://t", "/s1", "", &ports), Ok(connect("/p1", "/s1")));
        assert_eq!(all.subscribe("/p2", "topic://t", "", &ports), Ok(connect("/p2", "/s1")));
        assert_eq!(all.topics, ["/t"]);
        let flags: Vec<_> = all.list("").map(|(_, src, dest)| (src, dest)).collect();
        assert_eq!(flags, [(false, true), (false, true), (true, false)]);
        all.remove_topic("/t");
        assert_eq!(all.announce("/s1", NOW, &ports), Ok(vec![]));
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let none = Ports(&[]);
        let mut all = Subscriptions::new(2);
        for dest in ["/b", "/c"] {
            all.subscribe("/a", dest, "", &none).unwrap();
            all.announce(dest, NOW, &none).unwrap();
            all.add_topic(dest, &none).unwrap();
            all.set_type(dest, "").unwrap();
        }
        let full = Err(TooMany { limit: 2 });
        assert_eq!(all.subscribe("/a", "/d", "", &none), full);
        assert_eq!(all.announce("/d", NOW, &none), full);
        assert_eq!(all.add_topic("/d", &none), full);
        assert_eq!(all.set_type("/d", ""), Err(TooMany { limit: 2 }));
        // One that is there may change.
        all.subscribe("/a", "/b", "from", &Ports(&["/a"])).unwrap();
    }
}
