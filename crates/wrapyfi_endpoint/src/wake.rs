//! The doorbell by which I/O threads tell the thread that takes messages that there is work.

use std::os::fd::{AsFd, OwnedFd};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::task::Waker;
use std::time::{Duration, Instant};

use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};

/// Connections that one thread watches by itself; with more, it waits to be told.
const MOST_WATCHED: usize = 4;

/// A doorbell: rung by I/O threads, waited on by the thread that takes messages.
///
/// Rings are not counted: one wait answers all rings before it, so the waiter must look at every
/// endpoint that it owns. A ring before the wait is not lost.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use std::time::Duration;
/// use wrapyfi_core::endpoint::Wake;
/// let wake = Wake::new();
/// wake.ring();
/// assert!(wake.wait(Duration::from_secs(60))); // returns at once
/// ```
#[derive(Clone, Debug, Default)]
pub struct Wake(Arc<Doorbell>);

/// A connection that a thread which waits for the doorbell may read by itself, in place of the I/O thread: its messages
/// then wake one thread instead of two.
#[doc(hidden)]
pub trait Pollable: Send + Sync {
    /// True where threads send over the connection too, which the thread that reads it has to be told of by its bell.
    fn is_sent_on(&self) -> bool {
        true
    }

    /// Descriptor that is readable when something has come, which the I/O thread does not watch from now on. `None`
    /// where the I/O thread has to see to the connection.
    fn lend(&self) -> Option<Arc<dyn AsFd + Send + Sync>>;

    /// Reads what has come, and rings for it; false where the caller has nothing to watch any more, because the connection
    /// has ended.
    fn read(&self) -> bool;

    /// Has the I/O thread watch the connection again.
    fn give_back(&self);
}

#[derive(Default)]
struct Doorbell {
    state: Mutex<DoorbellState>,
    changed: Condvar,
    /// Descriptor by which a ring reaches a thread that waits for connections too; `None` where the system has none.
    event: OnceLock<Option<OwnedFd>>,
}

#[derive(Default)]
struct DoorbellState {
    rung: bool,
    /// Tasks that the next ring wakes.
    tasks: Vec<Waker>,
    /// Number of threads that wait for a ring alone.
    sleepers: usize,
    watched: Vec<Weak<dyn Pollable>>,
    /// True while a thread watches connections, from when it begins to until it has given them back.
    is_watching: bool,
    /// True while a ring has to be told by the descriptor.
    is_polling: bool,
}

impl Wake {
    /// A doorbell that has not rung.
    pub fn new() -> Self {
        Self::default()
    }

    /// Rings, so that the waiter looks. Never blocks for longer than the flag is held.
    pub fn ring(&self) {
        let tasks = {
            let mut state = self.lock();
            state.rung = true;
            if std::mem::take(&mut state.is_polling) {
                self.0.signal();
            }
            if state.sleepers > 0 {
                self.0.changed.notify_all();
            }
            std::mem::take(&mut state.tasks)
        };
        tasks.into_iter().for_each(Waker::wake);
    }

    /// Waits until rung, at most `timeout`; true when it was rung.
    pub fn wait(&self, timeout: Duration) -> bool {
        let has_time = !self.lock().rung && !timeout.is_zero();
        self.wait_and_read(has_time.then_some((self, true)), timeout)
    }

    /// Waits until rung, at most `timeout`; true when it was rung. Meanwhile the caller reads the connections that ring `other`,
    /// those on which nothing is sent, unless another thread reads them.
    #[doc(hidden)]
    pub fn wait_reading(&self, other: Option<&Self>, timeout: Duration) -> bool {
        self.wait_and_read(other.map(|other| (other, false)), timeout)
    }

    /// Waits until rung, at most `timeout`, and reads the connections of a doorbell; with `true` also those on which is sent.
    fn wait_and_read(&self, read: Option<(&Self, bool)>, timeout: Duration) -> bool {
        let deadline = Instant::now().checked_add(timeout);
        if let Some((read, all)) = read
            && let Some(event) = self.0.event()
            && let lent = read.lend(all)
            && !lent.0.is_empty()
        {
            self.watch(event, &lent.0, deadline);
            drop(lent);
            return std::mem::take(&mut self.lock().rung);
        }
        let mut state = self.lock();
        state.sleepers += 1;
        let left = deadline.map_or(timeout, |at| at.saturating_duration_since(Instant::now()));
        let (mut state, _) = self
            .0
            .changed
            .wait_timeout_while(state, left, |state| !state.rung)
            .unwrap_or_else(PoisonError::into_inner);
        state.sleepers -= 1;
        std::mem::take(&mut state.rung)
    }

    /// Makes the next ring wake a task, beside the thread that waits. Call it before the task
    /// looks, so that no ring between is lost.
    pub fn notify(&self, task: &Waker) {
        let mut state = self.lock();
        if !state.tasks.iter().any(|known| known.will_wake(task)) {
            state.tasks.push(task.clone());
        }
    }

