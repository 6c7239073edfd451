//! The tasks of a YARP instance: one for each endpoint, which closes its port at the end.

use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task::JoinSet;

use wrapyfi_endpoint::Mutex;
use wrapyfi_endpoint::restart::restarted;

/// Runtime of the endpoints' tasks, which ends all of them.
#[derive(Debug)]
pub(super) struct Tasks {
    handle: Handle,
    running: Mutex<JoinSet<()>>,
    ending: watch::Sender<bool>,
}

/// Ends an endpoint's task when it is dropped.
#[derive(Debug)]
pub(super) struct Stop {
    _sender: watch::Sender<()>,
}

/// Resolves when the endpoint, or all of YARP, ends.
#[derive(Debug, Clone)]
pub(super) struct Stopped {
    endpoint: watch::Receiver<()>,
    all: watch::Receiver<bool>,
}

impl Stopped {
    /// Waits for the end. Cancel-safe; again and again the same.
    pub(super) async fn wait(&mut self) {
        tokio::select! {
            // Nothing is ever sent: it resolves when the sender is dropped.
            _ = self.endpoint.changed() => {}
            _ = self.all.wait_for(|ending| *ending) => {}
        }
    }
}

impl Tasks {
    pub(super) fn new(handle: Handle) -> Self {
        Self { handle, running: Mutex::default(), ending: watch::Sender::new(false) }
    }

    /// A way to end a task, for the task and for its owner.
    pub(super) fn stop(&self) -> (Stop, Stopped) {
        let (_sender, endpoint) = watch::channel(());
        (Stop { _sender }, Stopped { endpoint, all: self.ending.subscribe() })
    }

    /// Starts a task that ends by itself once it is stopped; where it panics, it begins again.
    pub(super) fn spawn<F: Future<Output = ()> + Send + 'static>(
        &self,
        name: &str,
        tell: impl Fn(String) + Send + 'static,
        begin: impl FnMut() -> F + Send + 'static,
    ) {
        let task = restarted(format!("the task of {name}"), tell, begin);
        let mut running = self.running.lock();
        while running.try_join_next().is_some() {}
        running.spawn_on(task, &self.handle);
    }

    /// Starts a task that is given up when YARP ends.
    pub(super) fn spawn_aside(&self, task: impl Future<Output = ()> + Send + 'static) {
        drop(self.handle.spawn(task));
    }

    /// Stops all, and waits until they have ended.
    pub(super) async fn end(&self) {
        self.ending.send_replace(true);
        let mut running = {
            let mut running = self.running.lock();
            std::mem::take(&mut *running)
        };
        while running.join_next().await.is_some() {}
    }
}
