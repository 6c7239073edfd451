//! Resolution of port names to addresses: the seam to a name server.
//!
//! ```text
//!   ports ──register, announce, query, unregister──▶ dyn Names ◀── client of a real name server
//! ```

use std::pin::Pin;

use crate::name::NameError;

/// A future in a box: what lets [`Names`] be an object.
pub type Later<'a, T> = Pin<Box<dyn Future<Output = Result<T, NameError>> + Send + 'a>>;

/// Entry of a port at a name server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Registration {
    /// `/name`.
    pub name: String,
    /// Address or host.
    pub host: String,
    /// Number.
    pub port: u16,
    /// `tcp`, or `mcast` for groups.
    pub carrier: String,
}

/// Demands of a new registration.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NameRequest {
    /// `/name`, or `...` for one that the server chooses.
    pub name: String,
    /// `tcp` when `None`.
    pub carrier: Option<String>,
    /// The address that others reach it at; the server takes the one it sees when `None`.
    pub host: Option<String>,
    /// The number; the server chooses when `None`.
    pub port: Option<u16>,
}

/// A name server, as ports need it. Each call is one request, bounded in time by the type that implements
/// it.
pub trait Names: Send + Sync + 'static {
    /// Registers a name; one that exists is replaced.
    fn register<'a>(&'a self, request: &'a NameRequest) -> Later<'a, Registration>;

    /// The port of a name; `None` when it is unknown.
    fn query<'a>(&'a self, name: &'a str) -> Later<'a, Option<Registration>>;

    /// Forgets a name.
    fn unregister<'a>(&'a self, name: &'a str) -> Later<'a, ()>;

    /// Says that a port lives, or seems dead: makes persistent connections happen.
    fn announce<'a>(&'a self, name: &'a str, alive: bool) -> Later<'a, ()>;

    /// Sets a property of a name.
    fn set<'a>(&'a self, name: &'a str, key: &'a str, values: &'a [String]) -> Later<'a, ()>;

    /// The values of a property; none when there is none.
    fn get<'a>(&'a self, name: &'a str, key: &'a str) -> Later<'a, Vec<String>>;
}
