//! One bridge between all sides; everything around it, and the bridge itself, is killed with SIGKILL again and
//! again, and started anew.
//!
//! ```text
//!   DDS talker ─▶ bridge ─▶ ears on ROS 1, YARP, ZeroMQ          peers: another implementation on DDS, ROS 1 and
//!   talkers on ROS 1, YARP, ZeroMQ ─▶ bridge ─▶ DDS ear          ZeroMQ, this one on YARP
//!   master, name server, broker
//! ```
//!
//! | environment | meaning |
//! | --- | --- |
//! | `WRAPYFI_ROUNDS` | times that each of them is killed; default 1 |
//! | `WRAPYFI_MINUTES` | soak: for so long, by chance, all but the bridge, whose memory, files and threads must not grow |
//! | `WRAPYFI_VICTIMS` | who is killed, separated by commas, such as `DdsEar,Broker`; default: each |
//! | `WRAPYFI_SEED` | decides the order; default: another every time, printed |

use std::collections::BTreeMap;
use std::io::Write as _;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail, ensure};
use serde_json::Value;
use wrapyfi_e2e::{
    Config, Need, Output, Process, Result, Route, TIMEOUT, TestEnv, ros1, ros2, run, yarp, zeromq,
};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1, Need::Roscpp, Need::Python];
const NODE: &str = "/churned_bridge";
const TYPE: &str = "std_msgs/msg/String";
const RATE: &str = "--rate 50";
/// Entries of the bridge at the master: one topic published, one subscribed to.
const ENTRIES: usize = 2;

/// A program that is killed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Who {
    Master,
    NameServer,
    Broker,
    Bridge,
    DdsTalker,
    DdsEar,
    Ros1Talker,
    Ros1Ear,
    YarpTalker,
    YarpEar,
    ZeroMqTalker,
    ZeroMqEar,
}

use Who::{
    Bridge, Broker, DdsEar, DdsTalker, Master, NameServer, Ros1Ear, Ros1Talker, YarpEar,
    YarpTalker, ZeroMqEar, ZeroMqTalker,
};

/// All of them, in the order of their first start.
const ALL: [Who; 12] = [
    Master,
    NameServer,
    Broker,
    Bridge,
    DdsTalker,
    DdsEar,
    Ros1Talker,
    Ros1Ear,
    YarpTalker,
    YarpEar,
    ZeroMqTalker,
    ZeroMqEar,
];

/// Ways of messages: the first letter of their texts, who numbers them, and who hears them. The talker on YARP
/// passes on what it hears of that on DDS.
const WAYS: [(char, Who, Who); 6] = [
    ('d', DdsTalker, Ros1Ear),
    ('d', DdsTalker, YarpEar),
    ('d', DdsTalker, ZeroMqEar),
    ('r', Ros1Talker, DdsEar),
    ('z', ZeroMqTalker, DdsEar),
    ('d', DdsTalker, DdsEar),
];

/// Life of a talker, and the number that it gave a message: later ones are larger.
type Place = (u32, u64);

/// Letter and place of a message `d3:120`.
fn place(text: &str) -> Option<(char, Place)> {
    let letter = text.chars().next()?;
    let (life, number) = text.get(letter.len_utf8()..)?.split_once(':')?;
    Some((letter, (life.parse().ok()?, number.parse().ok()?)))
}

/// The text of a message that a peer has sent or heard; each has its own place for it.
fn text(line: &str) -> Option<String> {
    let message: Value = serde_json::from_str(line).ok()?;
    let found = [&message["fields"]["data"], &message["value"]["data"], &message["value"]];
    found.into_iter().find_map(Value::as_str).map(str::to_owned)
}

/// Last message of a talker, if it has sent any.
fn last_sent(output: &Output) -> Option<Place> {
    output.out.iter().rev().find_map(|line| Some(place(&text(line)?)?.1))
}

/// Messages that an ear has heard.
#[derive(Default)]
struct Heard {
    /// Number of its lines that were read.
    lines: usize,
    last: BTreeMap<char, Place>,
}

