//! Counters of the endpoints of this process, for what only a broker in the same process sees: messages of its
//! publishers that are lost there, peers that are refused there, and servers that are connected there.
//!
//! Topics alone tell whose a message is. Losses of another process that publishes on the same topic
//! through this broker are counted here too.

use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use super::curve_config::CurveClient;
use super::inside::Inside;
use super::zmtp::Kind;
use wrapyfi_endpoint::{Counters, DropReason, Mutex, Refused, Role};

/// Peer that a broker refuses, for its key or its port.
pub(super) struct Refusal {
    /// Side of the broker at which it is refused.
    pub(super) side: Kind,
    /// Peer and reason, in words.
    pub(super) who: String,
    /// Its key; empty where it has none, or another server key.
    pub(super) key: String,
    /// Entry of `clients` that has the key, where one does.
    pub(super) entry: Option<CurveClient>,
    /// Topic that it may not have; `None` where it may have none at all.
    pub(super) topic: Option<Vec<u8>>,
    /// True for one that has connected to the other port of the broker.
    pub(super) is_elsewhere: bool,
}

/// Side of the broker at which an endpoint's peers are, and the name of the endpoint.
type Key = (Kind, Vec<u8>);

/// The counters of the endpoints of one instance, by the side of the broker at which their peers are, and by name.
/// Looked at only where something is lost.
#[derive(Debug, Default)]
pub(super) struct Ledger {
    entries: Mutex<BTreeMap<Key, Vec<Weak<Counters>>>>,
    /// Number of servers at the broker of requests and replies, where it is this process that runs it.
    pub(super) servers: Mutex<Option<usize>>,
    /// Broker of topics, where it is this process that runs it, without CURVE.
    pub(super) broker: Mutex<Option<Inside>>,
}

impl Ledger {
    /// Enters an endpoint.
    pub(super) fn enter(&self, peers_at: Kind, name: &str, counters: &Arc<Counters>) {
        let mut entries = self.entries.lock();
        entries.retain(|_, each| {
            each.retain(|counters| counters.strong_count() > 0);
            !each.is_empty()
        });
        let each = entries.entry((peers_at, name.as_bytes().to_vec())).or_default();
        each.push(Arc::downgrade(counters));
    }

    /// Counts a message, `bytes` long, that not everybody got who was to have it.
    pub(super) fn undelivered(&self, topic: &[u8], reason: DropReason, bytes: usize) {
        let entries = self.entries.lock();
        let publishers = entries.get(&(Kind::Xpub, topic.to_vec()));
        // Of several publishers it is not known whose it was.
        if let Some(counters) = publishers.into_iter().flatten().rev().find_map(Weak::upgrade) {
            counters.undelivered(reason, bytes);
        }
    }

    /// Counts a message that a broker does not pass on, at every listener that was to have it.
    pub(super) fn not_taken(&self, topic: &[u8], reason: DropReason) {
        let entries = self.entries.lock();
        let listeners = entries.get(&(Kind::Xsub, topic.to_vec()));
        for counters in listeners.into_iter().flatten().filter_map(Weak::upgrade) {
            counters.received(0);
            counters.dropped(reason);
        }
    }

    /// Counts a peer that was refused at every endpoint that it may have been for.
    pub(super) fn refused(&self, refusal: &Refusal) {
        let entries = self.entries.lock();
        for ((side, name), counters) in
            entries.iter().flat_map(|(key, each)| each.iter().map(move |counters| (key, counters)))
        {
            let is_meant = refusal.topic.as_ref().is_none_or(|topic| match side {
                // A subscription is the beginning of a topic.
                Kind::Xpub => name.starts_with(topic),
                _ => name == topic,
            });
            if *side == refusal.side
                && is_meant
                && let Some(counters) = counters.upgrade()
            {
                let allow = refusal.allow(&String::from_utf8_lossy(name));
                let role = match side {
                    Kind::Xsub => Role::Publisher,
                    Kind::Xpub => Role::Listener,
                    Kind::Router => Role::Client,
                    Kind::Dealer => Role::Server,
                };
                let (who, roles) = (refusal.who.clone(), vec![role]);
                counters.refused_peer(Refused { who, allow, roles });
            }
        }
    }
}

