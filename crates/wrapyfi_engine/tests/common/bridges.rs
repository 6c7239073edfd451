//! Bridges of simulations: what they carry, and what goes wrong at their ends.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use wrapyfi_endpoint::{DropReason, Registry};
use wrapyfi_engine::{Engine, Plan, RouteStatus};

use super::seeds::Dice;
use super::{Faulty, Hand, Readers, plan, registry, types};

/// Names of what is carried; the first few are for written routes.
pub const NAMES: [&str; 6] = ["w0", "w1", "w2", "p0", "p1", "p2"];

/// Reasons for which a fault of an end may have a message dropped, whatever the settings of its route.
const ALWAYS: [DropReason; 4] = [
    DropReason::NoConsumer,
    DropReason::SendFailed,
    DropReason::Closed,
    DropReason::ConnectionLost,
];

/// Kind of a bridge's routes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Carries {
    Topics,
    Services,
}

/// Settings of a written route.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// Depth of the queue, or a tenth of a second for each call.
    pub depth: usize,
    pub overflow: &'static str,
    /// True where the quality of service allows a transport to lose messages.
    pub may_lose: bool,
}

impl Policy {
    fn roll(dice: &mut Dice) -> Self {
        let overflow = ["drop_oldest", "drop_newest", "{ block_ms: 20 }"][dice.below(3)];
        Self { depth: [5, 50][dice.below(2)], overflow, may_lose: dice.one_in(2) }
    }

    /// Reasons for which a message may be dropped that the route alone decides.
    fn allows(&self) -> Vec<DropReason> {
        let full = match self.overflow {
            "drop_oldest" | "drop_newest" => DropReason::QueueFull,
            _ => DropReason::BlockDeadline,
        };
        let transport = match self.may_lose {
            true => &[DropReason::LostUpstream, DropReason::Stalled][..],
            false => &[DropReason::SendQueueFull],
        };
        [&[full][..], transport].concat()
    }
}

/// Routes that a bridge is told to carry.
#[derive(Clone, Debug)]
pub struct Wishes {
    /// Settings of each written route; none where it is not wanted.
    pub written: [Option<Policy>; 3],
    /// Names that the pattern leaves out; none where there is no pattern.
    pub denied: Option<Vec<&'static str>>,
    pub eager: bool,
}

impl Wishes {
    pub fn roll(dice: &mut Dice) -> Self {
        let written = std::array::from_fn(|_| (!dice.one_in(4)).then(|| Policy::roll(dice)));
        let deny = |dice: &mut Dice| {
            NAMES[3..].iter().copied().filter(|_| dice.one_in(4)).collect::<Vec<_>>()
        };
        let denied = (!dice.one_in(5)).then(|| deny(dice));
        Self { written, denied, eager: dice.one_in(2) }
    }

    fn routes(&self, [from, to]: [&str; 2], carries: Carries) -> Vec<String> {
        let [from_key, to_key] = match carries {
            Carries::Topics => ["from", "to"],
            Carries::Services => ["service", "as"],
        };
        let route = |from_name: &str, to_name: &str, rest: &str| {
            let ends = format!("{from_key}: '{from}:/{from_name}', {to_key}: '{to}:/{to_name}'");
            format!("{ends}, type: NativeObject, {rest}")
        };
        let written = |(n, policy): (usize, &Option<Policy>)| {
            let Policy { depth, overflow, may_lose } = (*policy)?;
            let name = format!("w{n}");
            let rest = match carries {
                Carries::Topics => {
                    let qos = if may_lose { "sensor_data" } else { "default" };
                    format!("queue_depth: {depth}, overflow: {overflow}, qos: {qos}")
                }
                Carries::Services => format!("timeout_ms: {}", depth * 100),
            };
            Some(route(&name, &name, &rest))
        };
        let mut routes: Vec<String> = self.written.iter().enumerate().filter_map(written).collect();
        if let Some(denied) = &self.denied {
            let denied: Vec<String> = denied.iter().map(|name| format!("'{name}'")).collect();
            let rest = match carries {
                Carries::Topics => format!("lazy: {}, ", !self.eager),
                Carries::Services => String::new(),
            };
            let rest = format!("{rest}deny: [{}]", denied.join(", "));
            routes.push(route("(p.*)", "$1", &rest));
        }
        routes
    }

    pub fn wants(&self, topic: &str) -> bool {
        match topic.strip_prefix('w') {
            Some(n) => self.written[n.parse::<usize>().unwrap()].is_some(),
            None => self.denied.as_ref().is_some_and(|denied| !denied.contains(&topic)),
        }
    }
}

