//! YARP: our ports beside bare sockets that carry the same bytes, and beside ports of YARP's own library.
//!
//! ```text
//!   round trip   near ══ a bottle ══▶ far       bare: blocking, tokio    ports: RpcClient, RpcServer
//!                near ◀═ the same ═══ far                                       or ports that send
//!   stream       near ══ images ════▶ far       bare: tokio, one buffer  ports: OutputPort, InputPort
//!                near ◀─ a byte for each batch                           libYARP: Port, BufferedPort
//! ```
//!
//! Near and far are processes of their own, each on a tokio runtime with two threads that differs in
//! nothing between bare sockets and ports; all of it runs in tasks. The blocking round trip never
//! meets the runtime. Both ends of a ride over libYARP are one C++ program, `peers/yarp_ports.cpp`. Names are known by a name server in the process that orders the turn, which is
//! asked before anything is measured only.

mod far;
mod library;
mod names;
mod near;
mod rest;

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::{Context as _, Result, anyhow, ensure};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use tokio::runtime::Runtime;
use wrapyfi_yarp::name::{Environment, NameClient, NameServerConf};
use wrapyfi_yarp::port::{Acknowledge, InputOptions, Network, Reading};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::sig::{Image, PixelCode};
use wrapyfi_yarp::{Bottle, Dialect};

use crate::child::Child;
use crate::results::Results;
use crate::trip::Leg;
use crate::turn::{Bench, Line, in_turn};
use crate::worker::{Order, Report};

pub(crate) use far::far;
pub(crate) use library::Library;
pub(crate) use near::near;
pub(crate) use rest::{Ports, ports};

/// Longest time of one exchange.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Turns of one round. Where the scheduler puts two processes, and what else is in the caches, decides
/// more than how many messages they exchange.
const SWEEPS: u32 = 5;
/// Images of one batch: far acknowledges the last of them.
const BATCH: u32 = 100;
/// Variable with the folder of unix sockets.
const SOCKETS: &str = "YARP_RUNTIME_DIR";
/// Width and height of an image.
const SIZE: (usize, usize) = (640, 480);

/// Transport of the exchanges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Way {
    /// Sockets of the standard library, which block.
    Blocking,
    /// Sockets of tokio.
    Tokio,
    /// Ports, without acknowledgements: requests are answered by a function.
    FastTcp,
    /// Ports, each message acknowledged.
    Tcp,
    /// `fast_tcp`, requests answered out of the server's queue.
    Queue,
    /// `fast_tcp`, a port that sends and one that reads at both ends.
    Data,
    /// Ports, over a unix socket, without acknowledgements.
    UnixStream,
    /// Ports of libYARP, without acknowledgements.
    LibraryFastTcp,
    /// Ports of libYARP, each message acknowledged.
    LibraryTcp,
    /// Ports of libYARP, over a unix socket, without acknowledgements.
    LibraryUnixStream,
    /// Ports of libYARP, through shared memory.
    LibraryShmem,
}

impl Way {
    /// Name in files and on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Blocking => "blocking",
            Self::Tokio => "tokio",
            Self::FastTcp => "fast-tcp",
            Self::Tcp => "tcp",
            Self::Queue => "queue",
            Self::Data => "data",
            Self::LibraryFastTcp => "library-fast-tcp",
            Self::LibraryTcp => "library-tcp",
            Self::UnixStream => "unix-stream",
            Self::LibraryUnixStream => "library-unix-stream",
            Self::LibraryShmem => "library-shmem",
        }
    }

    /// Title of the way, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Blocking => "bare sockets that block",
            Self::Tokio => "bare sockets of tokio",
            Self::FastTcp => "ports over fast_tcp",
            Self::Tcp => "ports over tcp, with acknowledgements",
            Self::Queue => "request over fast_tcp, answered out of a queue",
            Self::Data => "a port each way over fast_tcp",
            Self::LibraryFastTcp => "ports of libYARP over fast_tcp",
            Self::LibraryTcp => "ports of libYARP over tcp, with acknowledgements",
            Self::UnixStream => "ports over unix_stream",
            Self::LibraryUnixStream => "ports of libYARP over unix_stream",
            Self::LibraryShmem => "ports of libYARP over shmem, with acknowledgements",
        }
    }

    /// Name of the carrier that connects its ports.
    fn carrier(self) -> &'static str {
        match self {
            Self::Tcp | Self::LibraryTcp => "tcp",
            Self::UnixStream | Self::LibraryUnixStream => "unix_stream",
            Self::LibraryShmem => "shmem",
            _ => "fast_tcp",
        }
    }

    /// True when the ports are those of libYARP.
    pub(crate) fn is_library(self) -> bool {
        matches!(
            self,
            Self::LibraryFastTcp | Self::LibraryTcp | Self::LibraryUnixStream | Self::LibraryShmem
        )
    }
}

