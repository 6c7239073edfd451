//! Sources of `wrapyfi play`: recordings of ROS 2, and bags of ROS 1, which are converted on the way.
//!
//! ```text
//!   NAME.mcap ─────────────┐
//!   folder of `ros2 bag` ──┼─▶ Source ─▶ topic, time, CDR
//!   NAME.bag ─ Conversion ─┘
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use wrapyfi_bag::recording::{Reader, RecordedTopic};
use wrapyfi_bag::ros1::{BagReader, Connection, Limits};
use wrapyfi_bag::{Conversion, offered};
use wrapyfi_data::types::RosType;
use wrapyfi_endpoint::{Durability, History, Qos, Reliability, Throttle};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::ros1::Options;
use wrapyfi_interfaces::store::ResolvedType;

use super::convert::types;
use crate::exit::{Failure, Result};

/// Largest message, and largest chunk of a recording, in bytes.
const MOST_BYTES: usize = 256 << 20;
/// First bytes of a bag of ROS 1.
const BAG: &[u8] = b"#ROSBAG";

/// A topic of a recording as it can be published.
#[derive(Debug, Clone)]
pub(super) struct PlayedTopic {
    pub(super) name: String,
    pub(super) ros_type: RosType,
    pub(super) qos: Qos,
    /// Type as a bag of ROS 1 has it: what is published on ROS 1 is that again.
    pub(super) of_ros1: Option<Ros1Type>,
}

/// A topic of a recording that cannot be published.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {why}")]
pub(super) struct LeftOut {
    pub(super) name: String,
    why: String,
}

/// Type of a topic in a bag of ROS 1.
#[derive(Debug, Clone)]
pub(super) struct Ros1Type {
    pub(super) name: String,
    pub(super) md5sum: String,
    pub(super) definition: String,
}

/// A message of a recording.
pub(super) struct Played {
    /// Index of its topic.
    pub(super) topic: usize,
    pub(super) time_ns: u64,
    pub(super) cdr: Vec<u8>,
}

/// A recording that is being played.
pub(super) struct Source {
    /// Topics that are known.
    topics: Vec<Result<PlayedTopic, LeftOut>>,
    kind: Kind,
}

enum Kind {
    /// Recordings, one behind the other: the open one with the places of its topics, and the rest, the last first.
    Mcap {
        file: PathBuf,
        open: Box<Reader<BufReader<File>>>,
        indices: Vec<usize>,
        rest: Vec<PathBuf>,
    },
    Bag {
        bag: Box<BagReader<File>>,
        conversion: Box<Conversion>,
        indices: BTreeMap<u32, usize>,
        losses: Throttle,
    },
}

impl Source {
    /// Opens what is at `path`.
    ///
    /// # Errors
    /// Exit code 2 where it is no recording.
    pub(super) fn open(path: &Path, definitions: &[PathBuf]) -> Result<Self> {
        let shown = path.display();
        let mut files = files(path)?;
        files.reverse();
        let fault = |error: &dyn std::fmt::Display| Failure::Usage(format!("{shown}: {error}"));
        let first = files.pop().ok_or_else(|| fault(&"it names no file"))?;
        let mut begin = Vec::new();
        let mut file = File::open(&first).map_err(|error| fault(&error))?;
        file.by_ref()
            .take(BAG.len() as u64)
            .read_to_end(&mut begin)
            .map_err(|error| fault(&error))?;
        let kind = if begin == BAG {
            let limits = Limits { message_bytes: MOST_BYTES, ..Limits::default() };
            let bag = BagReader::open(file, limits).map_err(|error| fault(&error))?;
            let options = Options { message_bytes: MOST_BYTES, elements: usize::MAX };
            let conversion = Conversion::new(types(definitions)?, options);
            let (bag, conversion) = (Box::new(bag), Box::new(conversion));
            Kind::Bag { bag, conversion, indices: BTreeMap::new(), losses: Throttle::default() }
        } else {
            let open =
                Reader::open(BufReader::new(file), MOST_BYTES).map_err(|error| fault(&error))?;
            Kind::Mcap { file: first, open: Box::new(open), indices: Vec::new(), rest: files }
        };
        let mut source = Self { topics: Vec::new(), kind };
        source.look();
        Ok(source)
    }

