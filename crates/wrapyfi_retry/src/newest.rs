//! Tasks of which only the newest run.

use std::collections::VecDeque;

use tokio::task::AbortHandle;

/// Tasks of which at most so many run at once: one more ends the oldest.
#[derive(Debug, Default)]
pub struct NewestTasks(VecDeque<AbortHandle>);

impl NewestTasks {
    /// Enters a task, and ends the oldest where `most` run already.
    pub fn enter(&mut self, task: AbortHandle, most: usize) {
        self.0.retain(|task| !task.is_finished());
        if self.0.len() >= most
            && let Some(oldest) = self.0.pop_front()
        {
            oldest.abort();
        }
        self.0.push_back(task);
    }

    /// Ends all of them.
    pub fn abort(&self) {
        self.0.iter().for_each(AbortHandle::abort);
    }
}
