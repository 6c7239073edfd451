//! Life of a port: opened, taking connections, saying goodbye.

use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout;
use wrapyfi_retry::Mutex;
use wrapyfi_retry::restart::restarted;

use super::accept::accept;
use super::connection;
use super::core::{Connected, Core, Handler, Role};
use super::counters::Counters;
use super::network::Network;
use super::open::{self, OpenError, PortOptions};
use super::session::SessionOptions;

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
    /// Opens a port and takes connections from now on.
    pub(super) async fn open(
        network: &Network,
        name: &str,
        options: &PortOptions,
        role: Role,
        handler: Option<Handler>,
    ) -> Result<Self, OpenError> {
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
            admission: options.senders.clone(),
        };
        let core = Arc::new(Core {
            name: opened.name,
            network: network.clone(),
            address: opened.address,
            contact: opened.contact,
            registered: options.register,
            rpc: options.rpc || role == Role::Client,
            pictures: options.pictures,
            readers: options.readers.clone(),
            role,
            handler,
            queue: options.queue,
            overflow: options.overflow,
            session,
            limits: Arc::new(network.limits().clone()),
            counters,
            connections: Mutex::default(),
            connected: watch::Sender::new(Connected::default()),
            adding: tokio::sync::Mutex::new(()),
            closing: watch::Sender::new(false),
            closed: watch::Sender::new(false),
        });
        tokio::spawn(keep(Arc::clone(&core), opened.listener));
        if options.register {
            open::announce(network, &core.name, opened.address.ip()).await;
        }
        Ok(Self { core })
    }

    /// Says goodbye to everybody and unregisters; returns when that is done, or gave up.
    pub(super) async fn close(&self) {
        self.core.closing.send_replace(true);
        let mut closed = self.core.closed.subscribe();
        // The sender lives as long as the core, which this holds.
        closed.wait_for(|closed| *closed).await.ok();
    }
}

/// Takes connections until the port closes, then ends what it has.
async fn keep(core: Arc<Core>, listener: TcpListener) {
    let (port, listener) = (Arc::clone(&core), Arc::new(listener));
    let counted = Arc::clone(&core);
    restarted(
        format!("YARP port {}", core.name),
        move |_why| counted.counters.add("port_panicked"),
        move || attend(Arc::clone(&port), Arc::clone(&listener)),
    )
    .await;
    // Those that said no goodbye in time: what waits for them is lost.
    core.outboxes().iter().for_each(|outbox| outbox.abort());
    if core.registered
        && let Err(error) = core.network.names().unregister(&core.name).await
    {
        tracing::warn!(target: "wrapyfi_yarp::port", name = core.name, %error, "unregister");
    }
    core.closed.send_replace(true);
}

/// Takes connections until the port closes, and says goodbye.
async fn attend(core: Arc<Core>, listener: Arc<TcpListener>) {
    let mut closing = core.closing.subscribe();
    // Connections are taken until it is done: some peers say goodbye on one of their own.
    let goodbye = async {
        // The sender lives as long as this port.
        closing.wait_for(|closing| *closing).await.ok();
        let limit = core.network.0.timeouts.close;
        if timeout(limit, say_goodbye(&core)).await.is_err() {
            core.counters.add("goodbye_timeout");
        }
    };
    let serve = |stream, _| connection::run(Arc::clone(&core), stream);
    let limit = core.session.limits.max_connections;
    let mut tasks = accept(&core.name, &listener, limit, &core.counters, serve, goodbye).await;
    drop(listener);
    tasks.shutdown().await;
}

/// Asks those who send to this port to stop, and ends the outputs.
async fn say_goodbye(core: &Arc<Core>) {
    let (senders, outputs) = {
        let connections = core.connections.lock();
        let inputs = connections.inputs.iter().filter(|input| input.status.push);
        let rooted = inputs.filter(|input| input.status.name.starts_with('/'));
        let senders: Vec<_> = rooted.map(|input| input.status.name.clone()).collect();
        let outputs: Vec<_> = connections.outputs.iter().map(|output| output.id).collect();
        (senders, outputs)
    };
    let mut goodbyes = JoinSet::new();
    for sender in senders {
        let core = Arc::clone(core);
        goodbyes.spawn(async move {
            if let Err(error) = core.network.disconnect(&sender, &core.name).await {
                let name = &core.name;
                tracing::debug!(target: "wrapyfi_yarp::port", name, sender, %error, "goodbye");
            }
        });
    }
    for id in outputs {
        let core = Arc::clone(core);
        goodbyes.spawn(async move { core.end_output(id).await });
    }
    while goodbyes.join_next().await.is_some() {}
}
