//! A configuration file: its section `endpoints`, its routes, their types.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};

use wrapyfi_data::Limits;
use wrapyfi_data::types::{MessageType, ServiceKind};
use wrapyfi_endpoint::Interaction;
use wrapyfi_endpoint::config::read_file;
use wrapyfi_endpoint::driver::{Carries, RouteFacts, ServerAddress};
use wrapyfi_endpoint::network::Hosts;
use wrapyfi_engine::{
    Config, ConfigError, Plan, Problem, Reading, RouteConfig, RouteTypes, Spanned, Typing,
};
use wrapyfi_interfaces::store::TypeStore;

use super::endpoints::{Endpoints, SectionNames};
use super::learn;
use crate::command::definitions;
use crate::edits::SOURCE;
use crate::exit::{Failure, Result};

/// A configuration that was read and checked.
#[derive(Debug)]
pub struct Loaded {
    /// Settings by which each middleware is reached.
    pub endpoints: Endpoints,
    /// The routes.
    pub plan: Plan,
    /// Source of the routes' types.
    pub types: TypeStore,
    /// Bytes that may wait in the queues of the process.
    pub waiting_bytes: usize,
    /// Folders of definitions.
    pub definitions: Vec<PathBuf>,
    /// Port of the live page, where there is one.
    pub page_port: Option<u16>,
    /// Line of each route in the file.
    pub lines: Vec<u64>,
    /// The text that was read.
    pub text: String,
    /// The file that it was read from, if it was.
    pub file: Option<PathBuf>,
}

/// Reads and checks a configuration file.
///
/// # Errors
/// Exit code 2 with every fault, each with its line.
pub fn load(file: &Path) -> Result<Loaded> {
    load_with(file, &[], |_, _, _| Ok(()))
}

/// As [`load`]; types of routes from ROS 1 that this program does not know are asked from their publishers, with the
/// settings as `change` leaves them. Entries that were `added` stand after those of the file.
///
/// # Errors
/// As [`load`] and `change`, and exit code 1 when ROS 1 does not start.
pub fn load_and_learn(
    file: &Path,
    added: &[Spanned<RouteConfig>],
    change: impl FnOnce(&mut Endpoints) -> Result<()>,
) -> Result<Loaded> {
    load_with(file, added, |endpoints, routes, types| {
        change(endpoints)?;
        learn::from_publishers(endpoints, routes, types)
    })
}

/// A type that a route names and of which this program has no definition.
#[derive(Debug)]
pub struct Undefined {
    /// Name of the route, else its ends.
    pub route: String,
    /// The type.
    pub type_name: String,
    /// Cause.
    pub reason: String,
}

/// As [`load`]; notes the type of which this program has no definition, where `meant` is it, its route's name, both
/// ends or one of them.
///
/// # Errors
/// As [`load`].
pub fn load_noting(file: &Path, meant: &str, undefined: &mut Option<Undefined>) -> Result<Loaded> {
    load_with(file, &[], |_, routes, types| {
        let text = |written: &Option<Spanned<String>>| Some(written.as_ref()?.value.clone());
        for Spanned { value: route, .. } in routes {
            let ends = route.ends().map(|end| end.map(|end| end.value.clone()).unwrap_or_default());
            let [from, to] = ends;
            let both = format!("{from} -> {to}");
            let name = route.name.as_ref().unwrap_or(&both);
            for type_name in [&route.message_type, &route.from_type].into_iter().filter_map(text) {
                let fault = match route.interaction() {
                    Interaction::Service => ServiceKind::resolve(&type_name, types).err(),
                    _ => MessageType::resolve(&type_name, types).err(),
                };
                let reason = fault.map(|it| it.to_string());
                let is_meant = [name, &from, &to, &both, &type_name].iter().any(|it| *it == meant);
                if let Some(reason) = reason.filter(|_| is_meant) {
                    *undefined = Some(Undefined { route: name.clone(), type_name, reason });
                }
            }
        }
        Ok(())
    })
}

