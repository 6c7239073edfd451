//! `wrapyfi convert`: a bag of ROS 1 becomes a recording of ROS 2.

use std::collections::BTreeSet;
use std::fs::File;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use wrapyfi_bag::ros1::{BagReader, Limits, OpenError};
use wrapyfi_bag::{Conversion, ConvertError, ConvertOptions, Progress, Report, TopicReport};
use wrapyfi_interfaces::ros1::{Options, Rules, Transcoded, Types};
use wrapyfi_interfaces::store::TypeStore;

use super::output::Place;
use crate::bag_cli::ConvertArgs;
use crate::columns::aligned;
use crate::command::definitions;
use crate::exit::{Failure, Result};
use crate::output;
use crate::shutdown::Shutdown;

/// Time between two lines of progress.
const SAY_EVERY: Duration = Duration::from_secs(5);
/// Bytes in a MiB.
const MIB: f64 = 1024.0 * 1024.0;

/// Converts, and prints what became of each topic.
///
/// # Errors
/// Exit code 2 for a file that is no bag, and a recording that is there already; 1 when something was left out, which the
/// report says.
pub fn run(args: &ConvertArgs, shutdown: &Shutdown) -> Result<()> {
    let shown = args.bag.display();
    let mib = usize::try_from(args.max_message_mib).unwrap_or(usize::MAX);
    let message_bytes = mib.saturating_mul(1 << 20);
    let types = types(&args.definitions)?;
    if args.bag.is_dir() {
        return Err(Failure::Usage(format!("{shown} is a folder: name a bag of ROS 1 in it")));
    }
    let file =
        File::open(&args.bag).map_err(|error| Failure::Usage(format!("{shown}: {error}")))?;
    let limits = Limits { message_bytes, ..Limits::default() };
    let mut bag = BagReader::open(file, limits).map_err(|error| match error {
        OpenError::Io(error) => {
            Failure::Failed(anyhow::Error::new(error).context(shown.to_string()))
        }
        other => Failure::Usage(format!("{shown}: {other}")),
    })?;
    if !bag.is_indexed() {
        tracing::warn!("{shown} has no index that can be read: its records are read one by one");
    }
    let path = args.out.clone().unwrap_or_else(|| args.bag.with_extension("mcap"));
    let place = Place::new(&path)?;
    let options = Options { message_bytes, elements: usize::MAX };
    let mut conversion = Conversion::new(types, options);
    let topics: BTreeSet<String> = args.topics.iter().cloned().collect();
    check_topics(&topics, &bag, &mut conversion)
        .map_err(|why| Failure::Usage(format!("{shown}{why}")))?;
    let mut out = place.create(args.compression.into())?;
    let wanted = ConvertOptions { topics: (!topics.is_empty()).then_some(topics) };
    let (start, mut said) = (Instant::now(), Instant::now());
    let mut look = |progress: &Progress| {
        if said.elapsed() >= SAY_EVERY {
            said = Instant::now();
            let Progress { read_bytes, size_bytes, messages } = progress;
            let part = 100.0 * *read_bytes as f64 / (*size_bytes).max(1) as f64;
            tracing::info!("{part:.0} %: {messages} messages");
        }
        !shutdown.requested()
    };
    let report = wrapyfi_bag::convert(&mut bag, &mut conversion, &mut out, &wanted, &mut look);
    let report = report.map_err(|error| {
        let file = if matches!(error, ConvertError::Write(_)) { &place.file } else { &args.bag };
        anyhow::Error::new(error).context(file.display().to_string())
    });
    // What was written before an error stays, with its index.
    let metadata = place.finish(out);
    let report = report?;
    metadata?;
    let took = start.elapsed();
    match args.json {
        true => output::line(&as_json(&report, &place.file.display().to_string()).to_string())?,
        false => print(&report, &place, took)?,
    }
    if report.is_complete() { Ok(()) } else { Err(Failure::Found) }
}

/// Refuses topics of which a bag with an index has none, by their names in it or in ROS 2.
fn check_topics(
    wanted: &BTreeSet<String>,
    bag: &BagReader<File>,
    conversion: &mut Conversion,
) -> Result<(), String> {
    if wanted.is_empty() || !bag.is_indexed() {
        return Ok(());
    }
    conversion.take_up(bag.connections().values());
    let mut names = BTreeSet::new();
    for connection in bag.connections().values() {
        let converted = conversion.target(connection).map(|target| target.topic.clone());
        if wanted.contains(&connection.topic) || converted.is_ok_and(|name| wanted.contains(&name))
        {
            return Ok(());
        }
        names.insert(connection.topic.as_str());
    }
    let wanted = wanted.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
    let names = names.into_iter().collect::<Vec<_>>().join(", ");
    Err(format!(" has no topic {wanted}; it has {names}"))
}

