//! Carries a message over, step by step.
//!
//! ```text
//!   Source ──▶ ops: block, text, each … ──▶ Target        Work: limits, counts, marks
//! ```
//!
//! Nothing is allocated but the target's growth. Every count is compared with what is left of the
//! source, and with the room the limit leaves in the target, before a loop begins.

use super::error::TranscodeError;
use super::op::{Block, Check, CheckKind, Count, ELEMENT, Each, Op, PathId};
use super::wire::{Short, Source, Target};
use super::{Options, Transcoded, severity, text};
use crate::cdr::CdrError;

/// State that the steps share.
#[derive(Debug)]
pub(super) struct Work<'p> {
    pub(super) paths: &'p [Box<str>],
    pub(super) options: Options,
    /// Value for `header.seq`.
    pub(super) seq: u32,
    pub(super) marks: Vec<usize>,
    /// Texts and messages in sequences so far.
    pub(super) elements: usize,
    pub(super) done: Transcoded,
}

impl Work<'_> {
    pub(super) fn path(&self, at: PathId) -> String {
        let path = usize::try_from(at).ok().and_then(|at| self.paths.get(at));
        path.map(ToString::to_string).unwrap_or_default()
    }

    pub(super) fn truncated(&self, at: PathId, short: Short) -> TranscodeError {
        let Short { needed, available } = short;
        CdrError::Truncated { path: self.path(at), needed, available }.into()
    }

    /// Makes sure that `more` bytes and their padding fit into the target.
    #[inline]
    pub(super) fn room(&self, have: usize, more: usize, at: PathId) -> Result<(), TranscodeError> {
        let needed = have.saturating_add(more);
        if needed <= self.options.message_bytes {
            return Ok(());
        }
        let limit = self.options.message_bytes;
        Err(TranscodeError::ResultTooLarge { path: self.path(at), needed, limit })
    }

    pub(super) fn length(
        &self,
        at: PathId,
        claimed: u32,
        min: usize,
        available: usize,
    ) -> TranscodeError {
        let claimed = u64::from(claimed);
        let needed = claimed.saturating_mul(min as u64);
        CdrError::Length { path: self.path(at), claimed, needed, available }.into()
    }

    pub(super) fn bound(
        &self,
        at: PathId,
        actual: usize,
        bound: Option<u32>,
    ) -> Result<(), TranscodeError> {
        match bound {
            Some(bound) if actual > bound as usize => {
                Err(TranscodeError::Bound { path: self.path(at), actual, bound })
            }
            _ => Ok(()),
        }
    }

    fn note_elements(&mut self, count: usize, at: PathId) -> Result<(), TranscodeError> {
        self.elements = self.elements.saturating_add(count);
        if self.elements <= self.options.elements {
            return Ok(());
        }
        Err(TranscodeError::TooMany { path: self.path(at), limit: self.options.elements })
    }
}

/// Runs the steps. `F`: the source is CDR; `T`: the target is. Calls itself once for each loop in
/// a loop, of which a type has at most [`MAX_DEPTH`](crate::description::MAX_DEPTH).
pub(super) fn run<const F: bool, const T: bool>(
    ops: &[Op],
    from: &mut Source<'_, F>,
    to: &mut Target<'_, T>,
    work: &mut Work<'_>,
) -> Result<(), TranscodeError> {
    for op in ops {
        match op {
            Op::Block(block) => {
                from.align(block.align);
                let bytes = take_block(block, from, work)?;
                work.room(to.len(), block.size.saturating_add(7), block_path(block, 0))?;
                to.align(block.align);
                to.put(bytes);
                if !block.checks.is_empty() {
                    check::<F, T>(&block.checks, to.last_mut(block.size), work);
                }
            }
            Op::Blocks { block, bound, at } => blocks(block, *bound, *at, from, to, work)?,
            Op::Text(op) => text::copy(op, from, to, work)?,
            Op::Each(each) => run_each(each, from, to, work)?,
            Op::SkipBlock { align, size, at } => {
                from.align(*align);
                from.take(*size).map_err(|short| work.truncated(*at, short))?;
            }
            Op::SkipBlocks { align, size, at } => {
                let count = sequence(*size, *at, from, work)?;
                if count != 0 {
                    from.align(*align);
                    let size = count.saturating_mul(*size);
                    from.take(size).map_err(|short| work.truncated(*at, short))?;
                }
            }
            Op::SkipText { wide, at } => {
                let size = if *wide { 4 } else { 1 };
                let count = sequence(size, *at, from, work)?;
                let size = count.saturating_mul(size);
                from.take(size).map_err(|short| work.truncated(*at, short))?;
            }
            Op::Put { align, bytes, at } => {
                work.room(to.len(), bytes.len().saturating_add(7), *at)?;
                to.align(*align);
                to.put(bytes);
            }
            Op::Zeros { align, size, at } => {
                work.room(to.len(), size.saturating_add(7), *at)?;
                to.align(*align);
                to.zeros(*size);
            }
            Op::Counter => to.count(work.seq),
            Op::Severity { at } => {
                let byte = from.take(1).map_err(|short| work.truncated(*at, short))?;
                let level = byte.first().copied().unwrap_or_default();
                to.put(&[if T { severity::to_ros2(level) } else { severity::to_ros1(level) }]);
            }
            Op::Mark(slot) => {
                if let Some(mark) = work.marks.get_mut(*slot) {
                    *mark = from.position();
                }
            }
            Op::Return(slot) => {
                from.go_to(work.marks.get(*slot).copied().unwrap_or(from.position()));
            }
        }
    }
    Ok(())
}

