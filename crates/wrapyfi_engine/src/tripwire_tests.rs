//! Loops through other bridges and what only looks like one, under an invented clock that ticks each millisecond.

use std::collections::BTreeSet;

use super::super::relay::Relay;
use super::super::work::Work as _;
use super::*;
use wrapyfi_data::types::{MessageType, Value};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{
    Context, Listener, Middleware, Overflow, Publisher, QueueSpec, Registry, TopicSpec,
};

const MS: Duration = Duration::from_millis(1);

/// Two middlewares and the routes between them, some of which are of one bridge.
struct Network {
    registry: Registry,
    sides: [Arc<Memory>; 2],
    routes: Vec<Relay>,
    now: Instant,
    /// Setting of the routes that begin.
    loop_guard: bool,
    /// Words of the states that were seen.
    seen: BTreeSet<&'static str>,
}

impl Network {
    fn new() -> Self {
        let sides = ["a", "b"].map(|name| Arc::new(Memory::new(name)));
        let mut registry = Registry::new();
        sides.iter().for_each(|side| registry.register(side.clone()));
        let (routes, seen) = (Vec::new(), BTreeSet::new());
        Self { registry, sides, routes, now: Instant::now(), loop_guard: true, seen }
    }

    /// Starts a bridge with routes.
    fn bridge(&mut self, routes: &[(&str, &str)]) {
        let lanes = Arc::new(Lanes::default());
        for (from, to) in routes {
            let ends = (from.parse().unwrap(), to.parse().unwrap());
            let mut route = Route::topic(ends.0, ends.1, MessageType::NativeObject);
            route.policy.loop_guard = self.loop_guard;
            route.policy.queue = QueueSpec { depth: 200, overflow: Overflow::DropOldest };
            let number = self.routes.len() as u64;
            self.routes.push(Relay::new(
                route,
                &self.registry,
                number,
                Context::default(),
                lanes.clone(),
            ));
        }
        self.tick(10, |_, _| ());
        self.seen.clear();
    }

    fn spec(topic: &str) -> TopicSpec {
        let queue = QueueSpec { depth: 100_000, overflow: Overflow::DropOldest };
        TopicSpec { queue, ..TopicSpec::new(topic, MessageType::NativeObject) }
    }

    fn publisher(&self, side: usize, topic: &str) -> Box<dyn Publisher> {
        self.sides[side].open_publisher(&Self::spec(topic), &Context::default()).unwrap()
    }

    fn listener(&self, side: usize, topic: &str) -> Box<dyn Listener> {
        self.sides[side].open_listener(&Self::spec(topic), &Context::default()).unwrap()
    }

    /// Lets milliseconds pass, each with an act and a step of all routes.
    fn tick(&mut self, ms: u64, mut act: impl FnMut(u64, Instant)) {
        for n in 0..ms {
            self.now += MS;
            act(n, self.now);
            for route in &mut self.routes {
                route.step(self.now);
                self.seen.insert(route.status().state.word());
            }
        }
    }

    fn state(&self, route: usize) -> String {
        self.routes[route].status().state.to_string()
    }

    fn sent(&self) -> u64 {
        self.routes.iter().map(|route| route.status().counters.sent).sum()
    }

    /// Asserts that every message that came is accounted for.
    fn is_accounted(&self) {
        for route in &self.routes {
            let counters = route.status().counters;
            assert_eq!(counters.received, counters.sent + counters.dropped(), "{counters:?}");
        }
    }

    /// Asserts that nothing is under way, and that a route says why.
    fn has_stopped(&mut self) {
        let before = self.sent();
        self.tick(500, |_, _| ());
        assert_eq!(self.sent(), before, "messages still go round");
        let states: Vec<_> = (0..self.routes.len()).map(|route| self.state(route)).collect();
        let is_told = |state: &String| state.starts_with("error: loop: what this route sends to ");
        assert!(states.iter().any(is_told), "{states:?}");
        self.is_accounted();
    }
}

fn number(n: i64) -> Payload {
    Payload::from(Value::Int(n))
}

fn drain(listener: &mut dyn Listener) -> usize {
    std::iter::from_fn(|| listener.take().unwrap()).count()
}

