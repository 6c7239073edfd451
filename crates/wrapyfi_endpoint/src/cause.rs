//! Causes for which nothing flows: each a value with its fields, and one sentence for it.
//!
//! ```text
//!   Link, Middleware, Discovery, errors ─▶ Cause ─▶ state of a route ─┬▶ Display: the sentence for people
//!                                                                    └▶ code, subject, theirs, ours: for programs
//! ```

use serde::{Serialize, Serializer};

use super::registry::UnknownMiddleware;
use super::{
    Absent, CarriedBack, CauseCode, DiscoverError, DropReason, EndpointAddress, Interaction,
    LearnError, Named, OpenError, PeerFault, Role,
};

/// Cause for which nothing flows at the moment, or less than is given.
///
/// ```
/// use wrapyfi_endpoint::{Absent, Cause, CauseCode, Role};
/// let cause = Cause::Nobody(Absent::new(Role::Publisher, "a publisher of", "ros2", "/chatter"));
/// assert_eq!(cause.code(), CauseCode::NobodyPublishes);
/// assert_eq!((cause.code().as_str(), cause.subject()), ("nobody_publishes", "ros2:/chatter".into()));
/// assert_eq!(cause.to_string(), "a publisher of /chatter");
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Cause {
    /// No such program is there.
    #[error("{0}")]
    Nobody(Absent),
    /// No program is there that tells the type.
    #[error("{0}, which tells the type")]
    Untyped(Absent),
    /// One of the two endpoints of a service is not found yet.
    #[error("{0}, found by half")]
    FoundByHalf(Absent),
    /// Only some parts of an action's server are found.
    #[error("{absent} with all parts of an action: {} not found", parts.join(", "))]
    PartsMissing {
        /// Server that is waited for.
        absent: Absent,
        /// Parts that are not found.
        parts: Vec<&'static str>,
    },
    /// Those who are there have another type.
    #[error("{absent}{}", other_type(absent.role, peer.as_deref(), theirs, ours))]
    Type {
        /// Endpoint that is waited for.
        absent: Absent,
        /// Program with the other type, where it is known.
        peer: Option<String>,
        /// Type there.
        theirs: String,
        /// Type here.
        ours: String,
    },
    /// A program has another definition of the type.
    #[error("{absent} of {type_name}: {peer} wants {type_name} of another definition")]
    OtherDefinition {
        /// Endpoint that is waited for.
        absent: Absent,
        /// Program with the other definition.
        peer: String,
        /// The type.
        type_name: String,
    },
    /// No program of those that are there fits in quality of service.
    #[error("{absent} that fits ({peer} {}", other_qos(absent.role, theirs, ours))]
    Qos {
        /// Endpoint that is waited for.
        absent: Absent,
        /// Program that does not fit.
        peer: String,
        /// Value of the policy there.
        theirs: String,
        /// Value of the policy here.
        ours: String,
    },
    /// No program of those that are there fits in a policy that ROS does not have.
    #[error("{absent} whose {policy} is compatible (see qos)")]
    Policy {
        /// Endpoint that is waited for.
        absent: Absent,
        /// The policy.
        policy: &'static str,
    },
    /// Services are mapped to DDS in another way there.
    #[error("{absent} that does not speak {theirs}")]
    ServiceMapping {
        /// Endpoint that is waited for.
        absent: Absent,
        /// RMW whose mapping the servers have.
        theirs: &'static str,
        /// RMW whose mapping the bridge has.
        ours: &'static str,
    },
    /// Services of a node are mapped to DDS in another way.
    #[error(
        "node {node} to speak {ours}: it runs {theirs}; set RMW_IMPLEMENTATION={theirs} here, or {ours} there"
    )]
    NodeMapping {
        /// Full name of the node.
        node: String,
        /// RMW whose mapping the node has.
        theirs: &'static str,
        /// RMW whose mapping is used here.
        ours: &'static str,
    },
    /// No such program is there, and a host that may have such a program does not resolve.
    #[error("{absent} ({why})")]
    UnresolvedHost {
        /// Endpoint that is waited for.
        absent: Absent,
        /// The host, and the error of its name.
        why: String,
    },
    /// Publishers of a topic have several types.
    #[error("{at} has several types: {}; give `type`", types.join(", "))]
    SeveralTypes {
        /// Address of the topic.
        at: String,
        /// The types.
        types: Vec<String>,
    },
    /// This program announces an address of its own machine to those of others.
    #[error(
        "{}the nodes of other machines do not reach ours, which is announced at {host}: set ROS_IP, and no \
         ROS_HOSTNAME, where it starts", awaited.as_ref().map_or_else(String::new, |it| format!("{it}: "))
    )]
    LoopbackAnnounced {
        /// Cause beside it.
        awaited: Option<Box<Cause>>,
        /// Host that is announced.
        host: String,
    },
    /// Another program is not connected, or has not done what is waited for.
    #[error("{peer}{step}{}{hint}", fault.as_ref().map_or_else(String::new, |it| format!(": {it}")))]
    Peer {
        /// The program, or its port.
        peer: Named,
        /// Step that is waited for, after the peer: ` to answer`; empty where it is to be connected.
        step: &'static str,
        /// Fault of the connection, where there is one.
        fault: Option<PeerFault>,
        /// Remedy where the program announces an address of its own machine alone, else empty.
        hint: &'static str,
    },
    /// The server of a service refuses.
    #[error("{server}, which refuses: {says}")]
    ServerRefuses {
        /// The server.
        server: Named,
        /// Reason that it gives.
        says: String,
    },
    /// No program has opened the port.
    #[error("port {}, which no program has opened", .0.name)]
    NotOpened(EndpointAddress),
    /// Another program has the name of a port.
    #[error(
        "the name {}, which another program{}: end that one, or set option port", port.name,
        if *was_ours { " took from us" } else { "'s port has" }
    )]
    NameTaken {
        /// Address of the port.
        port: EndpointAddress,
        /// True where the port was ours before.
        was_ours: bool,
    },
    /// Another publisher of this program has the port, with other settings.
    #[error(
        "port {}, which another publisher of this program has: give both the same to_peers, out_topic_connect and \
         type, or one of them another port", .0.name
    )]
    PortShared(EndpointAddress),
    /// Another program offers a service under the name.
    #[error("the name {to}, under which {by} offers {} {interaction}", interaction.article())]
    NameServed {
        /// Address at which it is to be offered.
        to: String,
        /// Interaction that the other program offers.
        interaction: Interaction,
        /// The other program.
        by: String,
    },
    /// Another source has the destination.
    #[error("the name {to}, to which {by} goes; write a route with another")]
    DestinationTaken {
        /// Address of the destination.
        to: String,
        /// Address of the other source.
        by: String,
    },
    /// Another route is about to leave the destination.
    #[error("{0}, which another route is leaving")]
    Leaving(String),
    /// A destination that is made ahead has another source.
    #[error("{0} to have no other source")]
    OtherSource(String),
    /// Another bridge carries it.
    #[error("the bridge {bridge}, which carries it to {to} already")]
    Carried {
        /// Full name of its node on ROS 2, or `another program`.
        bridge: String,
        /// Address of the destination.
        to: String,
    },
    /// Both sides have publishers, and one does not tell which are a bridge's.
    #[error(
        "a decision: {from} and {to} both have publishers, and {unmarked} does not tell which are bridges'; write a \
         route for it"
    )]
    BothSides {
        /// Address of the source.
        from: String,
        /// Address of the destination.
        to: String,
        /// Middleware that does not tell.
        unmarked: String,
    },
    /// The last state of a device is old.
    #[error(
        "{absent}: the last came more than {age_s} s ago, and movements are refused until one comes"
    )]
    Stale {
        /// State that is waited for.
        absent: Absent,
        /// Age of the last one in seconds, at least.
        age_s: u64,
    },
    /// A server of a middleware does not answer: broker, master, name server.
    #[error("{server}{detail}")]
    ServerAway {
        /// The server.
        server: Named,
        /// Error of its transport and the remedy, after the server; may be empty.
        detail: String,
    },
    /// Another server answers at a server's address.
    #[error("{server} (what answers there is not the matching side of one)")]
    OtherServer {
        /// The server.
        server: Named,
    },
    /// Only one side encrypts, or keys do not fit.
    #[error("{server}{detail}")]
    Security {
        /// The server.
        server: Named,
        /// Key or mechanism that differs, and the remedy, after the server.
        detail: String,
    },
    /// A server does not permit it.
    #[error("{server}, which {rule}")]
    Denied {
        /// The server.
        server: Named,
        /// Use that is not permitted, and the list that permits it.
        rule: String,
    },
    /// The middleware has ended, in its own words.
    #[error("{0}")]
    Ended(String),
    /// An endpoint could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A type could not be learned.
    #[error(transparent)]
    Learn(#[from] LearnError),
    /// Endpoints could not be listed.
    #[error(transparent)]
    Discover(#[from] DiscoverError),
    /// The program has no such middleware.
    #[error(transparent)]
    Unknown(#[from] UnknownMiddleware),
    /// Something begins; its name.
    #[error("{0}")]
    Starting(&'static str),
    /// The bridge is not activated.
    #[error("the bridge to be activated")]
    Inactive,
    /// No name matches a pattern.
    #[error("a name that matches")]
    NoName,
    /// More names match a pattern than it may have routes.
    #[error("{limit} is the limit of routes (max_routes), {more} more names match")]
    Limit {
        /// Address of the pattern's source.
        at: String,
        /// Most routes of the pattern.
        limit: usize,
        /// Number of names without a route.
        more: usize,
    },
    /// The route closes a circle over routes of other bridges.
    #[error(
        "loop: what this route of bridge {bridge} sends to {to} comes back to {from} through {}, and would go round for ever; leave \
         one of the routes out, or write loop_guard: false here if that is no circle",
        way_back(way)
    )]
    Cycle {
        /// Bridge that has the route.
        bridge: String,
        /// Address of the source.
        from: String,
        /// Address of the destination.
        to: String,
        /// Routes of other bridges on the way back.
        way: Vec<CarriedBack>,
    },
    /// A part of the program panicked.
    #[error("{what}: {panic}")]
    Panic {
        /// The part, and what follows.
        what: String,
        /// Text of the panic.
        panic: String,
    },
    /// A part that has panicked is to begin again; the part, in words.
    #[error("{0}")]
    Restarting(String),
    /// A step of the route has not ended.
    #[error("its step from {from} to {to} has blocked for {seconds} s")]
    Blocked {
        /// Address of the source.
        from: String,
        /// Address of the destination.
        to: String,
        /// Time in seconds since the step began.
        seconds: u64,
    },
    /// A subscriber does not acknowledge what it is sent.
    #[error(
        "{} runs Fast DDS and acknowledges nothing: it has ended without a word, stands still or is far too \
         slow for messages of {bytes} bytes; the other subscribers do not wait for it; end it or start it again, or \
         {remedy}", reader.as_deref().unwrap_or("a subscriber")
    )]
    Unacknowledged {
        /// Node of the subscriber, where it is known.
        reader: Option<String>,
        /// Size of the last message in bytes.
        bytes: usize,
        /// Setting that lets larger messages through.
        remedy: String,
    },
    /// A subscriber is slower than messages come.
    #[error(
        "{} runs Fast DDS and takes longer for messages of {bytes} bytes than there is between two: the newest go, \
         one after the other; {remedy}", reader.as_deref().unwrap_or("a subscriber")
    )]
    SlowReader {
        /// Node of the subscriber, where it is known.
        reader: Option<String>,
        /// Size of the last message in bytes.
        bytes: usize,
        /// Setting that lets larger messages through.
        remedy: String,
    },
    /// A message was larger than is allowed.
    #[error("a message on {at} was larger than {limit_mib} MiB")]
    Oversize {
        /// Address of the source.
        at: String,
        /// Largest size in MiB.
        limit_mib: usize,
    },
    /// Messages did not reach all listeners.
    #[error("{messages} messages did not reach everybody who listens on {to}")]
    Undelivered {
        /// Number of messages since the last look.
        messages: u64,
        /// Address of the destination.
        to: String,
    },
    /// A message or call was lost.
    #[error("{error}")]
    Lost {
        /// Reason as counters have it.
        reason: DropReason,
        /// Error in words.
        error: String,
    },
    /// The library of a transport reports an error, in its words.
    #[error("{0}")]
    Transport(String),
}

