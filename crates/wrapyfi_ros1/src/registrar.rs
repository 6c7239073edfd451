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
use super::registrations::{Kind, Step};
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
    let address = || format!("rosrpc://{}", host_and_port(core));
    match step {
        Step::Enter(key, type_name) => match key.kind {
            Kind::Publisher => master.register_publisher(&key.name, type_name).await,
            Kind::Subscriber => {
                let since = core.updates(&key.name);
                let publishers = master.register_subscriber(&key.name, type_name).await?;
                core.answered(&key.name, &publishers, since);
                Ok(())
            }
            Kind::Service => master.register_service(&key.name, &address()).await,
            Kind::Mark => master.set_param(&key.name, text(type_name)).await,
            Kind::Parameter => {
                let asked = Instant::now();
                // An empty struct where there is no such parameter.
                let value = master.subscribe_param(&key.name).await?;
                super::parameters::arrived(core, &key.name, &value, asked);
                Ok(())
            }
        },
        Step::Remove(key) => match key.kind {
            Kind::Publisher => master.unregister_publisher(&key.name).await,
            Kind::Subscriber => master.unregister_subscriber(&key.name).await,
            Kind::Service => master.unregister_service(&key.name, &address()).await,
            Kind::Parameter => master.unsubscribe_param(&key.name).await,
            Kind::Mark => master.delete_param(&key.name).await,
        },
    }
}

fn host_and_port(core: &Core) -> String {
    // The same address with another scheme.
    core.tcpros.to_string().trim_start_matches("http://").trim_end_matches('/').to_owned()
}

/// Tells the master that nothing is here any more. It may not answer.
pub(super) async fn leave(core: &Arc<Core>) {
    core.state().registrations.unwant_all();
    if let Err(error) = take_steps(core).await {
        tracing::debug!("ROS 1: could not say goodbye: {error}");
    }
}
