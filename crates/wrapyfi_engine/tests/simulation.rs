//! Two bridges on three buses, with the faults that a seed chooses, under an invented clock.
//!
//! ```text
//!   sources ─▶ bus a ─ bridge 1 ─▶ bus b ─ bridge 2 ─▶ bus c ─▶ listeners
//!                │ faults of each bridge's ends: refusal, failing sends, late, repeated and lost messages, slow and
//!                │ stopped readers, lost connections, panics, no discovery
//!                └ peers and bridges that come, go, restart and read nothing; plans that change
//!   at the end: all is healed, every route that the last plan wants is active and carries a message
//! ```
//!
//! Checks: a route publishes only messages that it took, in that order and no more often; a
//! listener on c hears only messages that were published there, in that order; every message is
//! accounted for (`received = sent + dropped`), and none is dropped for a reason that neither a fault nor the
//! settings of its route give: lost by a transport only under best effort, for want of room only as the policy of
//! the queue says.
//!
//! Seeds are run as `common/seeds.rs` says.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use crate::common::bridges::{Bridge, Carries, NAMES};
use crate::common::seeds::{Dice, every_seed, quiet_about_injected};
use crate::common::{Faulty, Hand, History, drain, listener, number, publisher};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{DropReason, Listener, Publisher};
use wrapyfi_engine::RouteState;

/// Turns in which things go wrong.
const TURNS: usize = 120;
/// Time after the last fault in which every route must be active again.
const HEALED_WITHIN: Duration = Duration::from_secs(120);

/// Buses, bridges and clock of one seed.
struct Simulation {
    dice: Dice,
    buses: [Memory; 3],
    bridges: [Bridge; 2],
    sources: BTreeMap<&'static str, Box<dyn Publisher>>,
    sinks: BTreeMap<&'static str, Box<dyn Listener>>,
    /// Topics whose listeners on c read nothing.
    stopped: BTreeSet<&'static str>,
    numbers: BTreeMap<&'static str, i64>,
    /// Numbers that came to c, and how far they are found in what was published there.
    heard: BTreeMap<&'static str, (Vec<i64>, usize)>,
    clock: Hand,
    /// Reasons for which messages were dropped.
    met: BTreeSet<&'static str>,
}

impl Simulation {
    fn new(seed: u64) -> Self {
        let (mut dice, clock) = (Dice(seed), Hand::new());
        let buses = ["a", "b", "c"].map(Faulty::new);
        let bridges = [
            Bridge::new([&buses[0], &buses[1]], ["a", "b"], Carries::Topics, &clock, &mut dice),
            Bridge::new([&buses[1], &buses[2]], ["b", "c"], Carries::Topics, &clock, &mut dice),
        ];
        let buses = buses.map(|bus| bus.bus.clone());
        let (sources, sinks) = (BTreeMap::new(), BTreeMap::new());
        let (stopped, met) = (BTreeSet::new(), BTreeSet::new());
        let (numbers, heard) = (BTreeMap::new(), BTreeMap::new());
        Self { dice, buses, bridges, sources, sinks, stopped, numbers, heard, clock, met }
    }

    fn publish(&mut self, topic: &'static str) {
        let n = self.numbers.entry(topic).or_default();
        *n += 1;
        if let Some(source) = self.sources.get_mut(topic) {
            source.publish(&number(*n)).unwrap();
        }
    }

    fn step(&mut self, time: Duration) {
        self.clock.advance(time);
        self.bridges.iter_mut().for_each(Bridge::step);
    }

    /// One thing happens.
    fn turn(&mut self) {
        let topic = NAMES[self.dice.below(NAMES.len())];
        match self.dice.below(16) {
            0 => _ = self.sources.remove(topic),
            1 | 2 => {
                _ = self.sources.insert(topic, publisher(&self.buses[0], &format!("/{topic}")));
            }
            3 => _ = self.sinks.remove(topic),
            4 | 5 => self.listen(topic),
            6 => {
                let which = self.dice.below(2);
                self.bridges[which].change_plan(&mut self.dice);
            }
            7 => {
                let which = self.dice.below(2);
                self.bridges[which].go_wrong(&mut self.dice);
            }
            8 => {
                let which = self.dice.below(2);
                self.bridges[which].restart();
            }
            9 => {
                // Restarts within a moment: the bridge sees one peer where the other was.
                if self.sources.contains_key(topic) {
                    self.sources.insert(topic, publisher(&self.buses[0], &format!("/{topic}")));
                }
                if self.sinks.contains_key(topic) {
                    self.listen_to_all();
                    self.listen(topic);
                }
            }
            10 => _ = self.stopped.insert(topic),
            11 => _ = self.stopped.remove(topic),
            12 | 13 => {
                let (which, end) = (self.dice.below(2), self.dice.below(2));
                self.bridges[which].ends[end].heal();
            }
            _ => (0..self.dice.below(30)).for_each(|_| self.publish(topic)),
        }
        for topic in NAMES {
            if self.dice.one_in(2) {
                self.publish(topic);
            }
        }
        let pause = [20, 50, 100, 500, 1500][self.dice.below(5)];
        self.step(Duration::from_millis(pause));
    }

    fn listen(&mut self, topic: &'static str) {
        let depth = [3, 100_000][self.dice.below(2)];
        self.sinks.insert(topic, listener(&self.buses[2], &format!("/{topic}"), depth));
    }

