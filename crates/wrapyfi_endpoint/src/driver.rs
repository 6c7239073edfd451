//! A middleware as programs have it in their lists: the only place that knows how it is configured, started and explained
//! is its own crate.
//!
//! ```text
//!   wrapyfi_bridge::main([zeromq::DRIVER, ros2::DRIVER, mine::DRIVER])
//!
//!   Driver ─ section ─▶ Section ─ plan ─▶ Planned ─ start ─▶ Middleware  endpoints: { mine: { … } }
//!      │                      └ servers ─▶ ServerAddress                 what has to be there first
//!      └ available ─▶ Available                                          mine:/topic, options of routes
//! ```

use std::any::Any;
use std::fmt;
use std::net::{IpAddr, Ipv4Addr};
use std::path::Path;

use serde::de::DeserializeOwned;
use wrapyfi_data::types::{MessageType, RosAction, ServiceKind, Value};
use wrapyfi_interfaces::named;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_retry::contained;

use crate::config::{NamedSection, Problem, Reading, Spanned, section_of};
use crate::network::{Hosts, Insecure};
use crate::{Conventions, EndpointAddress, Interaction, Planned, Role, StartError};

/// A middleware, for programs that configure it by a file and start it by its name.
pub trait Driver: Sync {
    /// Name in addresses, with the rules for topics and for options of routes.
    fn available(&self) -> Available<'static>;

    /// Settings where a file says nothing.
    fn section(&self) -> Box<dyn Section>;

    /// False where no setting says that there is such a network: commands look at it only where its name is given.
    fn is_expected(&self) -> bool {
        true
    }

    /// Node executable that bridges all of this middleware into ROS 2 and back; `None` where there is none.
    fn whole_bridge(&self) -> Option<WholeBridge> {
        None
    }

    /// Checks routes together.
    ///
    /// # Errors
    /// Index of a route that cannot be, and the fault.
    fn check_routes(&self, routes: &[RouteFacts<'_>]) -> Result<(), (usize, String)> {
        _ = routes;
        Ok(())
    }
}

/// Methods of a [`Section`] that follow from its type: each that is a [`NamedSection`] has them.
pub trait FileSection {
    /// The same settings once more.
    fn boxed(&self) -> Box<dyn Section>;

    /// Reads such settings out of the text of a whole configuration.
    fn read(&self, text: &str) -> Reading<Box<dyn Section>>;

    /// Example of what the section has, as YAML: `{ port: 7000 }`.
    fn example(&self) -> &'static str;
}

impl<S: Section + NamedSection + DeserializeOwned + Clone + Default> FileSection for S {
    fn boxed(&self) -> Box<dyn Section> {
        Box::new(self.clone())
    }

    fn read(&self, text: &str) -> Reading<Box<dyn Section>> {
        let Reading { value, problems, wrong_items } = section_of::<S>(text);
        Reading { value: value.map(|section| Box::new(section) as _), problems, wrong_items }
    }

    fn example(&self) -> &'static str {
        S::example_of(S::NAME).unwrap_or("{}")
    }
}

/// Settings of a middleware: its section of `endpoints`, changed by parameters and arguments of the program.
pub trait Section: FileSection + Any + fmt::Debug + Send + Sync {
    /// Reads the files that the settings name, as seen from `folder`.
    ///
    /// # Errors
    /// The first file that cannot be read or is wrong.
    fn find_files(&mut self, folder: &Path) -> Result<(), Problem> {
        _ = folder;
        Ok(())
    }

    /// Checks what the middleware checks when it starts, as far as that needs no other program.
    ///
    /// # Errors
    /// The first fault.
    fn check(&self) -> Result<(), Problem> {
        Ok(())
    }

    /// Checks that nothing of ours would listen where other machines reach it without permission.
    ///
    /// # Errors
    /// Place of the address, and the word that permits it.
    fn check_permitted(&self, hosts: &Hosts) -> Result<(), Problem> {
        _ = hosts;
        Ok(())
    }

    /// The settings that parameters of the node change, by their names in the section.
    fn settings(&mut self) -> Vec<(&'static str, Setting<'_>)> {
        Vec::new()
    }

    /// The word that lets others in, where the middleware has one.
    fn permission(&mut self) -> Option<Permission<'_>> {
        None
    }

    /// Gives the node of a bridge of all of this middleware a name, where none is set.
    fn name_node(&mut self, node: &str) {
        _ = node;
    }

    /// The middleware that these settings make.
    ///
    /// # Errors
    /// When a setting or a variable has a value that it cannot have.
    fn plan(&self, needs: &StartNeeds<'_>) -> Result<Planned, StartError>;

    /// Servers that have to be there first: for topics, or for services.
    ///
    /// # Errors
    /// When a setting cannot be, or nothing says where the server is.
    fn servers(
        &self,
        hosts: &Hosts,
        interaction: Interaction,
    ) -> Result<Vec<ServerAddress>, StartError> {
        _ = (hosts, interaction);
        Ok(Vec::new())
    }

    /// Warnings about what routes lose or leave without effect by these settings, as far as `types` tell it: each with
    /// the index of its route, where it is about one.
    fn warnings(
        &self,
        routes: &[RouteFacts<'_>],
        types: &mut TypeStore,
    ) -> Vec<(Option<usize>, String)> {
        _ = (routes, types);
        Vec::new()
    }
}

impl Clone for Box<dyn Section> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}

