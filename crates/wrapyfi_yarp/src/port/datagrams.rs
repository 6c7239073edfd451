//! udp and mcast: where datagrams go to, and where they come from.
//!
//! ```text
//!   sender ── TCP: header, name ─▶ receiver          udp:   ◀── number of its UDP port, TCP closes
//!                                                    mcast: group address behind the name, TCP closes
//!          ══ UDP: CRC, counter, bytes ═══▶ Assembler ─▶ inbox
//! ```

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4};
use std::sync::Arc;

use socket2::{Domain, Protocol, SockRef, Socket, Type};
use tokio::net::UdpSocket;

use super::core::Core;
use super::entered::Entered;
use super::link::LinkError;
use super::names::NameRequest;
use super::output::{Group, Kind};
use super::pace::Pace;
use super::room::{Begun, progress};
use super::session::{Data, Session};
use super::target::{self, Way};
use crate::task::erased;
use crate::wire::datagram::Assembler;
use crate::wire::{Command, Incoming, number};

/// Bytes that the system is asked to keep of a socket's datagrams: an image or two.
const SOCKET_BUFFER: usize = 4 << 20;
/// Largest datagram there is.
const DATAGRAM: usize = 65_536;
/// Group that YARP sends to when the name server gives none.
const DEFAULT_GROUP: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(224, 3, 1, 1), 11_000);

/// Asks for large buffers; the system gives what it allows.
pub(super) fn widen(socket: &UdpSocket) {
    let socket = SockRef::from(socket);
    socket.set_recv_buffer_size(SOCKET_BUFFER).ok();
    socket.set_send_buffer_size(SOCKET_BUFFER).ok();
}

/// The group of a port on the interface that leads to `contact`; made when it is the first.
pub(super) async fn group(core: &Arc<Core>, contact: &str) -> Result<Arc<Group>, LinkError> {
    let interface = interface_to(contact).await?;
    let known = core.connections.lock().outputs.iter().find_map(|output| match &output.kind {
        Kind::Group(group) if group.interface == interface => Some(Arc::clone(group)),
        _ => None,
    });
    if let Some(group) = known {
        return Ok(group);
    }
    let names = core.network.names();
    let request = NameRequest {
        name: "...".to_owned(),
        carrier: Some("mcast".to_owned()),
        ..NameRequest::default()
    };
    let (mut name, mut address) = (None, DEFAULT_GROUP);
    match names.register(&request).await {
        Ok(found) => {
            let ip = found.host.parse::<Ipv4Addr>().ok().filter(Ipv4Addr::is_multicast);
            if let Some(ip) = ip.filter(|_| found.port > 0) {
                address = SocketAddrV4::new(ip, found.port);
            }
            // The program that removes this port's name removes the group with it.
            names.set(&core.name, "owns", std::slice::from_ref(&found.name)).await.ok();
            name = Some(found.name);
        }
        Err(error) => {
            tracing::warn!(target: "wrapyfi_yarp::port", name = core.name, %error, "no group");
        }
    }
    let socket = group_sender(interface, address)?;
    let outbox = Arc::new(core.new_outbox());
    let group = Arc::new(Group { interface, address, name, outbox: Arc::clone(&outbox) });
    let core = Arc::clone(core);
    tokio::spawn(erased(async move {
        let way = Way::Datagrams { socket, pace: Pace::new() };
        if let Err(error) = target::run(way, &outbox).await {
            let name = &core.name;
            tracing::warn!(target: "wrapyfi_yarp::port", name, %error, "group ended");
            core.fault_counts.add("output_ended");
        }
        outbox.end();
    }));
    Ok(group)
}

/// Ends the group when no reader is left to send to.
pub(super) async fn leave_group(core: &Core, group: Arc<Group>) {
    let used = core
        .connections
        .lock()
        .outputs
        .iter()
        .any(|output| matches!(&output.kind, Kind::Group(other) if Arc::ptr_eq(other, &group)));
    if used {
        return;
    }
    group.outbox.close();
    if let Some(name) = &group.name
        && let Err(error) = core.network.names().unregister(name).await
    {
        tracing::debug!(target: "wrapyfi_yarp::port", name, %error, "group stays registered");
    }
}

