//! Pairs of types to steps.
//!
//! Fields are written in the order of the target. In a source of another order a mark remembers
//! where a field begins, and the source is read from there when its turn comes.

use std::collections::{BTreeMap, BTreeSet};

use super::error::{PairError, TypedField};
use super::fill::OneSided;
use super::matching::{Definitions, Entry, match_fields};
use super::op::{Block, Check, CheckKind, Count, ELEMENT, Each, Op, PathId, Text, push};
use super::rules::Rules;
use super::sizes::Sizes;
use crate::parser::{Container, Element, Primitive, TypeName};

/// Most fields that a pair of types may unfold into.
pub(super) const MAX_FIELDS: usize = 1 << 16;
/// Most bytes that their names may take.
const MAX_PATH_BYTES: usize = 16 << 20;

/// The steps of one direction.
#[derive(Debug, Default)]
pub(super) struct Program {
    pub(super) ops: Vec<Op>,
    pub(super) paths: Vec<Box<str>>,
    pub(super) marks: usize,
}

/// Fields and constants that do not go across.
#[derive(Debug, Default)]
pub(super) struct Differences {
    pub(super) only_ros1: BTreeSet<String>,
    pub(super) only_ros2: BTreeSet<String>,
    pub(super) renamed: BTreeSet<(String, String)>,
}

/// Two types with all they refer to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'d> {
    pub(super) ros1: (&'d TypeName, &'d Definitions),
    pub(super) ros2: (&'d TypeName, &'d Definitions),
    pub(super) rules: &'d Rules,
}

/// Compiles one direction.
pub(super) fn compile(pair: Pair<'_>, to_ros2: bool) -> Result<(Program, Differences), PairError> {
    let mut compiler = Compiler {
        pair,
        to_ros2,
        program: Program::default(),
        differences: Differences::default(),
        fields: 0,
        path_bytes: 0,
        ros1_sizes: Sizes::new(pair.ros1.1, false),
        ros2_sizes: Sizes::new(pair.ros2.1, true),
    };
    let mut ops = Vec::new();
    compiler.message(pair.ros1.0, pair.ros2.0, &Place::default(), &mut ops)?;
    let Compiler { mut program, differences, .. } = compiler;
    program.ops = ops;
    Ok((program, differences))
}

/// Position of the compiler in both types.
#[derive(Debug, Default, Clone)]
struct Place {
    /// Path of the message in ROS 1 and in ROS 2, `transforms[].header.`.
    ros1: String,
    ros2: String,
    /// Path in the source, from the innermost loop on.
    local: String,
}

struct Compiler<'d> {
    pair: Pair<'d>,
    to_ros2: bool,
    program: Program,
    differences: Differences,
    fields: usize,
    path_bytes: usize,
    ros1_sizes: Sizes<'d>,
    ros2_sizes: Sizes<'d>,
}

impl<'d> Compiler<'d> {
    fn message(
        &mut self,
        ros1: &'d TypeName,
        ros2: &'d TypeName,
        place: &Place,
        ops: &mut Vec<Op>,
    ) -> Result<(), PairError> {
        let Pair { rules, .. } = self.pair;
        let matched = match_fields((ros1, self.pair.ros1.1), (ros2, self.pair.ros2.1), rules)?;
        if matched.links.is_empty() && !matched.ros1.is_empty() && !matched.ros2.is_empty() {
            return Err(PairError::NothingInCommon { ros1: ros1.clone(), ros2: ros2.clone() });
        }
        self.note(&matched.ros1, &matched.ros2, &matched.links, place);
        let to_ros2 = self.to_ros2;
        let (from, to) =
            if to_ros2 { (&matched.ros1, &matched.ros2) } else { (&matched.ros2, &matched.ros1) };
        let source_of: BTreeMap<usize, usize> = matched
            .links
            .iter()
            .map(|(one, two)| if to_ros2 { (*two, *one) } else { (*one, *two) })
            .collect();
        let target_of: BTreeMap<usize, usize> =
            source_of.iter().map(|(target, source)| (*source, *target)).collect();
        let local = |entry: &Entry<'_>| format!("{}{}", place.local, entry.path);

        // The byte that stands in a message of CDR without fields.
        let hidden = matched.ros2.is_empty();
        if hidden && !to_ros2 {
            let at = self.path(&place.local)?;
            push(ops, Op::SkipBlock { align: 1, size: 1, at });
        }
        let mut next = 0;
        let mut marks: BTreeMap<usize, usize> = BTreeMap::new();
        for (position, entry) in to.iter().enumerate() {
            let Some(source) = source_of.get(&position).copied() else {
                self.fill(entry, place, ops)?;
                continue;
            };
            for (ahead, passed) in from.iter().enumerate().take(source).skip(next) {
                if target_of.contains_key(&ahead) {
                    let mark = self.mark();
                    marks.insert(ahead, mark);
                    push(ops, Op::Mark(mark));
                }
                self.skip(passed, &local(passed), ops)?;
            }
            let Some(found) = from.get(source) else { continue };
            match marks.get(&source) {
                None => {
                    self.field(found, entry, place, ops)?;
                    next = source + 1;
                }
                Some(mark) => {
                    next = next.max(source + 1);
                    let back = self.mark();
                    ops.extend([Op::Mark(back), Op::Return(*mark)]);
                    self.field(found, entry, place, ops)?;
                    push(ops, Op::Return(back));
                }
            }
        }
        for passed in from.iter().skip(next) {
            self.skip(passed, &local(passed), ops)?;
        }
        if hidden && to_ros2 {
            let at = self.path(&place.local)?;
            push(ops, Op::Zeros { align: 1, size: 1, at });
        }
        Ok(())
    }

