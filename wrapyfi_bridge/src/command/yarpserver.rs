//! `wrapyfi yarpserver`: a YARP name server, standalone, with the options of YARP's own.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use wrapyfi_endpoint::network::{Place, owner};
use wrapyfi_yarp::name::conf::{ConfError, NameServerConf, file_of, namespace};
use wrapyfi_yarp::name::environment::Environment;
use wrapyfi_yarp::server::{NameServer, NameServerError, NameServerOptions};
use wrapyfi_yarp_endpoint::{self as yarp, YarpConfig};

use super::{write_down, yarp_environment};
use crate::cli::YarpServerArgs;
use crate::exit::{Failure, Result};
use crate::shutdown::Shutdown;

/// Runs until the process is asked to end.
///
/// # Errors
/// Exit code 2 for bad settings, 1 when the port is taken.
pub fn run(args: &YarpServerArgs, shutdown: &Shutdown) -> Result<()> {
    let environment = yarp_environment(args.namespace.as_deref());
    let place = place(args, &environment).map_err(Failure::usage)?;
    let ip = resolve(&place.host).map_err(Failure::usage)?;
    let mut insecure = YarpConfig::from_env().map_err(Failure::usage)?.insecure;
    insecure.said(Place::Environment, args.read, insecure.is_allowed);
    insecure.said(Place::Argument, args.ip.is_some(), args.insecure);
    insecure.check(yarp::NAME, "a name server", ip).map_err(Failure::usage)?;
    let discovery = environment.base_port().map_err(Failure::usage)?;
    let options = NameServerOptions {
        ip,
        port: place.port,
        namespace: namespace(&environment).map_err(Failure::usage)?,
        // Asked above.
        insecure: true,
        discovery_port: (!args.no_discovery).then_some(discovery),
        ..NameServerOptions::default()
    };
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .context("cannot start the runtime")?;
    let server = runtime.block_on(NameServer::start(options)).map_err(|error| match error {
        NameServerError::BadNamespace { .. } => Failure::usage(error),
        NameServerError::PortTaken { port, .. } => {
            let owner = owner(port).map(|it| format!(" ({it})")).unwrap_or_default();
            anyhow!("{error}{owner}").into()
        }
        error => anyhow::Error::new(error).into(),
    })?;
    let own = server.registration().clone();
    if args.write {
        let conf = NameServerConf { host: own.host.clone(), port: own.port };
        write_down(&environment, &own.name, &conf)?;
    }
    tracing::info!(
        "name server {} on {}:{}, browse it at http://{}:{}/",
        own.name,
        own.host,
        own.port,
        own.host,
        own.port
    );
    let mut names = 0;
    while !shutdown.wait_until(Instant::now() + Duration::from_secs(1)) {
        let status = server.status();
        if status.names != names {
            names = status.names;
            tracing::info!("{names} names, {} connections", status.connections);
        }
    }
    let status = server.status();
    runtime.block_on(server.stop());
    tracing::info!("did {} commands; {:?}", status.commands, status.counts);
    Ok(())
}

/// Address of the name server: the arguments', else the configuration's with `--read`, else this
/// machine alone and YARP's port.
fn place(args: &YarpServerArgs, environment: &Environment) -> Result<NameServerConf, ConfError> {
    let mut place = if args.read {
        let file = file_of(environment, &namespace(environment)?)?;
        NameServerConf::read(&file)?
    } else {
        NameServerConf { port: environment.base_port()?, ..NameServerConf::default() }
    };
    if let Some(ip) = &args.ip {
        place.host.clone_from(ip);
    }
    place.port = args.port.unwrap_or(place.port);
    Ok(place)
}

fn resolve(host: &str) -> anyhow::Result<IpAddr> {
    let found = (host, 0).to_socket_addrs().with_context(|| format!("--ip {host}"))?;
    // YARP's clients know IPv4 best.
    let first = found.min_by_key(SocketAddr::is_ipv6);
    first.map(|it| it.ip()).ok_or_else(|| anyhow!("--ip {host} has no address"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args() -> YarpServerArgs {
        YarpServerArgs {
            ip: None,
            port: None,
            namespace: None,
            write: false,
            read: false,
            silent: false,
            insecure: false,
            no_discovery: true,
        }
    }

    #[test]
    fn what_is_given_goes_before_what_the_file_says() {
        let folder = tempfile::tempdir().unwrap();
        let environment = Environment::default().with("YARP_CONFIG_HOME", folder.path());
        let conf = |host: &str, port| NameServerConf { host: host.to_owned(), port };
        assert_eq!(place(&args(), &environment).unwrap(), conf("127.0.0.1", 10_000));
        let read = YarpServerArgs { read: true, ..args() };
        let missing = place(&read, &environment).unwrap_err().to_string();
        assert!(missing.contains("yarp.conf does not exist"), "{missing}");
        conf("127.0.0.2", 10_050).write(&file_of(&environment, "/root").unwrap()).unwrap();
        assert_eq!(place(&read, &environment).unwrap(), conf("127.0.0.2", 10_050));
        let both = YarpServerArgs { port: Some(0), ..read };
        assert_eq!(place(&both, &environment).unwrap(), conf("127.0.0.2", 0));
        assert_eq!(resolve("127.0.0.1").unwrap().to_string(), "127.0.0.1");
    }
}
