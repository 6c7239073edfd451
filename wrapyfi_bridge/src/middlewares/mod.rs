//! Steps from a configuration to middlewares that run.
//!
//! ```text
//!   bridge.yaml ─ load ─▶ Endpoints + Plan ─ Middlewares::of_bridge ─▶ Registry
//!   endpoint on the command line ───────── for_endpoint ─▶ Middleware
//!
//!   drivers                    the list of middlewares
//!   endpoints                  the settings of all of them, and the start of one
//!   learn                      types from publishers
//!   load                       a configuration file -> settings and routes
//!   observe                    a middleware that only looks
//!   parameters                 settings changed by the parameters of the node
//!   settings                   what they start with, compared where a plan changes
//!   demo                       the parties of `wrapyfi demo`
//! ```
//!
//! Those that no route uses are not started.

mod demo;
mod drivers;
mod endpoints;
mod learn;
mod load;
mod observe;
mod parameters;
mod settings;

use std::collections::BTreeSet;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Weak};
use std::time::Duration;

use anyhow::Context as _;
use wrapyfi_endpoint::driver::Purpose;
pub use wrapyfi_endpoint::driver::{Reach, Server, ServerAddress};
use wrapyfi_endpoint::{
    Cause, DeferredMiddleware, EndpointAddress, Middleware, MiddlewareSettings as _, Planned,
    Registry, Role, StartError,
};
use wrapyfi_engine::Plan;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_node::parameters::ParameterStore;
use wrapyfi_ros2::{self as ros2, NodeEndpoints, NodeHandle, graph::Graph};

pub use self::demo::DemoMiddlewares;
pub use self::drivers::{BUNDLED, check_topic, is_ros, names, option_names, set};
pub(crate) use self::drivers::{
    NODE_SERVICES, available, carries, conventions, expected, unknown, wait_causes, whole_bridges,
};
pub use self::endpoints::{Endpoints, SectionNames};
use self::endpoints::{failure, of_start, start};
pub(crate) use self::learn::{LearnTopicError, described, description_of, of_topic};
pub(crate) use self::load::route_facts;
pub use self::load::{Loaded, Undefined, load, load_and_learn, load_noting, load_text};
pub use self::observe::{Observer, observer, ros1_observer, ros2_elsewhere, ros2_hidden};
pub(crate) use self::parameters::{show_endpoints, take_parameters};
pub use self::settings::Settings;
use crate::cli::ServicePorts;
use crate::exit::{Failure, Result};
use crate::logging;
use crate::node::{GRAPH, Node};
use crate::own_address::OwnAddress;

/// Longest time that the start of a bridge waits for a middleware: the routes of a slower one wait for it.
const START_WITHIN: Duration = Duration::from_secs(5);

/// Middlewares at work.
#[derive(Default)]
pub struct Middlewares {
    registry: Registry,
    /// The graph of the ROS 2 node, where there is one.
    graph: Option<Arc<dyn Graph>>,
    /// Settings of those that routes use, with which they have started.
    pub(crate) settings: Settings,
}

impl Middlewares {
    /// The middlewares that `plan` uses, as the ROS 2 node `node`; ROS 2 alone until they are turned to more where
    /// it `waits` for its activation.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work, 1 when the ROS 2 node does not start. Another
    /// middleware that does not start is no error: its routes wait, and it is tried again.
    pub fn of_bridge(endpoints: &Endpoints, plan: &Plan, node: &Node, waits: bool) -> Result<Self> {
        let mut settings = Settings::of(endpoints, plan, &Settings::default())?;
        if waits {
            settings = Settings::of(endpoints, &Plan::default(), &settings)?;
        }
        let mut middlewares = Self::default().turned_to(settings)?;
        if plan.uses(ros2::NAME) {
            let largest = plan.largest_message_on(ros2::NAME);
            let settings = endpoints.ros2().settings(node.name(), &node.args, largest);
            let mut settings = settings.map_err(failure)?;
            // It offers all services of a node.
            settings.describes_types = false;
            let ros2 = settings.start();
            let ros2 = ros2.map_err(|error| of_start(ros2::NAME, error))?;
            middlewares.graph = Some(Arc::clone(ros2.graph()));
            middlewares.registry.register(Arc::new(ros2));
        }
        Ok(middlewares)
    }

