//! Latched in ROS 1, transient local in ROS 2: what a route keeps for who comes later, against
//! rosmaster, rospy and CycloneDDS.
//!
//! ```text
//!   {one that latches, several, one that does not}
//!     × {subscriber before, after, after the publisher was killed, after it was started again}
//!     × {ROS 1 ─▶ ROS 2, ROS 2 ─▶ ROS 1}
//! ```

use std::cell::Cell;
use std::collections::BTreeMap;

use serde_json::Value;
use wrapyfi_e2e::{Need, Output, Process, Result, Route, TestEnv, ros1, ros2, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Python];
const TEXT: &str = "std_msgs/msg/String";

#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    To2,
    To1,
}

/// A route without any word on quality of service, and who is on both sides of it.
struct Scene<'w> {
    env: &'w TestEnv,
    way: Way,
    latched: bool,
    from: String,
    to: String,
    nodes: Cell<u32>,
    /// Observer of the ROS 2 graph.
    graph: Process,
    bridge: Process,
}

impl<'w> Scene<'w> {
    fn new(env: &'w TestEnv, way: Way, latched: bool) -> Result<Self> {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let graph = env.graph()?;
        let route = match way {
            Way::To2 => Route::new(&ros1(&from), &ros2(&to), "Text"),
            Way::To1 => Route::new(&ros2(&from), &ros1(&to), "Text"),
        };
        let bridge = env.bridge(&env.embedded().route(route))?;
        Ok(Self { env, way, latched, from, to, nodes: Cell::new(0), graph, bridge })
    }

    fn node(&self) -> String {
        self.nodes.set(self.nodes.get() + 1);
        format!("node_{}", self.nodes.get())
    }

