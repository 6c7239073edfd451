//! Codecs against their bound, in one thread of this process, measured by criterion; `native` and `typed` by turns.
//!
//! | group | holds |
//! | --- | --- |
//! | `native` | a dict with 1 MiB of float32 to and from JSON, beside base64 alone on its text |
//! | `base64` | base64 alone on pictures, which bridged ways are compared with |
//! | `zeromq`, `cdr`, `pixels` | every payload to and from frames and CDR; a JPEG from pixels and back |
//! | `ros1` | messages of ROS 1 to CDR and back, beside memcpy of their bytes |
//! | `dynamic` | one decode of a `JointState` whose type is known at run time only |
//! | `registered` | a registered method, beside the method itself and beside raw endpoints |
//! | `typed` | generated structs from one node of ROS 2 to another, beside the endpoints with the same bytes and coding alone |

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use base64_simd::{AsOut as _, STANDARD};
use bytes::Bytes;
use clap::ValueEnum as _;
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion};
use memchr::{memmem, memrchr};
use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{MessageType, Payload, RosMessage, RosType, Value};
use wrapyfi_endpoint::codec::{json, ros};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{self as endpoint, Middleware as _, TopicSpec};
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::ros1::{Options, Rules, Types};
use wrapyfi_interfaces::sensor_msgs::msg::{Image as RosImage, JointState};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};
use wrapyfi_zeromq::codec as frames;

use crate::payload::{self, Kind, Maker, compress, decode_frames, decompress};
use crate::python::Python;
use crate::report::Limit::{AtLeast, AtMost, Shown};
use crate::report::{Row, Target, quantile};

/// Rounds of what is measured by turns, and the least time of one.
const ROUNDS: usize = 81;
const ROUND: Duration = Duration::from_millis(30);

/// Estimates of criterion, and rounds of what is measured by turns.
pub(crate) struct Micro {
    folder: PathBuf,
    /// Nanoseconds of a call in each round, by `group/benchmark`.
    turns: Turns,
}

type Turns = BTreeMap<String, Vec<f64>>;

/// Something measured, by the name that it has in its group.
type Call<'c> = (String, Box<dyn FnMut() -> Result<()> + 'c>);

/// A median and its interval of 95 %, in nanoseconds.
#[derive(serde::Deserialize)]
struct Median {
    confidence_interval: Bounds,
    point_estimate: f64,
}

#[derive(serde::Deserialize)]
struct Bounds {
    lower_bound: f64,
    upper_bound: f64,
}

#[derive(serde::Deserialize)]
struct Estimates {
    median: Median,
}

/// Sum of what is done one after the other.
impl std::iter::Sum for Median {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        let none = Bounds { lower_bound: 0.0, upper_bound: 0.0 };
        all.fold(Self { confidence_interval: none, point_estimate: 0.0 }, |sum, one| {
            let (before, more) = (&sum.confidence_interval, &one.confidence_interval);
            let bounds = Bounds {
                lower_bound: before.lower_bound + more.lower_bound,
                upper_bound: before.upper_bound + more.upper_bound,
            };
            Self {
                confidence_interval: bounds,
                point_estimate: sum.point_estimate + one.point_estimate,
            }
        })
    }
}

/// Messages that are structs.
const TYPED: [&str; 3] = ["joints", "image 640x480", "image 1920x1080"];

/// Messages of ROS 1, and how much longer than memcpy they may take.
const ROS1: [(&str, f64); 4] = [
    ("image 640x480", 1.5),
    ("image 1080p", 1.5),
    ("cloud of 64 Ki points", 1.5),
    ("20 transforms", f64::NAN),
];

