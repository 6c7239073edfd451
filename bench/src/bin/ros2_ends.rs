//! One end on ROS 2 for `bench/peers/ros2_side_by_side.py`, on whichever adapter the environment chooses.
//!
//! ```text
//!   publish   a serialised message from a file, at a rate     ends after COUNT
//!   relay     takes from --name, publishes on --to            ends when stdin does
//!   serve     a serialised reply from a file to each request  ends when stdin does
//!   call      a serialised request from a file                ends after COUNT
//! ```
//!
//! Lines of JSON on stdout: `{"ready": true}` when it is on the graph, figures at the end.

use std::io::{Read as _, Write as _};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use clap::{Parser, ValueEnum};
use serde_json::{Value, json};
use wrapyfi_endpoint::{History, Qos, Reliability, Wake};
use wrapyfi_node::NodeName;
use wrapyfi_ros2::graph::{
    Graph, GraphError, Notify, Peers, ServiceDescription, TopicDescription, wait_until,
};
use wrapyfi_ros2::{CycloneConfig, environment, join};

/// Longest time that the other end may take to come.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Largest message.
const MAX_BYTES: usize = 64 << 20;

#[derive(Clone, Copy, ValueEnum)]
enum Role {
    Publish,
    Relay,
    Serve,
    Call,
}

#[derive(Parser)]
struct Args {
    role: Role,
    /// Topic or service.
    #[arg(long)]
    name: String,
    #[arg(long)]
    to: Option<String>,
    #[arg(long = "type")]
    kind: String,
    #[arg(long)]
    file: Option<PathBuf>,
    #[arg(long, default_value_t = 10)]
    depth: u32,
    #[arg(long)]
    best_effort: bool,
    #[arg(long, default_value_t = 30.0)]
    rate: f64,
    #[arg(long, default_value_t = 100)]
    count: u64,
}

fn main() -> Result<()> {
    tracing_subscriber::fmt().with_writer(std::io::stderr).init();
    let args = Args::parse();
    let environment = environment::read(|name| std::env::var(name).ok())?;
    let name = NodeName::new(&format!("ours_{}", std::process::id()), "/")?;
    let joined =
        join(&CycloneConfig::from_environment(name, &environment), &environment, None, "/")?;
    let graph = &*joined.graph;
    match args.role {
        Role::Publish => publish(graph, &args),
        Role::Relay => relay(graph, &args),
        Role::Serve => serve(graph, &args),
        Role::Call => call(graph, &args),
    }
}

impl Args {
    fn topic(&self, name: &str) -> TopicDescription {
        let reliability =
            if self.best_effort { Reliability::BestEffort } else { Reliability::Reliable };
        let history = History::KeepLast(self.depth);
        TopicDescription {
            name: name.to_owned(),
            type_name: self.kind.clone(),
            type_hash: None,
            qos: Qos { reliability, history, ..Qos::default() },
            max_bytes: MAX_BYTES,
            hears_own: false,
        }
    }

    fn service(&self) -> ServiceDescription {
        ServiceDescription {
            name: self.name.clone(),
            type_name: self.kind.clone(),
            type_hash: None,
            request_hash: None,
            response_hash: None,
            depth: 10,
            max_bytes: MAX_BYTES,
        }
    }

    fn message(&self) -> Result<Vec<u8>> {
        let file = self.file.as_ref().context("--file is missing")?;
        std::fs::read(file).with_context(|| file.display().to_string())
    }
}

fn say(value: &Value) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{value}")?;
    Ok(out.flush()?)
}

fn bell(wake: &Wake) -> Notify {
    let wake = wake.clone();
    Arc::new(move || wake.ring())
}

fn publish(graph: &dyn Graph, args: &Args) -> Result<()> {
    let (message, wake) = (args.message()?, Wake::new());
    let mut writer = graph.advertise(&args.topic(&args.name), bell(&wake))?;
    say(&json!({"ready": true}))?;
    ensure!(wait_until(&wake, TIMEOUT, || writer.matched() > 0), "nobody subscribes");
    let start = Instant::now();
    let (mut sent, mut refused) = (0, 0);
    for number in 0..args.count {
        let due = start + Duration::from_secs_f64(number as f64 / args.rate);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        match writer.write(&[&message]) {
            Ok(()) => sent += 1,
            Err(GraphError::Timeout { .. }) => refused += 1,
            Err(error) => return Err(error.into()),
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    // Messages still on their way are asked for again while this end is there.
    std::thread::sleep(Duration::from_secs(1));
    say(&json!({"sent": sent, "refused": refused, "seconds": seconds}))
}

/// Says when stdin has ended.
fn leaving(wake: &Wake) -> Arc<AtomicBool> {
    let ends = Arc::new(AtomicBool::new(false));
    let (told, wake) = (Arc::clone(&ends), wake.clone());
    std::thread::spawn(move || {
        _ = std::io::stdin().read_to_end(&mut Vec::new());
        told.store(true, Relaxed);
        wake.ring();
    });
    ends
}

fn relay(graph: &dyn Graph, args: &Args) -> Result<()> {
    let wake = Wake::new();
    let to = args.to.as_ref().context("--to is missing")?;
    let mut writer = graph.advertise(&args.topic(to), bell(&wake))?;
    let mut reader = graph.subscribe(&args.topic(&args.name), bell(&wake))?;
    let ends = leaving(&wake);
    say(&json!({"ready": true}))?;
    let mut relayed = 0;
    while !ends.load(Relaxed) {
        while let Some(sample) = reader.take()? {
            if writer.write(&[&sample.cdr]).is_ok() {
                relayed += 1;
            }
        }
        wake.wait(Duration::from_secs(1));
    }
    say(&json!({"relayed": relayed}))
}

fn serve(graph: &dyn Graph, args: &Args) -> Result<()> {
    let (reply, wake) = (args.message()?, Wake::new());
    let mut server = graph.server(&args.service(), bell(&wake))?;
    let ends = leaving(&wake);
    say(&json!({"ready": true}))?;
    let mut waiting = Vec::new();
    while !ends.load(Relaxed) {
        while let Some(request) = server.take()? {
            waiting.push(request.id);
        }
        for id in std::mem::take(&mut waiting) {
            if server.hears(&id) {
                server.reply(&id, &[&reply])?;
            } else {
                waiting.push(id);
            }
        }
        wake.wait(server.look_again().unwrap_or(Duration::from_secs(1)));
    }
    Ok(())
}

fn call(graph: &dyn Graph, args: &Args) -> Result<()> {
    let (request, wake) = (args.message()?, Wake::new());
    let mut client = graph.client(&args.service(), bell(&wake))?;
    let seen = |peers: &Peers| matches!(peers, Peers::Ready(_) | Peers::Half);
    ensure!(wait_until(&wake, TIMEOUT, || seen(&client.servers())), "there is no server");
    let matched = Instant::now();
    ensure!(
        wait_until(&wake, TIMEOUT, || matches!(client.servers(), Peers::Ready(_))),
        "half a server"
    );
    let mut times = Vec::new();
    for number in 0..args.count {
        let start = if number == 0 { matched } else { Instant::now() };
        let sequence = client.send(&[&request])?;
        loop {
            if let Some(reply) = client.take()? {
                if reply.sequence == sequence {
                    break;
                }
                continue;
            }
            if start.elapsed() > TIMEOUT {
                bail!("call {number} was not answered");
            }
            wake.wait(Duration::from_millis(100));
        }
        times.push(start.elapsed().as_secs_f64());
    }
    say(&json!({"times": times}))
}