    fn listen_to_all(&mut self) {
        for (topic, sink) in &mut self.sinks {
            if self.stopped.contains(topic) {
                continue;
            }
            self.heard.entry(topic).or_default().0.extend(drain(sink.as_mut()));
        }
    }

    /// Checks the invariants that hold at any time.
    fn check(&mut self) {
        let published = self.bridges[1].ends[1].histories();
        for (topic, (heard, place)) in &mut self.heard {
            let all = published.get(&format!("/{topic}")).map_or(&[][..], |it| &it.published);
            for n in heard.drain(..) {
                let found = all[*place..].iter().position(|published| *published == n);
                let found = found.unwrap_or_else(|| {
                    panic!("{topic}: {n} was heard without being published, twice, or too late")
                });
                *place += found + 1;
            }
        }
        for bridge in &self.bridges {
            let [source, sink] = bridge.ends.each_ref().map(|end| end.histories());
            for (topic, History { published, .. }) in &sink {
                let taken = source.get(topic).map_or(&[][..], |history| &history.taken);
                let mut of_source = taken.iter();
                for n in published {
                    assert!(
                        of_source.any(|taken| taken == n),
                        "{topic}: {n} was published without being taken, twice, or too late"
                    );
                }
            }
            for route in bridge.routes() {
                assert_eq!(bridge.dropped_wrongly(&route), None, "{route:?}");
                self.met.extend(route.counters.drops.iter().map(|(why, _)| why.as_str()));
            }
        }
    }

    fn heal(&mut self) {
        for end in self.bridges.iter().flat_map(|bridge| &bridge.ends) {
            end.heal();
        }
        self.stopped.clear();
        for topic in NAMES {
            let source = publisher(&self.buses[0], &format!("/{topic}"));
            self.sources.entry(topic).or_insert(source);
            if !self.sinks.contains_key(topic) {
                self.listen(topic);
            }
        }
        // A topic that goes by the first bridge only shows on b, where only the second would publish it.
        let end = self.clock.now() + HEALED_WITHIN;
        loop {
            self.step(Duration::from_millis(200));
            let idle = self.unhealed();
            if idle.is_empty() {
                break;
            }
            assert!(self.clock.now() < end, "not active again: {idle:#?}");
        }
        // What was under way has come through.
        (0..20).for_each(|_| self.step(Duration::from_millis(20)));
        self.listen_to_all();
        self.check();
        for topic in NAMES {
            self.publish(topic);
        }
        (0..20).for_each(|_| self.step(Duration::from_millis(20)));
        for topic in NAMES {
            let heard = drain(self.sinks.get_mut(topic).unwrap().as_mut());
            let whole_way = self.bridges.iter().all(|bridge| bridge.wishes.wants(topic));
            let wanted = if whole_way { vec![self.numbers[topic]] } else { Vec::new() };
            assert_eq!(heard, wanted, "{topic} on c");
        }
        for bridge in &self.bridges {
            for route in bridge.routes() {
                let counters = &route.counters;
                let accounted = counters.sent + counters.dropped();
                assert_eq!(counters.received, accounted, "{}: {counters:?}", route.name);
            }
        }
    }

    /// Routes that are wanted and not active, and those that run unwanted.
    fn unhealed(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (index, bridge) in self.bridges.iter().enumerate() {
            let routes = bridge.routes();
            for topic in NAMES {
                let name = bridge.name_of(topic);
                let route = routes.iter().find(|route| route.name == name);
                let wants = bridge.wishes.wants(topic);
                let before = index == 0 || self.bridges[0].wishes.wants(topic);
                let behind = index == 1 || self.bridges[1].wishes.wants(topic);
                match (wants, route) {
                    // A pattern makes a route where there is a source, and a lazy one opens where a program listens.
                    (true, None) if !before && topic.starts_with('p') => {}
                    (true, Some(route)) if !before || !behind => {
                        if !matches!(route.state, RouteState::Waiting(_) | RouteState::Active) {
                            found.push(format!("{} {}", route.name, route.state));
                        }
                    }
                    (true, Some(route)) if route.state == RouteState::Active => {}
                    (true, route) => {
                        let state = route.map(|route| route.state.to_string());
                        found.push(format!("{} {topic}: {state:?}", bridge.names[0]));
                    }
                    (false, None) => {}
                    (false, Some(route)) => found.push(format!("{} is not wanted", route.name)),
                }
            }
        }
        found
    }
}

/// Runs a seed; reasons for which messages were dropped.
fn run(seed: u64) -> BTreeSet<&'static str> {
    let mut simulation = Simulation::new(seed);
    for turn in 0..TURNS {
        simulation.turn();
        simulation.listen_to_all();
        if turn % 10 == 9 {
            simulation.check();
        }
    }
    simulation.heal();
    simulation.met
}

#[test]
fn whatever_goes_wrong_no_message_is_unaccounted_for_and_every_route_comes_back() {
    every_seed("simulation::", |seed| drop(run(seed)));
}

/// Each fault costs messages somewhere, so that none is there in name only.
#[test]
fn every_reason_for_a_loss_is_met() {
    quiet_about_injected();
    let met: BTreeSet<_> = (0..100).flat_map(run).collect();
    let all = [
        DropReason::BlockDeadline,
        DropReason::Closed,
        DropReason::ConnectionLost,
        DropReason::LostUpstream,
        DropReason::NoConsumer,
        DropReason::QueueFull,
        DropReason::SendFailed,
        DropReason::SendQueueFull,
        DropReason::Stalled,
    ];
    assert_eq!(met, all.map(DropReason::as_str).into());
}
