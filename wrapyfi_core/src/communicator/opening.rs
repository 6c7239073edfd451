//! Opens the endpoints of a method for a mode.
//!
//! ```text
//!   Resolved ─ side ─▶ topic, options ─▶ source ─▶ middleware ─ open ─▶ Channel
//!                                          └─ absent: Channel without ends, one line in the log
//! ```

use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use super::builtin::missing_feature;
use super::client::ClientEnd;
use super::context::{CommunicatorContext, Found, Live};
use super::end::EndCommon;
use super::error::MethodError;
use super::goal_client::GoalCalls;
use super::goal_server::ServedGoals;
use super::listener::ListenerEnd;
use super::missing::Missing;
use super::mode::Mode;
use super::notifier::Notifier;
use super::publisher::PublisherEnd;
use super::resolve::Resolved;
use super::rules::Rules;
use super::server::ServerEnd;
use super::session::{Channel, Session};
use super::settings::{
    color_order, for_middlewares, is_jpg, limits, other_kind, plugins, qos, untyped,
};
use super::wait::Stop;
use wrapyfi_data::Limits;
use wrapyfi_data::codec::Conversion;
use wrapyfi_data::did_you_mean;
use wrapyfi_data::types::{DataType, MessageType, MessageTypeError, RosType, ServiceKind};
use wrapyfi_endpoint::StartError;
use wrapyfi_endpoint::method::{EndpointNeeds, Source};
use wrapyfi_endpoint::method::{OptionError, Options};
use wrapyfi_endpoint::{
    self as endpoint, ActionSpec, EndpointAddress, History, Middleware, OpenError, OpenResult,
    Overflow, Qos, QueueSpec, Role, ServiceSpec, TopicSpec, Wake,
};

/// Number of native objects that wait at a listener, as many as ZeroMQ holds for Wrapyfi.
const OBJECTS: usize = 1000;
/// Number of images or chunks of sound that wait at a listener.
const MEDIA: usize = 10;

pub(super) struct Opening<'a> {
    pub(super) method: String,
    pub(super) mode: Mode,
    pub(super) context: &'a CommunicatorContext,
    pub(super) live: &'a Arc<Live>,
}

/// Middleware, address and settings with which one endpoint is opened.
struct EndpointSettings {
    endpoint: EndpointAddress,
    options: Options,
    middleware: Arc<dyn Middleware>,
    queue_depth: Option<usize>,
    limits: Limits,
    /// True where the method has other values, which go on without this one.
    is_one_of_several: bool,
}

/// Reason that a value has no endpoints.
enum Unopened {
    /// Its middleware is not there; the other values of the method go on.
    Absent(String),
    Failed(MethodError),
}

impl From<MethodError> for Unopened {
    fn from(error: MethodError) -> Self {
        Self::Failed(error)
    }
}

