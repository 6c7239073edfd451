//! ROS 2 services as `rmw_fastrtps_cpp` writes them, over RustDDS.
//!
//! ```text
//!   RustServices ── client, server ──▶ Participant (while there is one of them)
//!     settings     what RustDDS can be told of the node's settings
//!     participant  RustDDS, its announcement (announce), its thread (watch, greeting), its end (goodbye), its ports
//!     client, server  the traits, on a Pair of endpoints, which end opens anew where RustDDS has ended beneath
//!     pair         writer, reader, remotes: whom they are matched with
//!     outgoing     what is written; large: replies in fragments, which RustDDS cannot identify
//!     identity     which request; adapter: CDR bytes
//! ```
//!
//! Fast DDS names a request in the inline QoS of its sample, for which CycloneDDS has no call.
//! RustDDS has one, so that these services need a participant of their own beside the one that
//! carries the topics. It exists only while a service does.
//!
//! RustDDS has no type hashes in USER_DATA (ROS 2 shows none for these endpoints), no static peers
//! and no domain tags. It takes memory for the size that the header of a fragmented sample claims,
//! before any limit of ours applies. Its readers of one topic share one mark up to which a writer was heard, so that
//! the clients of one service share a reader (`client`).

mod adapter;
mod announce;
#[cfg(test)]
mod captured_tests;
mod changes;
mod client;
mod end;
#[cfg(test)]
mod foreign_tests;
mod fragments;
mod goodbye;
mod greeting;
mod identity;
mod large;
mod outgoing;
mod pair;
mod participant;
mod ports;
mod remotes;
mod server;
mod settings;
#[cfg(test)]
mod stopped_tests;
mod watch;

use std::sync::Arc;

pub use announce::ServiceEndpoints;
pub use settings::RustServicesError;

use self::client::{Client, Endpoints};
use self::end::ReopenedEndpoints;
use self::participant::{Participant, ServicesState, Topics};
use self::server::Server;
use self::settings::Settings;
use super::config::CycloneConfig;
use super::graph::{
    CdrClient, CdrServer, Created, GraphError, GraphResult, Notify, ServiceDescription,
};
use super::names::{self, ServiceNames};
use wrapyfi_endpoint::Mutex;
use wrapyfi_node::NodeName;

/// Services of one node in the mapping of Fast DDS.
///
/// Dropping it leaves its clients and servers alive; the last of them ends the participant, which
/// takes a few hundred milliseconds.
#[derive(Clone)]
pub struct RustServices(Arc<ServicesState>);

impl RustServices {
    /// Services of the node that `config` describes: on its domain, within its discovery range, on
    /// its interface. Nothing is created yet. Settings that do not reach services are logged.
    ///
    /// # Errors
    /// When the settings cannot be honoured.
    pub fn new(config: &CycloneConfig) -> Result<Self, RustServicesError> {
        let settings = Settings::new(config)?;
        for warning in &settings.warnings {
            match config.services {
                Some(_) => tracing::warn!("{warning}"),
                // The user has not asked for this mapping.
                None => tracing::info!("{warning}"),
            }
        }
        Ok(Self::with(settings, Arc::default()))
    }

    /// Services of the same node on another participant.
    #[must_use]
    pub fn on_another_participant(&self) -> Self {
        let settings = Settings { place: self.0.settings.place + 1, ..self.0.settings.clone() };
        Self::with(settings, Arc::clone(&self.0.is_told))
    }

    fn with(settings: Settings, is_told: Arc<Mutex<bool>>) -> Self {
        Self(Arc::new(ServicesState {
            settings,
            is_told,
            participant: Mutex::default(),
            changes: Arc::default(),
            clients: Mutex::default(),
        }))
    }

    /// GUID of the participant, while there is a service.
    pub fn gid(&self) -> Option<[u8; 16]> {
        self.existing().map(|participant| participant.gid())
    }

    /// Readers and writers that exist now, for the announcement of the node under its own name.
    pub fn endpoints(&self) -> ServiceEndpoints {
        self.0.changes.endpoints()
    }

    /// Calls `on_change` now and after every service that comes or goes, in order, with what exists
    /// then. The program that creates or drops a service waits for it, so it must not create or drop one itself.
    pub fn on_change(&self, on_change: impl Fn(&ServiceEndpoints) + Send + Sync + 'static) {
        self.0.changes.notify_by(Box::new(on_change));
    }

    /// Creates a client and announces it. `on_event` is called from a thread of the services when
    /// replies or matches change, possibly before this returns.
    ///
    /// # Errors
    /// When a name is invalid or RustDDS refuses.
    pub fn client(&self, service: &ServiceDescription, on_event: Notify) -> Created<dyn CdrClient> {
        let ServiceNames { requests, replies } = dds_names(service)?;
        let topics = Topics { written: requests, read: replies, service: service.clone() };
        let mut clients = self.0.clients.lock();
        clients.retain(|(_, endpoints)| endpoints.strong_count() > 0);
        let known = clients.iter().find(|(known, _)| known == service);
        let endpoints = match known.and_then(|(_, endpoints)| endpoints.upgrade()) {
            Some(endpoints) => endpoints,
            None => {
                let endpoints = Arc::new(Endpoints::open(&self.0, topics)?);
                clients.push((service.clone(), Arc::downgrade(&endpoints)));
                endpoints
            }
        };
        Ok(Box::new(Client::new(endpoints, on_event)))
    }

    /// Creates a server and announces it. `on_event` is called as for [`RustServices::client`].
    ///
    /// # Errors
    /// When a name is invalid or RustDDS refuses.
    pub fn server(&self, service: &ServiceDescription, on_event: Notify) -> Created<dyn CdrServer> {
        let ServiceNames { requests, replies } = dds_names(service)?;
        let topics = Topics { written: replies, read: requests, service: service.clone() };
        Ok(Box::new(Server::new(ReopenedEndpoints::open(
            &self.0,
            "creating a server",
            topics,
            on_event,
        )?)))
    }

    fn existing(&self) -> Option<Arc<Participant>> {
        self.0.participant.lock().upgrade()
    }
}

/// Names of the requests and of the replies of a service.
fn dds_names(service: &ServiceDescription) -> GraphResult<ServiceNames> {
    let fault = |reason: String| GraphError::stack("naming", &service.name, &reason);
    NodeName::check_topic(&service.name).map_err(|error| fault(error.to_string()))?;
    names::service_to_dds(&service.name, &service.type_name)
        .map_err(|error| fault(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn service(name: &str, type_name: &str) -> ServiceDescription {
        ServiceDescription {
            name: name.into(),
            type_name: type_name.into(),
            type_hash: None,
            request_hash: None,
            response_hash: None,
            depth: 10,
            max_bytes: 1000,
        }
    }

    #[test]
    fn names_are_those_of_ros() {
        let ServiceNames { requests, replies } =
            dds_names(&service("/add_two_ints", "example_interfaces/srv/AddTwoInts")).unwrap();
        let type_of = |half| format!("example_interfaces::srv::dds_::AddTwoInts_{half}_");
        assert_eq!(requests, ("rq/add_two_intsRequest".into(), type_of("Request")));
        assert_eq!(replies, ("rr/add_two_intsReply".into(), type_of("Response")));
    }

    #[test]
    fn names_that_are_none_are_refused() {
        for (name, type_name) in
            [("add", "a/srv/B"), ("/a b", "a/srv/B"), ("/a", "B"), ("/a", "a/srv/B/C")]
        {
            let error = dds_names(&service(name, type_name)).unwrap_err();
            assert!(matches!(error, GraphError::Stack { operation: "naming", .. }), "{error:?}");
        }
    }
}
