//! Answers of a port to administrative requests and to the commands of a text session.

use std::sync::Arc;

use super::core::{Core, Sink};
use crate::wire::Command;
use crate::wire::admin::{self, AdminRequest, Direction};
use crate::{Bottle, Value};

/// Most properties that peers can leave at a port.
const MAX_PROPERTIES: usize = 1024;
/// Longest text of one of them.
const MAX_PROPERTY_BYTES: usize = 16 * 1024;

/// Scheduling of threads, as YARP's ports report it: tasks of ours have no threads of their own.
fn sched() -> Value {
    admin::dict("sched", [("tid", (-1).into()), ("priority", (-1).into()), ("policy", (-1).into())])
}

impl Core {
    /// Carries a request out.
    pub(super) async fn administer(self: &Arc<Self>, request: &Bottle) -> Bottle {
        match AdminRequest::parse(request) {
            AdminRequest::Version => admin::version(),
            AdminRequest::Help => admin::help(),
            AdminRequest::Add { destination } => match self.add_output(&destination).await {
                Ok(sentence) => admin::done(sentence),
                Err(error) => admin::failed(error.0),
            },
            AdminRequest::Remove { name } => self.remove(&name).await,
            AdminRequest::List { direction, name } => self.listed(direction, name.as_deref()),
            AdminRequest::Configure { direction, name } => {
                admin::configuration(direction, &name, self.has(direction, &name), true)
            }
            AdminRequest::Configuration { direction, name } => {
                admin::configuration(direction, &name, self.has(direction, &name), false)
            }
            AdminRequest::SetProperty { key, values } => self.set_property(&key, values),
            AdminRequest::Property { key } => self.property(key.as_deref()),
            AdminRequest::Attach { directed } => {
                let name = &self.name;
                tracing::warn!(target: "wrapyfi_yarp::port", name, "port monitors are not available here");
                admin::attached(directed)
            }
            AdminRequest::Detach { directed } => admin::detached(directed),
            AdminRequest::Unknown => admin::not_understood(),
        }
    }

    /// Carries a command out; the lines that answer it.
    pub(super) async fn command(self: &Arc<Self>, command: &Command) -> String {
        let sentence = match command {
            Command::Describe => return self.describe(),
            Command::Connect(name) => {
                // "/tcp://dst" names a carrier, "/dst" does not.
                let inner = name.get(1..).filter(|inner| inner.contains("://"));
                match self.add_output(inner.unwrap_or(name)).await {
                    Ok(sentence) => sentence,
                    Err(error) => error.0,
                }
            }
            Command::RemoveOutput(name) => match self.remove_output(name).await {
                true => admin::removed(&self.name, name),
                false => admin::no_output(name),
            },
            Command::RemoveInput(name) => match self.remove_input(name) {
                true => admin::removing(name, &self.name),
                false => admin::no_input(name),
            },
            // Not for this port; everything else never gets here.
            _ => admin::NO_OUTPUTS.to_owned(),
        };
        format!("{sentence}\r\n")
    }

    /// The port and its connections, in lines.
    pub(super) fn describe(&self) -> String {
        let name = &self.name;
        let mut lines = format!("This is {name} at tcp://{}/\r\n", self.contact);
        let connections = self.connections.lock();
        for output in &connections.outputs {
            let (to, carrier) = (&output.name, &output.carrier_text);
            lines +=
                &format!("There is an output connection from {name} to {to} using {carrier}\r\n");
        }
        if connections.outputs.is_empty() {
            lines += "There are no outgoing connections\r\n";
        }
        for input in &connections.inputs {
            let (from, carrier) = (&input.name, &input.carrier);
            lines +=
                &format!("There is an input connection from {from} to {name} using {carrier}\r\n");
        }
        if connections.inputs.is_empty() {
            lines += "There are no incoming connections\r\n";
        }
        lines
    }

    /// `[del]`: outputs to a port, and inputs from it.
    async fn remove(self: &Arc<Self>, name: &str) -> Bottle {
        let bare = admin::split_destination(name).map_or_else(|| name.to_owned(), |(_, name)| name);
        if self.remove_output(&bare).await {
            return admin::done(admin::removed(&self.name, name));
        }
        if self.remove_input(&bare) {
            return admin::done(admin::removing(name, &self.name));
        }
        let (output, input) = (admin::no_output(name), admin::no_input(name));
        admin::failed(format!("{output}\r\n{input}"))
    }

    /// Ends the inputs from `name`; whether there was one.
    pub(super) fn remove_input(&self, name: &str) -> bool {
        let connections = self.connections.lock();
        let mut found = false;
        for input in connections.inputs.iter().filter(|input| input.name == name) {
            input.stop.notify_one();
            found = true;
        }
        found
    }