    /// Topics that are known so far: all of a recording with an index.
    pub(super) fn topics(&self) -> &[Result<PlayedTopic, LeftOut>] {
        &self.topics
    }

    /// The next message.
    ///
    /// # Errors
    /// Exit code 1 where the recording cannot be read on.
    pub(super) fn next(&mut self) -> Result<Option<Played>> {
        loop {
            let Self { kind, topics } = self;
            match kind {
                Kind::Mcap { file, open, indices, rest } => {
                    if let Some(next) = open.next_message().context("the recording")? {
                        for topic in open.topics().iter().skip(indices.len()) {
                            indices.push(place(topics, recorded(topic)));
                        }
                        let Some(topic) = indices.get(next.topic).copied() else { continue };
                        let (time_ns, cdr) = (next.time_ns, next.cdr);
                        return Ok(Some(Played { topic, time_ns, cdr }));
                    }
                    if open.is_cut() {
                        tracing::warn!(
                            "{} has no end: its recording was killed, or it is cut; what is whole of it is played",
                            file.display()
                        );
                    }
                    let Some(path) = rest.pop() else { return Ok(None) };
                    let next = File::open(&path).with_context(|| path.display().to_string())?;
                    let next = Reader::open(BufReader::new(next), MOST_BYTES);
                    **open = next.with_context(|| path.display().to_string())?;
                    *file = path;
                    indices.clear();
                }
                Kind::Bag { bag, conversion, indices, losses } => {
                    let Some(next) = bag.next_message().context("the bag")? else {
                        bag.damage().to_string().lines().for_each(|line| tracing::warn!("{line}"));
                        return Ok(None);
                    };
                    let (id, time_ns) = (next.connection, next.time_ns);
                    if !indices.contains_key(&id) {
                        take_connections(bag, conversion, indices, topics);
                    }
                    let Some(topic) = indices.get(&id).copied() else { continue };
                    let mut cdr = Vec::new();
                    match conversion.convert(id, bag.message(), &mut cdr) {
                        Some(Ok(_)) => return Ok(Some(Played { topic, time_ns, cdr })),
                        Some(Err(error)) => {
                            if let Some(unlogged_before) = losses.pass(Instant::now()) {
                                tracing::warn!(
                                    unlogged_before,
                                    "a message cannot be converted: {error}"
                                );
                            }
                        }
                        None => {}
                    }
                }
            }
        }
    }

    /// Takes over the topics that are known before the first message.
    fn look(&mut self) {
        let Self { kind, topics } = self;
        match kind {
            Kind::Mcap { open, indices, .. } => {
                for topic in open.topics() {
                    indices.push(place(topics, recorded(topic)));
                }
            }
            Kind::Bag { bag, conversion, indices, .. } => {
                take_connections(bag, conversion, indices, topics);
            }
        }
    }
}

/// Takes over the connections of a bag that are known and have no place yet.
fn take_connections(
    bag: &BagReader<File>,
    conversion: &mut Conversion,
    indices: &mut BTreeMap<u32, usize>,
    topics: &mut Vec<Result<PlayedTopic, LeftOut>>,
) {
    let connections = bag.connections();
    conversion.take_up(connections.values());
    for (id, connection) in connections {
        if indices.contains_key(id) {
            continue;
        }
        let same = connections.values().filter(|one| {
            (&one.topic, &one.type_name) == (&connection.topic, &connection.type_name)
        });
        let topic = conversion.target(connection).map_err(str::to_owned).and_then(|target| {
            let ros_type = RosType::new(&target.ros2).map_err(|error| error.to_string())?;
            let qos = one_of(&offered(same));
            let Connection { type_name, md5sum, definition, .. } = connection.clone();
            let of_ros1 = Some(Ros1Type { name: type_name, md5sum, definition });
            Ok(PlayedTopic { name: target.topic.clone(), ros_type, qos, of_ros1 })
        });
        let topic = topic.map_err(|why| LeftOut { name: connection.topic.clone(), why });
        indices.insert(*id, place(topics, topic));
    }
}

