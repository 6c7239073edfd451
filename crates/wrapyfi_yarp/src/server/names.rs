//! The name server of this process, asked without a connection.

use std::net::IpAddr;
use std::sync::Arc;

use super::reply::Reply;
use super::shared::Shared;
use crate::Value;
use crate::port::names::{Later, NameRequest, Names, NamesError, Registration};

/// Asks a name server of this process: for ports that live beside it.
#[derive(Debug, Clone)]
pub struct ServerNames(pub(super) Arc<Shared>);

impl ServerNames {
    fn done(&self, words: Vec<Value>) -> Result<Reply, NamesError> {
        let address: Option<IpAddr> = self.0.own.host.parse().ok();
        let outcome = self.0.apply(&words.into(), address);
        match outcome.refused {
            Some(refusal) => Err(NamesError::Refused(refusal.to_string())),
            None => Ok(outcome.reply),
        }
    }

    fn unit(&self, words: Vec<Value>) -> Later<'_, ()> {
        let done = self.done(words).map(|_| ());
        Box::pin(async { done })
    }
}

fn found(reply: &Reply) -> Option<Registration> {
    match reply {
        Reply::Lines(lines) => crate::name::registration(lines.first()?),
        Reply::Bottle(_) => None,
    }
}

impl Names for ServerNames {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        let word = |word: &Option<String>| Value::from(word.as_deref().unwrap_or("..."));
        let port = request.port.map_or(Value::from(-1), |port| i32::from(port).into());
        let words = [
            "register".into(),
            request.name.as_str().into(),
            word(&request.carrier),
            word(&request.host),
            port,
        ];
        let kind = request.type_name.as_deref().map(Value::from);
        let done = self.done(words.into_iter().chain(kind).collect());
        Box::pin(async {
            let reply = done?;
            found(&reply).ok_or_else(|| NamesError::Nonsense(format!("{reply:?}")))
        })
    }

    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>> {
        let done = self.done(vec!["query".into(), name.into()]);
        Box::pin(async { Ok(found(&done?)) })
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        self.unit(vec!["unregister".into(), name.into()])
    }

    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()> {
        self.unit(vec!["announce".into(), name.into(), i32::from(alive).into()])
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        let values = values.iter().map(|value| value.as_str().into());
        self.unit(["set", name, key].map(Value::from).into_iter().chain(values).collect())
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        let values = self.0.state().registry.property(name, key).unwrap_or_default();
        Box::pin(async { Ok(values) })
    }

    fn list<'a>(&'a self, prefix: &'a str) -> Later<'a, Vec<Registration>> {
        let state = self.0.state();
        let names = state.registry.names(prefix);
        let ports = names.filter_map(|name| state.registry.find(name, "")).collect();
        Box::pin(async { Ok(ports) })
    }
}
