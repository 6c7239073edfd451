//! Tasks that panic begin again.
//!
//! ```text
//!   begin ─▶ task ── ends ──▶ over
//!     ▲        └─ panics: told, counted ─┐
//!     └──────────── back-off ────────────┘
//! ```

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::task::Poll;
use std::time::Instant;

use crate::backoff::{Backoff, LONGEST};

/// Runs the task that `begin` makes until it ends. After a panic, `tell` is given the reason that
/// it does not run, and the task begins again after a pause.
pub async fn restarted<F: Future<Output = ()>>(
    what: String,
    tell: impl Fn(String),
    mut begin: impl FnMut() -> F,
) {
    let mut backoff = Backoff::of_name(&what);
    for panics in 1_u64.. {
        let began = Instant::now();
        let mut task = Box::pin(begin());
        let has_ended = std::future::poll_fn(|context| {
            let polled = catch_unwind(AssertUnwindSafe(|| task.as_mut().poll(context)));
            polled.map_or(Poll::Ready(false), |polled| polled.map(|()| true))
        });
        if has_ended.await {
            return;
        }
        drop(task);
        tracing::error!(panics, "{what} panicked: it begins again after a pause");
        tell(format!("{what} to begin again, which has panicked {panics} times"));
        if began.elapsed() > LONGEST {
            backoff.reset();
        }
        backoff.pause().await;
    }
}

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};

    use super::*;

    #[test]
    fn a_task_that_panics_begins_again_until_it_ends() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let (began, told) = (Cell::new(0), RefCell::new(Vec::new()));
        let task = || {
            began.set(began.get() + 1);
            let is_over = began.get() == 3;
            async move {
                tokio::task::yield_now().await;
                assert!(is_over, "on purpose");
            }
        };
        let tell = |what| told.borrow_mut().push(what);
        runtime.block_on(restarted("the task".to_owned(), tell, task));
        let said = |count| format!("the task to begin again, which has panicked {count} times");
        assert_eq!((began.get(), told.into_inner()), (3, vec![said(1), said(2)]));
    }
}
