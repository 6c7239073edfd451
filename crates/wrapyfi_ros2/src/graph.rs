//! The ROS 2 graph as the bridge sees it: CDR bytes and discovery facts, nothing else.
//!
//! ```text
//!   Ros2 (Middleware)  names, types, payload <-> CDR
//!        │
//!      Graph           this trait: one participant, one node
//!        │
//!      cyclone         CycloneDDS, inside the program
//!      rmw             the middleware of an installed ROS 2 (feature `rmw`)
//! ```

mod service;

use std::fmt::Display;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use wrapyfi_interfaces::Message;

use wrapyfi_endpoint::{AnnouncedQos, BridgeMark, Cause, Qos, Wake};
use wrapyfi_node::NodeName;

pub(crate) use service::LOOK_AGAIN;
pub use service::{
    CdrClient, CdrReply, CdrRequest, CdrServer, Peers, RequestId, ServiceDescription,
    ServiceMapping,
};

/// A topic on the graph.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicDescription {
    /// Absolute ROS name, for instance `/camera/image_raw`.
    pub name: String,
    /// ROS type name, for instance `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// REP-2016 hash as text (`RIHS01_…`), where known: sent in USER_DATA.
    pub type_hash: Option<String>,
    /// Quality of service.
    pub qos: Qos,
    /// Messages larger than this are dropped on reception before they are copied.
    pub max_bytes: usize,
    /// True where a reader hears what its own node publishes, which would have routes loop.
    pub hears_own: bool,
}

impl TopicDescription {
    /// Topic of a type that is known when this is built.
    pub(crate) fn of<M: Message>(name: &str, qos: Qos, max_bytes: usize) -> Self {
        let (type_name, type_hash) = (M::ROS_TYPE.to_owned(), Some(M::TYPE_HASH.to_owned()));
        let name = name.to_owned();
        Self { name, type_name, type_hash, qos, max_bytes, hears_own: false }
    }
}

/// Properties that only some writers have.
#[derive(Debug, Clone, Copy, Default)]
pub struct WriterTraits<'a> {
    /// Messages that a transient-local writer gives to readers that come later.
    pub replay: Replay,
    /// A mark, where there is room for it: a bridge made the writer by pattern.
    pub mark: Option<&'a BridgeMark>,
}

/// Messages that a transient-local writer gives to readers that come later.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Replay {
    /// History of the writer, as in ROS 2.
    #[default]
    History,
    /// Newest messages, at most so many, however long the history for present readers is.
    Newest(u32),
    /// Nothing. It is announced as durability `TRANSIENT`, which readers that ask for transient local
    /// take, and which no DDS stack keeps without a program of its own for that.
    Nothing,
}

/// A node on a ROS 2 graph: creates writers and readers of serialised messages.
pub trait Graph: Send + Sync {
    /// Name of the node that owns the endpoints.
    fn node(&self) -> &NodeName;

    /// The same graph for endpoints that stand for a node of another middleware: they are listed as that node's, which is
    /// on the graph while there are some. What it is asked for beside them is as of this node.
    ///
    /// # Errors
    /// When the stack refuses the name.
    fn for_other(&self, node: &NodeName) -> GraphResult<Arc<dyn Graph>>;

    /// Creates a writer and announces it.
    ///
    /// # Errors
    /// When the DDS stack refuses; the reason is its own.
    fn advertise(&self, topic: &TopicDescription, on_match: Notify) -> Created<dyn CdrWriter> {
        self.advertise_with(topic, WriterTraits::default(), on_match)
    }

    /// As [`Graph::advertise`], for a writer that is not as others are. A stack that cannot make one
    /// makes an ordinary one.
    ///
    /// # Errors
    /// As [`Graph::advertise`].
    fn advertise_with(
        &self,
        topic: &TopicDescription,
        traits: WriterTraits<'_>,
        on_match: Notify,
    ) -> Created<dyn CdrWriter>;

    /// Creates a reader and announces it. `on_data` is called from a DDS thread when samples or
    /// matches change, possibly before this returns.
    ///
    /// # Errors
    /// When the DDS stack refuses.
    fn subscribe(&self, topic: &TopicDescription, on_data: Notify) -> Created<dyn CdrReader>;

    /// The only form in which this node maps services to DDS; `None` where it has both.
    fn service_mapping(&self) -> Option<ServiceMapping>;

    /// Creates a client and announces it. `on_event` is called as in [`Graph::subscribe`].
    ///
    /// # Errors
    /// When the DDS stack refuses.
    fn client(&self, service: &ServiceDescription, on_event: Notify) -> Created<dyn CdrClient>;

    /// Creates a server and announces it. `on_event` is called as in [`Graph::subscribe`].
    ///
    /// # Errors
    /// When the DDS stack refuses.
    fn server(&self, service: &ServiceDescription, on_event: Notify) -> Created<dyn CdrServer> {
        self.server_marked(service, None, on_event)
    }

