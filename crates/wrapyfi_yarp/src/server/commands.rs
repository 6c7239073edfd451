//! Commands of a name server and their effects, without sockets.
//!
//! ```text
//!   "register /cam" from 10.0.0.1 ──▶ NameState::apply ──▶ Outcome { reply, events, links }
//!                                     (registry, subscriptions)
//! ```
//!
//! Replies are those of YARP 3.12, byte for byte, oddities included: each one that is kept is named
//! where it is made.

use std::net::IpAddr;
use std::time::Duration;

use super::NameServerLimits;
use super::registry::{Refusal, Registry, Wish};
use super::reply::{self, Reply, line, stored};
use super::subscriptions::{Link, Subscriptions, TooMany};
use crate::name::{NameEvent, Target};
use crate::port::names::Registration;
use crate::{Bottle, Value, WireLimits};

/// Everything a name server knows.
#[derive(Debug)]
pub(crate) struct NameState {
    pub(crate) registry: Registry,
    pub(crate) subscriptions: Subscriptions,
}

/// Client that asks, and the time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asker {
    /// Address of his machine, where it is known.
    pub(crate) address: Option<IpAddr>,
    /// Time since the server started.
    pub(crate) now: Duration,
    /// Test whether something else listens on a port number of the client's machine, as far as we
    /// can see.
    pub(crate) busy: fn(u16) -> bool,
}

/// Result of a command.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outcome {
    /// Reply to the client.
    pub(crate) reply: Reply,
    /// Changes, for everybody who listens.
    pub(crate) events: Vec<NameEvent>,
    /// Connections to make and to end.
    pub(crate) links: Vec<Link>,
    /// Refusal of the command, if it was refused.
    pub(crate) refused: Option<Refusal>,
}

impl Outcome {
    fn reply(reply: Reply) -> Self {
        Self { reply, events: Vec::new(), links: Vec::new(), refused: None }
    }
}

/// A command without its first word.
struct Words<'a>(&'a [Value]);

impl Words<'_> {
    /// A word; the empty one where there is none, or something else.
    fn word(&self, index: usize) -> String {
        match self.0.get(index) {
            Some(value @ (Value::String(_) | Value::Vocab32(_) | Value::Vocab64(_))) => {
                stored(value)
            }
            _ => String::new(),
        }
    }

    /// Anything, as text.
    fn text(&self, index: usize) -> String {
        self.0.get(index).map(stored).unwrap_or_default()
    }

    fn has(&self, index: usize) -> bool {
        self.0.len() > index
    }
}

impl NameState {
    /// Knows only the name server itself.
    pub(crate) fn new(own: &Registration, discovery_port: u16, limits: NameServerLimits) -> Self {
        let subscriptions = Subscriptions::new(limits.max_subscriptions);
        Self { registry: Registry::new(own, discovery_port, limits), subscriptions }
    }

    /// Does what a line says.
    pub(crate) fn apply_text(&mut self, text: &[u8], asker: Asker, limits: &WireLimits) -> Outcome {
        match Bottle::from_text(text, limits) {
            Ok(command) => self.apply(&command, asker),
            Err(error) => Self::refuse(Refusal::Unreadable { reason: error.to_string() }, false),
        }
    }

