//! Calls through two bridges on three buses, with everything going wrong that a seed says, under an invented clock.
//!
//! ```text
//!   servers ◀─ bus a ◀─ bridge 1 ◀─ bus b ◀─ bridge 2 ◀─ bus c ◀─ clients
//!     │ answer, refuse, answer late and in any order, never, stop, restart
//!     └ the buses lose, delay and double requests and replies; the ends of bridges refuse, fail and panic; bridges
//!       restart; plans change
//!   at the end: all is healed, every route that the last plan wants is active and answers
//! ```
//!
//! Checks: every call ends once, with the reply to its own request or with an error in words, and not after
//! its deadline; no request is carried out twice that the wire did not double, nor before one that was sent earlier;
//! no request or reply is unaccounted for (`received = sent + dropped`), and none dropped for a reason that no fault
//! gives; nothing is under way any more at the end.
//!
//! Seeds are run as `common/seeds.rs` says.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::common::bridges::{Bridge, Carries, NAMES};
use crate::common::seeds::{Dice, every_seed};
use crate::common::{Faulty, Hand, number, number_of};
use wrapyfi_data::types::{ServiceKind, Value};
use wrapyfi_endpoint::memory::{Carriage, Fate, Memory, Way};
use wrapyfi_endpoint::{
    CallError, Client, Counters, DropReason, Middleware, Request, RequestId, ServeError, Server,
    ServiceSpec, Ticket,
};
use wrapyfi_engine::RouteState;

/// Turns in which things go wrong.
const TURNS: usize = 60;
/// Time after the last fault in which every route must be active again.
const HEALED_WITHIN: Duration = Duration::from_secs(120);
/// Time after which no call and no request is under way any more.
const ALL_OVER_AFTER: Duration = Duration::from_secs(15);
/// Calls of each service after everything is healed, all of which are answered.
const LAST_CALLS: u64 = 5;
const STEP: Duration = Duration::from_millis(20);
/// Reasons for which faults may have a request dropped.
const MAY_DROP: [DropReason; 5] = [
    DropReason::Expired,
    DropReason::Refused,
    DropReason::Overloaded,
    DropReason::SendFailed,
    DropReason::Closed,
];

/// Faults of the wires.
struct Wires {
    dice: Dice,
    is_bad: bool,
    /// True where requests arrive once and in order, or not at all.
    keeps_requests: bool,
    doubled: usize,
}

impl Wires {
    fn fate(&mut self, way: Way) -> Fate {
        if !self.is_bad {
            return Fate::Arrives;
        }
        match self.dice.below(12) {
            0 => Fate::Lost,
            1 | 2 if way == Way::Reply || !self.keeps_requests => Fate::Late,
            3 if way == Way::Reply || !self.keeps_requests => {
                self.doubled += usize::from(way == Way::Request);
                Fate::Twice
            }
            _ => Fate::Arrives,
        }
    }
}

/// A server of bus a.
struct Serving {
    server: Box<dyn Server>,
    counters: Arc<Counters>,
    /// Requests that are answered later, if at all.
    held: Vec<(RequestId, i64)>,
}

/// A call that has not ended.
struct Pending {
    n: i64,
    deadline: Instant,
}

/// A client of bus c.
struct Calling {
    client: Box<dyn Client>,
    counters: Arc<Counters>,
    pending: BTreeMap<Ticket, Pending>,
    replies: u64,
}

/// Buses, bridges, clients, servers and clock of one seed.
struct Simulation {
    dice: Dice,
    clock: Hand,
    buses: [Memory; 3],
    wires: Arc<Mutex<Wires>>,
    bridges: [Bridge; 2],
    servers: BTreeMap<&'static str, Serving>,
    clients: BTreeMap<&'static str, Calling>,
    /// Requests as the servers carried them out.
    done: BTreeMap<&'static str, Vec<i64>>,
    asked: i64,
    /// True where every request is answered at once.
    is_kind: bool,
}

fn spec(name: &str) -> ServiceSpec {
    ServiceSpec::new(format!("/{name}"), ServiceKind::NativeObject)
}

impl Simulation {
    fn new(seed: u64) -> Self {
        let (mut dice, clock) = (Dice(seed), Hand::new());
        let own = Dice(dice.next());
        let keeps_requests = dice.one_in(2);
        let wires = Wires { dice: own, is_bad: false, keeps_requests, doubled: 0 };
        let wires = Arc::new(Mutex::new(wires));
        let buses = ["a", "b", "c"].map(Faulty::new);
        for bus in &buses {
            let wires = Arc::clone(&wires);
            bus.bus.carry_services(Carriage::new(move |way| wires.lock().unwrap().fate(way)));
        }
        let bridge = |at: usize, names: [&'static str; 2], dice: &mut Dice| {
            let ends = [&buses[at], &buses[at + 1]];
            Bridge::new(ends, names, Carries::Services, &clock, dice)
        };
        let bridges = [bridge(0, ["a", "b"], &mut dice), bridge(1, ["b", "c"], &mut dice)];
        Self {
            dice,
            clock,
            buses: buses.map(|bus| bus.bus.clone()),
            wires,
            bridges,
            servers: BTreeMap::new(),
            clients: BTreeMap::new(),
            done: BTreeMap::new(),
            asked: 0,
            is_kind: false,
        }
    }

