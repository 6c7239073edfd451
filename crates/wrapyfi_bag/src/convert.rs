//! A bag of ROS 1 into a recording of ROS 2, message by message.
//!
//! ```text
//!   BagReader ─▶ Conversion ─▶ Feed ─ thread ─▶ recording::Writer
//!        └── damage ──┴── what was left out, and why ──▶ Report
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Seek, Write};

use wrapyfi_interfaces::ros1::Transcoded;

use crate::conversion::{Conversion, offered};
use crate::feed::{Feed, pipe};
use crate::recording::{Topic, WriteError, Writer};
use crate::ros1::{BagReader, Connection, Damage, ReadError};

/// Messages between two looks at the progress.
const LOOK_EVERY: u64 = 64;

/// Error of converting a bag: the file ends there.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConvertError {
    /// The bag cannot be read on.
    #[error("the bag: {0}")]
    Read(#[from] ReadError),
    /// The recording cannot be written.
    #[error("the recording: {0}")]
    Write(#[from] WriteError),
    /// The system gives no thread that writes.
    #[error("no thread can be started: {0}")]
    Thread(std::io::Error),
}

/// Choice of what is converted.
#[derive(Debug, Clone, Default)]
pub struct ConvertOptions {
    /// Topics, by their names in the bag or in ROS 2; none: all.
    pub topics: Option<BTreeSet<String>>,
}

/// Progress of a conversion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Bytes of the bag that were read.
    pub read_bytes: u64,
    /// Size of the bag in bytes.
    pub size_bytes: u64,
    /// Messages that were written.
    pub messages: u64,
}

/// Outcome for one topic of the bag with one type.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TopicReport {
    /// Topic in the bag.
    pub from: String,
    /// Type in the bag.
    pub ros1_type: String,
    /// Topic and type in the recording; none where the topic was left out.
    pub to: Option<(String, String)>,
    /// Messages that were written.
    pub messages: u64,
    /// Messages that were left out.
    pub left_out: u64,
    /// Reason for the first that was left out.
    pub why: Option<String>,
    /// Differences between the topic in the bag and in the recording, a sentence each.
    pub notes: Vec<String>,
    /// Changes that messages needed, such as texts that are no UTF-8.
    pub changes: Transcoded,
}

/// Outcome of a conversion.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Topics of the bag that were met, by name.
    pub topics: Vec<TopicReport>,
    /// Messages that were written.
    pub messages: u64,
    /// Bytes of these messages in the bag.
    pub bytes: u64,
    /// Places of the bag that could not be read.
    pub damage: Damage,
    /// Messages that the index of the bag counts and that were not found; none without an index, or where not all was read.
    pub missing: Option<u64>,
    /// Topics that were asked for and are not in the bag.
    pub absent: Vec<String>,
    /// True where it was asked to end before the end of the bag.
    pub is_interrupted: bool,
}

impl Report {
    /// True where each message that was asked for is in the recording.
    pub fn is_complete(&self) -> bool {
        let whole = self.damage.is_none() && self.missing.unwrap_or(0) == 0;
        let all = self.topics.iter().all(|topic| topic.left_out == 0) && self.absent.is_empty();
        whole && all && !self.is_interrupted
    }
}

/// Destination of a connection.
#[derive(Clone, Copy)]
enum Way {
    /// Number of the topic for the writer, and index in the report.
    Written(usize, usize),
    LeftOut(usize),
    NotWanted,
}

/// Converts a bag, and writes all of it that can be read. `look` is told the progress, and ends the conversion with `false`; what
/// was written until then stays.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use std::fs::File;
/// use std::io::BufWriter;
/// use wrapyfi_bag::recording::{Compression, Writer};
/// use wrapyfi_bag::ros1::{BagReader, Limits};
/// use wrapyfi_bag::{Conversion, ConvertOptions, convert};
/// use wrapyfi_interfaces::ros1::{Options, Rules, Types};
///
/// let mut bag = BagReader::open(File::open("robot.bag")?, Limits::default())?;
/// let mut out = Writer::new(BufWriter::new(File::create("robot.mcap")?), Compression::None)?;
/// let types = Types::from_environment(Rules::built_in());
/// let mut conversion = Conversion::new(types, Options::default());
/// let all = ConvertOptions::default();
/// let report = convert(&mut bag, &mut conversion, &mut out, &all, &mut |_| true)?;
/// out.finish("robot.mcap", "")?;
/// println!("{} messages", report.messages);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// When the system refuses to read or to write. Damage of the bag is in the report.
pub fn convert<R: Read + Seek, W: Write + Seek + Send>(
    bag: &mut BagReader<R>,
    conversion: &mut Conversion,
    out: &mut Writer<W>,
    options: &ConvertOptions,
    look: &mut dyn FnMut(&Progress) -> bool,
) -> Result<Report, ConvertError> {
    let (mut feed, drain) = pipe();
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("bag-writer".to_owned());
        let writer = thread.spawn_scoped(scope, || drain.write_to(out));
        let writer = writer.map_err(ConvertError::Thread)?;
        let read = read(bag, conversion, &mut feed, options, look);
        _ = feed.hand_over();
        drop(feed);
        match writer.join() {
            Ok(written) => written?,
            Err(panic) => std::panic::resume_unwind(panic),
        }
        Ok(read?)
    })
}

