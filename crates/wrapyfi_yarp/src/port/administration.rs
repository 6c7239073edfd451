//! Answers of a port to administrative requests and to the commands of a text session.

use std::sync::Arc;

use super::core::{Core, Role};
use super::output::ConnectionStatus;
use crate::wire::Command;
use crate::wire::admin::{self, Direction};
use crate::{Bottle, Value};

/// Most properties that peers can leave at a port.
const MAX_PROPERTIES: usize = 1024;
/// Longest text of one of them.
const MAX_PROPERTY_BYTES: usize = 16 * 1024;

/// Scheduling of threads, as YARP's ports report it: tasks of ours have no threads of their own.
fn sched() -> Value {
    admin::dict("sched", [("tid", (-1).into()), ("priority", (-1).into()), ("policy", (-1).into())])
}

/// Verbs of the requests.
const VERBS: [&str; 10] =
    ["ver", "help", "add", "del", "list", "set", "get", "prop", "atch", "dtch"];

/// Carries a request out.
pub(super) async fn administer(port: &Arc<Core>, request: &Bottle) -> Bottle {
    let is = |at: usize, word: &str| request.get(at).is_some_and(|value| value.is_word(word));
    let text = |at: usize| request.get(at).map(admin::name).unwrap_or_default();
    let given = |at: usize| Some(text(at)).filter(|text| !text.is_empty());
    let directed = is(1, "in") || is(1, "out");
    let direction = if is(1, "in") { Direction::In } else { Direction::Out };
    let found = |name: &str| connections(port, direction).into_iter().find(|one| one.name == name);
    let verb = VERBS.into_iter().find(|verb| is(0, verb)).unwrap_or_default();
    match verb {
        "ver" => admin::version(),
        "help" => admin::help(),
        "add" => {
            let carrier = given(2).map(|carrier| carrier + ":/").unwrap_or_default();
            match port.add_output(&(carrier + &text(1))).await {
                Ok(sentence) => admin::done(sentence),
                Err(error) => admin::failed(error.0),
            }
        }
        "del" => remove(port, &text(1)).await,
        "list" => match given(2) {
            None => connections(port, direction).into_iter().map(|one| one.name.into()).collect(),
            Some(name) => found(&name).map_or_else(Bottle::new, |one| {
                let (from, to) = match direction {
                    Direction::In => (&one.name, &port.name),
                    Direction::Out => (&port.name, &one.name),
                };
                admin::details(from, to, &one.carrier, one.connectionless, one.push)
            }),
        },
        "set" | "get" => {
            let name = text(2);
            admin::configuration(direction, &name, found(&name).is_some(), verb == "set")
        }
        "prop" if is(1, "set") => {
            set_property(port, &text(2), request.values.iter().skip(3).cloned().collect())
        }
        "prop" if is(1, "get") => property(port, given(2).as_deref()),
        "atch" => {
            let name = &port.name;
            tracing::warn!(target: "wrapyfi_yarp::port", name, "port monitors are not available here");
            admin::attached(directed)
        }
        "dtch" => admin::detached(directed),
        _ => admin::not_understood(),
    }
}

fn connections(port: &Core, direction: Direction) -> Vec<ConnectionStatus> {
    let mut connections = port.status();
    connections.retain(|one| one.incoming == (direction == Direction::In));
    connections
}

/// `[del]`: outputs to a port, and inputs from it.
async fn remove(port: &Arc<Core>, name: &str) -> Bottle {
    let bare = admin::split_destination(name).map_or_else(|| name.to_owned(), |(_, name)| name);
    if port.remove_output(&bare).await {
        return admin::done(admin::removed(&port.name, name));
    }
    if remove_input(port, &bare) {
        return admin::done(admin::removing(name, &port.name));
    }
    let output = admin::no_output(name);
    admin::failed(format!("{output}\r\nCould not find an incoming connection from {name}"))
}

/// Carries a command out; the lines that answer it.
pub(super) async fn command(port: &Arc<Core>, command: &Command) -> String {
    let sentence = match command {
        Command::Describe => return describe(port),
        Command::Connect(name) => {
            // "/tcp://dst" names a carrier, "/dst" does not.
            let inner = name.get(1..).filter(|inner| inner.contains("://"));
            port.add_output(inner.unwrap_or(name)).await.unwrap_or_else(|error| error.0)
        }
        Command::RemoveOutput(name) => match port.remove_output(name).await {
            true => admin::removed(&port.name, name),
            false => admin::no_output(name),
        },
        Command::RemoveInput(name) => match remove_input(port, name) {
            true => admin::removing(name, &port.name),
            false => format!("Could not find an incoming connection from {name}"),
        },
        // Not for this port; everything else never gets here.
        _ => admin::NO_OUTPUTS.to_owned(),
    };
    format!("{sentence}\r\n")
}