impl Heard {
    /// Reads what came since; each message must be later than the one before.
    fn read(&mut self, output: &Output) -> Result {
        for line in output.out.get(self.lines..).unwrap_or_default() {
            self.lines += 1;
            let Some((letter, place)) = text(line).as_deref().and_then(place) else { continue };
            let before = self.last.insert(letter, place);
            ensure!(before.is_none_or(|before| before < place), "{line} after {before:?}");
        }
        Ok(())
    }
}

struct Net<'e> {
    env: &'e TestEnv,
    programs: BTreeMap<Who, Process>,
    lives: BTreeMap<Who, u32>,
    heard: BTreeMap<Who, Heard>,
}

impl<'e> Net<'e> {
    fn start(env: &'e TestEnv) -> Result<Self> {
        let (programs, lives, heard) = Default::default();
        let mut net = Self { env, programs, lives, heard };
        ALL.iter().try_for_each(|who| net.launch(*who))?;
        net.flows().map(drop)?;
        Ok(net)
    }

    /// Starts a program, and waits until it is there.
    fn launch(&mut self, who: Who) -> Result {
        let env = self.env;
        let life = *self.lives.entry(who).and_modify(|life| *life += 1).or_insert(1);
        // Every other time under a new name.
        let node = format!("{}_{}", format!("{who:?}").to_lowercase(), life / 2);
        let said = |letter: char| format!("{letter}{life}:{{n}}");
        let [d, dds, r, w, y, z] = ["d", "dds", "r", "w", "y", "z"].map(|name| env.topic(name));
        let numbers =
            |role: &str, more: &str| env.peer("zmq_numbers.py", &format!("{role} {more}"));
        let program = match who {
            Master => env.roscore()?,
            NameServer => env.yarpserver()?,
            Broker => env.broker()?,
            Bridge => env.bridge(&self.config())?,
            DdsTalker => env.dds_publisher(&d, TYPE, &format!("{RATE} --text {}", said('d')))?,
            DdsEar => env.dds_subscriber(&dds, TYPE, "--plain")?,
            Ros1Talker => {
                let args = format!("publish --topic {r} {RATE} --node {node}");
                env.roscpp(&args, Some(&said('r')))?
            }
            Ros1Ear => env.roscpp(&format!("subscribe --topic {d} --node {node}"), None)?,
            YarpTalker => {
                let config = env.foreign().route(Route::new(&ros2(&d), &yarp(&w), "Text"));
                env.bridge_named("talker.yaml", &config)?
            }
            YarpEar => env.wrapyfi(["echo", &yarp(&y), "--type", "Text", "--json"])?,
            ZeroMqTalker => {
                numbers("publish", &format!("--topic {z} {RATE} --text {}", said('z')))?
            }
            ZeroMqEar => numbers("subscribe", &format!("--topic {d}"))?,
        };
        if !matches!(who, Master | NameServer | Broker | Bridge | YarpTalker | YarpEar) {
            program.event("ready")?;
        }
        if matches!(who, DdsEar | Ros1Ear | YarpEar | ZeroMqEar) {
            self.heard.insert(who, Heard::default());
        }
        self.programs.insert(who, program.pillar());
        Ok(())
    }

    fn config(&self) -> Config {
        let [d, dds, r, w, y, z] =
            ["d", "dds", "r", "w", "y", "z"].map(|name| self.env.topic(name));
        let config = self.env.foreign();
        let config =
            config.endpoint(&format!("  ros: {{ node: {} }}\n", NODE.trim_start_matches('/')));
        let to_all = [ros1(&d), yarp(&y), zeromq(&d)].map(|to| Route::new(&ros2(&d), &to, "Text"));
        let from_all = [ros1(&r), yarp(&w), zeromq(&z)]
            .map(|from| Route::new(&from, &ros2(&dds), "Text").with("merge", "true"));
        to_all.into_iter().chain(from_all).fold(config, Config::route)
    }

    fn program(&self, who: Who) -> Result<&Process> {
        self.programs.get(&who).with_context(|| format!("no {who:?}"))
    }