impl Micro {
    /// Measures all of it, `only` where it is given; criterion writes below `folder`.
    pub(crate) fn run(folder: &Path, only: Option<&str>) -> Result<Self> {
        let mut criterion = Criterion::default()
            .without_plots()
            .output_directory(folder)
            .sample_size(20)
            .nresamples(5_000)
            .warm_up_time(Duration::from_millis(200))
            .measurement_time(Duration::from_millis(800));
        if let Some(only) = only {
            criterion = criterion.with_filter(only);
        }
        let mut turns = Turns::default();
        native(&mut criterion, &mut turns, only)?;
        payloads(&mut criterion)?;
        ros1(&mut criterion)?;
        dynamic(&mut criterion)?;
        registered(&mut criterion)?;
        typed(&mut turns, only)?;
        Ok(Self { folder: folder.to_owned(), turns })
    }

    fn median(&self, name: &str) -> Option<Median> {
        let file = self.folder.join(name).join("new/estimates.json");
        let text = std::fs::read_to_string(file).ok()?;
        Some(serde_json::from_str::<Estimates>(&text).ok()?.median)
    }

    /// Median of `group/benchmark` in microseconds; NaN where it was not measured.
    pub(crate) fn us(&self, name: &str) -> f64 {
        if let Some(rounds) = self.turns.get(name) {
            return quantile(rounds, 0.5) / 1e3;
        }
        self.median(name).map_or(f64::NAN, |median| median.point_estimate / 1e3)
    }

    /// One figure over the sum of others, in each round where they were measured by turns.
    fn ratio(
        &self,
        area: &'static str,
        what: String,
        limit: f64,
        ours: &str,
        bounds: &[&str],
    ) -> Option<Target> {
        let limit = if limit.is_nan() { Shown } else { AtMost(limit) };
        if let Some(ours) = self.turns.get(ours) {
            let others = bounds.iter().map(|bound| self.turns.get(*bound));
            let others: Vec<_> = others.collect::<Option<_>>()?;
            let sum = |round: usize| -> f64 { others.iter().filter_map(|it| it.get(round)).sum() };
            let sums: Vec<f64> = (0..ours.len()).map(sum).collect();
            let ratios: Vec<f64> = ours.iter().zip(&sums).map(|(one, sum)| one / sum).collect();
            let [one, other] = [ours, &sums].map(|rounds| quantile(rounds, 0.5) / 1e3);
            let parts = format!("{one:.2} / {other:.2} us");
            return Some(Target::of(Row::new(area, "ratio", what), limit, &ratios, parts));
        }
        let other: Median = bounds.iter().map(|bound| self.median(bound)).sum::<Option<_>>()?;
        let one = self.median(ours)?;
        let (low, high) = (&one.confidence_interval, &other.confidence_interval);
        let interval = (low.lower_bound / high.upper_bound, low.upper_bound / high.lower_bound);
        let parts =
            format!("{:.2} / {:.2} us", one.point_estimate / 1e3, other.point_estimate / 1e3);
        Some(Target::between(
            Row::new(area, "ratio", what),
            limit,
            one.point_estimate / other.point_estimate,
            interval,
            parts,
        ))
    }