/// Load of an exchange.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Load {
    /// A bottle, there and back.
    Bottle1k,
    /// Images, one after the other.
    VgaRgb,
}

impl Load {
    /// Name in files and on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Bottle1k => "bottle1k",
            Self::VgaRgb => "vga-rgb",
        }
    }

    /// Title of the load, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Bottle1k => "bottle with 1 KiB of text, there and back",
            Self::VgaRgb => "640x480 RGB, one way, each",
        }
    }

    /// Round trips of one turn, or batches.
    fn count(self) -> u32 {
        match self {
            Self::Bottle1k => 1500,
            Self::VgaRgb => 3,
        }
    }

    /// The same before anything is measured.
    fn warm(self) -> u32 {
        match self {
            Self::Bottle1k => 200,
            Self::VgaRgb => 1,
        }
    }
}

/// One load on one way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::Args)]
pub(crate) struct Ride {
    #[arg(long)]
    pub(crate) load: Load,
    #[arg(long)]
    pub(crate) way: Way,
}

/// One ride of one turn, as its processes are told.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct Place {
    #[command(flatten)]
    ride: Ride,
    /// Port number of the name server.
    #[arg(long)]
    names: u16,
    /// Port that far listens on for bare sockets, which near is told.
    #[arg(long, default_value_t = 0)]
    peer: u16,
}

/// Report of far that near may come.
#[derive(Serialize, Deserialize)]
struct Ready {
    peer: u16,
}

impl Ride {
    /// Every ride, those that are compared next to each other.
    pub(crate) const ALL: [Self; 19] = [
        Self { load: Load::Bottle1k, way: Way::Blocking },
        Self { load: Load::Bottle1k, way: Way::Tokio },
        Self { load: Load::Bottle1k, way: Way::FastTcp },
        Self { load: Load::Bottle1k, way: Way::LibraryFastTcp },
        Self { load: Load::Bottle1k, way: Way::Tcp },
        Self { load: Load::Bottle1k, way: Way::LibraryTcp },
        Self { load: Load::Bottle1k, way: Way::UnixStream },
        Self { load: Load::Bottle1k, way: Way::LibraryUnixStream },
        Self { load: Load::Bottle1k, way: Way::LibraryShmem },
        Self { load: Load::Bottle1k, way: Way::Queue },
        Self { load: Load::Bottle1k, way: Way::Data },
        Self { load: Load::VgaRgb, way: Way::Tokio },
        Self { load: Load::VgaRgb, way: Way::FastTcp },
        Self { load: Load::VgaRgb, way: Way::LibraryFastTcp },
        Self { load: Load::VgaRgb, way: Way::Tcp },
        Self { load: Load::VgaRgb, way: Way::LibraryTcp },
        Self { load: Load::VgaRgb, way: Way::UnixStream },
        Self { load: Load::VgaRgb, way: Way::LibraryUnixStream },
        Self { load: Load::VgaRgb, way: Way::LibraryShmem },
    ];

    /// `yarp-way/load`.
    pub(crate) fn name(self) -> String {
        format!("yarp-{}/{}", self.way.name(), self.load.name())
    }