    /// Kills a program and starts it again; time from then on until every route delivers.
    fn strike(&mut self, who: Who) -> Result<Duration> {
        self.relaunch(who)?;
        let took = self.flows().with_context(|| format!("{who:?} was killed"))?;
        if who == Master {
            // Nodes of ROS 1 never register at a master that comes after theirs: a bridge that comes later would
            // not find them.
            [Ros1Talker, Ros1Ear].into_iter().try_for_each(|peer| self.relaunch(peer))?;
            self.flows().context("nodes of ROS 1 went to the new master")?;
        }
        Ok(took)
    }

    fn relaunch(&mut self, who: Who) -> Result {
        if self.heard.contains_key(&who) {
            self.read(who)?;
        }
        let mut program = self.programs.remove(&who).with_context(|| format!("no {who:?}"))?;
        program.kill()?;
        drop(program);
        self.launch(who)
    }

    fn read(&mut self, ear: Who) -> Result {
        let Some(program) = self.programs.get(&ear) else { return Ok(()) };
        let Some(heard) = self.heard.get_mut(&ear) else { return Ok(()) };
        program.wait_until("what it has heard", |output| Some(heard.read(output)))?
    }

    /// Waits until every way has brought two messages that were sent from now on, and the bridge stands in the
    /// master's books; time until each had brought its first.
    fn flows(&mut self) -> Result<Duration> {
        let begin = Instant::now();
        self.bring_news()?;
        self.is_registered()?;
        let took = begin.elapsed();
        self.bring_news()?;
        Ok(took)
    }

    fn bring_news(&mut self) -> Result {
        let mut sent = BTreeMap::new();
        for (letter, talker, _) in WAYS {
            let life = self.lives.get(&talker).copied().unwrap_or_default();
            let last = self.program(talker)?.wait_until("its last", |out| Some(last_sent(out)))?;
            sent.insert(letter, (life, last));
        }
        for (letter, _, ear) in WAYS {
            let Some((life, last)) = sent.get(&letter).copied() else { continue };
            let program = self.programs.get(&ear).with_context(|| format!("no {ear:?}"))?;
            let heard = self.heard.get_mut(&ear).with_context(|| format!("no {ear:?}"))?;
            let is_news = |it: &Place| it.0 == life && Some(*it) > last;
            program
                .wait_until(&format!("news of {letter}"), |output| match heard.read(output) {
                    Ok(()) => heard.last.get(&letter).is_some_and(is_news).then_some(Ok(())),
                    Err(error) => Some(Err(error)),
                })
                .with_context(|| format!("{ear:?}"))??;
        }
        Ok(())
    }

    /// Waits until the master has the bridge in its books, each end once.
    fn is_registered(&self) -> Result {
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let books = self.env.ros_books();
            if books.as_ref().is_ok_and(|books| books.entries_of(NODE) == ENTRIES) {
                return Ok(());
            }
            if Instant::now() >= deadline {
                bail!("the bridge does not stand in the master's books: {books:?}");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// The bridge's memory in KiB, open files, and threads.
    fn use_of_bridge(&self) -> Result<[f64; 3]> {
        let folder = format!("/proc/{}", self.program(Bridge)?.id());
        let status = std::fs::read_to_string(format!("{folder}/status"))?;
        let of = |key: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(key));
            let number = line.and_then(|line| line.split_whitespace().next());
            number.and_then(|number| number.parse::<f64>().ok()).context("no number in its status")
        };
        let files = std::fs::read_dir(format!("{folder}/fd"))?.count();
        Ok([of("VmRSS:")?, u32::try_from(files)?.into(), of("Threads:")?])
    }

    /// The bridge ends well, and leaves nothing at the master.
    fn end(mut self) -> Result {
        let mut bridge = self.programs.remove(&Bridge).context("no bridge")?;
        bridge.terminate()?;
        bridge.exits_with(0)?;
        let books = self.env.ros_books()?;
        ensure!(books.entries_of(NODE) == 0, "left at the master: {books:?}");
        Ok(())
    }
}

/// `SplitMix64`: the same seed, the same order.
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

fn setting(name: &str) -> Result<Option<u64>> {
    let Ok(text) = std::env::var(name) else { return Ok(None) };
    Ok(Some(text.parse().with_context(|| format!("{name}={text}"))?))
}

fn say(line: &str) -> Result {
    // Written directly: the test runner hides what `println!` says when a test passes.
    Ok(writeln!(std::io::stderr(), "{line}")?)
}