impl From<Absent> for Cause {
    fn from(absent: Absent) -> Self {
        Self::Nobody(absent)
    }
}

/// Words behind a missing endpoint, where those who are there have another type.
fn other_type(role: Role, peer: Option<&str>, theirs: &str, ours: &str) -> String {
    match (peer, role) {
        (Some(peer), _) => format!(" of {ours}: {peer} wants {theirs}"),
        (None, Role::Server) => format!(" that is {ours}; the one there is {theirs}"),
        (None, _) => format!(" with type {ours} (those there carry {theirs})"),
    }
}

/// Words behind a program that does not fit in quality of service.
fn other_qos(role: Role, theirs: &str, ours: &str) -> String {
    match role {
        Role::Publisher => format!("offers {theirs}, the route asks for {ours})"),
        _ => format!("asks for {theirs}, the route offers {ours})"),
    }
}

fn way_back(way: &[CarriedBack]) -> String {
    let hops: Vec<_> = way
        .iter()
        .map(|CarriedBack { bridge, from, to }| format!("bridge {bridge} ({from} -> {to})"))
        .collect();
    hops.join(", then ")
}

impl Cause {
    /// Fault of a connection to another program, with a hint where that announces its own machine alone.
    pub fn peer(
        peer: Named,
        step: &'static str,
        fault: Option<PeerFault>,
        hint: &'static str,
    ) -> Self {
        Self::Peer { peer, step, fault, hint }
    }

