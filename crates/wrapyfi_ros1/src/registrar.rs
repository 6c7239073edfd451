//! Keeps the master's knowledge of this node true, also when the master goes and comes back.
//!
//! ```text
//!   step wanted ─▶ call the master ─▶ taken            next step at once
//!                       └ no answer ─▶ back-off, fault told to the endpoints
//!   every second ─▶ getPid, lookupNode ─▶ another process, or we are unknown: enter all again
//! ```

use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::time::timeout;

use super::master::MasterError;
use super::node::Node;
use super::registrations::{Key, Kind, MasterUpdate};
use super::xmlrpc::text;
use wrapyfi_endpoint::Cause;
use wrapyfi_endpoint::backoff::Backoff;

/// Time between two looks at the master.
const LOOK: Duration = Duration::from_secs(1);

/// Registers what is wanted, for as long as the node lives.
pub(super) async fn keep(node: Arc<Node>) {
    meet_master(&node).await;
    let mut backoff = Backoff::of_process(node.next_id());
    let mut pid = None;
    loop {
        let wait = match round(&node, &mut pid).await {
            Ok(()) => {
                backoff.reset();
                node.set_fault(None);
                LOOK
            }
            Err(error) => {
                node.set_fault(Some(away(&node, &error)));
                backoff.wait()
            }
        };
        // A time-out is the usual end: then the master is looked at.
        _ = timeout(wait, node.work.notified()).await;
    }
}

/// Waits for the master, and learns what it calls its machine.
async fn meet_master(node: &Arc<Node>) {
    let mut backoff = Backoff::of_process(node.next_id());
    loop {
        match node.master.ask("getUri", []).await {
            Ok(uri) => return node.master.whereabouts.note_master(&uri),
            Err(error @ MasterError::Unreachable { .. }) => {
                node.set_fault(Some(away(node, &error)));
                backoff.pause().await;
            }
            // It lacks the method, and is one all the same.
            Err(_) => return,
        }
    }
}

/// Cause for which the master cannot be asked, and the likely remedy.
fn away(node: &Node, error: &MasterError) -> Cause {
    let mut cause = error.cause(&node.master.uri);
    if let (Cause::ServerAway { detail, .. }, Some(_)) = (&mut cause, node.master.whereabouts.afar)
    {
        *detail = format!(
            "{detail}; roscore has to run there, and a firewall may be between (port {} and those of its nodes)",
            node.master.uri.port
        );
    }
    cause
}

/// Looks at the master, and takes every step there is.
async fn round(node: &Arc<Node>, pid: &mut Option<i32>) -> Result<(), MasterError> {
    take_steps(node).await?;
    let now = node.master.pid().await?;
    let known = pid.replace(now);
    let lost = known.is_some_and(|known| known != now) || is_unknown(node).await?;
    if lost {
        tracing::info!("ROS 1: the master has forgotten this node, which registers again");
        node.state().registrations.forgotten();
        take_steps(node).await?;
    }
    Ok(())
}

/// True where the master should know this node and does not, or takes another for it.
async fn is_unknown(node: &Arc<Node>) -> Result<bool, MasterError> {
    if !node.state().registrations.expected() {
        return Ok(false);
    }
    let found = node.master.lookup_node(node.name.full()).await?;
    // Told as others' are.
    Ok(found != Some(node.master.whereabouts.of(node.api.clone())))
}

async fn take_steps(node: &Arc<Node>) -> Result<(), MasterError> {
    loop {
        let Some(step) = node.state().registrations.next() else { return Ok(()) };
        match take(node, &step).await {
            Ok(()) => {}
            Err(error @ MasterError::Unreachable { .. }) => return Err(error),
            // Asking again would not help: it is as done as it will be.
            Err(error) => tracing::warn!(?step, "ROS 1: {error}"),
        }
        node.state().registrations.taken(&step);
    }
}

async fn take(node: &Arc<Node>, step: &MasterUpdate) -> Result<(), MasterError> {
    let master = &node.master;
    let own = text(&master.api);
    // The address of this node with another scheme.
    let address = || node.tcpros.to_string().replacen("http", "rosrpc", 1);
    let address = || text(address().trim_end_matches('/'));
    let (method, params) = match step {
        MasterUpdate::Enter(Key { kind, name }, type_name) => match kind {
            Kind::Publisher => ("registerPublisher", vec![text(name), text(type_name), own]),
            Kind::Subscriber => {
                let question = node.question(name);
                let method = "registerSubscriber";
                let asked = [text(name), text(type_name), own];
                let publishers: Vec<String> = master.ask_for(method, asked).await?;
                node.set_publishers(name, &publishers, Some(question));
                return Ok(());
            }
            Kind::Service => ("registerService", vec![text(name), address(), own]),
            Kind::Mark => ("setParam", vec![text(name), text(type_name)]),
            Kind::Parameter => {
                let asked = Instant::now();
                // The master tells this node of changes from then on, and the value now: an empty struct where there
                // is no such parameter.
                let value = master.ask("subscribeParam", [own, text(name)]).await?;
                super::parameters::arrived(node, name, &value, asked);
                return Ok(());
            }
        },
        MasterUpdate::Remove(Key { kind, name }) => match kind {
            Kind::Publisher => ("unregisterPublisher", vec![text(name), own]),
            Kind::Subscriber => ("unregisterSubscriber", vec![text(name), own]),
            Kind::Service => ("unregisterService", vec![text(name), address()]),
            Kind::Parameter => ("unsubscribeParam", vec![own, text(name)]),
            Kind::Mark => ("deleteParam", vec![text(name)]),
        },
    };
    match master.ask(method, params).await {
        // It is gone: a bridge takes the marks of those that ended away.
        Err(MasterError::Refused { method: "deleteParam", .. }) => Ok(()),
        answer => answer.map(drop),
    }
}

/// Tells the master that nothing is here any more. It may not answer.
pub(super) async fn leave(node: &Arc<Node>) {
    node.state().registrations.unwant_all();
    if let Err(error) = take_steps(node).await {
        tracing::debug!("ROS 1: could not say goodbye: {error}");
    }
}