    /// As [`Graph::server`], with a mark as in [`WriterTraits::mark`].
    ///
    /// # Errors
    /// As [`Graph::server`].
    fn server_marked(
        &self,
        service: &ServiceDescription,
        mark: Option<&BridgeMark>,
        on_event: Notify,
    ) -> Created<dyn CdrServer>;

    /// The endpoints that exist now as far as discovery knows, those of this node included.
    ///
    /// # Errors
    /// When the DDS stack refuses.
    fn endpoints(&self) -> GraphResult<Vec<DiscoveredEndpoint>>;

    /// Number that grows with each change of the endpoints that other participants have, which is cheap to ask for; `None`
    /// where only [`Graph::endpoints`] tells.
    fn changes(&self) -> Option<u64> {
        None
    }

    /// First twelve bytes of the GUIDs of the other participants that are known now; `None` where only their endpoints are.
    fn participants(&self) -> Option<Vec<[u8; 12]>> {
        None
    }

    /// Begins to watch the endpoints that other participants have on a topic, given by its ROS name:
    /// publishers if `publishers`, else subscribers. `on_change` is called from a DDS thread when
    /// one comes, changes or goes, also for those that exist already, possibly before this returns.
    ///
    /// # Errors
    /// When the DDS stack refuses.
    fn watch(&self, topic: &str, publishers: bool, on_change: Notify) -> Created<dyn PeerWatch>;

    /// Begins to listen for what other participants say about their nodes.
    ///
    /// # Errors
    /// When the DDS stack refuses.
    fn nodes(&self) -> Created<dyn NodeWatch>;
}

/// Knows which node owns which endpoint, from `ros_discovery_info`. It knows more the longer it
/// listens.
pub trait NodeWatch: Send {
    /// Reads what has arrived; true where something had.
    fn update(&mut self) -> bool;

    /// Full name of the node that owns the endpoint, for instance `/robot/talker`.
    fn owner(&self, gid: &[u8; 16]) -> Option<&str>;
}

/// Knows the endpoints that other participants have on one side of a topic.
pub trait PeerWatch: Send + Sync {
    /// Endpoints of any type, in order of their GUIDs. Its cost grows with their number.
    fn peers(&self) -> Vec<DiscoveredEndpoint>;

    /// Grows whenever they change; cheap.
    fn changes(&self) -> u64;
}

/// Number of events of the quality of service of an endpoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct QosEvents {
    /// Deadlines that passed: those of publishers for a reader, its own for a writer.
    pub deadlines_missed: u64,
    /// A reader: publishers that were no longer alive. A writer: how often it was not alive in
    /// time.
    pub liveliness_lost: u64,
}

/// An endpoint somewhere on the graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DiscoveredEndpoint {
    /// True for a publisher.
    pub is_publisher: bool,
    /// ROS topic where it is one, else the DDS topic.
    pub topic: String,
    /// DDS topic.
    pub dds_topic: String,
    /// ROS type where it is one, else the DDS type.
    pub type_name: String,
    /// DDS type.
    pub dds_type: String,
    /// REP-2016 hash it announces.
    pub type_hash: Option<String>,
    /// DDS GUID.
    pub gid: [u8; 16],
    /// Quality of service that it announces.
    pub qos: AnnouncedQos,
    /// True for an endpoint of this participant.
    pub is_own: bool,
    /// The mark of a bridge that made it by pattern.
    pub mark: Option<BridgeMark>,
    /// Form in which its owner maps services to DDS, where that is known.
    pub service_mapping: Option<ServiceMapping>,
}

/// Waits until `condition` holds, looking whenever `wake` rings; false after `timeout`.
///
/// For tests and one-shot commands: `wake` is rung by the [`Notify`] of the endpoints concerned.
pub fn wait_until(wake: &Wake, timeout: Duration, mut condition: impl FnMut() -> bool) -> bool {
    let deadline = Instant::now() + timeout;
    // Changes without a ring, such as the list of endpoints, are looked for this often.
    let look = Duration::from_millis(20);
    loop {
        if condition() {
            return true;
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return false;
        }
        wake.wait(left.min(look));
    }
}

/// Called from a DDS thread. It must not block, and must not drop the endpoint it was given to.
pub type Notify = Arc<dyn Fn() + Send + Sync>;

/// A notification that rings `wake`.
pub(crate) fn ringing(wake: &Wake) -> Notify {
    let wake = wake.clone();
    Arc::new(move || wake.ring())
}

/// Writes serialised messages to one topic.
pub trait CdrWriter: Send {
    /// Writes one message, given in pieces that are concatenated: 4-byte encapsulation header
    /// first. One copy at most.
    ///
    /// # Errors
    /// The message was not sent: [`GraphError::Timeout`] when reliable readers did not keep up.
    fn write(&mut self, parts: &[&[u8]]) -> GraphResult<()>;

