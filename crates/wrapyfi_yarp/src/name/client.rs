//! Requests to a name server.
//!
//! ```text
//!   NAME_SERVER query /cam\n ──▶          one line, answered by lines up to "*** end of message":
//!                                         query, register, unregister, list, set, announce
//!   CONNACK admin, d, subscribe … ──▶     over text_ack, answered by a bottle: subscribe, get, topics
//! ```
//!
//! Each request has a connection of its own, as in YARP, is given up after a time, and reads no more
//! than the limits allow: the program that answers at that address need not be a name server.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Semaphore;

use super::conf::NameServerConf;
use super::error::NameError;
use super::name_fault;
use super::reply;
use crate::port::link::{Link, LinkError, LinkOptions};
use crate::port::names::{Later, NameRequest, Names, Registration};
use crate::port::tools::contact;
use crate::wire::text::{AnswerReader, Lined};
use crate::wire::{Carrier, Command, Sender};
use crate::{Bottle, Dialect, Value, WireLimits};

/// Time for which YARP's own programs wait for a name server.
pub const DEFAULT_TIMEOUT: Duration = Duration::from_secs(10);

/// A connection that the name server makes whenever both ports are there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PersistentConnection {
    /// Sender, perhaps with a carrier.
    pub src: String,
    /// Receiver, perhaps with a carrier.
    pub dest: String,
}

/// Most requests at once. YARP's name server has room for five connections that wait; the program that finds none
/// tries again after a second.
const AT_ONCE: usize = 2;

/// Letters of an answer that an error shows.
const SHOWN: usize = 80;

/// The beginning of an answer.
fn beginning(answer: &[u8]) -> String {
    String::from_utf8_lossy(answer).chars().take(SHOWN).collect()
}

/// Asks one name server. Cheap to clone.
#[derive(Debug, Clone)]
pub struct NameClient(Arc<Settings>);

#[derive(Debug, Clone)]
struct Settings {
    server: NameServerConf,
    namespace: String,
    timeout: Duration,
    limits: WireLimits,
    hosts: BTreeMap<String, IpAddr>,
    room: Arc<Semaphore>,
}

impl NameClient {
    /// A client of the name server at this address, whose name is `/root`.
    pub fn new(server: NameServerConf) -> Self {
        Self(Arc::new(Settings {
            server,
            namespace: super::conf::DEFAULT_NAMESPACE.to_owned(),
            timeout: DEFAULT_TIMEOUT,
            limits: WireLimits::default(),
            hosts: BTreeMap::new(),
            room: Arc::new(Semaphore::new(AT_ONCE)),
        }))
    }

    /// The same with addresses of machines whose names the system need not know, that of the name
    /// server and those under which ports are registered.
    #[must_use]
    pub fn with_hosts(mut self, hosts: impl IntoIterator<Item = (String, IpAddr)>) -> Self {
        let settings = Arc::make_mut(&mut self.0);
        settings.hosts = hosts.into_iter().collect();
        let server = settings.hosts.get(&settings.server.host);
        if let Some(ip) = server {
            settings.server.host = ip.to_string();
        }
        self
    }

    /// The same for a name server of another name.
    #[must_use]
    pub fn with_namespace(mut self, namespace: impl Into<String>) -> Self {
        Arc::make_mut(&mut self.0).namespace = namespace.into();
        self
    }

    /// The same with another time that a request may take, connecting included.
    #[must_use]
    pub fn with_timeout(mut self, timeout: Duration) -> Self {
        Arc::make_mut(&mut self.0).timeout = timeout;
        self
    }

    /// The same with other limits of what an answer may be.
    #[must_use]
    pub fn with_limits(mut self, limits: WireLimits) -> Self {
        Arc::make_mut(&mut self.0).limits = limits;
        self
    }

    /// Address of the name server.
    pub fn server(&self) -> &NameServerConf {
        &self.0.server
    }

    /// The port name of the name server.
    pub fn namespace(&self) -> &str {
        &self.0.namespace
    }

    /// Limits of answers.
    pub fn limits(&self) -> &WireLimits {
        &self.0.limits
    }

    /// Host and port, as connections take them.
    pub(super) fn address(&self) -> String {
        contact(&self.0.server.host, self.0.server.port)
    }

