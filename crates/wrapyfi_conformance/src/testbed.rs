//! Facts about a middleware that the suite has to know.

use wrapyfi_data::types::MessageType;
use wrapyfi_endpoint::{Middleware, ServiceSpec, TopicSpec};

/// The two ends of a testbed's wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WireEnd {
    /// One end.
    Near,
    /// The other end.
    Far,
}

impl WireEnd {
    /// Both of them.
    pub const BOTH: [Self; 2] = [Self::Near, Self::Far];

    /// The end opposite to this one.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Near => Self::Far,
            Self::Far => Self::Near,
        }
    }
}

/// A middleware under test: two instances of it, joined as two processes would be, with no
/// shortcut between them inside the process.
pub trait Testbed: Sized {
    /// Promises of the middleware.
    const CAPABILITIES: Capabilities;

    /// Starts both sides in an environment of their own: free ports, an unused domain, loopback only.
    fn start() -> Self;

    /// The middleware at one end.
    fn side(&self, side: WireEnd) -> &dyn Middleware;

    /// Ends the middleware at `side` and starts it anew at the same address. Its endpoints are
    /// gone already; those of the other side live on.
    fn restart(&mut self, side: WireEnd);

    /// Sends, as a foreign peer, one message on `spec.topic` that is framed as the middleware
    /// frames `spec.message_type` and has `body` where the content belongs. Returns when it is on
    /// its way to the listeners that exist. Called only where [`Capabilities::wire`].
    fn inject(&mut self, spec: &TopicSpec, body: &[u8]) {
        _ = (spec, body);
        unimplemented_rig("inject");
    }

    /// Sends, as a foreign client, one request to `spec.service` with `body` where the call belongs.
    /// Returns when it is on its way. Called only where [`Capabilities::wire`] and
    /// [`Capabilities::services`].
    fn inject_request(&mut self, spec: &ServiceSpec, body: &[u8]) {
        _ = (spec, body);
        unimplemented_rig("inject_request");
    }

    /// The type as the middleware names it, in what its links say.
    fn type_name(message_type: MessageType) -> String {
        message_type.ros_type().to_owned()
    }

    /// Names that no topic of the middleware can have. Called only where [`Capabilities::refuses_names`].
    fn invalid_names() -> Vec<String> {
        Vec::new()
    }
}

fn unimplemented_rig(what: &str) -> ! {
    panic!("the testbed says that its middleware has a wire, but has no {what}")
}

/// Promises of a middleware beyond the traits. Cases that need one which it does not make are ignored:
/// [`conformance_tests!`](crate::conformance_tests) is told why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Capabilities {
    /// Messages are bytes on their way: they have a size, and can be broken.
    pub wire: bool,
    /// A listener's link counts publishers.
    pub listener_knows_peers: bool,
    /// A listener's link counts every publisher, not only the nodes that have one.
    pub listener_counts_publishers: bool,
    /// A topic may have several publishers at once. Elsewhere a second one waits for the name.
    pub several_publishers: bool,
    /// A publisher's link counts every listener, not only whether there is one.
    pub publisher_counts_listeners: bool,
    /// An endpoint without a peer says so in `waiting_for`.
    pub waits_aloud: bool,
    /// Transient local durability.
    pub keeps_last: bool,
    /// True when messages that a side publishes do not come back to its own listeners.
    pub ignores_own: bool,
    /// Under policy `block` messages wait for room.
    pub block_waits: bool,
    /// Sound keeps 16-bit samples.
    pub integer_sound: bool,
    /// Sound keeps samples that are floats; elsewhere they become 16 bits.
    pub float_sound: bool,
    /// Images and sound keep their coordinate frame.
    pub frame_id: bool,
    /// Images keep the name of their encoding; elsewhere what has one number a pixel, as a Bayer pattern has, is grey.
    pub names_encodings: bool,
    /// Some names can belong to no topic.
    pub refuses_names: bool,
    /// Treatment of messages of another type.
    pub types: TypeCheck,
    /// Requests and replies.
    pub services: bool,
    /// Pictures and sound that are returned keep their time; elsewhere it is that of their arrival.
    pub reply_stamps: bool,
    /// A reply that is too large for its client is dropped before it is known whose it is: the call
    /// ends at its time.
    pub drops_large_replies_unread: bool,
}

/// Treatment of messages of another type on the same topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TypeCheck {
    /// The transport matches types: publisher and listener never meet, and the link says why.
    Match,
    /// They arrive, and are counted as dropped.
    Arrival,
    /// The transport does not look at types.
    Unchecked,
}

impl Capabilities {
    /// Everything the suite can ask for.
    pub const FULL: Self = Self {
        wire: true,
        listener_knows_peers: true,
        listener_counts_publishers: true,
        several_publishers: true,
        publisher_counts_listeners: true,
        waits_aloud: true,
        keeps_last: true,
        ignores_own: true,
        block_waits: true,
        integer_sound: true,
        float_sound: true,
        frame_id: true,
        names_encodings: true,
        refuses_names: true,
        types: TypeCheck::Match,
        services: true,
        reply_stamps: true,
        drops_large_replies_unread: false,
    };

    /// True when messages of another type are noticed.
    pub const fn checks_types(&self) -> bool {
        !matches!(self.types, TypeCheck::Unchecked)
    }
}
