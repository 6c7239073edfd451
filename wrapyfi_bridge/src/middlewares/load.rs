//! A configuration file: its section `endpoints`, its routes, their types.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use wrapyfi_core::Limits;
use wrapyfi_core::endpoint::EndpointAddress;
use wrapyfi_core::engine::{
    Config, ConfigError, Kind, Plan, Problem, Reading, Route, RouteConfig, Spanned,
};
use wrapyfi_core::network::{Hosts, Place};
use wrapyfi_core::types::{MessageType, ServiceKind};
use wrapyfi_interfaces::store::TypeStore;

use super::learn;
use super::ros1::Ros1Section;
use super::ros2::Ros2Section;
use super::yarp::YarpSection;
use super::zeromq::ZeroMqSection;
use crate::command::definitions;
use crate::edits::SOURCE;
use crate::exit::Failure;
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
    pub fn check_permitted(&self, file: Option<&Path>) -> Result<(), Failure> {
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
pub fn load(file: &Path) -> Result<Loaded, Failure> {
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
    change: impl FnOnce(&mut Endpoints) -> Result<(), Failure>,
) -> Result<Loaded, Failure> {
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
pub fn load_noting(
    file: &Path,
    meant: &str,
    undefined: &mut Option<Undefined>,
) -> Result<Loaded, Failure> {
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
    learn: impl FnOnce(&mut Config<Endpoints>, &mut TypeStore) -> Result<(), Failure>,
) -> Result<Loaded, Failure> {
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
pub fn load_text(text: &str, name: &str) -> Result<Loaded, Failure> {
    read(text.to_owned(), name, Path::new(""), &[], |_, _| Ok(()))
}

fn read(
    text: String,
    name: &str,
    beside: &Path,
    added: &[Spanned<RouteConfig>],
    learn: impl FnOnce(&mut Config<Endpoints>, &mut TypeStore) -> Result<(), Failure>,
) -> Result<Loaded, Failure> {
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
mod tests {
    use super::*;
    use crate::edits::Edits;

    fn written(folder: &Path, name: &str, text: &str) -> std::path::PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn a_setting_of_another_kind_is_told_what_to_write() {
        for (text, words) in [
            ("endpoints: 5\n", "`endpoints: { zeromq: { broker: foreign } }`"),
            ("endpoints: { zeromq: { pub_port: many } }\n", "`pub_port: 5555`"),
            ("endpoints: { ros2: { domain_id: seven } }\n", "`domain_id: 0`"),
            ("routes: 5\n", "`routes: [{ from: \"zeromq:/a\", to: \"ros2:/a\", type: Text }]`"),
            ("page: 8642\n", "`page: { port: 8642 }`"),
        ] {
            let told = load_text(text, "file").unwrap_err().to_string();
            assert!(told.contains("write for example") && told.contains(words), "{told}");
        }
    }

    #[test]
    fn all_faults_of_a_file_are_told_at_once() {
        let text = "endpoints:\n  ros2: { domain_id: 500 }\n  zeromq: { pub_port: x, rep_port: 5, req_port: 5 }\ndefaults: { devices: 5 }\nroutes:\n- { from: 'zeromq:/a', to: 'ros2:/a', type: Text, overflow: { block_ms: 5s } }\n- { from: 'zeromq:/b', to: 'ros2:/b', type: Imag }\n- { form: 'zeromq:/c', to: 'ros2:/c', type: Image }\n- { from: 'zermoq:/d', to: 'ros2:/d', type: Image }\n- { service: 'ros:/e', as: 'zeromq:/e', type: std_srvs/srv/SetBol, timeout_ms: -1 }\n- { from: 'ros2:/f', to: 'ros:/f', type: Tex, qos: relable }\n- { from: 'yarp:/g', to: 'ros:/f', type: std_srvs/srv/SetBool, options: { carrier: tpc } }\n- { service: 'ros:/h', as: 'zeromq:/h', encoding: bgr8 }\n- { from: 'yarp:/i', to: 'yarp:/i', type: Text, encoding: rgb8, options: { carier: tcp } }\nlimits: { waiting_mib: lots }\n";
        let told = load_text(text, "file").unwrap_err().to_string();
        let lines: Vec<_> = told.lines().filter_map(|line| line.split(':').nth(1)).collect();
        let services = " zeromq";
        let expected = [
            services, "2", "3", "3", "4", "6", "7", "8", "9", "10", "10", "11", "11", "12", "12",
            "12", "13", "14", "14", "14", "15",
        ];
        assert_eq!(lines, expected, "{told}");
        for words in [
            "write for example `devices: { load_torch_device",
            "write for example `waiting_mib: 1024`",
            "did you mean `SetBool`?",
            "option carrier is \"tpc\", it must be tcp, fast_tcp",
            "std_srvs/srv/SetBool is no message",
            "line 11 already routes to ros:/f",
            "encoding has no effect on Text",
            "did you mean `carrier`?",
        ] {
            assert!(told.contains(words), "{words}: {told}");
        }
    }

    #[test]
    fn what_is_no_text_and_a_second_document_are_told_in_words() {
        let folder = tempfile::tempdir().unwrap();
        let routes = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
        let file = folder.path().join("file.yaml");
        std::fs::write(&file, b"# a camera\n# caf\xe9\nroutes: []\n").unwrap();
        let told = load(&file).unwrap_err().to_string();
        assert!(told.contains("line 2: byte 0xe9 is no UTF-8; save the file as UTF-8"), "{told}");
        for mark in ["---", "..."] {
            let told = load_text(&format!("---\n{routes}{mark}\n{routes}"), "file");
            let told = told.unwrap_err().to_string();
            assert!(told.contains("a second document begins here"), "{told}");
        }
    }

    #[test]
    fn faults_of_values_stand_beside_those_of_keys() {
        let text = "definitions: [nowhere]\nendpoints:\n  zeromq:\n    curve: { secret_key_file: nowhere.key_secret }\n    pub_port: x\nhosts: { a: 1.2.3, b: 192.168.1.300 }\nroutes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
        let told = load_text(text, "file").unwrap_err().to_string();
        for place in ["file:1:", "file:4:", "file:5:", "file:6:13:", "file:6:23:"] {
            assert!(told.contains(place), "{place}: {told}");
        }
        // Without keys nothing would be encrypted.
        for curve in ["", "{}"] {
            let text = text.replace("{ secret_key_file: nowhere.key_secret }", curve);
            let told = load_text(&text, "file").unwrap_err().to_string();
            assert!(told.contains("file:4:") && told.contains("secret_key_file"), "{told}");
        }
    }

    #[test]
    fn a_setting_may_be_left_empty() {
        let routes = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }]\n";
        let load = |dialect: &str| {
            load_text(&format!("endpoints: {{ yarp: {{ dialect: {dialect} }} }}\n{routes}"), "file")
        };
        for dialect in ["null", "v3", "v4"] {
            load(dialect).unwrap();
        }
        let told = load("v5").unwrap_err().to_string();
        assert!(told.contains("file:1:") && told.contains("write v3 (YARP 3) or v4"), "{told}");
    }

    #[test]
    fn routes_share_a_server_of_zeromq_and_nothing_else() {
        let route = |service: &str, other: &str| {
            format!("- {{ service: '{service}', as: '{other}', type: std_srvs/srv/SetBool }}\n")
        };
        let load = |routes: [&str; 2]| load_text(&format!("routes:\n{}", routes.concat()), "file");
        let call = route("zeromq:/light", "ros2:/light");
        load([&call, &route("zeromq:/light", "yarp:/light")]).unwrap();
        for other in [
            route("zeromq:/lamp", "ros2:/lamp"),
            route("ros:/lamp", "zeromq:/lamp"),
            route("ros:/light", "zeromq:/light"),
        ] {
            let told = load([&call, &other]).unwrap_err().to_string();
            assert!(told.contains("file:3:") && told.contains("requests of the other"), "{told}");
        }
        let told = load([&call, &route("zeromq:/(.*)", "ros2:/$1")]).unwrap_err().to_string();
        assert!(told.contains("file:3:") && told.contains("have no names"), "{told}");
    }

    #[test]
    fn a_fault_of_an_added_route_is_told_without_a_line_of_the_file() {
        let text = "routes:\n  - {name: a, from: 'zeromq:/a', to: 'ros2:/a', type: Text}\n";
        for (entry, wanted) in [
            ("{from: 'zeromq:/b', to: 'ros2:/b', type: Txt}", "\"Txt\" is no message type"),
            (
                "{from: 'zeromq:/a', to: 'ros2:/a', type: Text}",
                "route zeromq:/a -> ros2:/a stands already in line 2",
            ),
        ] {
            let mut edits = Edits::default();
            edits.add(entry).unwrap();
            let read = read(text.to_owned(), "p.yaml", Path::new(""), edits.added(), |_, _| Ok(()));
            let told = read.unwrap_err().to_string();
            assert!(told.starts_with(&format!("p.yaml: the added route: {wanted}")), "{told}");
        }
    }

    #[test]
    fn an_argument_goes_before_the_file_and_needs_its_own_word() {
        let mut endpoints = Endpoints::default();
        endpoints.yarp.insecure.0.is_allowed = true;
        let own = OwnAddress { ip: Some([192, 0, 2, 7].into()), insecure: false };
        endpoints.reached_at(own);
        assert_eq!(endpoints.yarp.ip.as_ref().unwrap().value, "192.0.2.7");
        assert_eq!(endpoints.ros.hostname.as_deref(), Some("192.0.2.7"));
        let refused = endpoints.check_permitted(None).unwrap_err().to_string();
        assert!(refused.contains("192.0.2.7") && refused.contains("give --insecure"), "{refused}");
        endpoints.reached_at(OwnAddress { insecure: true, ..own });
        endpoints.check_permitted(None).unwrap();
    }

    #[test]
    fn the_word_of_a_later_place_counts_for_an_address_of_the_file() {
        let yaml = |section: &str| {
            let route = "{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }";
            load_text(&format!("endpoints: {{ {section} }}\nroutes: [{route}]\n"), "file").unwrap()
        };
        for (section, middleware) in [
            ("zeromq: { ip: 0.0.0.0 }", "zeromq"),
            ("zeromq: { ip: '*' }", "zeromq"),
            ("yarp: { ip: 0.0.0.0 }", "yarp"),
            ("ros: { hostname: 0.0.0.0 }", "ros"),
        ] {
            let Loaded { mut endpoints, .. } = yaml(section);
            let refused = endpoints.check_permitted(Some(Path::new("file"))).unwrap_err();
            let expected = format!("write insecure: true under endpoints.{middleware}");
            assert!(matches!(refused, Failure::Usage(_)), "{refused}");
            let told = refused.to_string();
            assert!(told.contains(&expected) && told.contains("0.0.0.0"), "{told}");
            assert!(middleware == "ros" || told.starts_with("file:1:"), "{told}");
            endpoints.reached_at(OwnAddress { insecure: true, ..OwnAddress::default() });
            endpoints.check_permitted(None).unwrap();
            yaml(&section.replace(" }", ", insecure: true }"))
                .endpoints
                .check_permitted(None)
                .unwrap();
        }
    }

    #[test]
    fn settings_that_no_middleware_starts_with_are_refused_with_their_line() {
        for (section, why) in [
            ("ros: { master_uri: 'localhost:11311' }", "master_uri"),
            ("ros: { master_uri: 'https://localhost:11311' }", "http://host:11311"),
            ("ros2: { domain_id: 300 }", "domains are 0 to 232"),
            ("zeromq: { rep_port: 5558, req_port: 5558 }", "rep_port and req_port are both 5558"),
            ("ros: { node: 1x }", "node: wrapyfi_bridge"),
            ("ros: { namespace: 'a b' }", "namespace: /robot"),
            ("zeromq: { pub_port: 5555, sub_port: 5555 }", "both 5555"),
            ("zeromq: { ip: '10.0.0.5:5555' }", "write ports as pub_port"),
        ] {
            let route = "routes:\n- {from: 'zeromq:/a', to: 'ros2:/a', type: Text}\n";
            let text = format!("{route}endpoints:\n  {section}\n");
            let refused = load_text(&text, "file").unwrap_err();
            let told = refused.to_string();
            assert!(told.starts_with("file:4:") && told.contains(why), "{section}: {told}");
            assert!(!told.contains("ROS_MASTER_URI"), "{told}");
        }
    }

    #[test]
    fn a_second_service_on_the_same_ports_of_zeromq_is_refused() {
        let one = "routes:\n- {service: 'ros2:/a', as: 'zeromq:/a', type: NativeObject}\n";
        load_text(one, "file").unwrap();
        let other = format!("{one}- {{service: 'zeromq:/b', as: 'ros2:/b', type: NativeObject}}\n");
        let error = load_text(&other, "file").unwrap_err().to_string();
        assert!(error.contains("zeromq:/a") && error.contains("zeromq:/b"), "{error}");
    }

    #[test]
    fn what_may_wait_is_bounded_by_the_file() {
        let text = |mib| {
            let route = "{ from: 'zeromq:/a', to: 'ros2:/a', type: Text }";
            format!("limits: {{ waiting_mib: {mib} }}\nroutes: [{route}]\n")
        };
        assert_eq!(load_text(&text(1), "bridge.yaml").unwrap().waiting_bytes, Limits::MIB);
        let error = load_text(&text(0), "bridge.yaml").unwrap_err().to_string();
        assert!(error.contains("waiting_mib is 0, it must be at least 1"), "{error}");
    }

    #[test]
    fn the_example_of_a_robot_with_a_base_on_ros_1_is_valid_without_any_ros() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/from_ros1.yaml");
        let loaded = load(&file).unwrap();
        assert!(loaded.plan.routes.len() > 10, "{loaded:?}");
        let map = loaded.plan.routes.iter().find(|route| route.name == "map").unwrap();
        assert_eq!(map.types().to.ros_type(), "nav_msgs/msg/OccupancyGrid");
    }

    /// Checks every example as `wrapyfi check` does, with nothing of ROS or YARP installed.
    #[test]
    fn every_example_is_valid() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
        let mut found = Vec::new();
        for entry in std::fs::read_dir(folder).unwrap() {
            let file = entry.unwrap().path();
            let loaded = load(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            let plan = loaded.plan;
            assert!(!plan.routes.is_empty(), "{}", file.display());
            found.push(file.file_name().unwrap().to_str().unwrap().to_owned());
            if file.ends_with("icub.yaml") || file.ends_with("base_on_yarp.yaml") {
                let of_robot = |route: &&Route| route.from.middleware == "yarp";
                let eager = plan.routes.iter().filter(of_robot).find(|route| {
                    matches!(route.kind, Kind::Topic(_)) && route.is_whole() && !route.policy.lazy
                });
                assert_eq!(eager.map(|route| &route.name), None, "it streams at rest");
            }
        }
        for robot in ["icub.yaml", "base_on_yarp.yaml", "pepper_on_ros1.yaml"] {
            assert!(found.iter().any(|file| file == robot), "{robot} is missing in {found:?}");
        }
    }

    #[test]
    fn mapping_rules_are_read_from_beside_the_file_and_faults_have_their_line() {
        let folder = tempfile::tempdir().unwrap();
        let config = |rules: &str| {
            format!(
                "endpoints:\n  ros: {{ mapping_rules: [{rules}] }}\nroutes:\n  - {{ from: \"ros:/a\", \
                 to: \"ros2:/a\", type: Text }}\n"
            )
        };
        let rules = "[{ros1_package_name: base_msgs, ros2_package_name: base_interfaces}]";
        written(folder.path(), "rules.yaml", rules);
        let file = written(folder.path(), "bridge.yaml", &config("rules.yaml"));
        let loaded = load(&file).unwrap();
        assert_eq!(loaded.endpoints.ros.rules, serde_saphyr::from_str(rules).unwrap());

        written(folder.path(), "bad.yaml", "[{ros1_package_name: base_msgs, ros2: x}]");
        for name in ["bad.yaml", "none.yaml"] {
            let file = written(folder.path(), "bridge.yaml", &config(name));
            let told = load(&file).unwrap_err().to_string();
            assert!(told.contains("bridge.yaml:2:") && told.contains(name), "{told}");
        }
    }
}
