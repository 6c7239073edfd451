//! Steps from a configuration to middlewares that run.
//!
//! ```text
//!   bridge.yaml ─ load ─▶ Endpoints + Plan ─ Middlewares::of_bridge ─▶ Registry
//!   endpoint on the command line ───────── for_endpoint ─▶ Middleware
//!
//!   learn                      types from publishers
//!   load                       a configuration file -> sections and routes
//!   observe                    a middleware that only looks, and the server that it needs
//!   parameters                 sections changed by the parameters of the node
//!   zeromq, ros2, ros1, yarp   a section each, and the middleware that it makes
//!   settings                   what they start with, compared where a plan changes
//!   demo                       the parties of `wrapyfi demo`
//!   available, start           their names; the start of one, with the exit code of a failure
//! ```
//!
//! The only place that knows which middlewares exist. Those that no route uses are not started.

mod available;
mod demo;
mod learn;
mod load;
mod observe;
mod parameters;
mod ros1;
mod ros2;
mod settings;
mod start;
mod word;
mod yarp;
mod zeromq;

use std::collections::BTreeSet;
use std::sync::{Arc, Weak};

use anyhow::Context as _;
use wrapyfi_data::Limits;
use wrapyfi_endpoint::{DeferredMiddleware, EndpointAddress, Middleware, Registry, StartFault};
use wrapyfi_engine::Plan;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_node::parameters::ParameterStore;
use wrapyfi_ros2::{NodeEndpoints, NodeHandle, graph::Graph};

pub use self::available::{check_topic, is_ros, names, option_names};
pub(crate) use self::available::{unknown, waits};
pub use self::demo::DemoMiddlewares;
pub(crate) use self::learn::{LearnTopicError, described, of_topic};
pub use self::load::{Endpoints, Loaded, Undefined, load, load_and_learn, load_noting, load_text};
pub use self::observe::{
    Observer, Reach, Server, ServerAddress, observer, ros2_elsewhere, server_addresses,
};
pub(crate) use self::parameters::{show_endpoints, take_parameters};
pub use self::ros1::Ros1Section;
pub use self::ros2::Ros2Section;
use self::settings::One;
pub use self::settings::Settings;
pub use self::start::Role;
pub use self::yarp::YarpSection;
pub use self::zeromq::{ServicePorts, ZeroMqSection};
use crate::exit::{Failure, Result};
use crate::files::in_no_file;
use crate::logging;
use crate::node::Node;
use crate::own_address::OwnAddress;

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
        if plan.uses("ros2") {
            let ros2 = endpoints.ros2.start(node, plan.largest_message_on("ros2"))?;
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

    /// Names of the middlewares that have ended for good, with the reasons.
    pub(crate) fn ended(&self) -> impl Iterator<Item = (&'static str, String)> {
        let each = self.settings.each.keys();
        each.filter_map(|name| Some((*name, self.registry.get(name).ok()?.ended()?)))
    }

    /// Puts another in place of the middleware `name`, which has ended because of `reason`; it starts once
    /// routes have let go of the one before.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub(crate) fn start_anew(&mut self, name: &'static str, reason: String) -> Result<()> {
        if let (Some(one), Ok(before)) = (self.settings.each.get(name), self.registry.get(name)) {
            let before = (Arc::downgrade(before), reason);
            self.registry.register(start_or_wait(name, one.clone(), Some(before))?);
        }
        Ok(())
    }

    /// Puts `next` in place of these middlewares.
    pub fn replace_by(&mut self, next: Self) {
        if self.settings.each.get(yarp::NAME) != next.settings.each.get(yarp::NAME)
            && self.settings.each.contains_key(yarp::NAME)
        {
            // Its port is the one before's.
            logging::write_to(None);
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
            NodeEndpoints::start(graph, parameters, logging::loggers().as_ref()).context("ros2")?;
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

/// The one middleware that `address` names, for a command.
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
    if address.middleware != "zeromq" && ports.any() {
        let text = format!("{address}: --rep-port and --req-port are for zeromq");
        return Err(Failure::Usage(text));
    }
    let mut endpoints = Endpoints::default();
    endpoints.reached_at(own);
    endpoints.zeromq.rep_port = ports.rep_port.map(in_no_file);
    endpoints.zeromq.req_port = ports.req_port.map(in_no_file);
    start_as(&endpoints, &address.middleware, role)
}

/// Starts a middleware with these settings, for a program with this role.
fn start_as(endpoints: &Endpoints, middleware: &str, role: Role) -> Result<Arc<dyn Middleware>> {
    let Endpoints { zeromq, yarp, ros, ros2, hosts } = endpoints;
    let largest = Limits::default().message_bytes;
    let one = match middleware {
        "zeromq" => One::ZeroMq(zeromq.checked(zeromq.config(Some(role), largest, hosts)?)?, false),
        yarp::NAME => {
            let listens = !matches!(role, Role::Observer | Role::Client);
            One::Yarp(yarp.config(largest, hosts)?, listens)
        }
        ros1::NAME => One::Ros1(ros.config(hosts)?),
        "ros2" => return Ok(Arc::new(ros2.hidden()?)),
        other => return Err(unknown(other)),
    };
    one.start()
}

/// Starts a middleware; where something that it needs is not there, or the one `before` is still in use, for which
/// it has a reason, it is tried again later.
fn start_or_wait(
    name: &'static str,
    settings: One,
    before: Option<(Weak<dyn Middleware>, String)>,
) -> Result<Arc<dyn Middleware>> {
    let absent = match &before {
        Some((_, reason)) => reason.clone(),
        None => match settings.start() {
            Ok(started) => return Ok(started),
            Err(Failure::Usage(fault)) => return Err(Failure::Usage(fault)),
            Err(absent) => absent.to_string(),
        },
    };
    let again = move || {
        if let Some((before, reason)) = &before
            && before.strong_count() > 0
        {
            return Err(StartFault::Absent(reason.clone()));
        }
        settings.start().map_err(|failure| match failure {
            Failure::Usage(fault) => StartFault::Hopeless(fault),
            absent => StartFault::Absent(absent.to_string()),
        })
    };
    Ok(Arc::new(DeferredMiddleware::new(name, absent, again).context(name)?))
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
