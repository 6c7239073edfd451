//! Services on the graph: requests and replies as CDR bytes, and what pairs them.
//!
//! ```text
//!   client                                              server
//!   CdrClient::send ─ request, sequence ─▶ rq/… ─────▶ CdrServer::take ─ request, RequestId
//!   CdrClient::take ◀─ reply, sequence ── rr/… ◀────── CdrServer::reply(RequestId, …)
//! ```
//!
//! DDS vendors differ in how a reply names its request ([`ServiceMapping`]); here it is a sequence
//! number for clients and a [`RequestId`] for servers. Bodies have no such header.

use std::time::Duration;

use bytes::Bytes;

use super::GraphError;

/// A service on the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceDescription {
    /// Absolute ROS name, for instance `/add_two_ints`.
    pub name: String,
    /// ROS type name, for instance `example_interfaces/srv/AddTwoInts`.
    pub type_name: String,
    /// REP-2016 hash of the type, where known: on Zenoh a part of the service's name.
    pub type_hash: Option<String>,
    /// REP-2016 hash of the type's `_Request`, where known: sent in USER_DATA.
    pub request_hash: Option<String>,
    /// REP-2016 hash of its `_Response`.
    pub response_hash: Option<String>,
    /// Requests and replies kept: 10 for services, 1000 for those of parameters.
    pub depth: u32,
    /// Requests and replies larger than this are dropped on reception before they are copied.
    pub max_bytes: usize,
}

/// Place of a request's identity on the wire, which differs between DDS vendors.
///
/// ```
/// # mod wrapyfi_core { pub mod middleware { pub mod ros2 { pub use wrapyfi_ros2::graph::ServiceMapping; } } }
/// use wrapyfi_core::middleware::ros2::ServiceMapping;
/// # use wrapyfi_ros2::environment;
/// # let fast = |name: &str| (name == "RMW_IMPLEMENTATION").then(|| "rmw_fastrtps_cpp".to_owned());
/// # assert_eq!(environment::read(fast)?.services, Some(ServiceMapping::FastDds));
/// assert_eq!(ServiceMapping::FastDds.rmw(), "rmw_fastrtps_cpp");
/// # Ok::<(), environment::EnvironmentError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ServiceMapping {
    /// `rmw_cyclonedds_cpp`: 16 bytes, client and sequence number, in front of the body.
    Cyclone,
    /// `rmw_fastrtps_cpp`: the related sample identity in inline QoS.
    FastDds,
}

impl ServiceMapping {
    /// Name of the RMW that speaks it, as in `RMW_IMPLEMENTATION`.
    pub fn rmw(self) -> &'static str {
        match self {
            Self::Cyclone => "rmw_cyclonedds_cpp",
            Self::FastDds => "rmw_fastrtps_cpp",
        }
    }

    /// The mapping that does not understand this one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Cyclone => Self::FastDds,
            Self::FastDds => Self::Cyclone,
        }
    }
}

/// Names a request among all requests to a server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct RequestId {
    /// Identity of the client: eight bytes of `rmw_cyclonedds_cpp`, then zeros; or a GUID of
    /// `rmw_fastrtps_cpp`.
    pub client: [u8; 16],
    /// The client's number for it.
    pub sequence: i64,
}

/// A request as its server takes it.
#[derive(Debug, Clone, PartialEq)]
pub struct CdrRequest {
    /// Identity of the request, for [`CdrServer::reply`].
    pub id: RequestId,
    /// Encapsulation header and body, as of a message of the type's `_Request`.
    pub cdr: Bytes,
    /// Source timestamp in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
    /// Writer of the request and its number there, by which it is known where both of a node's stacks have received it.
    pub sample: Option<([u8; 16], i64)>,
}

/// A reply as its client takes it.
#[derive(Debug, Clone, PartialEq)]
pub struct CdrReply {
    /// Sequence number that [`CdrClient::send`] returned for the request.
    pub sequence: i64,
    /// Encapsulation header and body, as of a message of the type's `_Response`.
    pub cdr: Bytes,
    /// Source timestamp in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
}

/// Readiness of the other end of a service: a request that is sent before is lost.
///
/// ```
/// use wrapyfi_ros2::{ParameterClient, graph::Peers};
/// fn is_there(talker: &ParameterClient) -> bool {
///     matches!(talker.servers(), Peers::Ready(_))
/// }
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Peers {
    /// No program has the other end.
    None,
    /// Discovery knows one half of the other end, requests or replies, or the other end has not yet
    /// confirmed that it hears us. The latter changes within moments, and no program is notified of it:
    /// see [`CdrClient::look_again`].
    Half,
    /// Number of peers that have both halves, and speak our mapping as far as their GUIDs tell.
    Ready(usize),
    /// All that have the other end are of another vendor, whose requests and replies are not ours.
    Foreign(ServiceMapping),
}

/// Shortest time to the next look at things that no program is notified of: see
/// [`CdrClient::look_again`].
pub(crate) const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// Sends requests to one service.
pub trait CdrClient: Send {
    /// Sends a request, given in pieces that are concatenated: 4-byte encapsulation header first.
    /// Its sequence number.
    ///
    /// # Errors
    /// The request was not sent.
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError>;

    /// The next reply to a request of this client, if one waits. Replies to other clients are
    /// passed over.
    ///
    /// # Errors
    /// The next reply was unusable: [`GraphError::TooLarge`], [`GraphError::NoIdentity`]. It is
    /// gone, the one after it can be taken.
    fn take(&mut self) -> Result<Option<CdrReply>, GraphError>;

    /// Identity by which servers know the request of this number.
    fn id_of(&self, sequence: i64) -> RequestId;

    /// Servers there are now.
    fn servers(&self) -> Peers;

    /// Time until [`CdrClient::servers`] is looked at again though nothing is notified: a matched
    /// server had not confirmed yet that it hears. `None` while only a match, which is notified, can
    /// change what it said.
    fn look_again(&self) -> Option<Duration> {
        None
    }
}

/// Answers the requests to one service.
pub trait CdrServer: Send {
    /// The next request, if one waits.
    ///
    /// # Errors
    /// The next request was unusable: [`GraphError::TooLarge`], [`GraphError::NoIdentity`],
    /// [`GraphError::ForeignMapping`]. It is gone, the one after it can be taken.
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError>;

    /// True when the client of this request would hear a reply now; until then a reply is lost.
    /// True also when that cannot be known. The answer changes with matches, which are notified,
    /// and within moments after them: see [`CdrServer::look_again`].
    fn hears(&self, id: &RequestId) -> bool {
        _ = id;
        true
    }

    /// Tells of a client, by the writer of its requests: this one came another way than by [`CdrServer::take`].
    fn note_client(&mut self, id: &RequestId, writer: &[u8; 16]) {
        _ = (id, writer);
    }

    /// As [`CdrClient::look_again`], for [`CdrServer::hears`].
    fn look_again(&self) -> Option<Duration> {
        None
    }

    /// Answers a request, with the reply in pieces as [`CdrClient::send`] takes them.
    ///
    /// # Errors
    /// The reply was not sent.
    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> Result<(), GraphError>;

    /// Clients there are now.
    fn clients(&self) -> Peers;

    /// Requests lost before they could be taken, since the last call.
    fn lost(&mut self) -> u64 {
        0
    }
}