impl Opening<'_> {
    pub(super) fn open(&self, values: &[Resolved]) -> Result<Session, MethodError> {
        let channels = values.iter().map(|value| self.channel(value, values.len() > 1));
        Ok(Session {
            channels: channels.collect::<Result<_, _>>()?,
            method: self.method.clone(),
            stop: Stop::new(self.context.is_interrupted()),
            live: Arc::downgrade(self.live),
        })
    }

    fn channel(&self, value: &Resolved, is_one_of_several: bool) -> Result<Channel, MethodError> {
        let Some(name) = &value.middleware else {
            tracing::debug!("{}: no middleware is selected for {}", self.method, value.topic);
            return Ok(Channel::default());
        };
        let absent = |why: String| {
            tracing::warn!(
                "{}: middleware {name} is not available here ({why}), so what would come from \
                 {name}:{} is None and what would go there is not sent",
                self.method,
                value.topic
            );
            Ok(Channel { absent: Some((name.clone(), why)), ..Channel::default() })
        };
        let source = match self.context.find(name) {
            Found::Source(source) => source,
            Found::Absent => {
                let available = self.context.middlewares().join(", ");
                return absent(match missing_feature(name) {
                    Some(feature) => format!(
                        "build wrapyfi_core with its feature `{feature}`; available: {available}"
                    ),
                    None => format!("available: {available}"),
                });
            }
            Found::Unknown => {
                let available = self.context.middlewares();
                return Err(MethodError::UnknownMiddleware {
                    method: self.method.clone(),
                    name: name.clone(),
                    hint: did_you_mean(name, &available),
                    available: available.join(", "),
                });
            }
        };
        let (_, options) = value.end(Role::Listener).map_err(|fault| self.option(fault))?;
        match source.absent(&options) {
            Some(why) => absent(why),
            None => match self.open_ends(value, &*source, is_one_of_several) {
                Ok(channel) => Ok(channel),
                Err(Unopened::Absent(why)) => absent(why),
                Err(Unopened::Failed(error)) => Err(error),
            },
        }
    }

    fn open_ends(
        &self,
        value: &Resolved,
        source: &dyn Source,
        is_one_of_several: bool,
    ) -> Result<Channel, Unopened> {
        let (mode, mut channel) = (self.mode, Channel::default());
        if mode.has_two_ways() {
            let (there, _) = value.end(Role::Publisher).map_err(|fault| self.option(fault))?;
            let (here, _) = value.end(Role::Listener).map_err(|fault| self.option(fault))?;
            if there == here {
                return Err(Unopened::Failed(MethodError::SameTopic {
                    method: self.method.clone(),
                    mode,
                    middleware: source.name().to_owned(),
                    topic: there,
                }));
            }
        }
        let end = |role| self.end(value, source, role, is_one_of_several);
        if mode.listens() {
            channel.listener = Some(self.listener(value, &end(Role::Listener)?)?);
        }
        if mode.sends() {
            channel.publisher = Some(self.publisher(value, &end(Role::Publisher)?)?);
        }
        if mode == Mode::Request {
            channel.client = Some(match value.action {
                None => self.client(value.data_type, &end(Role::Client)?)?,
                Some(_) => self.action_client(&end(Role::ActionClient)?)?,
            });
        }
        if mode == Mode::Reply {
            channel.server = Some(Arc::new(match value.action {
                None => self.server(value.data_type, &end(Role::Server)?)?,
                Some(has_feedback) => {
                    self.action_server(&end(Role::ActionServer)?, has_feedback)?
                }
            }));
        }
        Ok(channel)
    }

    fn end(
        &self,
        value: &Resolved,
        source: &dyn Source,
        role: Role,
        is_one_of_several: bool,
    ) -> Result<EndpointSettings, Unopened> {
        let (topic, options) = value.end(role).map_err(|fault| self.option(fault))?;
        let limits = self.read(|| limits(&options))?;
        let wanted =
            EndpointNeeds { role, options: &options, max_message_bytes: limits.message_bytes };
        let middleware = self.live.middleware(source, &wanted).map_err(|error| match error {
            StartError::Option(fault) => Unopened::Failed(self.option(fault)),
            StartError::Absent(why) | StartError::Failed(why) if is_one_of_several => {
                Unopened::Absent(why)
            }
            other => Unopened::Failed(MethodError::Start {
                method: self.method.clone(),
                middleware: source.name().to_owned(),
                reason: other.to_string(),
            }),
        })?;
        self.mention(&options, &*middleware);
        let endpoint = EndpointAddress { middleware: source.name().to_owned(), name: topic };
        let queue_depth = source.queue_depth();
        Ok(EndpointSettings {
            endpoint,
            options,
            middleware,
            queue_depth,
            limits,
            is_one_of_several,
        })
    }

    /// Logs the options that the middleware cannot follow.
    fn mention(&self, options: &Options, middleware: &dyn Middleware) {
        if let Ok(Some(carrier)) = options.text("carrier")
            && carrier != "tcp"
            && !middleware.routing_properties().carriers
        {
            let middleware = middleware.name();
            tracing::warn!("{}: {middleware} has no carrier {carrier}; it is ignored", self.method);
        }
    }

    fn listener(
        &self,
        value: &Resolved,
        end: &EndpointSettings,
    ) -> Result<ListenerEnd, MethodError> {
        let spec = self.read(|| self.topic_spec(value, end))?;
        let context = endpoint::Context::default();
        let common = self.common(end, &context, context.wake.clone())?;
        let listener = self.opened(end.middleware.open_listener(&spec, &context))?;
        Ok(ListenerEnd::new(common, listener, context.clock))
    }

    fn publisher(
        &self,
        value: &Resolved,
        end: &EndpointSettings,
    ) -> Result<Arc<PublisherEnd>, MethodError> {
        let spec = self.read(|| self.topic_spec(value, end))?;
        let wake = self.live.runtime().bell();
        let context = endpoint::Context { wake, ..endpoint::Context::default() };
        let common = self.common(end, &context, Wake::new())?;
        let publisher = self.opened(end.middleware.open_publisher(&spec, &context))?;
        let in_ros = end.middleware.routing_properties().ros_time;
        let publisher = Arc::new(PublisherEnd::new(common, publisher, spec.conversion(), in_ros));
        self.live.runtime().watch(Arc::downgrade(&publisher) as _);
        Ok(publisher)
    }

    fn client(
        &self,
        data_type: DataType,
        end: &EndpointSettings,
    ) -> Result<ClientEnd, MethodError> {
        let spec = self.service_spec(data_type, end)?;
        let context = endpoint::Context::default();
        let common = self.common(end, &context, context.wake.clone())?;
        let client = self.opened(end.middleware.open_client(&spec, &context))?;
        Ok(ClientEnd::new(common, client, spec.conversion()))
    }

    fn server(
        &self,
        data_type: DataType,
        end: &EndpointSettings,
    ) -> Result<ServerEnd, MethodError> {
        let spec = self.service_spec(data_type, end)?;
        let context = endpoint::Context::default();
        let common = self.common(end, &context, context.wake.clone())?;
        let server = self.opened(end.middleware.open_server(&spec, &context))?;
        Ok(ServerEnd::new(common, server, spec.conversion(), context.clock))
    }

    fn action_client(&self, end: &EndpointSettings) -> Result<ClientEnd, MethodError> {
        let spec = self.read(|| self.action_spec(end))?;
        let context = endpoint::Context::default();
        let common = self.common(end, &context, context.wake.clone())?;
        let client = end.middleware.open_action_client(&spec, &self.of_runtime(&context));
        let ActionSpec { action, goals, color_order, limits, .. } = &spec;
        let (to, color_order, limits) = (MessageType::NativeObject, *color_order, *limits);
        let result = Conversion { to, color_order, limits };
        let goals = GoalCalls::new(self.opened(client)?, action, *goals, result, &context);
        self.live.runtime().watch(Arc::downgrade(&goals) as _);
        Ok(ClientEnd::of_action(common, goals, result))
    }

    fn action_server(
        &self,
        end: &EndpointSettings,
        has_feedback: bool,
    ) -> Result<ServerEnd, MethodError> {
        let spec = self.read(|| self.action_spec(end))?;
        let context = endpoint::Context::default();
        let common = self.common(end, &context, context.wake.clone())?;
        let server = match end.middleware.open_action_server(&spec, &self.of_runtime(&context)) {
            Err(OpenError::NotCarried { middleware, .. }) => {
                return Err(MethodError::NoActions { method: self.method.clone(), middleware });
            }
            opened => self.opened(opened)?,
        };
        let goals = ServedGoals::new(server, spec, has_feedback, &context);
        self.live.runtime().watch(Arc::downgrade(&goals) as _);
        Ok(ServerEnd::of_action(common, goals, context.clock))
    }

    /// Context with the bell of the library's thread.
    fn of_runtime(&self, context: &endpoint::Context) -> endpoint::Context {
        endpoint::Context { wake: self.live.runtime().bell(), ..context.clone() }
    }

    /// Parts that an endpoint of any role has, which waits for `wake`.
    fn common(
        &self,
        end: &EndpointSettings,
        context: &endpoint::Context,
        wake: Wake,
    ) -> Result<EndCommon, MethodError> {
        let options = &end.options;
        let missing = end.is_one_of_several.then(|| Missing::new(&end.middleware));
        self.read(|| {
            Ok(EndCommon {
                endpoint: end.endpoint.clone(),
                counters: Arc::clone(&context.counters),
                should_wait: options.switch("should_wait")?.unwrap_or(true),
                timeout: options.number("timeout_ms")?.map(Duration::from_millis),
                rules: Rules::from_options(options)?,
                notifier: Notifier::new(wake),
                missing: missing.unwrap_or_default(),
            })
        })
    }

    fn message_type(
        &self,
        value: &Resolved,
        options: &Options,
    ) -> Result<MessageType, OptionError> {
        let data_type = value.data_type;
        if data_type == DataType::RosMessage {
            return self.ros_type(value, options);
        }
        match options.word::<MessageType>("message_type")? {
            Some(written) if written.data_type() == data_type => Ok(written),
            Some(other) => Err(other_kind("message_type", &other, data_type)),
            None => Ok(match data_type {
                DataType::NativeObject => MessageType::NativeObject,
                DataType::AudioChunk => MessageType::AudioChunk,
                DataType::Image if is_jpg(options)? => MessageType::CompressedImage,
                DataType::Image => MessageType::Image,
                DataType::Properties => MessageType::Properties,
                DataType::RosMessage => return Err(untyped()),
            }),
        }
    }

    /// Type of a ROS message: that of the Rust type, or the one that is written.
    fn ros_type(&self, value: &Resolved, options: &Options) -> Result<MessageType, OptionError> {
        let written = options.text("message_type")?;
        let fault = |name: &str, wanted: String| {
            OptionError::new("message_type", format_args!("{name:?}"), wanted)
        };
        let unusable = |name: &str, reason: String| {
            fault(name, format!("a type whose definition is found: {reason}"))
        };
        let ros_type = match (value.ros_type, written) {
            (Some(own), Some(other)) if own.name != other => {
                let own = own.name;
                let wanted = format!("{own}, which is what the method returns, or left out");
                return Err(fault(other, wanted));
            }
            // The definition is the one that the Rust type was generated from, whatever is
            // installed.
            (Some(own), _) => {
                RosType::generated(own).map_err(|error| unusable(own.name, error.to_string()))?
            }
            (None, written) => {
                let name = written.ok_or_else(untyped)?;
                self.context.ros_type(name).map_err(|error| unusable(name, error.to_string()))?
            }
        };
        Ok(MessageType::Ros(ros_type))
    }

    fn topic_spec(
        &self,
        value: &Resolved,
        end: &EndpointSettings,
    ) -> Result<TopicSpec, OptionError> {
        let options = &end.options;
        let message_type = self.message_type(value, options)?;
        let depth = options.number::<u32>("queue_size")?.map(|depth| depth.max(1));
        let by_default = if value.data_type == DataType::NativeObject { OBJECTS } else { MEDIA };
        let queue_depth = match depth {
            Some(depth) => usize::try_from(depth).unwrap_or(usize::MAX),
            None => end.queue_depth.unwrap_or(by_default),
        };
        let preset = qos(options)?;
        let mut qos: Qos = preset.map_or_else(Qos::default, Into::into);
        if preset.is_none() || depth.is_some() {
            qos.history = History::KeepLast(u32::try_from(queue_depth).unwrap_or(u32::MAX));
        }
        Ok(TopicSpec {
            qos,
            match_peers: preset.is_none(),
            queue: QueueSpec { depth: queue_depth, overflow: Overflow::DropOldest },
            color_order: color_order(options)?,
            limits: end.limits,
            plugins: plugins(self.context.plugins(), options)?,
            options: for_middlewares(options)?,
            ..TopicSpec::new(end.endpoint.name.clone(), message_type)
        })
    }

    fn service_spec(
        &self,
        data_type: DataType,
        end: &EndpointSettings,
    ) -> Result<ServiceSpec, MethodError> {
        self.read(|| {
            let options = &end.options;
            let kind = match data_type {
                DataType::RosMessage => self.ros_service(options)?,
                _ => function_kind(data_type, options)?,
            };
            let timeout = options.number("timeout_ms")?.map(Duration::from_millis);
            Ok(ServiceSpec {
                timeout: timeout.unwrap_or(ServiceSpec::TIMEOUT),
                color_order: color_order(options)?,
                limits: end.limits,
                plugins: plugins(self.context.plugins(), options)?,
                options: for_middlewares(options)?,
                ..ServiceSpec::new(end.endpoint.name.clone(), kind)
            })
        })
    }

    /// Service of the ROS type that is written.
    fn ros_service(&self, options: &Options) -> Result<ServiceKind, OptionError> {
        let called =
            Called { option: "message_type", a_type: "the type of a service", form: "srv" };
        called.resolved(options, |name| self.context.service_kind(name))
    }

    fn action_spec(&self, end: &EndpointSettings) -> Result<ActionSpec, OptionError> {
        let options = &end.options;
        let called =
            Called { option: "action_type", a_type: "the type of an action", form: "action" };
        let kind = called.resolved(options, |name| self.context.ros_action(name))?;
        Ok(ActionSpec {
            color_order: color_order(options)?,
            limits: end.limits,
            plugins: plugins(self.context.plugins(), options)?,
            options: for_middlewares(options)?,
            ..ActionSpec::new(end.endpoint.name.clone(), kind)
        })
    }

    fn read<T>(&self, read: impl FnOnce() -> Result<T, OptionError>) -> Result<T, MethodError> {
        read().map_err(|fault| self.option(fault))
    }

    fn option(&self, fault: impl Display) -> MethodError {
        MethodError::Option { method: self.method.clone(), fault: fault.to_string() }
    }

    fn opened<T>(&self, opened: OpenResult<T>) -> Result<T, MethodError> {
        opened.map_err(|source| MethodError::Open {
            method: self.method.clone(),
            source: Box::new(source),
        })
    }
}

