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

use super::core::Core;
use super::master::MasterError;
use super::registrations::{Key, Kind, Step};
use super::whereabouts::meet_master;
use super::xmlrpc::text;
use wrapyfi_endpoint::backoff::Backoff;

/// Time between two looks at the master.
const LOOK: Duration = Duration::from_secs(1);

/// Registers what is wanted, for as long as the node lives.
pub(super) async fn keep(core: Arc<Core>) {
    meet_master(&core).await;
    let mut backoff = Backoff::of_process(core.next_id());
    let mut pid = None;
    loop {
        let wait = match round(&core, &mut pid).await {
            Ok(()) => {
                backoff.reset();
                core.set_fault(None);
                LOOK
            }
            Err(error) => {
                core.set_fault(Some(core.away(&error)));
                backoff.wait()
            }
        };
        // A time-out is the usual end: then the master is looked at.
        _ = timeout(wait, core.work.notified()).await;
    }
}

/// Looks at the master, and takes every step there is.
async fn round(core: &Arc<Core>, pid: &mut Option<i32>) -> Result<(), MasterError> {
    take_steps(core).await?;
    let now = core.master.pid().await?;
    let known = pid.replace(now);
    let lost = known.is_some_and(|known| known != now) || is_unknown(core).await?;
    if lost {
        tracing::info!("ROS 1: the master has forgotten this node, which registers again");
        core.state().registrations.forgotten();
        take_steps(core).await?;
    }
    Ok(())
}

/// True where the master should know this node and does not, or takes another for it.
async fn is_unknown(core: &Arc<Core>) -> Result<bool, MasterError> {
    if !core.state().registrations.expected() {
        return Ok(false);
    }
    let found = core.master.lookup_node(core.name.full()).await?;
    // Told as others' are.
    Ok(found != Some(core.master.whereabouts.of(core.api.clone())))
}

async fn take_steps(core: &Arc<Core>) -> Result<(), MasterError> {
    loop {
        let Some(step) = core.state().registrations.next() else { return Ok(()) };
        match take(core, &step).await {
            Ok(()) => {}
            Err(error @ MasterError::Unreachable(_)) => return Err(error),
            // Asking again would not help: it is as done as it will be.
            Err(error) => tracing::warn!(?step, "ROS 1: {error}"),
        }
        core.state().registrations.taken(&step);
    }
}

async fn take(core: &Arc<Core>, step: &Step) -> Result<(), MasterError> {
    let master = &core.master;
    let own = text(&master.api);
    // The address of this node with another scheme.
    let address = || core.tcpros.to_string().replacen("http", "rosrpc", 1);
    let address = || text(address().trim_end_matches('/'));
    let (method, params) = match step {
        Step::Enter(Key { kind, name }, type_name) => match kind {
            Kind::Publisher => ("registerPublisher", vec![text(name), text(type_name), own]),
            Kind::Subscriber => {
                let since = core.updates(name);
                let method = "registerSubscriber";
                let asked = [text(name), text(type_name), own];
                let publishers: Vec<String> = master.ask_for(method, asked).await?;
                core.set_publishers(name, &publishers, Some(since));
                return Ok(());
            }
            Kind::Service => ("registerService", vec![text(name), address(), own]),
            Kind::Mark => ("setParam", vec![text(name), text(type_name)]),
            Kind::Parameter => {
                let asked = Instant::now();
                // The master tells this node of changes from then on, and the value now: an empty struct where there
                // is no such parameter.
                let value = master.ask("subscribeParam", [own, text(name)]).await?;
                super::parameters::arrived(core, name, &value, asked);
                return Ok(());
            }
        },
        Step::Remove(Key { kind, name }) => match kind {
            Kind::Publisher => ("unregisterPublisher", vec![text(name), own]),
            Kind::Subscriber => ("unregisterSubscriber", vec![text(name), own]),
            Kind::Service => ("unregisterService", vec![text(name), address()]),
            Kind::Parameter => ("unsubscribeParam", vec![own, text(name)]),
            Kind::Mark => ("deleteParam", vec![text(name)]),
        },
    };
    master.ask(method, params).await.map(drop)
}

/// Tells the master that nothing is here any more. It may not answer.
pub(super) async fn leave(core: &Arc<Core>) {
    core.state().registrations.unwant_all();
    if let Err(error) = take_steps(core).await {
        tracing::debug!("ROS 1: could not say goodbye: {error}");
    }
}