/// A setting that a parameter of the node changes, by the type of its value.
#[derive(Debug)]
pub enum Setting<'s> {
    /// A text without a place in the file.
    Text(&'s mut Option<String>),
    /// A text with its place.
    Placed(&'s mut Option<Spanned<String>>),
    /// A port, from 1.
    Port(&'s mut Option<Spanned<u16>>),
    /// A setting that is on or off.
    Switch(&'s mut bool),
}

/// The word of a section that lets others in, and the setting that it is about.
#[derive(Debug)]
pub struct Permission<'s> {
    /// The word.
    pub insecure: &'s mut Insecure,
    /// Name of the setting that gives the address.
    pub address: &'static str,
    /// Place at which the address is said that others reach, in words; `None` where `--ip` says it.
    pub said_elsewhere: Option<&'static str>,
}

/// Needs of a program, by which a [`Section`] chooses how its middleware starts.
#[derive(Debug, Clone, Copy)]
pub struct StartNeeds<'a> {
    /// Names of machines that the configuration maps to addresses.
    pub hosts: &'a Hosts,
    /// Largest message in bytes.
    pub largest_message: usize,
    /// Use that is made of the middleware.
    pub purpose: Purpose,
}

/// Use that is made of a middleware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Routes of a bridge.
    Routes {
        /// True where some of them are services.
        has_services: bool,
        /// True where others connect to endpoints of ours.
        is_reached: bool,
    },
    /// One endpoint of a command.
    Endpoint(Role),
    /// A look at which endpoints exist, which opens none and starts no server.
    Look,
}

/// A route, for checks of a middleware at its ends.
#[derive(Debug, Clone)]
pub struct RouteFacts<'p> {
    /// Name in tables and logs.
    pub name: &'p str,
    /// Both ends in words.
    pub ends: String,
    /// Source, or the server of a service.
    pub from: &'p EndpointAddress,
    /// Destination, or where a service is offered.
    pub to: &'p EndpointAddress,
    /// Types of its messages, or of its service.
    pub carries: Carries,
    /// True where the type is written.
    pub is_typed: bool,
    /// True for one topic or service with a known type.
    pub is_whole: bool,
    /// True for a pattern.
    pub is_many: bool,
}

/// Types of what a route carries.
#[derive(Debug, Clone, Copy)]
pub enum Carries {
    /// Messages: their types at the source and at the destination.
    Topic(MessageType, MessageType),
    /// Requests and replies.
    Service(ServiceKind),
    /// Goals, feedback and results; `None` until the type is learned.
    Action(Option<RosAction>),
}

named! {
    /// Server without which nothing of a middleware is found.
    pub enum Server {
        /// The broker of topics.
        Broker => "ZeroMQ broker",
        /// The broker of requests and replies.
        ServiceBroker => "ZeroMQ broker of services",
        /// The name server of YARP.
        NameServer => "YARP name server",
        /// The master of ROS 1.
        Master => "ROS 1 master",
        /// The router through which nodes on rmw_zenoh_cpp find each other.
        Router => "Zenoh router",
    }
    /// Name of the server.
    pub fn name;
}

