//! The ports of a network as endpoints.
//!
//! ```text
//!   /cam         publisher /cam          /head/state:o   publisher        /head/rpc:i   server
//!   /cam:in417   listener of /cam        /head/cmd:i     listener         /head/rpc     server
//! ```
//!
//! A name server knows names only: neither types nor what a port does. The role is what YARP's
//! customs make of the name (`:i`, `:o`, `rpc`), and Wrapyfi's (`:in` and a number).

use std::collections::BTreeMap;
use std::sync::Arc;

use super::Shared;
use crate::endpoint::{DiscoverError, Discovered, Discovery, Role};

/// Looks at one name server.
pub(super) struct YarpDiscovery {
    shared: Arc<Shared>,
}

impl YarpDiscovery {
    pub(super) fn new(shared: &Arc<Shared>) -> Self {
        Self { shared: Arc::clone(shared) }
    }
}

/// What a port is, by its name: of what, and in which role.
fn role(name: &str) -> (&str, Role) {
    if let Some((topic, number)) = name.rsplit_once(":in")
        && !number.is_empty()
        && number.bytes().all(|byte| byte.is_ascii_digit())
    {
        return (topic, Role::Listener);
    }
    let last = name.rsplit('/').next().unwrap_or(name);
    match last.split_once(':') {
        _ if last.starts_with("rpc") => (name, Role::Server),
        Some((_, "rpc")) => (name, Role::Server),
        Some((_, "i")) => (name, Role::Listener),
        _ => (name, Role::Publisher),
    }
}

impl Discovery for YarpDiscovery {
    fn endpoints(&mut self) -> Result<Vec<Discovered>, DiscoverError> {
        let (names, own) = (self.shared.directory.names(), self.shared.registrar.client());
        let mut counts: BTreeMap<(&str, Role), u64> = BTreeMap::new();
        // The name server's own names are no endpoints.
        let ports = names
            .iter()
            .filter(|name| *name != own.namespace() && *name != "fallback")
            .filter(|name| !self.shared.own.contains(name));
        for name in ports {
            *counts.entry(role(name)).or_default() += 1;
        }
        let found = counts
            .into_iter()
            .map(|((name, role), count)| Discovered { count, ..Discovered::new(name, role) });
        Ok(found.collect())
    }

    fn waiting_for(&self) -> Option<String> {
        self.shared.directory.waiting_for()
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
            assert_eq!(role(port), (name, told), "{port}");
        }
    }
}
