//! The participant of the services of a node, from the first service to the last.
//!
//! ```text
//!   client, server ─ Arc ─▶ Participant { watch, announcement, RustDDS }
//!                           ends: thread, empty announcement, RustDDS's own threads, goodbye
//! ```

use std::sync::{Arc, Weak};

use rustdds::dds::CreateError;
use rustdds::policy::{Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, Publisher, QosPolicies, QosPolicyBuilder,
    RTPSEntity as _, Subscriber, Topic, TopicKind,
};

use super::announce::Announcement;
use super::changes::Changes;
use super::client::Endpoints;
use super::goodbye::Goodbye;
use super::outgoing::{MAX_BLOCKING, Writer};
use super::pair::{Pair, Reader};
use super::ports;
use super::settings::{Settings, WholeSamples};
use super::watch::Watch;
use crate::discovery_info::{Gid, TOPIC};
use crate::graph::{GraphError, GraphResult, Notify, ServiceDescription};
use wrapyfi_endpoint::Mutex;

/// Fields drop in this order, after the announcement's end.
pub(super) struct Participant {
    watch: Watch,
    announcement: Mutex<Announcement>,
    changes: Arc<Changes>,
    whole: WholeSamples,
    publisher: Publisher,
    subscriber: Subscriber,
    dds: DomainParticipant,
    /// Last: what RustDDS still said would make it be there again.
    _goodbye: Goodbye,
}

/// State that the services of one node share: its settings, its participant while there is one, and who hears of changes.
pub(super) struct ServicesState {
    pub(super) settings: Settings,
    pub(super) participant: Mutex<Weak<Participant>>,
    pub(super) changes: Arc<Changes>,
    /// True once the log has what carries the services of the node.
    pub(super) is_told: Arc<Mutex<bool>>,
    /// Endpoints of the clients of each service.
    pub(super) clients: Mutex<Vec<(ServiceDescription, Weak<Endpoints>)>>,
}

impl ServicesState {
    /// The participant, created where there is none, and where the one there was has ended.
    pub(super) fn participant(&self) -> GraphResult<Arc<Participant>> {
        let mut known = self.participant.lock();
        if let Some(participant) = known.upgrade().filter(|it| !it.has_ended()) {
            return Ok(participant);
        }
        let participant = Participant::new(&self.settings, &self.changes, &self.is_told)?;
        *known = Arc::downgrade(&participant);
        Ok(participant)
    }
}

/// Names and quality of service of the two topics of a service.
pub(super) struct Topics {
    /// DDS topic and type of what is written.
    pub(super) written: (String, String),
    /// Topic and type that the end reads.
    pub(super) read: (String, String),
    /// The service.
    pub(super) service: ServiceDescription,
}

impl Participant {
    /// Joins the domain.
    pub(super) fn new(
        settings: &Settings,
        changes: &Arc<Changes>,
        is_told: &Mutex<bool>,
    ) -> GraphResult<Arc<Self>> {
        let node = settings.node.fqn();
        let fault = |error: &dyn std::fmt::Display| {
            GraphError::stack("creating the participant of services", &node, &error)
        };
        let mut builder = DomainParticipantBuilder::new(settings.domain_id)
            .socket_receive_buffer_size(SOCKET_BUFFER)
            .socket_send_buffer_size(SOCKET_BUFFER);
        if let Some(networks) = &settings.networks {
            builder = builder.with_only_networks(networks.iter().copied());
        }
        let kept = ports::keep_half_free(settings.domain_id);
        let dds = builder.build().map_err(|error| fault(&error))?;
        drop(kept);
        let watch = Watch::new(&dds, settings).map_err(|error| fault(&error))?;
        let make = || {
            let publisher = dds.create_publisher(&QosPolicies::qos_none())?;
            let subscriber = dds.create_subscriber(&QosPolicies::qos_none())?;
            let topic = topic(&dds, (TOPIC, Announcement::DDS_TYPE), &Announcement::qos())?;
            let announcement = Announcement::new(&publisher, &topic, dds.guid(), settings)?;
            Ok((publisher, subscriber, announcement))
        };
        let (publisher, subscriber, announcement) =
            make().map_err(|error: CreateError| fault(&error))?;
        // The second participant of the node has the same.
        if !std::mem::replace(&mut *is_told.lock(), true) {
            tracing::info!(
                node,
                domain = settings.domain_id,
                networks = ?settings.networks,
                "services of the Fast DDS mapping are on RustDDS"
            );
        }
        let goodbye = Goodbye::new(settings, &announcement.participant);
        Ok(Arc::new(Self {
            watch,
            announcement: Mutex::new(announcement),
            changes: Arc::clone(changes),
            whole: settings.whole,
            publisher,
            subscriber,
            dds,
            _goodbye: goodbye,
        }))
    }

    /// GUID of the participant.
    pub(super) fn gid(&self) -> Gid {
        self.announcement.lock().participant
    }

    /// Creates one end of a service and announces it.
    pub(super) fn open(
        self: &Arc<Self>,
        operation: &'static str,
        topics: &Topics,
        notify: Notify,
    ) -> GraphResult<Opened> {
        let service = &topics.service;
        let pair = self
            .watch
            .add(|| self.endpoints_of(topics), |ends| Pair::new(service, self.whole, ends, notify))
            .map_err(|error| GraphError::stack(operation, &service.name, &error))?;
        let (reader, writer) = (pair.reader_guid().to_bytes(), pair.writer_guid().to_bytes());
        self.change(|announcement| announcement.add(reader, writer));
        Ok(Opened { pair, listed: Listed { participant: Arc::clone(self), reader, writer } })
    }