fn load_with(
    file: &Path,
    added: &[Spanned<RouteConfig>],
    learn: impl FnOnce(&mut Endpoints, &[Spanned<RouteConfig>], &mut TypeStore) -> Result<()>,
) -> Result<Loaded> {
    let name = file.display().to_string();
    // Read no further than a configuration may be long: what has no end is one, too.
    let text = read_file(file).map_err(|error| Failure::usage(format!("{name}: {error}")))?;
    // As seen from the file, wherever the program was started.
    let beside = file.parent().unwrap_or(Path::new(""));
    let loaded = read(text, &name, beside, added, learn)?;
    Ok(Loaded { file: Some(file.to_owned()), ..loaded })
}

/// Reads and checks a configuration that is in no file; `name` stands for it in errors.
///
/// # Errors
/// As [`load`].
pub fn load_text(text: &str, name: &str) -> Result<Loaded> {
    read(text.to_owned(), name, Path::new(""), &[], |_, _, _| Ok(()))
}

fn read(
    text: String,
    name: &str,
    beside: &Path,
    added: &[Spanned<RouteConfig>],
    learn: impl FnOnce(&mut Endpoints, &[Spanned<RouteConfig>], &mut TypeStore) -> Result<()>,
) -> Result<Loaded> {
    let Reading { value, mut problems, .. } = Config::<SectionNames>::read(&text, example);
    let refused = |mut problems: Vec<Problem>| {
        problems.sort_by_key(|problem| problem.position);
        Failure::usage(ConfigError { file: name.to_owned(), problems })
    };
    let written = value.as_ref().map(|config| &config.endpoints);
    let mut endpoints = Endpoints::read(&text, written, &mut problems);
    let Some(mut config) = value else { return Err(refused(problems)) };
    config.routes.extend_from_slice(added);
    endpoints.hosts = hosts(&config, &mut problems);
    // What can be found wrong before anything is started.
    problems.extend(endpoints.check(Some(beside)));
    let waiting_bytes = waiting_bytes(&config).unwrap_or_else(|problem| {
        problems.push(problem);
        Limits::WAITING_BYTES
    });
    let folders: Vec<_> =
        config.definitions.iter().map(|folder| beside.join(&folder.value)).collect();
    for (written, folder) in config.definitions.iter().zip(&folders) {
        let fault = |text| Problem::at(written.referenced, format!("definitions {text}"));
        problems.extend(definitions::check(folder).map_err(fault).err());
    }
    let mut types = definitions::store(&folders);
    let is_readable = problems.is_empty();
    if is_readable {
        learn(&mut endpoints, &config.routes, &mut types)?;
    }
    let available = super::drivers::available();
    let (plan, mut own) = Plan::read(&config, &available, &mut types);
    if !added.is_empty() && !own.is_empty() {
        // What the file by itself does not have is told without a line of it.
        config.routes.truncate(config.routes.len().saturating_sub(added.len()));
        let (_, of_file) = Plan::read(&config, &available, &mut types);
        for problem in own.iter_mut().filter(|it| !of_file.contains(it)) {
            let message = format!("{SOURCE}: {}", problem.message);
            *problem = Problem { position: None, message };
        }
    }
    // Routes that could not be read are left out: that none remains is no fault of its own.
    problems.extend(own.into_iter().filter(|it| is_readable || it.position.is_some()));
    // Where every entry is a route, they stand in one order.
    let is_whole = plan.routes.len() == config.routes.len();
    problems.extend(Endpoints::check_routes(&route_facts(&plan)).err().map(|(index, message)| {
        match config.routes.get(index).filter(|_| is_whole) {
            Some(entry) => Problem::at(entry.referenced, message),
            None => Problem { position: None, message },
        }
    }));
    problems.extend(page_taken(&config, &endpoints, &plan));
    if !problems.is_empty() {
        return Err(refused(problems));
    }
    // A plan that is valid has a route for each entry.
    let lines = config.routes.iter().map(|entry| entry.referenced.line()).collect();
    let page_port = config.page.port.map(|port| port.value);
    let definitions = folders;
    let file = None;
    Ok(Loaded { endpoints, plan, types, waiting_bytes, definitions, page_port, lines, text, file })
}

