//! `wrapyfi detect`: looks for YARP's name server by multicast, as `yarp detect` does.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::Context as _;
use wrapyfi_yarp::name::conf::{NameServerConf, namespace};
use wrapyfi_yarp::name::multicast::{DISCOVERY_GROUP, NameServerSearch, discover};

use super::{write_down, yarp_environment};
use crate::cli::DetectArgs;
use crate::exit::{Failure, Result};
use crate::output;

/// Time between two questions.
const PAUSE: Duration = Duration::from_millis(500);

/// Prints where the name server is, and writes that down where `--write` says so.
///
/// # Errors
/// Exit code 3 when none answers, 2 for bad settings, 1 when the file cannot be written.
pub fn run(args: &DetectArgs) -> Result<()> {
    let environment = yarp_environment(args.namespace.as_deref());
    let port = match args.port {
        Some(port) => port,
        None => environment.base_port().map_err(Failure::usage)?,
    };
    let tries = args.timeout.as_millis().div_ceil(PAUSE.as_millis()).max(1);
    let question = NameServerSearch {
        port,
        namespace: namespace(&environment).map_err(Failure::usage)?,
        interface: args.ip.unwrap_or(Ipv4Addr::UNSPECIFIED),
        tries: u32::try_from(tries).unwrap_or(u32::MAX),
        wait: PAUSE,
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime")?;
    let asked = || format!("cannot ask the group {DISCOVERY_GROUP}:{port}");
    let found = runtime.block_on(discover(&question)).with_context(asked)?;
    let Some(found) = found else {
        return Err(Failure::TimedOut(format!(
            "no name server {} answered at {DISCOVERY_GROUP}:{port}: start one (`wrapyfi yarpserver`, \
             `yarpserver`), say on which interface to ask (--ip), or write its address yourself (`yarp \
             conf HOST PORT`)",
            question.namespace
        )));
    };
    output::line(&format!("{} {} {}", found.name, found.host, found.port))?;
    if args.write {
        let conf = NameServerConf { host: found.host, port: found.port };
        write_down(&environment, &question.namespace, &conf)?;
    }
    Ok(())
}