    /// Has threads that wait for the doorbell read a connection that rings it, for as long as it lives.
    #[doc(hidden)]
    pub fn attach<T: Pollable + 'static>(&self, connection: &Arc<T>) {
        let connection = Arc::downgrade(connection);
        let mut state = self.lock();
        state.watched.retain(|known| known.strong_count() > 0);
        state.watched.push(connection);
    }

    /// Connections that the caller is to watch, where there are some and no other thread does.
    fn lend(&self, all: bool) -> Loan<'_> {
        let mut loan = Loan(Vec::new(), None);
        let mut state = self.lock();
        let is_few = (1..=MOST_WATCHED).contains(&state.watched.len());
        if !is_few || state.is_watching {
            return loan;
        }
        state.is_watching = true;
        loan.1 = Some(self);
        let watched: Vec<_> = state.watched.iter().filter_map(Weak::upgrade).collect();
        drop(state);
        for connection in watched.into_iter().filter(|it| all || !it.is_sent_on()) {
            if let Some(fd) = connection.lend() {
                loan.0.push((connection, fd));
            }
        }
        loan
    }

    /// Reads connections until one of them has rung, another thread has, which `event` tells, or the time is over.
    fn watch(&self, event: &OwnedFd, lent: &[Lent], deadline: Option<Instant>) {
        loop {
            {
                let mut state = self.lock();
                if state.rung {
                    return;
                }
                state.is_polling = true;
            }
            let mut fds = vec![PollFd::new(event, PollFlags::IN)];
            fds.extend(
                lent.iter().map(|(_, fd)| PollFd::from_borrowed_fd(fd.as_fd(), PollFlags::IN)),
            );
            let left = deadline.map(|at| at.saturating_duration_since(Instant::now()));
            let left = left.and_then(|left| Timespec::try_from(left).ok());
            let polled = poll(&mut fds, left.as_ref());
            let is_ready: Vec<bool> = fds.iter().map(|fd| !fd.revents().is_empty()).collect();
            {
                let mut state = self.lock();
                // A ring has taken this back, and told it by the descriptor.
                if !std::mem::take(&mut state.is_polling) {
                    self.0.drain();
                    return;
                }
            }
            // An interrupted call ends the wait too: the caller may want to know of the signal.
            if !polled.is_ok_and(|count| count > 0) {
                return;
            }
            let ready = lent.iter().zip(is_ready.iter().skip(1)).filter(|(_, is_ready)| **is_ready);
            // A descriptor whose connection has ended would be readable for ever.
            if ready.filter(|((connection, _), _)| !connection.read()).count() > 0 {
                return;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, DoorbellState> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A connection that was lent, with its descriptor.
type Lent = (Arc<dyn Pollable>, Arc<dyn AsFd + Send + Sync>);

/// Connections that were lent, and the doorbell that is watched for them. They go back on drop: also where reading panics.
struct Loan<'a>(Vec<Lent>, Option<&'a Wake>);

impl Drop for Loan<'_> {
    fn drop(&mut self) {
        self.0.iter().for_each(|(connection, _)| connection.give_back());
        if let Some(wake) = self.1 {
            wake.lock().is_watching = false;
        }
    }
}

impl Doorbell {
    fn event(&self) -> Option<&OwnedFd> {
        let open = || eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK).ok();
        self.event.get_or_init(open).as_ref()
    }

    /// Makes the descriptor readable.
    fn signal(&self) {
        let told = self.event().map(|event| rustix::io::write(event, &1_u64.to_ne_bytes()));
        if let Some(Err(error)) = told {
            tracing::error!(%error, "a thread that waits cannot be woken");
        }
    }

    /// Makes the descriptor unreadable again.
    fn drain(&self) {
        if let Some(event) = self.event() {
            _ = rustix::io::read(event, &mut [0; 8]);
        }
    }
}