#[test]
fn one_message_between_two_bridges_is_stopped_and_a_mended_set_up_recovers() {
    let mut network = Network::new();
    network.bridge(&[("a:/x", "b:/x")]);
    network.bridge(&[("b:/x", "a:/x")]);
    let mut talker = network.publisher(0, "/x");
    talker.publish(&number(1)).unwrap();
    network.tick(3000, |_, _| ());
    network.has_stopped();
    let state = network.state(0);
    assert!(state.contains("sends to b:/x comes back to a:/x through other programs"), "{state}");
    assert!(state.contains("leave out the route from b:/x to a:/x"), "{state}");
    // Where the loop is still there, the next message ends it again.
    network.tick(5000, |_, _| ());
    assert!(
        network.state(0).starts_with("degraded: messages pass again after a loop"),
        "{}",
        network.state(0)
    );
    talker.publish(&number(2)).unwrap();
    network.tick(3000, |_, _| ());
    network.has_stopped();
    network.routes.truncate(1);
    network.tick(10_000, |_, _| ());
    let mut ear = network.listener(1, "/x");
    network.tick(12_000, |n, _| {
        if n % 100 == 0 {
            talker.publish(&number(n as i64)).unwrap();
        }
    });
    assert_eq!(drain(ear.as_mut()), 120);
    assert_eq!(network.state(0), "active");
    network.is_accounted();
}

#[test]
fn a_route_whose_guard_is_off_goes_on() {
    let mut network = Network::new();
    network.loop_guard = false;
    network.bridge(&[("a:/x", "b:/x")]);
    network.bridge(&[("b:/x", "a:/x")]);
    network.publisher(0, "/x").publish(&number(1)).unwrap();
    network.tick(5000, |_, _| ());
    let before = network.sent();
    network.tick(100, |_, _| ());
    assert!(network.sent() > before, "{}", network.state(0));
    // Its message is always under way: the counters never come to rest.
    assert_eq!(network.state(0), "active");
}

/// A program that sends on what it hears, to where it comes from.
#[test]
fn a_loop_that_stays_is_tried_less_and_less() {
    let mut network = Network::new();
    network.bridge(&[("a:/x", "b:/x")]);
    let (mut back, mut ear) = (network.publisher(0, "/x"), network.listener(1, "/x"));
    network.publisher(0, "/x").publish(&number(1)).unwrap();
    for seconds in ["5 s", "10 s", "20 s", "40 s", "60 s", "60 s"] {
        let end = network.now + Duration::from_secs(66);
        let wanted = format!("tried again after {seconds}");
        let is_open =
            |state: String| state.starts_with("error: loop: ") && state.ends_with(&wanted);
        while !is_open(network.state(0)) {
            assert!(network.now < end, "{seconds}: {}", network.state(0));
            network.tick(1, |_, _| {
                let heard = drain(ear.as_mut());
                (0..heard).for_each(|_| _ = back.publish(&number(1)).unwrap());
            });
        }
        while !network.state(0).starts_with("degraded") {
            network.tick(1, |_, _| ());
        }
        back.publish(&number(1)).unwrap();
    }
    network.tick(1, |_, _| ());
    network.is_accounted();
}

#[test]
fn messages_that_gather_in_a_loop_are_stopped() {
    let mut network = Network::new();
    network.bridge(&[("a:/x", "b:/x")]);
    network.bridge(&[("b:/x", "a:/x")]);
    let mut talker = network.publisher(0, "/x");
    for n in 0..1200 {
        if !network.seen.contains("error") {
            talker.publish(&number(n)).unwrap();
            network.tick(10, |_, _| ());
        }
    }
    assert!(network.seen.contains("error"), "{:?}", network.seen);
    // The other bridge may be in the midst of a round, with messages that it holds.
    network.tick(2500, |_, _| ());
    network.has_stopped();
}

#[test]
fn rings_and_loops_with_bridges_in_parallel_are_stopped() {
    let (there, back) = (("a:/x", "b:/x"), ("b:/x", "a:/x"));
    for bridges in [
        vec![vec![there], vec![("b:/x", "b:/y")], vec![("b:/y", "a:/x")]],
        // Messages double with each round.
        vec![vec![there], vec![there], vec![back]],
        vec![vec![there], vec![there], vec![back], vec![back]],
        vec![vec![there, back], vec![there, back]],
    ] {
        let mut network = Network::new();
        bridges.iter().for_each(|routes| network.bridge(routes));
        network.publisher(0, "/x").publish(&number(1)).unwrap();
        for _ in 0..120 {
            if !network.seen.contains("error") {
                network.tick(100, |_, _| ());
            }
        }
        assert!(network.seen.contains("error"), "{bridges:?}");
        network.tick(2000, |_, _| ());
        network.has_stopped();
    }
}

/// Each bridge has one direction of each of two loops, so that the other loop may look like answers.
#[test]
fn two_loops_at_once_are_both_stopped() {
    let mut network = Network::new();
    network.bridge(&[("a:/x", "b:/x"), ("b:/y", "a:/y")]);
    network.bridge(&[("b:/x", "a:/x"), ("a:/y", "b:/y")]);
    network.publisher(0, "/x").publish(&number(1)).unwrap();
    network.publisher(0, "/y").publish(&number(2)).unwrap();
    let mut stopped = false;
    for _ in 0..60 {
        let before = network.sent();
        network.tick(500, |_, _| ());
        stopped |= network.sent() == before;
    }
    assert!(stopped, "{} {}", network.state(0), network.state(1));
    network.is_accounted();
}