    fn serve(&mut self, name: &'static str) {
        // One at a time: two would be asked in turn.
        self.servers.remove(name);
        let context = self.clock.context();
        let server = self.buses[0].open_server(&spec(name), &context).unwrap();
        let serving = Serving { server, counters: context.counters, held: Vec::new() };
        self.servers.insert(name, serving);
    }

    fn open_client(&mut self, name: &'static str) {
        let context = self.clock.context();
        let client = self.buses[2].open_client(&spec(name), &context).unwrap();
        let calling =
            Calling { client, counters: context.counters, pending: BTreeMap::new(), replies: 0 };
        self.clients.insert(name, calling);
    }

    fn call(&mut self, name: &'static str, timeout: Duration) {
        let Some(calling) = self.clients.get_mut(name) else { return };
        self.asked += 1;
        let (n, deadline) = (self.asked, self.clock.now() + timeout);
        match calling.client.send(&Request::new([Value::Int(n)]), timeout) {
            Ok(ticket) => {
                let before = calling.pending.insert(ticket, Pending { n, deadline });
                assert!(before.is_none(), "{name}: {ticket:?} was given twice");
            }
            Err(CallError::TooMany { .. }) => {}
            Err(error) => panic!("{name}: {error}"),
        }
    }

    fn step(&mut self, time: Duration) {
        self.clock.advance(time);
        self.bridges.iter_mut().for_each(Bridge::step);
        for name in NAMES {
            self.answer(name);
            self.listen(name);
        }
    }

    /// Lets the server of a name do as the seed says.
    fn answer(&mut self, name: &'static str) {
        let Some(Serving { server, held, .. }) = self.servers.get_mut(name) else { return };
        while let Some(asked) = server.take().unwrap() {
            let call = asked.request.into_call().unwrap();
            let n = call.args[0].as_i64().unwrap();
            self.done.entry(name).or_default().push(n);
            match if self.is_kind { 0 } else { self.dice.below(8) } {
                0..4 => drop(server.reply(asked.id, Ok(number(n))).unwrap()),
                4 => drop(server.reply(asked.id, Err(format!("no {n}").into())).unwrap()),
                5 | 6 => held.push((asked.id, n)),
                _ => {}
            }
        }
        while !held.is_empty() && (self.is_kind || self.dice.one_in(4)) {
            let (id, n) = held.swap_remove(self.dice.below(held.len()));
            match server.reply(id, Ok(number(n))) {
                Ok(_) | Err(ServeError::NotWaiting { .. }) => {}
                Err(error) => panic!("{name}: {error}"),
            }
        }
    }

    fn listen(&mut self, name: &'static str) {
        let Some(calling) = self.clients.get_mut(name) else { return };
        while let Some((ticket, result)) = calling.client.take() {
            let pending = calling.pending.remove(&ticket);
            let Some(Pending { n, .. }) = pending else {
                panic!("{name}: {ticket:?} ended twice, or was never made: {result:?}")
            };
            match result {
                Ok(reply) => {
                    assert_eq!(number_of(&reply.payload), n, "{name}: a reply to another request");
                    calling.replies += 1;
                }
                Err(CallError::Refused { reason, .. }) => {
                    assert!(!reason.is_empty(), "{name}: {n} was refused without a word");
                    calling.replies += 1;
                }
                Err(CallError::TimedOut { why, .. }) => {
                    assert!(!why.is_empty(), "{name}: nobody says why {n} took too long");
                }
                Err(error) => panic!("{name}: {n}: {error}"),
            }
        }
        let now = self.clock.now();
        for (ticket, Pending { n, deadline }) in &calling.pending {
            assert!(*deadline > now, "{name}: {ticket:?} of {n} goes on after its deadline");
        }
    }

    /// Lets one thing happen, and time pass.
    fn turn(&mut self) {
        let name = NAMES[self.dice.below(NAMES.len())];
        let which = self.dice.below(2);
        match self.dice.below(14) {
            0 => _ = self.servers.remove(name),
            1 | 2 => self.serve(name),
            3 => _ = self.clients.remove(name),
            4 | 5 => self.open_client(name),
            6 => self.bridges[which].change_plan(&mut self.dice),
            7 => self.bridges[which].go_wrong(&mut self.dice),
            8 => self.bridges[which].restart(),
            9 | 10 => self.bridges[which].ends[self.dice.below(2)].heal(),
            11 => self.wires.lock().unwrap().is_bad ^= true,
            _ => {
                for _ in 0..self.dice.below(90) {
                    self.call(name, Duration::from_secs(1));
                }
            }
        }
        for _ in 0..=self.dice.below(4) {
            for name in NAMES {
                if self.dice.one_in(2) {
                    let timeout = [100, 1000, 4000][self.dice.below(3)];
                    self.call(name, Duration::from_millis(timeout));
                }
            }
            let pause = [5, 20, 20, 50, 100, 500, 1500, 3000][self.dice.below(8)];
            self.step(Duration::from_millis(pause));
        }
    }