    pub(super) fn link_options(&self) -> LinkOptions {
        LinkOptions {
            dialect: Dialect::default(),
            limits: self.0.limits.clone(),
            timeout: self.0.timeout,
            runtime_folder: None,
        }
    }

    /// A connection for more than one request.
    pub(super) async fn greet(&self, carrier: Carrier, name: &str) -> Result<Link, LinkError> {
        let (address, options) = (self.address(), self.link_options());
        Link::open(&address, carrier, &Sender::new(name), &[], &options).await
    }

    /// Does `work`, whose turn it is now or later, within the time allowed.
    pub(super) async fn in_time<T>(
        &self,
        work: impl Future<Output = Result<T, LinkError>>,
    ) -> Result<T, LinkError> {
        let limit = self.0.timeout;
        tokio::time::timeout(limit, work).await.unwrap_or(Err(LinkError::Timeout(limit)))
    }

    /// Makes one request in its turn.
    async fn request<T>(
        &self,
        command: &str,
        work: impl Future<Output = Result<T, LinkError>>,
    ) -> Result<T, NameError> {
        let done = self.in_time(async {
            let _turn = self.0.room.acquire().await;
            work.await
        });
        let (address, command) = (self.address(), beginning(command.as_bytes()));
        done.await.map_err(|source| NameError::NoAnswer { address, command, source })
    }

    /// Address of a port; `None` where the name server does not know it.
    ///
    /// # Errors
    /// As [`NameError`]; likewise below.
    pub async fn query(&self, name: &str) -> Result<Option<Registration>, NameError> {
        self.checked(name)?;
        let command = format!("query {name}");
        let answer = self.one_line(&command, "\n").await?;
        self.registration(&command, &answer)
    }

    /// Registers a port, which takes the name from the program that had it. One that the name server then tells for
    /// another number is forgotten and registered once more.
    pub async fn register(&self, request: &NameRequest) -> Result<Registration, NameError> {
        let is_there = |at: &Registration| request.port.is_none_or(|port| port == at.port);
        let at = self.register_once(request).await?;
        if is_there(&at) {
            return Ok(at);
        }
        self.unregister(&at.name).await?;
        let at = self.register_once(request).await?;
        let wanted = request.port.filter(|_| !is_there(&at));
        wanted.map_or(Ok(at.clone()), |wanted| Err(NameError::Elsewhere { at, wanted }))
    }

    async fn register_once(&self, request: &NameRequest) -> Result<Registration, NameError> {
        let command = self.register_command(request)?;
        // YARP's own ports end this line with both bytes, and the others with one.
        let answer = self.one_line(&command, "\r\n").await?;
        self.registration(&command, &answer)?.ok_or_else(|| self.refused(&command, &answer))
    }

    /// Forgets a port; one that is not known is no error.
    pub async fn unregister(&self, name: &str) -> Result<(), NameError> {
        self.checked(name)?;
        let command = format!("unregister {name}");
        let answer = self.one_line(&command, "\n").await?;
        match answer.lines.iter().find(|line| line.starts_with(b"refused")) {
            Some(_) => Err(self.refused(&command, &answer)),
            None => Ok(()),
        }
    }

    /// The ports whose names begin with these components; all for an empty prefix.
    pub async fn list(&self, prefix: &str) -> Result<Vec<Registration>, NameError> {
        let command = if prefix.is_empty() {
            "list".to_owned()
        } else {
            self.checked(
                prefix.strip_suffix('/').filter(|rest| !rest.is_empty()).unwrap_or(prefix),
            )?;
            format!("list {prefix}")
        };
        let answer = self.one_line(&command, "\n").await?;
        answer.lines.iter().map(|line| self.located(&command, line)).collect()
    }

    /// Sets a property of a port to these values, which the name server sorts. None where the port
    /// is not known.
    pub async fn set(
        &self,
        name: &str,
        key: &str,
        values: &[Value],
    ) -> Result<Option<Vec<String>>, NameError> {
        self.checked(name)?;
        let words = ["set", name, key].map(Value::from).into_iter().chain(values.iter().cloned());
        let words: Bottle = words.collect();
        let texts = words.values.into_iter().map(|value| match value {
            // Slashes need no quotes between blanks, and old name servers know none.
            Value::String(text) if plain(text.as_bytes()) => text.to_string_lossy().into_owned(),
            other => Bottle::from(vec![other]).to_text(),
        });
        let command = texts.collect::<Vec<_>>().join(" ");
        let answer = self.one_line(&command, "\r\n").await?;
        match answer.lines.first() {
            None => Ok(None),
            Some(line) => match reply::property(line, name, key) {
                Some(values) => Ok(Some(values)),
                None if line.starts_with(b"refused") => Err(self.refused(&command, &answer)),
                None => Err(self.nonsense(&command, line)),
            },
        }
    }

