//! YARP: ports, the name server and what YARP's programs send.
//!
//! ```text
//!   Publisher /cam ─▶ Port /cam ══ any carrier ══▶ /cam:in7 ─▶ Listener     (or yarp read)
//!   Client ─▶ /rpc:in3 ◀══ requests, replies ══▶ /rpc ◀─ Server                   (or yarp rpc)
//!        └────────── names: one registrar, one directory ──────────┘
//!                      name server: YARP's, or ours inside this process
//! ```
//!
//! No YARP library is needed. One runtime with two threads carries all ports; an idle port costs
//! nothing. The name server tells of ports that come and go; nothing polls for them.
//!
//! | module | one idea |
//! | --- | --- |
//! | `config`, `options` | settings of the middleware; of a topic or service |
//! | `shared`, `name`, `error` | what all endpoints share; which names ports may have; why YARP does not start |
//! | `payload` | bytes of messages ⇄ payloads |
//! | `directory`, `unlisted` | the names there are, and who waits for one; ports that a new name server does not know |
//! | `survey`, `role`, `discovery` | what ports say of themselves, and what that makes them |
//! | `types`, `first_message`, `learning` | what ports send |
//! | `device` | what devices tell of themselves: `board`, `joint_limits` of joints, `intrinsics` of cameras |
//! | `opening`, `port_connection` | ports that open, connections that stay, whatever ends meanwhile |
//! | `input` | input ports of other programs, and the names that mean them |
//! | `found_format` | functions of Wrapyfi, told from the rpc ports of robots |
//! | `client_dialects` | dialect and format of a request, and so of its answer |
//! | `shared_output` | one output port for all publishers of its name |
//! | `publisher`, `listener`, `client`, `server` | the endpoints |
//! | `served_board` | a robot of ROS 2 as a control board of YARP |
//! | `log_port` | the log, where `yarplogger` reads it |
//! | `link_state`, `losses`, `tasks`, `own` | what an endpoint says of itself; where its task runs |

mod board;
mod client;
mod client_dialects;
mod config;
mod device;
mod directory;
mod discovery;
mod error;
mod first_message;
mod found_format;
mod input;
mod intrinsics;
mod joint_limits;
mod learning;
mod link_state;
mod listener;
mod log_port;
mod losses;
mod name;
mod opening;
pub mod options;
mod own;
pub mod payload;
mod port_connection;
mod publisher;
mod registered_port;
mod role;
#[cfg(feature = "driver")]
mod section;
mod served_board;
mod server;
mod shared;
mod shared_output;
mod source;
mod survey;
mod tasks;
mod types;
mod unlisted;

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::{Builder, Handle, Runtime};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_yarp::name::registrar::RegistrarOptions;
use wrapyfi_yarp::name::{Environment, NameClient, Registrar};
use wrapyfi_yarp::port::{Network, NetworkOptions, Timeouts};
use wrapyfi_yarp::server::{NameServer, NameServerOptions};

use self::config::Listening;
use self::served_board::{BoardListener, BoardPublisher};
use self::shared::InstanceState;
pub use config::YarpConfig;
pub use error::YarpError;
pub use name::{NAME, check_topic};
pub use options::{DESTINATION_OPTIONS, OPTIONS, SOURCE_OPTIONS, check_option};
#[cfg(feature = "driver")]
pub use section::DRIVER;
pub use served_board::{INPUTS as BOARD_INPUTS, PORTS as BOARD_PORTS};
pub use source::source;
pub use types::Convention;
pub use wrapyfi_yarp::Dialect;
pub use wrapyfi_yarp::name::NameServerConf;

use wrapyfi_data::Limits;
use wrapyfi_data::types::{Map, MessageType, Value};
use wrapyfi_endpoint::network::ReachedByOthers;
use wrapyfi_endpoint::restart::restarted;
use wrapyfi_endpoint::{
    ActionClient, ActionSpec, Builder as SettingsBuilder, Cause, Client, Context, Conventions,
    DiscoverError, Discovered, Discovery, LearnResult, Learned, Listener, LogSink, Middleware,
    MiddlewareSettings, NameService, Opened, PROGRESS, Publisher, Role, RoutingProperties, Server,
    ServiceSpec, Share, StartError, TopicSpec, function_action, topic_of_name,
};

