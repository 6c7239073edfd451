//! Reads YAML, and finds all faults at once: an entry that is wrong is told and left out, and the rest is read again.
//!
//! ```text
//!   text ─▶ serde ─▶ value
//!     ▲       └─ fault at a place ─▶ Problem
//!     └── without ◀─ entry at the place ◀─ Entries ◀─ granit_parser
//! ```

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use granit_parser::{Event, Parser};
use serde::de::DeserializeOwned;
use serde_saphyr::Error;

use super::problem::{ConfigError, Examples, MAX_CONFIG_BYTES, Problem};

/// Most faults that are told at once.
const MOST: usize = 50;

/// Most bytes that are read to find them, so that a large text with many faults takes no longer than one without.
const MOST_BYTES: usize = 1 << 20;

/// A value that was read from YAML, with the faults of its text.
#[derive(Debug)]
pub struct Reading<T> {
    /// The value without the entries that are wrong; `None` where the rest cannot be read.
    pub value: Option<T>,
    /// Faults, in the order of their lines.
    pub problems: Vec<Problem>,
    /// Places of the items of lists that are wrong, with the keys of their entries that are: none where it is the item
    /// itself.
    pub wrong_items: BTreeMap<(u64, u64), Vec<Option<String>>>,
}

impl<T> Reading<T> {
    /// The value, where nothing is wrong.
    ///
    /// # Errors
    /// With all faults; `file` is the name of the text.
    pub fn whole(self, file: &str) -> Result<T, ConfigError> {
        match self.value {
            Some(value) if self.problems.is_empty() => Ok(value),
            _ => Err(ConfigError { file: file.to_owned(), problems: self.problems }),
        }
    }
}

impl<T: DeserializeOwned> Reading<T> {
    /// Reads a text; `examples` says what to write for a key.
    pub fn new(text: &str, examples: Examples<'_>) -> Self {
        let mut reading = Self { value: None, problems: Vec::new(), wrong_items: BTreeMap::new() };
        if text.len() > MAX_CONFIG_BYTES {
            reading.problems.push(Problem::too_large(text.len()));
            return reading;
        }
        let mut rest = Cow::Borrowed(text);
        let (mut left_out, mut bytes) = (BTreeSet::new(), 0_usize);
        while reading.problems.len() < MOST && (bytes == 0 || bytes + rest.len() <= MOST_BYTES) {
            bytes += rest.len();
            let error = match serde_saphyr::from_str(&rest) {
                Ok(value) => {
                    reading.value = Some(value);
                    break;
                }
                Err(error) => error,
            };
            let place = error.location().map(|at| (at.line(), at.column()));
            let entries = Entries::of(&rest).unwrap_or_default();
            let path = place.map(|place| entries.path(&rest, place)).unwrap_or_default();
            let key = path.iter().rev().find_map(|entry| entry.key.as_deref());
            // A key is also missing because its entry was left out, and a place has one fault.
            let follows = match error.without_snippet() {
                Error::SerdeMissingField { field, .. } => left_out.contains::<str>(field),
                _ => reading.problems.iter().any(|told| told.position == place),
            };
            if !follows {
                reading.problems.push(Problem::read(text, &error, key, examples));
            }
            // What is left must not be empty, which would be another fault.
            let Some(entry) = path.iter().rfind(|entry| entry.siblings > 1) else { break };
            left_out.extend(entry.key.clone());
            for (at, item) in path.iter().enumerate().filter(|(_, entry)| entry.key.is_none()) {
                let wrong = path.get(at + 1).and_then(|entry| entry.key.clone());
                let place = place_of(&rest, item.bytes.start);
                reading.wrong_items.entry(place).or_default().push(wrong);
            }
            let shorter = without(&rest, entry);
            if shorter == rest {
                break;
            }
            rest = Cow::Owned(shorter);
        }
        reading.problems.sort_by_key(|problem| problem.position);
        reading
    }
}

/// An entry `key: value` of a mapping, or an item of a list.
#[derive(Debug, Default)]
struct Entry {
    /// The key; `None` for an item.
    key: Option<String>,
    bytes: Range<usize>,
    /// True within braces or brackets.
    is_flow: bool,
    /// Number of entries in its mapping or list, with itself.
    siblings: usize,
}

