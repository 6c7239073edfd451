//! `make bench`: raw transports, our bridge and Python Wrapyfi measured by turns in one run.
//!
//! `README.md` beside this describes the method; `RESULTS.md`, `results.csv` and `plot.svg` hold
//! the last figures.

mod asked;
mod case;
mod child;
mod clock;
mod coding;
mod crowd;
mod dynamic;
mod estimate;
mod fast;
mod machine;
mod many;
mod micro;
mod payload;
mod plot;
mod proc;
mod python;
mod registered;
mod relay;
mod report;
mod results;
mod ros1;
mod soak;
mod stats;
mod targets;
mod tcpros;
mod trip;
mod turn;
mod wire;
mod worker;
mod yarp;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use clap::{Parser, Subcommand};

use asked::Asked;
use case::Case;
use payload::Kind;
use python::Python;
use results::Results;
use tcpros::Hop;
use trip::Trip;
use turn::{Bench, in_turn};
use wire::{Place, Wire};
use yarp::Ride;

/// Measures wrapyfi for ROS 2. Run it through `make bench`.
#[derive(Debug, Parser)]
#[command(
    after_help = "Cases of YARP are named yarp-way/load; --only yarp has ports at rest and the \
                        name server, too."
)]
struct Cli {
    /// Rounds in which every case that a target is made of has one turn.
    #[arg(long, default_value_t = 17)]
    rounds: u32,
    /// The other cases have one in the first round and then in every so many.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    others_every: u32,
    /// Streams for 10 seconds instead of 60.
    #[arg(long)]
    quick: bool,
    /// Only cases whose name (`way/payload`, `call-way/load`, `ask-way/payload`) contains this, in
    /// every round, and neither streams, coding, registered methods nor foreign endpoints; `coding`,
    /// `registered`, `endpoints`, `fast-dds`: only that; `ros1`: all of ROS 1.
    #[arg(long)]
    only: Option<String>,
    /// Folder for the results; default: this program's own in the repository.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Settings of CycloneDDS for every process, as in CYCLONEDDS_URI: to try some out.
    #[arg(long)]
    cyclonedds_uri: Option<String>,
    #[command(subcommand)]
    role: Option<Role>,
}

/// Task of a process that the benchmark started.
#[derive(Debug, Subcommand)]
enum Role {
    /// Sends.
    #[command(hide = true)]
    Source {
        #[arg(long)]
        wire: Wire,
        #[command(flatten)]
        place: Place,
    },
    /// Carries, as little as possible.
    #[command(hide = true)]
    RelayToRos {
        #[command(flatten)]
        place: Place,
    },
    /// Carries the other way.
    #[command(hide = true)]
    RelayToZmq {
        #[command(flatten)]
        place: Place,
    },
    /// Codes a large array and tells how much memory that took.
    #[command(hide = true)]
    Large {
        #[arg(long)]
        what: coding::Large,
        #[arg(long)]
        file: PathBuf,
    },
    /// Asks, and waits for the answer.
    #[command(hide = true)]
    Near {
        #[command(flatten)]
        place: trip::Place,
    },
    /// Answers.
    #[command(hide = true)]
    Far {
        #[command(flatten)]
        place: trip::Place,
    },
    /// Calls a registered method.
    #[command(hide = true)]
    Asker {
        #[command(flatten)]
        place: asked::Place,
    },
    /// Runs it for others.
    #[command(hide = true)]
    Asked {
        #[command(flatten)]
        place: asked::Place,
    },
    /// Has many endpoints.
    #[command(hide = true)]
    Crowd {
        #[arg(long)]
        domain: u32,
    },
    /// Counts them.
    #[command(hide = true)]
    Onlooker {
        #[arg(long)]
        domain: u32,
    },
    /// Has a port that asks or sends, or a bare socket.
    #[command(hide = true)]
    YarpNear {
        #[command(flatten)]
        place: yarp::Place,
    },
    /// Has one that answers or reads.
    #[command(hide = true)]
    YarpFar {
        #[command(flatten)]
        place: yarp::Place,
    },
    /// Has many, at rest.
    #[command(hide = true)]
    YarpPorts {
        /// Port number of the name server.
        #[arg(long)]
        names: u16,
    },
    /// Publishes on ROS 1.
    #[command(hide = true)]
    Ros1Source {
        #[command(flatten)]
        place: tcpros::Place,
    },
    /// Receives what became of it.
    #[command(hide = true)]
    Ros1Sink {
        #[command(flatten)]
        place: tcpros::Place,
        /// Port of the source that is told of arrivals.
        #[arg(long)]
        acks: u16,
    },
    /// Sends images on ROS 1, or on a bare socket.
    #[command(hide = true)]
    Ros1Near {
        #[command(flatten)]
        place: tcpros::PairPlace,
    },
    /// Receives them.
    #[command(hide = true)]
    Ros1Far {
        #[command(flatten)]
        place: tcpros::PairPlace,
    },
    /// Receives.
    #[command(hide = true)]
    Sink {
        #[arg(long)]
        wire: Wire,
        #[command(flatten)]
        place: Place,
        /// Port of the source that is told of arrivals.
        #[arg(long)]
        acks: u16,
    },
}