    /// Measures it once.
    pub(crate) fn turn(self, bench: &Bench, library: Option<&Library>) -> Result<Leg> {
        let server = Server::start()?;
        let start = |role: &str, peer: u16| {
            let mut command = if self.way.is_library() {
                let library = library.context("libYARP is not there")?;
                library.command(role, Place { ride: self, names: server.port, peer })?
            } else {
                let mut command = bench.command(&bench.own);
                command.args([&format!("yarp-{role}"), "--load", self.load.name()]);
                command.args(["--way", self.way.name(), "--names", &server.port.to_string()]);
                command.args(["--peer", &peer.to_string()]);
                command
            };
            command.env(SOCKETS, &bench.folder);
            Child::start(&format!("yarp-{role}"), command, &bench.folder)
        };
        let mut sink = start("far", 0)?;
        let Ready { peer } = sink.answer()?;
        let source = start("near", peer)?;
        let mut line = Line { source, sink, middle: Vec::new(), domain: 0, acks: 0 };
        let warm = line.ask(&Order::Warm).context("warming up")?;
        let calls = line.phase(&Order::Window { count: self.load.count(), inflight: 1 })?;
        let Report { sent, received, .. } = calls.report;
        ensure!(sent == received && sent > 0, "{received} of {sent} arrived");
        Ok(Leg { warm, calls })
    }
}

/// All of it, as every round has it: backwards in every other one.
pub(crate) fn round(
    bench: &Bench,
    library: Option<&Library>,
    rides: &[Ride],
    round: u32,
    results: &mut Results,
) {
    let there = |ride: &&Ride| library.is_some() || !ride.way.is_library();
    let rides: Vec<Ride> = rides.iter().filter(there).copied().collect();
    let rides = in_turn(&rides, round.is_multiple_of(2));
    let mut legs: BTreeMap<Ride, Leg> = BTreeMap::new();
    for _ in 0..SWEEPS {
        for ride in &rides {
            match ride.turn(bench, library) {
                Ok(leg) => add(legs.entry(*ride).or_default(), leg),
                failed => results.leg(round, &ride.name(), failed),
            }
        }
    }
    for (ride, leg) in legs {
        results.leg(round, &ride.name(), Ok(leg));
    }
    if rides.is_empty() {
        return;
    }
    match names::registrations() {
        Ok(figure) => results.micro(round, vec![figure]),
        Err(error) => results.failures.push(format!("round {round}, name server: {error:#}")),
    }
}

/// Puts what another turn found to what is there.
fn add(all: &mut Leg, one: Leg) {
    let (before, more) = (f64::from(all.calls.report.sent), f64::from(one.calls.report.sent));
    if before == 0.0 {
        *all = one;
        return;
    }
    let used = all.calls.cpu_us * before + one.calls.cpu_us * more;
    all.calls.cpu_us = used / (before + more);
    let (report, other) = (&mut all.calls.report, one.calls.report);
    report.sent += other.sent;
    report.received += other.received;
    report.span_ns += other.span_ns;
    report.latency_us.extend(other.latency_us);
}

/// A runtime like that of every process here.
fn runtime(threads: usize) -> Result<Runtime> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    Ok(builder.worker_threads(threads).enable_all().build()?)
}

/// Runs `work` as a task.
fn task<T: Send + 'static>(
    runtime: &Runtime,
    work: impl Future<Output = Result<T>> + Send + 'static,
) -> Result<T> {
    runtime.block_on(runtime.spawn(work)).map_err(|error| anyhow!("a task: {error}"))?
}

/// A name server on a runtime of its own.
struct Server {
    port: u16,
    /// Ends before its runtime.
    _server: NameServer,
    _runtime: Runtime,
}

impl Server {
    fn start() -> Result<Self> {
        let runtime = runtime(1)?;
        let options = NameServerOptions { port: 0, ..NameServerOptions::default() };
        let server = runtime.block_on(NameServer::start(options))?;
        Ok(Self { port: server.address().port(), _server: server, _runtime: runtime })
    }
}

/// Client of the name server at this number.
fn client(port: u16) -> NameClient {
    NameClient::new(NameServerConf { host: "127.0.0.1".to_owned(), port })
}

/// The network that this name server knows.
fn network(names: u16) -> Network {
    let here = std::net::Ipv4Addr::LOCALHOST.into();
    let folder = std::env::var_os(SOCKETS).unwrap_or_else(|| std::env::temp_dir().into());
    let environment = Environment::from_pairs([(SOCKETS, folder)]);
    Network::builder().names(client(names)).listen(here).environment(environment).build()
}