/// The address that datagrams to `contact` leave from.
async fn interface_to(contact: &str) -> Result<Ipv4Addr, LinkError> {
    let connect = |error| LinkError::Connect { address: contact.to_owned(), error };
    let probe = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).await?;
    probe.connect(contact).await.map_err(connect)?;
    match probe.local_addr()?.ip() {
        IpAddr::V4(interface) => Ok(interface),
        IpAddr::V6(_) => Err(connect(io::ErrorKind::Unsupported.into())),
    }
}

fn group_sender(interface: Ipv4Addr, group: SocketAddrV4) -> io::Result<UdpSocket> {
    let socket = multicast_socket(SocketAddrV4::new(interface, 0), interface)?;
    socket.connect(&SocketAddr::V4(group).into())?;
    opened(socket)
}

fn group_receiver(interface: Ipv4Addr, group: SocketAddrV4) -> io::Result<UdpSocket> {
    let socket = multicast_socket(group, Ipv4Addr::UNSPECIFIED)?;
    socket.join_multicast_v4(group.ip(), &interface)?;
    opened(socket)
}

/// A socket at `address`, which those of other programs on this machine may have, too. What it sends leaves through
/// `interface`, and is heard on this machine.
pub(crate) fn multicast_socket(address: SocketAddrV4, interface: Ipv4Addr) -> io::Result<Socket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    socket.set_reuse_address(true)?;
    socket.bind(&address.into())?;
    if !interface.is_unspecified() {
        socket.set_multicast_if_v4(&interface)?;
    }
    socket.set_multicast_loop_v4(true)?;
    Ok(socket)
}

fn opened(socket: Socket) -> io::Result<UdpSocket> {
    let socket = UdpSocket::from_std(socket.into())?;
    widen(&socket);
    Ok(socket)
}

/// Goes on where a session of udp or mcast has read its header.
pub(super) async fn receive(core: Arc<Core>, session: Session) {
    let opened = async {
        let local = session.stream.tcp().ok_or(io::ErrorKind::Unsupported)?.local_addr()?.ip();
        match session.group {
            Some(group) if group.ip().is_multicast() => match local {
                IpAddr::V4(interface) => group_receiver(interface, group),
                IpAddr::V6(_) => Err(io::ErrorKind::Unsupported.into()),
            },
            Some(_) => Err(io::ErrorKind::InvalidInput.into()),
            None => {
                let socket = UdpSocket::bind((local, 0)).await?;
                widen(&socket);
                let port = i32::from(socket.local_addr()?.port());
                session.stream.write_all(&[&number::encode(port)]).await?;
                Ok(socket)
            }
        }
    };
    let (port, name) = (&core.name, &session.name);
    let socket = match opened.await {
        Ok(socket) => socket,
        Err(error) => {
            tracing::warn!(target: "wrapyfi_yarp::port", port, name, %error, "no datagrams");
            core.fault_counts.add("no_datagrams");
            return;
        }
    };
    let entered = Entered::new(&core, &session);
    drop(session);
    tokio::select! {
        biased;
        () = entered.stop.notified() => {}
        error = read(&core, &entered, &socket) => {
            tracing::warn!(target: "wrapyfi_yarp::port", port, %error, "datagrams ended");
        }
    }
}

async fn read(core: &Core, entered: &Entered, socket: &UdpSocket) -> io::Error {
    let mut datagram = vec![0; DATAGRAM];
    let mut assembler = Assembler::new(core.network.limits());
    let mut room = Begun::new(core.network.0.rooms);
    let mut last = None;
    loop {
        if let Err(fault) = room.hold(assembler.begun()) {
            core.fault_counts.count(&fault);
            assembler.restart();
            continue;
        }
        let received = socket.recv(&mut datagram);
        let limit = core.network.0.timeouts.progress;
        let size = match progress(assembler.has_begun(), limit, received).await {
            Ok(Ok(size)) => size,
            Ok(Err(error)) => return error,
            Err(fault) => {
                core.fault_counts.count(&fault);
                assembler.restart();
                continue;
            }
        };
        match assembler.push(datagram.get(..size).unwrap_or_default()) {
            Ok(Some(Incoming { command: Command::Data { envelope, .. }, body })) => {
                last = envelope.or(last);
                let data = Data { body, envelope: last.clone(), reply: false };
                entered.deliver(data).await;
            }
            Ok(_) => {}
            Err(fault) => core.fault_counts.count(&fault),
        }
    }
}
