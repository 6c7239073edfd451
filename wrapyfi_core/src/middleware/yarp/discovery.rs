//! The ports of a network as endpoints.
//!
//! ```text
//!   /cam         publisher /cam          /head/state:o   publisher        /head/rpc:i   server
//!   /cam:in417   listener of /cam        /head/cmd:i     listener         /head/rpc     server
//! ```
//!
//! A name server knows names only: neither types nor what a port does. So the ports themselves are
//! asked for their connections, once when they are first seen and again a while later: what has outputs
//! is a publisher, what has inputs alone a listener. Of a port without connections, and of one that does
//! not answer, the role is what YARP's customs make of the name (`:i`, `:o`, `rpc`), and Wrapyfi's (`:in`
//! and a number). Nobody can be asked for types.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::task::JoinSet;

use super::Shared;
use super::tasks::{Stop, Stopped};
use crate::endpoint::{DiscoverError, Discovered, Discovery, Role};

/// How long what a port said is believed.
const BELIEVED: Duration = Duration::from_secs(2);
/// Longest time that a port is given for its answer: those that died are still registered.
const PATIENCE: Duration = Duration::from_millis(500);
/// Most ports that are asked at once.
const AT_ONCE: usize = 16;

/// Looks at one name server.
pub(super) struct YarpDiscovery {
    shared: Arc<Shared>,
    asked: Arc<Asked>,
    /// Ends what is being asked.
    stop: Option<Stop>,
    /// What was told last is all that the name server and the ports say.
    complete: bool,
}

/// What ports said of their connections.
#[derive(Debug, Default)]
struct Asked(Mutex<BTreeMap<String, Answer>>);

/// What one port said.
#[derive(Debug, Clone, Copy)]
struct Answer {
    asked_at: Instant,
    /// Its answer to the last question is not there yet.
    is_open: bool,
    traffic: Option<Traffic>,
}

/// Which ways a port is connected with other ports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Traffic {
    inputs: bool,
    outputs: bool,
}

impl Asked {
    fn known(&self) -> MutexGuard<'_, BTreeMap<String, Answer>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl YarpDiscovery {
    pub(super) fn new(shared: &Arc<Shared>) -> Self {
        Self { shared: Arc::clone(shared), asked: Arc::default(), stop: None, complete: false }
    }

    /// Asks those ports of `names` that have not said anything lately.
    fn ask(&mut self, names: &[String]) {
        let due: Vec<String> = {
            let mut known = self.asked.known();
            known.retain(|name, _| names.contains(name));
            let old = |name: &&String| {
                known.get(*name).is_none_or(|answer| answer.asked_at.elapsed() > BELIEVED)
            };
            let due = names.iter().filter(old).cloned().collect::<Vec<_>>();
            for name in &due {
                // Whatever was said before holds until there is an answer.
                let traffic = known.get(name).and_then(|answer| answer.traffic);
                let answer = Answer { asked_at: Instant::now(), is_open: true, traffic };
                known.insert(name.clone(), answer);
            }
            due
        };
        if due.is_empty() {
            return;
        }
        let (stop, stopped) = self.shared.tasks.stop();
        // Those asked before, who have not answered yet, are asked no longer.
        self.stop = Some(stop);
        let (shared, asked) = (Arc::clone(&self.shared), Arc::clone(&self.asked));
        self.shared.tasks.spawn(ask_all(shared, asked, due, stopped));
    }
}

async fn ask_all(shared: Arc<Shared>, asked: Arc<Asked>, names: Vec<String>, mut stopped: Stopped) {
    let (mut running, mut names) = (JoinSet::new(), names.into_iter());
    let all = async {
        loop {
            while running.len() < AT_ONCE
                && let Some(name) = names.next()
            {
                let network = shared.network.clone();
                running.spawn(async move {
                    let traffic = tokio::time::timeout(PATIENCE, traffic(&network, &name)).await;
                    (name, traffic.ok().flatten())
                });
            }
            match running.join_next().await {
                Some(Ok((name, traffic))) => {
                    let answer = Answer { asked_at: Instant::now(), is_open: false, traffic };
                    asked.known().insert(name, answer);
                }
                Some(Err(_ended)) => {}
                None => return,
            }
        }
    };
    tokio::select! {
        () = all => {}
        () = stopped.wait() => {}
    }
}

