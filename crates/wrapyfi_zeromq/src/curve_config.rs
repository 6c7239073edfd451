//! Settings of CURVE, and the faults that they can have.

use std::path::PathBuf;

use serde::Deserialize;

use super::curve::Keys;

/// Variable of [`CurveConfig::secret_key_file`].
pub(super) const SECRET_KEY_FILE: &str = "WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE";
/// Variable of [`CurveConfig::server_key`].
pub(super) const SERVER_KEY: &str = "WRAPYFI_ZEROMQ_CURVE_SERVER_KEY";

/// Keys of this process on ZeroMQ, and what other keys may do at a broker of ours.
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_zeromq as zeromq; } }
/// use wrapyfi_core::middleware::zeromq::{CurveClient, CurveConfig, ZeroMqConfig};
/// let camera = CurveClient {
///     key: "/etc/wrapyfi/camera.key".into(),
///     publish: vec!["/camera/.*".into()],
///     ..CurveClient::default()
/// };
/// let curve = CurveConfig {
///     secret_key_file: Some("/etc/wrapyfi/broker.key_secret".into()),
///     clients: Some(vec![camera, CurveClient::of_all("/etc/wrapyfi/operator.key")]),
///     ..CurveConfig::default()
/// };
/// let config = ZeroMqConfig { curve: Some(curve), ..ZeroMqConfig::default() };
/// assert!(!config.curve.unwrap().clients.unwrap()[0].call);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CurveConfig {
    /// File with the secret key of this process, which no other program may read
    /// (`WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE`): a certificate of pyzmq, or a line of 40 characters. None: a key of
    /// its own for each start, with which no broker can run here.
    pub secret_key_file: Option<PathBuf>,
    /// Public key of the broker, 40 characters, or a file with it (`WRAPYFI_ZEROMQ_CURVE_SERVER_KEY`). None: the
    /// broker has the key of this process.
    pub server_key: Option<String>,
    /// Clients that a broker of ours takes. None: every client that knows the broker's public key.
    pub clients: Option<Vec<CurveClient>>,
}

impl CurveConfig {
    /// Reads the keys, as ZeroMQ does when it starts, in a process that runs a broker where `serves` is true.
    ///
    /// # Errors
    /// The fault with which it would not start.
    #[doc(hidden)]
    pub fn check(&self, serves: bool) -> Result<(), CurveError> {
        Keys::load(self, serves, None).map(drop)
    }

    /// True where the broker has another key than this process, which then cannot be the broker.
    pub fn is_elsewhere(&self) -> bool {
        let keys = || Keys::load(self, false, None);
        self.server_key.is_some() && keys().is_ok_and(|keys| keys.is_of_another())
    }
}

/// A client that a broker takes.
///
/// See [`CurveConfig`].
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub use wrapyfi_zeromq as zeromq; } }
/// use wrapyfi_core::middleware::zeromq::CurveClient;
/// let viewer = CurveClient {
///     key: "/etc/wrapyfi/viewer.key".into(),
///     subscribe: vec!["/camera/.*".into()],
///     ..CurveClient::default()
/// };
/// assert!(!viewer.call && viewer.publish.is_empty());
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurveClient {
    /// Public key, 40 characters, or a file with it.
    pub key: String,
    /// Topics that it may publish: regular expressions for whole names.
    #[serde(default)]
    pub publish: Vec<String>,
    /// Topics that it may listen to, likewise.
    #[serde(default)]
    pub subscribe: Vec<String>,
    /// True where it may call the service.
    #[serde(default)]
    pub call: bool,
    /// True where it may serve it.
    #[serde(default)]
    pub serve: bool,
}

impl CurveClient {
    /// A client that may use all topics and the service.
    pub fn of_all(key: &str) -> Self {
        let all = vec![".*".to_owned()];
        Self { key: key.to_owned(), publish: all.clone(), subscribe: all, call: true, serve: true }
    }
}

/// Error of the keys of CURVE.
///
/// ```
/// use wrapyfi_zeromq::CurveConfig;
/// let file = Some("/nowhere/broker.key_secret".into());
/// let error = CurveConfig { secret_key_file: file, ..CurveConfig::default() }.check(true).unwrap_err();
/// let expected = match cfg!(feature = "curve") {
///     true => "the CURVE key file /nowhere/broker.key_secret cannot be read: ",
///     false => "this program was built without CURVE: ",
/// };
/// assert!(error.to_string().starts_with(expected), "{error}");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CurveError {
    /// The program has no CURVE.
    #[error("this program was built without CURVE: build it with the feature `curve`")]
    NotBuilt,
    /// A file of a key cannot be read.
    #[error("the CURVE key file {} cannot be read: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Message of the system.
        reason: String,
    },
    /// Others could read the secret key.
    #[error(
        "the CURVE secret key {path} can be read by others (mode {mode:03o}): chmod 600 {path}",
        path = path.display()
    )]
    OpenToOthers {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file has no key.
    #[error(
        "{} has no {what} key: neither a line of 40 characters (Z85) nor a certificate of pyzmq with `{what}-key`",
        path.display()
    )]
    NoKey {
        /// The file.
        path: PathBuf,
        /// Kind of the key: public or secret.
        what: &'static str,
    },
    /// A text is no key, and no file.
    #[error(
        "{text:?} is no CURVE public key (40 characters of Z85), and as a file it cannot be read: {reason}"
    )]
    BadKey {
        /// Text as configured.
        text: String,
        /// Message of the system.
        reason: String,
    },
    /// A topic of a client is no pattern.
    #[error("the topic {pattern:?} of the CURVE client {key} {reason}")]
    Pattern {
        /// Public key of the client.
        key: String,
        /// Pattern as configured.
        pattern: String,
        /// The rule that it breaks.
        reason: String,
    },
    /// An entry of `clients` has a fault.
    #[error("{fault}")]
    Client {
        /// Place of the entry in the list.
        index: usize,
        /// The fault.
        fault: Box<CurveError>,
    },
    /// A client is listed twice.
    #[error("the CURVE client {0} is listed twice: write all that it may in one entry")]
    Twice(String),
    /// A broker runs here, and has no key that stays.
    #[error(
        "CURVE is asked for and the broker runs here: name the file with its secret key, `secret_key_file` \
         (WRAPYFI_ZEROMQ_CURVE_SECRET_KEY_FILE); where the broker is another program, write `broker: foreign` \
         (WRAPYFI_ZEROMQ_START_PROXY_BROKER=False)"
    )]
    NoSecretKey,
    /// The broker that would run here has another key than clients are told.
    #[error(
        "`server_key` ({server}) is not the public key of `secret_key_file` ({own}), which the broker here has: leave \
         `server_key` out (WRAPYFI_ZEROMQ_CURVE_SERVER_KEY), or have no broker here: `broker: foreign`, \
         WRAPYFI_ZEROMQ_START_PROXY_BROKER=False"
    )]
    OtherServer {
        /// Public key that is configured.
        server: String,
        /// Public key of this process.
        own: String,
    },
    /// The system gives no random numbers.
    #[error("the system gives no random numbers for CURVE")]
    NoRandom,
}

impl CurveError {
    /// Variable that has the fault, where no file has it.
    pub fn variable(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } | Self::OpenToOthers { .. } => SECRET_KEY_FILE,
            Self::NoKey { what: "secret", .. } => SECRET_KEY_FILE,
            _ => SERVER_KEY,
        }
    }
}