/// The port and its connections, in lines.
pub(crate) fn describe(port: &Core) -> String {
    let name = &port.name;
    let mut lines = format!("This is {name} at tcp://{}/\r\n", port.contact);
    let outputs = connections(port, Direction::Out);
    for ConnectionStatus { name: to, carrier, .. } in &outputs {
        lines += &format!("There is an output connection from {name} to {to} using {carrier}\r\n");
    }
    if outputs.is_empty() {
        lines += "There are no outgoing connections\r\n";
    }
    let inputs = connections(port, Direction::In);
    for ConnectionStatus { name: from, carrier, .. } in &inputs {
        lines += &format!("There is an input connection from {from} to {name} using {carrier}\r\n");
    }
    if inputs.is_empty() {
        lines += "There are no incoming connections\r\n";
    }
    lines
}

/// Ends the inputs from a port; whether there was one.
fn remove_input(core: &Core, name: &str) -> bool {
    let connections = core.connections.lock();
    let found = connections.inputs.iter().filter(|input| input.status.name == name);
    found.inspect(|input| input.stop.notify_one()).count() > 0
}

fn set_property(core: &Core, key: &str, values: Bottle) -> Bottle {
    if key.starts_with('/') && key != core.name && !set_service(core, key, &values) {
        return admin::fail(None);
    }
    let mut connections = core.connections.lock();
    let properties = &mut connections.properties;
    let size = key.len().saturating_add(values.to_text_bytes().len());
    let full = properties.len() >= MAX_PROPERTIES && !properties.contains_key(key);
    if full || size > MAX_PROPERTY_BYTES {
        core.fault_counts.add("property_refused");
        return admin::fail(Some(&format!(
            "at most {MAX_PROPERTIES} properties of {MAX_PROPERTY_BYTES} bytes are kept"
        )));
    }
    properties.insert(key.to_owned(), values);
    admin::ok()
}

fn property(core: &Core, key: Option<&str>) -> Bottle {
    let connections = core.connections.lock();
    match key {
        Some(key) if key == core.name => about(core),
        Some(key) if key.starts_with('/') => {
            let output = connections.outputs.iter().find(|output| output.peer.name == key);
            if output.is_none() && !connections.inputs.iter().any(|input| input.status.name == key)
            {
                return admin::fail(Some(&format!("cannot find any connection to/from {key}")));
            }
            let socket = output.and_then(|output| output.socket.as_ref());
            let service = socket
                .and_then(|socket| socket2::SockRef::from(&**socket).tos_v4().ok().map(i64::from));
            let service = service.unwrap_or(-1);
            [sched(), admin::dict("qos", [("tos", service.into())])].into_iter().collect()
        }
        Some(key) => connections.properties.get(key).cloned().unwrap_or_default(),
        None => {
            let pair = |(key, values): (&String, &Bottle)| {
                let key = std::iter::once(Value::from(key.as_str()));
                Value::from(key.chain(values.values.iter().cloned()).collect::<Bottle>())
            };
            connections.properties.iter().map(pair).collect()
        }
    }
}

/// Sets the type of service of the connection with `peer`; whether there is one that took it.
fn set_service(core: &Core, peer: &str, values: &Bottle) -> bool {
    let service = admin::type_of_service(values);
    if service.is_none() && values.find("qos").is_some() {
        return false;
    }
    let connections = core.connections.lock();
    let output = connections.outputs.iter().find(|output| output.peer.name == peer);
    if let (Some(output), Some(service)) = (output, service)
        && let Some(socket) = &output.socket
    {
        return socket2::SockRef::from(&**socket).set_tos_v4(service).is_ok();
    }
    output.is_some() || connections.inputs.iter().any(|input| input.status.name == peer)
}

/// Description of the port, as YARP's ports give it to `yarpconnectionsinfo` and to bridges.
fn about(core: &Core) -> Bottle {
    let program = std::env::args_os().next().map(std::path::PathBuf::from);
    let program = program.as_deref().and_then(std::path::Path::file_name);
    let program = program.map_or_else(|| "unknown".into(), |name| name.to_string_lossy());
    let host = core.contact.rsplit_once(':').map_or(&*core.contact, |(host, _)| host);
    let flag = |set: bool| Value::from(i32::from(set));
    let process = [
        ("pid", i64::from(std::process::id()).into()),
        ("name", Value::string(program.as_ref())),
        // Words behind a command are not read.
        ("arguments", Value::string("")),
        ("priority", 0.into()),
        ("policy", 0.into()),
    ];
    let platform = [("os", Value::string("Linux")), ("hostname", Value::string(host))];
    let port = [
        ("is_input", flag(core.handler.is_some())),
        ("is_output", flag(core.role != Role::Input)),
        ("is_rpc", flag(core.options.rpc || core.role == Role::Client)),
        ("type", "".into()),
    ];
    let process = admin::dict("process", process);
    [sched(), process, admin::dict("platform", platform), admin::dict("port", port)]
        .into_iter()
        .collect()
}