/// What a port says of its connections with other ports; none where it does not answer.
async fn traffic(network: &wrapyfi_yarp::port::Network, name: &str) -> Option<Traffic> {
    let connected = async |outputs| {
        let names = network.connections(name, outputs).await.ok()?;
        // The tools that ask are no ports, and the name server reads nobody.
        Some(names.iter().any(|other| other.starts_with('/')))
    };
    Some(Traffic { outputs: connected(true).await?, inputs: connected(false).await? })
}

/// What a port is, by its name and its connections: of what, and in which role.
fn role(name: &str, traffic: Option<Traffic>) -> (&str, Role) {
    let last = name.rsplit('/').next().unwrap_or(name);
    if let Some((topic, number)) = name.rsplit_once(":in")
        && !number.is_empty()
        && number.bytes().all(|byte| byte.is_ascii_digit())
    {
        // It asks what it is connected to.
        let asks = matches!(traffic, Some(Traffic { outputs: true, .. }));
        return (topic, if asks { Role::Client } else { Role::Listener });
    }
    let by_custom = match last.split_once(':') {
        _ if last.starts_with("rpc") => return (name, Role::Server),
        Some((_, "rpc")) => return (name, Role::Server),
        Some((_, "i")) => Role::Listener,
        _ => Role::Publisher,
    };
    let role = match traffic {
        Some(Traffic { outputs: true, .. }) => Role::Publisher,
        Some(Traffic { inputs: true, outputs: false }) => Role::Listener,
        _ => by_custom,
    };
    (name, role)
}

impl Discovery for YarpDiscovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let was_asked = self.shared.directory.was_asked();
        let (mut names, own) = (self.shared.directory.names(), self.shared.registrar.client());
        // The name server's own names are no endpoints.
        names.retain(|name| {
            name != own.namespace() && name != "fallback" && !self.shared.own.contains(name)
        });
        self.ask(&names);
        let mut counts: BTreeMap<(&str, Role), u64> = BTreeMap::new();
        let asked = self.asked.known();
        self.complete = was_asked && asked.values().all(|answer| !answer.is_open);
        for name in &names {
            let traffic = asked.get(name).and_then(|answer| answer.traffic);
            *counts.entry(role(name, traffic)).or_default() += 1;
        }
        let found = counts
            .into_iter()
            .map(|((name, role), count)| Discovered { count, ..Discovered::new(name, role) });
        Ok(found.collect())
    }

    fn waiting_for(&self) -> Option<String> {
        self.shared.directory.waiting_for()
    }

    fn is_complete(&self) -> Option<bool> {
        Some(self.complete)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_what_ports_do() {
        for (port, name, told) in [
            ("/cam", "/cam", Role::Publisher),
            ("/cam:in417", "/cam", Role::Listener),
            ("/cam:in", "/cam:in", Role::Publisher),
            ("/icub/head/state:o", "/icub/head/state:o", Role::Publisher),
            ("/icub/head/command:i", "/icub/head/command:i", Role::Listener),
            ("/icub/head/rpc:i", "/icub/head/rpc:i", Role::Server),
            ("/grabber/rpc", "/grabber/rpc", Role::Server),
        ] {
            assert_eq!(role(port, None), (name, told), "{port}");
            let idle = Some(Traffic { inputs: false, outputs: false });
            assert_eq!(role(port, idle), (name, told), "{port}");
        }
    }

    #[test]
    fn connections_tell_more_than_names() {
        let traffic = |inputs, outputs| Some(Traffic { inputs, outputs });
        for (port, traffic, name, told) in [
            ("/view", traffic(true, false), "/view", Role::Listener),
            ("/relay", traffic(true, true), "/relay", Role::Publisher),
            ("/odd:i", traffic(false, true), "/odd:i", Role::Publisher),
            ("/cam:in417", traffic(true, false), "/cam", Role::Listener),
            ("/ask:in3", traffic(false, true), "/ask", Role::Client),
            ("/head/rpc:i", traffic(true, false), "/head/rpc:i", Role::Server),
        ] {
            assert_eq!(role(port, traffic), (name, told), "{port}");
        }
    }
}