    /// Does what a command says.
    pub(crate) fn apply(&mut self, command: &Bottle, asker: Asker) -> Outcome {
        let mut words = command.values.as_slice();
        let mut skip = |word: &str| match words.split_first() {
            Some((first, rest)) if first.is_word(word) => {
                words = rest;
                true
            }
            _ => false,
        };
        skip("NAME_SERVER");
        let bottle = skip("bot");
        let Some((verb, rest)) = words.split_first() else {
            return Outcome::reply(Reply::nothing());
        };
        let rest = Words(rest);
        match stored(verb).as_str() {
            "register" => self.register(&rest, asker, bottle),
            "unregister" => self.unregister(&rest.word(0), bottle),
            "query" => Outcome::reply(self.query(&rest.word(0), bottle)),
            "list" => {
                let prefix = rest.word(0);
                Outcome::reply(self.contacts(self.registry.names(&prefix), bottle))
            }
            "runners" => {
                let names = self.registry.names_with("yarprun", "true");
                Outcome::reply(self.contacts(names, bottle))
            }
            "set" => self.set(&rest, bottle),
            "get" => Outcome::reply(self.get(&rest.word(0), &rest.text(1), bottle)),
            "check" => Outcome::reply(self.check(&rest)),
            "route" => {
                let (from, to) = (rest.word(0), rest.word(1));
                let way = format!("tcp:/{to}");
                Outcome::reply(one_line(&["port", &from, "route", &to, "=", &way]))
            }
            "gc" => Outcome::reply(one_line(&["garbage collection done."])),
            "help" => Outcome::reply(help(bottle)),
            // Those below always answer with a bottle; `bot` does not know them.
            "announce" if !bottle => self.announce(&rest, asker),
            "subscribe" if !bottle => self.subscribe(&rest),
            "unsubscribe" if !bottle => {
                self.subscriptions.unsubscribe(&rest.word(0), &rest.word(1));
                Outcome::reply(Reply::ok())
            }
            "topic" if !bottle => self.topic(&rest),
            "untopic" if !bottle => {
                self.subscriptions.remove_topic(&rest.word(0));
                Outcome::reply(Reply::ok())
            }
            "type" if !bottle => self.type_of(&rest),
            _ => Outcome::reply(Reply::nothing()),
        }
    }

    /// Says that something was not done.
    pub(crate) fn refuse(refusal: Refusal, bottle: bool) -> Outcome {
        let reply = Reply::refused(&refusal, bottle);
        Outcome { refused: Some(refusal), ..Outcome::reply(reply) }
    }

    fn register(&mut self, words: &Words<'_>, asker: Asker, bottle: bool) -> Outcome {
        let wish = self.wish(words, asker);
        if let Err(refusal) = self.registry.check(&wish) {
            return Self::refuse(refusal, bottle);
        }
        // The program that registers a name has it: the port that had it before is not asked.
        let mut outcome = self.remove(&wish.name);
        match self.registry.register(wish, asker.busy) {
            Ok(contact) => {
                if contact.carrier != "mcast" {
                    outcome.events.push(NameEvent::Added(contact.name.clone()));
                }
                outcome.reply = if bottle {
                    // `bot register` answers in the old form, one line for each element.
                    Reply::Lines(reply::port(Some(&contact)).into_iter().map(element).collect())
                } else {
                    Reply::Lines(vec![reply::registration(&contact)])
                };
                outcome
            }
            Err(refusal) => Outcome {
                reply: Reply::refused(&refusal, bottle),
                refused: Some(refusal),
                ..outcome
            },
        }
    }

    /// `register NAME [CARRIER [IP [PORT [TYPE]]]]`.
    fn wish(&self, words: &Words<'_>, asker: Asker) -> Wish {
        let chosen = |index: usize| {
            let word = words.word(index);
            (words.has(index) && word != "...").then_some(word)
        };
        let own = &self.registry.own;
        let carrier = chosen(1).unwrap_or_else(|| "tcp".to_owned());
        let topic = carrier == "topic";
        let host = chosen(2).unwrap_or_else(|| match asker.address {
            _ if carrier == "mcast" => "...".to_owned(),
            _ if topic => own.host.clone(),
            Some(address) => address.to_canonical().to_string(),
            None => "localhost".to_owned(),
        });
        let port = match words.0.get(3) {
            None if topic => i64::from(own.port),
            // The type of a port comes with the number -1, which means any.
            // Saturates; what is no port is refused.
            Some(Value::Float64(number)) => *number as i64,
            other => other.and_then(Value::as_i64).unwrap_or(-1),
        };
        let kind = words.has(4).then(|| words.word(4)).filter(|kind| kind != "*");
        Wish { name: words.word(0), carrier, host, port, kind }
    }