/// Types of ROS 2 of the folders that are named, then of the ROS 2 that is sourced.
pub(crate) fn types(folders: &[PathBuf]) -> Result<Types> {
    let fault = |text| Failure::Usage(format!("--definitions {text}"));
    folders.iter().try_for_each(|folder| definitions::check(folder)).map_err(fault)?;
    let mut store = TypeStore::empty();
    for folder in folders {
        store.add_folder(folder);
    }
    store.add_ament_path(&std::env::var_os("AMENT_PREFIX_PATH").unwrap_or_default());
    Ok(Types::new(Rules::built_in(), store))
}

fn print(report: &Report, place: &Place, took: Duration) -> Result<()> {
    let rows: Vec<_> = report.topics.iter().map(row).collect();
    for line in aligned(&rows, 2) {
        output::line(&line)?;
    }
    for line in remarks(report) {
        output::line(&line)?;
    }
    let (seconds, mib) = (took.as_secs_f64(), report.bytes as f64 / MIB);
    let rate = mib / seconds.max(1e-3);
    let (messages, file) = (report.messages, place.file.display());
    output::line(&format!(
        "{messages} messages, {mib:.1} MiB in {seconds:.1} s ({rate:.0} MiB/s) in {file}"
    ))
}

/// Topic, types, messages that were written and left out.
fn row(topic: &TopicReport) -> [String; 4] {
    let TopicReport { from, ros1_type, to, messages, left_out, .. } = topic;
    let (name, types) = match to {
        Some((to, ros2_type)) => (to, format!("{ros1_type} → {ros2_type}")),
        None => (from, format!("{ros1_type}, left out")),
    };
    let left_out = if *left_out == 0 { String::new() } else { format!("{left_out} left out") };
    [name.clone(), types, format!("{messages} messages"), left_out]
}

/// Sentences about what differs, was left out, or could not be read.
fn remarks(report: &Report) -> Vec<String> {
    let mut all = Vec::new();
    for topic in &report.topics {
        let from = &topic.from;
        all.extend(topic.notes.iter().map(|note| format!("{from}: {note}")));
        let Transcoded { cut_texts, bad_texts, wrapped_times } = topic.changes;
        for (count, what) in [
            (cut_texts, "texts end at a NUL"),
            (bad_texts, "texts that are no UTF-8 have U+FFFD in them"),
            (wrapped_times, "times are behind the year 2038, which ROS 2 cannot tell"),
        ] {
            if count > 0 {
                all.push(format!("{from}: {count} {what}"));
            }
        }
        if let Some(why) = &topic.why {
            all.push(format!("{from}: {} messages left out: {why}", topic.left_out));
        }
    }
    all.extend(report.absent.iter().map(|name| format!("{name}: no such topic is in the bag")));
    all.extend(report.damage.to_string().lines().map(str::to_owned));
    match report.missing {
        Some(missing @ 1..) => {
            all.push(format!("{missing} messages that the index counts could not be read"));
        }
        None if report.is_interrupted => all.push("ended before the end of the bag".to_owned()),
        _ => {}
    }
    all
}

fn as_json(report: &Report, file: &str) -> Value {
    let topics = report.topics.iter().map(|topic| {
        let (to, ros2_type) = topic.to.clone().unzip();
        json!({
            "from": topic.from, "ros1_type": topic.ros1_type, "to": to, "ros2_type": ros2_type,
            "messages": topic.messages, "left_out": topic.left_out, "why": topic.why, "notes": topic.notes,
        })
    });
    let places = report
        .damage
        .places
        .iter()
        .map(|(at, fault)| json!({ "byte": at, "fault": fault.to_string() }));
    json!({
        "file": file, "messages": report.messages, "bytes": report.bytes, "complete": report.is_complete(),
        "topics": topics.collect::<Vec<_>>(), "absent": report.absent, "missing": report.missing,
        "damage": { "places": places.collect::<Vec<_>>(), "count": report.damage.count,
                    "skipped_bytes": report.damage.skipped_bytes },
    })
}
