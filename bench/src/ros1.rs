//! Cost of carrying messages between ROS 1 and CDR, beside memcpy of the same bytes.
//!
//! ```text
//!   memcpy of the ROS 1 bytes ─▶ to CDR ─▶ to ROS 1 ┐
//!      └──────────── and backwards, again ◀─────────┘
//! ```

use std::hint::black_box;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use wrapyfi_interfaces::ros1::{Options, PairPlan, Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

use crate::micro::Figure;
use crate::stats::median;

/// Messages, and how much longer than memcpy they may take.
pub(crate) const CASES: [(&str, Option<f64>); 5] = [
    ("Image 640x480", Some(1.5)),
    ("Image 1080p", Some(1.5)),
    ("PointCloud2, 64 Ki points", Some(1.5)),
    ("TFMessage, 20 transforms", None),
    ("JointState, 12 joints", None),
];
/// Name of the baseline, and of the timed directions.
pub(crate) const MEMCPY: &str = "memcpy";
pub(crate) const DIRECTIONS: [&str; 2] = ["to CDR", "from CDR"];

/// Name of a figure.
pub(crate) fn figure(name: &str, what: &str) -> String {
    format!("ROS 1 {name}: {what}")
}

/// Time for one message, and sweeps at least.
const BUDGET: Duration = Duration::from_millis(60);
const SWEEPS: usize = 15;
/// Bytes handled between two looks at the clock, at least: a small message takes less than a look.
const BATCH_BYTES: usize = 1 << 16;

/// A message in both forms, with buffers that are reused as a route does.
struct Case {
    name: &'static str,
    plan: PairPlan,
    ros1: Vec<u8>,
    cdr: Vec<u8>,
}

/// Messages of a camera, a lidar, a transform tree and an arm.
pub(crate) struct Ros1 {
    cases: Vec<Case>,
}

/// Writes ROS 1 messages by hand: fields one behind the other.
#[derive(Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn text(self, text: &str) -> Self {
        let mut this = self.u32(u32::try_from(text.len()).unwrap_or_default());
        this.0.extend(text.bytes());
        this
    }

    fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    fn header(self) -> Self {
        self.u32(1).u32(1_700_000_000).u32(5).text("camera_optical_frame")
    }

    fn floats(mut self, count: u32) -> Self {
        self.0.extend((0..count).flat_map(|n| f64::from(n).to_le_bytes()));
        self
    }
}

/// `sensor_msgs/Image`, stamped 1 700 000 000 s.
pub(crate) fn image(width: u32, height: u32) -> Vec<u8> {
    let size = width * height * 3;
    let start = Writer::default().header().u32(height).u32(width).text("bgr8");
    let pixels = vec![0x5a; usize::try_from(size).unwrap_or_default()];
    start.bytes(&[0]).u32(width * 3).u32(size).bytes(&pixels).0
}

fn cloud(points: u32) -> Vec<u8> {
    let mut writer = Writer::default().header().u32(1).u32(points).u32(4);
    for (offset, name) in (0_u32..).step_by(4).zip(["x", "y", "z", "intensity"]) {
        writer = writer.text(name).u32(offset).bytes(&[7]).u32(1);
    }
    let data = vec![0x3f; usize::try_from(points * 16).unwrap_or_default()];
    writer.bytes(&[0]).u32(16).u32(points * 16).u32(points * 16).bytes(&data).bytes(&[1]).0
}

/// `tf2_msgs/TFMessage`, stamped likewise.
pub(crate) fn transforms(count: u32) -> Vec<u8> {
    let one = |writer: Writer| writer.header().text("left_arm_link_3").floats(7);
    (0..count).fold(Writer::default().u32(count), |writer, _| one(writer)).0
}

fn joints(count: u32) -> Vec<u8> {
    let names = (0..count).fold(Writer::default().header().u32(count), |writer, joint| {
        writer.text(&format!("left_arm_joint_{joint}"))
    });
    (0..3).fold(names, |writer, _| writer.u32(count).floats(count)).0
}

impl Ros1 {
    /// Makes them once.
    pub(crate) fn new() -> Result<Self> {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        let mut cases = Vec::new();
        let messages = [
            ("sensor_msgs/Image", image(640, 480)),
            ("sensor_msgs/Image", image(1920, 1080)),
            ("sensor_msgs/PointCloud2", cloud(1 << 16)),
            ("tf2_msgs/TFMessage", transforms(20)),
            ("sensor_msgs/JointState", joints(12)),
        ];
        for ((name, _), (ros1_type, ros1)) in CASES.into_iter().zip(messages) {
            let definition = types.definition(ros1_type)?;
            let plan = types.plan(&definition)?;
            let (mut cdr, mut back) = (Vec::new(), Vec::new());
            plan.to_cdr(&ros1, &Options::default(), &mut cdr)?;
            plan.to_ros1(&cdr, 1, &Options::default(), &mut back)?;
            // Only the first header's number comes back.
            ensure!(back.len() == ros1.len(), "{name} comes back with {} bytes", back.len());
            cases.push(Case { name, plan, ros1, cdr });
        }
        Ok(Self { cases })
    }

    /// Medians of one round, in microseconds.
    pub(crate) fn round(&self) -> Vec<Figure> {
        self.cases.iter().flat_map(Case::round).collect()
    }
}

impl Case {
    fn round(&self) -> [Figure; 3] {
        let Self { name, plan, ros1, cdr } = self;
        let options = Options::default();
        let (mut copy, mut forth, mut back) = (Vec::new(), Vec::new(), Vec::new());
        let mut works: [(Vec<f64>, &mut dyn FnMut()); 3] = [
            (Vec::new(), &mut || {
                copy.clear();
                copy.extend_from_slice(black_box(ros1));
                black_box(&mut copy);
            }),
            (Vec::new(), &mut || {
                forth.clear();
                drop(black_box(plan.to_cdr(black_box(ros1), &options, &mut forth)));
            }),
            (Vec::new(), &mut || {
                back.clear();
                drop(black_box(plan.to_ros1(black_box(cdr), 1, &options, &mut back)));
            }),
        ];
        let batch = BATCH_BYTES.div_ceil(ros1.len().max(1));
        #[allow(clippy::cast_precision_loss)]
        let each = 1e6 / batch as f64;
        works.iter_mut().for_each(|(_, work)| work());
        let begin = Instant::now();
        let mut sweeps = 0;
        while sweeps < SWEEPS || begin.elapsed() < BUDGET {
            for (times, work) in &mut works {
                let start = Instant::now();
                (0..batch).for_each(|_| work());
                times.push(start.elapsed().as_secs_f64() * each);
            }
            sweeps += 1;
        }
        let [memcpy, to_cdr, to_ros1] = works.map(|(times, _)| median(&times).unwrap_or(f64::NAN));
        let [forth, back] = DIRECTIONS;
        [
            (figure(name, MEMCPY), memcpy),
            (figure(name, forth), to_cdr),
            (figure(name, back), to_ros1),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_goes_there_and_back() {
        let ros1 = Ros1::new().unwrap();
        assert_eq!(ros1.cases.len(), 5);
        let figures = ros1.round();
        assert_eq!(figures.len(), 15);
        assert!(figures.iter().all(|(_, micros)| *micros > 0.0), "{figures:?}");
    }
}
