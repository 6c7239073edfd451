//! Events of a service, as `ros2 service echo` and `ros2 action echo` read them.
//!
//! ```text
//!   CdrClient ─ send ─▶ request sent        take ─▶ response received ─┐
//!   CdrServer ─ take ─▶ request received    reply ─▶ response sent ────┴─▶ <service>/_service_event
//! ```
//!
//! The option `introspection` asks for them: `metadata` tells that something went, `contents` also what.

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use wrapyfi_interfaces::builtin_interfaces::msg::Time;
use wrapyfi_interfaces::cdr::{CdrValue as _, CdrWriter as Cdr};
use wrapyfi_interfaces::service_msgs::msg::ServiceEventInfo;

use super::codec::ServiceCodec;
use crate::graph::{
    CdrClient, CdrReply, CdrRequest, CdrServer, CdrWriter, GraphError, Peers, RequestId,
    TopicDescription,
};
use crate::ros2::{NAME, Ros2, no_service};
use wrapyfi_data::types::{RosMessage, RosService, RosType, Value};
use wrapyfi_endpoint::{Clock, Context, OpenError, OpenResult, Qos, Throttle};

/// Option of services and actions.
pub(crate) const OPTION: &str = "introspection";

/// Checks the value of the option.
///
/// # Errors
/// When it is none that the option has.
pub(crate) fn check_option(name: &str, value: &Value) -> Result<(), String> {
    match (name, value.as_str()) {
        (OPTION, Some("metadata" | "contents")) => Ok(()),
        (OPTION, _) => Err("option introspection must be metadata or contents".into()),
        _ => Ok(()),
    }
}

/// Events of one client or server.
pub(super) struct Events {
    writer: Box<dyn CdrWriter>,
    ros_type: RosType,
    service: RosService,
    has_contents: bool,
    max_bytes: usize,
    clock: Clock,
    complaints: Throttle,
}

impl Events {
    /// Events of a service whose options ask for them, and whose type has some.
    ///
    /// # Errors
    /// When the option is wrong, or the publisher cannot be created.
    pub(super) fn of(
        ros2: &Ros2,
        codec: &ServiceCodec,
        context: &Context,
    ) -> OpenResult<Option<Self>> {
        let (spec, service) = (&codec.spec, codec.service);
        let Some(wanted) = spec.options.get(OPTION) else { return Ok(None) };
        check_option(OPTION, wanted)
            .map_err(|fault| OpenError::transport(NAME, &spec.service, fault))?;
        let event = service.resolved().part("_Event").map(|event| RosType::new(&event));
        let Some(ros_type) = event.transpose().map_err(|error| no_service(spec, &error))? else {
            return Ok(None);
        };
        let topic = TopicDescription {
            name: format!("{}/_service_event", spec.service),
            type_name: ros_type.name().to_owned(),
            type_hash: Some(ros_type.type_hash().to_owned()),
            qos: Qos::default(),
            max_bytes: spec.limits.message_bytes,
            hears_own: false,
        };
        let writer = ros2.graph().advertise(&topic, Arc::new(|| ()));
        Ok(Some(Self {
            writer: writer.map_err(|error| no_service(spec, &error))?,
            ros_type,
            service,
            has_contents: wanted.as_str() == Some("contents"),
            max_bytes: spec.limits.message_bytes,
            clock: context.clock.clone(),
            complaints: Throttle::default(),
        }))
    }

    /// Publishes an event. A service goes on where that fails.
    fn tell(&mut self, event_type: u8, id: &RequestId, body: &[&[u8]]) {
        let sent = self
            .event(event_type, id, body)
            .and_then(|event| self.writer.write(&[&event]).map_err(|error| error.to_string()));
        if let Err(fault) = sent
            && let Some(unlogged_before) = self.complaints.pass(self.clock.now())
        {
            let service = self.service.name();
            tracing::warn!(
                service,
                unlogged_before,
                "an event of the service was not sent: {fault}"
            );
        }
    }

