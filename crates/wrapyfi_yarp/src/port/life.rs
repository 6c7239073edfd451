//! Life of a port: taking connections, saying goodbye.

use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio::time::timeout;
use wrapyfi_retry::restart::restarted;

use super::accept::accept;
use super::connection;
use super::core::{Core, Input};
use crate::task::erased;

/// Takes connections until the port closes, then ends what it has.
pub(crate) async fn keep(core: Arc<Core>, listener: TcpListener) {
    let (port, listener) = (Arc::clone(&core), Arc::new(listener));
    let counted = Arc::clone(&core);
    restarted(
        format!("YARP port {}", core.name),
        move |_why| counted.fault_counts.add("port_panicked"),
        move || attend(Arc::clone(&port), Arc::clone(&listener)),
    )
    .await;
    // Those that said no goodbye in time: what waits for them is lost.
    core.outboxes().iter().for_each(|outbox| outbox.abort());
    if core.options.register
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
            core.fault_counts.add("goodbye_timeout");
        }
    };
    let serve = |stream| connection::run(Arc::clone(&core), stream);
    let limit = core.limits.max_connections;
    let mut tasks = accept(&core.name, &listener, limit, &core.fault_counts, serve, goodbye).await;
    drop(listener);
    tasks.shutdown().await;
}

/// Asks those who send to this port to stop, and ends the outputs.
async fn say_goodbye(core: &Arc<Core>) {
    let (senders, outputs) = {
        let connections = core.connections.lock();
        let is_asked = |input: &&Input| input.status.push && core.name_service.is_none();
        let inputs = connections.inputs.iter().filter(is_asked);
        let rooted = inputs.filter(|input| input.status.name.starts_with('/'));
        let senders: Vec<_> = rooted.map(|input| input.status.name.clone()).collect();
        let outputs: Vec<_> = connections.outputs.iter().map(|output| output.id).collect();
        (senders, outputs)
    };
    let mut goodbyes = JoinSet::new();
    for sender in senders {
        let core = Arc::clone(core);
        goodbyes.spawn(erased(async move {
            if let Err(error) = core.network.disconnect(&sender, &core.name).await {
                let name = &core.name;
                tracing::debug!(target: "wrapyfi_yarp::port", name, sender, %error, "goodbye");
            }
        }));
    }
    for id in outputs {
        let core = Arc::clone(core);
        goodbyes.spawn(erased(async move { core.end_output(id).await }));
    }
    while goodbyes.join_next().await.is_some() {}
}