fn main() -> Result<()> {
    let cli = Cli::parse();
    match &cli.role {
        None => run(&cli),
        Some(Role::RelayToRos { place }) => relay::run(true, place),
        Some(Role::RelayToZmq { place }) => relay::run(false, place),
        Some(Role::Large { what, file }) => coding::large(*what, file),
        Some(Role::Near { place }) => {
            log_warnings();
            trip::near(place)
        }
        Some(Role::Far { place }) => {
            log_warnings();
            trip::far(place)
        }
        Some(Role::Asker { place }) => {
            log_warnings();
            asked::asker(*place)
        }
        Some(Role::Asked { place }) => {
            log_warnings();
            asked::asked(*place)
        }
        Some(Role::Crowd { domain }) => crowd::crowd(*domain),
        Some(Role::Onlooker { domain }) => crowd::onlooker(*domain),
        Some(Role::YarpNear { place }) => {
            log_warnings();
            yarp::near(*place)
        }
        Some(Role::YarpFar { place }) => {
            log_warnings();
            yarp::far(*place)
        }
        Some(Role::YarpPorts { names }) => yarp::ports(*names),
        Some(Role::Ros1Source { place }) => {
            log_warnings();
            worker::source_on(|| tcpros::outgoing(place))
        }
        Some(Role::Ros1Sink { place, acks }) => {
            log_warnings();
            worker::sink_on(|| tcpros::incoming(place), *acks)
        }
        Some(Role::Ros1Near { place }) => {
            log_warnings();
            tcpros::near(place)
        }
        Some(Role::Ros1Far { place }) => {
            log_warnings();
            tcpros::far(place)
        }
        Some(Role::Source { wire, place }) => {
            log_warnings();
            worker::source(*wire, place)
        }
        Some(Role::Sink { wire, place, acks }) => {
            log_warnings();
            worker::sink(*wire, place, *acks)
        }
    }
}

fn log_warnings() {
    tracing_subscriber::fmt()
        .with_max_level(tracing_subscriber::filter::LevelFilter::WARN)
        .with_writer(std::io::stderr)
        .init();
}

/// Progress, for whoever waits.
fn note(text: &str) {
    // Nothing is lost where nobody reads along.
    _ = writeln!(std::io::stderr(), "{text}");
}