/// A bridge, and the buses as it sees them.
pub struct Bridge {
    pub engine: Engine,
    pub ends: [Arc<Faulty>; 2],
    pub names: [&'static str; 2],
    pub wishes: Wishes,
    /// Reasons for which messages of each route may be dropped by the settings that it has had.
    allowed: BTreeMap<String, BTreeSet<&'static str>>,
    carries: Carries,
    clock: Hand,
}

impl Bridge {
    pub fn new(
        buses: [&Arc<Faulty>; 2],
        names: [&'static str; 2],
        carries: Carries,
        clock: &Hand,
        dice: &mut Dice,
    ) -> Self {
        let ends = buses.map(|bus| bus.seen_by_another());
        let (engine, wishes) = (Engine::new(Plan::default(), &Registry::new()), Wishes::roll(dice));
        let (allowed, clock) = (BTreeMap::new(), clock.clone());
        let mut bridge = Self { engine, ends, names, wishes, allowed, carries, clock };
        bridge.restart();
        bridge
    }

    fn plan(&self) -> Plan {
        plan(&self.wishes.routes(self.names, self.carries))
    }

    fn registry(&self) -> Registry {
        let mut registry = registry(&[&self.ends[0], &self.ends[1]]);
        registry.set_clock(self.clock.clock());
        registry
    }

    pub fn step(&mut self) {
        self.engine.step(self.clock.now());
    }

    pub fn change_plan(&mut self, dice: &mut Dice) {
        self.wishes = Wishes::roll(dice);
        self.allow();
        self.engine.apply(self.plan(), types(), self.registry()).unwrap();
    }

    /// Ends the bridge; another takes its place with the same plan.
    pub fn restart(&mut self) {
        // An end that panics as it closes would end a bridge that is not run by threads.
        self.ends.iter().for_each(|end| end.change(|faults| faults.panics_in = None));
        self.engine = Engine::new(Plan::default(), &Registry::new());
        self.engine = Engine::new(self.plan(), &self.registry()).with_types(types());
        self.allowed.clear();
        self.allow();
    }

    /// Enters what the settings of now allow: a route keeps its counters where it gets other ones.
    fn allow(&mut self) {
        let pattern = Policy { depth: 10, overflow: "drop_oldest", may_lose: false };
        for (n, name) in NAMES.iter().enumerate() {
            let policy = self.wishes.written.get(n).copied().unwrap_or(Some(pattern));
            let reasons = policy.iter().flat_map(Policy::allows).map(DropReason::as_str);
            let route = self.name_of(name);
            self.allowed.entry(route).or_default().extend(reasons);
        }
    }

    /// First reason for which a route has dropped messages, though neither its settings nor a fault allow it.
    pub fn dropped_wrongly(&self, route: &RouteStatus) -> Option<DropReason> {
        let allowed = self.allowed.get(&route.name);
        let is_wrong = |why: &DropReason| {
            !ALWAYS.contains(why) && !allowed.is_some_and(|it| it.contains(why.as_str()))
        };
        route.counters.drops.iter().map(|(why, _)| *why).find(is_wrong)
    }

    pub fn go_wrong(&mut self, dice: &mut Dice) {
        let send = if self.carries == Carries::Topics { "publish" } else { "reply" };
        let place = [None, None, Some("take"), Some(send), Some("open"), Some("look")];
        let more =
            [Some("learn"), Some("drop"), (self.carries == Carries::Services).then_some("send")];
        let faulty = &self.ends[dice.below(2)];
        faulty.change(|faults| {
            faults.refuses_to_open = dice.one_in(3);
            faults.sends_fail = dice.one_in(3);
            faults.messages_are_late = dice.one_in(3);
            faults.messages_come_twice = dice.one_in(3);
            faults.messages_are_lost = dice.one_in(3);
            faults.readers = [Readers::Read, Readers::Slow, Readers::Stopped][dice.below(3)];
            faults.is_cut = dice.one_in(6);
            faults.panics_in =
                if dice.one_in(2) { place[dice.below(6)] } else { more[dice.below(3)] };
            faults.away = dice.one_in(4).then(|| "injected: it sees nothing".to_owned());
        });
    }

    pub fn routes(&self) -> Vec<RouteStatus> {
        let all = self.engine.status().into_iter();
        all.filter(|it| it.pattern.is_none() && it.message_type != "unknown").collect()
    }

    pub fn name_of(&self, topic: &str) -> String {
        let [from, to] = self.names;
        match self.carries {
            Carries::Topics => format!("{from}:/{topic} -> {to}:/{topic}"),
            Carries::Services => format!("{to}:/{topic} -> {from}:/{topic}"),
        }
    }
}
