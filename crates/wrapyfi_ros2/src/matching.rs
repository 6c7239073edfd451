//! Changes of an endpoint's quality of service to fit its peers.
//!
//! ```text
//!   peers ─▶ listener_qos / publisher_qos ─▶ what would fit
//!     the same as now                              ─▶ nothing
//!     a peer is shut out, or the first ones are there ─▶ after SETTLE without other news
//!     all fit, but more could be had               ─▶ after CALM without other news
//! ```
//!
//! So a publisher that comes and goes does not take its subscription along each time: what it needs
//! is done once, and undone only when it has been quiet for long. Pure: the caller says what time it
//! is.

use std::time::{Duration, Instant};

use wrapyfi_endpoint::{
    AnnouncedQos, MatchedQos, PinnedQos, Qos, QosPolicy, listener_qos, mismatches, publisher_qos,
};

/// Peers of one program are discovered one after the other: so long without news is the end of it.
pub(super) const SETTLE: Duration = Duration::from_millis(100);
/// Time for which a change that is only perhaps better has to last before it is made.
pub(super) const CALM: Duration = Duration::from_secs(5);

/// Decides for one endpoint.
#[derive(Debug)]
pub(super) struct Matching {
    listens: bool,
    /// Quality of service without peers; its history and lifespan hold always.
    base: Qos,
    /// Policies that peers cannot change.
    pinned: PinnedQos,
    /// Quality of service that would fit the peers, and since when.
    wanted: Option<(Qos, Instant)>,
    /// True when it has once been fitted to a peer.
    fitted: bool,
}

/// Decision about the endpoint's quality of service.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Decision {
    /// Nothing; the value fits as well as any does.
    Keep,
    /// Nothing before this time, if nothing else happens.
    Wait(Instant),
    /// Open again with this.
    Switch(MatchedQos),
}

impl Matching {
    /// Matching of a listener if `listens`, else of a publisher. Policies in `pinned` stay.
    pub(super) fn new(listens: bool, base: Qos, pinned: PinnedQos) -> Self {
        Self { listens, base, pinned, wanted: None, fitted: false }
    }

    /// Looks at what `peers` announce to an endpoint that has `current`.
    pub(super) fn decide(
        &mut self,
        current: &Qos,
        peers: &[AnnouncedQos],
        now: Instant,
    ) -> Decision {
        if peers.is_empty() {
            // Peers that went may come back as they were; a change meanwhile has no use.
            self.wanted = None;
            return Decision::Keep;
        }
        let mut found = if self.listens {
            listener_qos(peers, &self.base)
        } else {
            // An offer once made is kept: who relies on it may come back.
            let base = Qos {
                reliability: current.reliability,
                durability: current.durability,
                ..self.base
            };
            publisher_qos(peers, &base)
        };
        found.qos = self.pinned.apply(found.qos);
        found.warnings.retain(|warning| !self.pinned.holds(warning.policy));
        if found.qos == *current {
            self.wanted = None;
            self.fitted = true;
            return Decision::Keep;
        }
        let since = match self.wanted {
            Some((wanted, since)) if wanted == found.qos => since,
            _ => {
                self.wanted = Some((found.qos, now));
                now
            }
        };
        let urgent = !self.fitted
            || peers.iter().any(|peer| !self.fits(current, peer) && self.fits(&found.qos, peer));
        let due = since + if urgent { SETTLE } else { CALM };
        if now < due {
            return Decision::Wait(due);
        }
        self.wanted = None;
        self.fitted = true;
        Decision::Switch(found)
    }

    fn fits(&self, own: &Qos, peer: &AnnouncedQos) -> bool {
        unmet(self.listens, own, peer).is_empty()
    }
}