/// Node executable that bridges all of a middleware, without a configuration.
#[derive(Debug, Clone, Copy)]
pub struct WholeBridge {
    /// Name of the executable, and of its node: `ros1_bridge`.
    pub executable: &'static str,
    /// Name of the middleware in words.
    pub title: &'static str,
    /// Parameters that are on or off beside those that each such node has, with their descriptions.
    pub switches: &'static [(&'static str, &'static str)],
    /// Routes where these switches are on; whether what is hidden is carried, too.
    pub routes: fn(&[&'static str], bool) -> Vec<WholeRoute>,
}

/// Route of a [`WholeBridge`].
#[derive(Debug, Clone, Copy)]
pub struct WholeRoute {
    /// Interaction that it carries.
    pub interaction: Interaction,
    /// True where it leads from ROS 2 to the middleware.
    pub comes_back: bool,
    /// Address on the middleware: a pattern, or where it comes back a name with its groups.
    pub there: &'static str,
    /// Name on ROS 2, below the prefix of the node and without the first slash: the other way round.
    pub here: &'static str,
    /// Further keys of the route, each behind a comma.
    pub keys: &'static str,
    /// True for one name that neither prefix nor lists of names change.
    pub is_fixed: bool,
}

impl WholeRoute {
    /// Route of messages from the middleware.
    pub const fn topic(there: &'static str, here: &'static str, keys: &'static str) -> Self {
        let (comes_back, is_fixed) = (false, false);
        Self { interaction: Interaction::Topic, comes_back, there, here, keys, is_fixed }
    }

    /// The same of requests and replies.
    #[must_use]
    pub const fn service(self) -> Self {
        Self { interaction: Interaction::Service, ..self }
    }

    /// The same of goals, feedback and results.
    #[must_use]
    pub const fn action(self) -> Self {
        Self { interaction: Interaction::Action, ..self }
    }

    /// Route from ROS 2 to `there`.
    #[must_use]
    pub const fn back(self) -> Self {
        Self { comes_back: true, ..self }
    }
}

/// Place at which a server is expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerAddress {
    /// Kind of the server.
    pub server: Server,
    /// Host as it is configured.
    pub host: String,
    /// Port of the server.
    pub port: u16,
    /// True where the bridge runs the server itself.
    pub is_own: bool,
    /// Command that starts it there, and what may be done instead.
    pub start: String,
    /// Settings that lead a command of this shell there, where the shell has others.
    pub reach: Reach,
}

/// Settings of a command of `wrapyfi`, each with a space.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reach {
    /// Variables, to stand before the command.
    pub variables: String,
    /// Options, to stand behind it.
    pub options: String,
}

/// Command that has a server listen at a host and on ports, each with its option and its usual number, which is left out.
pub fn start_at(program: &str, host: &str, ports: &[(&str, u16, u16)]) -> String {
    let ip = host.parse::<IpAddr>().ok();
    let is_usual = ip.is_some_and(|ip| ip.is_unspecified() || ip == Ipv4Addr::LOCALHOST);
    let at = match ip {
        _ if is_usual || matches!(host, "*" | "localhost") => String::new(),
        Some(ip) if ip.is_loopback() => format!(" --ip {host}"),
        _ => format!(" --ip {host} --insecure"),
    };
    let others = ports.iter().filter(|(_, port, usual)| port != usual);
    let options: String = others.map(|(option, port, _)| format!(" {option} {port}")).collect();
    format!("{program}{at}{options}")
}

/// A middleware that routes may name.
///
/// Shown by a [`Driver`], and read by the plan of routes.
///
/// ```
/// use wrapyfi_endpoint::driver::Available;
/// let must_be_absolute = |topic: &str| match topic.starts_with('/') {
///     true => Ok(()),
///     false => Err("a name begins with /".to_owned()),
/// };
/// let mine = Available { name: "mine", check_topic: &must_be_absolute, ..Available::default() };
/// assert!((mine.check_topic)("camera").is_err());
/// ```
#[derive(Clone, Copy)]
pub struct Available<'a> {
    /// Name in addresses.
    pub name: &'a str,
    /// Rule of the middleware for topic names; the error names the fault.
    pub check_topic: &'a dyn Fn(&str) -> Result<(), String>,
    /// Settings that only this middleware and few others have, as `options` of a route names them.
    pub options: &'a [&'a str],
    /// Rule of the middleware for the value of one of them; the error names the fault.
    pub check_option: &'a dyn Fn(&str, &Value) -> Result<(), String>,
    /// Those of them that only the source of a route has, because they are about what is received.
    pub source_options: &'a [&'a str],
    /// Those of them that only the destination of a route has, because they are about what is sent. One that is in both
    /// lists is of services and actions alone.
    pub destination_options: &'a [&'a str],
    /// Interactions that the middleware carries.
    pub interactions: &'a [Interaction],
    /// Conventions of the middleware for types and names.
    #[doc(hidden)]
    pub conventions: Conventions,
}

impl Available<'_> {
    /// Asks the rule of the middleware for topic names.
    ///
    /// # Errors
    /// The fault of the name, or the panic of the rule.
    pub fn check_name(&self, topic: &str) -> Result<(), String> {
        self.contained(|| (self.check_topic)(topic))
    }

    /// Asks the rule of the middleware for the value of one of its options.
    ///
    /// # Errors
    /// The fault of the value, or the panic of the rule.
    pub fn check_value(&self, option: &str, value: &Value) -> Result<(), String> {
        self.contained(|| (self.check_option)(option, value))
    }

    fn contained(&self, rule: impl FnOnce() -> Result<(), String>) -> Result<(), String> {
        contained(rule).unwrap_or_else(|panic| {
            Err(format!("middleware {}: its driver panicked: {panic}", self.name))
        })
    }
}

impl Default for Available<'_> {
    fn default() -> Self {
        Self {
            name: "",
            check_topic: &|_| Ok(()),
            options: &[],
            check_option: &|_, _| Ok(()),
            source_options: &[],
            destination_options: &[],
            interactions: Interaction::TOPICS_AND_SERVICES,
            conventions: Conventions::NONE,
        }
    }
}