    /// Checks what holds at any time.
    fn check(&self) {
        let wires = self.wires.lock().unwrap();
        let mut again = 0;
        for (name, done) in &self.done {
            let mut once = done.clone();
            once.sort_unstable();
            once.dedup();
            again += done.len() - once.len();
            if wires.keeps_requests {
                assert!(done.is_sorted(), "{name}: not in the order of the calls: {done:?}");
            }
        }
        assert!(again <= wires.doubled, "{again} requests were carried out again");
        for route in self.bridges.iter().flat_map(Bridge::routes) {
            let other = route.counters.drops.iter().find(|(why, _)| !MAY_DROP.contains(why));
            assert_eq!(other, None, "{route:?}");
        }
    }

    fn heal(&mut self) {
        for end in self.bridges.iter().flat_map(|bridge| &bridge.ends) {
            end.heal();
        }
        self.wires.lock().unwrap().is_bad = false;
        self.is_kind = true;
        for name in NAMES {
            if !self.servers.contains_key(name) {
                self.serve(name);
            }
            if !self.clients.contains_key(name) {
                self.open_client(name);
            }
        }
        let end = self.clock.now() + HEALED_WITHIN;
        loop {
            self.step(Duration::from_millis(200));
            let idle = self.unhealed();
            if idle.is_empty() {
                break;
            }
            assert!(self.clock.now() < end, "not active again: {idle:#?}");
        }
        self.rest();
        let before: BTreeMap<_, _> =
            self.clients.iter().map(|(name, calling)| (*name, calling.replies)).collect();
        for name in NAMES {
            (0..LAST_CALLS).for_each(|_| self.call(name, Duration::from_secs(1)));
        }
        (0..20).for_each(|_| self.step(STEP));
        for name in NAMES {
            let whole_way = self.bridges.iter().all(|bridge| bridge.wishes.wants(name));
            let Calling { pending, replies, .. } = &self.clients[name];
            let found = (pending.is_empty(), replies - before[name]);
            let wanted = if whole_way { LAST_CALLS } else { 0 };
            assert_eq!(found, (whole_way, wanted), "{name} on c");
        }
        self.rest();
        self.check();
    }

    /// Waits until every call is over, and counts what has come of all.
    fn rest(&mut self) {
        let end = self.clock.now() + ALL_OVER_AFTER;
        while self.clock.now() < end {
            self.step(Duration::from_millis(100));
        }
        for (name, Calling { counters, pending, replies, .. }) in &self.clients {
            assert!(pending.is_empty(), "{name}: calls go on");
            let counted = counters.snapshot();
            let late = counted.dropped_for(DropReason::Late);
            assert_eq!(counted.received, replies + late, "{name}: {counted:?}");
        }
        for (name, Serving { counters, .. }) in &self.servers {
            let counted = counters.snapshot();
            assert_eq!(counted.received, counted.sent + counted.dropped(), "{name}: {counted:?}");
        }
        for bridge in &self.bridges {
            let routes = bridge.routes();
            for route in &routes {
                let counters = &route.counters;
                let accounted = counters.sent + counters.dropped();
                assert_eq!(counters.received, accounted, "{}: {counters:?}", route.name);
            }
            for (service, history) in bridge.ends[0].histories() {
                let name = bridge.name_of(service.trim_start_matches('/'));
                if routes.iter().any(|route| route.name == name) {
                    assert_eq!(history.under_way, 0, "{name}: calls of the bridge go on");
                }
            }
        }
    }

    /// Routes that are wanted and not active, and those that run unwanted.
    fn unhealed(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (index, bridge) in self.bridges.iter().enumerate() {
            let routes = bridge.routes();
            for name in NAMES {
                let route = routes.iter().find(|route| route.name == bridge.name_of(name));
                let is_offered = index == 0 || self.bridges[0].wishes.wants(name);
                let state = route.map(|route| &route.state);
                let is_right = match (bridge.wishes.wants(name), state) {
                    (false, state) => state.is_none(),
                    (true, Some(RouteState::Active)) => is_offered,
                    (true, Some(RouteState::Waiting(_))) => !is_offered,
                    // A pattern makes a route where there is a server.
                    (true, None) => !is_offered && name.starts_with('p'),
                    (true, Some(_)) => false,
                };
                if !is_right {
                    let state = state.map(ToString::to_string);
                    found.push(format!("{}: {state:?}", bridge.name_of(name)));
                }
            }
        }
        found
    }
}

fn run(seed: u64) {
    let mut simulation = Simulation::new(seed);
    for turn in 0..TURNS {
        simulation.turn();
        if turn % 10 == 9 {
            simulation.check();
        }
    }
    simulation.heal();
}

#[test]
fn whatever_goes_wrong_every_call_ends_once_and_every_service_answers_again() {
    every_seed("simulation_services::", run);
}
