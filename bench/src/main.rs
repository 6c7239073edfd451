//! `make bench`: codecs, raw transports, our bridge and Python Wrapyfi measured in one run.
//!
//! `README.md` beside this describes the method; `RESULTS.md` and `plot.svg` hold the last figures. A whole run writes
//! the table of the repository's README as well.

mod case;
mod child;
mod clock;
#[cfg(test)]
mod counts;
mod engine;
mod micro;
mod package;
mod payload;
mod proc;
mod python;
mod report;
mod routes;
mod turn;
mod ways;
mod wire;
mod worker;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use clap::{Parser, Subcommand, ValueEnum as _};

use case::{Case, Way};
use micro::Micro;
use python::{Library, Python};
use report::{Run, Target};
use turn::Bench;
use ways::{HOPS, Ways};
use wire::{Place, Wire};

/// Measures wrapyfi for ROS 2. Run it through `make bench`.
#[derive(Debug, Parser)]
struct Cli {
    /// Rounds, in each of which every way has one turn with every payload; in a whole run ways that take long have a turn in every
    /// third, ways that decide no promise in every seventh.
    #[arg(long, default_value_t = 27)]
    rounds: u32,
    /// Streams for 10 seconds instead of 60, rest for 5 instead of 15.
    #[arg(long)]
    quick: bool,
    /// Only ways whose name (`way/payload`) contains one of these, with commas between; `micro`, `micro:NAME`, `engine`, `scripts`, `stream`, `routes`: only that. It is printed.
    #[arg(long)]
    only: Option<String>,
    /// Another `wrapyfi`, of another version: its broker and bridge have a turn after each of this one's.
    #[arg(long)]
    against: Option<PathBuf>,
    /// Folder for the results; default: of a whole run this program's own in the repository.
    #[arg(long)]
    out: Option<PathBuf>,
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
    /// Measures the engine.
    #[command(hide = true)]
    Engine,
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
    let Some(role) = &cli.role else { return run(&cli) };
    tracing_subscriber::fmt()
        .with_max_level(tracing_subscriber::filter::LevelFilter::WARN)
        .with_writer(std::io::stderr)
        .init();
    match role {
        Role::Engine => engine::tell(),
        Role::Source { wire, place } => worker::source(*wire, place),
        Role::Sink { wire, place, acks } => worker::sink(*wire, place, *acks),
    }
}

/// Progress and failures, for the user who waits and for the report.
#[derive(Default)]
struct Notes(Vec<String>);

impl Notes {
    fn say(text: &str) {
        // Nothing is lost where no program reads along.
        _ = writeln!(std::io::stderr(), "{text}");
    }

    /// The value that was found; a failure is noted.
    fn some<T>(&mut self, what: &str, found: Result<T>) -> Option<T> {
        found
            .inspect_err(|error| {
                let failure = format!("{what}: {error:#}").replace('\n', " ");
                Self::say(&failure);
                self.0.push(failure);
            })
            .ok()
    }
}

