//! Routes of services: a server of one middleware, offered on another.
//!
//! ```text
//!   { service: "yarp:/icub/head/rpc", as: "ros2:/icub/head/rpc", type: NativeObject }  ──▶  ServiceRouteSpec
//! ```

use std::fmt;
use std::time::Duration;

use wrapyfi_interfaces::store::TypeStore;

use super::config::{Defaults, RouteConfig, Spanned};
use super::config_error::Problem;
use super::plan::Available;
use super::plan_address::address;
use super::plan_options;
use crate::Limits;
use crate::endpoint::{BridgeMark, EndpointAddress, ServiceSpec};
use crate::types::{Map, ServiceKind};

/// By how much a request outlives the call that the route makes for it.
const ANSWER_MARGIN: Duration = Duration::from_secs(2);
/// Longest time that a call may be given, in milliseconds: an hour.
const LONGEST_TIMEOUT_MS: u64 = 3_600_000;

/// A route of a service as it will be run.
#[derive(Debug, Clone, PartialEq)]
pub struct ServiceRouteSpec {
    /// Name in tables, logs and errors.
    pub name: String,
    /// Where its server is.
    pub service: EndpointAddress,
    /// Where it is offered.
    pub offered: EndpointAddress,
    /// What is asked and returned.
    pub kind: ServiceKind,
    /// Time that a call has.
    pub timeout: Duration,
    /// Bounds on every request and reply.
    pub limits: Limits,
    /// Settings that only some middlewares have, by name.
    pub options: Map,
    /// Of a route that a pattern made: what its server announces.
    pub mark: Option<BridgeMark>,
}

impl ServiceRouteSpec {
    /// A route with default settings.
    #[must_use]
    pub fn new(service: EndpointAddress, offered: EndpointAddress, kind: ServiceKind) -> Self {
        Self {
            name: format!("{offered} -> {service}"),
            service,
            offered,
            kind,
            timeout: ServiceSpec::TIMEOUT,
            limits: Limits::default(),
            options: Map::default(),
            mark: None,
        }
    }

    /// What to open at `address`, one of the route's two ends.
    #[must_use]
    pub fn service_spec(&self, address: &EndpointAddress) -> ServiceSpec {
        // The route says by itself, and better, that the server did not answer.
        let margin = if *address == self.offered { ANSWER_MARGIN } else { Duration::ZERO };
        ServiceSpec {
            timeout: self.timeout.saturating_add(margin),
            limits: self.limits,
            options: self.options.clone(),
            mark: self.mark.clone(),
            ..ServiceSpec::new(address.name.clone(), self.kind)
        }
    }
}

impl fmt::Display for ServiceRouteSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { service, offered, kind, timeout, .. } = self;
        write!(f, "{offered} -> {service}  {}  within {} ms", kind.ros_type(), timeout.as_millis())
    }
}

/// True for an entry that means a service.
pub(super) fn is_service(config: &RouteConfig) -> bool {
    config.service.is_some() || config.offered.is_some()
}

pub(super) fn read(
    entry: &Spanned<RouteConfig>,
    defaults: &Defaults,
    middlewares: &[Available<'_>],
    types: &mut TypeStore,
) -> Result<ServiceRouteSpec, Vec<Problem>> {
    let config = &entry.value;
    let mut problems = Vec::new();
    for (key, written) in [("from", &config.from), ("to", &config.to)] {
        if let Some(written) = written {
            let text = format!("`{key}` stands beside a service: give service and as only");
            problems.push(Problem::at(written.referenced, text));
        }
    }
    for (key, is_given) in [
        ("from_type", config.from_type.is_some()),
        ("qos", config.qos.is_some()),
        ("encoding", config.encoding.is_some()),
        ("frame_id", config.frame_id.is_some()),
        ("stamp", config.stamp.is_some()),
        ("queue_depth", config.queue_depth.is_some()),
        ("overflow", config.overflow.is_some()),
        ("max_rate_hz", config.max_rate_hz.is_some()),
        ("devices", config.devices.is_some()),
        ("lazy", config.lazy.is_some()),
        ("merge", config.merge),
    ] {
        if is_given {
            let text = format!("{key} has no effect on a service");
            problems.push(Problem::at(entry.referenced, text));
        }
    }
    let mut end = |key: &str, written: &Option<Spanned<String>>| match written {
        Some(text) => address(text, middlewares).map_err(|problem| problems.push(problem)).ok(),
        None => {
            let text = format!("key `{key}` is missing: a service route has service and as");
            problems.push(Problem::at(entry.referenced, text));
            None
        }
    };
    let (service, offered) = (end("service", &config.service), end("as", &config.offered));
    // Without a type the entry is read elsewhere.
    let kind = config.message_type.as_ref().and_then(|written| {
        ServiceKind::resolve(&written.value, types)
            .map_err(|error| problems.push(Problem::at(written.referenced, error.to_string())))
            .ok()
    });
    let timeout_ms = config.timeout_ms.as_ref();
    if let Some(timeout) = timeout_ms.filter(|ms| !(1..=LONGEST_TIMEOUT_MS).contains(&ms.value)) {
        let (given, most) = (timeout.value, LONGEST_TIMEOUT_MS);
        let text = format!("timeout_ms is {given}, it must lie between 1 and {most}");
        problems.push(Problem::at(timeout.referenced, text));
    }
    let mib = config.max_message_mib.as_ref().map_or(defaults.max_message_mib, |mib| mib.value);
    if !(1..=2047).contains(&mib) {
        let text = format!("max_message_mib is {mib}, it must lie between 1 and 2047");
        problems.push(Problem::at(entry.referenced, text));
    }
    let (Some(service), Some(offered), Some(kind)) = (service, offered, kind) else {
        return Err(problems);
    };
    let options = plan_options::read(&config.options, [&service, &offered], middlewares)
        .map_err(|found| problems.extend(found))
        .unwrap_or_default();
    if service == offered {
        let text = format!("service {service} is offered as itself: it would call itself");
        problems.push(Problem::at(entry.referenced, text));
    }
    if !problems.is_empty() {
        return Err(problems);
    }
    let mut route = ServiceRouteSpec::new(service, offered, kind);
    if let Some(name) = &config.name {
        route.name.clone_from(name);
    }
    if let Some(timeout) = timeout_ms {
        route.timeout = Duration::from_millis(timeout.value);
    }
    route.limits.message_bytes = mib.saturating_mul(Limits::MIB);
    route.options = options;
    Ok(route)
}
