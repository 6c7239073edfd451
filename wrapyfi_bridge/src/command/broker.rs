//! `wrapyfi broker`: the places where Wrapyfi's publishers and listeners, clients and servers meet,
//! standalone.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use wrapyfi_endpoint::network::{Place, is_of_this_machine};
use wrapyfi_zeromq::{BrokerError, BrokerMode, CurveClient, ZeroMq, ZeroMqConfig, ZeroMqError};

use crate::cli::BrokerArgs;
use crate::exit::{Failure, Result};
use crate::shutdown::Shutdown;

/// Topics that one line of the log names.
const MOST_TOPICS: usize = 16;
/// Letters of a topic's name in the log.
const MOST_OF_NAME: usize = 100;

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
        config.check_keys().map_err(Failure::Usage)?;
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
        Err(error @ ZeroMqError::PortTaken { .. })
            if args.ports.rep_port.or(args.ports.req_port).is_none() =>
        {
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
        let subscriptions = topics.map(|status| status.subscriptions).unwrap_or_default();
        if let Some(changes) = changes(&known, &subscriptions) {
            tracing::info!("listeners: {changes}");
        }
        known = subscriptions;
    }
    if let Some(status) = zeromq.broker_status() {
        tracing::info!("forwarded {} messages, {} bytes", status.messages, status.bytes);
    }
    if let Some(served) = zeromq.service_broker_status() {
        tracing::info!("forwarded {} requests, {} replies", served.requests, served.replies);
    }
    Ok(())
}

/// Topics whose number of listeners has changed, in words, as far as they fit on a line; `None` where none has.
fn changes(before: &BTreeMap<String, u64>, now: &BTreeMap<String, u64>) -> Option<String> {
    let gone = before.keys().filter(|topic| !now.contains_key(*topic)).map(|topic| (topic, &0));
    let changed = now.iter().chain(gone);
    let mut changed = changed.filter(|(topic, count)| before.get(*topic).unwrap_or(&0) != *count);
    let shown: Vec<_> = changed
        .by_ref()
        .take(MOST_TOPICS)
        .map(|(topic, count)| {
            let name: String = topic.chars().take(MOST_OF_NAME).collect();
            let more = if name.len() < topic.len() { "…" } else { "" };
            format!("{name}{more} {count}")
        })
        .collect();
    let others = changed.count();
    let more = if others > 0 { format!(", and {others} other topics") } else { String::new() };
    (!shown.is_empty()).then(|| shown.join(", ") + &more)
}

fn failed(error: ZeroMqError) -> Failure {
    if error.is_hopeless() { Failure::usage(error) } else { anyhow::Error::new(error).into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_has_what_changed_and_no_more_than_a_line_of_it() {
        let topics = |range: std::ops::Range<usize>, count| -> BTreeMap<String, u64> {
            range.map(|number| (format!("/{number:04}"), count)).collect()
        };
        let few = topics(0..3, 1);
        assert_eq!(changes(&BTreeMap::new(), &few).unwrap(), "/0000 1, /0001 1, /0002 1");
        assert_eq!(changes(&few, &few), None);
        let mut other = few.clone();
        other.insert("/0001".into(), 2);
        other.remove("/0002");
        assert_eq!(changes(&few, &other).unwrap(), "/0001 2, /0002 0");
        other.insert("/0002".into(), 0);
        assert_eq!(changes(&few, &other).unwrap(), "/0001 2, /0002 0");
        let many = changes(&few, &topics(0..4000, 2)).unwrap();
        assert!(many.ends_with("/0015 2, and 3984 other topics"), "{many}");
        let long = changes(&BTreeMap::new(), &BTreeMap::from([("é".repeat(60_000), 1)])).unwrap();
        assert!(long.len() < 300 && long.ends_with("é… 1"), "{long}");
    }
}