    /// Promises that these figures decide.
    pub(crate) fn targets(&self) -> Vec<Target> {
        let mut targets = Vec::new();
        for (code, limit) in [("encode", 1.3), ("decode", 1.5)] {
            let what =
                format!("{code} a dict with 1 MiB float32, against base64-simd alone on its text");
            targets.extend(self.ratio(
                "codecs",
                what,
                limit,
                &format!("native/{code}"),
                &[&format!("native/base64 {code}")],
            ));
        }
        for ((name, limit), way) in ROS1.iter().flat_map(|it| [(it, "to CDR"), (it, "from CDR")]) {
            let what = format!("ROS 1, {name}, {way}, against memcpy of the same bytes");
            targets.extend(self.ratio(
                "codecs",
                what,
                *limit,
                &format!("ros1/{name} {way}"),
                &[&format!("ros1/{name} memcpy")],
            ));
        }
        let decode = self.us("dynamic/JointState");
        if decode.is_finite() {
            let what =
                "10 000 dynamic decodes a second of a JointState (12 joints): percent of a core";
            let row = Row::new("codecs", "%", what);
            targets.push(Target::once(row, AtMost(5.0), decode, format!("{decode:.2} us each")));
        }
        let [method, unheard] =
            ["method", "unheard"].map(|it| self.us(&format!("registered/{it}")));
        if unheard.is_finite() {
            let what = "a registered call that publishes a small value, nobody listens: us above the method";
            targets.push(Target::once(
                Row::new("library", "us", what),
                AtMost(1.0),
                unheard - method,
                format!("{unheard:.3} - {method:.3} us"),
            ));
        }
        let what =
            "publish and listen of registered methods in memory, against raw endpoints".to_owned();
        let raw = ["registered/raw"];
        targets.extend(self.ratio("library", what, f64::NAN, "registered/listen", &raw));
        for name in TYPED {
            let [typed, raw, coding, apart] =
                ["", " raw", " coding", " apart"].map(|part| format!("typed/{name}{part}"));
            let what = format!("publish and listen of structs on ROS 2, {name}, against");
            let raw_alone = format!("{what} raw endpoints");
            targets.extend(self.ratio("ros2", raw_alone, 1.05, &typed, &[&raw]));
            let alone = format!("{what} raw endpoints and coding alone");
            targets.extend(self.ratio("ros2", alone, 1.05, &typed, &[&raw, &coding]));
            let apart_each =
                format!("{what} raw endpoints and coding of another message, by turns");
            targets.extend(self.ratio("ros2", apart_each, 1.05, &typed, &[&apart]));
        }
        targets
    }

    /// Coding of every payload beside Python's, and what was promised of it.
    pub(crate) fn coding(&self, python: Option<&mut Python>) -> Result<(String, Vec<Target>)> {
        let (mut rows, mut targets, mut python) = (String::new(), Vec::new(), python);
        for kind in Kind::value_variants().iter().copied().filter(|kind| *kind != Kind::FileMib) {
            let form = if kind == Kind::VgaJpeg { "pixels" } else { "zeromq" };
            let ours = ["encode", "decode"]
                .map(|code| self.us(&format!("{form}/{code} {}", payload::name(&kind))));
            let cdr = ["encode", "decode"]
                .map(|code| self.us(&format!("cdr/{code} {}", payload::name(&kind))));
            let repeats = if kind == Kind::FullHdRgb { 15 } else { 60 };
            let theirs = match &mut python {
                Some(python) => python.coding(kind, repeats)?,
                None => crate::python::Coding { encode_us: f64::NAN, decode_us: f64::NAN },
            };
            let theirs = [theirs.encode_us, theirs.decode_us];
            let figures = [
                ("encode", ours[0]),
                ("encode, Python", theirs[0]),
                ("decode", ours[1]),
                ("decode, Python", theirs[1]),
                ("encode CDR", cdr[0]),
                ("decode CDR", cdr[1]),
            ];
            targets.extend(figures.map(|(code, us)| {
                let row = Row::new("codecs", "us", format!("{code}: {}", kind.title()));
                Target::once(row.in_other_table(), Shown, us, "one thread, no transport")
            }));
            let cells = figures.map(|(_, us)| format!("{us:.1}"));
            rows += &format!("| {} | {} |\n", kind.title(), cells.join(" | "));
            let promised = match kind {
                Kind::F32Mib | Kind::U8Rgb200 => 10.0,
                Kind::VgaJpeg => 1.0,
                _ => continue,
            };
            for (code, (ours, python)) in
                ["encode", "decode"].iter().zip(ours.into_iter().zip(theirs))
            {
                let what = format!("{code} a {}, Python against us", kind.title());
                let parts = format!("{python:.0} / {ours:.0} us");
                let row = Row::new("codecs", "ratio", what);
                targets.push(Target::once(row, AtLeast(promised), python / ours, parts));
            }
        }
        let head = "One thread, no transport, microseconds: a whole message of ZeroMQ frames (a JPEG from pixels and to \
                    pixels), and CDR.\n\n\
                    | payload | encode | Python | decode | Python | encode CDR | decode CDR |\n\
                    | --- | --- | --- | --- | --- | --- | --- |\n";
        Ok((format!("{head}{rows}"), targets))
    }
}

