//! The ways in which programs exchange messages, and the roles that endpoints have in them.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Way in which programs exchange messages.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::{Interaction, Role};
/// let service: Interaction = "service".parse()?;
/// assert_eq!((service.provider(), service.taker()), (Role::Server, Role::Client));
/// assert_eq!(Role::Listener.interaction(), Interaction::Topic);
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Interaction {
    /// Messages from publishers to subscriptions.
    #[default]
    Topic,
    /// Requests to a server, each with one reply.
    Service,
    /// Goals to a server, each with feedback and a result, which may be cancelled.
    Action,
}

impl Interaction {
    /// All interactions.
    pub const ALL: [Self; 3] = [Self::Topic, Self::Service, Self::Action];
    /// Topics and services: those of a middleware that has no actions.
    pub const TOPICS_AND_SERVICES: &'static [Self] = &[Self::Topic, Self::Service];

    /// Role of the endpoint from which a route takes: publisher or server.
    pub fn provider(self) -> Role {
        match self {
            Self::Topic => Role::Publisher,
            Self::Service => Role::Server,
            Self::Action => Role::ActionServer,
        }
    }

    /// Role of the endpoint to which a route gives: listener or client.
    pub fn taker(self) -> Role {
        match self {
            Self::Topic => Role::Listener,
            Self::Service => Role::Client,
            Self::Action => Role::ActionClient,
        }
    }

    /// Article that stands before the word of the interaction.
    pub fn article(self) -> &'static str {
        if self == Self::Action { "an" } else { "a" }
    }

    /// Keys of the source and of the destination in an entry of `routes`.
    pub fn keys(self) -> [&'static str; 2] {
        match self {
            Self::Topic => ["from", "to"],
            Self::Service => ["service", "as"],
            Self::Action => ["action", "as"],
        }
    }

    /// Puts source and destination of a route in the direction of messages or calls, and back again: those of a
    /// service and of an action go from the place where it is offered to the place of its server.
    pub fn in_direction<T>(self, source: T, destination: T) -> [T; 2] {
        match self {
            Self::Topic => [source, destination],
            Self::Service | Self::Action => [destination, source],
        }
    }
}

impl FromStr for Interaction {
    type Err = String;

    /// Reads the word that the interaction has in JSON: `topic`, `service` or `action`.
    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|one| one.to_string() == text);
        known.ok_or_else(|| format!("{text:?} is no interaction: write topic, service or action"))
    }
}

/// Role of an endpoint.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_endpoint as endpoint; }
/// use wrapyfi_core::endpoint::Role;
/// assert_eq!(Role::Publisher.to_string(), "publisher");
/// assert_eq!(Role::ActionServer.words(), "action server");
/// assert!(Role::Publisher < Role::Server); // the order of lists
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum Role {
    Publisher,
    Listener,
    Client,
    Server,
    ActionClient,
    ActionServer,
}

impl Role {
    /// Interaction in which endpoints have the role.
    pub fn interaction(self) -> Interaction {
        match self {
            Self::Publisher | Self::Listener => Interaction::Topic,
            Self::Client | Self::Server => Interaction::Service,
            Self::ActionClient | Self::ActionServer => Interaction::Action,
        }
    }

    /// The role in a sentence: `action server`.
    pub fn words(self) -> String {
        self.to_string().replace('_', " ")
    }

    /// True for a publisher and for servers, from which routes take.
    pub fn is_provider(self) -> bool {
        self == self.interaction().provider()
    }
}
