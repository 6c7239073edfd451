//! One bridge, everything around it killed with SIGKILL again and again.
//!
//! ```text
//!   roscpp ═▶ ┌────────┐ ═▶ CycloneDDS        killed by chance: one of the eight programs at the ends,
//!   roscpp ═▶ │ bridge │ ═▶ CycloneDDS        or the master; then started again, every other time under
//!   roscpp ◀═ │        │ ◀═ CycloneDDS        a new name
//!   roscpp ◀═ └────────┘ ◀═ CycloneDDS        the bridge itself lives through all of it
//! ```
//!
//! | environment | meaning |
//! | --- | --- |
//! | `WRAPYFI_CHURN_ROUNDS` | rounds; default 50 |
//! | `WRAPYFI_CHURN_SEED` | what decides who is killed; default: another every time, printed |

use std::collections::BTreeSet;
use std::io::Write as _;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use wrapyfi_e2e::{Need, Output, Process, Result, Route, TIMEOUT, TestEnv, ros1, ros2, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Roscpp, Need::Python];
const NODE: &str = "/churned_bridge";
const TYPE: &str = "std_msgs/msg/String";
/// Time between two looks at a condition.
const LOOK: Duration = Duration::from_millis(10);

fn setting(name: &str) -> Result<Option<u64>> {
    let Ok(text) = std::env::var(name) else { return Ok(None) };
    Ok(Some(text.parse().with_context(|| format!("{name}={text}"))?))
}

/// `SplitMix64`: the same seed, the same victims.
struct Chance(u64);

impl Chance {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^= mixed >> 31;
        usize::try_from(mixed % end as u64).unwrap_or(0)
    }
}

/// Program at an end of a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Publisher,
    Subscriber,
}

/// A route with the programs at its ends. What is published is `life:number`: each publisher that is
/// started is another life.
struct Way {
    topic: String,
    from_ros1: bool,
    publisher: Process,
    subscriber: Process,
    life: u32,
    started: u32,
}

/// `life:number` as it was sent or received.
fn numbers(output: &Output, life: u32) -> Vec<u64> {
    let lead = format!("{life}:");
    output.events("message").iter().filter_map(|one| number(one, &lead)).collect()
}

/// The text of a message: the peers print it as a value, that on CycloneDDS as a field, too.
fn text(message: &serde_json::Value) -> Option<&str> {
    message["fields"]["data"].as_str().or_else(|| message["value"].as_str())
}

fn number(message: &serde_json::Value, lead: &str) -> Option<u64> {
    text(message)?.strip_prefix(lead)?.parse().ok()
}

impl Way {
    fn open(env: &TestEnv, name: &str, from_ros1: bool) -> Result<Self> {
        let topic = env.topic(name);
        let publisher = publisher(env, &topic, from_ros1, 1, &node(name, End::Publisher, 0))?;
        let subscriber = subscriber(env, &topic, from_ros1, &node(name, End::Subscriber, 0))?;
        Ok(Self { topic, from_ros1, publisher, subscriber, life: 1, started: 0 })
    }

    fn route(&self) -> Route {
        let (ros1, ros2) = (ros1(&self.topic), ros2(&self.topic));
        match self.from_ros1 {
            true => Route::new(&ros1, &ros2, "Text"),
            false => Route::new(&ros2, &ros1, "Text"),
        }
    }

    /// Kills what stands at an end and starts it again, under a new name where that is wanted.
    fn strike(&mut self, env: &TestEnv, name: &str, end: End, renamed: bool) -> Result {
        self.started += u32::from(renamed);
        let node = node(name, end, self.started);
        match end {
            End::Publisher => {
                self.publisher.kill()?;
                self.life += 1;
                self.publisher = publisher(env, &self.topic, self.from_ros1, self.life, &node)?;
            }
            End::Subscriber => {
                self.once_each()?;
                self.subscriber.kill()?;
                self.subscriber = subscriber(env, &self.topic, self.from_ros1, &node)?;
            }
        }
        Ok(())
    }

    /// Waits for two messages that are sent from now on: what was under way proves nothing.
    fn delivers(&self, bridge: &Process) -> Result {
        let life = self.life;
        let sent = self
            .publisher
            .wait_until("what was sent", |output| Some(numbers(output, life).last().copied()))?;
        let news = |output: &Output| {
            let fresh = numbers(output, life).into_iter().filter(|n| Some(*n) > sent).count();
            (fresh >= 2).then_some(())
        };
        self.subscriber.wait_until("two new messages", news).with_context(|| {
            format!(
                "topic {}\nthe publisher: {}\nthe bridge: {}",
                self.topic,
                self.publisher.tail(),
                bridge.tail()
            )
        })
    }