    fn unregister(&mut self, name: &str, bottle: bool) -> Outcome {
        if name == self.registry.own.name {
            return Self::refuse(Refusal::Own { name: name.to_owned() }, bottle);
        }
        let mut outcome = self.remove(name);
        if bottle && let Reply::Lines(lines) = &mut outcome.reply {
            lines.extend(reply::port(None).into_iter().map(element));
        }
        outcome
    }

    /// Forgets a port and those it owns. For each of the latter the reply has a line `old`:
    /// `scenario_mcast.json`.
    fn remove(&mut self, name: &str) -> Outcome {
        let mut outcome = Outcome::reply(Reply::nothing());
        let mut waiting = vec![name.to_owned()];
        let mut lines = Vec::new();
        while let Some(name) = waiting.pop() {
            if name == self.registry.own.name {
                continue;
            }
            outcome.links.extend(self.subscriptions.depart(&name, &self.registry));
            let contact = self.registry.find(&name, "");
            let Some(owned) = self.registry.remove(&name) else { continue };
            lines.extend(owned.iter().map(|_| b"old".to_vec()));
            if contact.is_some_and(|contact| contact.carrier != "mcast") {
                // Those it owns go first.
                outcome.events.insert(0, NameEvent::Removed(name));
            }
            waiting.extend(owned);
        }
        outcome.reply = Reply::Lines(lines);
        outcome
    }

    fn query(&self, name: &str, bottle: bool) -> Reply {
        let Target { network, name, .. } = Target::parse(name);
        let contact = self.registry.find(&name, &network);
        if bottle {
            return Reply::Bottle(reply::port(contact.as_ref()).into());
        }
        Reply::Lines(contact.iter().map(reply::registration).collect())
    }

    fn contacts<'a>(&self, names: impl Iterator<Item = &'a str>, bottle: bool) -> Reply {
        let contacts = names.filter_map(|name| self.registry.find(name, ""));
        if bottle {
            let ports = contacts.map(|contact| Bottle::from(reply::port(Some(&contact))).into());
            return Reply::Bottle([Value::from("ports")].into_iter().chain(ports).collect());
        }
        Reply::Lines(contacts.map(|contact| reply::registration(&contact)).collect())
    }

    fn set(&mut self, words: &Words<'_>, bottle: bool) -> Outcome {
        let (name, key) = (words.word(0), words.text(1));
        let values = words.0.iter().skip(2).map(stored).collect();
        match self.registry.set(&name, &key, values) {
            Ok(_) => Outcome::reply(self.get(&name, &key, bottle)),
            Err(refusal) => Self::refuse(refusal, bottle),
        }
    }

    fn get(&self, name: &str, key: &str, bottle: bool) -> Reply {
        let values = self.registry.property(name, key);
        if bottle {
            let values = values.unwrap_or_default();
            return Reply::Bottle(values.iter().map(|text| parsed(text)).collect());
        }
        let Some(values) = values else { return Reply::nothing() };
        let before = ["port", name, "property", key, "="];
        one_line(&before.into_iter().chain(values.iter().map(String::as_str)).collect::<Vec<_>>())
    }

    fn check(&self, words: &Words<'_>) -> Reply {
        let (name, key, value) = (words.word(0), words.text(1), words.text(2));
        let Some(values) = self.registry.property(&name, &key) else { return Reply::nothing() };
        let present = if values.contains(&value) { "true" } else { "false" };
        one_line(&["port", &name, "property", &key, "value", &value, "present", present])
    }

    fn announce(&mut self, words: &Words<'_>, asker: Asker) -> Outcome {
        let name = words.word(0);
        if matches!(words.0.get(1), Some(Value::Int32(0))) {
            self.subscriptions.verify(&name, asker.now);
            return Outcome::reply(Reply::ok());
        }
        linked(self.subscriptions.announce(&name, asker.now, &self.registry))
    }

    fn subscribe(&mut self, words: &Words<'_>) -> Outcome {
        let (src, dest) = (words.word(0), words.word(1));
        if !dest.is_empty() {
            let mode = words.word(2);
            return linked(self.subscriptions.subscribe(&src, &dest, &mode, &self.registry));
        }
        let pair = |key: &str, value: &str| Bottle::from(vec![key.into(), value.into()]).into();
        let entries = self.subscriptions.list(&src).map(|(kept, src_topic, dest_topic)| {
            let mut entry = Bottle::from(vec![
                "subscription".into(),
                pair("src", &kept.src_full),
                pair("dest", &kept.dest_full),
            ]);
            if !kept.mode.is_empty() {
                entry.values.push(pair("mode", &kept.mode));
            }
            if src_topic || dest_topic {
                let flags = [i32::from(src_topic), i32::from(dest_topic)].map(Value::from);
                entry.push(Bottle::from_iter([Value::from("topic")].into_iter().chain(flags)));
            }
            Value::from(entry)
        });
        let reply = [Value::from("subscriptions")].into_iter().chain(entries).collect();
        Outcome::reply(Reply::Bottle(reply))
    }

    fn topic(&mut self, words: &Words<'_>) -> Outcome {
        if words.has(0) {
            return linked(self.subscriptions.add_topic(&words.word(0), &self.registry));
        }
        let names = self.subscriptions.topics.iter().map(|name| name.as_str().into());
        Outcome::reply(Reply::Bottle(names.collect()))
    }

    fn type_of(&mut self, words: &Words<'_>) -> Outcome {
        let (family, name) = (words.word(0), words.word(1));
        match (family.as_str(), words.0.len()) {
            ("yarp", 3) => {
                linked(self.subscriptions.set_type(&name, &words.word(2)).map(|()| vec![]))
            }
            ("yarp", 2) => Outcome::reply(match self.subscriptions.type_of(&name) {
                Some(text) if !text.is_empty() => {
                    let words = ["type", &family, &name, text].map(Value::from);
                    Reply::Bottle(Bottle::from_iter(words))
                }
                _ => Reply::fail(),
            }),
            _ => Outcome::reply(Reply::fail()),
        }
    }
}