/// Reads a count, for which so many elements of at least `min` bytes are there.
pub(super) fn sequence<const F: bool>(
    min: usize,
    at: PathId,
    from: &mut Source<'_, F>,
    work: &Work<'_>,
) -> Result<usize, TranscodeError> {
    let claimed = from.count().map_err(|short| work.truncated(at, short))?;
    let available = from.remaining();
    let too_long = || work.length(at, claimed, min, available);
    let count = usize::try_from(claimed).map_err(|_beyond_memory| too_long())?;
    match count.checked_mul(min) {
        Some(needed) if needed <= available => Ok(count),
        _ => Err(too_long()),
    }
}

fn block_path(block: &Block, offset: usize) -> PathId {
    block.field_at(offset).unwrap_or(ELEMENT)
}

fn take_block<'a, const F: bool>(
    block: &Block,
    from: &mut Source<'a, F>,
    work: &Work<'_>,
) -> Result<&'a [u8], TranscodeError> {
    from.take(block.size).map_err(|short| {
        // The first field that is not there in full.
        let at = block_path(block, short.available);
        let start = block.parts.iter().find(|(_, id)| *id == at).map_or(0, |(start, _)| *start);
        let end = block.parts.iter().map(|(start, _)| *start).find(|next| *next > start);
        let needed = end.unwrap_or(block.size).saturating_sub(start);
        let available = short.available.saturating_sub(start);
        work.truncated(at, Short { needed, available })
    })
}

fn blocks<const F: bool, const T: bool>(
    block: &Block,
    bound: Option<u32>,
    at: PathId,
    from: &mut Source<'_, F>,
    to: &mut Target<'_, T>,
    work: &mut Work<'_>,
) -> Result<(), TranscodeError> {
    let count = sequence(block.size, at, from, work)?;
    if T {
        work.bound(at, count, bound)?;
    }
    let size = count.saturating_mul(block.size);
    work.room(to.len(), size.saturating_add(16), at)?;
    to.count(u32::try_from(count).unwrap_or(u32::MAX));
    if count == 0 {
        return Ok(()); // without elements there is no padding either
    }
    from.align(block.align);
    let bytes = from.take(size).map_err(|short| work.truncated(at, short))?;
    to.align(block.align);
    to.put(bytes);
    if !block.checks.is_empty() {
        let written = to.last_mut(size);
        if let (1, [Check { kind: CheckKind::Bool, .. }]) = (block.size, block.checks.as_slice()) {
            written.iter_mut().for_each(|byte| *byte = u8::from(*byte != 0));
        } else {
            for element in written.chunks_exact_mut(block.size) {
                check::<F, T>(&block.checks, element, work);
            }
        }
    }
    Ok(())
}

/// Looks at what was written, and puts it right.
fn check<const F: bool, const T: bool>(checks: &[Check], written: &mut [u8], work: &mut Work<'_>) {
    for Check { kind, offset, repeats, stride } in checks {
        let mut at = *offset;
        for _ in 0..*repeats {
            let Some(rest) = written.get_mut(at..) else { break };
            match kind {
                CheckKind::Bool => {
                    if let Some(byte) = rest.first_mut() {
                        *byte = u8::from(*byte != 0);
                    }
                }
                CheckKind::Seconds => {
                    if rest.first_chunk::<4>().is_some_and(|bytes| i32::from_le_bytes(*bytes) < 0) {
                        work.done.wrapped_times = work.done.wrapped_times.saturating_add(1);
                    }
                }
            }
            at = at.saturating_add(*stride);
        }
    }
}

fn run_each<const F: bool, const T: bool>(
    each: &Each,
    from: &mut Source<'_, F>,
    to: &mut Target<'_, T>,
    work: &mut Work<'_>,
) -> Result<(), TranscodeError> {
    let at = each.at;
    let count = match each.count {
        Count::Fixed(count) => count,
        Count::Skipped => sequence(each.from_min, at, from, work)?,
        Count::Sequence { bound } => {
            let count = sequence(each.from_min, at, from, work)?;
            if T {
                work.bound(at, count, bound)?;
            }
            work.room(to.len(), 8, at)?;
            to.count(u32::try_from(count).unwrap_or(u32::MAX));
            count
        }
    };
    work.note_elements(count, at)?;
    work.room(to.len(), count.saturating_mul(each.to_min), at)?;
    for index in 0..count {
        run(&each.body, from, to, work)
            .map_err(|error| error.in_element(index).in_field(&work.path(at)))?;
    }
    Ok(())
}