    /// The values of a property; empty where there is none, and where the port is not known.
    pub async fn get(&self, name: &str, key: &str) -> Result<Bottle, NameError> {
        self.checked(name)?;
        self.ask(["bot", "get", name, key].map(Value::from).into_iter().collect()).await
    }

    /// Says that a port is there, which makes persistent connections happen, or that it does not
    /// answer.
    pub async fn announce(&self, name: &str, alive: bool) -> Result<(), NameError> {
        self.checked(name)?;
        let command = format!("announce {name}{}", if alive { "" } else { " 0" });
        let answer = self.one_line(&command, "\n").await?;
        if &*answer.end == b"[ok]" { Ok(()) } else { Err(self.refused(&command, &answer)) }
    }

    /// Asks for a connection whenever both ports are there. The receiver may have a carrier before
    /// it: `tcp://view`.
    pub async fn subscribe(&self, src: &str, dest: &str) -> Result<(), NameError> {
        self.ok(["subscribe", src, dest]).await
    }

    /// Takes that back. A connection that exists stays.
    pub async fn unsubscribe(&self, src: &str, dest: &str) -> Result<(), NameError> {
        self.ok(["unsubscribe", src, dest]).await
    }

    /// The persistent connections, those of one port where a name is given.
    pub async fn subscriptions(
        &self,
        name: Option<&str>,
    ) -> Result<Vec<PersistentConnection>, NameError> {
        let request: Bottle = ["subscribe"].into_iter().chain(name).map(Value::from).collect();
        let command = request.to_text();
        let answer = self.ask(request).await?;
        let mut entries = answer.values.iter();
        if !entries.next().is_some_and(|first| first.is_word("subscriptions")) {
            return Err(self.nonsense(&command, &answer.to_text_bytes()));
        }
        let read = |entry: &Value| {
            let entry = entry.as_list()?;
            let text = |key: &str| entry.find(key).and_then(Value::as_str).map(str::to_owned);
            Some(PersistentConnection { src: text("src")?, dest: text("dest")? })
        };
        entries
            .map(|entry| {
                read(entry).ok_or_else(|| self.nonsense(&command, &answer.to_text_bytes()))
            })
            .collect()
    }

    /// Any command, as `yarp name` takes them, with its answer as a bottle.
    pub async fn ask(&self, request: Bottle) -> Result<Bottle, NameError> {
        let data = Command::Data { reply: true, envelope: None };
        let asked =
            async { self.greet(Carrier::TextAck, "admin").await?.ask(&data, &request).await };
        self.request(&request.to_text(), asked).await
    }