/// Example of a value that a key of the whole file may have.
fn example(key: &str) -> Option<&'static str> {
    match key {
        "endpoints" => Some(super::endpoints::example()),
        "routes" => Some("[{ from: \"zeromq:/a\", to: \"ros2:/a\", type: Text }]"),
        _ => None,
    }
}

/// Fault of a page at the port of a server on this machine that the routes need, such as a broker.
fn page_taken(
    config: &Config<SectionNames>,
    endpoints: &Endpoints,
    plan: &Plan,
) -> Option<Problem> {
    let written = config.page.port.as_ref().filter(|port| port.value != 0)?;
    let is_here = |host: &str| match host.parse::<IpAddr>() {
        Ok(ip) => ip.is_unspecified() || ip == Ipv4Addr::LOCALHOST,
        Err(_) => matches!(host, "localhost" | "*"),
    };
    let ends = plan.routes.iter().flat_map(|route| {
        [&route.from, &route.to].map(|end| (end.middleware.as_str(), route.interaction()))
    });
    let ends: BTreeSet<_> = ends.collect();
    let servers = ends.into_iter().flat_map(|(name, interaction)| {
        // Settings by which no server can be named are faults of their own.
        endpoints.servers(name, interaction).unwrap_or_default()
    });
    let mut ports: Vec<_> = servers.filter(|it| is_here(&it.host)).collect();
    let taken = ports.iter().position(|it| it.port == written.value)?;
    let ServerAddress { server, host, port, .. } = ports.swap_remove(taken);
    let free = (8642..).find(|free| *free != port && ports.iter().all(|it| it.port != *free))?;
    let text = format!(
        "page: port is {port}, which the {server} at {host} has: give the page a port of its own, such as page: {{ port: \
         {free} }}"
    );
    Some(Problem::at(written.referenced, text))
}

/// Bytes that may wait in the queues of this process.
fn waiting_bytes(config: &Config<SectionNames>) -> Result<usize, Problem> {
    let Some(mib) = &config.limits.waiting_mib else { return Ok(Limits::WAITING_BYTES) };
    mib.value.checked_mul(Limits::MIB).filter(|bytes| *bytes > 0).ok_or_else(|| {
        let text = format!("waiting_mib is {}, it must be at least 1", mib.value);
        Problem::at(mib.referenced, text)
    })
}

/// The names of machines that the configuration maps to addresses.
fn hosts(config: &Config<SectionNames>, problems: &mut Vec<Problem>) -> Hosts {
    let address = |(host, written): (&String, &Spanned<String>)| match written.value.parse() {
        Ok(ip) => Some((host.clone(), ip)),
        Err::<IpAddr, _>(_) => {
            let text = format!(
                "hosts: {host} is {:?}, which is no address; write it as 192.168.1.7",
                written.value
            );
            problems.push(Problem::at(written.referenced, text));
            None
        }
    };
    config.hosts.iter().filter_map(address).collect()
}

/// Routes of a plan as the checks of middlewares have them.
pub(crate) fn route_facts(plan: &Plan) -> Vec<RouteFacts<'_>> {
    let facts = plan.routes.iter().map(|route| RouteFacts {
        name: &route.name,
        ends: route.ends(),
        from: &route.from,
        to: &route.to,
        carries: match route.types {
            RouteTypes::Topic(types) => Carries::Topic(types.from, types.to),
            RouteTypes::Service(kind) => Carries::Service(kind),
            RouteTypes::Action(kind) => Carries::Action(kind),
        },
        is_typed: route.typing == Typing::Given,
        is_whole: route.is_whole(),
        is_many: route.is_many(),
    });
    facts.collect()
}

#[cfg(test)]
#[path = "load_tests.rs"]
mod tests;
