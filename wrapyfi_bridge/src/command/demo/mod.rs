//! `wrapyfi demo`: the main job on built-in sources.
//!
//! ```text
//!   scripts: camera, microphone, objects ── ZeroMQ ──▶ broker ─┐
//!   robot: camera, ears ── YARP ports ─────────────────────────┼─▶ bridge ── DDS ──▶ viewer
//!   robot: light, an rpc port ◀─▶ YARP ◀───────────────────────┘    (node             (node wrapyfi_demo_viewer)
//!                                                              wrapyfi_demo)    rates, latencies, calls
//! ```
//!
//! Nothing is short-circuited: scripts, robot and viewer know only sockets, ports and topics, as
//! programs of their own would.

mod caller;
mod robot;
mod routes;
mod scenes;
mod sources;
mod tally;
mod viewer;

use std::io::IsTerminal as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_endpoint::Mutex;
use wrapyfi_engine::{Engine, Plan};

use self::sources::Sources;
use self::viewer::Viewer;
use crate::cli::DemoArgs;
use crate::exit::Result;
use crate::in_force::{InForce, Running};
use crate::middlewares::{DemoMiddlewares, Endpoints};
use crate::node::Node;
use crate::on_graph::info;
use crate::output;
use crate::page::Page;
use crate::shutdown::Shutdown;
use crate::top::routes::Routes;

/// Runs for `--seconds`, or until the process is asked to end.
///
/// # Errors
/// Exit code 1 when a topic delivered nothing or a call failed; the message names the route and its
/// state.
pub fn run(args: &DemoArgs, shutdown: &Shutdown) -> Result<()> {
    let middlewares = DemoMiddlewares::start()?;
    let plan = routes::plan().context("demo routes")?;
    let mut viewer = Viewer::open(&middlewares.viewer)?;
    let running =
        Engine::new(plan, &middlewares.bridge).start().context("cannot start the routes")?;
    let sources = Sources::start(&middlewares.sources)?;
    let node = Node::named("wrapyfi_demo").context("the demo's node")?;
    let page = args.page.and_then(|port| {
        // The middlewares are the demo's own: nothing is asked by these settings.
        let (file, endpoints) = ("wrapyfi demo".to_owned(), Endpoints::default());
        let (definitions, removed) = (Vec::new(), Plan::default());
        let in_force = InForce { file, is_of_parameters: false, endpoints, definitions, removed };
        let (routes, in_force) = (running.applier(), Arc::new(Mutex::new(in_force)));
        Page::start(port, Running { node: node.clone(), routes, in_force })
    });

    let start = Instant::now();
    let end = args.seconds.map(|seconds| start + seconds);
    let (mut screen, mut routes) = (Screen::new(), Routes::default());
    let mut tick = start;
    loop {
        let next = tick + Duration::from_secs(1);
        // Not a moment of its own for what is left: rates over it would be noise.
        let until = end.filter(|end| *end < next + Duration::from_millis(500)).unwrap_or(next);
        let ended = viewer.watch(until, shutdown);
        let elapsed = tick.elapsed();
        tick = Instant::now();
        routes.update(info::of_all(&running.status(), &node));
        screen.show(&format!(
            "{:.0} s: ZeroMQ broker on {}, YARP name server on {}, ROS 2 {}\n\n{}\n{}",
            start.elapsed().as_secs_f64(),
            middlewares.broker,
            middlewares.name_server,
            middlewares.graph(),
            routes.table(),
            viewer.table(elapsed),
        ))?;
        if ended || end.is_some_and(|end| tick >= end) {
            break;
        }
    }
    drop((page, sources));
    let last = running.stop();
    let faults: Vec<String> = viewer
        .faults()
        .into_iter()
        .map(|(route, fault)| {
            let state = last.iter().find(|it| it.name == route).map(|it| it.state.to_string());
            format!("{route}: {fault} ({})", state.as_deref().unwrap_or("no such route"))
        })
        .collect();
    if faults.is_empty() {
        return Ok(());
    }
    Err(anyhow!("{}", faults.join("; ")).into())
}

/// Redraws in place on a terminal, appends elsewhere.
struct Screen {
    terminal: bool,
    lines: usize,
}

impl Screen {
    fn new() -> Self {
        Self { terminal: std::io::stdout().is_terminal(), lines: 0 }
    }

    fn show(&mut self, text: &str) -> Result<()> {
        let above = if self.terminal && self.lines > 0 {
            format!("\x1b[{}A\x1b[J", self.lines)
        } else {
            String::new()
        };
        output::line(&format!("{above}{text}"))?;
        self.lines = text.lines().count() + usize::from(text.ends_with('\n'));
        Ok(())
    }
}