/// Conventions of YARP: log ports of programs, and ports of commands that live for one call (`yarp write ... /x`).
pub const CONVENTIONS: Conventions = Conventions {
    program_topics: &["log/", "tmp/port/"],
    name_service: Some(NameService {
        knows_listeners: false,
        address_variable: "YARP_IP",
        server_variable: None,
        clean: "yarp clean",
        find: Some(
            "start a name server: yarpserver --write, or wrapyfi yarpserver --write where there is no YARP; or find \
             the one that runs: wrapyfi detect --write",
        ),
    }),
    program: "a program with a YARP port",
    ..Conventions::NONE
};

/// Threads that carry all ports.
const THREADS: usize = 2;
/// Longest time that a request to the name server may take.
const NAMES_TIMEOUT: Duration = Duration::from_secs(5);

/// The middleware `yarp`.
///
/// Dropping it closes the ports of all its endpoints and ends its name server, within two seconds.
pub struct Yarp {
    shared: Arc<InstanceState>,
    boards: served_board::ServedBoards,
    server: Option<NameServer>,
    runtime: Option<Runtime>,
    address: String,
}

impl Yarp {
    /// Starts the runtime and, where that is wanted and none answers yet, the name server.
    ///
    /// # Errors
    /// When no setting says where the name server is, or ours cannot run. A name server elsewhere that
    /// does not answer yet is no error: it is waited for. Nor are ports that other machines would reach:
    /// those are refused where they are opened.
    #[doc(hidden)]
    pub fn start(config: &YarpConfig) -> Result<Self, YarpError> {
        let found = config.find()?;
        let server = config.hosts.resolve(&found.server.host);
        let server = server.map_err(YarpError::Host)?;
        let environment = Environment::from_process();
        let server = SocketAddr::new(server, found.server.port);
        let Listening { on, advertised, is_afar, refused } =
            config.listening(server, &environment)?;
        let runtime = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("wrapyfi-yarp")
            .enable_all()
            .build()
            .map_err(|error| YarpError::Transport(error.to_string()))?;
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
        let shared = {
            let _inside = runtime.enter();
            let directory = Arc::new(directory::Directory::new(&client, is_afar));
            let registrar = Registrar::start(client, RegistrarOptions::default());
            let kept = Arc::downgrade(&directory);
            let network = Network::new(NetworkOptions {
                names: Arc::new(registrar.clone()),
                known: Arc::new(move |name| kept.upgrade()?.kept(name)),
                dialect: config.dialect,
                limits: wrapyfi_yarp::WireLimits {
                    max_message_bytes: config.max_message_bytes,
                    ..wrapyfi_yarp::WireLimits::default()
                },
                timeouts: Timeouts {
                    progress: PROGRESS,
                    close: Duration::from_millis(500),
                    ..Timeouts::default()
                },
                listen: on,
                host: advertised.map(|ip| ip.to_string()),
                environment: environment.clone(),
                rooms: || Box::new(losses::OutputRoom(Share::default())),
            });
            let tasks = tasks::Tasks::new(runtime.handle().clone());
            let (own, send_queue) = (own::OwnPorts::default(), config.send_queue.max(1));
            let shared = InstanceState {
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
                is_wrapyfi: config.is_wrapyfi,
                is_afar,
                refused,
            };
            Arc::new(shared)
        };
        let (told, followed) = (Arc::clone(&shared.directory), Arc::clone(&shared));
        shared.tasks.spawn_aside(restarted(
            "the list of YARP's ports".to_owned(),
            move |what| told.lost(&what),
            move || directory::follow(Arc::clone(&followed)),
        ));
        let boards = served_board::ServedBoards::default();
        Ok(Self { shared, boards, server, runtime: Some(runtime), address })
    }

    /// Checks that ports may be opened that others connect to: all but those that call.
    ///
    /// # Errors
    /// When other machines would reach them, and no setting permits that.
    #[doc(hidden)]
    pub fn may_listen(&self) -> Result<(), ReachedByOthers> {
        self.shared.may_listen()
    }

    /// Host and port of the name server.
    pub fn name_server(&self) -> &str {
        &self.address
    }

    /// Address of the name server that runs in this process; `None` where none does.
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

impl MiddlewareSettings for YarpConfig {
    type Middleware = Yarp;

