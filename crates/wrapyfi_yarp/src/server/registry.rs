//! The names there are: where their ports listen, what they say of themselves.
//!
//! ```text
//!   "/cam" ──▶ Entry { 10.0.0.1 : 10002, tcp, properties: ips, offers, process … }
//! ```
//!
//! Properties are lists of texts, kept in the order of their bytes: `set /x k red 5` answers
//! `5 red`, as YARP's data base does.

use std::collections::BTreeMap;

use super::NameServerLimits;
use super::allocator::Allocator;
use super::subscriptions::Known;
use crate::port::names::Registration;

/// A registered port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Entry {
    contact: Registration,
    /// Type of its data, as `yarp/image`. Stored, as YARP does, and never told.
    kind: Option<String>,
    properties: BTreeMap<String, Vec<String>>,
}

/// Demands of a port that registers. `...` leaves the choice to the name server, as does a port
/// that is no number above 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Wish {
    pub(crate) name: String,
    pub(crate) carrier: String,
    pub(crate) host: String,
    pub(crate) port: i64,
    pub(crate) kind: Option<String>,
}

/// Refusal of a name server. The text goes to the client that asked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum Refusal {
    #[error("the name has {length} bytes, the limit is {limit}")]
    LongName { length: usize, limit: usize },
    #[error("{port} is not a port number: use 1 to 65535, or ... for any")]
    Port { port: i64 },
    #[error("{limit} names are registered, which is the limit: run yarp clean")]
    Names { limit: usize },
    #[error("no port number from {first} to {last} is free: run yarp clean")]
    Numbers { first: u16, last: u16 },
    #[error("no multicast group is free: run yarp clean")]
    Groups,
    #[error("{name} is the name server itself")]
    Own { name: String },
    #[error("{key} belongs to the registration: register the port again")]
    Fixed { key: String },
    #[error("a port has at most {limit} properties")]
    Properties { limit: usize },
    #[error("a property has at most {values} values of {bytes} bytes in all")]
    Values { values: usize, bytes: usize },
    #[error("{limit} of these are kept, which is the limit")]
    Kept { limit: usize },
    #[error("the command has {length} bytes, the limit is {limit}")]
    LongCommand { length: usize, limit: usize },
    #[error("the command cannot be read: {reason}")]
    Unreadable { reason: String },
}

/// The names there are.
#[derive(Debug)]
pub(crate) struct Registry {
    pub(crate) own: Registration,
    ports: BTreeMap<String, Entry>,
    /// Number of registrations that use a port number, whichever side chose it.
    numbers: BTreeMap<u16, usize>,
    allocator: Allocator,
    limits: NameServerLimits,
}

impl Registry {
    /// Knows the name server itself, and the group on which it can be found.
    pub(crate) fn new(own: &Registration, discovery_port: u16, limits: NameServerLimits) -> Self {
        let mut registry = Self {
            own: own.clone(),
            ports: BTreeMap::new(),
            numbers: BTreeMap::new(),
            // The numbers above the server's own are its to give.
            allocator: Allocator::new(own.port),
            limits,
        };
        registry.insert(own, None);
        registry.properties(&own.name, "nameserver", vec!["true".to_owned()]);
        registry.insert(
            &Registration {
                name: "fallback".to_owned(),
                host: crate::name::DISCOVERY_GROUP.to_string(),
                port: discovery_port,
                carrier: "mcast".to_owned(),
            },
            None,
        );
        registry
    }

    /// Number of names.
    pub(crate) fn len(&self) -> usize {
        self.ports.len()
    }

    /// Address of a port; `network` chooses among those that it has.
    pub(crate) fn find(&self, name: &str, network: &str) -> Option<Registration> {
        let entry = self.ports.get(name)?;
        let reached = || {
            let addresses = entry.properties.get("ips")?;
            addresses.iter().find(|address| address.starts_with(network))
        };
        let host = if network.is_empty() { None } else { reached() };
        let host = host.unwrap_or(&entry.contact.host);
        // As YARP answers where a port was registered without an address.
        let host = if host.is_empty() { "localhost".to_owned() } else { host.clone() };
        Some(Registration { host, ..entry.contact.clone() })
    }

    /// The names that begin with whole components of `prefix`, in order.
    pub(crate) fn names(&self, prefix: &str) -> impl Iterator<Item = &str> {
        self.ports.keys().map(String::as_str).filter(move |name| {
            name.strip_prefix(prefix).is_some_and(|rest| {
                rest.is_empty()
                    || prefix.is_empty()
                    || rest.starts_with('/')
                    || prefix.ends_with('/')
            })
        })
    }

    /// The names whose property `key` has `value`, in order.
    pub(crate) fn names_with(&self, key: &str, value: &str) -> impl Iterator<Item = &str> {
        self.ports
            .iter()
            .filter(move |(_, entry)| {
                entry.properties.get(key).is_some_and(|values| values.iter().any(|v| v == value))
            })
            .map(|(name, _)| name.as_str())
    }

