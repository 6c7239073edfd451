//! Outputs of a port: made, listed, taken away.
//!
//! ```text
//!   [add] "tcp://dst" ─▶ query dst ─▶ end the old output to it ─▶ connect ─▶ Outbox + task
//! ```

use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::time::timeout;

use super::core::{Core, Role};
use super::datagrams;
use super::link::{Link, LinkError};
use super::message::Message;
use super::open::Admission;
use super::outbox::{Outbox, Put};
use super::output::{ConnectionStatus, Group, Kind, Output, Peer};
use super::pace::Pace;
use super::pictures;
use super::rpc_link::RpcLink;
use super::target::{self, Way};
use crate::task::erased;
use crate::wire::{Carrier, Fault, Sender, UnknownCarrier, admin, header};

/// Time that a receiver has to find that it lacks a modifier: it answers the header first, and then
/// closes.
const MODIFIER: Duration = Duration::from_millis(500);

/// Error of adding an output, as a whole sentence.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ConnectError(pub String);

impl Core {
    /// Connects to `destination`, `/name` or `carrier://name`; the sentence that says so.
    pub(super) async fn add_output(
        self: &Arc<Self>,
        destination: &str,
    ) -> Result<String, ConnectError> {
        let unknown = || ConnectError(format!("Do not know how to connect to {destination}"));
        let unreachable = |error: &dyn std::fmt::Display| {
            let name = &self.name;
            tracing::debug!(target: "wrapyfi_yarp::port", name, destination, %error, "connect");
            ConnectError(admin::unreachable_destination(destination))
        };
        let refused = |reason: &dyn std::fmt::Display| {
            let name = &self.name;
            tracing::warn!(target: "wrapyfi_yarp::port", name, destination, "connect refused: {reason}");
            ConnectError(format!("{}: {reason}", admin::unreachable_destination(destination)))
        };
        let (carrier, name) = admin::split_destination(destination).ok_or_else(unknown)?;
        let mut sender = Sender::new(self.name.clone());
        let carrier = carrier.map(|carrier| sender.qualify(carrier));
        let pull = carrier == Some(Carrier::Mjpeg.name());
        if self.role == Role::Input && !pull {
            return Err(ConnectError(admin::NO_OUTPUTS.to_owned()));
        }
        if let Some(modifier) = sender.sender_modifier() {
            let kind = &modifier.key;
            let what = modifier.value.as_deref().unwrap_or_default();
            let reason =
                format!("modifier {kind}.{what} is not available here: connect without it");
            return Err(refused(&reason));
        }
        if pull && !self.options.pictures {
            return Err(refused(&Fault::NoPictures(self.name.clone())));
        }
        let _one_at_a_time = self.adding.lock().await;
        if self.role == Role::Client && !self.connections.lock().outputs.is_empty() {
            return Err(ConnectError(admin::ONE_OUTPUT.to_owned()));
        }
        let found = match &self.name_service {
            Some(names) => names.requests.upgrade().and_then(|names| names.find(&name)),
            None => self.network.query(&name).await.map_err(|error| unreachable(&error))?,
        };
        let found = found.ok_or_else(unknown)?;
        let admitted = if pull { &self.options.senders } else { &self.options.readers };
        if let Err(fault) = Admission::check(admitted.as_ref(), &name, &found.host) {
            self.fault_counts.count(&fault);
            return Err(refused(&fault));
        }
        let carrier: Carrier = match carrier {
            Some(carrier) => carrier.parse().map_err(|error: UnknownCarrier| refused(&error))?,
            None => found.carrier.parse().unwrap_or(Carrier::Tcp),
        };
        let carrier = carrier.qualified(&sender);
        if self.name_service.is_some() && carrier.is_connectionless() {
            return Err(unreachable(&"changes are not told in datagrams"));
        }
        if self.is_full() {
            return Err(ConnectError(admin::NO_OUTPUTS.to_owned()));
        }
        let (contact, carrier_text) = (found.contact(), sender.carrier_text(carrier));
        let peer = Peer { name, carrier, carrier_text, contact };
        let made = if pull {
            pictures::pull(self, &peer.name, &peer.contact).await
        } else {
            self.remove_output(&peer.name).await;
            self.make_output(peer, sender).await
        };
        made.map_err(|error| match &error {
            LinkError::Fault(fault) if fault.is_refusal() => refused(fault),
            _ => unreachable(&error),
        })?;
        Ok(format!("Added connection from {} to {destination}", self.name))
    }