    fn endpoints_of(&self, topics: &Topics) -> Result<(Writer, Reader), CreateError> {
        let qos = qos(topics.service.depth);
        let named = |(name, type_name): &(String, String)| {
            topic(&self.dds, (name.as_str(), type_name.as_str()), &qos)
        };
        let (written, read) = (named(&topics.written)?, named(&topics.read)?);
        // The reader first, so that a client can hear the reply to what its writer sends.
        let reader = self.subscriber.create_simple_datareader_no_key(&read, Some(qos.clone()))?;
        let writer = self.publisher.create_datawriter_no_key(&written, Some(qos.clone()))?;
        Ok((writer, reader))
    }

    /// True once RustDDS has ended beneath: nothing is sent or heard any more.
    pub(super) fn has_ended(&self) -> bool {
        self.watch.has_ended()
    }

    /// Changes the announcement, then tells the owner. One that no program would hear is left alone: the
    /// participant that follows announces what there is.
    fn change(&self, change: impl FnOnce(&mut Announcement)) {
        if self.has_ended() {
            return;
        }
        let mut announcement = self.announcement.lock();
        change(&mut announcement);
        self.changes.set(&announcement.endpoints);
    }
}

impl Drop for Participant {
    fn drop(&mut self) {
        if !self.has_ended() {
            self.announcement.lock().retire();
        }
    }
}

/// One end of a service. Fields drop in this order: its endpoints, then their entry, then perhaps
/// the participant.
pub(super) struct Opened {
    /// Endpoints of the client or server.
    pub(super) pair: Arc<Pair>,
    listed: Listed,
}

impl Opened {
    /// True once RustDDS has ended beneath.
    pub(super) fn has_ended(&self) -> bool {
        self.listed.participant.has_ended()
    }
}

/// The entry of a service in the announcement, removed on drop.
struct Listed {
    participant: Arc<Participant>,
    reader: Gid,
    writer: Gid,
}

impl Drop for Listed {
    fn drop(&mut self) {
        self.participant.change(|announcement| announcement.remove(&self.reader, &self.writer));
    }
}

/// Asked of the kernel for sockets: RustDDS sends large samples in one burst.
const SOCKET_BUFFER: usize = 4 << 20;

/// Unacknowledged samples after which a writer waits, where the depth says less. RustDDS waits for a reader that was
/// killed until its lease is over, 20 s on Fast DDS: this many replies go to the others meanwhile.
const MIN_WINDOW: i32 = 512;

fn qos(depth: u32) -> QosPolicies {
    let depth = i32::try_from(depth.max(1)).unwrap_or(i32::MAX);
    let max_samples = depth.max(MIN_WINDOW);
    let blocking_ms = i64::try_from(MAX_BLOCKING.as_millis()).unwrap_or(i64::MAX);
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable {
            max_blocking_time: rustdds::Duration::from_millis(blocking_ms),
        })
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth })
        .resource_limits(ResourceLimits {
            max_samples,
            max_instances: 1,
            max_samples_per_instance: max_samples,
        })
        .build()
}

fn topic(
    dds: &DomainParticipant,
    (name, type_name): (&str, &str),
    qos: &QosPolicies,
) -> Result<Topic, CreateError> {
    dds.create_topic(name.to_owned(), type_name.to_owned(), qos, TopicKind::NoKey)
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, UdpSocket};
    use std::time::Duration;

    use super::super::{RustServices, foreign_tests::adder};
    use super::*;
    use crate::config::CycloneConfig;
    use crate::graph::{Peers, wait_until};
    use wrapyfi_endpoint::Wake;
    use wrapyfi_node::NodeName;

    #[test]
    fn writers_announce_the_port_that_is_listened_on() {
        let domain_id = 71 + std::process::id() % 10;
        let data = ports::discovery(u16::try_from(domain_id).unwrap(), 0).unwrap() + 1;
        // As any socket of this host may have it.
        let _taken = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, data));
        let services = |node| {
            let node = NodeName::new(node, "/").unwrap();
            RustServices::new(&CycloneConfig::loopback(node, domain_id)).unwrap()
        };
        let (service, wake) = (adder(), Wake::new());
        let bell = wake.clone();
        let (ours, theirs) = (services("ours"), services("theirs"));
        let _server = ours.server(&service, Arc::new(|| {})).unwrap();
        let client = theirs.client(&service, Arc::new(move || bell.ring())).unwrap();
        let is_ready = || matches!(client.servers(), Peers::Ready(_));
        assert!(wait_until(&wake, Duration::from_secs(30), is_ready), "{:?}", client.servers());
        let participant = theirs.existing().unwrap();
        let of_ours = |topic: &str| topic.contains(&service.name);
        let readers = participant.dds.discovered_readers();
        let reader = readers.iter().find(|it| of_ours(it.subscription_topic_data.topic_name()));
        let writers = participant.dds.discovered_writers();
        let writer = writers.iter().find(|it| of_ours(it.publication_topic_data.topic_name()));
        let heard = &reader.unwrap().reader_proxy.unicast_locator_list;
        assert_eq!(&writer.unwrap().writer_proxy.unicast_locator_list, heard);
    }
}