/// Measures `run`, which is called many times.
fn time<T>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: impl Into<String>,
    mut run: impl FnMut() -> T,
) {
    group.bench_function(name.into(), |it| it.iter(&mut run));
}

/// Measures `calls` by turns where `only` names one of them: a drift of the machine meets all alike, and their ratio is
/// known more closely than from one after the other.
fn by_turns(
    turns: &mut Turns,
    only: Option<&str>,
    group: &str,
    mut calls: Vec<Call<'_>>,
) -> Result<()> {
    for (name, _) in &mut calls {
        *name = format!("{group}/{name}");
    }
    if only.is_some_and(|only| !calls.iter().any(|(name, _)| name.contains(only))) {
        return Ok(());
    }
    for _ in 0..ROUNDS {
        for (name, call) in &mut calls {
            // What the one before it left in the caches is no part of it.
            call()?;
            let (begin, mut count) = (Instant::now(), 0_u32);
            while begin.elapsed() < ROUND {
                call()?;
                count += 1;
            }
            let ns = begin.elapsed().as_nanos() as f64 / f64::from(count);
            turns.entry(name.clone()).or_default().push(ns);
        }
    }
    Ok(())
}

/// A call for [`by_turns`], whose result is dropped.
fn call<'c, T>(name: impl Into<String>, mut run: impl FnMut() -> Result<T> + 'c) -> Call<'c> {
    (name.into(), Box::new(move || run().map(|found| drop(black_box(found)))))
}

/// Our coder and base64 alone on one and the same text.
fn native(criterion: &mut Criterion, turns: &mut Turns, only: Option<&str>) -> Result<()> {
    let Payload::NativeObject(object) = Maker::new(Kind::F32Mib)?.payload(1) else {
        anyhow::bail!("a dict is no native object");
    };
    let (value, limits, plugins) = (object.value, Limits::default(), wrapyfi_plugins::standard());
    let text = Bytes::from(json::encode(&value, &plugins)?);
    let tag = b"\"numpy.ndarray\", \"";
    let from = memmem::find(&text, tag).context("no array in the text")? + tag.len();
    let base64 = text.get(from..memrchr(b'"', &text).context("no end")?).context("no base64")?;
    let file = STANDARD.decode_to_vec(base64)?;
    anyhow::ensure!(file.len() > 1 << 20, "the array file has {} bytes only", file.len());
    let mut buffer = file.clone();
    let decoded = |_| anyhow::anyhow!("no base64");
    let calls = vec![
        // Into memory that is there already: a bound has nothing to allocate.
        call("base64 decode", || {
            let out = STANDARD.decode(black_box(base64), buffer.as_out());
            Ok(out.map_err(decoded)?.len())
        }),
        call("decode", || Ok(json::decode(black_box(&text), &limits, &plugins)?)),
        call("base64 encode", || Ok(STANDARD.encode_type::<Vec<u8>>(black_box(&file)))),
        call("encode", || Ok(json::encode(black_box(&value), &plugins)?)),
    ];
    by_turns(turns, only, "native", calls)?;
    let mut group = criterion.benchmark_group("base64");
    for (name, pixels) in [("vga-rgb", 640 * 480), ("full-hd-rgb", 1920 * 1080)] {
        // With the 128 bytes of the array's header, as Wrapyfi sends them.
        let bytes = vec![0x5A_u8; pixels * 3 + 128];
        let text = STANDARD.encode_type::<Vec<u8>>(&bytes);
        let mut buffer = bytes.clone();
        time(&mut group, format!("decode {name}"), || {
            STANDARD.decode(black_box(&text), buffer.as_out()).map(|out| out.len())
        });
        time(&mut group, format!("encode {name}"), || {
            STANDARD.encode_type::<Vec<u8>>(black_box(&bytes))
        });
    }
    group.finish();
    Ok(())
}

