//! Log lines of the core, kept until Python's `logging` takes them.
//!
//! ```text
//!   tracing event ─▶ logging of wrapyfi_bridge ─▶ queue ══ log_lines() ══▶ thread of wrapyfi_rs._log ─▶ logging
//! ```
//!
//! A thread of the core never waits for the interpreter's lock: whoever holds that may wait for the thread.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, PoisonError};

use pyo3::prelude::*;
use wrapyfi_bridge::logging;

/// Most lines that wait for Python; those after them are counted.
const MAX_LINES: usize = 4096;

/// Level, name of the logger, text.
type Line = (&'static str, String, String);

static QUEUE: Mutex<Queue> = Mutex::new(Queue { lines: VecDeque::new(), lost: 0 });
static NOT_EMPTY: Condvar = Condvar::new();

struct Queue {
    lines: VecDeque<Line>,
    /// Number of lines since the last look for which there was no room.
    lost: u64,
}

impl Queue {
    fn push(&mut self, line: Line) {
        match self.lines.len() {
            ..MAX_LINES => self.lines.push_back(line),
            _ => self.lost += 1,
        }
    }

    fn take(&mut self) -> Vec<Line> {
        let lost = std::mem::take(&mut self.lost);
        let mut lines: Vec<Line> = self.lines.drain(..).collect();
        if lost > 0 {
            let text = format!("{lost} lines are left out: {MAX_LINES} waited for Python");
            lines.push(("WARN", LOGGER.to_owned(), text));
        }
        lines
    }
}

/// Name of the package's logger in Python.
const LOGGER: &str = "wrapyfi_rs";

/// Keeps lines from now on.
pub(crate) fn start() {
    logging::start_to(LOGGER, |level, logger, text| {
        let mut queue = QUEUE.lock().unwrap_or_else(PoisonError::into_inner);
        queue.push((level.as_str(), logger.to_owned(), text.to_owned()));
        drop(queue);
        NOT_EMPTY.notify_one();
    });
}

/// Lines since the last look, each with its level and the name of its logger. With `wait`, until there is one.
#[pyfunction]
pub(crate) fn log_lines(py: Python<'_>, wait: bool) -> Vec<Line> {
    py.detach(|| {
        let mut queue = QUEUE.lock().unwrap_or_else(PoisonError::into_inner);
        while wait && queue.lines.is_empty() {
            queue = NOT_EMPTY.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
        queue.take()
    })
}
