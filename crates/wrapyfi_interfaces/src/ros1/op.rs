//! The steps that a plan is made of.
//!
//! ```text
//!   geometry_msgs/PoseStamped              ROS 1 to CDR             CDR to ROS 1
//!     header.seq          uint32             skip 4                   counter
//!     header.stamp        time               block of 8, aligned 4    block of 8, aligned 4
//!     header.frame_id     string             text                     text
//!     pose.position       float64 x 3    ┐
//!     pose.orientation    float64 x 4    ┴   block of 56, aligned 8   block of 56, aligned 8
//! ```
//!
//! A block is what lies together on both sides: ROS 1 never pads, and CDR does not inside a block,
//! because it begins at a multiple of its alignment and no member needs a larger one.

/// Index of a field's name in the plan's table of paths.
pub(super) type PathId = u32;

/// The element of a loop as a whole: the loop says which field it is of.
pub(super) const ELEMENT: PathId = PathId::MAX;

/// One step: reads from the one message, writes to the other.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Op {
    /// Copies a block.
    Block(Block),
    /// Copies a counted sequence of blocks.
    Blocks { block: Block, bound: Option<u32>, at: PathId },
    /// Copies a string.
    Text(Text),
    /// Runs the body for each element.
    Each(Each),
    /// Passes over a block of the source.
    SkipBlock { align: usize, size: usize, at: PathId },
    /// Passes over a counted sequence of blocks.
    SkipBlocks { align: usize, size: usize, at: PathId },
    /// Passes over a string.
    SkipText { wide: bool, at: PathId },
    /// Writes bytes that are always the same.
    Put { align: usize, bytes: Vec<u8>, at: PathId },
    /// Writes zeros.
    Zeros { align: usize, size: usize, at: PathId },
    /// Writes the counter of `header.seq`.
    Counter,
    /// Copies a severity of the log, from the numbers of one ROS to those of the other.
    Severity { at: PathId },
    /// Remembers where the source is.
    Mark(usize),
    /// Goes back, or forth, to where a mark was set.
    Return(usize),
}

/// Bytes that lie together on both sides.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Block {
    /// 1, 2, 4 or 8.
    pub(super) align: usize,
    /// Never 0.
    pub(super) size: usize,
    /// Bytes that must be checked.
    pub(super) checks: Vec<Check>,
    /// First byte of each field, for errors.
    pub(super) parts: Vec<(usize, PathId)>,
}

/// Something in a block that is not any bits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Check {
    pub(super) kind: CheckKind,
    /// First byte, from the start of the block.
    pub(super) offset: usize,
    /// Number of times that it comes again; `stride` bytes lie between two of them.
    pub(super) repeats: usize,
    pub(super) stride: usize,
}

/// Rule of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CheckKind {
    /// Written as 0 or 1: any other byte makes readers of CDR refuse the message.
    Bool,
    /// Seconds of a time: unsigned in ROS 1, signed in ROS 2.
    Seconds,
}

/// A string.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Text {
    pub(super) from_wide: bool,
    pub(super) to_wide: bool,
    /// Most bytes, or code units where the target is wide.
    pub(super) bound: Option<u32>,
    pub(super) at: PathId,
}

/// A loop.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Each {
    pub(super) count: Count,
    pub(super) body: Vec<Op>,
    /// Least number of bytes that one element takes on either side, without padding.
    pub(super) from_min: usize,
    pub(super) to_min: usize,
    pub(super) at: PathId,
}

/// Source of the number of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Count {
    /// Fixed number, which is not on the wire.
    Fixed(usize),
    /// Number that the source says, which the target is told.
    Sequence { bound: Option<u32> },
    /// Number that the source says, of elements that the target has none of.
    Skipped,
}

/// Repeats of a check that are written out one by one; more make a loop.
const MOST_COPIES: usize = 64;

impl Block {
    /// A block of one field.
    pub(super) fn new(align: usize, size: usize, at: PathId) -> Self {
        Self { align, size, checks: Vec::new(), parts: vec![(0, at)] }
    }

    /// True when a following field of alignment `align` lies close behind in CDR too, wherever the
    /// block is.
    fn joins(&self, align: usize) -> bool {
        joins(self.align, self.size, align)
    }

    fn append(&mut self, other: Self) {
        let start = self.size;
        self.size = self.size.saturating_add(other.size);
        self.checks.extend(other.checks.into_iter().map(|mut check| {
            check.offset += start;
            check
        }));
        self.parts.extend(other.parts.into_iter().map(|(offset, at)| (offset + start, at)));
    }

    /// True when many of them lie close together in CDR.
    pub(super) fn repeats(&self) -> bool {
        self.size.is_multiple_of(self.align)
    }

    /// `count` of them as one, where that is possible.
    pub(super) fn times(&self, count: usize) -> Option<Self> {
        if !self.repeats() {
            return None;
        }
        let mut checks = Vec::new();
        for check in &self.checks {
            let dense = check.stride.checked_mul(check.repeats) == Some(self.size);
            if check.repeats == 1 {
                checks.push(Check { repeats: count, stride: self.size, ..*check });
            } else if dense {
                checks.push(Check { repeats: check.repeats.checked_mul(count)?, ..*check });
            } else if count <= MOST_COPIES {
                checks.extend(
                    (0..count).map(|i| Check { offset: check.offset + i * self.size, ..*check }),
                );
            } else {
                return None;
            }
        }
        let size = self.size.checked_mul(count)?;
        Some(Self { align: self.align, size, checks, parts: self.parts.clone() })
    }

    /// The field that the byte at `offset` belongs to.
    pub(super) fn field_at(&self, offset: usize) -> Option<PathId> {
        self.parts.iter().rev().find(|(start, _)| *start <= offset).map(|(_, at)| *at)
    }
}

fn joins(align: usize, size: usize, next: usize) -> bool {
    next <= align && size.is_multiple_of(next)
}

/// Appends a step, or lengthens the last one.
pub(super) fn push(ops: &mut Vec<Op>, op: Op) {
    match (ops.last_mut(), op) {
        (Some(Op::Block(last)), Op::Block(next)) if last.joins(next.align) => last.append(next),
        (
            Some(Op::SkipBlock { align, size, .. }),
            Op::SkipBlock { align: next, size: more, .. },
        ) if joins(*align, *size, next) => *size = size.saturating_add(more),
        (Some(Op::Zeros { align, size, .. }), Op::Zeros { align: next, size: more, .. })
            if joins(*align, *size, next) =>
        {
            *size = size.saturating_add(more);
        }
        (Some(Op::Put { align, bytes, .. }), Op::Put { align: next, bytes: more, .. })
            if joins(*align, bytes.len(), next) =>
        {
            bytes.extend(more);
        }
        (_, op) => ops.push(op),
    }
}
