//! The tasks of a YARP instance: one for each endpoint, which closes its port at the end.

use std::sync::Arc;

use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task::JoinSet;

use super::link_state::LinkState;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{Cause, Mutex};
use wrapyfi_yarp::task::{Task, erased};

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
struct Stopped {
    endpoint: watch::Receiver<()>,
    all: watch::Receiver<bool>,
}

impl Stopped {
    /// Waits for the end. Cancel-safe; again and again the same.
    async fn wait(&mut self) {
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

    /// Starts the task of an endpoint: it serves until the endpoint, or all of YARP, ends, and then closes its ports.
    /// Where it panics, it closes those that it has left open, and begins again.
    pub(super) fn spawn<S, F, G>(
        &self,
        name: &str,
        link_state: &Arc<LinkState>,
        endpoint: S,
        serve: impl Fn(S) -> F + Send + 'static,
        close: impl Fn(S) -> G + Send + 'static,
    ) -> Stop
    where
        S: Clone + Send + 'static,
        F: Future<Output = ()> + Send + 'static,
        G: Future<Output = ()> + Send + 'static,
    {
        let served = endpoint.clone();
        let serve = move || erased(serve(served.clone()));
        let close = move || erased(close(endpoint.clone()));
        self.spawn_steps(name, link_state, Box::new(serve), Box::new(close))
    }

    fn spawn_steps(
        &self,
        name: &str,
        link_state: &Arc<LinkState>,
        serve: Box<dyn Fn() -> Task + Send>,
        close: Box<dyn Fn() -> Task + Send>,
    ) -> Stop {
        let (_sender, of_endpoint) = watch::channel(());
        let stopped = Stopped { endpoint: of_endpoint, all: self.ending.subscribe() };
        let (told, ended) = (Arc::clone(link_state), Arc::clone(link_state));
        let begin = move || {
            let (left_open, serve, close) = (close(), serve(), close());
            let (mut stopped, ended) = (stopped.clone(), Arc::clone(&ended));
            async move {
                left_open.await;
                tokio::select! {
                    () = stopped.wait() => {}
                    () = serve => {}
                }
                close.await;
                ended.ended();
            }
        };
        let task = restarted(
            format!("the task of {name}"),
            move |what| told.waiting(Cause::Restarting(what)),
            begin,
        );
        let mut running = self.running.lock();
        while running.try_join_next().is_some() {}
        running.spawn_on(erased(task), &self.handle);
        Stop { _sender }
    }

    /// Starts a task that is given up when YARP ends.
    pub(super) fn spawn_aside(&self, task: impl Future<Output = ()> + Send + 'static) {
        drop(self.handle.spawn(erased(task)));
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