    /// A publisher that has said `text`, once where it latches, and still is there.
    fn publisher(&self, text: &str) -> Result<Process> {
        let (from, node) = (&self.from, self.node());
        let publisher = match (self.way, self.latched) {
            (Way::To2, true) => {
                let args = format!("publish --topic {from} --node {node} --latch --count 1");
                self.env.rospy(&args, Some(&format!(r#"{{"data": "{text}"}}"#)))?
            }
            (Way::To2, false) => {
                let args = format!("publish --topic {from} --node {node} --count 10");
                self.env.rospy(&args, Some(&format!(r#"{{"data": "{text}"}}"#)))?
            }
            (Way::To1, true) => {
                let args = format!("--text {text} --count 1 --transient-local");
                self.env.dds_publisher(from, TEXT, &args)?
            }
            // A subscription that is just being found may miss the first.
            (Way::To1, false) => {
                self.env.dds_publisher(from, TEXT, &format!("--text {text} --count 20"))?
            }
        };
        publisher.event("done").map_err(|e| e.context(self.bridge.tail()))?;
        Ok(publisher)
    }

    /// A subscriber that the route knows.
    fn subscriber(&self, keeps: bool) -> Result<Process> {
        let to = &self.to;
        let subscriber = match self.way {
            Way::To2 => {
                let durability = if keeps { "--transient-local" } else { "" };
                self.env.dds_subscriber(to, TEXT, durability)?
            }
            Way::To1 => {
                self.env.rospy(&format!("subscribe --topic {to} --node {}", self.node()), None)?
            }
        };
        subscriber.event("matched").map_err(|e| e.context(self.bridge.tail()))?;
        Ok(subscriber)
    }

    fn hears(&self, who: &Process, text: &str) -> Result {
        who.wait_until(&format!("{text:?}"), |output| {
            heard(output).contains_key(text).then_some(())
        })
        .map_err(|e| e.context(self.bridge.tail()))
    }

    /// Waits until the route has that many writers on ROS 2.
    fn writers(&self, count: usize) -> Result {
        self.writers_of(count, 1)
    }

    /// The same, when there have been so many at least.
    fn writers_of(&self, count: usize, ever: usize) -> Result {
        if self.way == Way::To1 {
            return Ok(());
        }
        let topic = format!("rt{}", self.to);
        self.graph
            .wait_until(&format!("{count} writers"), |output| {
                let gone: Vec<Value> =
                    output.events("gone").iter().map(|event| event["guid"].clone()).collect();
                let mut all: Vec<Value> = output
                    .events("endpoint")
                    .into_iter()
                    .filter(|e| e["topic"] == *topic && e["role"] == "writer")
                    .map(|e| e["guid"].clone())
                    .collect();
                all.sort_by_key(Value::to_string);
                all.dedup();
                let there = all.iter().filter(|guid| !gone.contains(guid)).count();
                (there == count && all.len() >= ever).then_some(())
            })
            .map_err(|e| e.context(self.bridge.tail()))
    }

    /// Kills a publisher, and waits until the route knows; `rest` is what is kept then.
    fn kill(&self, publisher: Process, rest: &[&str]) -> Result {
        drop(publisher);
        let reports = |output: &Output| -> Vec<Value> {
            output.objects().filter(|object| object["routes"].is_array()).collect()
        };
        // One may be under way.
        let fresh = self.bridge.wait_until("reports", |output| Some(reports(output).len() + 2))?;
        if rest.is_empty() {
            self.bridge.wait_until("the route to wait for a publisher", |output| {
                let reports = reports(output);
                let report = reports.last().filter(|_| reports.len() >= fresh)?;
                let route = &report["routes"][0];
                let reason = route["reason"].as_str().unwrap_or_default();
                (route["state"] == "waiting" && reason.contains("publishe")).then_some(())
            })?;
        }
        match (self.way, rest.first()) {
            (Way::To2, _) => self.writers(1 + rest.len()),
            (Way::To1, None) => Ok(()),
            // The message that is kept longest comes first.
            (Way::To1, Some(first)) => loop {
                let probe = self.subscriber(true)?;
                if probe.messages(1)?[0]["value"]["data"] == **first {
                    return Ok(());
                }
            },
        }
    }
}

/// Number of times that a subscriber heard each text.
fn heard(output: &Output) -> BTreeMap<String, usize> {
    let mut all = BTreeMap::new();
    for message in output.events("message") {
        let text = message["fields"]["data"].as_str().or_else(|| message["value"]["data"].as_str());
        *all.entry(text.unwrap_or("(none)").to_owned()).or_default() += 1;
    }
    all
}

/// All that it heard up to `end`, with how often where each comes once.
fn all(scene: &Scene<'_>, who: &Process, expected: &[&str]) -> Result {
    scene.hears(who, "end")?;
    let heard = who.wait_until("what it heard", |output| Some(heard(output)))?;
    let names: Vec<&str> = heard.keys().map(String::as_str).collect();
    let mut wanted = expected.to_vec();
    wanted.push("end");
    wanted.sort_unstable();
    assert_eq!(names, wanted, "{}", scene.bridge.tail());
    if scene.latched {
        assert!(heard.values().all(|times| *times == 1), "{heard:?}\n{}", scene.bridge.tail());
    }
    Ok(())
}

/// `others` say their message and stay; one more comes, is killed, and is started again.
fn matrix(test: &str, way: Way, latched: bool, others: &[&str]) -> Result {
    run(test, NEEDS, |env| {
        let _roscore = env.roscore()?;
        let scene = Scene::new(env, way, latched)?;
        let before = [scene.subscriber(false)?, scene.subscriber(true)?];
        // One of them asks for transient local: a second writer takes over from the first.
        scene.writers_of(1, 2)?;
        let mut publishers = Vec::new();
        let each_hears = |subscribers: &[Process], text: &str| {
            subscribers.iter().try_for_each(|one| scene.hears(one, text))
        };
        let first = scene.publisher("a")?;
        each_hears(&before, "a")?;
        for text in others {
            publishers.push(scene.publisher(text)?);
            each_hears(&before, text)?;
        }
        let kept: Vec<&str> = if latched { others.to_vec() } else { Vec::new() };
        scene.writers(if latched { 2 + others.len() } else { 1 })?;

        let after = scene.subscriber(true)?;
        if latched {
            scene.hears(&after, "a")?;
        }
        scene.kill(first, &kept)?;
        let after_death = scene.subscriber(true)?;
        kept.iter().try_for_each(|text| scene.hears(&after_death, text))?;

        publishers.push(scene.publisher("again")?);
        for one in before.iter().chain([&after, &after_death]) {
            scene.hears(one, "again")?;
        }
        scene.writers(if latched { 2 + others.len() } else { 1 })?;
        let after_restart = scene.subscriber(true)?;
        if latched {
            scene.hears(&after_restart, "again")?;
        }
        publishers.push(scene.publisher("end")?);

        let with = |more: &[&'static str]| -> Vec<&str> {
            kept.iter().copied().chain(more.iter().copied()).collect()
        };
        for one in &before {
            let mut expected: Vec<&str> = others.to_vec();
            expected.extend(["a", "again"]);
            all(&scene, one, &expected)?;
        }
        all(&scene, &after, &with(if latched { &["a", "again"] } else { &["again"] }))?;
        all(&scene, &after_death, &with(&["again"]))?;
        all(&scene, &after_restart, &with(if latched { &["again"] } else { &[] }))?;
        Ok(())
    })
}

macro_rules! matrix {
    ($($test:ident($way:ident, $latched:literal, $others:expr);)*) => {
        $(#[test]
        fn $test() -> Result {
            matrix(stringify!($test), Way::$way, $latched, &$others)
        })*
    };
}

matrix! {
    one_latched_publisher_is_transient_local_in_ros_2(To2, true, []);
    several_latched_publishers_are_each_replayed_in_ros_2(To2, true, ["b", "c"]);
    what_is_not_latched_is_not_kept_in_ros_2(To2, false, []);
    one_transient_local_publisher_is_latched_in_ros_1(To1, true, []);
    several_transient_local_publishers_are_each_replayed_in_ros_1(To1, true, ["b", "c"]);
    what_is_not_transient_local_is_not_latched_in_ros_1(To1, false, []);
}