    async fn ok<'a>(&self, words: impl IntoIterator<Item = &'a str>) -> Result<(), NameError> {
        let request: Bottle = words.into_iter().map(Value::from).collect();
        for value in request.values.iter().skip(1).take(2) {
            self.checked(&super::Target::parse(value.as_str().unwrap_or_default()).name)?;
        }
        let command = request.to_text();
        let answer = self.ask(request).await?;
        match answer.get(0) {
            Some(first) if first.is_word("ok") => Ok(()),
            Some(first) if first.is_word("fail") => {
                Err(NameError::Refused { command, answer: answer.to_text() })
            }
            _ => Err(self.nonsense(&command, &answer.to_text_bytes())),
        }
    }

    /// One line, and the lines of its answer.
    async fn one_line(&self, command: &str, end: &str) -> Result<Lined, NameError> {
        let request = format!("NAME_SERVER {command}{end}");
        let asked = async {
            let (address, options) = (self.address(), self.link_options());
            let mut link = Link::connect(&address, Carrier::Text, &options).await?;
            link.write_raw(&[request.as_bytes()]).await?;
            let mut reader = AnswerReader::new(&options.limits, reply::is_end);
            link.poll(|buffer| reader.poll(buffer)).await
        };
        self.request(command, asked).await
    }

    fn registration(
        &self,
        command: &str,
        answer: &Lined,
    ) -> Result<Option<Registration>, NameError> {
        match answer.lines.first() {
            None if answer.end.starts_with(b"***") => Ok(None),
            None => Err(self.nonsense(command, &answer.end)),
            Some(line) if line.starts_with(b"refused") => Err(self.refused(command, answer)),
            Some(line) => self.located(command, line).map(Some),
        }
    }

    /// The registration that a line of an answer tells, at the address that its host has here.
    fn located(&self, command: &str, line: &bytes::Bytes) -> Result<Registration, NameError> {
        let mut at = reply::registration(line).ok_or_else(|| self.nonsense(command, line))?;
        if let Some(ip) = self.0.hosts.get(&at.host) {
            at.host = ip.to_string();
        }
        Ok(at)
    }

    /// The line that asks for it.
    fn register_command(&self, request: &NameRequest) -> Result<String, NameError> {
        let NameRequest { name, carrier, host, port } = request;
        // The name server completes these.
        self.checked(&match name.strip_prefix('=') {
            Some(tail) => format!("/{tail}"),
            None => name.clone(),
        })?;
        let mut command = format!("register {name}");
        let port = port.map(|port| port.to_string());
        let wanted = [carrier, host, &port];
        if wanted.iter().any(|word| word.is_some()) {
            for word in wanted.map(|word| word.as_deref().unwrap_or("...")) {
                if word.is_empty()
                    || word.contains(|letter: char| letter.is_whitespace() || letter == '"')
                {
                    let reason = format!("cannot be registered with {word:?}");
                    return Err(NameError::BadName { name: name.clone(), reason });
                }
                command.push(' ');
                command.push_str(word);
            }
        }
        Ok(command)
    }

    fn checked(&self, name: &str) -> Result<(), NameError> {
        let bad = |reason| NameError::BadName { name: beginning(name.as_bytes()), reason };
        name_fault(name, self.0.limits.max_name_bytes).map_or(Ok(()), |reason| Err(bad(reason)))
    }

    fn nonsense(&self, command: &str, answer: &[u8]) -> NameError {
        NameError::Nonsense {
            address: self.address(),
            command: command.to_owned(),
            answer: beginning(answer),
        }
    }

    fn refused(&self, command: &str, answer: &Lined) -> NameError {
        let line = answer.lines.first().unwrap_or(&answer.end);
        NameError::Refused { command: command.to_owned(), answer: beginning(line) }
    }
}

/// Ports ask their name server through this.
impl Names for NameClient {
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration> {
        Box::pin(Self::register(self, request))
    }

    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>> {
        Box::pin(Self::query(self, name))
    }

    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()> {
        Box::pin(Self::unregister(self, name))
    }

    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()> {
        Box::pin(Self::announce(self, name, alive))
    }

    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()> {
        Box::pin(async move {
            let values: Vec<_> = values.iter().map(|value| Value::from(value.as_str())).collect();
            Self::set(self, name, key, &values).await?;
            Ok(())
        })
    }

    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>> {
        Box::pin(async move {
            let values = Self::get(self, name, key).await?;
            let text = |value: Value| match value {
                Value::String(text) => text.to_string_lossy().into_owned(),
                other => Bottle::from(vec![other]).to_text(),
            };
            Ok(values.into_iter().map(text).collect())
        })
    }
}

/// True when a string can go between blanks as it is, and is read as a string again.
fn plain(text: &[u8]) -> bool {
    let word = |byte: &u8| byte.is_ascii_alphanumeric() || b"/_:-.+".contains(byte);
    text.iter().all(word)
        && text.first().is_some_and(|byte| byte.is_ascii_alphabetic() || *byte == b'/')
        && !matches!(text, b"true" | b"false" | b"null" | b"inf" | b"nan")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_wanted_is_left_to_the_name_server() {
        let client = NameClient::new(NameServerConf::default());
        let command = |request: &NameRequest| client.register_command(request).unwrap();
        let named = |name: &str| NameRequest { name: name.to_owned(), ..NameRequest::default() };
        assert_eq!(command(&named("/cam")), "register /cam");
        let placed =
            NameRequest { host: Some("127.0.0.1".into()), port: Some(10_444), ..named("/cam") };
        assert_eq!(command(&placed), "register /cam ... 127.0.0.1 10444");
        let group = NameRequest { carrier: Some("mcast".into()), ..named("...") };
        assert_eq!(command(&group), "register ... mcast ... ...");
    }
}
