//! The program: its commands, and under the name of a node executable that node:
//! `ros2 run wrapyfi_bridge ros1_bridge` starts a link to it.

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Parser as _;
use wrapyfi_endpoint::driver::Driver;

use crate::cli::{ActionCommand, Cli, Command};
use crate::exit::{Failure, Result, finish};
use crate::shutdown::Shutdown;
use crate::{aborted, command, export, files, logging, middlewares, node_main, survey};

/// The `wrapyfi` command with these middlewares: `bridge`, `check`, `list`, `echo`, `pub`, `why`, `top` and the others know
/// each of them by its name. A program with a middleware of its own is
///
/// ```no_run
/// use std::process::ExitCode;
///
/// fn main() -> ExitCode {
///     let mut drivers = wrapyfi_bridge::BUNDLED.to_vec();
///     drivers.truncate(2); // those that it needs, and its own
///     wrapyfi_bridge::main(&drivers)
/// }
/// ```
pub fn main(drivers: &[&'static dyn Driver]) -> ExitCode {
    files::raise_limit();
    aborted::catch();
    if let Err(failure) = middlewares::set(drivers) {
        return finish(Err(failure));
    }
    if let Some(executable) = node_main::executable(std::env::args_os().next()) {
        return finish(node_main::run_executable(executable));
    }
    let (words, ros) = node_main::split(std::env::args_os());
    finish(run(&Cli::parse_from(words), ros))
}

fn run(cli: &Cli, ros: Vec<OsString>) -> Result<()> {
    if let Command::Bridge(args) = &cli.command {
        let level = logging::level(cli.log_level.as_deref().unwrap_or("info"));
        let level = level.map_err(Failure::usage)?;
        return node_main::run(args, node_main::parse(ros.into_iter())?, None, level);
    }
    if !ros.is_empty() {
        return Err(Failure::usage("--ros-args is for the nodes: `wrapyfi bridge --ros-args …`"));
    }
    let level = match (&cli.log_level, &cli.command) {
        (Some(level), _) => level,
        (None, Command::Yarpserver(args)) if args.silent => "warn",
        (
            None,
            Command::Echo(_)
            | Command::List(_)
            | Command::Call(_)
            | Command::Export(_)
            | Command::Survey(_),
        ) => "warn",
        (None, Command::Action(command)) if !matches!(command, ActionCommand::Serve(_)) => "warn",
        // What it finds is said in its answer.
        (None, Command::Why(_) | Command::Top(_)) => "error",
        (None, _) => "info",
    };
    logging::start("wrapyfi", level).map_err(Failure::usage)?;
    let shutdown = Shutdown::on_signals().context("cannot catch signals")?;
    match &cli.command {
        Command::Demo(args) => command::demo::run(args, &shutdown),
        // Above: it logs as its node.
        Command::Bridge(_) => Ok(()),
        Command::Check { file, against, print_sros2_policy } => {
            command::check::run(file, against.as_deref(), *print_sros2_policy)
        }
        Command::List(args) => command::list::run(args, &shutdown),
        Command::Echo(args) => command::echo::run(args, &shutdown),
        Command::Pub(args) => command::publish::run(args, &shutdown),
        Command::Call(args) => command::service::call::run(args, &shutdown),
        Command::Serve(args) => command::service::serve::run(args, &shutdown),
        Command::Action(command) => command::action::run(command, &shutdown),
        Command::Survey(args) => survey::run(args, &shutdown),
        Command::Export(args) => export::run(args, &shutdown),
        #[cfg(feature = "bags")]
        Command::Convert(args) => command::bag::convert::run(args, &shutdown),
        #[cfg(feature = "bags")]
        Command::Play(args) => command::bag::play::run(args, &shutdown),
        #[cfg(feature = "bags")]
        Command::Record(args) => command::bag::record::run(args, &shutdown),
        Command::Broker(args) => shutdown.outcome(command::broker::run(args, &shutdown)),
        Command::Yarpserver(args) => shutdown.outcome(command::yarpserver::run(args, &shutdown)),
        Command::Detect(args) => command::detect::run(args),
        Command::Completions { shell } => command::completions::print(*shell),
        Command::Man { folder } => command::completions::write_pages(folder),
        Command::Why(args) => command::why::run(args),
        Command::Top(args) => command::top::run(args, &shutdown),
    }
}
