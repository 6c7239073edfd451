//! The `wrapyfi` command.

use std::process::ExitCode;

use anyhow::Context as _;
use clap::Parser as _;
use wrapyfi_bridge::cli::{Cli, Command};
use wrapyfi_bridge::exit::{Failure, finish};
use wrapyfi_bridge::shutdown::Shutdown;
use wrapyfi_bridge::{command, logging};

fn main() -> ExitCode {
    // `ros2 run` hands every node its --ros-args: the `bridge` executable reads them.
    let cli = Cli::parse();
    finish(run(&cli))
}

fn run(cli: &Cli) -> Result<(), Failure> {
    let level = match (&cli.log_level, &cli.command) {
        (Some(level), _) => level,
        (None, Command::Yarpserver(args)) if args.silent => "warn",
        (None, Command::Echo(_) | Command::List(_) | Command::Call(_)) => "warn",
        (None, _) => "info",
    };
    logging::start("wrapyfi", level).map_err(Failure::usage)?;
    let shutdown = Shutdown::on_signals().context("cannot catch signals")?;
    match &cli.command {
        Command::Demo(args) => command::demo::run(args, &shutdown),
        Command::Bridge(args) => command::bridge::run(args, &shutdown),
        Command::Check { file } => command::check::run(file),
        Command::List(args) => command::list::run(args, &shutdown),
        Command::Echo(args) => command::echo::run(args, &shutdown),
        Command::Pub(args) => command::publish::run(args, &shutdown),
        Command::Call(args) => command::service::call::run(args, &shutdown),
        Command::Serve(args) => command::service::serve::run(args, &shutdown),
        Command::Broker(args) => command::broker::run(args, &shutdown),
        Command::Yarpserver(args) => command::yarpserver::run(args, &shutdown),
    }
}
