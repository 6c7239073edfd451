//! Calls that a middleware makes from its own threads, made again from one of ours.
//!
//! ```text
//!   thread of the middleware ── call() ──▶ queue ──▶ thread "rmw-events" ──▶ Notify
//!     holds locks of the endpoint                       holds none: may take, count, create
//! ```
//!
//! Fast DDS calls while it holds the lock of the reader. A callback that takes a lock of its own there, and takes
//! messages under the same lock elsewhere, would wait for ever.

#![allow(unsafe_code, reason = "middlewares give a pointer back")]

use std::collections::VecDeque;
use std::ffi::c_void;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use super::Fault;

/// Called from a thread of the node when something has changed. It must not block: all endpoints of the node share
/// that thread.
pub type Notify = Arc<dyn Fn() + Send + Sync>;

/// The queue of calls of one node. The thread behind it ends with the last callback.
#[derive(Clone)]
pub(crate) struct Dispatch(Sender<Arc<Entry>>);

/// One who is to be called, at most once for all that happens until then.
struct Entry {
    notify: Notify,
    is_queued: AtomicBool,
    /// Time after which it is called once more: see [`Dispatch::callback`].
    again_after: Option<Duration>,
}

/// Hook that a middleware is given. The middleware must have returned it before it is dropped.
pub(crate) struct Callback(Box<Hook>);

struct Hook {
    entry: Arc<Entry>,
    queue: Sender<Arc<Entry>>,
}

impl Dispatch {
    pub(crate) fn start() -> Result<Self, Fault> {
        let (queue, calls) = channel::<Arc<Entry>>();
        let run = move || {
            // Those to be called once more, the first one that is due at the front.
            let mut later: VecDeque<(Instant, Arc<Entry>)> = VecDeque::new();
            loop {
                let next = match later.front() {
                    Some((due, _)) => {
                        calls.recv_timeout(due.saturating_duration_since(Instant::now()))
                    }
                    None => calls.recv().map_err(RecvTimeoutError::from),
                };
                let entry = match next {
                    Ok(entry) => {
                        // Before the call: what happens during it is a reason for another one.
                        entry.is_queued.store(false, Ordering::Release);
                        if let Some(time) = entry.again_after {
                            later.push_back((Instant::now() + time, Arc::clone(&entry)));
                        }
                        entry
                    }
                    Err(RecvTimeoutError::Timeout) => match later.pop_front() {
                        Some((_, entry)) => entry,
                        None => continue,
                    },
                    Err(RecvTimeoutError::Disconnected) => return,
                };
                (entry.notify)();
            }
        };
        std::thread::Builder::new()
            .name("rmw-events".to_owned())
            .spawn(run)
            .map_err(|error| Fault::new("starting a thread", error.to_string()))?;
        Ok(Self(queue))
    }

    /// A callback that calls `notify`, and once more after a time, where there is one: the same for all of a node.
    pub(crate) fn callback(&self, notify: Notify, again_after: Option<Duration>) -> Callback {
        let entry = Arc::new(Entry { notify, is_queued: AtomicBool::new(false), again_after });
        Callback(Box::new(Hook { entry, queue: self.0.clone() }))
    }
}

impl Callback {
    /// Pointer that rmw gives back to [`call`].
    pub(crate) fn user_data(&self) -> *const c_void {
        ptr::from_ref::<Hook>(&self.0).cast()
    }
}

/// Queues a call of the [`Notify`] behind `user_data`.
///
/// # Safety
/// `user_data` is [`Callback::user_data`] of a callback that lives.
pub(crate) unsafe extern "C" fn call(user_data: *const c_void, _number_of_events: usize) {
    // SAFETY: as this function asks for.
    let hook = unsafe { &*user_data.cast::<Hook>() };
    if !hook.entry.is_queued.swap(true, Ordering::AcqRel) {
        // The thread is there as long as a sender is.
        _ = hook.queue.send(Arc::clone(&hook.entry));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calls_reach_another_thread_and_none_is_lost() {
        let dispatch = Dispatch::start().unwrap();
        let (told, hears) = channel();
        let notify: Notify = Arc::new(move || {
            told.send(std::thread::current().id()).unwrap();
        });
        let callback = dispatch.callback(notify, Some(Duration::from_millis(1)));
        for _ in 0..3 {
            // SAFETY: the callback lives.
            unsafe { call(callback.user_data(), 1) };
            for _twice in 0..2 {
                assert_ne!(hears.recv().unwrap(), std::thread::current().id());
            }
        }
        drop((callback, dispatch));
        assert!(hears.recv().is_err(), "the thread has ended");
    }
}