    fn start(&self) -> Result<Yarp, StartError> {
        let is_absent =
            |error: &YarpError| matches!(error, YarpError::NameServer(_) | YarpError::Host(_));
        Yarp::start(self)
            .map_err(|error| StartError::of(&error, error.is_hopeless(), is_absent(&error)))
    }
}

/// YARP, at the name server that `yarp.conf` names.
pub fn yarp() -> SettingsBuilder<YarpConfig> {
    SettingsBuilder::new(YarpConfig::from_env().map_err(StartError::refused))
}

impl Middleware for Yarp {
    fn network(&self) -> Option<String> {
        let (host, port) = self.address.rsplit_once(':')?;
        Some(wrapyfi_endpoint::network::server_text(host, port.parse().ok()?))
    }

    fn name(&self) -> &str {
        NAME
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.may_listen()?;
        let (options, shared) = (options::YarpOptions::of_topic(spec)?, &self.shared);
        Ok(match options.board {
            true => Box::new(BoardListener::open(&self.boards, shared, spec, &options, context)?),
            false => Box::new(listener::YarpListener::open(shared, spec, options, context)?),
        })
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.may_listen()?;
        let (options, shared) = (options::YarpOptions::of_topic(spec)?, &self.shared);
        Ok(match options.board {
            true => Box::new(BoardPublisher::open(&self.boards, shared, spec, &options, context)?),
            false => Box::new(publisher::YarpPublisher::open(shared, spec, options, context)?),
        })
    }

    fn open_client(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Client> {
        Ok(Box::new(client::YarpClient::open(&self.shared, spec, context)?))
    }

    fn open_server(&self, spec: &ServiceSpec, context: &Context) -> Opened<dyn Server> {
        self.may_listen()?;
        Ok(Box::new(server::YarpServer::open(&self.shared, spec, context)?))
    }

    fn open_action_client(&self, spec: &ActionSpec, context: &Context) -> Opened<dyn ActionClient> {
        // A function of Wrapyfi reads JSON, in which the words of a request are its arguments.
        let is_json = spec.options.get("bottle").and_then(Value::as_bool) == Some(false);
        function_action::open(self, spec, context, (!is_json).then_some("command"))
    }

    fn discover(&self) -> Result<Box<dyn Discovery>, DiscoverError> {
        Ok(Box::new(discovery::YarpDiscovery::new(&self.shared)))
    }

    fn routing_properties(&self) -> RoutingProperties {
        // A name belongs to one port of the network: no other program publishes where we do.
        RoutingProperties {
            tells_own: true,
            subscribes_first: true,
            untyped: true,
            carriers: true,
            ..RoutingProperties::default()
        }
    }

    /// The port of a topic that others listen to is an input port, which YARP's users connect: `/cmd_vel:i`.
    fn ahead_options(&self, name: &str) -> Option<Map> {
        if name.contains(':') {
            return None;
        }
        let port = if input::is_input(name) { name.to_owned() } else { format!("{name}:i") };
        Some(Map::from([("port", Value::from(port))]))
    }

    fn learn_topic(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<Learned> {
        if found.type_name.is_some() || found.role != Role::Publisher {
            return topic_of_name(NAME, found, types);
        }
        let told = learning::learn(&self.shared, &found.name)?;
        topic_of_name(NAME, &Discovered { type_name: Some(told), ..found.clone() }, types)
    }

    /// Carrier mjpeg brings JPEG files: no program has to decompress them for those who want pixels.
    fn received_as(&self, learned: MessageType, options: &Map) -> MessageType {
        let carrier = options.get("carrier").and_then(Value::as_str);
        match learned {
            MessageType::Image if carrier.is_some_and(options::brings_files) => {
                MessageType::CompressedImage
            }
            other => other,
        }
    }

    /// The port for the log of this program, opened where `YARP_FORWARD_LOG_ENABLE` is set to 1 and ports may
    /// be opened that others connect to.
    fn log_sink(&self) -> Option<Box<dyn LogSink>> {
        self.may_listen().ok()?;
        Some(Box::new(log_port::LogPort::open(&self.shared)?))
    }

    fn verify(&self, name: &str) {
        discovery::verify(&self.shared, name);
    }

    fn waiting_for(&self) -> Option<Cause> {
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
            // Inside a caller's runtime nothing may wait.
            runtime.spawn(wrapyfi_yarp::task::erased(ended));
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
