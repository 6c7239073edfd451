//! Common part of every port: a listening socket, its connections, its properties.
//!
//! ```text
//!   listener ─ accept ─▶ one task a connection (connection.rs) ──▶ Sink: inbox, handler, nothing
//!                            │ admin, commands (administration.rs)
//!                            ▼
//!   write ─▶ outputs: one Outbox and one task each (target.rs)
//! ```

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::timeout;
use wrapyfi_retry::restart::restarted;

use super::connection;
use super::inbox::Inbox;
use super::link::Link;
use super::message::Received;
use super::network::Network;
use super::open::{self, OpenError, PortOptions};
use super::outputs::Output;
use super::session::{Answer, SessionOptions};
use super::{Counters, Overflow};
use crate::{Bottle, Limits};

/// A future that a handler of requests gives back.
pub(super) type Answering = Pin<Box<dyn Future<Output = Answer> + Send>>;

/// Destination of the data of a port's inputs.
pub(super) enum Sink {
    /// Queue of the owner.
    Inbox(Arc<Inbox>),
    /// Function, called on the connection's own task.
    Handler(Box<dyn Fn(Received, bool) -> Answering + Send + Sync>),
    /// No destination: messages are acknowledged all the same.
    Nobody,
}

/// Abilities of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Role {
    /// True when outputs may be added.
    pub(super) outputs: bool,
    /// True when there may be one output only, for requests.
    pub(super) client: bool,
    /// Strict readers acknowledge when a message was taken.
    pub(super) when_taken: bool,
    /// Room of each output's queue.
    pub(super) queue: usize,
    /// Message that gives way when the queue is full.
    pub(super) overflow: Overflow,
}

impl Default for Role {
    fn default() -> Self {
        Self {
            outputs: false,
            client: false,
            when_taken: false,
            queue: 1,
            overflow: Overflow::default(),
        }
    }
}

/// An input, as the port knows it.
#[derive(Debug)]
pub(super) struct Input {
    pub(super) id: u64,
    pub(super) name: String,
    pub(super) carrier: String,
    pub(super) connectionless: bool,
    pub(super) push: bool,
    pub(super) stop: Arc<Notify>,
    pub(super) messages: Arc<AtomicU64>,
}

#[derive(Default)]
pub(super) struct Connections {
    pub(super) inputs: Vec<Input>,
    pub(super) outputs: Vec<Output>,
    pub(super) properties: BTreeMap<String, Bottle>,
    next_id: u64,
}

/// Number of connections of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Connected {
    /// Number of connections that bring data.
    pub inputs: usize,
    /// Number of connections that take data away.
    pub outputs: usize,
}

pub(super) struct Core {
    pub(super) name: String,
    pub(super) network: Network,
    pub(super) address: SocketAddr,
    pub(super) contact: String,
    registered: bool,
    /// True when the owner says that the port is for requests.
    pub(super) rpc: bool,
    /// Type that the owner says the port carries.
    pub(super) type_name: Option<String>,
    /// True when carrier mjpeg is taken.
    pub(super) pictures: bool,
    pub(super) role: Role,
    pub(super) sink: Sink,
    pub(super) session: SessionOptions,
    pub(super) limits: Arc<Limits>,
    pub(super) counters: Arc<Counters>,
    connections: Mutex<Connections>,
    pub(super) connected: watch::Sender<Connected>,
    /// One output is added at a time.
    pub(super) adding: tokio::sync::Mutex<()>,
    pub(super) closing: watch::Sender<bool>,
    closed: watch::Sender<bool>,
}

/// The owner's end of a port: dropping it closes the port.
pub(super) struct Owner {
    pub(super) core: Arc<Core>,
}

impl std::fmt::Debug for Owner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Core { name, address, .. } = &*self.core;
        f.debug_struct("Port").field("name", name).field("address", address).finish_non_exhaustive()
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.core.closing.send_replace(true);
    }
}

impl Owner {
    /// Says goodbye to everybody and unregisters; returns when that is done, or gave up.
    pub(super) async fn close(&self) {
        self.core.closing.send_replace(true);
        let mut closed = self.core.closed.subscribe();
        // The sender lives as long as the core, which this holds.
        closed.wait_for(|closed| *closed).await.ok();
    }
}

impl Core {
    pub(super) async fn open(
        network: &Network,
        name: &str,
        options: &PortOptions,
        role: Role,
        sink: Sink,
    ) -> Result<Owner, OpenError> {
        let opened = open::open(network, name, options).await?;
        let counters = Arc::new(Counters::default());
        let session = SessionOptions {
            dialect: network.dialect(),
            limits: network.limits().clone(),
            handshake_timeout: network.0.timeouts.handshake,
            progress_timeout: network.0.timeouts.progress,
            rooms: network.0.rooms,
            own_port: opened.address.port(),
            runtime_folder: network.0.environment.runtime_folder(),
            counters: Arc::clone(&counters),
        };
        let core = Arc::new(Self {
            name: opened.name,
            network: network.clone(),
            address: opened.address,
            contact: opened.contact,
            registered: options.register,
            rpc: options.rpc || role.client,
            type_name: options.type_name.clone(),
            pictures: options.pictures,
            role,
            sink,
            session,
            limits: Arc::new(network.limits().clone()),
            counters,
            connections: Mutex::default(),
            connected: watch::Sender::new(Connected::default()),
            adding: tokio::sync::Mutex::new(()),
            closing: watch::Sender::new(false),
            closed: watch::Sender::new(false),
        });
        tokio::spawn(Arc::clone(&core).keep(opened.listener));
        if options.register {
            open::announce(network, &core.name, opened.address.ip()).await;
        }
        Ok(Owner { core })
    }