    /// Kind of the cause.
    pub fn code(&self) -> CauseCode {
        use CauseCode as Code;
        match self {
            Self::Nobody(absent) | Self::Untyped(absent) => match absent.role {
                Role::Publisher => Code::NobodyPublishes,
                Role::Listener => Code::NobodyListens,
                Role::Server | Role::ActionServer => Code::NobodyOffers,
                Role::Client | Role::ActionClient => Code::NobodyCalls,
            },
            Self::FoundByHalf(_) | Self::PartsMissing { .. } | Self::Stale { .. } => Code::NotReady,
            Self::SeveralTypes { .. } => Code::TypeUnknown,
            Self::Learn(LearnError::Asked(_)) => Code::NotReady,
            Self::Type { .. } => Code::Type,
            Self::OtherDefinition { .. } => Code::OtherDefinition,
            Self::Qos { .. } | Self::Policy { .. } => Code::Qos,
            Self::ServiceMapping { .. } | Self::NodeMapping { .. } => Code::ServiceMapping,
            Self::UnresolvedHost { .. } => Code::UnresolvedHost,
            Self::LoopbackAnnounced { .. } => Code::LoopbackAddress,
            Self::Peer { fault, hint, .. } => match fault {
                Some(PeerFault::Unlike { .. } | PeerFault::Unreadable { .. }) => Code::Type,
                Some(PeerFault::Refuses { .. }) => Code::RefusedByPeer,
                Some(PeerFault::Transport(_)) if hint.is_empty() => Code::PeerUnreachable,
                None if hint.is_empty() => Code::NotReady,
                _ => Code::LoopbackAddress,
            },
            Self::ServerRefuses { .. } => Code::RefusedByPeer,
            Self::NotOpened(_) => Code::NotOpened,
            Self::NameTaken { .. }
            | Self::PortShared(_)
            | Self::NameServed { .. }
            | Self::Leaving(_) => Code::NameTaken,
            Self::DestinationTaken { .. } | Self::OtherSource(_) => Code::DestinationTaken,
            Self::Carried { .. } => Code::Carried,
            Self::BothSides { .. } => Code::BothSides,
            Self::ServerAway { .. } => Code::ServerAway,
            Self::OtherServer { .. } => Code::OtherServer,
            Self::Security { .. } => Code::Security,
            Self::Denied { .. } => Code::Denied,
            Self::Learn(LearnError::Undefined { .. }) => Code::Definition,
            Self::Learn(_) => Code::TypeUnknown,
            Self::Open(error) => match error {
                OpenError::NotStarted { .. } => Code::Middleware,
                OpenError::Transport { .. } => Code::Transport,
                _ => Code::Setting,
            },
            Self::Ended(_) | Self::Discover(_) | Self::Unknown(_) => Code::Middleware,
            Self::Starting(_) => Code::Starting,
            Self::Inactive => Code::Inactive,
            Self::NoName => Code::NoName,
            Self::Limit { .. } => Code::Limit,
            Self::Cycle { .. } => Code::Cycle,
            Self::Panic { .. } | Self::Restarting(_) => Code::Panic,
            Self::Blocked { .. } => Code::Blocked,
            Self::Unacknowledged { .. } => Code::Unacknowledged,
            Self::SlowReader { .. } => Code::Slow,
            Self::Oversize { .. } | Self::Undelivered { .. } | Self::Lost { .. } => Code::Drops,
            Self::Transport(_) => Code::Transport,
        }
    }

