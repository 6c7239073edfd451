//! The `wrapyfi` command, and under the name of a node executable that node:
//! `ros2 run wrapyfi_bridge ros1_bridge` starts a link to it.

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Parser as _;
use wrapyfi_bridge::cli::{Cli, Command};
use wrapyfi_bridge::exit::{Failure, Result, finish};
use wrapyfi_bridge::shutdown::Shutdown;
use wrapyfi_bridge::{command, logging, node_main};

fn main() -> ExitCode {
    wrapyfi_bridge::files::raise_limit();
    wrapyfi_bridge::aborted::catch();
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
        (None, Command::Echo(_) | Command::List(_) | Command::Call(_)) => "warn",
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
        Command::Broker(args) => shutdown.outcome(command::broker::run(args, &shutdown)),
        Command::Yarpserver(args) => shutdown.outcome(command::yarpserver::run(args, &shutdown)),
        Command::Detect(args) => command::detect::run(args),
        Command::Why(args) => command::why::run(args),
        Command::Top(args) => command::top::run(args, &shutdown),
    }
}