/// `[ok]`, and what is to be connected.
fn linked(result: Result<Vec<Link>, TooMany>) -> Outcome {
    match result {
        Ok(links) => Outcome { links, ..Outcome::reply(Reply::ok()) },
        Err(TooMany { limit }) => NameState::refuse(Refusal::Kept { limit }, true),
    }
}

fn one_line(words: &[&str]) -> Reply {
    Reply::Lines(vec![line(words.iter().map(|&word| word.into()).collect())])
}

/// An element of a bottle as a line of its own.
fn element(value: Value) -> Vec<u8> {
    match value {
        Value::List(list) => line(list.values),
        other => stored(&other).into_bytes(),
    }
}

/// A stored text as the value it was made from.
fn parsed(text: &str) -> Value {
    match Bottle::from_text(text.as_bytes(), &WireLimits::default()) {
        Ok(mut bottle) => match bottle.values.pop() {
            None => Value::from(""),
            Some(value) if bottle.is_empty() => value,
            Some(value) => {
                bottle.values.push(value);
                bottle.into()
            }
        },
        Err(_) => text.into(),
    }
}

/// Commands that the name server understands, as YARP lists them.
const HELP: [&str; 13] = [
    "+ help",
    "+ list [$prefix]",
    "+ register $portname",
    "+ register $portname $carrier $ipAddress $portNumber",
    "  (if you want a field set automatically, write '...')",
    "+ unregister $portname",
    "+ query $portname",
    "+ set $portname $property $value",
    "+ get $portname $property",
    "+ check $portname $property",
    "+ route $port1 $port2",
    "+ runners",
    "  (to get a list of the yarprun ports)",
];

fn help(bottle: bool) -> Reply {
    if bottle {
        return Reply::Bottle(HELP.into_iter().map(Value::from).collect());
    }
    let lines = ["Here are some ways to use the name server:"].into_iter().chain(HELP);
    Reply::Lines(lines.map(|text| text.as_bytes().to_vec()).collect())
}
