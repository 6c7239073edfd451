//! Carries a message over, step by step.
//!
//! ```text
//!   Source ──▶ ops: block, text, each … ──▶ Target        Work: both of them, limits, counts, marks
//! ```
//!
//! Nothing is allocated but the target's growth. Every count is compared with what is left of the
//! source, and with the room the limit leaves in the target, before a loop begins.

use super::error::TranscodeError;
use super::op::{Block, Check, CheckKind, Count, ELEMENT, Each, Op, PathId};
use super::wire::{Short, Source, Target};
use super::{Options, Transcoded, severity};
use crate::cdr::CdrError;

/// The message that is read, the one that is written, and what the steps share. `F`: the source is CDR; `T`: the target is.
#[derive(Debug)]
pub(super) struct Work<'w, const F: bool, const T: bool> {
    pub(super) from: Source<'w, F>,
    pub(super) to: Target<'w, T>,
    pub(super) paths: &'w [Box<str>],
    pub(super) options: Options,
    /// Value for `header.seq`.
    pub(super) seq: u32,
    pub(super) marks: Vec<usize>,
    /// Texts and messages in sequences so far.
    pub(super) elements: usize,
    pub(super) done: Transcoded,
}

impl<'w, const F: bool, const T: bool> Work<'w, F, T> {
    pub(super) fn path(&self, at: PathId) -> String {
        let path = usize::try_from(at).ok().and_then(|at| self.paths.get(at));
        path.map(ToString::to_string).unwrap_or_default()
    }

    fn truncated(&self, at: PathId, Short { needed, available }: Short) -> TranscodeError {
        CdrError::Truncated { path: self.path(at), needed, available }.into()
    }

