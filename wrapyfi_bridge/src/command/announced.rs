//! The type of a service or an action, as its servers announce it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_endpoint::{
    Discovered, EndpointAddress, LearnError, LearnResult, Middleware, Role, Wake,
};
use wrapyfi_interfaces::store::TypeStore;

use super::definitions;
use super::echo::Waiting;
use super::service::wait;
use crate::exit::{Failure, Result};
use crate::middlewares::described;
use crate::shutdown::Shutdown;

/// Servers whose type a command needs.
pub(in crate::command) struct Announced<'a, T> {
    pub(in crate::command) endpoint: &'a EndpointAddress,
    /// Role of the servers.
    pub(in crate::command) role: Role,
    /// Folders of packages with definitions.
    pub(in crate::command) definitions: &'a [PathBuf],
    /// Time within which a server must be there.
    pub(in crate::command) timeout: Duration,
    pub(in crate::command) learn:
        fn(&dyn Middleware, &Discovered, &mut TypeStore) -> LearnResult<T>,
}

impl<T: Display> Announced<'_, T> {
    /// Waits until there is a server, and returns its type; `None` when asked to end.
    pub(in crate::command) fn learned(
        &self,
        middleware: &dyn Middleware,
        wake: &Wake,
        shutdown: &Shutdown,
    ) -> Result<Option<T>> {
        let Self { endpoint, learn, .. } = self;
        let side = &endpoint.middleware;
        let name = format!("/{}", endpoint.name.trim_start_matches('/'));
        let mut types = definitions::of_command(self.definitions)?;
        let mut discovery = middleware.discover().with_context(|| side.clone())?;
        let deadline = Instant::now() + self.timeout;
        let mut asked = BTreeSet::new();
        let mut waiting = Waiting::new(endpoint);
        while !shutdown.requested() {
            let found = discovery.endpoints().with_context(|| side.clone())?;
            let servers = found.into_iter().filter(|one| one.role == self.role && one.name == name);
            let (mut kinds, mut why) = (BTreeMap::new(), "no node offers it: start one".to_owned());
            for server in servers {
                match learn(middleware, &server, &mut types) {
                    Ok(kind) => _ = kinds.insert(kind.to_string(), kind),
                    Err(LearnError::Undefined { .. }) if asked.insert(server.node.clone()) => {
                        // Now, or never.
                        described(middleware, &server, &mut types);
                        if let Ok(kind) = learn(middleware, &server, &mut types) {
                            kinds.insert(kind.to_string(), kind);
                        }
                    }
                    Err(LearnError::Undefined { reason, .. }) => {
                        return Err(Failure::Usage(format!("{reason} (--definitions DIR)")));
                    }
                    Err(error) => why = format!("still waiting for {error}; give --type"),
                }
            }
            if kinds.len() > 1 {
                let names: Vec<String> = kinds.into_keys().collect();
                let names = names.join(", ");
                let text = format!("{endpoint} has several types: {names}; choose one with --type");
                return Err(Failure::Usage(text));
            }
            if let Some((_, only)) = kinds.pop_first() {
                return Ok(Some(only));
            }
            if Instant::now() >= deadline {
                let why =
                    discovery.waiting_for().map_or(why, |what| format!("still waiting for {what}"));
                return Err(Failure::TimedOut(format!(
                    "{endpoint}: time-out: {why}, or see `wrapyfi list {side}`"
                )));
            }
            match discovery.waiting_for() {
                Some(what) => waiting.say(&what),
                None => waiting.say(&"a node that offers it"),
            }
            wait(wake, Some(deadline));
        }
        Ok(None)
    }
}
