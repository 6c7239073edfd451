//! Dialect and format of a request, which its reply takes on.
//!
//! ```text
//!   a float in the request            ─▶ its size: YARP 3 or YARP 4
//!   none, but one in the reply        ─▶ what this client wrote before, or its port told after the first
//!                                        reply; that one is of the name server's dialect
//!   one string that begins with "["   ─▶ a call of Wrapyfi: JSON
//! ```
//!
//! The other way round a server is asked before the first request with a float ([`ask`]).

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::OnceCell;
use wrapyfi_yarp::port::{Network, Received};
use wrapyfi_yarp::{Bottle, Dialect};

use super::options::{BottleFormat, YarpOptions};
use wrapyfi_endpoint::Mutex;
use wrapyfi_endpoint::codec::EncodeResult;
use wrapyfi_yarp::task::erased;

/// Most clients whose dialect is remembered.
const MOST: usize = 256;
/// Longest time that a port may take to tell its dialect.
const TIMEOUT: Duration = Duration::from_secs(1);
/// The beginning of a bottle that holds one string, before its length.
const ONE_STRING: [u8; 8] = [4, 1, 0, 0, 1, 0, 0, 0];
/// Bytes before the text of that string.
const BEFORE_TEXT: usize = 12;

/// A message in the dialect of its reader, as far as that is known, and in the other one where its floats differ
/// and the reader may have that.
pub(super) struct InDialects {
    pub(super) usual: Bytes,
    pub(super) other: Option<Bytes>,
}

impl InDialects {
    /// Writes a message in `dialect`, and in the other one unless the reader is known to have `dialect` or both
    /// are alike.
    pub(super) fn of(
        dialect: Dialect,
        reader_is_known: bool,
        write: impl Fn(Dialect) -> EncodeResult<Bytes>,
    ) -> EncodeResult<Self> {
        let usual = write(dialect)?;
        // What only one dialect has a form for is written in that one.
        let other = if reader_is_known { None } else { write(dialect.other()).ok() };
        Ok(Self { other: other.filter(|other| *other != usual), usual })
    }
}

/// The dialects of the clients of one port.
pub(super) struct ClientDialects {
    network: Network,
    /// The name server's port, where it may tell how those read that show nothing.
    name_server: Option<String>,
    usual: OnceCell<Dialect>,
    known: Mutex<HashMap<Arc<str>, Dialect>>,
}

impl ClientDialects {
    pub(super) fn new(network: Network, name_server: &str, options: &YarpOptions) -> Self {
        let is_set = options.dialect.is_some() || network.dialect() != Dialect::default();
        let name_server = (!is_set).then(|| name_server.to_owned());
        Self { network, name_server, usual: OnceCell::new(), known: Mutex::default() }
    }

    /// The dialect of a request, as far as it can be told by now.
    pub(super) fn dialect(&self, received: &Received) -> Option<Dialect> {
        if received.is_text {
            return Some(self.network.dialect());
        }
        let client = client(&received.from, received.connection);
        let shown = dialect_of(&received.payload.bytes, self.network.limits());
        if let Some(dialect) = shown {
            self.learn(&client, dialect);
            return shown;
        }
        self.known(|known| known.get(&client).copied())
    }

    /// The dialect of clients that show none: what is set, else that of YARP's name server.
    pub(super) async fn usual(&self) -> Dialect {
        let Some(name_server) = &self.name_server else { return self.network.dialect() };
        *self.usual.get_or_init(|| async { ask(&self.network, name_server).await.0 }).await
    }

    /// A reply with floats goes to a client that has shown no dialect. Its port is asked behind that, for the
    /// next time: YARP's ports tell nothing while they wait for a reply.
    pub(super) fn written(self: &Arc<Self>, received: &Received, dialect: Dialect) {
        let name = Arc::clone(&received.from);
        let client = client(&name, received.connection);
        self.learn(&client, dialect);
        // The others of this name have been told of with the first one: no program can be asked.
        if client != name && !self.learn(&name, dialect) {
            return;
        }
        let clients = Arc::clone(self);
        tokio::spawn(erased(async move {
            let (told, has_told) = ask(&clients.network, &name).await;
            if has_told && told == dialect {
                return;
            }
            if has_told {
                clients.learn(&name, told);
            }
            let it = if has_told { "has others" } else { "does not tell which it has" };
            tracing::warn!(
                "{name} was answered with floats of dialect {dialect}, and {it}: set option dialect"
            );
        }));
    }