    /// The middlewares that `settings` have. Those with the settings of now are the same ones; others
    /// start, where there is one of that name once routes have let go of it. These middlewares stay as
    /// they are, and end with the last who holds them.
    ///
    /// # Errors
    /// Exit code 2 for settings that cannot work.
    pub fn turned_to(&self, settings: Settings) -> Result<Self> {
        let (mut registry, graph) = (self.registry.clone(), self.graph.clone());
        for (&name, one) in &settings.each {
            let before = self.settings.each.get(name);
            if before != Some(one) {
                let before = before.and_then(|_| self.registry.get(name).ok());
                let in_use = "the one with the settings before is in use".to_owned();
                let before = before.map(|before| (Arc::downgrade(before), in_use));
                registry.register(start_or_wait(name, one.clone(), before)?);
            }
        }
        for name in self.settings.each.keys() {
            if !settings.each.contains_key(name) {
                registry.remove(name);
            }
        }
        Ok(Self { registry, graph, settings })
    }

    /// Names of the middlewares that have ended for good, with the causes.
    pub(crate) fn ended(&self) -> impl Iterator<Item = (&'static str, Cause)> {
        let each = self.settings.each.keys();
        each.filter_map(|name| Some((*name, self.registry.get(name).ok()?.ended()?)))
    }

    /// Puts another in place of the middleware `name`, which has ended because of `reason`; it starts once
    /// routes have let go of the one before.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(crate) fn start_anew(&mut self, name: &'static str, reason: &Cause) -> Result<()> {
        if let (Some(one), Ok(before)) = (self.settings.each.get(name), self.registry.get(name)) {
            let before = (Arc::downgrade(before), reason.to_string());
            self.registry.register(start_or_wait(name, one.clone(), Some(before))?);
        }
        Ok(())
    }

    /// Puts `next` in place of these middlewares.
    pub fn replace_by(&mut self, next: Self) {
        for (name, settings) in &self.settings.each {
            if next.settings.each.get(name) != Some(settings) {
                // Its log is that of the one before.
                logging::write_to(name, None);
            }
        }
        *self = next;
    }

    /// Offers the node's services and topics beside those of the routes: parameters, descriptions
    /// of the types that are named, log, clock. They end with the result; nothing where no route is
    /// on ROS 2.
    ///
    /// # Errors
    /// Exit code 1 when the DDS stack refuses.
    pub fn offer_node(
        &self,
        node: &Node,
        parameters: ParameterStore,
        types: (&mut TypeStore, &BTreeSet<&'static str>),
    ) -> Result<Option<OfferedNode>> {
        let Some(graph) = &self.graph else { return Ok(None) };
        let offered =
            NodeEndpoints::start(graph, parameters, logging::loggers().as_ref()).context(GRAPH)?;
        let (store, names) = types;
        describe(offered.handle(), store, names);
        if node.args.rosout_logs {
            logging::publish_to(Some(offered.handle().clone()));
        }
        Ok(Some(OfferedNode(offered)))
    }

    /// The middlewares by name.
    pub fn registry(&self) -> &Registry {
        &self.registry
    }

    /// The middlewares by name, with the clock of the node that has this `handle`.
    pub(crate) fn registry_on(&self, handle: Option<&NodeHandle>) -> Registry {
        let mut registry = self.registry.clone();
        if let Some(handle) = handle {
            registry.set_clock(handle.clock());
        }
        registry
    }
}

/// Has the node describe the types that are named, of definitions in `store`.
pub(crate) fn describe(handle: &NodeHandle, store: &mut TypeStore, names: &BTreeSet<&'static str>) {
    handle.types(|described| {
        for name in names {
            if let Err(error) = described.add_named(store, name) {
                tracing::warn!("{name} is not described: {error}");
            }
        }
    });
}