    fn has(&self, direction: Direction, name: &str) -> bool {
        let connections = self.connections.lock();
        match direction {
            Direction::In => connections.inputs.iter().any(|input| input.name == name),
            Direction::Out => connections.outputs.iter().any(|output| output.name == name),
        }
    }

    fn listed(&self, direction: Direction, name: Option<&str>) -> Bottle {
        let connections = self.connections.lock();
        let (inputs, outputs) = (&connections.inputs, &connections.outputs);
        match (direction, name) {
            (Direction::In, None) => {
                inputs.iter().map(|input| input.name.as_str().into()).collect()
            }
            (Direction::Out, None) => {
                outputs.iter().map(|output| output.name.as_str().into()).collect()
            }
            (Direction::In, Some(name)) => {
                let found = inputs.iter().find(|input| input.name == name);
                found.map_or_else(Bottle::new, |input| {
                    let (less, push) = (input.connectionless, input.push);
                    admin::details(&input.name, &self.name, &input.carrier, less, push)
                })
            }
            (Direction::Out, Some(name)) => {
                let found = outputs.iter().find(|output| output.name == name);
                found.map_or_else(Bottle::new, |output| {
                    let (less, push) =
                        (output.carrier.is_connectionless(), output.carrier.is_push());
                    let carrier = &output.carrier_text;
                    admin::details(&self.name, &output.name, carrier, less, push)
                })
            }
        }
    }

    fn set_property(&self, key: &str, values: Bottle) -> Bottle {
        if key.starts_with('/') && key != self.name && !self.set_service(key, &values) {
            return admin::fail(None);
        }
        let mut connections = self.connections.lock();
        let properties = &mut connections.properties;
        let size = key.len().saturating_add(values.to_text_bytes().len());
        let full = properties.len() >= MAX_PROPERTIES && !properties.contains_key(key);
        if full || size > MAX_PROPERTY_BYTES {
            self.counters.add("property_refused");
            return admin::fail(Some(&format!(
                "at most {MAX_PROPERTIES} properties of {MAX_PROPERTY_BYTES} bytes are kept"
            )));
        }
        properties.insert(key.to_owned(), values);
        admin::ok()
    }

    /// Sets the type of service of the connection with `peer`; whether there is one that took it.
    fn set_service(&self, peer: &str, values: &Bottle) -> bool {
        let service = admin::type_of_service(values);
        if service.is_none() && values.find("qos").is_some() {
            return false;
        }
        let connections = self.connections.lock();
        let output = connections.outputs.iter().find(|output| output.name == peer);
        if let (Some(output), Some(service)) = (output, service)
            && let Some(socket) = &output.socket
        {
            return socket2::SockRef::from(&**socket).set_tos_v4(service).is_ok();
        }
        output.is_some() || connections.inputs.iter().any(|input| input.name == peer)
    }

    /// Description of the port, as YARP's ports give it to `yarpconnectionsinfo` and to bridges.
    fn about(&self) -> Bottle {
        let program = std::env::args_os().next().map(std::path::PathBuf::from);
        let program = program.as_deref().and_then(std::path::Path::file_name);
        let program = program.map_or_else(|| "unknown".into(), |name| name.to_string_lossy());
        let host = self.contact.rsplit_once(':').map_or(&*self.contact, |(host, _)| host);
        let flag = |set: bool| Value::from(i32::from(set));
        let process = [
            ("pid", i64::from(std::process::id()).into()),
            ("name", Value::string(program.as_ref())),
            // Whatever stands behind a command is nobody's business.
            ("arguments", Value::string("")),
            ("priority", 0.into()),
            ("policy", 0.into()),
        ];
        let platform = [("os", Value::string("Linux")), ("hostname", Value::string(host))];
        let port = [
            ("is_input", flag(!matches!(self.sink, Sink::Nobody))),
            ("is_output", flag(self.role.outputs)),
            ("is_rpc", flag(self.rpc)),
            ("type", self.type_name.as_deref().unwrap_or_default().into()),
        ];
        let process = admin::dict("process", process);
        [sched(), process, admin::dict("platform", platform), admin::dict("port", port)]
            .into_iter()
            .collect()
    }

    fn property(&self, key: Option<&str>) -> Bottle {
        let connections = self.connections.lock();
        match key {
            Some(key) if key == self.name => self.about(),
            Some(key) if key.starts_with('/') => {
                let output = connections.outputs.iter().find(|output| output.name == key);
                if output.is_none() && !connections.inputs.iter().any(|input| input.name == key) {
                    return admin::fail(Some(&format!("cannot find any connection to/from {key}")));
                }
                let socket = output.and_then(|output| output.socket.as_ref());
                let service = socket.and_then(|socket| {
                    socket2::SockRef::from(&**socket).tos_v4().ok().map(i64::from)
                });
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
}