fn run(cli: &Cli) -> Result<()> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let repository = here.parent().context("the benchmark has no repository around it")?;
    let folder = tempfile::Builder::new().prefix("wrapyfi_bench_").tempdir()?;
    let bench = Bench::new(folder.path(), cli.against.clone())?;
    let only = cli.only.as_deref();
    let wants = |part: &str| only.is_none_or(|only| only == part);
    let cases: Vec<Case> = Case::all(cli.against.is_some())
        .into_iter()
        .filter(|case| only.is_none_or(|only| only.split(',').any(|one| case.name().contains(one))))
        .collect();
    let (mut notes, mut targets, mut ways) =
        (Notes::default(), Vec::<Target>::new(), Ways::default());
    let (mut loads, mut coding) = (vec![proc::load()], String::new());
    let start = |library, is_wanted: bool| {
        let needs = is_wanted || cases.iter().any(|case| case.way.library() == Some(library));
        let start = || Python::start(library, repository, folder.path());
        let started = needs.then(start).transpose();
        // Half of the rows compare with it.
        started.context("Python Wrapyfi, which `make setup-test` installs")
    };
    let mut python = start(Library::Wrapyfi, wants("micro") || wants("scripts"))?;
    let mut ours = start(Library::Package, wants("scripts"))?;

    // Bridged ways are compared with base64 of the same run.
    let filter = only.map(|only| match only.strip_prefix("micro") {
        Some(name) => name.trim_start_matches(':'),
        None => "base64/",
    });
    let micro = Micro::run(folder.path(), filter)?;
    if wants("micro")
        && let Some((table, found)) = notes.some("coding", micro.coding(python.as_mut()))
    {
        coding = format!("## Coding\n\n{table}\n");
        targets.extend(found);
    }
    if only.is_none_or(|only| only.starts_with("micro")) {
        targets.extend(micro.targets());
    }
    if wants("engine") {
        targets.extend(notes.some("engine", engine::run(&bench)).unwrap_or_default());
    }
    let begin = std::time::Instant::now();
    for round in 1..=if cases.is_empty() { 0 } else { cli.rounds } {
        loads.push(proc::load());
        // Backwards in every other round: a drift of the machine meets all alike.
        let mut order = cases.clone();
        order.retain(|case| only.is_some() || ways::has_turn(*case, round));
        if round % 2 == 0 {
            order.reverse();
        }
        for case in order {
            let turn = match case.way.library() {
                None => bench.turn(case),
                Some(library) => {
                    let found = if library == Library::Package { &mut ours } else { &mut python };
                    let Some(python) = found else { continue };
                    python.turn(case)
                }
            };
            if let Some(turn) = notes.some(&format!("round {round}, {}", case.name()), turn) {
                ways.add(round, case, turn);
            }
        }
        Notes::say(&format!(
            "round {round} of {}: {:.0} s",
            cli.rounds,
            begin.elapsed().as_secs_f64()
        ));
    }
    let rounds = if only.is_some() { cli.rounds } else { cli.rounds.div_ceil(ways::LONG_EVERY) };
    if wants("scripts")
        && let Some((python, ours)) = python.as_mut().zip(ours.as_mut())
    {
        targets
            .extend(notes.some("scripts", package::run(python, ours, rounds)).unwrap_or_default());
    }
    drop((python, ours));
    targets.extend(ways.targets(&micro));
    if wants("stream") {
        let found = ways::stream(&bench, if cli.quick { 10 } else { 60 });
        targets.extend(notes.some("stream", found).unwrap_or_default());
    }
    if wants("routes") {
        let seconds = if cli.quick { 5 } else { 15 };
        targets
            .extend(notes.some("1000 routes", routes::zeromq(&bench, seconds)).unwrap_or_default());
        let found = routes::ros1(&bench, repository, seconds);
        targets.extend(notes.some("400 routes of ROS 1", found).unwrap_or_default());
    }

    let run = Run::now(repository, cli.rounds, &loads);
    let mut text = format!("## Last run\n\n{run}.\n\n{}\n{coding}", report::table(&targets));
    if !cases.is_empty() {
        text += &format!("## Ways and payloads\n\n![Latency](plot.svg)\n\n{}\n", ways.table());
    }
    if !notes.0.is_empty() {
        text += &format!("## Turns that failed\n\n* {}\n", notes.0.join("\n* "));
    }
    // A part of a run takes no place of a whole one.
    let is_whole = only.is_none() && !cli.quick;
    if let Some(out) = cli.out.as_deref().or(is_whole.then_some(here)) {
        std::fs::create_dir_all(out)?;
        std::fs::write(out.join("plot.svg"), ways.plot(Way::value_variants()))?;
        report::put(&out.join("RESULTS.md"), &text)?;
        run.append(&out.join("history.csv"), &targets)?;
    }
    if cli.out.is_none() && is_whole {
        std::fs::write(repository.join("docs/hops.svg"), ways.plot(&HOPS))?;
        let text = format!(
            "{}\n![One hop](docs/hops.svg)\n\n{}\n{run}. In brackets 95 % intervals.\n",
            ways.hops(),
            report::shown(&targets),
        );
        report::put(&repository.join("README.md"), &text)?;
    }
    Notes::say(&format!("{:.0} s", begin.elapsed().as_secs_f64()));
    writeln!(std::io::stdout(), "{text}")?;
    let failed = notes.0.len();
    ensure!(failed == 0, "{failed} parts or turns failed; the report names them");
    Ok(())
}
