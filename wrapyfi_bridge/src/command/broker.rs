//! `wrapyfi broker`: the places where Wrapyfi's publishers and listeners, clients and servers meet,
//! standalone.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_endpoint::network::{Place, is_of_this_machine};
use wrapyfi_zeromq::{BrokerError, BrokerMode, CurveClient, ZeroMq, ZeroMqConfig, ZeroMqError};

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
    // Where a broker runs already, as in a bridge, this one waits for its end.
    (config.broker, config.service_broker) = (BrokerMode::Embedded, BrokerMode::Embedded);
    let ip = config.address().map_err(|error| failed(error.into()))?;
    if !is_of_this_machine(ip) {
        return Err(failed(BrokerError::NotHere(ip).into()));
    }
    let zeromq = ZeroMq::start(&config).map_err(failed)?;
    match zeromq.start_services() {
        Ok(_) => {}
        // Topics need not wait for what has the ports of requests.
        Err(error @ ZeroMqError::PortTaken { .. }) if !args.ports.any() => {
            tracing::warn!("no broker of requests and replies here: {error}");
        }
        Err(error) => return Err(failed(error)),
    }
    // Each is told once it is this process that runs it.
    let (mut known, mut tells_topics, mut tells_services) = (BTreeMap::new(), true, true);
    let mut tell = || {
        if zeromq.service_broker_status().is_some()
            && std::mem::take(&mut tells_services)
            && let Ok((rep_port, req_port)) = zeromq.start_services()
        {
            tracing::info!(
                "broker on {ip}: clients connect to port {rep_port}, servers to port {req_port}"
            );
        }
        if zeromq.broker_status().is_some() && std::mem::take(&mut tells_topics) {
            let (pub_port, sub_port) = (zeromq.pub_port(), zeromq.sub_port());
            tracing::info!(
                "broker on {ip}: listeners connect to port {pub_port}, publishers to port {sub_port}"
            );
        }
    };
    tell();
    if zeromq.broker_status().is_none() {
        tracing::warn!(
            "waits for the end of the broker that runs already, and takes its place then"
        );
    }
    while !shutdown.wait_until(Instant::now() + Duration::from_secs(1)) {
        tell();
        let (topics, services) = (zeromq.broker_status(), zeromq.service_broker_status());
        if let Some(reason) = topics.as_ref().and_then(|status| status.failure.as_ref()) {
            return Err(anyhow!("the broker stopped: {reason}").into());
        }
        if let Some(reason) = services.and_then(|status| status.failure) {
            return Err(anyhow!("the broker of requests stopped: {reason}").into());
        }
        if let Some(status) = topics.filter(|status| status.subscriptions != known) {
            known = status.subscriptions;
            tracing::info!("subscriptions: {known:?}");
        }
    }
    if let Some(status) = zeromq.broker_status() {
        tracing::info!("forwarded {} messages, {} bytes", status.messages, status.bytes);
    }
    if let Some(served) = zeromq.service_broker_status() {
        tracing::info!("forwarded {} requests, {} replies", served.requests, served.replies);
    }
    Ok(())
}

fn failed(error: ZeroMqError) -> Failure {
    if error.is_hopeless() { Failure::usage(error) } else { anyhow::Error::new(error).into() }
}