    /// Cause for which fewer messages go out than are given; `None` where all do.
    fn slowed(&self) -> Option<Cause> {
        None
    }

    /// Readers matched now.
    fn matched(&self) -> usize;

    /// Policy over which the last reader was refused (`reliability`, …), where one was.
    fn incompatible(&self) -> Option<&'static str>;

    /// Number of events since the last call; zeros where the stack does not report them.
    fn qos_events(&self) -> QosEvents {
        QosEvents::default()
    }
}

/// Takes serialised messages of one topic.
pub trait CdrReader: Send {
    /// The next sample, if one waits.
    ///
    /// # Errors
    /// [`GraphError::TooLarge`] when the next sample was over the limit; it is gone, the one after
    /// it can be taken.
    fn take(&mut self) -> GraphResult<Option<CdrSample>>;

    /// Writers matched now.
    fn matched(&self) -> usize;

    /// Numbers of the matched writers, as [`CdrSample::publisher`] has them; `None` where the stack
    /// does not tell.
    fn publishers(&self) -> Option<Vec<u64>> {
        None
    }

    /// The GUID of one of them.
    fn publisher_gid(&self, publisher: u64) -> Option<[u8; 16]> {
        _ = publisher;
        None
    }

    /// Samples lost or rejected before they could be taken, since the last call.
    fn lost(&mut self) -> u64;

    /// Policy over which the last writer was refused (`reliability`, …), where one was.
    fn incompatible(&self) -> Option<&'static str>;

    /// Number of events since the last call; zeros where the stack does not report them.
    fn qos_events(&self) -> QosEvents {
        QosEvents::default()
    }
}

/// A received serialised message.
#[derive(Debug, Clone, PartialEq)]
pub struct CdrSample {
    /// Encapsulation header and body; shares the DDS stack's buffer.
    pub cdr: Bytes,
    /// Source timestamp in nanoseconds since 1970.
    pub source_timestamp_ns: i64,
    /// Stands for the publisher's GUID while it exists, and is the same for every reader of the
    /// node; 0 where the stack does not tell.
    pub publisher: u64,
}

/// Error of a DDS stack.
///
/// ```
/// use wrapyfi_ros2::graph::GraphError;
/// let error = GraphError::Timeout { topic: "/map".into(), timeout_ms: 1000 };
/// assert_eq!(error.to_string(), "reliable readers of \"/map\" did not keep up within 1000 ms");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GraphError {
    /// A sample larger than the topic allows arrived and was dropped.
    #[error(
        "sample of {actual} bytes on {topic:?} is over the limit of {limit} bytes (raise max_message_mib)"
    )]
    TooLarge {
        /// Topic.
        topic: String,
        /// Size in bytes.
        actual: usize,
        /// Limit in bytes.
        limit: usize,
    },
    /// A reliable reader did not acknowledge in time.
    #[error("reliable readers of {topic:?} did not keep up within {timeout_ms} ms")]
    Timeout {
        /// Topic.
        topic: String,
        /// Time waited.
        timeout_ms: u64,
    },
    /// A request or a reply does not say which request it is.
    #[error("{what} of {actual} bytes on {service:?} has no identity of at least {least} bytes")]
    NoIdentity {
        /// `request` or `reply`.
        what: &'static str,
        /// Service.
        service: String,
        /// Size in bytes, encapsulation header included.
        actual: usize,
        /// Bytes that the identity takes with the encapsulation header.
        least: usize,
    },
    /// A request came from a program whose RMW writes it in another way: its fields would be read
    /// wrongly, and its client would not understand the reply.
    #[error(
        "a request on {service:?} came from {} while this node speaks {}: set RMW_IMPLEMENTATION={} there, or {} here",
        theirs.rmw(), ours.rmw(), ours.rmw(), theirs.rmw()
    )]
    ForeignMapping {
        /// Service.
        service: String,
        /// Mapping of this node.
        ours: ServiceMapping,
        /// Mapping of the client.
        theirs: ServiceMapping,
    },
    /// The stack's own error.
    #[error("{operation} failed on {topic:?}: {reason}")]
    Stack {
        /// Call that failed.
        operation: &'static str,
        /// Topic, or the node for its own entities.
        topic: String,
        /// The stack's words and code.
        reason: String,
    },
}

impl GraphError {
    /// Error of the stack's own, in its words.
    pub(crate) fn stack(operation: &'static str, topic: &str, reason: &dyn Display) -> Self {
        Self::Stack { operation, topic: topic.to_owned(), reason: reason.to_string() }
    }
}

/// Result of a DDS stack.
pub type GraphResult<T> = Result<T, GraphError>;

/// Result of creating an endpoint whose type only its stack knows.
pub type Created<T> = GraphResult<Box<T>>;
