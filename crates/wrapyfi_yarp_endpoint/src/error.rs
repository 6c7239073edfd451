//! Error of starting YARP.

use wrapyfi_endpoint::network::ReachedByOthers;
use wrapyfi_yarp::name::conf::ConfError;
use wrapyfi_yarp::server::NameServerError;

/// Error of starting YARP.
///
/// ```
/// use wrapyfi_yarp_endpoint::{Yarp, YarpConfig, YarpError};
/// let name_server = Some(std::net::SocketAddr::from(([192, 0, 2, 1], 10000)).into()); // another machine's address
/// let config = YarpConfig { name_server, embedded: true, ..YarpConfig::default() };
/// assert!(matches!(Yarp::start(&config), Err(YarpError::NotLoopback(_))));
/// ```
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum YarpError {
    /// No setting says where the name server is.
    #[error("no name server is known: {0}")]
    NameServer(#[from] ConfError),
    /// No name server runs, and ours cannot.
    #[error(transparent)]
    Embedded(#[from] NameServerError),
    /// The name server's machine has no address.
    #[error("name server: {0}")]
    Host(String),
    /// Other machines could reach our name server.
    #[error(transparent)]
    NotLoopback(#[from] ReachedByOthers),
    /// The system refused.
    #[error("YARP could not start: {0}")]
    Transport(String),
}

impl YarpError {
    /// True when no later try can succeed, because the settings are wrong.
    pub fn is_hopeless(&self) -> bool {
        match self {
            Self::NameServer(error) => !error.is_missing(),
            Self::NotLoopback(_) => true,
            Self::Embedded(error) => matches!(
                error,
                NameServerError::NotLoopback(_) | NameServerError::BadNamespace { .. }
            ),
            Self::Host(_) | Self::Transport(_) => false,
        }
    }
}