    async fn make_output(self: &Arc<Self>, peer: Peer, sender: Sender) -> Result<(), LinkError> {
        let (contact, carrier, options) =
            (&peer.contact, peer.carrier, self.network.link_options());
        if self.role == Role::Client {
            let link = RpcLink::new(contact.clone(), carrier, sender, options);
            link.connect().await?;
            self.enter_output(peer, Kind::Rpc(Arc::new(link)), None);
            return Ok(());
        }
        if carrier == Carrier::Mcast {
            let group = datagrams::group(self, contact).await?;
            let behind = header::encode_group(group.address);
            if let Err(error) = Link::open(contact, carrier, &sender, &behind, &options).await {
                datagrams::leave_group(self, group).await;
                return Err(error);
            }
            self.enter_output(peer, Kind::Group(group), None);
            return Ok(());
        }
        let mut link = Link::open(contact, carrier, &sender, &[], &options).await?;
        if sender.foreign_modifier().is_some()
            && let Ok(error) = timeout(MODIFIER, link.ended()).await
        {
            return Err(error);
        }
        let way = match carrier {
            Carrier::Udp => {
                let ((local, receiver), number) = (link.addresses()?, link.number);
                drop(link);
                let socket = udp_to(local, receiver, number).await?;
                Way::Datagrams { socket, pace: Pace::new() }
            }
            _ => Way::Stream(link),
        };
        self.start(peer, way);
        Ok(())
    }

    /// Enters an output and starts its task.
    pub(super) fn start(self: &Arc<Self>, peer: Peer, way: Way) {
        let socket = match &way {
            Way::Stream(link) => copy_of(&link.stream),
            Way::Datagrams { socket, .. } => copy_of(socket),
            Way::Reversed(_) | Way::Mjpeg(_) => None,
        };
        let outbox = Arc::new(self.new_outbox());
        let kind = Kind::Queue(Arc::clone(&outbox));
        let id = self.enter_output(peer, kind, socket);
        let core = Arc::clone(self);
        tokio::spawn(erased(async move {
            // Also when the task is dropped with its runtime.
            let _end = EndOnDrop { core: Arc::clone(&core), outbox: Arc::clone(&outbox), id };
            let ended = tokio::select! {
                biased;
                () = outbox.aborted() => return,
                ended = target::run(way, &outbox) => ended,
            };
            if let Err(error) = ended {
                let name = &core.name;
                tracing::debug!(target: "wrapyfi_yarp::port", name, %error, "output ended");
                core.fault_counts.add("output_ended");
            }
        }));
    }

    /// Puts an output on the list; its number there.
    fn enter_output(&self, peer: Peer, kind: Kind, socket: Option<Arc<OwnedFd>>) -> u64 {
        let mut connections = self.connections.lock();
        let id = Self::new_id(&mut connections);
        let output = Output { id, peer, kind, socket };
        connections.outputs.push(output);
        self.ring(&connections);
        id
    }

    /// Takes an output off the list.
    fn leave_output(&self, id: u64) {
        let mut connections = self.connections.lock();
        connections.outputs.retain(|output| output.id != id);
        self.ring(&connections);
    }

    /// Ends the output to `name`, as it was given or with its slash; whether there was one.
    pub(super) async fn remove_output(self: &Arc<Self>, name: &str) -> bool {
        let found = {
            let connections = self.connections.lock();
            let ids = connections.outputs.iter().filter(|output| output.peer.name == name);
            ids.map(|output| output.id).collect::<Vec<_>>()
        };
        for id in &found {
            self.end_output(*id).await;
        }
        !found.is_empty()
    }

    /// Says goodbye to an output, once what waits is sent.
    pub(super) async fn end_output(self: &Arc<Self>, id: u64) {
        let limit = self.network.0.timeouts.close;
        let found = {
            let connections = self.connections.lock();
            let found = connections.outputs.iter().find(|output| output.id == id);
            found.map(|output| {
                (output.kind.clone(), output.peer.carrier, output.peer.contact.clone())
            })
        };
        let Some((kind, carrier, contact)) = found else { return };
        match &kind {
            Kind::Queue(outbox) => {
                outbox.close();
                if timeout(limit, outbox.ended()).await.is_err() {
                    // Its task finds this out by itself, if it ever moves again.
                    self.fault_counts.add("goodbye_timeout");
                    outbox.abort();
                }
            }
            Kind::Group(group) => {
                timeout(limit, group.outbox.drained()).await.ok();
            }
            Kind::Rpc(link) => link.close().await,
        }
        // A queue's task may have done this.
        self.leave_output(id);
        if carrier.is_connectionless() {
            let gone = self.network.tell_gone(&contact, &self.name);
            if !matches!(timeout(limit, gone).await, Ok(Ok(()))) {
                self.fault_counts.add("goodbye_failed");
            }
        }
        if let Kind::Group(group) = kind {
            datagrams::leave_group(self, group).await;
        }
    }