fn payloads(criterion: &mut Criterion) -> Result<()> {
    for kind in Kind::value_variants().iter().copied().filter(|kind| *kind != Kind::FileMib) {
        let (maker, limits, name) = (Maker::new(kind)?, Limits::default(), payload::name(&kind));
        let (spec, payload, message_type) =
            (maker.spec("/t"), maker.payload(1), kind.message_type());
        let encoded: Vec<Bytes> =
            frames::encode(&payload, &spec)?.into_iter().map(Bytes::from).collect();
        let mut group = criterion.benchmark_group("zeromq");
        time(&mut group, format!("encode {name}"), || frames::encode(black_box(&payload), &spec));
        time(&mut group, format!("decode {name}"), || decode_frames(black_box(&encoded), &spec));
        group.finish();
        let (cdr, plugins) = (Bytes::from(maker.cdr()?.body), wrapyfi_plugins::standard());
        let mut group = criterion.benchmark_group("cdr");
        // Its pieces share the payload's memory.
        time(&mut group, format!("encode {name}"), || {
            drop(black_box(ros::encode(black_box(&payload), message_type, &plugins)));
        });
        time(&mut group, format!("decode {name}"), || {
            ros::decode(black_box(&cdr), message_type, &limits, &plugins)
        });
        group.finish();
        if kind == Kind::VgaJpeg {
            let pixels = maker.uncoded(1)?;
            let mut group = criterion.benchmark_group("pixels");
            time(&mut group, format!("encode {name}"), || {
                compress(pixels.clone()).map(|file| frames::encode(&file, &spec))
            });
            time(&mut group, format!("decode {name}"), || {
                decode_frames(black_box(&encoded), &spec).map(decompress)
            });
            group.finish();
        }
    }
    Ok(())
}

/// Fields of a message of ROS 1, one behind the other: numbers, and texts with their length.
fn fields(numbers: &[u32], text: &str) -> Vec<u8> {
    let length = u32::try_from(text.len()).unwrap_or_default();
    let head = numbers.iter().chain([&length]).flat_map(|number| number.to_le_bytes());
    head.chain(text.bytes()).collect()
}

fn header() -> Vec<u8> {
    fields(&[1, 1_700_000_000, 5], "camera_optical_frame")
}

fn image(width: u32, height: u32) -> Vec<u8> {
    let size = width * height * 3;
    let pixels = vec![0x5a; size as usize];
    let rest = [(width * 3).to_le_bytes(), size.to_le_bytes()].concat();
    [header(), fields(&[height, width], "bgr8"), vec![0], rest, pixels].concat()
}

fn cloud(points: u32) -> Vec<u8> {
    let mut message = [header(), [1, points, 4].map(u32::to_le_bytes).concat()].concat();
    for (offset, name) in (0_u32..).step_by(4).zip(["x", "y", "z", "intensity"]) {
        let rest = [&offset.to_le_bytes()[..], &[7], &1_u32.to_le_bytes()].concat();
        message.extend([fields(&[], name), rest].concat());
    }
    message.push(0);
    message.extend([16, points * 16, points * 16].map(u32::to_le_bytes).concat());
    message.resize(message.len() + points as usize * 16, 0x3f);
    message.push(1);
    message
}

fn transforms(count: u32) -> Vec<u8> {
    let one = [header(), fields(&[], "left_arm_link_3"), vec![0; 7 * 8]].concat();
    [count.to_le_bytes().to_vec(), one.repeat(count as usize)].concat()
}