impl Refusal {
    /// A peer without a key.
    pub(super) fn of(side: Kind, who: String) -> Self {
        Self { side, who, key: String::new(), entry: None, topic: None, is_elsewhere: false }
    }

    /// Line of the configuration that lets the peer do what an endpoint called `name` is there for.
    fn allow(&self, name: &str) -> String {
        const CLIENTS: &str = "endpoints: zeromq: curve: clients:";
        let Self { side, key, entry, .. } = self;
        if self.is_elsewhere {
            return format!("connect that program to {} of the broker", side.port());
        }
        let and = |topics: fn(&CurveClient) -> &Vec<String>| {
            let listed = entry.iter().flat_map(topics).map(String::as_str);
            listed.chain([name]).collect::<Vec<_>>()
        };
        let grant = match side {
            Kind::Xsub => format!("publish: {:?}", and(|it| &it.publish)),
            Kind::Xpub => format!("subscribe: {:?}", and(|it| &it.subscribe)),
            Kind::Router => "call: true".to_owned(),
            Kind::Dealer => "serve: true".to_owned(),
        };
        match entry {
            Some(entry) => {
                format!("{CLIENTS} write {grant} in the entry with key: {:?}", entry.key)
            }
            None if key.is_empty() => format!(
                "that program needs the public key of this broker as its server key, and a CURVE key of its own in \
                 {CLIENTS} - {{ key: …, {grant} }}"
            ),
            None => format!("{CLIENTS} - {{ key: \"{key}\", {grant} }}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_counted_where_it_may_have_been_for_with_the_line_that_allows_it() {
        let ledger = Ledger::default();
        let [camera, depth, command] = [(); 3].map(|()| Arc::<Counters>::default());
        ledger.enter(Kind::Xpub, "/camera", &camera);
        ledger.enter(Kind::Xpub, "/depth", &depth);
        ledger.enter(Kind::Xsub, "/command", &command);
        let refuse = |side, topic: Option<&str>| {
            let topic = topic.map(|topic| topic.as_bytes().to_vec());
            let (who, key, entry) = ("x".to_owned(), "K".to_owned(), None);
            ledger.refused(&Refusal { key, entry, topic, ..Refusal::of(side, who) });
        };
        let counts = || [&camera, &depth, &command].map(|it| it.snapshot().dropped());
        refuse(Kind::Xpub, Some("/cam"));
        assert_eq!(counts(), [1, 0, 0]);
        refuse(Kind::Xpub, None);
        assert_eq!(counts(), [2, 1, 0]);
        refuse(Kind::Xsub, Some("/comm"));
        refuse(Kind::Xsub, Some("/command"));
        assert_eq!(counts(), [2, 1, 1]);
        let line = command.take_refused().pop().unwrap().allow;
        assert!(line.ends_with("- { key: \"K\", publish: [\"/command\"] }"), "{line}");
        assert_eq!(command.take_refused(), []);
    }

    #[test]
    fn what_a_key_that_is_listed_lacks_is_told_as_a_change_of_its_entry() {
        let publish = ["/camera", "/depth/(.*)"].map(str::to_owned).to_vec();
        let entry = CurveClient { key: "keys/robot.key".to_owned(), publish, ..Default::default() };
        let refusal = |side, key: &str, entry: Option<&CurveClient>| {
            let (who, key, entry) = (String::new(), key.to_owned(), entry.cloned());
            Refusal { key, entry, ..Refusal::of(side, who) }.allow("/words")
        };
        for (side, line) in [
            (Kind::Xsub, "publish: [\"/camera\", \"/depth/(.*)\", \"/words\"]"),
            (Kind::Xpub, "subscribe: [\"/words\"]"),
            (Kind::Router, "call: true"),
        ] {
            let told = refusal(side, "K", Some(&entry));
            let wanted = format!("clients: write {line} in the entry with key: \"keys/robot.key\"");
            assert!(told.ends_with(&wanted), "{told}");
        }
        let elsewhere = Refusal { is_elsewhere: true, ..Refusal::of(Kind::Xsub, String::new()) };
        assert_eq!(elsewhere.allow("/words"), "connect that program to sub_port of the broker");
        let without = refusal(Kind::Dealer, "", None);
        assert!(without.contains("needs the public key") && without.contains("serve: true"));
    }
}