/// A mapping or list that is being read.
struct Open {
    is_mapping: bool,
    is_flow: bool,
    /// Indices of its entries.
    entries: Vec<usize>,
    /// True between a key and the end of its value.
    has_key: bool,
    /// Byte at which its last value ends.
    end: usize,
}

/// All entries of a text, each before those of its value.
#[derive(Debug, Default)]
struct Entries(Vec<Entry>);

impl Entries {
    /// The entries; `None` where the text is no YAML, or has keys that are no words.
    fn of(text: &str) -> Option<Self> {
        let (mut entries, mut open) = (Vec::<Entry>::new(), Vec::<Open>::new());
        for event in Parser::new_from_str(text) {
            let (event, span) = event.ok()?;
            let bytes = span.byte_range()?;
            let is_mapping = matches!(event, Event::MappingStart(..));
            let is_start = is_mapping || matches!(event, Event::SequenceStart(..));
            let is_end = matches!(event, Event::MappingEnd | Event::SequenceEnd);
            if !(is_start || is_end || matches!(event, Event::Scalar(..) | Event::Alias(_))) {
                continue;
            }
            let mut end = bytes.end;
            if is_end {
                let Open { is_flow, end: of_last, entries: own, .. } = open.pop()?;
                end = if is_flow { end } else { of_last };
                for index in &own {
                    entries.get_mut(*index)?.siblings = own.len();
                }
            } else if let Some(parent) = open.last_mut()
                && !parent.has_key
            {
                let key = match &event {
                    _ if !parent.is_mapping => None,
                    Event::Scalar(text, ..) => Some(text.to_string()),
                    _ => return None,
                };
                parent.has_key = true;
                parent.entries.push(entries.len());
                let (is_key, is_flow) = (key.is_some(), parent.is_flow);
                entries.push(Entry { key, bytes: bytes.clone(), is_flow, siblings: 1 });
                if is_key {
                    continue;
                }
            }
            if is_start {
                let is_flow = text.get(bytes.start..)?.starts_with(['{', '[']);
                let (entries, end) = (Vec::new(), bytes.end);
                open.push(Open { is_mapping, is_flow, entries, has_key: false, end });
                continue;
            }
            let Some(parent) = open.last_mut() else { continue };
            (parent.has_key, parent.end) = (false, end);
            let entry = parent.entries.last().and_then(|index| entries.get_mut(*index))?;
            entry.bytes.end = end.max(entry.bytes.end);
        }
        Some(Self(entries))
    }

    /// The entries that a place is in, from the outermost to the innermost.
    fn path(&self, text: &str, place: (u64, u64)) -> Vec<&Entry> {
        let Some(at) = byte_of(text, place) else { return Vec::new() };
        self.0.iter().filter(|it| it.bytes.start <= at && at <= it.bytes.end).collect()
    }
}

/// The text with blanks for an entry, so that all that follows stays at its line and column.
fn without(text: &str, entry: &Entry) -> String {
    let Range { mut start, mut end } = entry.bytes;
    let (before, after) = (text.get(..start).unwrap_or(""), text.get(end..).unwrap_or(""));
    let after_blanks = after.trim_start();
    if entry.is_flow && after_blanks.starts_with(',') {
        end += after.len() - after_blanks.len() + 1;
    } else if (entry.is_flow && before.trim_end().ends_with(','))
        || (entry.key.is_none() && before.trim_end().ends_with('-'))
    {
        start = before.trim_end().len() - 1;
    }
    let blank = |(at, c): (usize, char)| match (start..end).contains(&at) && c != '\n' {
        true => ' ',
        false => c,
    };
    text.char_indices().map(blank).collect()
}

/// Byte at a line and column, both from 1.
fn byte_of(text: &str, (line, column): (u64, u64)) -> Option<usize> {
    let above = usize::try_from(line).ok()?.checked_sub(1)?;
    let start: usize = text.split_inclusive('\n').take(above).map(str::len).sum();
    let rest = text.get(start..)?;
    let within = usize::try_from(column).ok()?.checked_sub(1)?;
    Some(start + rest.char_indices().nth(within).map_or(rest.len(), |(at, _)| at))
}