/// Place of a topic, which is added where it is none of those that are known.
fn place(
    topics: &mut Vec<Result<PlayedTopic, LeftOut>>,
    topic: Result<PlayedTopic, LeftOut>,
) -> usize {
    let is_same = |one: &Result<PlayedTopic, LeftOut>| match (one, &topic) {
        (Ok(one), Ok(topic)) => (&one.name, one.ros_type) == (&topic.name, topic.ros_type),
        (Err(one), Err(topic)) => one == topic,
        _ => false,
    };
    if let Some(known) = topics.iter().position(is_same) {
        return known;
    }
    topics.push(topic);
    topics.len() - 1
}

/// A topic of a recording of ROS 2.
fn recorded(topic: &RecordedTopic) -> Result<PlayedTopic, LeftOut> {
    let RecordedTopic { name, type_name, encoding, definition_encoding, definition, qos, .. } =
        topic;
    let left_out = |why| LeftOut { name: name.clone(), why };
    if encoding != "cdr" {
        return Err(left_out(format!("its messages are {encoding:?}, only \"cdr\" can be played")));
    }
    if definition_encoding != "ros2msg" {
        return Err(left_out(format!(
            "its type {type_name} is defined by {definition_encoding:?}, only \"ros2msg\" can be read"
        )));
    }
    let resolved = TypeName::parse(Dialect::Ros2, type_name).map_err(|fault| fault.to_string());
    let resolved = resolved.and_then(|parsed| {
        ResolvedType::from_text(Dialect::Ros2, &parsed, definition)
            .map_err(|fault| fault.to_string())
    });
    let ros_type = resolved.and_then(|it| RosType::new(&it).map_err(|fault| fault.to_string()));
    let ros_type = ros_type.map_err(left_out)?;
    Ok(PlayedTopic { name: name.clone(), ros_type, qos: one_of(qos), of_ros1: None })
}

/// One quality of service for all that publishers offered: each listener that any of them fitted hears it.
fn one_of(offered: &[Qos]) -> Qos {
    let Some((first, others)) = offered.split_first() else { return Qos::default() };
    let mut qos = *first;
    for other in others {
        if other.durability == Durability::TransientLocal {
            qos.durability = Durability::TransientLocal;
        }
        if other.reliability == Reliability::Reliable {
            qos.reliability = Reliability::Reliable;
        }
        qos.history = match (qos.history, other.history) {
            (History::KeepLast(one), History::KeepLast(other)) => History::KeepLast(one.max(other)),
            _ => History::KeepAll,
        };
        // Promises that not all gave.
        if other.deadline != qos.deadline {
            qos.deadline = None;
        }
        if other.lease != qos.lease || other.liveliness != qos.liveliness {
            (qos.liveliness, qos.lease) = (Qos::default().liveliness, None);
        }
        if other.lifespan != qos.lifespan {
            qos.lifespan = None;
        }
    }
    qos
}

/// The files of a recording, in their order.
fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let shown = path.display();
    let entries = std::fs::read_dir(path).with_context(|| shown.to_string())?;
    let is_mcap = |path: &PathBuf| path.extension().is_some_and(|it| it == "mcap");
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_mcap);
    let mut found: Vec<PathBuf> = paths.collect();
    // `ros2 bag` numbers them: NAME_0.mcap, NAME_1.mcap, …, NAME_10.mcap.
    found.sort_by_key(|path| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let number = stem.rsplit_once('_').and_then(|(_, number)| number.parse::<u64>().ok());
        (number, stem)
    });
    if found.is_empty() {
        return Err(Failure::Usage(format!(
            "{shown} has no .mcap file: `ros2 bag convert` makes some of a recording with another storage"
        )));
    }
    Ok(found)
}
