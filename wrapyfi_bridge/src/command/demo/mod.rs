//! `wrapyfi demo`: the main job on built-in sources.
//!
//! ```text
//!   sources ── ZeroMQ ──▶ broker ──▶ bridge (node wrapyfi_demo) ── DDS ──▶ viewer
//!   camera, microphone,                                       (node wrapyfi_demo_viewer)
//!   objects                                                    rates and latencies
//! ```
//!
//! Nothing is short-circuited: sources and viewer know only sockets and topics, as programs of
//! their own would.

mod sources;
mod viewer;

use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_core::engine::{Engine, Plan, RouteSpec};
use wrapyfi_core::types::MessageType;

use self::sources::Sources;
use self::viewer::Viewer;
use crate::cli::DemoArgs;
use crate::exit::Failure;
use crate::middlewares::DemoMiddlewares;
use crate::shutdown::Shutdown;
use crate::table;

/// What the demo carries: name of the route, ZeroMQ topic, ROS 2 topic, type.
const ROUTES: [(&str, &str, &str, MessageType); 5] = [
    ("camera", "/demo/camera", "/camera/image_raw", MessageType::Image),
    ("camera jpeg", "/demo/jpeg", "/camera/image_raw/compressed", MessageType::CompressedImage),
    ("microphone", "/demo/microphone", "/microphone", MessageType::AudioChunk),
    ("object", "/demo/object", "/object", MessageType::NativeObject),
    ("object as text", "/demo/text", "/object/json", MessageType::StringJson),
];

/// Runs for `--seconds`, or until the process is asked to end.
///
/// # Errors
/// Exit code 1 when a route delivered nothing; the message names it and its state.
pub fn run(args: &DemoArgs, shutdown: &Shutdown) -> Result<(), Failure> {
    let middlewares = DemoMiddlewares::start()?;
    let plan = plan().context("demo routes")?;
    let mut viewer = Viewer::open(middlewares.viewer(), &ROUTES)?;
    let running =
        Engine::new(plan, middlewares.bridge()).start().context("cannot start the routes")?;
    let sources = Sources::start(middlewares.sources())?;

    let start = Instant::now();
    let end = args.seconds.map(|seconds| start + seconds);
    let mut screen = Screen::new();
    let mut before = running.status();
    let mut tick = start;
    loop {
        let next = tick + Duration::from_secs(1);
        let until = end.map_or(next, |end| next.min(end));
        let ended = viewer.watch(until, shutdown);
        let now = running.status();
        let elapsed = tick.elapsed();
        tick = Instant::now();
        screen.show(&format!(
            "{:.0} s: ZeroMQ broker on {}, ROS 2 domain {}\n\n{}\n{}",
            start.elapsed().as_secs_f64(),
            middlewares.broker(),
            middlewares.domain_id(),
            table::table(&before, &now, elapsed),
            viewer.table(elapsed),
        ))?;
        before = now;
        if ended || end.is_some_and(|end| tick >= end) {
            break;
        }
    }
    drop(sources);
    let last = running.stop();
    let silent = viewer.silent();
    if silent.is_empty() {
        return Ok(());
    }
    let reasons: Vec<String> = last
        .iter()
        .filter(|route| silent.iter().any(|topic| route.to.ends_with(topic)))
        .map(|route| format!("{} ({})", route.name, route.state))
        .collect();
    Err(anyhow!("nothing arrived on: {}", reasons.join("; ")).into())
}

fn plan() -> anyhow::Result<Plan> {
    let route = |&(name, from, to, message_type): &(&str, &str, &str, MessageType)| {
        let (from, to) = (format!("zeromq:{from}").parse()?, format!("ros2:{to}").parse()?);
        let route = RouteSpec::new(from, to, message_type);
        anyhow::Ok(RouteSpec { name: name.to_owned(), ..route })
    };
    Ok(Plan { routes: ROUTES.iter().map(route).collect::<anyhow::Result<_>>()?, ..Plan::default() })
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

    fn show(&mut self, text: &str) -> Result<(), Failure> {
        let mut out = std::io::stdout().lock();
        if self.terminal && self.lines > 0 {
            write!(out, "\x1b[{}A\x1b[J", self.lines).context("cannot print")?;
        }
        writeln!(out, "{text}").and_then(|()| out.flush()).context("cannot print")?;
        self.lines = text.lines().count() + usize::from(text.ends_with('\n'));
        Ok(())
    }
}
