//! Keys of CURVE as files hold them, and what each may do at a broker.
//!
//! ```text
//!   secret_key_file ── mode 600? ── Z85 ──▶ Keys: secret, public, the broker's ──▶ Curve: one connection each
//!   clients ── key: topics ──▶ Grant ── may publish? may subscribe? ──▶ Peer
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;

use crypto_box::SecretKey;
use crypto_box::aead::OsRng;
use crypto_box::aead::rand_core::RngCore as _;
use zeroize::Zeroizing;

use super::Breach;
use crate::curve_config::{CurveClient, CurveConfig, CurveError};
use crate::traffic::{ASKS_FOR_COUNTS, TRAFFIC_TOPIC};
use crate::zmtp::Kind;
use wrapyfi_endpoint::pattern::NamePattern;

/// A key, secret or public.
pub(super) type Key = [u8; 32];

/// Largest file of a key, in bytes.
const MAX_FILE: u64 = 64 * 1024;
/// Digits of Z85.
const DIGITS: &[u8; 85] =
    b"0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#";

/// Keys of this process.
pub(crate) struct Keys {
    pub(super) secret: Zeroizing<Key>,
    pub(super) public: Key,
    /// Public key of the broker.
    pub(super) server: Key,
    /// True where the secret key is that of a file.
    is_kept: bool,
    /// Clients that a broker of ours takes; none: all.
    clients: Option<BTreeMap<Key, Arc<Grant>>>,
}

impl std::fmt::Debug for Keys {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Keys({})", z85(&self.public))
    }
}

/// Permissions of one client.
#[derive(Debug)]
pub(crate) struct Grant {
    key: String,
    publish: Vec<NamePattern>,
    subscribe: Vec<NamePattern>,
    /// The entry as it is written.
    entry: CurveClient,
    /// Topic of the broker's own counts.
    own_topic: Option<String>,
}

impl Keys {
    /// Keys of a process that connects, and where `serves` is true those of its broker too.
    ///
    /// # Errors
    /// When a file cannot be read or has no key, or others could read the secret one.
    pub(crate) fn load(
        config: &CurveConfig,
        serves: bool,
        own_topic: Option<&str>,
    ) -> Result<Arc<Self>, CurveError> {
        // First, so that a text which is no key is told as that where a broker also lacks its own.
        let server = config.server_key.as_deref().map(public_key).transpose()?;
        let secret = match &config.secret_key_file {
            Some(path) => secret_key(path)?,
            None if serves => return Err(CurveError::NoSecretKey),
            None => random()?,
        };
        let public = *SecretKey::from(*secret).public_key().as_bytes();
        let server = server.unwrap_or(public);
        let is_kept = config.secret_key_file.is_some();
        let mut keys = Self { secret, public, server, is_kept, clients: None };
        if serves && keys.is_of_another() {
            let (server, own) = (z85(&server), z85(&public));
            return Err(CurveError::OtherServer { server, own });
        }
        if let Some(clients) = config.clients.as_ref().filter(|_| serves) {
            let mut grants = BTreeMap::new();
            for (index, client) in clients.iter().enumerate() {
                Grant::enter(client, own_topic, &mut grants)
                    .map_err(|fault| CurveError::Client { index, fault: Box::new(fault) })?;
            }
            keys.clients = Some(grants);
        }
        Ok(Arc::new(keys))
    }

    /// Public key of this process, as others write it down.
    pub(crate) fn public(&self) -> String {
        z85(&self.public)
    }

    /// True where the next start has the same key.
    pub(crate) fn is_kept(&self) -> bool {
        self.is_kept
    }

    /// True where the broker has the key of another process.
    pub(crate) fn is_of_another(&self) -> bool {
        self.server != self.public
    }

    /// True where only listed clients are taken.
    pub(crate) fn has_list(&self) -> bool {
        self.clients.is_some()
    }

    /// Entry of `clients` that has a key, written as 40 digits.
    pub(crate) fn entry(&self, key: &str) -> Option<&CurveClient> {
        let grant = self.clients.as_ref()?.get(&*decode(key)?)?;
        Some(&grant.entry)
    }