    pub(super) fn connections(&self) -> std::sync::MutexGuard<'_, Connections> {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A number that no other connection of this port has.
    pub(super) fn new_id(connections: &mut Connections) -> u64 {
        connections.next_id += 1;
        connections.next_id
    }

    /// Tells those who watch how many connections there are.
    pub(super) fn ring(&self, connections: &Connections) {
        let (inputs, outputs) = (connections.inputs.len(), connections.outputs.len());
        let now = Connected { inputs, outputs };
        self.connected.send_if_modified(|known| std::mem::replace(known, now) != now);
    }

    /// Takes connections until the port closes, then ends what it has.
    async fn keep(self: Arc<Self>, listener: TcpListener) {
        let (port, listener) = (Arc::clone(&self), Arc::new(listener));
        let counted = Arc::clone(&self);
        restarted(
            format!("YARP port {}", self.name),
            move |_why| counted.counters.add("port_panicked"),
            move || Arc::clone(&port).attend(Arc::clone(&listener)),
        )
        .await;
        // Those that said no goodbye in time: what waits for them is lost.
        self.outboxes().iter().for_each(|outbox| outbox.abort());
        if let Sink::Inbox(inbox) = &self.sink {
            inbox.close();
        }
        if self.registered
            && let Err(error) = self.network.names().unregister(&self.name).await
        {
            tracing::warn!(target: "wrapyfi_yarp::port", name = self.name, %error, "unregister");
        }
        self.closed.send_replace(true);
    }

    /// Takes connections until the port closes, and says goodbye.
    async fn attend(self: Arc<Self>, listener: Arc<TcpListener>) {
        let mut closing = self.closing.subscribe();
        let room = Arc::new(Semaphore::new(self.session.limits.max_connections));
        let mut tasks = JoinSet::new();
        // Connections are taken until it is done: some peers say goodbye on one of their own.
        let goodbye = async {
            // The sender lives as long as this port.
            closing.wait_for(|closing| *closing).await.ok();
            let limit = self.network.0.timeouts.close;
            if timeout(limit, self.say_goodbye()).await.is_err() {
                self.counters.add("goodbye_timeout");
            }
        };
        tokio::pin!(goodbye);
        loop {
            let accepted = tokio::select! {
                () = &mut goodbye => break,
                accepted = listener.accept() => accepted,
                Some(ended) = tasks.join_next() => {
                    if ended.is_err_and(|error| error.is_panic()) {
                        self.counters.add("connection_panicked");
                    }
                    continue;
                }
            };
            match accepted {
                Ok((stream, _)) => match Arc::clone(&room).try_acquire_owned() {
                    Ok(permit) => {
                        let core = Arc::clone(&self);
                        tasks.spawn(async move {
                            connection::run(core, stream).await;
                            drop(permit);
                        });
                    }
                    Err(_) => self.counters.add("too_many_connections"),
                },
                Err(error) => {
                    // Out of file descriptors, mostly: only time helps.
                    self.counters.add("accept_failed");
                    tracing::warn!(target: "wrapyfi_yarp::port", name = self.name, %error, "accept");
                    tokio::time::sleep(Duration::from_millis(50)).await;
                }
            }
        }
        drop(listener);
        tasks.shutdown().await;
    }

    /// Asks those who send to this port to stop, and ends the outputs.
    async fn say_goodbye(self: &Arc<Self>) {
        let (senders, outputs) = {
            let connections = self.connections();
            let inputs = connections.inputs.iter().filter(|input| input.push);
            let rooted = inputs.filter(|input| input.name.starts_with('/'));
            let senders: Vec<_> = rooted.map(|input| input.name.clone()).collect();
            let outputs: Vec<_> = connections.outputs.iter().map(|output| output.id).collect();
            (senders, outputs)
        };
        let mut goodbyes = JoinSet::new();
        for sender in senders {
            let core = Arc::clone(self);
            goodbyes.spawn(async move {
                if let Err(error) = core.network.disconnect(&sender, &core.name).await {
                    let name = &core.name;
                    tracing::debug!(target: "wrapyfi_yarp::port", name, sender, %error, "goodbye");
                }
            });
        }
        for id in outputs {
            let core = Arc::clone(self);
            goodbyes.spawn(async move { core.end_output(id).await });
        }
        while goodbyes.join_next().await.is_some() {}
    }

    /// A connection whose peer reads from now on.
    pub(super) fn reversed(&self, stream: TcpStream) -> Link {
        Link::reversed(stream, self.network.link_options())
    }
}