/// The type of a service or an action, as an option names it.
struct Called {
    option: &'static str,
    a_type: &'static str,
    form: &'static str,
}

impl Called {
    fn resolved<T>(
        &self,
        options: &Options,
        resolve: impl FnOnce(&str) -> Result<T, MessageTypeError>,
    ) -> Result<T, OptionError> {
        let Self { option, a_type, form } = self;
        let Some(name) = options.text(option)? else {
            let wanted = format!("{a_type}, as package/{form}/Type");
            return Err(OptionError::new(option, "not given", wanted));
        };
        resolve(name).map_err(|error| {
            let wanted = format!("{a_type} whose definition is found: {error}");
            OptionError::new(option, format_args!("{name:?}"), wanted)
        })
    }
}

/// Service that is a function of Wrapyfi.
fn function_kind(data_type: DataType, options: &Options) -> Result<ServiceKind, OptionError> {
    match options.word::<ServiceKind>("message_type")? {
        Some(written) if written.data_type() == data_type => Ok(written),
        Some(other) => Err(other_kind("message_type", &other, data_type)),
        None => match data_type {
            DataType::NativeObject => Ok(ServiceKind::NativeObject),
            DataType::AudioChunk => Ok(ServiceKind::AudioChunk),
            DataType::Image if is_jpg(options)? => Ok(ServiceKind::CompressedImage),
            DataType::Image => Ok(ServiceKind::Image),
            DataType::Properties | DataType::RosMessage => {
                let wanted = "NativeObject, Image, AudioChunk or a service of ROS in modes request and reply";
                Err(OptionError::new("data type", data_type, wanted))
            }
        },
    }
}