    /// Address of the endpoint or server that the cause is about, else the program, type or reason; empty where there is
    /// none.
    pub fn subject(&self) -> String {
        match self {
            Self::Nobody(absent)
            | Self::Untyped(absent)
            | Self::FoundByHalf(absent)
            | Self::PartsMissing { absent, .. }
            | Self::Policy { absent, .. }
            | Self::ServiceMapping { absent, .. }
            | Self::UnresolvedHost { absent, .. }
            | Self::Stale { absent, .. }
            | Self::Type { absent, peer: None, .. } => &absent.named.address,
            Self::Type { peer: Some(subject), .. }
            | Self::OtherDefinition { peer: subject, .. }
            | Self::Qos { peer: subject, .. }
            | Self::NodeMapping { node: subject, .. }
            | Self::SeveralTypes { at: subject, .. }
            | Self::LoopbackAnnounced { host: subject, .. }
            | Self::NameServed { by: subject, .. }
            | Self::DestinationTaken { by: subject, .. }
            | Self::Leaving(subject)
            | Self::OtherSource(subject)
            | Self::Carried { bridge: subject, .. }
            | Self::BothSides { unmarked: subject, .. }
            | Self::Unknown(UnknownMiddleware { name: subject, .. })
            | Self::Learn(LearnError::Undefined { type_name: subject, .. })
            | Self::Blocked { to: subject, .. }
            | Self::Oversize { at: subject, .. }
            | Self::Undelivered { to: subject, .. }
            | Self::Limit { at: subject, .. } => subject,
            Self::Peer { peer: named, .. }
            | Self::ServerRefuses { server: named, .. }
            | Self::ServerAway { server: named, .. }
            | Self::OtherServer { server: named }
            | Self::Security { server: named, .. }
            | Self::Denied { server: named, .. } => &named.address,
            Self::NotOpened(port) | Self::NameTaken { port, .. } | Self::PortShared(port) => {
                return port.to_string();
            }
            Self::Open(OpenError::NotStarted { middleware, .. }) => {
                return (*middleware).to_owned();
            }
            Self::Unacknowledged { reader, .. } | Self::SlowReader { reader, .. } => {
                return reader.clone().unwrap_or_default();
            }
            Self::Cycle { way, .. } => {
                let bridges: Vec<&str> = way.iter().map(|hop| hop.bridge.as_str()).collect();
                return bridges.join(", ");
            }
            Self::Lost { reason, .. } => reason.as_str(),
            _ => "",
        }
        .to_owned()
    }

