//! YARP: ports, the name server and what YARP's programs send.
//!
//! ```text
//!   Publisher /cam ─▶ OutputPort /cam ══ any carrier ══▶ /cam:in7 ─▶ Listener     (or yarp read)
//!   Client ─▶ /rpc:in3 ◀══ requests, replies ══▶ /rpc ◀─ Server                   (or yarp rpc)
//!        └────────── names: one registrar, one directory ──────────┘
//!                      name server: YARP's, or ours inside this process
//! ```
//!
//! No YARP library is needed. One runtime with two threads carries all ports; an idle port costs
//! nothing. Who is there is told by the name server, never asked for in turns.
//!
//! | module | one idea |
//! | --- | --- |
//! | `config`, `options` | settings of the middleware; of a topic or service |
//! | `payload` | bytes of messages ⇄ payloads |
//! | `directory` | the names there are, and who waits for one |
//! | `survey`, `role`, `discovery` | what ports say of themselves, and what that makes them |
//! | `types`, `first_message` | what ports send |
//! | `device` | what devices tell of themselves: `board`, `joint_limits` of joints, `intrinsics` of cameras |
//! | `opening`, `port_connection` | ports that open, connections that stay, whatever ends meanwhile |
//! | `input` | input ports of other programs, and the names that mean them |
//! | `found_format` | functions of Wrapyfi, told from the rpc ports of robots |
//! | `client_dialects` | dialect and format of a request, and so of its answer |
//! | `shared_output` | one output port for all publishers of its name |
//! | `publisher`, `listener`, `client`, `server` | the endpoints |
//! | `log_port` | the log, where `yarplogger` reads it |
//! | `link_state`, `losses`, `tasks`, `own` | what an endpoint says of itself; where its task runs |

mod board;
mod client;
mod client_dialects;
mod config;
mod device;
mod directory;
mod discovery;
mod first_message;
mod found_format;
mod input;
mod intrinsics;
mod joint_limits;
mod link_state;
mod listener;
mod log_port;
mod losses;
mod opening;
pub mod options;
mod own;
pub mod payload;
mod port_connection;
mod publisher;
mod role;
mod server;
mod shared_output;
mod survey;
mod tasks;
mod types;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::{Builder, Handle, Runtime};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp::name::conf::ConfError;
use wrapyfi_yarp::name::registrar::RegistrarOptions;
use wrapyfi_yarp::name::{Environment, NameClient, Registrar};
use wrapyfi_yarp::port::names::Names;
use wrapyfi_yarp::port::{Network, PortOptions, Timeouts};
use wrapyfi_yarp::server::{NameServer, NameServerError, NameServerOptions};

use self::config::Listening;
pub use config::YarpConfig;
pub use log_port::LogPort;
pub use options::OPTIONS;
pub use types::Convention;
pub use wrapyfi_yarp::Dialect;
pub use wrapyfi_yarp::name::NameServerConf;

use wrapyfi_data::Limits;
use wrapyfi_data::types::{Map, MessageType, Value};
use wrapyfi_endpoint::network::ReachedByOthers;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{
    Client, Context, Conventions, DiscoverError, Discovered, Discovery, LearnResult, Learned,
    Listener, Middleware, OpenError, OpenResult, Opened, PROGRESS, Publisher, Role, Server,
    ServiceSpec, Share, TopicSpec, Traits, topic_of_name,
};

/// Name of this middleware in addresses.
pub const NAME: &str = "yarp";

/// Conventions of YARP. A number follows the prefix of log ports, with which no name of ROS may begin.
pub const CONVENTIONS: Conventions =
    Conventions { program_topics: Some("log/"), ..Conventions::NONE };

/// Longest name of a port: YARP reads 1000 bytes with its end, and a reader's name has a number.
const MAX_NAME_BYTES: usize = 900;
/// Threads that carry all ports.
const THREADS: usize = 2;
/// Longest time that a request to the name server may take.
const NAMES_TIMEOUT: Duration = Duration::from_secs(5);

/// The middleware `yarp`.
///
/// Dropping it closes the ports of all its endpoints and ends its name server, within two seconds.
pub struct Yarp {
    shared: Arc<Shared>,
    server: Option<NameServer>,
    runtime: Option<Runtime>,
    address: String,
}