/// Keeps every message.
fn reading() -> InputOptions {
    let reading = Reading::Strict { queue: 4, acknowledge: Acknowledge::Queued };
    InputOptions { reading, ..InputOptions::default() }
}

/// Bottle that goes there and back.
fn bottle() -> Bottle {
    Bottle::from(vec!["x".repeat(1024).into()])
}

/// Bytes of that bottle.
fn bottle_bytes() -> Result<Vec<u8>> {
    Ok(bottle().encode(Dialect::default())?)
}

/// Bytes of an image, with its head.
fn image_bytes() -> Result<Bytes> {
    let (width, height) = SIZE;
    let pixels = vec![7; width * height * 3].into();
    Ok(Image::from_packed(PixelCode::Rgb, width, height, pixels)?.encode()?.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bare_sockets_carry_what_ports_carry() {
        // Tag, count and length before the text; the head before the pixels.
        assert_eq!(bottle_bytes().unwrap().len(), 3 * 4 + 1024);
        assert_eq!(image_bytes().unwrap().len(), 60 + 640 * 480 * 3);
    }

    #[test]
    fn every_ride_over_ports_stands_beside_a_bare_one() {
        for ride in Ride::ALL {
            let bare = Ride { way: Way::Tokio, ..ride };
            assert!(Ride::ALL.contains(&bare), "{}", ride.name());
        }
    }

    #[test]
    fn turns_of_a_round_add_up() {
        let leg = |sent, cpu_us, time| {
            let report = Report {
                sent,
                received: sent,
                latency_us: vec![time],
                span_ns: 5,
                ..Report::default()
            };
            let calls = crate::turn::Phase { report, cpu_us, middle_us: 0.0 };
            Leg { warm: Report::default(), calls }
        };
        let mut all = Leg::default();
        add(&mut all, leg(100, 4.0, 1.0));
        add(&mut all, leg(300, 8.0, 2.0));
        let (report, cpu_us) = (&all.calls.report, all.calls.cpu_us);
        assert_eq!((report.sent, report.received, report.span_ns), (400, 400, 10));
        assert_eq!((&report.latency_us[..], cpu_us), (&[1.0, 2.0][..], 7.0));
    }

    #[test]
    fn every_way_carries() {
        for ride in Ride::ALL.into_iter().filter(|ride| !ride.way.is_library()) {
            let server = Server::start().unwrap();
            let names = server.port;
            let place = move |peer| Place { ride, names, peer };
            let (told, peer) = std::sync::mpsc::channel();
            std::thread::spawn(move || far::serve(place(0), move |peer| Ok(told.send(peer)?)));
            let mut near = near::Near::open(place(peer.recv().unwrap())).unwrap();
            let report = near.exchange(2).unwrap();
            let each = if ride.load == Load::VgaRgb { BATCH } else { 1 };
            let (sent, received, times) = (report.sent, report.received, report.latency_us.len());
            assert_eq!((sent, received, times), (2 * each, 2 * each, 2), "{}", ride.name());
        }
    }
    #[test]
    fn libyarp_carries_where_it_is_installed() {
        let folder = tempfile::tempdir().unwrap();
        let repository = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let library = match Library::compile(repository, folder.path()) {
            Ok(library) => library,
            Err(error) => return println!("skipped: {error:#}"),
        };
        for ride in Ride::ALL.into_iter().filter(|ride| ride.way.is_library()) {
            let server = Server::start().unwrap();
            let start = |role, peer| {
                let place = Place { ride, names: server.port, peer };
                let mut command = library.command(role, place).unwrap();
                command.env(SOCKETS, folder.path());
                Child::start(role, command, folder.path()).unwrap()
            };
            let mut far = start("far", 0);
            let Ready { peer } = far.answer().unwrap();
            let mut near = start("near", peer);
            near.tell(&Order::Window { count: 2, inflight: 1 }).unwrap();
            let report: Report = near.answer().unwrap();
            let each = if ride.load == Load::VgaRgb { BATCH } else { 1 };
            let found = (report.sent, report.received, report.latency_us.len());
            assert_eq!(found, (2 * each, 2 * each, 2), "{}", ride.name());
        }
    }
}