    /// Notes the dialect of a client; true when none was known.
    fn learn(&self, client: &Arc<str>, dialect: Dialect) -> bool {
        self.known(|known| {
            if known.len() >= MOST && !known.contains_key(client) {
                known.clear();
            }
            known.insert(Arc::clone(client), dialect).is_none()
        })
    }

    fn known<T>(&self, look: impl FnOnce(&mut HashMap<Arc<str>, Dialect>) -> T) -> T {
        look(&mut self.known.lock())
    }
}

/// Key of the client that sent a request: its port's name, or name and connection for YARP's tools,
/// which are all called `anon_rpc`.
fn client(name: &Arc<str>, connection: u64) -> Arc<str> {
    if name.starts_with('/') { Arc::clone(name) } else { format!("{name} {connection}").into() }
}

/// Asks a port for its dialect; that of the network where it does not tell. True if it has told.
pub(super) async fn ask(network: &Network, name: &str) -> (Dialect, bool) {
    match tokio::time::timeout(TIMEOUT, network.probe_dialect(name)).await {
        Ok(Ok(dialect)) => (dialect, true),
        _ => (network.dialect(), false),
    }
}

/// The one dialect in which `bytes` are a bottle; none where they are one in both, or in neither.
fn dialect_of(bytes: &[u8], limits: &wrapyfi_yarp::WireLimits) -> Option<Dialect> {
    let is_whole = |dialect| Bottle::is_whole(bytes, dialect, limits);
    match (is_whole(Dialect::V3), is_whole(Dialect::V4)) {
        (true, false) => Some(Dialect::V3),
        (false, true) => Some(Dialect::V4),
        _ => None,
    }
}

/// BottleFormat of a request: JSON from Wrapyfi, else a bottle.
pub(super) fn format(bytes: &[u8]) -> BottleFormat {
    let text = bytes.strip_prefix(&ONE_STRING).and_then(|_| bytes.get(BEFORE_TEXT..));
    match text {
        Some(text) if text.trim_ascii_start().starts_with(b"[") => BottleFormat::Json,
        _ => BottleFormat::Bottle,
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_yarp::port::NetworkOptions;

    use super::*;

    fn bytes(text: &str, dialect: Dialect) -> Vec<u8> {
        let bottle =
            Bottle::from_text(text.as_bytes(), &wrapyfi_yarp::WireLimits::default()).unwrap();
        bottle.encode(dialect).unwrap()
    }

    #[test]
    fn a_float_shows_who_wrote_it() {
        let limits = wrapyfi_yarp::WireLimits::default();
        for text in ["[set] [pos] 2 10.5", "1.5", "(1.5 2) word", "1.5 2.5 3.5"] {
            for dialect in [Dialect::V3, Dialect::V4] {
                assert_eq!(dialect_of(&bytes(text, dialect), &limits), Some(dialect), "{text}");
            }
        }
        for text in ["[get] [enc] 0", "", "word"] {
            assert_eq!(dialect_of(&bytes(text, Dialect::V3), &limits), None, "{text}");
        }
    }

    #[test]
    fn tools_of_one_name_are_several_clients() {
        let (tool, port): (Arc<str>, Arc<str>) = ("anon_rpc".into(), "/asker".into());
        let network = Network::new(NetworkOptions::default());
        let clients = ClientDialects::new(network, "/root", &YarpOptions::default());
        assert!(clients.learn(&client(&tool, 1), Dialect::V4));
        assert!(clients.learn(&client(&tool, 2), Dialect::V3), "another one");
        assert!(clients.learn(&client(&port, 3), Dialect::V4));
        assert!(!clients.learn(&client(&port, 4), Dialect::V4), "it has connected again");
    }

    #[test]
    fn calls_of_wrapyfi_are_one_string() {
        assert_eq!(format(&bytes("\"[[1], {}]\"", Dialect::V3)), BottleFormat::Json);
        for text in ["get enc 0", "help", "\"[[1], {}]\" 2", "", "[get]"] {
            assert_eq!(format(&bytes(text, Dialect::V3)), BottleFormat::Bottle, "{text}");
        }
    }
}