/// State that all endpoints of one YARP instance share.
struct Shared {
    network: Network,
    registrar: Registrar,
    directory: Arc<directory::Directory>,
    own: own::OwnPorts,
    outputs: shared_output::SharedOutputs,
    survey: survey::Survey,
    types: types::Types,
    tasks: tasks::Tasks,
    send_queue: usize,
    environment: Environment,
    /// The name server is on another machine.
    is_afar: bool,
    /// Refusal of ports that others connect to; `None` where they may be opened.
    refused: Option<ReachedByOthers>,
}

impl Shared {
    /// Refuses to open ports that others connect to where other machines would reach them without
    /// permission.
    fn may_listen(&self) -> Result<(), ReachedByOthers> {
        self.refused.clone().map_or(Ok(()), Err)
    }

    /// A port that only asks. Where ports may not be open to other machines, it listens on this one alone,
    /// and nobody is told: its server answers on the connection that it is asked on.
    fn asking(&self) -> PortOptions {
        match self.refused {
            None => PortOptions::default(),
            Some(_) => PortOptions {
                address: Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 0))),
                register: false,
                ..PortOptions::default()
            },
        }
    }

    /// Numbers of changes of names, answers of ports, types, and own ports: while they stay the
    /// same, discovery finds the same.
    fn changes(&self) -> [u64; 4] {
        let Self { directory, survey, types, own, .. } = self;
        [directory.changes(), survey.changes(), types.heard.learned(), own.changes()]
    }

    /// The name under which a port of ours is registered, as the environment wants it.
    fn own_name(&self, name: &str) -> String {
        let naming = self.environment.port_naming(name);
        naming.map_or_else(|_| name.to_owned(), |naming| naming.name)
    }

    /// The port of this name and its address, for which the name server is asked where it is not known.
    async fn located(&self, name: &str) -> Option<directory::Entry> {
        let entry = self.directory.entry(name)?;
        if entry.contact.is_some() {
            return Some(entry);
        }
        let found = self.network.query(name).await.ok().flatten()?;
        Some(self.directory.locate(name, entry.number, &found))
    }

    /// Hint for the error about a port that does not answer: the likely reason and the remedy, else
    /// an empty text. A name server on this machine is not asked: loopback is the usual address
    /// there.
    async fn hint(&self, name: &str) -> &'static str {
        if !self.is_afar {
            return "";
        }
        let contact = self.located(name).await.and_then(|entry| entry.contact);
        let at = contact.and_then(|contact| contact.parse::<SocketAddr>().ok());
        if at.is_some_and(|at| at.ip().is_loopback()) {
            "; it is registered at an address of its own machine alone: set YARP_IP there"
        } else {
            ""
        }
    }

    /// The network in which an endpoint with these options opens its port.
    fn network(&self, options: &options::YarpOptions) -> Network {
        options
            .dialect
            .map_or_else(|| self.network.clone(), |dialect| self.network.with_dialect(dialect))
    }

    /// Reason why a port of ours is not found under its name; `None` where it is.
    fn taken(&self, name: &str) -> Option<String> {
        let status = self.registrar.status();
        let taken = status.borrow().taken.iter().any(|taken| taken == name);
        taken.then(|| {
            format!("the name {name}, which another program took from us: end that one, or set option port")
        })
    }
}

