//! `wrapyfi broker`: the places where Wrapyfi's publishers and listeners, clients and servers meet,
//! standalone.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_endpoint::network::Place;
use wrapyfi_zeromq::{Broker, BrokerError, CurveClient, ServiceBroker, ZeroMqConfig};

use crate::cli::BrokerArgs;
use crate::exit::{Failure, Result};
use crate::middlewares::ZeroMqSection;
use crate::shutdown::Shutdown;

/// Runs until the process is asked to end.
///
/// # Errors
/// Exit code 2 for bad settings, 1 when a port is taken.
pub fn run(args: &BrokerArgs, shutdown: &Shutdown) -> Result<()> {
    let mut config = ZeroMqConfig::from_env().map_err(Failure::usage)?;
    config.insecure.said(Place::Argument, args.ip.is_some(), args.insecure);
    if let Some(ip) = &args.ip {
        config.ip.clone_from(ip);
    }
    config.pub_port = args.pub_port.unwrap_or(config.pub_port);
    config.sub_port = args.sub_port.unwrap_or(config.sub_port);
    config.rep_port = args.ports.rep_port.unwrap_or(config.rep_port);
    config.req_port = args.ports.req_port.unwrap_or(config.req_port);
    if args.curve_secret_key_file.is_some() || !args.curve_client.is_empty() {
        let curve = config.curve.get_or_insert_default();
        // The broker's own key, whatever else connects from here.
        curve.server_key = None;
        if let Some(file) = &args.curve_secret_key_file {
            curve.secret_key_file = Some(file.clone());
        }
        let clients = args.curve_client.iter().map(|key| CurveClient::of_all(key));
        curve.clients = Some(clients.collect()).filter(|clients: &Vec<_>| !clients.is_empty());
    } else {
        config = ZeroMqSection::default().checked(config)?;
    }
    let services = match ServiceBroker::start(&config) {
        Ok(services) => Some(services),
        // Wrapyfi's servers bring theirs along: topics need not wait for them to end.
        Err(error @ BrokerError::PortTaken { .. }) if !args.ports.any() => {
            tracing::warn!("no broker of requests and replies here: {error}");
            None
        }
        Err(error) => return Err(failed(error)),
    };
    if let Some(services) = &services {
        tracing::info!(
            "broker on {}: clients connect to port {}, servers to port {}",
            services.ip(),
            services.rep_port(),
            services.req_port()
        );
    }
    let broker = Broker::start(&config).map_err(failed)?;
    tracing::info!(
        "broker on {}: listeners connect to port {}, publishers to port {}",
        broker.ip(),
        broker.pub_port(),
        broker.sub_port()
    );
    let mut known = BTreeMap::new();
    while !shutdown.wait_until(Instant::now() + Duration::from_secs(1)) {
        let status = broker.status();
        if let Some(reason) = status.failure {
            return Err(anyhow!("the broker stopped: {reason}").into());
        }
        if let Some(reason) = services.as_ref().and_then(|services| services.status().failure) {
            return Err(anyhow!("the broker of requests stopped: {reason}").into());
        }
        if status.subscriptions != known {
            known = status.subscriptions;
            tracing::info!("subscriptions: {known:?}");
        }
    }
    let status = broker.status();
    tracing::info!("forwarded {} messages, {} bytes", status.messages, status.bytes);
    if let Some(served) = services.map(|services| services.status()) {
        tracing::info!("forwarded {} requests, {} replies", served.requests, served.replies);
    }
    Ok(())
}

fn failed(error: BrokerError) -> Failure {
    match error {
        BrokerError::NotLoopback(_) | BrokerError::SamePort { .. } | BrokerError::Curve(_) => {
            Failure::usage(error)
        }
        error => anyhow::Error::new(error).into(),
    }
}
