//! Kinds of causes, a word each.

use serde::{Deserialize, Serialize};
use wrapyfi_interfaces::named;

named! {
    /// Kind of a cause, as statuses, messages and `wrapyfi why --json` name it.
    #[derive(PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum CauseCode {
        /// No program publishes.
        NobodyPublishes => "nobody_publishes",
        /// No program subscribes.
        NobodyListens => "nobody_listens",
        /// No program offers the service.
        NobodyOffers => "nobody_offers",
        /// No program calls the service, or uses a device.
        NobodyCalls => "nobody_calls",
        /// A program that is there has not yet done what is waited for.
        NotReady => "not_ready",
        /// The route, or what it looks with, has just begun.
        Starting => "starting",
        /// The bridge is not activated.
        Inactive => "inactive",
        /// Types differ.
        Type => "type",
        /// Nothing tells the type.
        TypeUnknown => "type_unknown",
        /// A definition is missing.
        Definition => "definition",
        /// Definitions of one type differ.
        OtherDefinition => "other_definition",
        /// Quality of service differs.
        Qos => "qos",
        /// Services are mapped to DDS in two ways.
        ServiceMapping => "service_mapping",
        /// A host name does not resolve.
        UnresolvedHost => "unresolved_host",
        /// A broker, master or name server does not answer.
        ServerAway => "server_away",
        /// Another server answers at the address.
        OtherServer => "other_server",
        /// Keys or mechanisms of two sides differ.
        Security => "security",
        /// A rule of the other side denies it.
        Denied => "denied",
        /// A server listens on the loopback interface of another machine.
        LoopbackElsewhere => "loopback_elsewhere",
        /// A program announces an address of its own machine alone.
        LoopbackAddress => "loopback_address",
        /// The middleware does not work, or is not there.
        Middleware => "middleware",
        /// A setting is wrong.
        Setting => "setting",
        /// Something works, and too slowly.
        Slow => "slow",
        /// A subscriber acknowledges nothing.
        Unacknowledged => "unacknowledged",
        /// A step of the route blocks.
        Blocked => "blocked",
        /// A program that is registered does not answer.
        PeerUnreachable => "peer_unreachable",
        /// A program refuses the connection.
        RefusedByPeer => "refused_by_peer",
        /// No program has opened the port.
        NotOpened => "not_opened",
        /// Another program or route has the name.
        NameTaken => "name_taken",
        /// The destination has another source.
        DestinationTaken => "destination_taken",
        /// Another bridge carries it.
        Carried => "carried",
        /// Nothing tells which side is to be the source.
        BothSides => "both_sides",
        /// No name matches a pattern.
        NoName => "no_name",
        /// More names match than a pattern may have routes.
        Limit => "limit",
        /// Routes make a circle.
        Cycle => "cycle",
        /// A part of the program panicked.
        Panic => "panic",
        /// Messages are dropped.
        Drops => "drops",
        /// The library of a transport reports an error.
        Transport => "transport",
        /// A pattern leaves the name out.
        LeftOut => "left_out",
        /// The name differs a little from one that is there.
        OtherName => "other_name",
        /// The name is in another domain of ROS 2.
        OtherDomain => "other_domain",
        /// The bridge has another master of ROS 1.
        OtherMaster => "other_master",
        /// Discovery does not reach as far.
        DiscoveryRange => "discovery_range",
        /// The bridge itself is the only publisher.
        OwnPublication => "own_publication",
        /// No bridge runs the route.
        NoBridge => "no_bridge",
        /// No route has the name.
        NoRoute => "no_route",
        /// The state of a running route tells it.
        State => "state",
        /// The limit of a rate leaves messages out.
        RateLimit => "rate_limit",
        /// A list of permitted programs leaves one out.
        Refused => "refused",
        /// Two bridges have one node name.
        SameNode => "same_node",
        /// Several bridges carry the same.
        SeveralBridges => "several_bridges",
        /// All is in place, and no message comes.
        Idle => "idle",
        /// A word of a bridge elsewhere that is not known here.
        Other => "other",
    }
    /// Word in statuses, messages and JSON.
    pub fn as_str, from_name;
}

impl From<&str> for CauseCode {
    /// Code with this word; [`CauseCode::Other`] for one that is not known here.
    fn from(word: &str) -> Self {
        Self::from_name(word).unwrap_or(Self::Other)
    }
}