    /// Everything that this subscriber received, it received once, and in order.
    fn once_each(&self) -> Result {
        let texts: Vec<String> = self.subscriber.wait_until("what was received", |output| {
            let all = output.events("message");
            Some(all.iter().filter_map(|one| text(one).map(str::to_owned)).collect())
        })?;
        let mut seen = BTreeSet::new();
        for text in &texts {
            let (life, number) = text.split_once(':').with_context(|| format!("text {text:?}"))?;
            let place: (u32, u64) = (life.parse()?, number.parse()?);
            ensure!(seen.last().is_none_or(|last| *last < place), "{text} came late: {texts:?}");
            ensure!(seen.insert(place), "{text} came twice: {texts:?}");
        }
        Ok(())
    }
}

fn node(name: &str, end: End, number: u32) -> String {
    let end = if end == End::Publisher { "talker" } else { "ear" };
    format!("{end}_{name}_{number}")
}

fn publisher(env: &TestEnv, topic: &str, ros1: bool, life: u32, node: &str) -> Result<Process> {
    if ros1 {
        let args = format!("publish --topic {topic} --rate 100 --node {node}");
        return env.roscpp(&args, Some(&format!("{life}:{{n}}")));
    }
    env.dds_publisher(topic, TYPE, &format!("--rate 100 --text {life}:{{n}}"))
}

fn subscriber(env: &TestEnv, topic: &str, from_ros1: bool, node: &str) -> Result<Process> {
    if from_ros1 {
        return env.dds_subscriber(topic, TYPE, "--plain");
    }
    env.roscpp(&format!("subscribe --topic {topic} --node {node}"), None)
}

/// Waits until the master has each route's end at the bridge in its books, once.
fn registered(env: &TestEnv, ways: &[Way]) -> Result {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let books = env.ros_books();
        if let Ok(books) = &books {
            let has = |way: &Way| {
                let side = if way.from_ros1 { &books.subscribers } else { &books.publishers };
                let nodes = side.iter().find(|(topic, _)| *topic == way.topic);
                nodes.is_some_and(|(_, nodes)| nodes.iter().any(|node| node == NODE))
            };
            if ways.iter().all(has) && books.entries_of(NODE) == ways.len() {
                return Ok(());
            }
        }
        if Instant::now() >= deadline {
            bail!("the bridge does not stand in the master's books: {books:?}");
        }
        std::thread::sleep(LOOK);
    }
}

#[test]
fn a_bridge_outlives_what_is_killed_around_it() -> Result {
    run("a_bridge_outlives_what_is_killed_around_it", NEEDS, |env| {
        let rounds = setting("WRAPYFI_CHURN_ROUNDS")?.unwrap_or(50);
        let seed = setting("WRAPYFI_CHURN_SEED")?.unwrap_or_else(|| std::process::id().into());
        writeln!(std::io::stderr(), "WRAPYFI_CHURN_SEED={seed} WRAPYFI_CHURN_ROUNDS={rounds}")?;
        let mut chance = Chance(seed);
        let mut roscore = env.roscore()?;
        let names = ["a", "b", "c", "d"];
        let mut ways = Vec::new();
        for (name, from_ros1) in names.into_iter().zip([true, true, false, false]) {
            ways.push(Way::open(env, name, from_ros1)?);
        }
        let endpoint = format!("  ros: {{ node: {} }}\n", NODE.trim_start_matches('/'));
        let config = ways
            .iter()
            .fold(env.embedded().endpoint(&endpoint), |config, way| config.route(way.route()));
        let mut bridge = env.bridge(&config)?;
        registered(env, &ways)?;
        ways.iter().try_for_each(|way| way.delivers(&bridge))?;
        for round in 1..=rounds {
            let (victim, renamed) = (chance.below(2 * ways.len() + 1), chance.below(2) == 1);
            let said = match (names.get(victim / 2), ways.get_mut(victim / 2)) {
                (Some(name), Some(way)) => {
                    let end = if victim % 2 == 0 { End::Publisher } else { End::Subscriber };
                    way.strike(env, name, end, renamed)?;
                    format!("{end:?} of {name}, renamed: {renamed}")
                }
                _ => {
                    roscore.kill()?;
                    roscore = env.roscore()?;
                    "the master".to_owned()
                }
            };
            let begin = Instant::now();
            let why = || format!("seed {seed}, round {round}: killed was {said}");
            registered(env, &ways).with_context(why)?;
            ways.iter().try_for_each(|way| way.delivers(&bridge)).with_context(why)?;
            let took = begin.elapsed().as_millis();
            writeln!(std::io::stderr(), "round {round}: {said}; all deliver after {took} ms")?;
        }
        ways.iter().try_for_each(Way::once_each)?;
        bridge.terminate()?;
        bridge.exits_with(0)?;
        let books = env.ros_books()?;
        ensure!(books.entries_of(NODE) == 0, "left at the master: {books:?}");
        Ok(())
    })
}