fn ros1(criterion: &mut Criterion) -> Result<()> {
    let (mut types, options) =
        (Types::new(Rules::built_in(), TypeStore::empty()), Options::default());
    let messages = [
        ("sensor_msgs/Image", image(640, 480)),
        ("sensor_msgs/Image", image(1920, 1080)),
        ("sensor_msgs/PointCloud2", cloud(1 << 16)),
        ("tf2_msgs/TFMessage", transforms(20)),
    ];
    let mut group = criterion.benchmark_group("ros1");
    for ((name, _), (ros1_type, ros1)) in ROS1.into_iter().zip(messages) {
        let definition = types.definition(ros1_type)?;
        let plan = types.plan(&definition)?;
        // Buffers are used again, as a route does.
        let (mut copy, mut cdr, mut back) = (Vec::new(), Vec::new(), Vec::new());
        plan.to_cdr(&ros1, &options, &mut cdr)?;
        plan.to_ros1(&cdr, 1, &options, &mut back)?;
        anyhow::ensure!(back.len() == ros1.len(), "{name} comes back with {} bytes", back.len());
        time(&mut group, format!("{name} memcpy"), || {
            copy.clear();
            copy.extend_from_slice(black_box(&ros1));
        });
        let mut forth = Vec::new();
        time(&mut group, format!("{name} to CDR"), || {
            forth.clear();
            plan.to_cdr(black_box(&ros1), &options, &mut forth)
        });
        time(&mut group, format!("{name} from CDR"), || {
            back.clear();
            plan.to_ros1(black_box(&cdr), 1, &options, &mut back)
        });
    }
    group.finish();
    Ok(())
}

const JOINT_STATE: &str = "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
";

fn dynamic(criterion: &mut Criterion) -> Result<()> {
    let name = TypeName::parse(Dialect::Ros2, "sensor_msgs/msg/JointState")?;
    let plan = ResolvedType::from_text(Dialect::Ros2, &name, JOINT_STATE)?.plan()?;
    let mut message = plan.default_message();
    let names = (0..12).map(|joint| format!("left_arm_joint_{joint}"));
    message.set("name", names.collect::<Vec<_>>())?;
    for field in ["position", "velocity", "effort"] {
        message.set(field, (0..12).map(f64::from).collect::<Vec<_>>())?;
    }
    let cdr = plan.encode(&message)?.to_bytes();
    let mut group = criterion.benchmark_group("dynamic");
    time(&mut group, "JointState", || plan.decode(black_box(&cdr), 1 << 20));
    group.finish();
    Ok(())
}

struct Robot {
    calls: i64,
}

#[communicator]
impl Robot {
    #[register(NativeObject, "memory", "/registered/object", should_wait = false)]
    fn object(&mut self, step: i64) -> Value {
        self.calls += step;
        Value::Int(self.calls)
    }
}

fn registered(criterion: &mut Criterion) -> Result<()> {
    let bus = Arc::new(Memory::new("memory"));
    let context = CommunicatorContext::builder().only(bus.clone()).build();
    let robot = |mode| {
        let mut robot = Robot { calls: 0 }.communicator_in(&context);
        robot.activate(RobotMethod::Object, mode).map(|()| robot)
    };
    let mut group = criterion.benchmark_group("registered");
    let mut bare = Robot { calls: 0 };
    time(&mut group, "method", || bare.object(black_box(1)));
    let mut alone = robot(Mode::Publish)?;
    time(&mut group, "unheard", || alone.object(black_box(1)));
    drop(alone);
    let (mut here, mut there) = (robot(Mode::Publish)?, robot(Mode::Listen)?);
    while there.object(0)?.is_none() {
        here.object(1)?;
    }
    time(&mut group, "listen", || {
        _ = black_box(here.object(1));
        there.object(0)
    });
    let (spec, ends) =
        (TopicSpec::new("/raw", MessageType::NativeObject), endpoint::Context::default());
    let mut listener = bus.open_listener(&spec, &ends)?;
    let mut publisher = bus.open_publisher(&spec, &endpoint::Context::default())?;
    time(&mut group, "raw", || {
        _ = black_box(publisher.publish(&Payload::from(bare.object(1))));
        listener.take()
    });
    group.finish();
    Ok(())
}