    fn event(&self, event_type: u8, id: &RequestId, body: &[&[u8]]) -> Result<Bytes, String> {
        let stamp = self.clock.ros_now().stamp;
        let info = ServiceEventInfo {
            event_type,
            stamp: Time { sec: stamp.sec, nanosec: stamp.nanosec },
            client_gid: id.client,
            sequence_number: id.sequence,
        };
        let mut event = Cdr::new();
        info.write(&mut event);
        // Neither a request nor a response.
        event.write_primitive_array(&[0_u32, 0]);
        let event = event.finish().to_bytes();
        if !self.has_contents {
            return Ok(event);
        }
        let (field, ros_type) = match event_type {
            ServiceEventInfo::REQUEST_SENT | ServiceEventInfo::REQUEST_RECEIVED => {
                ("request", self.service.request())
            }
            _ => ("response", self.service.response()),
        };
        let fields = RosMessage::new(ros_type, body.concat()).fields(self.max_bytes);
        let mut event = RosMessage::new(self.ros_type, event)
            .fields(self.max_bytes)
            .map_err(|error| error.to_string())?;
        event
            .set(field, vec![fields.map_err(|error| error.to_string())?])
            .and_then(|()| RosMessage::from_fields(self.ros_type, &event))
            .map(|event| event.cdr.to_bytes())
            .map_err(|error| error.to_string())
    }
}

/// A client or a server whose requests and replies are told of.
struct Told<T>(T, Events);

/// `client`, whose requests and replies are told of where there are `events`.
pub(super) fn client(client: Box<dyn CdrClient>, events: Option<Events>) -> Box<dyn CdrClient> {
    match events {
        Some(events) => Box::new(Told(client, events)),
        None => client,
    }
}

/// `server`, whose requests and replies are told of where there are `events`.
pub(super) fn server(server: Box<dyn CdrServer>, events: Option<Events>) -> Box<dyn CdrServer> {
    match events {
        Some(events) => Box::new(Told(server, events)),
        None => server,
    }
}

impl CdrClient for Told<Box<dyn CdrClient>> {
    fn send(&mut self, parts: &[&[u8]]) -> Result<i64, GraphError> {
        let Self(client, events) = self;
        let sequence = client.send(parts)?;
        events.tell(ServiceEventInfo::REQUEST_SENT, &client.id_of(sequence), parts);
        Ok(sequence)
    }

    fn take(&mut self) -> Result<Option<CdrReply>, GraphError> {
        let Self(client, events) = self;
        let taken = client.take()?;
        if let Some(reply) = &taken {
            let id = client.id_of(reply.sequence);
            events.tell(ServiceEventInfo::RESPONSE_RECEIVED, &id, &[&reply.cdr]);
        }
        Ok(taken)
    }

    fn id_of(&self, sequence: i64) -> RequestId {
        self.0.id_of(sequence)
    }

    fn servers(&self) -> Peers {
        self.0.servers()
    }

    fn look_again(&self) -> Option<Duration> {
        self.0.look_again()
    }
}

impl CdrServer for Told<Box<dyn CdrServer>> {
    fn take(&mut self) -> Result<Option<CdrRequest>, GraphError> {
        let Self(server, events) = self;
        let taken = server.take()?;
        if let Some(request) = &taken {
            events.tell(ServiceEventInfo::REQUEST_RECEIVED, &request.id, &[&request.cdr]);
        }
        Ok(taken)
    }

    fn hears(&self, id: &RequestId) -> bool {
        self.0.hears(id)
    }

    fn note_client(&mut self, id: &RequestId, writer: &[u8; 16]) {
        self.0.note_client(id, writer);
    }

    fn look_again(&self) -> Option<Duration> {
        self.0.look_again()
    }

    fn reply(&mut self, id: &RequestId, parts: &[&[u8]]) -> Result<(), GraphError> {
        let Self(server, events) = self;
        server.reply(id, parts)?;
        events.tell(ServiceEventInfo::RESPONSE_SENT, id, parts);
        Ok(())
    }

    fn clients(&self) -> Peers {
        self.0.clients()
    }

    fn lost(&mut self) -> u64 {
        self.0.lost()
    }
}