    /// Permissions of a client that connects to a socket of ours of this kind; none where it may everything, as this
    /// process itself may.
    pub(super) fn admit(&self, client: &Key, kind: Kind) -> Result<Option<Arc<Grant>>, Breach> {
        let Some(clients) = self.clients.as_ref().filter(|_| *client != self.public) else {
            return Ok(None);
        };
        let grant = clients.get(client).ok_or_else(|| Breach::Unknown(z85(client)))?;
        match kind {
            Kind::Router if !grant.entry.call => Err(Breach::NotAllowed(grant.key.clone(), "call")),
            Kind::Dealer if !grant.entry.serve => {
                Err(Breach::NotAllowed(grant.key.clone(), "serve"))
            }
            _ => Ok(Some(Arc::clone(grant))),
        }
    }
}

impl Grant {
    /// Reads an entry of `clients`.
    fn enter(
        entry: &CurveClient,
        own_topic: Option<&str>,
        grants: &mut BTreeMap<Key, Arc<Self>>,
    ) -> Result<(), CurveError> {
        let public = public_key(&entry.key)?;
        let key = z85(&public);
        let compiled = |written: &[String]| -> Result<Vec<NamePattern>, CurveError> {
            let one = |written: &String| {
                NamePattern::new(written).map_err(|reason| CurveError::Pattern {
                    key: key.clone(),
                    pattern: written.clone(),
                    reason,
                })
            };
            written.iter().map(one).collect()
        };
        let grant = Self {
            publish: compiled(&entry.publish)?,
            subscribe: compiled(&entry.subscribe)?,
            entry: entry.clone(),
            own_topic: own_topic.map(str::to_owned),
            key: key.clone(),
        };
        match grants.insert(public, Arc::new(grant)) {
            None => Ok(()),
            Some(_) => Err(CurveError::Twice(key)),
        }
    }

    /// Public key of the client.
    pub(crate) fn key(&self) -> &str {
        &self.key
    }

    pub(crate) fn may_publish(&self, topic: &[u8]) -> bool {
        matches(&self.publish, topic)
    }

    /// True for a topic that it may listen to. Counts of the broker are for all.
    pub(crate) fn may_subscribe(&self, topic: &[u8]) -> bool {
        let is_counts = topic == TRAFFIC_TOPIC.as_bytes()
            || topic.starts_with(ASKS_FOR_COUNTS.as_bytes())
            || self.own_topic.as_ref().is_some_and(|own| topic == own.as_bytes());
        is_counts || matches(&self.subscribe, topic)
    }
}

fn matches(patterns: &[NamePattern], topic: &[u8]) -> bool {
    let topic = std::str::from_utf8(topic);
    topic.is_ok_and(|topic| patterns.iter().any(|pattern| pattern.matches(topic)))
}

/// Random bytes of the system.
pub(super) fn random<const N: usize>() -> Result<Zeroizing<[u8; N]>, CurveError> {
    let mut bytes = Zeroizing::new([0; N]);
    OsRng.try_fill_bytes(&mut *bytes).map_err(|_opaque| CurveError::NoRandom)?;
    Ok(bytes)
}

fn secret_key(path: &Path) -> Result<Zeroizing<Key>, CurveError> {
    let file = File::open(path).map_err(|error| unreadable(path, &error))?;
    let mode = file.metadata().map_err(|error| unreadable(path, &error))?.permissions().mode();
    if mode & 0o077 != 0 {
        return Err(CurveError::OpenToOthers { path: path.to_owned(), mode: mode & 0o777 });
    }
    let text = read(file).map_err(|error| unreadable(path, &error))?;
    find(&text, "secret").ok_or_else(|| CurveError::NoKey { path: path.to_owned(), what: "secret" })
}

/// A public key, or the one in the file that the text names.
fn public_key(text: &str) -> Result<Key, CurveError> {
    if let Some(key) = decode(text.trim()) {
        return Ok(*key);
    }
    let path = Path::new(text);
    let read = File::open(path)
        .and_then(read)
        .map_err(|error| CurveError::BadKey { text: text.to_owned(), reason: error.to_string() })?;
    let key = find(&read, "public");
    key.map(|key| *key).ok_or_else(|| CurveError::NoKey { path: path.to_owned(), what: "public" })
}

fn unreadable(path: &Path, error: &std::io::Error) -> CurveError {
    CurveError::Unreadable { path: path.to_owned(), reason: error.to_string() }
}