impl std::fmt::Debug for Doorbell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Doorbell").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    use super::*;

    struct Count(AtomicUsize);

    impl std::task::Wake for Count {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, SeqCst);
        }
    }

    #[test]
    fn a_task_is_woken_once_for_each_time_it_asked() {
        let (wake, count) = (Wake::new(), Arc::new(Count(AtomicUsize::new(0))));
        let task = Arc::clone(&count).into();
        wake.notify(&task);
        wake.notify(&task);
        wake.ring();
        wake.ring();
        assert_eq!(count.0.load(SeqCst), 1);
        assert!(wake.wait(Duration::from_secs(60)), "threads are told as well");
    }

    /// A connection of a test: the reading end of a pipe.
    struct Pipe {
        end: Arc<OwnedFd>,
        wake: Wake,
        is_lent: Mutex<bool>,
        read: AtomicUsize,
        is_sent_on: bool,
    }

    impl Pipe {
        /// A connection that is attached to `wake`, and the other end of the pipe.
        fn at(wake: &Wake, is_sent_on: bool) -> (Arc<Self>, OwnedFd) {
            let (end, other) = rustix::pipe::pipe().unwrap();
            let (end, wake) = (Arc::new(end), wake.clone());
            let (is_lent, read) = (Mutex::new(false), AtomicUsize::new(0));
            let pipe = Arc::new(Self { end, wake, is_lent, read, is_sent_on });
            pipe.wake.attach(&pipe);
            (pipe, other)
        }
    }

    impl Pollable for Pipe {
        fn is_sent_on(&self) -> bool {
            self.is_sent_on
        }

        fn lend(&self) -> Option<Arc<dyn AsFd + Send + Sync>> {
            let was_lent = std::mem::replace(&mut *self.is_lent.lock().unwrap(), true);
            assert!(!was_lent, "two threads watch it");
            Some(Arc::clone(&self.end) as Arc<dyn AsFd + Send + Sync>)
        }

        fn read(&self) -> bool {
            let mut byte = [0];
            assert_eq!(rustix::io::read(&*self.end, &mut byte), Ok(1));
            self.read.fetch_add(1, SeqCst);
            // Half a message rings for nothing.
            if byte[0] == 1 {
                self.wake.ring();
            }
            // The end of a connection.
            byte[0] != 2
        }

        fn give_back(&self) {
            *self.is_lent.lock().unwrap() = false;
        }
    }

    #[test]
    fn a_thread_that_waits_reads_by_itself_until_a_message_is_whole() {
        let wake = Wake::new();
        let (pipe, other) = Pipe::at(&wake, true);
        rustix::io::write(&other, &[0, 0, 1, 0]).unwrap();
        assert!(wake.wait(Duration::from_secs(60)));
        assert_eq!((pipe.read.load(SeqCst), *pipe.is_lent.lock().unwrap()), (3, false));
        assert!(!wake.wait(Duration::from_millis(1)), "the rest of a message is not there");
        assert_eq!(pipe.read.load(SeqCst), 4);
        wake.ring();
        assert!(wake.wait(Duration::from_secs(60)), "a ring before the wait is not lost");
        rustix::io::write(&other, &[2]).unwrap();
        assert!(!wake.wait(Duration::from_secs(60)), "a connection that has ended is left at once");
        assert_eq!((pipe.read.load(SeqCst), *pipe.is_lent.lock().unwrap()), (5, false));

        // Rings reach a thread that watches connections, and one beside it.
        std::thread::scope(|scope| {
            let wait = || while !wake.wait(Duration::from_secs(60)) {};
            let waiters = [scope.spawn(wait), scope.spawn(wait)];
            while waiters.iter().any(|waiter| !waiter.is_finished()) {
                wake.ring();
                std::thread::yield_now();
            }
        });
        while wake.wait(Duration::ZERO) {}
        drop(pipe);
        assert!(!wake.wait(Duration::from_millis(1)), "nothing is left to be watched");
    }

    /// Rings a bell of its own when it is woken.
    struct Rings(Wake);

    impl std::task::Wake for Rings {
        fn wake(self: Arc<Self>) {
            self.0.ring();
        }
    }

    #[test]
    fn a_thread_with_a_bell_of_its_own_reads_connections_of_another() {
        let (own, other) = (Wake::new(), Wake::new());
        let (pipe, written) = Pipe::at(&other, false);
        let (sent_on, _other_end) = Pipe::at(&other, true);
        other.ring();
        let task = Arc::new(Rings(own.clone())).into();
        other.notify(&task);
        rustix::io::write(&written, &[0, 1]).unwrap();
        assert!(own.wait_reading(Some(&other), Duration::from_secs(60)));
        assert_eq!((pipe.read.load(SeqCst), *pipe.is_lent.lock().unwrap()), (2, false));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !*pipe.is_lent.lock().unwrap() {
                    std::thread::yield_now();
                }
                own.ring();
            });
            let rang = own.wait_reading(Some(&other), Duration::from_secs(60));
            assert!(rang, "nothing is read meanwhile");
            assert!(!*sent_on.is_lent.lock().unwrap(), "its senders would ring in vain");
        });
        assert_eq!((pipe.read.load(SeqCst), *pipe.is_lent.lock().unwrap()), (2, false));
        assert!(!own.wait_reading(None, Duration::from_millis(1)), "and nothing without");
    }

    /// A connection whose first reading panics.
    struct Panics(Arc<OwnedFd>, AtomicUsize);

    impl Pollable for Panics {
        fn lend(&self) -> Option<Arc<dyn AsFd + Send + Sync>> {
            Some(Arc::clone(&self.0) as Arc<dyn AsFd + Send + Sync>)
        }

        fn read(&self) -> bool {
            panic!("a fault of a test");
        }

        fn give_back(&self) {
            self.1.fetch_add(1, SeqCst);
        }
    }

    #[test]
    fn a_connection_goes_back_when_reading_it_panics() {
        let wake = Wake::new();
        let (end, other) = rustix::pipe::pipe().unwrap();
        let connection = Arc::new(Panics(Arc::new(end), AtomicUsize::new(0)));
        wake.attach(&connection);
        rustix::io::write(&other, &[0]).unwrap();
        for times in 1..=2 {
            let wait = std::panic::AssertUnwindSafe(|| wake.wait(Duration::from_secs(60)));
            assert!(std::panic::catch_unwind(wait).is_err(), "it is lent again after a panic");
            assert_eq!(connection.1.load(SeqCst), times);
        }
    }
}