    #[inline]
    pub(super) fn take(&mut self, size: usize, at: PathId) -> Result<&'w [u8], TranscodeError> {
        self.from.take(size).map_err(|short| self.truncated(at, short))
    }

    /// Makes sure that `more` bytes and their padding fit into the target.
    #[inline]
    pub(super) fn room(&self, more: usize, at: PathId) -> Result<(), TranscodeError> {
        let needed = self.to.len().saturating_add(more);
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

    /// Runs the steps. Calls itself once for each loop in a loop, of which a type has at most
    /// [`MAX_DEPTH`](crate::description::MAX_DEPTH).
    pub(super) fn run(&mut self, ops: &[Op]) -> Result<(), TranscodeError> {
        for op in ops {
            match op {
                Op::Block(block) => {
                    self.from.align(block.align);
                    let bytes = self.take_block(block)?;
                    self.room(block.size.saturating_add(7), block_path(block, 0))?;
                    self.to.align(block.align);
                    self.to.put(bytes);
                    if !block.checks.is_empty() {
                        check(&block.checks, self.to.last_mut(block.size), &mut self.done);
                    }
                }
                Op::Blocks { block, bound, at } => self.blocks(block, *bound, *at)?,
                Op::Text(op) => self.copy_text(op)?,
                Op::Each(each) => self.run_each(each)?,
                Op::SkipBlock { align, size, at } => {
                    self.from.align(*align);
                    self.take(*size, *at)?;
                }
                Op::SkipBlocks { align, size, at } => {
                    let count = self.sequence(*size, *at)?;
                    if count != 0 {
                        self.from.align(*align);
                        self.take(count.saturating_mul(*size), *at)?;
                    }
                }
                Op::SkipText { wide, at } => {
                    let size = if *wide { 4 } else { 1 };
                    let count = self.sequence(size, *at)?;
                    self.take(count.saturating_mul(size), *at)?;
                }
                Op::Put { align, bytes, at } => {
                    self.room(bytes.len().saturating_add(7), *at)?;
                    self.to.align(*align);
                    self.to.put(bytes);
                }
                Op::Zeros { align, size, at } => {
                    self.room(size.saturating_add(7), *at)?;
                    self.to.align(*align);
                    self.to.zeros(*size);
                }
                Op::Counter => self.to.count(self.seq),
                Op::Severity { at } => {
                    let level = self.take(1, *at)?.first().copied().unwrap_or_default();
                    let to = if T { severity::to_ros2(level) } else { severity::to_ros1(level) };
                    self.to.put(&[to]);
                }
                Op::Mark(slot) => {
                    if let Some(mark) = self.marks.get_mut(*slot) {
                        *mark = self.from.at;
                    }
                }
                Op::Return(slot) => {
                    self.from.at = self.marks.get(*slot).copied().unwrap_or(self.from.at);
                }
            }
        }
        Ok(())
    }

    /// Reads a count, for which so many elements of at least `min` bytes are there.
    pub(super) fn sequence(&mut self, min: usize, at: PathId) -> Result<usize, TranscodeError> {
        let claimed = self.from.count().map_err(|short| self.truncated(at, short))?;
        let available = self.from.remaining();
        let too_long = || self.length(at, claimed, min, available);
        let count = usize::try_from(claimed).map_err(|_beyond_memory| too_long())?;
        match count.checked_mul(min) {
            Some(needed) if needed <= available => Ok(count),
            _ => Err(too_long()),
        }
    }

    fn take_block(&mut self, block: &Block) -> Result<&'w [u8], TranscodeError> {
        self.from.take(block.size).map_err(|short| {
            // The first field that is not there in full.
            let at = block_path(block, short.available);
            let start = block.parts.iter().find(|(_, id)| *id == at).map_or(0, |(start, _)| *start);
            let end = block.parts.iter().map(|(start, _)| *start).find(|next| *next > start);
            let needed = end.unwrap_or(block.size).saturating_sub(start);
            let available = short.available.saturating_sub(start);
            self.truncated(at, Short { needed, available })
        })
    }

    fn blocks(
        &mut self,
        block: &Block,
        bound: Option<u32>,
        at: PathId,
    ) -> Result<(), TranscodeError> {
        let count = self.sequence(block.size, at)?;
        if T {
            self.bound(at, count, bound)?;
        }
        let size = count.saturating_mul(block.size);
        self.room(size.saturating_add(16), at)?;
        self.to.count(u32::try_from(count).unwrap_or(u32::MAX));
        if count == 0 {
            return Ok(()); // without elements there is no padding either
        }
        self.from.align(block.align);
        let bytes = self.take(size, at)?;
        self.to.align(block.align);
        self.to.put(bytes);
        if !block.checks.is_empty() {
            let written = self.to.last_mut(size);
            if let (1, [Check { kind: CheckKind::Bool, .. }]) = (block.size, &*block.checks) {
                written.iter_mut().for_each(|byte| *byte = u8::from(*byte != 0));
            } else {
                for element in written.chunks_exact_mut(block.size) {
                    check(&block.checks, element, &mut self.done);
                }
            }
        }
        Ok(())
    }

    fn run_each(&mut self, each: &Each) -> Result<(), TranscodeError> {
        let at = each.at;
        let count = match each.count {
            Count::Fixed(count) => count,
            Count::Skipped => self.sequence(each.from_min, at)?,
            Count::Sequence { bound } => {
                let count = self.sequence(each.from_min, at)?;
                if T {
                    self.bound(at, count, bound)?;
                }
                self.room(8, at)?;
                self.to.count(u32::try_from(count).unwrap_or(u32::MAX));
                count
            }
        };
        self.note_elements(count, at)?;
        self.room(count.saturating_mul(each.to_min), at)?;
        for index in 0..count {
            self.run(&each.body)
                .map_err(|error| error.in_element(index).in_field(&self.path(at)))?;
        }
        Ok(())
    }
}

fn block_path(block: &Block, offset: usize) -> PathId {
    block.field_at(offset).unwrap_or(ELEMENT)
}

/// Looks at what was written, and puts it right.
fn check(checks: &[Check], written: &mut [u8], done: &mut Transcoded) {
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
                        done.wrapped_times = done.wrapped_times.saturating_add(1);
                    }
                }
            }
            at = at.saturating_add(*stride);
        }
    }
}
