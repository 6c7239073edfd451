//! State of an endpoint's connections, written by its task and read by its owner.

use wrapyfi_endpoint::{Cause, Link, Mutex, Wake};

/// Written by the task of an endpoint, read by its owner, who is rung at changes.
#[derive(Debug)]
pub(super) struct LinkState {
    state: Mutex<Link>,
    pub(super) wake: Wake,
}

impl LinkState {
    /// State of a new endpoint, without connections.
    pub(super) fn new(wake: Wake, waiting_for: Cause) -> Self {
        let link = Link { peers: Some(0), waiting_for: Some(waiting_for), keeps_last: false };
        Self { state: Mutex::new(link), wake }
    }

    /// Connected to so many.
    pub(super) fn connected(&self, peers: usize) {
        self.set(Link { peers: Some(peers), waiting_for: None, keeps_last: false });
    }

    /// Not connected, with the reason.
    pub(super) fn waiting(&self, what: impl Into<Cause>) {
        self.set(Link { peers: Some(0), waiting_for: Some(what.into()), keeps_last: false });
    }

    /// Not connected: the middleware has ended.
    pub(super) fn ended(&self) {
        self.waiting(Cause::Ended("YARP, which has ended".to_owned()));
    }

    fn set(&self, link: Link) {
        let mut state = self.state.lock();
        if *state != link {
            *state = link;
            drop(state);
            self.wake.ring();
        }
    }

    pub(super) fn link(&self) -> Link {
        self.state.lock().clone()
    }
}