/// Prints how long each took to deliver again.
fn tell(took: &BTreeMap<Who, Vec<Duration>>) -> Result {
    for (who, all) in took {
        let mut all = all.clone();
        all.sort();
        let ms = |at: usize| all.get(at).map_or(0, Duration::as_millis);
        let (n, middle, last) = (all.len(), ms(all.len() / 2), ms(all.len().saturating_sub(1)));
        say(&format!("{who:?}: {n} times, delivers after {} / {middle} / {last} ms", ms(0)))?;
    }
    Ok(())
}

/// Seconds since the beginning; memory in KiB, files and threads of the bridge.
type Sample = (f64, [f64; 3]);

/// Rise of memory, files and threads in an hour, by least squares; an error where the end is higher than the
/// beginning by more than chance brings about.
fn slopes(samples: &[Sample]) -> Result {
    // What is learned and opened at first is no leak.
    let samples = samples.get(samples.len() / 3..).unwrap_or_default();
    let count = f64::from(u32::try_from(samples.len())?.max(1));
    let mean = |of: &dyn Fn(&Sample) -> f64| samples.iter().map(of).sum::<f64>() / count;
    let time = mean(&|it| it.0);
    let spread = mean(&|it| (it.0 - time).powi(2));
    let length = samples.last().map_or(0.0, |it| it.0) - samples.first().map_or(0.0, |it| it.0);
    let mut rises = Vec::new();
    for (at, (name, allowed)) in
        [("memory in KiB", 4096.0), ("files", 4.0), ("threads", 2.0)].into_iter().enumerate()
    {
        let level = mean(&|it| it.1[at]);
        let slope = mean(&|it| (it.0 - time) * (it.1[at] - level)) / spread.max(f64::EPSILON);
        say(&format!("{name}: {level:.0} on average, {:+.1} an hour", slope * 3600.0))?;
        if slope * length > allowed + level * 0.05 {
            rises.push(format!("{name} rose by {:.0} in {length:.0} s", slope * length));
        }
    }
    ensure!(rises.is_empty(), "the bridge grows: {}", rises.join(", "));
    Ok(())
}

#[test]
fn a_bridge_outlives_what_is_killed_around_it() -> Result {
    run("a_bridge_outlives_what_is_killed_around_it", NEEDS, |env| {
        let rounds = setting("WRAPYFI_ROUNDS")?.unwrap_or(1);
        let soak = setting("WRAPYFI_MINUTES")?.map(|minutes| Duration::from_secs(60 * minutes));
        let seed = setting("WRAPYFI_SEED")?.unwrap_or_else(|| std::process::id().into());
        say(&format!("WRAPYFI_SEED={seed}"))?;
        let named = std::env::var("WRAPYFI_VICTIMS").unwrap_or_default();
        let is_meant = |who: &Who| match named.as_str() {
            "" => soak.is_none() || *who != Bridge,
            _ => named.split(',').any(|name| name == format!("{who:?}")),
        };
        let mut victims: Vec<Who> = ALL.into_iter().filter(is_meant).collect();
        ensure!(!victims.is_empty(), "WRAPYFI_VICTIMS={named} names nobody of {ALL:?}");
        let (mut chance, mut took) = (Chance(seed), BTreeMap::<Who, Vec<Duration>>::new());
        let mut net = Net::start(env)?;
        let (begin, mut samples, mut round) = (Instant::now(), Vec::new(), 0);
        while soak.map_or(round < rounds, |soak| begin.elapsed() < soak) {
            round += 1;
            for at in (1..victims.len()).rev() {
                victims.swap(at, chance.below(at + 1));
            }
            for who in victims.iter().copied() {
                let struck = net.strike(who);
                let after = struck.with_context(|| format!("seed {seed}, round {round}"))?;
                took.entry(who).or_default().push(after);
                if soak.is_some() {
                    samples.push((begin.elapsed().as_secs_f64(), net.use_of_bridge()?));
                }
            }
            if round % 10 == 0 {
                say(&format!("round {round}"))?;
                tell(&took)?;
            }
        }
        tell(&took)?;
        if soak.is_some() {
            slopes(&samples)?;
        }
        net.end()
    })
}
