//! Traits of every generated message and of every service.

use std::fmt::Debug;

use bytes::Bytes;

use crate::cdr::{CdrError, CdrParts, CdrReader, CdrValue, CdrWriter};
use crate::store::TypeStore;

/// A ROS 2 message.
///
/// ```
/// use wrapyfi_interfaces::{Message, std_msgs::msg::String as Text};
/// let cdr = Text { data: "hello".into() }.encode().to_bytes();
/// assert_eq!(Text::decode(&cdr, 1024).unwrap().data, "hello");
/// ```
pub trait Message: CdrValue + Clone + Debug + Default + PartialEq {
    /// ROS name, for instance `sensor_msgs/msg/Image`.
    const ROS_TYPE: &'static str;
    /// Name on DDS, for instance `sensor_msgs::msg::dds_::Image_`.
    const DDS_TYPE: &'static str;
    /// REP-2016 hash, `RIHS01_…`, computed from the definition at build time.
    const TYPE_HASH: &'static str;

    /// A store that has the definition of the type.
    fn types() -> TypeStore {
        TypeStore::generated()
    }

    /// The serialised message with its encapsulation header. Large `uint8[]` fields are shared.
    fn encode(&self) -> CdrParts {
        let mut writer = CdrWriter::new();
        self.write(&mut writer);
        writer.finish()
    }

    /// Reads a serialised message of at most `max_bytes` bytes. Its `uint8[]` fields share the
    /// memory of `cdr`. Bytes behind the last member are ignored: DDS pads there.
    ///
    /// # Errors
    /// When `cdr` is too large, not plain CDR, or not a message of this type.
    fn decode(cdr: &Bytes, max_bytes: usize) -> Result<Self, CdrError> {
        Self::read(&mut CdrReader::within(cdr, max_bytes)?)
    }
}

/// A generated message as a value: its name, its hash and its definition.
#[derive(Debug, Clone, Copy)]
pub struct GeneratedType {
    /// ROS name, for instance `sensor_msgs/msg/Image`.
    pub name: &'static str,
    /// REP-2016 hash, where it is known before the program runs.
    pub hash: Option<&'static str>,
    types: fn() -> TypeStore,
}

impl GeneratedType {
    /// Type of a message.
    pub const fn of<M: Message>() -> Self {
        Self { name: M::ROS_TYPE, hash: Some(M::TYPE_HASH), types: M::types }
    }

    /// Type of a message that another generator wrote, whose definition is the one in `types`.
    pub const fn foreign(name: &'static str, types: fn() -> TypeStore) -> Self {
        Self { name, hash: None, types }
    }

    /// A store that has its definition.
    pub fn types(&self) -> TypeStore {
        (self.types)()
    }
}

/// Types of one name and hash are one.
impl PartialEq for GeneratedType {
    fn eq(&self, other: &Self) -> bool {
        (self.name, self.hash) == (other.name, other.hash)
    }
}

/// A ROS 2 service: what is asked and what is answered.
///
/// ```
/// use wrapyfi_interfaces::{Message, Service, std_srvs::srv::SetBool};
/// fn request_type<S: Service>() -> &'static str {
///     S::Request::ROS_TYPE
/// }
/// assert_eq!(request_type::<SetBool>(), "std_srvs/srv/SetBool_Request");
/// ```
pub trait Service {
    /// Message that a client sends.
    type Request: Message;
    /// Message that the server answers.
    type Response: Message;
    /// Message that a client or server publishes about a call (service introspection).
    type Event: Message;
    /// ROS name, for instance `std_srvs/srv/SetBool`.
    const ROS_TYPE: &'static str;
    /// REP-2016 hash of the service as a whole. Endpoints announce those of
    /// [`Request`](Self::Request) and [`Response`](Self::Response) instead.
    const TYPE_HASH: &'static str;
}

/// A ROS 2 action: what is asked, answered and told meanwhile, and the types that carry these.
///
/// ```
/// use wrapyfi_interfaces::{Action, Message, Service};
/// /// Types of the topics and services of an action.
/// fn carriers<A: Action>() -> [&'static str; 3] {
///     [A::SendGoal::ROS_TYPE, A::GetResult::ROS_TYPE, A::FeedbackMessage::ROS_TYPE]
/// }
/// ```
pub trait Action {
    /// Message that a client asks with.
    type Goal: Message;
    /// Message that the server ends a goal with.
    type Result: Message;
    /// Message that the server tells meanwhile.
    type Feedback: Message;
    /// Service that takes a goal with its id.
    type SendGoal: Service;
    /// Service that answers once the goal has ended.
    type GetResult: Service;
    /// Message of the feedback topic: feedback with the id of its goal.
    type FeedbackMessage: Message;
    /// ROS name, for instance `example_interfaces/action/Fibonacci`.
    const ROS_TYPE: &'static str;
    /// REP-2016 hash of the action as a whole.
    const TYPE_HASH: &'static str;
}

/// REP-2016 hashes of a service: of the type as a whole and of its parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServiceHashes {
    /// Hash of the service.
    pub service: &'static str,
    /// Hash of its `_Request`.
    pub request: &'static str,
    /// Hash of its `_Response`.
    pub response: &'static str,
}

impl ServiceHashes {
    /// Hashes of a generated service.
    pub const fn of<S: Service>() -> Self {
        Self {
            service: S::TYPE_HASH,
            request: S::Request::TYPE_HASH,
            response: S::Response::TYPE_HASH,
        }
    }
}