fn run(cli: &Cli) -> Result<()> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let repository = here.parent().context("the benchmark has no repository around it")?;
    let out = cli.out.clone().unwrap_or_else(|| here.to_owned());
    let folder = tempfile::Builder::new().prefix("wrapyfi_bench_").tempdir()?;
    let mut bench = Bench::new(folder.path())?;
    bench.cyclonedds_uri.clone_from(&cli.cyclonedds_uri);
    let mut results = Results::new(cli.rounds);
    let wanted = |name: &str| cli.only.as_ref().is_none_or(|only| name.contains(only));
    let cases: Vec<Case> = Case::all().into_iter().filter(|case| wanted(&case.name())).collect();
    let rides: Vec<Ride> = Ride::ALL.into_iter().filter(|ride| wanted(&ride.name())).collect();
    let trips: Vec<Trip> = Trip::ALL.into_iter().filter(|trip| wanted(&trip.name())).collect();

    let asked: Vec<Asked> = Asked::ALL.into_iter().filter(|ask| wanted(ask.name())).collect();

    let mut library = None;
    if rides.iter().any(|ride| ride.way.is_library()) {
        match yarp::Library::compile(repository, folder.path()) {
            Ok(compiled) => library = Some(compiled),
            Err(error) => {
                note(&format!("without libYARP: {error:#}"));
                results.failures.push(format!("libYARP: {error:#}"));
            }
        }
    }
    let hops: Vec<Hop> = Hop::ALL.into_iter().filter(|hop| wanted(&hop.name())).collect();
    let mut master = None;
    if !hops.is_empty() {
        match tcpros::Master::start(&bench, repository) {
            Ok(started) => master = Some(started),
            Err(error) => {
                note(&format!("without ROS 1: {error:#}"));
                results.failures.push(format!("ROS 1: {error:#}"));
            }
        }
    }
    let coded = cli.only.as_deref().is_none_or(|only| only == "coding");
    let mut python = None;
    if coded || cases.iter().any(|case| case.way.is_python()) {
        match Python::start(repository, folder.path()) {
            Ok(started) => python = Some(started),
            Err(error) => {
                note(&format!("without Python Wrapyfi: {error:#}"));
                results.no_python = Some(format!("{error:#}"));
            }
        }
    }
    let bodies = micro::Bodies::new()?;
    let begin = std::time::Instant::now();
    for round in 1..=cli.rounds {
        results.loads.push(proc::load());
        results.micro(round, bodies.base64()?);
        yarp::round(&bench, library.as_ref(), &rides, round, &mut results);
        if let Some(master) = &mut master {
            tcpros::round(&bench, master, &hops, round, &mut results);
        }
        if cli.only.as_deref() == Some("ros1") {
            results.micro(round, bodies.ros1());
        }
        if coded {
            results.micro(round, bodies.coding()?);
            match coding::memory(&bench.own, folder.path()) {
                Ok(figures) => results.micro(round, figures),
                Err(error) => results.failures.push(format!("round {round}, memory: {error:#}")),
            }
            if let Some(python) = &mut python {
                python_coding(python, round, &mut results);
            }
        }
        if cli.only.as_deref().is_none_or(|only| only == "registered") {
            match registered::round() {
                Ok(figures) => results.micro(round, figures),
                Err(error) => {
                    results.failures.push(format!("round {round}, registered: {error:#}"));
                }
            }
        }
        for case in order(&cases, round, cli) {
            let turn = match (&mut python, case.way.is_python()) {
                (_, false) => bench.turn(case),
                (Some(python), true) => python.turn(case),
                (None, true) => continue,
            };
            match turn {
                Ok(turn) => results.turn(round, case, turn),
                Err(error) => {
                    let failure = format!("round {round}, {}: {error:#}", case.name());
                    note(&failure);
                    results.failures.push(failure);
                }
            }
        }
        for trip in in_turn(&trips, round.is_multiple_of(2)) {
            results.leg(round, &trip.name(), trip.turn(&bench));
        }
        // Python's calls are so slow that every other round is enough.
        if cli.only.is_some() || round % 2 == 1 {
            for ask in in_turn(&asked, round / 2 % 2 == 1) {
                if ask == Asked::Ours || results.no_python.is_none() {
                    results.leg(round, ask.name(), ask.turn(&bench, repository));
                }
            }
        }
        note(&format!("round {round} of {}: {:.0} s", cli.rounds, begin.elapsed().as_secs_f64()));
    }
    drop(python);
    if cli.only.is_none() {
        let (seconds, settle) = if cli.quick { (10, 4) } else { (60, 10) };
        match soak::run(&bench, seconds, settle) {
            Ok(soak) => results.soak = Some(soak),
            Err(error) => results.failures.push(format!("stream: {error:#}")),
        }
    }
    if cli.only.as_deref().is_none_or(|only| only == "fast-dds") {
        match fast::run(&bench, if cli.quick { 10 } else { 60 }) {
            Ok(stream) => results.fast = Some(stream),
            Err(error) => results.failures.push(format!("stream to Fast DDS: {error:#}")),
        }
    }
    if cli.only.as_deref().is_none_or(|only| only == "endpoints") {
        match crowd::run(&bench, if cli.quick { 5 } else { 15 }) {
            Ok(rest) => results.rest(rest),
            Err(error) => results.failures.push(format!("foreign endpoints: {error:#}")),
        }
    }
    if cli.only.as_deref().is_none_or(|only| only == "many") {
        match many::run(&bench, if cli.quick { 5 } else { 15 }) {
            Ok(many) => results.many(many),
            Err(error) => results.failures.push(format!("a thousand routes: {error:#}")),
        }
    }
    if cli.only.as_deref().is_none_or(|only| only == "yarp") {
        match yarp::Ports::measure(&bench, if cli.quick { 5 } else { 15 }) {
            Ok(ports) => results.ports(ports),
            Err(error) => results.failures.push(format!("YARP ports at rest: {error:#}")),
        }
    }
    if let Some(master) = master.as_mut().filter(|_| wanted("ros1")) {
        for way in [tcpros::Way::Bridge, tcpros::Way::Rospy] {
            let seconds = if cli.quick { 10 } else { 60 };
            match tcpros::streams(&bench, master, way, seconds) {
                Ok(streams) => results.streams(way, streams),
                Err(error) => {
                    results.failures.push(format!("streams, {}: {error:#}", way.title()));
                }
            }
        }
    }
    let targets = targets::check(&results);
    std::fs::create_dir_all(&out)?;
    std::fs::write(out.join("results.csv"), results.csv())?;
    std::fs::write(out.join("plot.svg"), plot::draw(&results))?;
    std::fs::write(out.join("RESULTS.md"), report::write(&results, &targets)?)?;
    note(&format!("{:.0} s; results in {}", begin.elapsed().as_secs_f64(), out.display()));
    writeln!(std::io::stdout(), "{}", report::target_table(&targets))?;
    Ok(())
}