fn read(file: File) -> std::io::Result<Zeroizing<String>> {
    let size = file.metadata()?.len().min(MAX_FILE);
    // With room for all of it: one that grows would leave copies behind.
    let mut text = Zeroizing::new(String::with_capacity(usize::try_from(size).unwrap_or(0) + 64));
    file.take(MAX_FILE).read_to_string(&mut text)?;
    Ok(text)
}

/// Key in a file: `secret-key = "…"` of a certificate, or a line that is nothing else.
fn find(text: &str, what: &str) -> Option<Zeroizing<Key>> {
    let mut alone = None;
    for line in text.lines().map(str::trim) {
        let value = line.strip_prefix(what).and_then(|rest| rest.strip_prefix("-key"));
        if let Some(value) = value.and_then(|rest| rest.trim_start().strip_prefix('=')) {
            return decode(value.trim().trim_matches(['"', '\'']));
        }
        if alone.is_none() {
            alone = decode(line);
        }
    }
    alone
}

/// Key of 40 digits of Z85.
fn decode(text: &str) -> Option<Zeroizing<Key>> {
    if text.len() != 40 {
        return None;
    }
    let mut key = Zeroizing::new([0; 32]);
    for (digits, bytes) in text.as_bytes().chunks_exact(5).zip(key.chunks_exact_mut(4)) {
        let mut value = 0_u64;
        for digit in digits {
            value = value * 85 + DIGITS.iter().position(|known| known == digit)? as u64;
        }
        bytes.copy_from_slice(&u32::try_from(value).ok()?.to_be_bytes());
    }
    Some(key)
}

/// Digits of Z85 for a public key.
fn z85(key: &Key) -> String {
    let mut text = String::with_capacity(40);
    for chunk in key.chunks_exact(4) {
        let value = chunk.iter().fold(0_usize, |value, byte| value << 8 | usize::from(*byte));
        for place in [85_usize.pow(4), 85_usize.pow(3), 85_usize.pow(2), 85, 1] {
            let digit = DIGITS.get(value / place % 85).copied();
            text.extend(digit.map(char::from));
        }
    }
    text
}

#[cfg(test)]
impl Keys {
    /// Keys from a number, and of the broker, where that is not this one.
    pub(super) fn of_test(number: u8, server: Option<&Self>) -> Arc<Self> {
        let secret = Zeroizing::new([number; 32]);
        let public = *SecretKey::from(*secret).public_key().as_bytes();
        let server = server.map_or(public, |server| server.public);
        Arc::new(Self { secret, public, server, is_kept: true, clients: None })
    }

