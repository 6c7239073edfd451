//! A configuration file: its section `endpoints`, its routes, their types.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{MessageType, ServiceKind};
use wrapyfi_endpoint::EndpointAddress;
use wrapyfi_endpoint::network::{Hosts, Place};
use wrapyfi_engine::{
    Config, ConfigError, Kind, Plan, Problem, Reading, Route, RouteConfig, Spanned,
};
use wrapyfi_interfaces::store::TypeStore;

use super::learn;
use super::ros1::Ros1Section;
use super::ros2::Ros2Section;
use super::yarp::YarpSection;
use super::zeromq::ZeroMqSection;
use crate::command::definitions;
use crate::edits::SOURCE;
use crate::exit::{Failure, Result};
use crate::files::read_file;
use crate::own_address::OwnAddress;

/// The `endpoints` section of a configuration: how each middleware is reached.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Endpoints {
    /// The ZeroMQ broker.
    pub zeromq: ZeroMqSection,
    /// The ROS 2 graph.
    pub ros2: Ros2Section,
    /// The ROS 1 master.
    pub ros: Ros1Section,
    /// YARP's name server, and our ports.
    pub yarp: YarpSection,
    /// `hosts` of the configuration.
    #[serde(skip)]
    pub hosts: Hosts,
}

impl Endpoints {
    /// Says at which address others reach the endpoints, before what the sections say.
    pub fn reached_at(&mut self, own: OwnAddress) {
        for insecure in [&mut self.yarp.insecure.0, &mut self.ros.insecure.0] {
            insecure.said(Place::Argument, own.ip.is_some(), own.insecure);
        }
        // Nobody is told an address of ours on ZeroMQ: the broker's is what the word is about.
        self.zeromq.insecure.0.said(Place::Argument, false, own.insecure);
        if let Some(ip) = own.ip {
            self.yarp.say_ip(ip.to_string());
            self.ros.hostname = Some(ip.to_string());
        }
    }

    /// Checks what the middlewares check of their settings when they start, as far as it asks nobody.
    pub(super) fn check(&self) -> impl Iterator<Item = Problem> {
        let checked = [self.yarp.check(), self.zeromq.check(), self.ros2.check(), self.ros.check()];
        checked.into_iter().filter_map(Result::err)
    }

    /// Checks that nothing would listen where other machines reach it without permission. Parameters and arguments
    /// say where, and permit it, too: only what they have changed can be judged.
    ///
    /// # Errors
    /// Exit code 2 with the line of the address in `file`, where it is from there, and the word that permits it.
    pub fn check_permitted(&self, file: Option<&Path>) -> Result<()> {
        let checked = self.zeromq.check_permitted(&self.hosts);
        let checked = checked.and_then(|()| self.yarp.check_permitted());
        let problem = match checked.and_then(|()| self.ros.check_permitted(&self.hosts)) {
            Ok(()) => return Ok(()),
            Err(problem) => problem,
        };
        Err(match (file, problem.position) {
            (Some(file), Some((1.., _))) => {
                let file = file.display().to_string();
                Failure::usage(ConfigError { file, problems: vec![problem] })
            }
            _ => Failure::Usage(problem.message),
        })
    }
}

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
    load_with(file, &[], |_, _| Ok(()))
}

/// As [`load`]; types of routes from ROS 1 that nobody here has are asked from their publishers, with the settings as
/// `change` leaves them. Entries that were `added` stand after those of the file.
///
/// # Errors
/// As [`load`] and `change`, and exit code 1 when ROS 1 does not start.
pub fn load_and_learn(
    file: &Path,
    added: &[Spanned<RouteConfig>],
    change: impl FnOnce(&mut Endpoints) -> Result<()>,
) -> Result<Loaded> {
    load_with(file, added, |config, types| {
        change(&mut config.endpoints)?;
        learn::from_publishers(config, types)
    })
}

/// A type that a route names and nobody here has a definition of.
#[derive(Debug)]
pub struct Undefined {
    /// Name of the route, else its ends.
    pub route: String,
    /// The type.
    pub type_name: String,
    /// Cause.
    pub reason: String,
}