/// Error of starting YARP.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum YarpError {
    /// No setting says where the name server is.
    #[error("no name server is known: {0}")]
    NameServer(#[from] ConfError),
    /// No name server runs, and ours cannot.
    #[error(transparent)]
    Embedded(#[from] NameServerError),
    /// The name server's machine has no address.
    #[error("name server: {reason}")]
    Host {
        /// Reason why the host has no address.
        reason: String,
    },
    /// Other machines could reach our name server.
    #[error(transparent)]
    NotLoopback(#[from] ReachedByOthers),
    /// The system refused.
    #[error("YARP could not start: {reason}")]
    Transport {
        /// Message of the system.
        reason: String,
    },
}

impl YarpError {
    /// True when no later try can succeed, because the settings are wrong.
    #[must_use]
    pub fn is_hopeless(&self) -> bool {
        match self {
            Self::NameServer(error) => !error.is_missing(),
            Self::NotLoopback(_) => true,
            Self::Embedded(error) => matches!(
                error,
                NameServerError::NotLoopback { .. } | NameServerError::BadNamespace { .. }
            ),
            Self::Host { .. } | Self::Transport { .. } => false,
        }
    }
}

impl Yarp {
    /// Starts the runtime and, where that is wanted and none answers yet, the name server.
    ///
    /// # Errors
    /// When nobody says where the name server is, or ours cannot run. A name server elsewhere that
    /// does not answer yet is no error: it is waited for. Nor are ports that other machines would reach:
    /// those are refused where they are opened.
    pub fn start(config: &YarpConfig) -> Result<Self, YarpError> {
        let found = config.find()?;
        let server = config.hosts.resolve(&found.server.host);
        let server = server.map_err(|reason| YarpError::Host { reason })?;
        let environment = Environment::from_process();
        let server = SocketAddr::new(server, found.server.port);
        let Listening { on, advertised, is_afar, refused } =
            config.listening(server, &environment)?;
        let runtime = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("wrapyfi-yarp")
            .enable_all()
            .build()
            .map_err(|error| YarpError::Transport { reason: error.to_string() })?;
        let client = NameClient::new(found.server)
            .with_hosts(config.hosts.iter().map(|(host, ip)| (host.to_owned(), ip)))
            .with_namespace(found.namespace)
            .with_timeout(NAMES_TIMEOUT);
        let (client, server) = if config.embedded {
            runtime.block_on(embed(client, server.ip(), config))?
        } else {
            (client, None)
        };
        let conf = client.server();
        let address = format!("{}:{}", conf.host, conf.port);
        let (shared, names) = {
            let _inside = runtime.enter();
            let registrar = Registrar::start(client.clone(), RegistrarOptions::default());
            let names: Arc<dyn Names> = Arc::new(registrar.clone());
            let network = Network::builder()
                .shared_names(names)
                .dialect(config.dialect)
                .limits(wrapyfi_yarp::Limits {
                    max_message_bytes: config.max_message_bytes,
                    ..wrapyfi_yarp::Limits::default()
                })
                .timeouts(Timeouts {
                    progress: PROGRESS,
                    close: Duration::from_millis(500),
                    ..Timeouts::default()
                })
                .environment(environment.clone())
                .rooms(|| Box::new(losses::OutputRoom(Share::default())))
                .listen(on);
            let network = match advertised {
                Some(ip) => network.host(ip.to_string()).build(),
                None => network.build(),
            };
            let directory = Arc::new(directory::Directory::new(&client, is_afar));
            let tasks = tasks::Tasks::new(runtime.handle().clone());
            let (own, send_queue) = (own::OwnPorts::default(), config.send_queue.max(1));
            let shared = Shared {
                network,
                registrar,
                directory,
                own,
                outputs: shared_output::SharedOutputs::default(),
                survey: survey::Survey::default(),
                types: types::Types::new(config.conventions.clone()),
                tasks,
                send_queue,
                environment,
                is_afar,
                refused,
            };
            (Arc::new(shared), client)
        };
        let (directory, registrar) = (Arc::clone(&shared.directory), shared.registrar.clone());
        let told = Arc::clone(&directory);
        shared.tasks.spawn_aside(restarted(
            "the list of YARP's ports".to_owned(),
            move |what| told.lost(&what),
            move || directory::follow(Arc::clone(&directory), names.clone(), registrar.clone()),
        ));
        Ok(Self { shared, server, runtime: Some(runtime), address })
    }

    /// Checks that ports may be opened that others connect to: all but those that call.
    ///
    /// # Errors
    /// When other machines would reach them, and no setting permits that.
    pub fn may_listen(&self) -> Result<(), ReachedByOthers> {
        self.shared.may_listen()
    }

    /// The port for the log of this program, opened where `YARP_FORWARD_LOG_ENABLE` is set to 1 and ports may
    /// be opened that others connect to.
    #[must_use]
    pub fn log_port(&self) -> Option<LogPort> {
        self.may_listen().ok().and_then(|()| LogPort::open(&self.shared))
    }

    /// Host and port of the name server.
    #[must_use]
    pub fn name_server(&self) -> &str {
        &self.address
    }

    /// Address of the name server that runs in this process; `None` where none does.
    #[must_use]
    pub fn embedded(&self) -> Option<SocketAddr> {
        self.server.as_ref().map(NameServer::address)
    }
}

/// Starts a name server, unless one answers there.
async fn embed(
    client: NameClient,
    ip: IpAddr,
    config: &YarpConfig,
) -> Result<(NameClient, Option<NameServer>), YarpError> {
    let conf = client.server().clone();
    if conf.port != 0 && client.query(client.namespace()).await.is_ok_and(|found| found.is_some()) {
        tracing::info!("a name server runs at {}:{} already", conf.host, conf.port);
        return Ok((client, None));
    }
    config.insecure.check(NAME, "a name server", ip)?;
    let options = NameServerOptions {
        ip,
        port: conf.port,
        namespace: client.namespace().to_owned(),
        // Asked above.
        insecure: true,
        dialect: config.dialect,
        ..NameServerOptions::default()
    };
    let server = NameServer::start(options).await?;
    let client = server.client().with_timeout(NAMES_TIMEOUT);
    Ok((client, Some(server)))
}

impl Middleware for Yarp {
    fn name(&self) -> &str {
        NAME
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.may_listen()?;
        Ok(Box::new(listener::YarpListener::open(&self.shared, spec, context)?))
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.may_listen()?;
        Ok(Box::new(publisher::YarpPublisher::open(&self.shared, spec, context)?))
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        Ok(Box::new(client::YarpClient::open(&self.shared, spec, context)?))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        self.may_listen()?;
        Ok(Box::new(server::YarpServer::open(&self.shared, spec, context)?))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(discovery::YarpDiscovery::new(&self.shared)))
    }

    fn traits(&self) -> Traits {
        // A name belongs to one port of the network: nobody else publishes where we do.
        Traits { tells_own: true, untyped: true, carriers: true, ..Traits::default() }
    }

    fn learn_topic(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<Learned> {
        if found.type_name.is_some() || found.role != Role::Publisher {
            return topic_of_name(NAME, found, types);
        }
        let told = first_message::learn(&self.shared, &found.name)?;
        topic_of_name(NAME, &Discovered { type_name: Some(told), ..found.clone() }, types)
    }

    /// Carrier mjpeg brings JPEG files: nobody has to decompress them for those who want pixels.
    fn received_as(&self, learned: MessageType, options: &Map) -> MessageType {
        let carrier = options.get("carrier").and_then(Value::as_str);
        match learned {
            MessageType::Image if carrier.is_some_and(options::brings_files) => {
                MessageType::CompressedImage
            }
            other => other,
        }
    }

    fn waiting_for(&self) -> Option<String> {
        self.shared.directory.waiting_for()
    }
}

impl Drop for Yarp {
    fn drop(&mut self) {
        let Some(runtime) = self.runtime.take() else { return };
        let (shared, server) = (Arc::clone(&self.shared), self.server.take());
        let ended = async move {
            tokio::join!(shared.tasks.end(), shared.types.heard.close());
            if let Some(server) = server {
                server.stop().await;
            }
        };
        let most = Limits::SHUTDOWN * 3 / 4;
        if Handle::try_current().is_ok() {
            // Inside somebody's runtime nothing may wait.
            runtime.spawn(ended);
            return runtime.shutdown_background();
        }
        runtime.block_on(async {
            if tokio::time::timeout(most, ended).await.is_err() {
                tracing::debug!("ports did not close within {most:?}");
            }
        });
        runtime.shutdown_timeout(Limits::SHUTDOWN - most);
    }
}

impl std::fmt::Debug for Yarp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Yarp").field("name_server", &self.address).finish_non_exhaustive()
    }
}

/// Checks the name of a topic or service, which is the name of a port.
///
/// # Errors
/// The rule that the name breaks.
pub fn check_topic(name: &str) -> Result<(), String> {
    name_fault(name).map_or(Ok(()), |fault| Err(fault.to_owned()))
}

/// The rule that a name breaks, if any.
fn name_fault(name: &str) -> Option<&'static str> {
    if !name.starts_with('/') || name.len() < 2 {
        return Some("it must begin with / and go on, such as /icub/cam/left");
    }
    if name.len() > MAX_NAME_BYTES {
        return Some("it is longer than 900 bytes; YARP reads 1000 at most");
    }
    if name.ends_with('/') {
        return Some("it ends with /; leave that out");
    }
    let forbidden = |letter: char| {
        letter.is_control() || letter.is_whitespace() || "\"\\,(){}[]".contains(letter)
    };
    if name.contains(forbidden) {
        return Some("it has a blank, a quote, a comma or a bracket, which YARP's commands use");
    }
    if name.contains(":/") {
        return Some("it contains :/, which YARP takes for the end of a carrier");
    }
    None
}

fn check_name(name: &str) -> OpenResult<()> {
    check_topic(name).map_err(|reason| OpenError::invalid_name(NAME, name, reason))
}