    /// Number of targets of carrier mjpeg.
    pub(super) fn picture_readers(&self) -> usize {
        let connections = self.connections.lock();
        connections.outputs.iter().filter(|output| output.peer.carrier == Carrier::Mjpeg).count()
    }

    /// Puts a message in front of every target whose carrier is meant.
    pub(crate) fn write(&self, message: Message, meant: impl Fn(Carrier) -> bool) -> Written {
        let message = Arc::new(message);
        let mut written = Written::default();
        let connections = self.connections.lock();
        let mut groups: Vec<*const Group> = Vec::new();
        for output in connections.outputs.iter().filter(|output| meant(output.peer.carrier)) {
            let outbox = match &output.kind {
                Kind::Queue(outbox) => outbox,
                // One datagram reaches all of them.
                Kind::Group(group) => {
                    if groups.contains(&Arc::as_ptr(group)) {
                        continue;
                    }
                    groups.push(Arc::as_ptr(group));
                    &group.outbox
                }
                Kind::Rpc(_) => continue,
            };
            let put = outbox.push(&message);
            written.targets += usize::from(put != Put::Gone);
            written.dropped += usize::from(matches!(put, Put::Full | Put::NoRoom));
            written.over_budget += usize::from(put == Put::NoRoom);
        }
        written
    }

    /// The queues of all targets.
    pub(super) fn outboxes(&self) -> Vec<Arc<Outbox>> {
        let connections = self.connections.lock();
        let kinds = connections.outputs.iter().filter_map(|output| match &output.kind {
            Kind::Queue(outbox) => Some(Arc::clone(outbox)),
            Kind::Group(group) => Some(Arc::clone(&group.outbox)),
            Kind::Rpc(_) => None,
        });
        kinds.collect()
    }

    /// State of every connection.
    pub(super) fn status(&self) -> Vec<ConnectionStatus> {
        let connections = self.connections.lock();
        let inputs = connections.inputs.iter().map(|input| input.status.clone());
        let outputs = connections.outputs.iter().map(|output| ConnectionStatus {
            name: output.peer.name.clone(),
            carrier: output.peer.carrier_text.clone(),
            incoming: false,
            connectionless: output.peer.carrier.is_connectionless(),
            push: output.peer.carrier.is_push(),
        });
        inputs.chain(outputs).collect()
    }
}

/// Result of writing a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Written {
    /// Queues that it went to.
    pub targets: usize,
    /// Queues that were full, so that a message was dropped.
    pub dropped: usize,
    /// Number of those queues that had a place, but no room for the message's bytes.
    pub over_budget: usize,
}

struct EndOnDrop {
    core: Arc<Core>,
    outbox: Arc<Outbox>,
    id: u64,
}

impl Drop for EndOnDrop {
    fn drop(&mut self) {
        self.outbox.end();
        self.core.leave_output(self.id);
    }
}

/// A socket on the same local port as the handshake had, as YARP does it.
async fn udp_to(local: SocketAddr, peer: SocketAddr, number: i32) -> Result<UdpSocket, LinkError> {
    let port = u16::try_from(number).ok().filter(|&port| port > 0);
    let port = port.ok_or_else(|| LinkError::Unsendable {
        carrier: Carrier::Udp,
        reason: format!("the receiver named {number} as its port"),
    })?;
    let socket = match UdpSocket::bind(local).await {
        Ok(socket) => socket,
        // No reader looks at the number that datagrams come from.
        Err(_) => UdpSocket::bind(SocketAddr::new(local.ip(), 0)).await?,
    };
    socket.connect(SocketAddr::new(peer.ip(), port)).await?;
    datagrams::widen(&socket);
    Ok(socket)
}

/// A second handle of a socket, for its options.
fn copy_of(socket: &impl std::os::fd::AsFd) -> Option<Arc<OwnedFd>> {
    socket.as_fd().try_clone_to_owned().ok().map(Arc::new)
}