/// As [`load`]; notes the type that nobody here has a definition of, where `meant` is it, its route's name, both ends or
/// one of them.
///
/// # Errors
/// As [`load`].
pub fn load_noting(file: &Path, meant: &str, undefined: &mut Option<Undefined>) -> Result<Loaded> {
    load_with(file, &[], |config, types| {
        let text = |written: &Option<Spanned<String>>| Some(written.as_ref()?.value.clone());
        for Spanned { value: route, .. } in &config.routes {
            let from = text(&route.from).or_else(|| text(&route.service)).unwrap_or_default();
            let to = text(&route.to).or_else(|| text(&route.offered)).unwrap_or_default();
            let both = format!("{from} -> {to}");
            let name = route.name.as_ref().unwrap_or(&both);
            for type_name in [&route.message_type, &route.from_type].into_iter().filter_map(text) {
                let reason = match route.service {
                    Some(_) => {
                        ServiceKind::resolve(&type_name, types).err().map(|it| it.to_string())
                    }
                    None => MessageType::resolve(&type_name, types).err().map(|it| it.to_string()),
                };
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
    learn: impl FnOnce(&mut Config<Endpoints>, &mut TypeStore) -> Result<()>,
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
    read(text.to_owned(), name, Path::new(""), &[], |_, _| Ok(()))
}

fn read(
    text: String,
    name: &str,
    beside: &Path,
    added: &[Spanned<RouteConfig>],
    learn: impl FnOnce(&mut Config<Endpoints>, &mut TypeStore) -> Result<()>,
) -> Result<Loaded> {
    let Reading { value, mut problems, .. } = Config::<Endpoints>::read(&text, example);
    let refused = |mut problems: Vec<Problem>| {
        problems.sort_by_key(|problem| problem.position);
        Failure::usage(ConfigError { file: name.to_owned(), problems })
    };
    let Some(mut config) = value else { return Err(refused(problems)) };
    config.routes.extend_from_slice(added);
    let waiting_bytes = check(&mut config, beside, &mut problems);
    let folders: Vec<_> =
        config.definitions.iter().map(|folder| beside.join(&folder.value)).collect();
    for (written, folder) in config.definitions.iter().zip(&folders) {
        let fault = |text| Problem::at(written.referenced, format!("definitions {text}"));
        problems.extend(definitions::check(folder).map_err(fault).err());
    }
    let mut types = definitions::store(&folders);
    let is_readable = problems.is_empty();
    if is_readable {
        learn(&mut config, &mut types)?;
    }
    let available = super::available::available();
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
    problems.extend(check_services(&plan).err().map(|(index, message)| {
        match config.routes.get(index).filter(|_| is_whole) {
            Some(entry) => Problem::at(entry.referenced, message),
            None => Problem { position: None, message },
        }
    }));
    if !problems.is_empty() {
        return Err(refused(problems));
    }
    // A plan that is valid has a route for each entry.
    let lines = config.routes.iter().map(|entry| entry.referenced.line()).collect();
    let (endpoints, page_port) = (config.endpoints, config.page.port);
    let definitions = folders;
    let file = None;
    Ok(Loaded { endpoints, plan, types, waiting_bytes, definitions, page_port, lines, text, file })
}

/// Example of a value that a key of the endpoints, or a list of routes between them, may have.
fn example(key: &str) -> Option<&'static str> {
    Some(match key {
        "endpoints" => "{ zeromq: { broker: foreign } }",
        "zeromq" => "{ broker: foreign }",
        "ros2" => "{ domain_id: 0 }",
        "ros" => "{ master_uri: \"http://localhost:11311\" }",
        "yarp" => "{ name_server: \"127.0.0.1:10000\" }",
        "routes" => "[{ from: \"zeromq:/a\", to: \"ros2:/a\", type: Text }]",
        "domain_id" => "0",
        "pub_port" => "5555",
        "sub_port" => "5556",
        "rep_port" => "5558",
        "req_port" => "5559",
        "insecure" | "embedded" => "true",
        _ => return None,
    })
}

/// Bytes that may wait in the queues of this process.
fn waiting_bytes(config: &Config<Endpoints>) -> Result<usize, Problem> {
    let Some(mib) = &config.limits.waiting_mib else { return Ok(Limits::WAITING_BYTES) };
    mib.value.checked_mul(Limits::MIB).filter(|bytes| *bytes > 0).ok_or_else(|| {
        let text = format!("waiting_mib is {}, it must be at least 1", mib.value);
        Problem::at(mib.referenced, text)
    })
}

/// The names of machines that the configuration maps to addresses.
fn hosts(config: &Config<Endpoints>, problems: &mut Vec<Problem>) -> Hosts {
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

/// Finds what can be found wrong before anything is started, and reads what the sections name. Bytes that may wait in
/// the queues of this process.
fn check(config: &mut Config<Endpoints>, beside: &Path, problems: &mut Vec<Problem>) -> usize {
    config.endpoints.hosts = hosts(config, problems);
    config.endpoints.zeromq.find_keys(beside);
    problems.extend(config.endpoints.check());
    problems.extend(config.endpoints.ros.read_rules(beside).err());
    waiting_bytes(config).unwrap_or_else(|problem| {
        problems.push(problem);
        Limits::WAITING_BYTES
    })
}

/// Refuses services of zeromq that cannot be told apart: the index of the route, and the fault. Routes that call one
/// name share its server.
fn check_services(plan: &Plan) -> Result<(), (usize, String)> {
    let is_zeromq = |end: &EndpointAddress| end.middleware == "zeromq";
    let mut services = plan.routes.iter().enumerate().filter(|(_, it)| {
        matches!(it.kind, Kind::Service(_)) && (is_zeromq(&it.from) || is_zeromq(&it.to))
    });
    let is_nameless = |it: &Route| !it.is_whole() && (is_zeromq(&it.from) || it.is_many());
    if let Some((index, pattern)) = services.clone().find(|(_, it)| is_nameless(it)) {
        let fault = format!(
            "{}: services of zeromq have no names, and tell no types: a pair of ports is one service; \
             write a route for it, with a type",
            pattern.name
        );
        return Err((index, fault));
    }
    let Some((_, one)) = services.next() else { return Ok(()) };
    let shares_server = |it: &Route| is_zeromq(&it.from) && it.from == one.from;
    match services.find(|(_, it)| !shares_server(it)) {
        Some((index, other)) => Err((
            index,
            format!(
                "{} and {}: a pair of ports of zeromq is one service, and each would get the requests of the other; \
                 give one of them to another bridge, on other ports (endpoints.zeromq.rep_port, req_port)",
                one.ends(),
                other.ends()
            ),
        )),
        None => Ok(()),
    }
}

#[cfg(test)]
#[path = "load_tests.rs"]
mod tests;
