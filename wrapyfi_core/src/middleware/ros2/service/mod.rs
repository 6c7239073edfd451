//! Services of any type whose definition is known, called and served.
//!
//! ```text
//!   AnyClient ─ request ─▶ CdrClient ═══ DDS ═══▶ CdrServer ─▶ AnyServer ─▶ user
//!       ▲                                                          │
//!       └──── reply, or why there is none ◀═══ DDS ════════════════┘
//!   calls: time-outs, late replies, how many at once      replies: kept until the client hears
//! ```

mod client;
mod error;
pub(super) mod replies;
mod server;

use std::time::Duration;

use bytes::Bytes;
use wrapyfi_interfaces::description::HIDDEN_FIELD;
use wrapyfi_interfaces::dynamic::{DynamicMessage, Plan, ValueError};
use wrapyfi_interfaces::store::ResolvedType;

pub use crate::endpoint::Ticket;
pub use client::AnyClient;
pub use error::CallError;
pub use server::{AnyRequest, AnyServer, ServeError, ServerDrops};

use super::graph::ServiceDescription;
use super::{AnyError, Ros2};
use crate::Limits;
use crate::endpoint::BridgeMark;
use crate::endpoint::calls::ends;

/// How soon to look again, at the earliest, for what nobody is notified of: see
/// [`CdrClient::look_again`](super::graph::CdrClient::look_again).
pub(super) const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// How calls are treated, by clients and by servers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceOptions {
    /// Time that a call has, from its begin to its reply: 5 s.
    pub timeout: Duration,
    /// Calls of one client, or requests of one server, that may be under way at once: 64.
    pub pending: usize,
    /// Requests and replies kept by DDS: 10.
    pub depth: u32,
    /// Largest request or reply in bytes.
    pub max_bytes: usize,
    /// What a server announces: that a bridge made it by pattern.
    pub mark: Option<BridgeMark>,
}

impl Default for ServiceOptions {
    fn default() -> Self {
        Self {
            timeout: Duration::from_secs(5),
            pending: 64,
            depth: 10,
            max_bytes: Limits::default().message_bytes,
            mark: None,
        }
    }
}

/// A type of service: how its requests and replies are read and written.
#[derive(Debug, Clone)]
pub struct ServiceType {
    name: String,
    request: Plan,
    response: Plan,
    request_hash: String,
    response_hash: String,
}

impl ServiceType {
    /// The service with this definition.
    ///
    /// # Errors
    /// When it is no service, or cannot be compiled.
    pub fn new(resolved: &ResolvedType) -> Result<Self, AnyError> {
        let name = resolved.name().to_string();
        let part = |suffix: &str| {
            let part = resolved.part(suffix).ok_or_else(|| AnyError::NoService(name.clone()))?;
            let plan = part.plan().map_err(|fault| AnyError::Definition {
                type_name: name.clone(),
                fault: Box::new(fault),
            })?;
            Ok::<_, AnyError>((plan, part.type_hash()))
        };
        let (request, request_hash) = part("_Request")?;
        let (response, response_hash) = part("_Response")?;
        Ok(Self { name, request, response, request_hash, response_hash })
    }

    /// ROS name, for instance `example_interfaces/srv/AddTwoInts`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How requests are read and written.
    #[must_use]
    pub fn request(&self) -> &Plan {
        &self.request
    }

    /// How replies are read and written.
    #[must_use]
    pub fn response(&self) -> &Plan {
        &self.response
    }

    /// A reply that says what went wrong, for services whose replies have room for it: a `success`
    /// (or `successful`) that is false, and a text. One without fields says nothing in any case, and
    /// spares the client to wait for its time-out.
    #[must_use]
    pub fn error_reply(&self, text: &str) -> Option<DynamicMessage> {
        let mut reply = self.response.default_message();
        if reply.fields().all(|(name, _)| name == HIDDEN_FIELD) {
            return Some(reply);
        }
        let switch = ["success", "successful"];
        if !switch.iter().any(|name| reply.set(name, false).is_ok()) {
            return None;
        }
        // Where there is no room for the text, the switch still says that it failed.
        let _ = ["message", "reason", "error", "status_message"]
            .iter()
            .any(|name| reply.set(name, text).is_ok());
        Some(reply)
    }

    fn describe(
        &self,
        ros2: &Ros2,
        name: &str,
        options: &ServiceOptions,
    ) -> Result<ServiceDescription, AnyError> {
        Ok(ServiceDescription {
            name: ros2.resolve(name).map_err(|error| AnyError::Open(error.to_string()))?,
            type_name: self.name.clone(),
            request_hash: Some(self.request_hash.clone()),
            response_hash: Some(self.response_hash.clone()),
            depth: options.depth,
            max_bytes: options.max_bytes,
        })
    }
}

/// A message in one piece; a large one is refused here, where it can still be told.
fn encode(plan: &Plan, message: &DynamicMessage) -> Result<Bytes, ValueError> {
    Ok(plan.encode(message)?.to_bytes())
}
