//! A node as the rest of the program uses it: from any thread, without waiting for the network.
//!
//! ```text
//!   any thread ─ parameters, log, now ─▶ NodeHandle ─ shared state, doorbell ─▶ the node's thread
//! ```

use std::cell::Cell;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, MutexGuard};

use wrapyfi_interfaces::rosgraph_msgs::msg::Clock;

use wrapyfi_data::types::Stamp;
use wrapyfi_endpoint::{Clock as NodeClock, Mutex, RosNow, Wake};
use wrapyfi_node::parameters::ParameterStore;
use wrapyfi_node::type_description::TypeDescriptions;
use wrapyfi_node::{LogLevel, LogLine, RosTime};

/// Log lines that may wait for the node's thread.
const MAX_LINES: usize = 1000;

thread_local! {
    static IN_NODE_THREAD: Cell<bool> = const { Cell::new(false) };
}

/// Marks the calling thread as a node's own: what it logs is not published.
pub(super) fn in_node_thread() {
    IN_NODE_THREAD.set(true);
}

/// Log lines that wait for the node's thread.
#[derive(Default)]
struct LogQueue {
    lines: VecDeque<(Stamp, LogLine)>,
    /// Number of lines dropped since the last [`LogQueue::take`].
    dropped: u64,
}

impl LogQueue {
    fn push(&mut self, stamp: Stamp, line: LogLine) {
        if self.lines.len() >= MAX_LINES {
            self.lines.pop_front();
            self.dropped += 1;
        }
        self.lines.push_back((stamp, line));
    }

    /// Takes all lines, the first of which says how many were dropped before them.
    fn take(&mut self) -> VecDeque<(Stamp, LogLine)> {
        let Self { mut lines, dropped } = std::mem::take(self);
        if dropped > 0
            && let Some((stamp, first)) = lines.front()
        {
            let told = LogLine {
                level: LogLevel::Warn,
                logger: first.logger.clone(),
                text: format!(
                    "{dropped} earlier lines are missing here: {MAX_LINES} waited already; the program's own log has them"
                ),
                file: String::new(),
                function: String::new(),
                line: 0,
            };
            lines.push_front((*stamp, told));
        }
        lines
    }
}

/// State that the node's thread and the rest of the program share.
pub(super) struct NodeState {
    store: Mutex<ParameterStore>,
    types: Mutex<TypeDescriptions>,
    time: Mutex<RosTime>,
    lines: Mutex<LogQueue>,
    refused_requests: AtomicU64,
    pub(super) wake: Wake,
}

impl NodeState {
    pub(super) fn new(store: ParameterStore, time: RosTime, wake: Wake) -> Self {
        Self {
            store: Mutex::new(store),
            types: Mutex::default(),
            time: Mutex::new(time),
            lines: Mutex::default(),
            refused_requests: AtomicU64::new(0),
            wake,
        }
    }

    pub(super) fn store(&self) -> MutexGuard<'_, ParameterStore> {
        self.store.lock()
    }

    pub(super) fn types(&self) -> MutexGuard<'_, TypeDescriptions> {
        self.types.lock()
    }

    pub(super) fn take_lines(&self) -> VecDeque<(Stamp, LogLine)> {
        self.lines.lock().take()
    }

    pub(super) fn now(&self) -> Stamp {
        self.time.lock().now(Stamp::now())
    }

    pub(super) fn count_refused(&self) {
        self.refused_requests.fetch_add(1, Relaxed);
    }

    pub(super) fn set_simulated(&self, simulated: bool) {
        let changed = self.time.lock().set_simulated(simulated);
        if changed {
            let to = if simulated { RosTime::TOPIC } else { "the system" };
            tracing::info!("the node's time comes from {to}");
        }
    }

    pub(super) fn on_clock(&self, clock: &Clock) {
        let went_back = self.time.lock().on_clock(clock);
        match went_back {
            Ok(Some(by)) => {
                tracing::warn!("{} went back by {} s", RosTime::TOPIC, by.as_secs_f64());
            }
            Ok(None) => {}
            Err(error) => tracing::warn!("{error}"),
        }
    }
}

/// A node as the rest of the program uses it. Copies are the same node; they may outlive it, and
/// do nothing then.
#[derive(Clone)]
pub struct NodeHandle(pub(super) Arc<NodeState>);

impl NodeHandle {
    /// Declares, reads, sets or watches parameters. Changes are published on `/parameter_events`.
    /// Not to be called from a validator of the store.
    pub fn parameters<R>(&self, use_them: impl FnOnce(&mut ParameterStore) -> R) -> R {
        let result = use_them(&mut self.0.store());
        self.0.wake.ring();
        result
    }

    /// Adds or removes types that `~/get_type_description` answers for.
    pub fn types<R>(&self, use_them: impl FnOnce(&mut TypeDescriptions) -> R) -> R {
        use_them(&mut self.0.types())
    }

    /// Publishes a line on `/rosout`. Never blocks on the network; when too many wait, the oldest is dropped, and a
    /// line says how many were.
    pub fn log(&self, line: LogLine) {
        if IN_NODE_THREAD.get() {
            return;
        }
        let stamp = self.0.now();
        self.0.lines.lock().push(stamp, line);
        self.0.wake.ring();
    }

    /// The time of the node: of `/clock` while `use_sim_time` is true, else of the system.
    pub fn now(&self) -> Stamp {
        self.0.now()
    }

    /// The same as a clock for routes.
    pub fn clock(&self) -> NodeClock {
        let shared = Arc::clone(&self.0);
        NodeClock::default().with_ros_time(move || {
            let time = shared.time.lock();
            RosNow { stamp: time.now(Stamp::now()), simulated: time.is_simulated() }
        })
    }

    /// Requests to the node that were refused unanswered: malformed, too large, or of another
    /// vendor's clients. A DDS stack that fails counts once until it says something else.
    pub fn refused_requests(&self) -> u64 {
        self.0.refused_requests.load(Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_many_were_dropped() {
        let mut queue = LogQueue::default();
        let line = |number: usize| LogLine {
            level: LogLevel::Info,
            logger: "talker".to_owned(),
            text: number.to_string(),
            file: String::new(),
            function: String::new(),
            line: 0,
        };
        (0..MAX_LINES + 2).for_each(|number| queue.push(Stamp::default(), line(number)));
        let texts: Vec<String> = queue.take().into_iter().map(|(_, line)| line.text).collect();
        assert_eq!(texts.len(), MAX_LINES + 1);
        assert!(texts[0].starts_with("2 earlier lines"), "{}", texts[0]);
        assert_eq!(texts[1], "2");
        queue.push(Stamp::default(), line(0));
        assert_eq!(queue.take().len(), 1);
    }
}