    /// Checks that a name may be registered, before anything is changed for it.
    pub(crate) fn check(&self, wish: &Wish) -> Result<(), Refusal> {
        let limit = self.limits.max_name_bytes;
        for text in [&wish.name, &wish.carrier, &wish.host].into_iter().chain(&wish.kind) {
            if text.len() > limit {
                return Err(Refusal::LongName { length: text.len(), limit });
            }
        }
        if wish.name == self.own.name {
            return Err(Refusal::Own { name: wish.name.clone() });
        }
        if wish.port > i64::from(u16::MAX) {
            return Err(Refusal::Port { port: wish.port });
        }
        if self.ports.len() >= self.limits.max_names && !self.ports.contains_key(&wish.name) {
            return Err(Refusal::Names { limit: self.limits.max_names });
        }
        Ok(())
    }

    /// Registers a port that [`Self::check`] allows and that is not registered any more, and tells
    /// where it is.
    pub(crate) fn register(
        &mut self,
        wish: Wish,
        busy: impl Fn(u16) -> bool,
    ) -> Result<Registration, Refusal> {
        let Wish { mut name, carrier, mut host, port, kind } = wish;
        let given = name == "..." || name.starts_with('=');
        let mut completed = None;
        if given {
            let made = self.allocator.name(|name| self.ports.contains_key(name));
            name = if name == "..." { made.clone() } else { format!("{made}{name}") };
            completed = Some(made);
        }
        let undo = |registry: &mut Self, host: &str| {
            if let Some(made) = &completed {
                registry.allocator.give_back(made, host, 0);
            }
        };
        if carrier == "mcast" && host == "..." {
            let Some(group) = self.allocator.group() else {
                undo(self, "");
                return Err(Refusal::Groups);
            };
            host = group;
        }
        let number = match u16::try_from(port) {
            Ok(number) if number != 0 => Some(number),
            // YARP gives away what is in use, and its ports then fail to listen.
            _ => self
                .allocator
                .number(&name, |number| self.numbers.contains_key(&number) || busy(number)),
        };
        let Some(number) = number else {
            undo(self, &host);
            let (first, last) = self.allocator.range();
            return Err(Refusal::Numbers { first, last });
        };
        let contact = Registration { name, host, port: number, carrier };
        self.insert(&contact, kind);
        Ok(contact)
    }

    fn insert(&mut self, contact: &Registration, kind: Option<String>) {
        self.remove(&contact.name);
        *self.numbers.entry(contact.port).or_default() += 1;
        let entry = Entry { contact: contact.clone(), kind, properties: BTreeMap::new() };
        self.ports.insert(contact.name.clone(), entry);
    }

    /// Forgets a port, and tells which others it owned.
    pub(crate) fn remove(&mut self, name: &str) -> Option<Vec<String>> {
        let mut entry = self.ports.remove(name)?;
        if let Some(users) = self.numbers.get_mut(&entry.contact.port) {
            *users -= 1;
            if *users == 0 {
                self.numbers.remove(&entry.contact.port);
            }
        }
        self.allocator.give_back(name, &entry.contact.host, entry.contact.port);
        Some(entry.properties.remove("owns").unwrap_or_default())
    }

    /// The values of a property; none where the port is not known.
    pub(crate) fn property(&self, name: &str, key: &str) -> Option<Vec<String>> {
        let entry = self.ports.get(name)?;
        Some(match key {
            "host" => vec![entry.contact.host.clone()],
            "socket" => vec![entry.contact.port.to_string()],
            "carrier" => vec![entry.contact.carrier.clone()],
            "type" => entry.kind.iter().cloned().collect(),
            _ => entry.properties.get(key).cloned().unwrap_or_default(),
        })
    }

    /// Sets a property; false where the port is not known.
    pub(crate) fn set(
        &mut self,
        name: &str,
        key: &str,
        values: Vec<String>,
    ) -> Result<bool, Refusal> {
        let limits = &self.limits;
        let Some(entry) = self.ports.get(name) else { return Ok(false) };
        if ["port", "host", "socket", "carrier", "type"].contains(&key) {
            return Err(Refusal::Fixed { key: key.to_owned() });
        }
        if key.len() > limits.max_name_bytes {
            return Err(Refusal::LongName { length: key.len(), limit: limits.max_name_bytes });
        }
        let known = entry.properties.contains_key(key);
        if !known && entry.properties.len() >= limits.max_properties {
            return Err(Refusal::Properties { limit: limits.max_properties });
        }
        let (most, bytes) = (limits.max_values, limits.max_value_bytes);
        if values.len() > most || values.iter().map(String::len).sum::<usize>() > bytes {
            return Err(Refusal::Values { values: most, bytes });
        }
        self.properties(name, key, values);
        Ok(true)
    }

    fn properties(&mut self, name: &str, key: &str, mut values: Vec<String>) {
        values.sort_unstable();
        if let Some(entry) = self.ports.get_mut(name) {
            if values.is_empty() {
                entry.properties.remove(key);
            } else {
                entry.properties.insert(key.to_owned(), values);
            }
        }
    }
}

impl Known for Registry {
    fn is_port(&self, name: &str) -> bool {
        self.ports.get(name).is_some_and(|entry| entry.contact.carrier != "topic")
    }
}