    /// The same with the public key of another.
    pub(super) fn pretending(&self, other: &Self) -> Arc<Self> {
        let (secret, server) = (self.secret.clone(), self.server);
        Arc::new(Self { secret, public: other.public, server, is_kept: true, clients: None })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{BrokerMode, ZeroMqConfig};
    use std::io::Write as _;
    use std::path::PathBuf;

    /// Keys of the example in the specification of CURVE (libzmq's `zmq_curve`).
    const PUBLIC: &str = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7";
    const SECRET: &str = "JTKVSB%%)wK0E.X)V>+}o?pNmC{O&4W4b!Ni{Lh6";

    /// A file that ends with the test.
    struct Written(PathBuf);

    impl Written {
        fn new(text: &str, mode: u32) -> Self {
            let name: Zeroizing<[u8; 8]> = random().unwrap();
            let path = std::env::temp_dir().join(format!("key-{:x}", u64::from_be_bytes(*name)));
            File::create(&path).unwrap().write_all(text.as_bytes()).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            Self(path)
        }
    }

    impl Drop for Written {
        fn drop(&mut self) {
            _ = std::fs::remove_file(&self.0);
        }
    }

    fn config(file: &Written) -> CurveConfig {
        CurveConfig { secret_key_file: Some(file.0.clone()), ..CurveConfig::default() }
    }

    #[test]
    fn keys_are_read_from_certificates_and_lines() {
        let certificate = format!(
            "#   ****  Generated by pyzmq  ****\n\nmetadata\ncurve\n    public-key = \"{PUBLIC}\"\n    secret-key = \"{SECRET}\"\n"
        );
        for text in [certificate, format!("{SECRET}\n")] {
            let file = Written::new(&text, 0o600);
            let keys = Keys::load(&config(&file), true, None).unwrap();
            assert_eq!(keys.public(), PUBLIC);
            assert_eq!(keys.server, keys.public);
            assert!(!format!("{keys:?}").contains(SECRET));
        }
        let public = Written::new(&format!("curve\n public-key = \"{PUBLIC}\"\n"), 0o644);
        assert_eq!(public_key(public.0.to_str().unwrap()), public_key(PUBLIC));
    }

    #[test]
    fn a_secret_that_others_read_is_refused() {
        for mode in [0o644, 0o640, 0o604] {
            let file = Written::new(SECRET, mode);
            let error = Keys::load(&config(&file), true, None).unwrap_err();
            assert_eq!(error, CurveError::OpenToOthers { path: file.0.clone(), mode });
            let told = format!("chmod 600 {}", file.0.display());
            assert!(error.to_string().ends_with(&told), "{error}");
        }
    }

    #[test]
    fn what_is_no_key_is_named() {
        let file = Written::new("nothing\n", 0o600);
        assert!(matches!(Keys::load(&config(&file), true, None), Err(CurveError::NoKey { .. })));
        for text in ["", "short", "/nowhere/at/all", "§".repeat(20).as_str()] {
            assert!(matches!(public_key(text), Err(CurveError::BadKey { .. })), "{text}");
        }
        // More than four bytes hold.
        assert_eq!(decode(&"#".repeat(40)), None);
        let none = CurveConfig::default();
        assert_eq!(Keys::load(&none, true, None).unwrap_err(), CurveError::NoSecretKey);
        assert!(Keys::load(&none, false, None).is_ok(), "one of its own");
    }

    #[test]
    fn a_broker_runs_where_its_own_key_is_what_clients_are_told() {
        let file = Written::new(SECRET, 0o600);
        let said = |server_key: &str, broker_by_variable| {
            let server_key = Some(server_key.to_owned());
            let curve = Some(CurveConfig { server_key, ..CurveConfig::default() });
            let mut config = ZeroMqConfig { curve, broker_by_variable, ..ZeroMqConfig::default() };
            config.follow_keys();
            let before = config.broker;
            config.curve.as_mut().unwrap().secret_key_file = Some(file.0.clone());
            config.follow_keys();
            assert_eq!(config.service_broker, config.broker);
            (before, config.broker)
        };
        let (embedded, foreign) = (BrokerMode::Embedded, BrokerMode::Foreign);
        let other = PUBLIC.replace("rq:", "0q:");
        assert_eq!(said(PUBLIC, false), (foreign, embedded));
        assert_eq!(said(&other, false), (foreign, foreign));
        assert_eq!(said(&other, true), (embedded, embedded), "which then does not start");
    }

    #[test]
    fn a_client_may_what_its_entry_says() {
        let file = Written::new(SECRET, 0o600);
        let client = CurveClient {
            key: PUBLIC.replace("rq:", "0q:"),
            publish: vec!["/cmd".to_owned()],
            subscribe: vec!["/camera/(left|right)".to_owned()],
            call: true,
            serve: false,
        };
        let clients = Some(vec![client.clone()]);
        let keys = CurveConfig { clients, ..config(&file) };
        let keys = Keys::load(&keys, true, Some("ZEROMQ/CONNECTIONS")).unwrap();
        let key = public_key(&client.key).unwrap();
        let grant = keys.admit(&key, Kind::Xpub).unwrap().unwrap();
        assert!(grant.may_publish(b"/cmd") && !grant.may_publish(b"/cmd2"));
        assert!(grant.may_subscribe(b"/camera/left") && !grant.may_subscribe(b"/camera/"));
        assert!(grant.may_subscribe(b"ZEROMQ/CONNECTIONS") && !grant.may_subscribe(b""));
        assert!(!grant.may_publish(&[0xff]));
        assert!(keys.admit(&key, Kind::Router).is_ok());
        assert!(matches!(keys.admit(&key, Kind::Dealer), Err(Breach::NotAllowed(_, "serve"))));
        assert!(matches!(keys.admit(&[7; 32], Kind::Xpub), Err(Breach::Unknown(_))));
        assert!(keys.admit(&keys.public, Kind::Dealer).unwrap().is_none(), "this process itself");
        let twice = CurveConfig { clients: Some(vec![client.clone(), client]), ..config(&file) };
        let fault = Keys::load(&twice, true, None).unwrap_err();
        assert!(matches!(fault, CurveError::Client { index: 1, .. }), "{fault}");
        assert!(fault.to_string().ends_with("write all that it may in one entry"), "{fault}");
    }
}
