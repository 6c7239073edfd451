//! Scan for the length of a bottle while it arrives.
//!
//! ```text
//!   list of 2 │ int32 │ list of 1000 float64 │ …        stack: [2 left] ─▶ [1 left]
//!                      └ 8000 bytes: skipped, there or not yet there
//! ```

use super::Frame;
use super::error::BottleError;
use super::kind::{Code, Kind};
use super::read::{list_kind, wrong_code};
use crate::{Dialect, WireLimits};

/// Finds the end of a bottle whose bytes arrive in pieces, without reading any of them twice.
///
/// Replies to requests come with no length before them: this is how a client knows where one ends.
#[derive(Debug, Clone)]
pub struct BottleScan {
    dialect: Dialect,
    limits: WireLimits,
    /// Offset of the first byte that was not looked at; may lie behind the bytes that have arrived.
    at: usize,
    elements: usize,
    /// Lists that are open, outermost first. None until the outermost one has begun.
    open: Option<Vec<Open>>,
}

/// A list that is not at its end.
#[derive(Debug, Clone, Copy)]
struct Open {
    /// Kind of the list's elements, where they come without codes.
    kind: Option<Kind>,
    /// Elements to come.
    left: usize,
}

impl BottleScan {
    /// A scan of a bottle that has not begun to arrive.
    pub fn new(dialect: Dialect, limits: &WireLimits) -> Self {
        Self { dialect, limits: limits.clone(), at: 0, elements: 0, open: None }
    }

    /// Goes on with all bytes that have arrived, those of earlier calls included.
    ///
    /// # Errors
    /// When they cannot be the start of a bottle, or exceed the limits. The scan is over then.
    pub fn advance(&mut self, bytes: &[u8]) -> Result<Frame, BottleError> {
        if self.open.is_none() {
            // A wrong code shows itself before its count has arrived.
            let Some(code) = int(bytes, 0) else { return Ok(need(8, bytes)) };
            list_kind(code, 0, self.dialect)?;
            let Some(count) = int(bytes, 4) else { return Ok(need(8, bytes)) };
            self.begin_list(code, count, 0)?;
        }
        while let Some(list) = self.open.as_mut().and_then(|open| open.last_mut()) {
            if list.left == 0 {
                self.open.as_mut().and_then(Vec::pop);
                continue;
            }
            let kind = list.kind;
            if let Some(kind) = kind.filter(|kind| kind.is_sized()) {
                let length = list.left.saturating_mul(kind.size());
                list.left = 0;
                self.skip(length)?;
                continue;
            }
            let end = match kind {
                Some(_) => self.block(bytes, self.at)?,
                None => self.element(bytes)?,
            };
            if let Some(end) = end {
                return Ok(need(end, bytes));
            }
        }
        if self.at > bytes.len() { Ok(need(self.at, bytes)) } else { Ok(Frame::Complete(self.at)) }
    }

    /// Passes an element with its code, or says up to where bytes are needed for that.
    fn element(&mut self, bytes: &[u8]) -> Result<Option<usize>, BottleError> {
        let at = self.at;
        let Some(code) = int(bytes, at) else { return Ok(Some(at.saturating_add(4))) };
        let behind = at + 4;
        match Code::of(code, self.dialect) {
            None => Err(wrong_code(code, at, self.dialect)),
            Some(Code::Value(kind)) if kind.is_sized() => {
                self.count_down();
                self.skip(4 + kind.size())?;
                Ok(None)
            }
            Some(Code::Value(_)) => self.block(bytes, behind),
            Some(Code::List(_)) => {
                let Some(count) = int(bytes, behind) else { return Ok(Some(behind + 4)) };
                self.count_down();
                self.begin_list(code, count, at)?;
                Ok(None)
            }
            Some(Code::Dict) => {
                let (Some(code), Some(count)) = (int(bytes, behind), int(bytes, behind + 4)) else {
                    return Ok(Some(behind + 8));
                };
                self.count_down();
                self.begin_list(code, count, behind)?;
                Ok(None)
            }
        }
    }

    /// Passes a string or blob whose length stands at `at`, or says up to where bytes are needed.
    fn block(&mut self, bytes: &[u8], at: usize) -> Result<Option<usize>, BottleError> {
        let Some(length) = int(bytes, at) else { return Ok(Some(at.saturating_add(4))) };
        let length = BottleError::length("a string or blob", at, length)?;
        self.count_down();
        self.skip((at + 4 - self.at).saturating_add(length))?;
        Ok(None)
    }

    /// Enters a list whose code stands at `at`.
    fn begin_list(&mut self, code: i32, count: i32, at: usize) -> Result<(), BottleError> {
        let kind = list_kind(code, at, self.dialect)?;
        let left = BottleError::length("the count of a list", at + 4, count)?;
        self.elements = self.elements.saturating_add(left);
        if self.elements > self.limits.max_elements {
            return Err(BottleError::TooManyElements(self.limits.max_elements));
        }
        let open = self.open.get_or_insert_default();
        if open.len() >= self.limits.depth() {
            return Err(BottleError::TooDeep { limit: self.limits.depth() });
        }
        open.push(Open { kind, left });
        let length = at + 8 - self.at;
        self.skip(length)
    }

    /// One element less to come in the innermost list.
    fn count_down(&mut self) {
        if let Some(list) = self.open.as_mut().and_then(|open| open.last_mut()) {
            list.left = list.left.saturating_sub(1);
        }
    }

    fn skip(&mut self, length: usize) -> Result<(), BottleError> {
        self.at = self.at.saturating_add(length);
        let limit = self.limits.max_message_bytes;
        if self.at > limit {
            return Err(BottleError::TooLong { length: self.at, limit });
        }
        Ok(())
    }
}

fn need(end: usize, bytes: &[u8]) -> Frame {
    Frame::NeedMore(end.saturating_sub(bytes.len()))
}

fn int(bytes: &[u8], at: usize) -> Option<i32> {
    bytes.get(at..)?.first_chunk().copied().map(i32::from_le_bytes)
}