    fn mark(&mut self) -> usize {
        self.program.marks += 1;
        self.program.marks - 1
    }

    fn note(
        &mut self,
        ros1: &[Entry<'_>],
        ros2: &[Entry<'_>],
        links: &[(usize, usize)],
        place: &Place,
    ) {
        for (one, two) in links {
            if let (Some(one), Some(two)) = (ros1.get(*one), ros2.get(*two))
                && one.path != two.path
            {
                let one = format!("{}{}", place.ros1, one.path);
                self.differences.renamed.insert((one, format!("{}{}", place.ros2, two.path)));
            }
        }
        let (linked1, linked2): (BTreeSet<usize>, BTreeSet<usize>) = links.iter().copied().unzip();
        let only = |entries: &[Entry<'_>], linked: &BTreeSet<usize>, place: &str| {
            let only = entries.iter().enumerate().filter(|(at, _)| !linked.contains(at));
            only.map(|(_, entry)| format!("{place}{}", entry.path)).collect::<Vec<_>>()
        };
        self.differences.only_ros1.extend(only(ros1, &linked1, &place.ros1));
        self.differences.only_ros2.extend(only(ros2, &linked2, &place.ros2));
    }

    /// Counts a field, and gives its path a number.
    fn path(&mut self, path: &str) -> Result<PathId, PairError> {
        self.fields += 1;
        self.path_bytes = self.path_bytes.saturating_add(path.len());
        let too_complex =
            |what, limit| PairError::TooComplex { name: self.pair.ros1.0.clone(), what, limit };
        if self.fields > MAX_FIELDS {
            return Err(too_complex("fields", MAX_FIELDS));
        }
        if self.path_bytes > MAX_PATH_BYTES {
            return Err(too_complex("bytes of field names", MAX_PATH_BYTES));
        }
        let id = PathId::try_from(self.program.paths.len()).unwrap_or(PathId::MAX);
        self.program.paths.push(path.into());
        Ok(id)
    }

    /// Writes what a field has that the source lacks.
    fn fill(
        &mut self,
        entry: &Entry<'_>,
        place: &Place,
        ops: &mut Vec<Op>,
    ) -> Result<(), PairError> {
        let path =
            format!("{}{}", if self.to_ros2 { &place.ros2 } else { &place.ros1 }, entry.path);
        let at = self.path(&path)?;
        if !self.to_ros2 && path == "header.seq" && is(entry.owner, "std_msgs", "Header") {
            ops.push(Op::Counter);
            return Ok(());
        }
        self.one_sided(self.to_ros2, at, |side| side.fill(entry.field, ops))
    }

    fn skip(&mut self, entry: &Entry<'_>, local: &str, ops: &mut Vec<Op>) -> Result<(), PairError> {
        let at = self.path(local)?;
        self.one_sided(!self.to_ros2, at, |side| side.skip(entry.field, ops))
    }

    /// Handles a field of one side, that of ROS 2 or of ROS 1, and counts what is in it.
    fn one_sided(
        &mut self,
        is_ros2: bool,
        at: PathId,
        handle: impl FnOnce(&mut OneSided<'d>) -> Result<(), PairError>,
    ) -> Result<(), PairError> {
        let definitions = if is_ros2 { self.pair.ros2.1 } else { self.pair.ros1.1 };
        let left = MAX_FIELDS.saturating_sub(self.fields);
        let mut side = OneSided { definitions, cdr: is_ros2, left, at };
        handle(&mut side)?;
        self.fields = MAX_FIELDS.saturating_sub(side.left);
        Ok(())
    }

    /// Copies a field.
    fn field(
        &mut self,
        from: &Entry<'d>,
        to: &Entry<'d>,
        place: &Place,
        ops: &mut Vec<Op>,
    ) -> Result<(), PairError> {
        let at = self.path(&format!("{}{}", place.local, from.path))?;
        let (one, two) = if self.to_ros2 { (from, to) } else { (to, from) };
        let containers = (from.field.field_type.container, to.field.field_type.container);
        let inside = |looped: bool| {
            let mark = if looped { "[]." } else { "." };
            Place {
                ros1: format!("{}{}{mark}", place.ros1, one.path),
                ros2: format!("{}{}{mark}", place.ros2, two.path),
                local: if looped {
                    String::new()
                } else {
                    format!("{}{}.", place.local, from.path)
                },
            }
        };
        let mut body = Vec::new();
        match containers {
            (Container::Single, Container::Single) => {
                return self.element(one, two, at, &inside(false), ops);
            }
            (Container::Array(count), Container::Array(same)) if count == same => {
                self.element(one, two, ELEMENT, &inside(true), &mut body)?;
                let count = count as usize;
                if let [Op::Block(block)] = body.as_slice()
                    && let Some(all) = block.times(count)
                {
                    push(ops, Op::Block(Block { parts: vec![(0, at)], ..all }));
                    return Ok(());
                }
                self.each(Count::Fixed(count), body, from, to, at, ops);
            }
            (Container::Sequence { .. }, Container::Sequence { .. }) => {
                self.element(one, two, ELEMENT, &inside(true), &mut body)?;
                let bound = match two.field.field_type.container {
                    Container::Sequence { bound } => bound,
                    _ => None,
                };
                match body.as_slice() {
                    [Op::Block(block)] if block.repeats() => {
                        let block = block.clone();
                        push(ops, Op::Blocks { block, bound, at });
                    }
                    _ => self.each(Count::Sequence { bound }, body, from, to, at, ops),
                }
            }
            _ => return Err(mismatch(one, two)),
        }
        Ok(())
    }

    fn each(
        &mut self,
        count: Count,
        body: Vec<Op>,
        from: &Entry<'d>,
        to: &Entry<'d>,
        at: PathId,
        ops: &mut Vec<Op>,
    ) {
        let (sizes, other) = (&mut self.ros1_sizes, &mut self.ros2_sizes);
        let (sizes, other) = if self.to_ros2 { (sizes, other) } else { (other, sizes) };
        let from_min = sizes.least(&from.field.field_type.element);
        let to_min = other.least(&to.field.field_type.element);
        push(ops, Op::Each(Each { count, body, from_min, to_min, at }));
    }

    /// Copies one element of a field.
    fn element(
        &mut self,
        one: &Entry<'d>,
        two: &Entry<'d>,
        at: PathId,
        inside: &Place,
        ops: &mut Vec<Op>,
    ) -> Result<(), PairError> {
        match (&one.field.field_type.element, &two.field.field_type.element) {
            (Element::Primitive(first), Element::Primitive(second)) => {
                if !are_alike(*first, *second) {
                    return Err(mismatch(one, two));
                }
                let is_log =
                    is(one.owner, "rosgraph_msgs", "Log") && is(two.owner, "rcl_interfaces", "Log");
                if is_log && one.path == "level" {
                    ops.push(Op::Severity { at });
                    return Ok(());
                }
                let size = first.size();
                let mut block = Block::new(size, size, at);
                let kind = if *first == Primitive::Bool {
                    Some(CheckKind::Bool)
                } else {
                    let is_time = is(one.owner, "builtin_interfaces", "Time");
                    (is_time && one.field.name == "sec").then_some(CheckKind::Seconds)
                };
                block.checks.extend(kind.map(|kind| Check {
                    kind,
                    offset: 0,
                    repeats: 1,
                    stride: size,
                }));
                push(ops, Op::Block(block));
            }
            (Element::Nested(first), Element::Nested(second)) => {
                if !self.pair.rules.are_counterparts(first, second) {
                    return Err(mismatch(one, two));
                }
                self.message(first, second, inside, ops)?;
            }
            (
                Element::String { .. },
                second @ (Element::String { bound } | Element::WString { bound }),
            ) => {
                let wide = matches!(second, Element::WString { .. });
                let text = Text {
                    from_wide: wide && !self.to_ros2,
                    to_wide: wide && self.to_ros2,
                    bound: *bound,
                    at,
                };
                push(ops, Op::Text(text));
            }
            _ => return Err(mismatch(one, two)),
        }
        Ok(())
    }
}

fn is(message: &TypeName, package: &str, name: &str) -> bool {
    *message == TypeName::well_known(package, name)
}

/// True when the bits of one can stand for the other: same size, and both whole numbers, both
/// fractions or both booleans.
fn are_alike(one: Primitive, two: Primitive) -> bool {
    let class = |primitive| match primitive {
        Primitive::Bool => 0,
        Primitive::Float32 | Primitive::Float64 => 1,
        _ => 2,
    };
    class(one) == class(two) && one.size() == two.size()
}

fn mismatch(one: &Entry<'_>, two: &Entry<'_>) -> PairError {
    let typed = |entry: &Entry<'_>| {
        let Entry { path, field, owner } = entry;
        let (message, field_type) = ((*owner).clone(), field.field_type.to_string());
        Box::new(TypedField { message, field: path.clone(), field_type })
    };
    PairError::Mismatch { ros1: typed(one), ros2: typed(two) }
}
