//! Command `wrapyfi bridge` and the node executables: run the routes of a configuration.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use wrapyfi_endpoint::{CountersSnapshot, Mutex, WAITING};
use wrapyfi_engine::{Engine, Plan};
use wrapyfi_node::parameters::ParameterStore;

use crate::edits::Edits;
use crate::exit::{Failure, Result};
use crate::in_force::{InForce, Options, Running, change_by, ros2_types, warn_of_unheard};
use crate::lifecycle::Lifecycle;
use crate::lines::Lines;
use crate::middlewares::{Loaded, Middlewares, OfferedNode};
use crate::node::{GRAPH, Node};
use crate::on_graph::{OnGraph, Parts, own_addresses};
use crate::page::Page;
use crate::reload::{Reload, Source, Watch};
use crate::shutdown::Shutdown;
use crate::{logging, status_line};

/// Most routes without a message that get a line of their own at the end.
const FEW_IDLE: usize = 10;

/// Lines of status that may wait for their reader.
const MAX_LINES: usize = 8;
/// Longest time that writing the last of them may take.
const LAST_LINE: Duration = Duration::from_millis(500);

/// Runs the routes of a configuration, which is `loaded` from `source`, as the ROS 2 node `node`, until the time
/// is over or the process is asked to end.
///
/// # Errors
/// Exit code 2 when the configuration is refused, 1 when a middleware cannot start.
pub fn run(
    mut loaded: Loaded,
    source: Source,
    node: &Node,
    mut parameters: ParameterStore,
    options: Options,
    shutdown: &Shutdown,
) -> Result<()> {
    let name = source.name();
    let page_port = options.page_port.or(loaded.page_port);
    change_by(&mut loaded, node, &mut parameters, &options)?;
    let Loaded { endpoints, plan, types: mut store, definitions, lines, text, .. } = loaded;
    if options.no_autostart && !plan.uses(GRAPH) {
        return Err(Failure::usage(
            "no route is on ros2, where others could configure and activate the bridge: leave --no-autostart \
             (parameter autostart) out",
        ));
    }
    WAITING.set_limit(loaded.waiting_bytes);
    warn_of_unused(&parameters);
    warn_of_unheard(&plan.index(|address| node.resolve(address)), &lines);
    let middlewares = Middlewares::of_bridge(&endpoints, &plan, node, options.no_autostart)?;
    let removed = Plan::default();
    let is_of_parameters = matches!(source, Source::Text(..));
    let in_force =
        InForce { file: name.clone(), is_of_parameters, endpoints, definitions, removed };
    let types = ros2_types(&plan);
    // Dropped last: what the routes say at their end is logged too.
    let bridge_node = node;
    let node = middlewares.offer_node(node, parameters, (&mut store, &types))?;
    let routes = plan.routes.iter().filter(|route| route.is_whole()).count();
    match plan.routes.len() - routes {
        _ if options.no_autostart => tracing::info!("waits to be configured and activated: {name}"),
        0 => tracing::info!("{routes} routes from {name}"),
        found => {
            tracing::info!("{routes} routes, {found} that are found while running, from {name}");
        }
    }
    let registry = middlewares.registry_on(node.as_ref().map(OfferedNode::handle));
    let plan = if options.no_autostart { Plan::default() } else { plan };
    let engine =
        Engine::new(plan, &registry).with_types(store).with_own(own_addresses(bridge_node));
    // A middleware that starts anew waits until the one before is held no more.
    drop(registry);
    let running = engine.start().context("cannot start the routes")?;
    running.set_active(!options.no_autostart);
    let (routes, in_force) = (running.applier(), Arc::new(Mutex::new(in_force)));
    let bridge = Running { node: bridge_node.clone(), routes, in_force };
    let lifecycle = Lifecycle::default();
    let watch = Watch::start(Reload {
        source,
        middlewares,
        options,
        bridge: bridge.clone(),
        handle: node.as_ref().map(|node| node.handle().clone()),
        known: text,
        edits: Edits::default(),
        page_port,
        other_page_port: None,
        lifecycle: lifecycle.clone(),
        shutdown: shutdown.clone(),
    })?;
    let page = page_port.and_then(|port| Page::start(port, bridge.clone()));
    let on_graph = node.as_ref().map(|node| node.handle().clone());
    let on_graph = on_graph.map(|handle| OnGraph::start(Parts { bridge, handle, lifecycle }));
    let on_graph = on_graph.transpose()?;
    // A reader that stands still, or went, is no concern of the routes.
    let status = || Lines::start("status", std::io::stdout(), MAX_LINES, |_| String::new());
    let json = options.json.then(status).transpose().context("cannot print the status")?;
    let end = options.seconds.map(|seconds| Instant::now() + seconds);
    let mut tick = Instant::now();
    let mut failure = None;
    loop {
        tick += Duration::from_secs(1);
        let ended = shutdown.wait_until(end.map_or(tick, |end| tick.min(end)));
        if ended || end.is_some_and(|end| Instant::now() >= end) {
            break;
        }
        failure = options.lives_with.and_then(|name| running.registry().get(name).ok()?.ended());
        if failure.is_some() {
            break;
        }
        if let Some(json) = &json {
            json.write(status_line::json_line(&running.status(), logging::panics()));
        }
    }
    drop((watch, on_graph, page));
    let last = running.stop();
    if let Some(json) = &json {
        json.write(status_line::json_line(&last, logging::panics()));
        json.finish(LAST_LINE);
    }
    // A pattern carries nothing itself, and many routes of patterns nothing either.
    let routes = last.iter().filter(|route| route.pattern.is_none());
    let (carried, idle): (Vec<_>, Vec<_>) = routes.partition(|route| {
        let counters = &route.counters;
        counters.received > 0 || counters.sent > 0 || !counters.drops.is_empty()
    });
    let mut each = carried;
    if idle.len() <= FEW_IDLE {
        each.extend(idle);
    } else {
        tracing::info!("{} routes end that carried nothing", idle.len());
    }
    for route in each {
        let drops: Vec<String> = route
            .counters
            .drops
            .iter()
            .map(|(reason, count)| format!("{reason} {count}"))
            .collect();
        let drops = if drops.is_empty() { "none".to_owned() } else { drops.join(", ") };
        let CountersSnapshot { received, sent, unread, .. } = route.counters;
        tracing::info!(
            route = %route.name,
            "ends: {received} in, {sent} out, {unread} unread, dropped: {drops}"
        );
    }
    failure.map_or(Ok(()), |why| Err(Failure::Failed(anyhow::Error::new(why))))
}

/// Warns of parameters on the command line that nothing declares: perhaps misspelt.
fn warn_of_unused(store: &ParameterStore) {
    let known = || {
        // Those of topics were given, and are none of the others.
        let own = store.names().filter(|name| !name.starts_with("qos_overrides."));
        own.collect::<Vec<_>>().join(", ")
    };
    for (name, _) in store.unused_overrides() {
        if name.starts_with("qos_overrides.") {
            tracing::warn!("parameter {name} is for no topic that a route has here at that end");
        } else {
            tracing::warn!("parameter {name} is not one of this node's: {}", known());
        }
    }
}