/// The cases of a round. Every other one runs backwards, of the rounds with all cases as of those
/// with some: a drift of the machine meets all cases alike.
fn order(cases: &[Case], round: u32, cli: &Cli) -> Vec<Case> {
    let (full, rest) = ((round - 1) / cli.others_every, (round - 1) % cli.others_every);
    let all = cli.only.is_some() || rest == 0;
    let index = match (cli.only.is_some(), rest) {
        (true, _) => round,
        (false, 0) => full,
        // Without the full rounds before it.
        (false, _) => round - full,
    };
    let order: Vec<Case> = cases.iter().copied().filter(|case| all || case.is_judged()).collect();
    in_turn(&order, index % 2 == 1)
}

fn python_coding(python: &mut Python, round: u32, results: &mut Results) {
    let kinds = [
        Kind::Small,
        Kind::Audio,
        Kind::U8Rgb200,
        Kind::VgaJpeg,
        Kind::F32Mib,
        Kind::VgaRgb,
        Kind::FullHdRgb,
    ];
    for kind in kinds {
        match python.coding(kind, if kind == Kind::FullHdRgb { 5 } else { 15 }) {
            Ok(coding) => results.coding(round, kind, coding),
            Err(error) => results.failures.push(format!("Python's coding: {error:#}")),
        }
    }
}