    /// Type, value or number that the other side has; empty where the cause compares nothing.
    pub fn theirs(&self) -> String {
        match self {
            Self::Type { theirs, .. }
            | Self::Qos { theirs, .. }
            | Self::Peer { fault: Some(PeerFault::Unreadable { theirs, .. }), .. } => {
                theirs.clone()
            }
            Self::Peer { fault: Some(PeerFault::Unlike { theirs, .. }), .. } => theirs.name.clone(),
            Self::Peer { fault: Some(PeerFault::Refuses { theirs, .. }), .. } => {
                theirs.clone().unwrap_or_default()
            }
            Self::ServiceMapping { theirs, .. } | Self::NodeMapping { theirs, .. } => {
                (*theirs).to_owned()
            }
            Self::OtherDefinition { type_name, .. } => type_name.clone(),
            Self::Limit { more, .. } => more.to_string(),
            _ => String::new(),
        }
    }

    /// Type, value or number that this side has or allows; empty where the cause compares nothing.
    pub fn ours(&self) -> String {
        match self {
            Self::Type { ours, .. }
            | Self::Qos { ours, .. }
            | Self::Peer { fault: Some(PeerFault::Unreadable { ours, .. }), .. } => ours.clone(),
            Self::Peer {
                fault: Some(PeerFault::Unlike { ours, .. } | PeerFault::Refuses { ours, .. }),
                ..
            } => ours.name.clone(),
            Self::ServiceMapping { ours, .. } | Self::NodeMapping { ours, .. } => {
                (*ours).to_owned()
            }
            Self::OtherDefinition { type_name, .. } => type_name.clone(),
            Self::Limit { limit, .. } => limit.to_string(),
            Self::Oversize { limit_mib, .. } => limit_mib.to_string(),
            _ => String::new(),
        }
    }
}

impl Serialize for Cause {
    /// Writes `reason`, the sentence, and the parts that programs read.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Parts {
            reason: String,
            cause: CauseCode,
            #[serde(skip_serializing_if = "String::is_empty")]
            cause_subject: String,
            #[serde(skip_serializing_if = "String::is_empty")]
            cause_theirs: String,
            #[serde(skip_serializing_if = "String::is_empty")]
            cause_ours: String,
        }
        let parts = Parts {
            reason: self.to_string(),
            cause: self.code(),
            cause_subject: self.subject(),
            cause_theirs: self.theirs(),
            cause_ours: self.ours(),
        };
        parts.serialize(serializer)
    }
}

#[cfg(test)]
#[path = "cause_tests.rs"]
mod tests;