/// Line and column of a byte, both from 1.
fn place_of(text: &str, byte: usize) -> (u64, u64) {
    let before = text.get(..byte).unwrap_or(text);
    let line = before.rsplit('\n').next().unwrap_or("");
    let count = |n: usize| u64::try_from(n + 1).unwrap_or(u64::MAX);
    (count(before.matches('\n').count()), count(line.chars().count()))
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Robot {
        name: String,
        #[serde(default)]
        domain: u32,
        #[serde(default)]
        arms: Vec<Arm>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Arm {
        joints: u32,
        #[serde(default)]
        names: Vec<String>,
    }

    fn read(text: &str) -> Reading<Robot> {
        Reading::new(text, &|key| (key == "joints").then_some("7"))
    }

    fn places(text: &str) -> Vec<(u64, u64)> {
        let problems = read(text).problems;
        problems.iter().filter_map(|problem| problem.position).collect()
    }

    #[test]
    fn what_is_right_has_no_problems() {
        let Robot { name, domain, arms } = read("name: a\n").whole("x").unwrap();
        assert_eq!((name.as_str(), domain, arms), ("a", 0, vec![]));
    }

    #[test]
    fn every_fault_is_told_with_its_place() {
        // A number that is none, a list in quotes, an unknown key with many lines, a value with commas.
        let text = "domain: \"a, b\"\narms:\n- joints: many\n  names: 'x, y'\n- joint:\n    a: [1,\n      2]\n    b: {c: 1}\n  joints: 3\n- {joints: [1, 2], names: {a: 1}, other: 1}\nname: a\n";
        let expected = [(1, 9), (3, 11), (4, 10), (5, 3), (10, 12), (10, 27), (10, 35)];
        assert_eq!(places(text), expected);
        let Reading { value, problems, wrong_items } = read(text);
        let robot = value.unwrap();
        assert_eq!((robot.name.as_str(), robot.domain), ("a", 0));
        assert!(problems[1].message.contains("write for example `joints: 7`"), "{problems:?}");
        let items = [(3, 3), (5, 3), (10, 3)];
        assert!(items.iter().all(|item| wrong_items.contains_key(item)), "{wrong_items:?}");
        assert_eq!(wrong_items[&(3, 3)], [Some("joints".to_owned())]);
    }

    #[test]
    fn what_only_follows_is_not_told() {
        // The item without its only entry, and a key that was left out.
        assert_eq!(places("name: a\narms: [{joint: 1}]\n"), [(2, 9)]);
        assert_eq!(places("name: [a]\ndomain: x\n"), [(1, 7), (2, 9)]);
        assert_eq!(places("name: a\narms:\n- joints: many\n"), [(3, 11)]);
        assert_eq!(places("name: a\nname: b\ndomain: x\n"), [(2, 1), (3, 9)]);
    }

    #[test]
    fn what_is_missing_is_told_beside_other_faults() {
        let Reading { problems, .. } = read("domain: x\narms: [{}, {joints: 1}]\n");
        let told: Vec<_> = problems.iter().map(|it| it.message.as_str()).collect();
        assert!(told.iter().any(|it| it.starts_with("key `joints` is missing")), "{told:?}");
        assert!(told.iter().any(|it| it.starts_with("key `name` is missing")), "{told:?}");
        assert!(told.len() == 3, "{told:?}");
    }

    #[test]
    fn what_is_no_yaml_has_one_fault() {
        for text in ["name: [\n", "name: a\n b: c\n", "? {a: 1}\n: 2\n", "\t", "- *x\n", "&a [*a]"]
        {
            let Reading { value, problems, .. } = read(text);
            assert!(value.is_none() && problems.len() == 1, "{text:?}: {problems:?}");
        }
    }

    #[test]
    fn faults_are_bounded() {
        let text = format!("name: a\narms: [{}]\n", "{joint: 1},".repeat(3 * MOST));
        assert_eq!(places(&text).len(), MOST);
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_without_panic(text in "([a-c]|[a-c]: |- |\n|\n  |[\\[\\]{},'\"é#&*!|>]){0,60}") {
            let _ = read(&text);
            let _ = read(&format!("name: a\narms:\n{text}"));
        }
    }
}