/// The policies over which an endpoint with `own` and a peer do not come together.
pub(super) fn unmet(listens: bool, own: &Qos, peer: &AnnouncedQos) -> Vec<QosPolicy> {
    let own = (*own).into();
    if listens { mismatches(peer, &own) } else { mismatches(&own, peer) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_endpoint::{Durability, QosPreset, Reliability};

    fn offer(preset: QosPreset) -> AnnouncedQos {
        Qos::from(preset).into()
    }

    fn best_effort() -> AnnouncedQos {
        AnnouncedQos { reliability: Reliability::BestEffort, ..offer(QosPreset::Default) }
    }

    /// Applies decisions as an endpoint does.
    struct Endpoint {
        matching: Matching,
        qos: Qos,
        start: Instant,
        switches: usize,
    }

    impl Endpoint {
        fn new(listens: bool) -> Self {
            let qos = Qos::default();
            let start = Instant::now();
            let matching = Matching::new(listens, qos, PinnedQos::default());
            Self { matching, qos, start, switches: 0 }
        }

        fn look(&mut self, peers: &[AnnouncedQos], after: Duration) -> Decision {
            let decision = self.matching.decide(&self.qos, peers, self.start + after);
            if let Decision::Switch(found) = &decision {
                self.qos = found.qos;
                self.switches += 1;
            }
            decision
        }
    }

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn the_first_peer_is_fitted_as_soon_as_it_is_quiet() {
        let mut listener = Endpoint::new(true);
        let latched = [offer(QosPreset::Latched)];
        assert_eq!(listener.look(&[], ms(0)), Decision::Keep);
        assert_eq!(listener.look(&latched, ms(0)), Decision::Wait(listener.start + SETTLE));
        assert!(matches!(listener.look(&latched, SETTLE), Decision::Switch(_)));
        assert_eq!(listener.qos.durability, Durability::TransientLocal);
        assert_eq!(listener.look(&latched, ms(200)), Decision::Keep);
        assert_eq!(listener.look(&[], ms(300)), Decision::Keep);
    }

    #[test]
    fn who_is_shut_out_is_let_in_soon_and_the_rest_waits() {
        let mut listener = Endpoint::new(true);
        let reliable = offer(QosPreset::Default);
        assert_eq!(listener.look(&[reliable], ms(0)), Decision::Keep);
        listener.look(&[reliable, best_effort()], ms(1000));
        listener.look(&[reliable, best_effort()], ms(1000) + SETTLE);
        assert_eq!(listener.qos.reliability, Reliability::BestEffort);
        let due = listener.start + ms(2000) + CALM;
        assert_eq!(listener.look(&[reliable], ms(2000)), Decision::Wait(due));
        assert!(matches!(listener.look(&[reliable], ms(2000) + CALM), Decision::Switch(_)));
        assert_eq!(listener.qos, Qos::default());
    }

    #[test]
    fn a_peer_that_flaps_moves_nothing_but_once() {
        let mut listener = Endpoint::new(true);
        let reliable = offer(QosPreset::Default);
        listener.look(&[reliable], ms(0));
        for second in 1..60 {
            let at = ms(second * 1000);
            let peers =
                if second % 2 == 1 { vec![reliable, best_effort()] } else { vec![reliable] };
            listener.look(&peers, at);
            listener.look(&peers, at + SETTLE);
        }
        assert_eq!(listener.switches, 1);
    }

    #[test]
    fn what_is_pinned_stays_and_the_rest_follows() {
        let mut listener = Endpoint::new(true);
        let reliability = Some(Reliability::Reliable);
        listener.matching.pinned = PinnedQos { reliability, ..PinnedQos::default() };
        let peers =
            [AnnouncedQos { reliability: Reliability::BestEffort, ..offer(QosPreset::Latched) }];
        listener.look(&peers, ms(0));
        let Decision::Switch(found) = listener.look(&peers, SETTLE) else { panic!("no switch") };
        assert_eq!(found.warnings, []);
        let durability = Durability::TransientLocal;
        assert_eq!(listener.qos, Qos { durability, ..Qos::default() });
        assert_eq!(listener.look(&peers, ms(60_000)), Decision::Keep);
    }

    #[test]
    fn a_publisher_keeps_what_it_offered() {
        let mut publisher = Endpoint::new(false);
        let (usual, latched) = (offer(QosPreset::Default), offer(QosPreset::Latched));
        let strict = AnnouncedQos { deadline: Some(ms(50)), ..latched };
        publisher.look(&[usual, strict], ms(0));
        publisher.look(&[usual, strict], SETTLE);
        let fitted = Qos {
            durability: Durability::TransientLocal,
            deadline: Some(ms(50)),
            ..Qos::default()
        };
        assert_eq!(publisher.qos, fitted);
        publisher.look(&[usual], ms(1000));
        assert_eq!(publisher.qos, fitted);
        publisher.look(&[usual], ms(1000) + CALM);
        assert_eq!(publisher.qos, Qos { deadline: None, ..fitted });
        assert_eq!(publisher.look(&[usual], ms(60_000)), Decision::Keep);
    }
}
