//! Matching of the fields of one type with those of the other.
//!
//! ```text
//!   rosgraph_msgs/Log             rcl_interfaces/Log        a rule says so
//!     header.seq
//!     header.stamp  ───────────────  stamp                  `header` is unfolded for it
//!     header.frame_id
//!     level         ───────────────  level
//! ```

use std::collections::{BTreeMap, BTreeSet};

use super::error::PairError;
use super::names::snake_case;
use super::rules::{FieldRule, Rules};
use crate::parser::{Container, Element, Field, MessageDefinition, TypeName};

/// Definitions by name.
pub(super) type Definitions = BTreeMap<TypeName, MessageDefinition>;

/// A field, maybe of a message inside.
#[derive(Debug, Clone)]
pub(super) struct Entry<'d> {
    /// `stamp`, `header.stamp`.
    pub(super) path: String,
    pub(super) field: &'d Field,
    /// The message it is a field of.
    pub(super) owner: &'d TypeName,
}

/// Fields of both, in order, and which belong together.
#[derive(Debug)]
pub(super) struct Match<'d> {
    pub(super) ros1: Vec<Entry<'d>>,
    pub(super) ros2: Vec<Entry<'d>>,
    /// Positions in the two.
    pub(super) links: Vec<(usize, usize)>,
}

/// Brings the fields of two messages together: by rule, else by name. A ROS 1 name counts in small
/// letters and with underscores, too.
pub(super) fn match_fields<'d>(
    ros1: (&'d TypeName, &'d Definitions),
    ros2: (&'d TypeName, &'d Definitions),
    rules: &Rules,
) -> Result<Match<'d>, PairError> {
    let rule = rules
        .fields(ros1.0, ros2.0)
        .unwrap_or_else(|| FieldRule { pairs: Vec::new(), others: true });
    let paths = |side: fn(&(String, String)) -> &String| -> BTreeSet<&str> {
        rule.pairs.iter().map(|pair| side(pair).as_str()).collect()
    };
    let one = entries(ros1.0, ros1.1, &paths(|pair| &pair.0))?;
    let two = entries(ros2.0, ros2.1, &paths(|pair| &pair.1))?;
    let mut links = Vec::new();
    let mut taken = BTreeSet::new();
    for (path1, path2) in &rule.pairs {
        let first = position(&one, path1, ros1.0)?;
        let second = position(&two, path2, ros2.0)?;
        if !taken.insert(second) {
            return Err(PairError::RuleTwice { name: ros2.0.clone(), path: path2.clone() });
        }
        links.push((first, second));
    }
    if rule.others {
        let mut linked: BTreeSet<usize> = links.iter().map(|(first, _)| *first).collect();
        let by_path: BTreeMap<&str, usize> =
            two.iter().enumerate().map(|(at, entry)| (entry.path.as_str(), at)).collect();
        // Names that are the same come before those that only look alike.
        let spellings: [fn(&str) -> String; 3] =
            [str::to_owned, str::to_lowercase, spelled_as_in_ros2];
        for spelling in spellings {
            for (first, entry) in one.iter().enumerate() {
                if linked.contains(&first) {
                    continue;
                }
                if let Some(second) = by_path.get(spelling(&entry.path).as_str())
                    && taken.insert(*second)
                {
                    linked.insert(first);
                    links.push((first, *second));
                }
            }
        }
        refuse_alike(ros1.0, &one, &links, &linked)?;
    }
    Ok(Match { ros1: one, ros2: two, links })
}

/// Refuses fields of ROS 1 that ROS 2 spells like another one which is carried: one of the two values would be lost.
fn refuse_alike(
    name: &TypeName,
    all: &[Entry<'_>],
    links: &[(usize, usize)],
    linked: &BTreeSet<usize>,
) -> Result<(), PairError> {
    let carried = links.iter().filter_map(|(first, _)| all.get(*first));
    let carried: BTreeMap<String, &str> =
        carried.map(|entry| (spelled_as_in_ros2(&entry.path), entry.path.as_str())).collect();
    for (first, entry) in all.iter().enumerate() {
        let spelled = spelled_as_in_ros2(&entry.path);
        let other = carried.get(&spelled).filter(|_| !linked.contains(&first));
        if let Some(other) = other {
            return Err(PairError::Alike {
                name: name.clone(),
                fields: [(*other).to_owned(), entry.path.clone()],
                spelled,
            });
        }
    }
    Ok(())
}

fn spelled_as_in_ros2(path: &str) -> String {
    path.split('.').map(snake_case).collect::<Vec<_>>().join(".")
}

fn position(entries: &[Entry<'_>], path: &str, name: &TypeName) -> Result<usize, PairError> {
    entries.iter().position(|entry| entry.path == path).ok_or_else(|| {
        let fields = entries.iter().map(|entry| entry.path.clone()).collect();
        PairError::RuleField { name: name.clone(), path: path.to_owned(), fields }
    })
}

/// Fields of a message in order; those of which a rule names parts are unfolded.
fn entries<'d>(
    name: &'d TypeName,
    definitions: &'d Definitions,
    named: &BTreeSet<&str>,
) -> Result<Vec<Entry<'d>>, PairError> {
    let mut entries = Vec::new();
    unfold("", name, definitions, named, &mut entries)?;
    Ok(entries)
}

/// Calls itself once for each message in a message, of which a described type has few.
fn unfold<'d>(
    prefix: &str,
    name: &'d TypeName,
    definitions: &'d Definitions,
    named: &BTreeSet<&str>,
    entries: &mut Vec<Entry<'d>>,
) -> Result<(), PairError> {
    let (owner, definition) =
        definitions.get_key_value(name).ok_or_else(|| PairError::Undefined(name.clone()))?;
    for field in &definition.fields {
        let path = format!("{prefix}{}", field.name);
        let inside = format!("{path}.");
        let nested = match (&field.field_type.element, field.field_type.container) {
            (Element::Nested(nested), Container::Single) => Some(nested),
            _ => None,
        };
        match nested.filter(|_| named.iter().any(|named| named.starts_with(&inside))) {
            None => entries.push(Entry { path, field, owner }),
            Some(_) if named.contains(path.as_str()) => {
                return Err(PairError::RuleTwice { name: name.clone(), path });
            }
            Some(nested) => unfold(&inside, nested, definitions, named, entries)?,
        }
    }
    Ok(())
}