/// From one node of ROS 2 to another in this process, and until it is there.
fn typed(turns: &mut Turns, only: Option<&str>) -> Result<()> {
    let names = (0..12).map(|joint| format!("left_arm_joint_{joint}")).collect();
    let [position, velocity] = [0.5, -0.25].map(|it| vec![it; 12]);
    let joints = JointState { name: names, position, velocity, ..JointState::default() };
    let image = |width: u32, height: u32| {
        let (encoding, step) = ("bgr8".to_owned(), width * 3);
        let data = Bytes::from(vec![0x5A; (step * height) as usize]);
        RosImage { height, width, encoding, step, data, ..RosImage::default() }
    };
    let domain = std::process::id() % 100 + 1;
    let node = |name| {
        let with = |it: &mut wrapyfi_ros2::Ros2Settings| it.cyclone.domain_id = domain;
        wrapyfi_core::ros2(name).with(with).start()
    };
    let nodes = [node("bench_talks")?, node("bench_listens")?];
    let [of_joints, of_vga, of_full_hd] = TYPED;
    by_turns(turns, only, "typed", there(of_joints, &nodes, &joints)?)?;
    by_turns(turns, only, "typed", there(of_vga, &nodes, &image(640, 480))?)?;
    by_turns(turns, only, "typed", there(of_full_hd, &nodes, &image(1920, 1080))?)
}

fn there<'c, M: Message>(
    name: &str,
    [talks, listens]: &'c [wrapyfi_ros2::Ros2; 2],
    message: &'c M,
) -> Result<Vec<Call<'c>>> {
    let spec = TopicSpec::new("/typed", MessageType::Ros(RosType::of::<M>()?));
    let context = endpoint::Context::default();
    let mut listener = listens.open_listener(&spec, &context)?;
    let mut publisher = talks.open_publisher(&spec, &endpoint::Context::default())?;
    while publisher.link().peers != Some(1) || listener.link().peers != Some(1) {
        _ = context.wake.wait(Duration::from_millis(10));
    }
    let sent = move |payload: &Payload| -> Result<Payload> {
        publisher.publish(payload)?;
        loop {
            if let Some(sample) = listener.take()? {
                return Ok(sample.payload);
            }
            _ = context.wake.wait(Duration::from_secs(1));
        }
    };
    let cdr = RosMessage::of(message)?.cdr.to_bytes();
    let raw = Payload::from(RosMessage::new(RosType::of::<M>()?, cdr.clone()));
    let sent = Rc::new(RefCell::new(sent));
    let (raw_sent, apart_sent) = (Rc::clone(&sent), Rc::clone(&sent));
    let (apart, apart_raw) = (cdr.clone(), raw.clone());
    Ok(vec![
        call(format!("{name} coding"), move || coded(message, &cdr)),
        call(format!("{name} raw"), move || (raw_sent.borrow_mut())(black_box(&raw))),
        // Both, for one message after the other, but each by itself.
        call(format!("{name} apart"), move || {
            drop(black_box(coded(message, &apart)?));
            (apart_sent.borrow_mut())(black_box(&apart_raw))
        }),
        call(name, move || {
            let payload = RosMessage::of(black_box(message))?.into();
            let Payload::RosMessage(found) = (sent.borrow_mut())(&payload)? else {
                anyhow::bail!("no message of ROS")
            };
            Ok(found.read::<M>()?)
        }),
    ])
}

/// Encodes a message, and decodes its bytes.
fn coded<M: Message>(message: &M, cdr: &Bytes) -> Result<M> {
    drop(black_box(black_box(message).encode()));
    Ok(M::decode(black_box(cdr), cdr.len())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each benchmark is run, and its estimate is found where criterion leaves it.
    #[test]
    fn estimates_are_read_and_compared() {
        let folder = tempfile::tempdir().unwrap();
        let micro = Micro::run(folder.path(), Some("ros1/20 transforms")).unwrap();
        assert!(micro.us("ros1/20 transforms to CDR") > 0.0);
        assert!(micro.us("native/encode").is_nan());
        assert_eq!(micro.targets().len(), 2);
    }
}