#[test]
fn a_publisher_that_says_one_thing_is_never_stopped_and_loses_nothing() {
    // Messages at once, and milliseconds from one time to the next.
    for (count, every) in [
        (1, 1),
        (1, 2),
        (1, 9),
        (5, 1),
        (10, 65),
        (20, 37),
        (20, 100),
        (40, 128),
        (60, 90),
        (300, 777),
    ] {
        let mut network = Network::new();
        network.bridge(&[("a:/x", "b:/x")]);
        let mut talker = network.publisher(0, "/x");
        let mut ear = network.listener(1, "/x");
        let (mut said, mut heard, mut longest, mut behind) = (0, 0, 0, 0);
        network.tick(120_000, |n, _| {
            heard += drain(ear.as_mut());
            behind = if heard < said { behind + 1 } else { 0 };
            longest = longest.max(behind);
            if n % every == 0 {
                (0..count).for_each(|_| _ = talker.publish(&number(7)).unwrap());
                said += count;
            }
        });
        let what = format!("{count} each {every} ms");
        network.tick(1000, |_, _| ());
        heard += drain(ear.as_mut());
        assert!(!network.seen.contains("error"), "{what}");
        let counters = network.routes[0].status().counters;
        // The queue of 200 is shorter than 300 at once, whether a trial is on or not.
        assert!(count > 200 || heard == said, "{what}: {heard} of {said} {counters:?}");
        assert!(count > 200 || longest < 200, "{what}: messages waited for {longest} ms");
        network.is_accounted();
    }
}

#[test]
fn two_publishers_in_opposite_directions_are_no_loop() {
    let mut network = Network::new();
    network.bridge(&[("a:/x", "b:/x"), ("b:/y", "a:/y")]);
    network.bridge(&[("b:/x", "a:/z")]);
    let mut talkers = [network.publisher(0, "/x"), network.publisher(1, "/y")];
    let mut ears = [network.listener(0, "/z"), network.listener(0, "/y")];
    network.tick(60_000, |_, _| {
        talkers.iter_mut().for_each(|it| _ = it.publish(&number(7)).unwrap());
        ears.iter_mut().for_each(|it| _ = drain(it.as_mut()));
    });
    assert!(!network.seen.contains("error"), "{:?}", network.seen);
    network.is_accounted();
}

/// A client that asks the same again as soon as its answer is there: what is held stops it, too.
#[test]
fn a_program_that_answers_is_no_loop() {
    let mut network = Network::new();
    network.bridge(&[("a:/ask", "b:/ask"), ("b:/answer", "a:/answer")]);
    let mut client = (network.publisher(0, "/ask"), network.listener(0, "/answer"));
    let mut node = (network.publisher(1, "/answer"), network.listener(1, "/ask"));
    let mut answers = 0;
    network.tick(10, |_, _| ());
    client.0.publish(&number(1)).unwrap();
    network.tick(60_000, |_, _| {
        if drain(node.1.as_mut()) > 0 {
            node.0.publish(&number(answers)).unwrap();
        }
        if drain(client.1.as_mut()) > 0 {
            answers += 1;
            client.0.publish(&number(1)).unwrap();
        }
    });
    assert!(!network.seen.contains("error"), "{:?}", network.seen);
    assert!(answers > 10_000, "{answers}");
    network.is_accounted();
}

#[test]
fn slots_are_the_same_for_all_and_to_come() {
    let now = Instant::now();
    let (at, jitter) = next_slot(now, SLOT);
    assert!(at > now && at <= now + SLOT && (0.0..1.0).contains(&jitter));
    assert_eq!(next_slot(at - MS, SLOT).0, at);
    assert_eq!(next_slot(at, SLOT).0, at + SLOT);
    let before = now.checked_sub(Duration::from_secs(5)).unwrap();
    assert!(next_slot(before, SLOT).0 > before);
}

#[test]
fn contents_differ_by_their_ends_and_length() {
    assert_eq!(fingerprint(&number(1)), fingerprint(&number(1)));
    assert_ne!(fingerprint(&number(1)), fingerprint(&number(2)));
    let bytes = |bytes: &[u8]| {
        let mut into = Fingerprint { hasher: DefaultHasher::new(), left: 0 };
        into.bytes(bytes);
        into.hasher.finish()
    };
    let long = [0; 4000];
    assert_ne!(bytes(&[&long[..], &[1]].concat()), bytes(&[&long[..], &[2]].concat()));
    assert_ne!(bytes(&long), bytes(&long[1..]));
}