/// The one middleware that `address` names, for a command with an endpoint in this role.
///
/// # Errors
/// As [`Middlewares::of_bridge`].
pub fn for_endpoint(
    address: &EndpointAddress,
    role: Role,
    own: OwnAddress,
) -> Result<Arc<dyn Middleware>> {
    for_service(address, role, &ServicePorts::default(), own)
}

/// As [`for_endpoint`], with the ports of requests and replies that were given.
///
/// # Errors
/// As [`Middlewares::of_bridge`].
pub fn for_service(
    address: &EndpointAddress,
    role: Role,
    ports: &ServicePorts,
    own: OwnAddress,
) -> Result<Arc<dyn Middleware>> {
    let mut endpoints = Endpoints::default();
    endpoints.reached_at(own);
    for (key, port) in [("rep_port", ports.rep_port), ("req_port", ports.req_port)] {
        let Some(port) = port else { continue };
        if !endpoints.set_port(&address.middleware, key, port) {
            let mut having = names().to_vec();
            having.retain(|name| endpoints.set_port(name, key, port));
            let having = having.join(", ");
            let text = format!("{address}: --rep-port and --req-port are for {having}");
            return Err(Failure::Usage(text));
        }
    }
    endpoints.start(&address.middleware, Purpose::Endpoint(role))
}

/// The middleware called `name`, to look at which endpoints exist.
///
/// # Errors
/// As [`Middlewares::of_bridge`].
pub fn for_look(name: &str, own: OwnAddress) -> Result<Arc<dyn Middleware>> {
    let mut endpoints = Endpoints::default();
    endpoints.reached_at(own);
    endpoints.start(name, Purpose::Look)
}

/// Starts a middleware; where something that it needs is not there, it takes its time, or the one `before` is still in use,
/// for which it has a reason, it is tried again later.
fn start_or_wait(
    name: &'static str,
    settings: Planned,
    before: Option<(Weak<dyn Middleware>, String)>,
) -> Result<Arc<dyn Middleware>> {
    let absent = |failure: Failure| StartError::Absent(failure.to_string());
    let mut first = None;
    let fault = match &before {
        Some((_, reason)) => StartError::Absent(reason.clone()),
        None => {
            let (tell, told) = channel();
            let planned = settings.clone();
            let thread = std::thread::Builder::new().name(format!("start-{name}"));
            // No caller waits any more where a bridge has ended meanwhile.
            let begun = thread.spawn(move || _ = tell.send(start(name, &planned)));
            begun.context(name)?;
            match told.recv_timeout(START_WITHIN) {
                Ok(Ok(started)) => return Ok(started),
                Ok(Err(Failure::Usage(fault))) => return Err(Failure::Usage(fault)),
                Ok(Err(failure)) => absent(failure),
                Err(RecvTimeoutError::Timeout) => {
                    first = Some(told);
                    let seconds = START_WITHIN.as_secs();
                    StartError::Absent(format!("it has not started within {seconds} s"))
                }
                Err(closed) => StartError::Failed(closed.to_string()),
            }
        }
    };
    let again = move || {
        if let Some((before, reason)) = &before
            && before.strong_count() > 0
        {
            return Err(StartError::Absent(reason.clone()));
        }
        let begun = first.take().and_then(|told| told.recv().ok());
        begun.unwrap_or_else(|| start(name, &settings)).map_err(|failure| match failure {
            Failure::Usage(fault) => StartError::Refused(fault),
            failure => absent(failure),
        })
    };
    Ok(Arc::new(DeferredMiddleware::new(name, fault, again).context(name)?))
}

/// The node's own endpoints; they end with it.
pub struct OfferedNode(NodeEndpoints);

impl OfferedNode {
    /// The node as the rest of the program uses it.
    pub fn handle(&self) -> &NodeHandle {
        self.0.handle()
    }
}

impl Drop for OfferedNode {
    fn drop(&mut self) {
        logging::publish_to(None);
    }
}