/// Reads the bag, and gives its messages to the writer, until one of both ends.
fn read<R: Read + Seek>(
    bag: &mut BagReader<R>,
    conversion: &mut Conversion,
    feed: &mut Feed,
    options: &ConvertOptions,
    look: &mut dyn FnMut(&Progress) -> bool,
) -> Result<Report, ReadError> {
    let mut report = Report::default();
    let mut ways: BTreeMap<u32, Way> = BTreeMap::new();
    let mut seen = 0_u64;
    conversion.take_up(bag.connections().values());
    loop {
        if seen.is_multiple_of(LOOK_EVERY) {
            let (read_bytes, size_bytes) = bag.position();
            let progress = Progress { read_bytes, size_bytes, messages: report.messages };
            if !look(&progress) {
                report.is_interrupted = true;
                break;
            }
        }
        let Some(next) = bag.next_message()? else { break };
        let (id, time_ns) = (next.connection, next.time_ns);
        seen += 1;
        let way = match ways.get(&id) {
            Some(way) => *way,
            None => {
                let way = way(id, bag.connections(), conversion, feed, options, &mut report);
                ways.insert(id, way);
                way
            }
        };
        if !carry(way, (id, time_ns, bag.message()), conversion, feed, &mut report) {
            break;
        }
    }
    report.damage = bag.damage().clone();
    if !report.is_interrupted {
        report.missing = bag.indexed_messages().map(|indexed| indexed.saturating_sub(seen));
    }
    if let Some(wanted) = &options.topics {
        let is_met = |name: &&String| {
            let names = |topic: &TopicReport| {
                topic.from == **name || topic.to.as_ref().is_some_and(|(to, _)| to == *name)
            };
            report.topics.iter().any(names)
        };
        report.absent = wanted.iter().filter(|name| !is_met(name)).cloned().collect();
    }
    report.topics.sort_by(|one, other| one.from.cmp(&other.from));
    Ok(report)
}

/// Decides where the messages of a connection go.
fn way(
    id: u32,
    connections: &BTreeMap<u32, Connection>,
    conversion: &mut Conversion,
    feed: &mut Feed,
    options: &ConvertOptions,
    report: &mut Report,
) -> Way {
    let Some(connection) = connections.get(&id) else { return Way::NotWanted };
    let Connection { topic, type_name, .. } = connection;
    let is_wanted = |name: &str| options.topics.as_ref().is_none_or(|all| all.contains(name));
    let target = conversion.target(connection);
    let to = target.as_ref().ok().map(|target| target.topic.clone());
    if !is_wanted(topic) && !to.as_deref().is_some_and(is_wanted) {
        return Way::NotWanted;
    }
    let name_of = |to: &Option<String>, ros2: &str| to.clone().map(|to| (to, ros2.to_owned()));
    let ros2_type = target.as_ref().map_or_else(|_| String::new(), |it| it.ros2.name().to_string());
    let to = name_of(&to, &ros2_type);
    let is_same =
        |one: &TopicReport| one.from == *topic && one.ros1_type == *type_name && one.to == to;
    let index = match report.topics.iter().position(is_same) {
        Some(index) => index,
        None => {
            let (from, ros1_type) = (topic.clone(), type_name.clone());
            report.topics.push(TopicReport { from, ros1_type, to, ..TopicReport::default() });
            report.topics.len() - 1
        }
    };
    let Some(entry) = report.topics.get_mut(index) else { return Way::NotWanted };
    match target {
        Err(reason) => {
            entry.why.get_or_insert_with(|| reason.to_owned());
            Way::LeftOut(index)
        }
        Ok(target) => {
            for note in &target.notes {
                if !entry.notes.contains(note) {
                    entry.notes.push(note.clone());
                }
            }
            let same = connections.values().filter(|one| one.topic == *topic);
            let qos = offered(same.filter(|one| one.type_name == *type_name));
            let topic = feed.add_topic(Topic::of(&target.topic, &target.ros2, qos));
            Way::Written(topic, index)
        }
    }
}

/// Carries one message over, or counts it; false where the writer has ended.
fn carry(
    way: Way,
    (connection, time_ns, data): (u32, u64, &[u8]),
    conversion: &Conversion,
    feed: &mut Feed,
    report: &mut Report,
) -> bool {
    let (topic, index) = match way {
        Way::Written(topic, index) => (Some(topic), index),
        Way::LeftOut(index) => (None, index),
        Way::NotWanted => return true,
    };
    let Some(entry) = report.topics.get_mut(index) else { return true };
    let Some(topic) = topic else {
        entry.left_out += 1;
        return true;
    };
    let changes = &mut entry.changes;
    let put = |cdr: &mut Vec<u8>| match conversion.convert(connection, data, cdr) {
        Some(Ok(Transcoded { cut_texts, bad_texts, wrapped_times })) => {
            changes.cut_texts = changes.cut_texts.saturating_add(cut_texts);
            changes.bad_texts = changes.bad_texts.saturating_add(bad_texts);
            changes.wrapped_times = changes.wrapped_times.saturating_add(wrapped_times);
            Ok(())
        }
        Some(Err(error)) => Err(Some(error)),
        None => Err(None),
    };
    match feed.add((topic, time_ns), put) {
        Ok(goes_on) => {
            entry.messages += 1;
            report.messages += 1;
            report.bytes = report.bytes.saturating_add(data.len() as u64);
            goes_on
        }
        Err(error) => {
            entry.left_out += 1;
            if entry.why.is_none() {
                entry.why = error.map(|error| error.to_string());
            }
            true
        }
    }
}
