//! Requests and replies of a ROS 2 service as bytes.
//!
//! ```text
//!              wrapyfi_msgs/srv/…                          wrapyfi_ros2_interfaces/srv/…
//!   request    NativeObject {"args": […], "kwargs": {…}}   text: [args, kwargs], as Python's clients
//!   reply      success, message, response                  response
//!   error      success false, message                      cannot be told
//! ```
//!
//! Arrays travel beside the JSON in ours, and as base64 in Python's. Requests and replies of any other service are
//! its own bytes; a call gives its fields as arguments.

use bytes::Bytes;
use wrapyfi_interfaces::description::HIDDEN_FIELD;
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue, TypePlan, ValueError};
use wrapyfi_interfaces::store::TypeStore;

use crate::graph::{GraphError, ServiceDescription};
use crate::payload;
use crate::ros2::no_service;
use wrapyfi_data::types::{
    DataType, MessageType, Payload, RosMessage, RosService, RosType, ServiceKind, value_of,
};
use wrapyfi_data::{DecodeError, DecodeResult, EncodeError, EncodeResult};
use wrapyfi_endpoint::codec::{json, requests, ros};
use wrapyfi_endpoint::{DropReason, OpenError, Request, ServiceSpec};

/// Codec of one service: how its requests and replies are written.
pub(super) struct ServiceCodec {
    /// Service, whose name is absolute.
    pub(super) spec: ServiceSpec,
    pub(super) service: RosService,
    /// Wrapping of a function of Wrapyfi's; `None` for any other service.
    wrapped: Option<Wrapped>,
}

/// The plans of a request's arguments, and of what is returned.
struct Wrapped {
    arguments: TypePlan,
    returned: TypePlan,
}

/// Payload or error that a function of Wrapyfi returned, read from the reply of a service of this
/// kind.
///
/// # Errors
/// When the reply does not hold what such services return.
pub fn returned(
    kind: ServiceKind,
    reply: &DynamicMessage,
) -> DecodeResult<Result<Payload, String>> {
    let codec = ServiceCodec::new(&ServiceSpec::new("", kind));
    codec.map_err(|error| malformed("response", error.to_string()))?.read_reply(reply)
}

impl ServiceCodec {
    pub(super) fn new(spec: &ServiceSpec) -> Result<Self, OpenError> {
        let spec = spec.clone();
        if let ServiceKind::Ros(service) = spec.kind {
            return Ok(Self { spec, service, wrapped: None });
        }
        let mut store = TypeStore::generated();
        let mut resolve =
            |name: &str| store.resolve_name(name).map_err(|error| no_service(&spec, &error));
        let mut plan =
            |name: &str| resolve(name)?.plan().map_err(|error| no_service(&spec, &error));
        let arguments = plan(MessageType::NativeObject.ros_type())?;
        let returned = plan(spec.kind.message_type().ros_type())?;
        let service = RosService::new(&resolve(spec.kind.ros_type())?);
        let service = service.map_err(|error| no_service(&spec, &error))?;
        Ok(Self { spec, service, wrapped: Some(Wrapped { arguments, returned }) })
    }

    pub(super) fn describe(&self, depth: u32) -> ServiceDescription {
        ServiceDescription {
            name: self.spec.service.clone(),
            type_name: self.type_name().to_owned(),
            type_hash: Some(self.service.resolved().type_hash()),
            request_hash: Some(self.service.request().type_hash().to_owned()),
            response_hash: Some(self.service.response().type_hash().to_owned()),
            depth,
            max_bytes: self.most(),
        }
    }

    pub(super) fn type_name(&self) -> &'static str {
        self.service.name()
    }

    fn most(&self) -> usize {
        self.spec.limits.message_bytes
    }

    pub(super) fn encode_request(&self, request: &Request) -> EncodeResult<Bytes> {
        let Some(Wrapped { arguments, .. }) = &self.wrapped else {
            return requests::asked_message(request, self.service, self.most())
                .map(|asked| asked.cdr);
        };
        let field = if self.spec.kind.is_upstream() {
            text(requests::encode_request(request, &self.spec)?)?.into()
        } else {
            // Refuses what no caller may send, such as keywords that are no text.
            let call = Payload::from(requests::to_value(&*requests::call(request)?));
            self.message(&call, MessageType::NativeObject, arguments)?.into()
        };
        written(self.service.request(), [("request", field)])
    }

    pub(super) fn decode_request(&self, cdr: &Bytes) -> DecodeResult<Request> {
        let Some(Wrapped { arguments, .. }) = &self.wrapped else {
            return self.own(self.service.request(), cdr).map(Request::Message);
        };
        let message = self.fields(self.service.request(), cdr)?;
        if self.spec.kind.is_upstream() {
            return requests::decode_request(&text_of(&message, "request")?, &self.spec);
        }
        match self.payload(&message, "request", arguments, MessageType::NativeObject)? {
            Payload::NativeObject(object) => requests::from_value(object.value),
            other => Err(mismatch(DataType::NativeObject, other.data_type())),
        }
    }

    pub(super) fn encode_reply(&self, returned: &Payload) -> EncodeResult<Bytes> {
        let Some(Wrapped { returned: plan, .. }) = &self.wrapped else {
            let message = requests::returned_message(returned, self.service, self.most());
            return message.map(|message| message.cdr);
        };
        let returned = &*requests::without_messages(returned)?;
        let wanted = self.spec.kind.data_type();
        if returned.data_type() != wanted {
            let (expected, actual) = (wanted.to_string(), returned.data_type().to_string());
            return Err(EncodeError::mismatch(expected, actual));
        }
        let message_type = self.spec.kind.message_type();
        let field = match (message_type, returned) {
            (MessageType::StringJson, Payload::NativeObject(value)) => {
                text(json::encode_with(value, &self.spec.plugins)?)?.into()
            }
            _ => self.message(returned, message_type, plan)?.into(),
        };
        let success = (!self.spec.kind.is_upstream()).then(|| ("success", true.into()));
        written(self.service.response(), success.into_iter().chain([("response", field)]))
    }

    /// Payload or error that a reply carries.
    pub(super) fn decode_reply(&self, cdr: &Bytes) -> DecodeResult<Result<Payload, String>> {
        if self.wrapped.is_none() {
            return self.own(self.service.response(), cdr).map(|message| Ok(message.into()));
        }
        self.read_reply(&self.fields(self.service.response(), cdr)?)
    }

    fn read_reply(&self, message: &DynamicMessage) -> DecodeResult<Result<Payload, String>> {
        let Some(Wrapped { returned, .. }) = &self.wrapped else {
            return Ok(Ok(value_of(message).into()));
        };
        let failed = matches!(message.get("success"), Some(DynamicValue::Bool(false)));
        if !self.spec.kind.is_upstream() && failed {
            let reason = message.get("message").and_then(|text| text.as_str()).unwrap_or_default();
            return Ok(Err(reason.to_owned()));
        }
        let message_type = self.spec.kind.message_type();
        if message_type == MessageType::StringJson {
            let text = text_of(message, "response")?;
            let value = json::decode_with(&text, &self.spec.limits, &self.spec.plugins)?;
            return Ok(Ok(value.into()));
        }
        self.payload(message, "response", returned, message_type).map(Ok)
    }

    /// A reply that says what went wrong, for services whose replies have room for it: see
    /// [`error_reply`].
    pub(super) fn error_reply(&self, text: &str) -> Option<Bytes> {
        let reply = error_reply(self.service, text)?;
        Some(self.service.response().plan().encode(&reply).ok()?.to_bytes())
    }

    /// A message of a service that is no function: what costs nothing is checked.
    fn own(&self, ros_type: RosType, cdr: &Bytes) -> DecodeResult<RosMessage> {
        let message = RosMessage::new(ros_type, cdr.clone());
        message.check(self.most()).map_err(|error| ros::fault(&error))?;
        Ok(message)
    }

    fn fields(&self, ros_type: RosType, cdr: &Bytes) -> DecodeResult<DynamicMessage> {
        ros_type.plan().decode_exact(cdr, self.most()).map_err(|error| ros::fault(&error))
    }

    /// A payload as the message that a field holds. Pixels and samples are copied in one piece.
    fn message(
        &self,
        payload: &Payload,
        message_type: MessageType,
        plan: &TypePlan,
    ) -> EncodeResult<DynamicMessage> {
        let ServiceSpec { color_order, limits, plugins, .. } = &self.spec;
        let cdr = payload::encode(payload, message_type, *color_order, limits, plugins)?.to_bytes();
        plan.decode(&cdr, limits.message_bytes).map_err(|fault| {
            EncodeError::unrepresentable("a service", fault.to_string(), "raise max_message_mib")
        })
    }

    /// Payload of the message in a field.
    fn payload(
        &self,
        of: &DynamicMessage,
        field: &str,
        plan: &TypePlan,
        message_type: MessageType,
    ) -> DecodeResult<Payload> {
        let nested = of.get(field).and_then(|value| value.as_message());
        let nested = nested.ok_or_else(|| malformed(field, "no message".to_owned()))?;
        let cdr = plan.encode(nested).map_err(|fault| malformed(field, fault.to_string()))?;
        let (limits, plugins) = (&self.spec.limits, &self.spec.plugins);
        ros::decode_with(&cdr.to_bytes(), message_type, limits, plugins)
    }
}

/// A reply that says what went wrong, for services whose replies have room for it: a `success`
/// (or `successful`) that is false, and a text. One without fields says nothing in any case, and
/// spares the client to wait for its time-out.
pub(super) fn error_reply(service: RosService, text: &str) -> Option<DynamicMessage> {
    let mut reply = service.response().plan().default_message();
    if reply.fields().all(|(name, _)| name == HIDDEN_FIELD) {
        return Some(reply);
    }
    let switch = ["success", "successful"];
    if !switch.iter().any(|name| reply.set(name, false).is_ok()) {
        return None;
    }
    // A reply without room for the text still says by its switch that the call failed.
    let _ = ["message", "reason", "error", "status_message"]
        .iter()
        .any(|name| reply.set(name, text).is_ok());
    Some(reply)
}

/// A message with these fields.
fn written(
    ros_type: RosType,
    fields: impl IntoIterator<Item = (&'static str, DynamicValue)>,
) -> EncodeResult<Bytes> {
    let mut message = ros_type.plan().default_message();
    for (name, value) in fields {
        message.set(name, value).map_err(|fault| unwritable(&fault))?;
    }
    Ok(ros_type.plan().encode(&message).map_err(|fault| unwritable(&fault))?.to_bytes())
}

fn text(json: Vec<u8>) -> EncodeResult<String> {
    String::from_utf8(json).map_err(|error| {
        EncodeError::unrepresentable(
            "a service",
            format!("JSON that is not UTF-8: {error}"),
            "write it in UTF-8",
        )
    })
}

fn text_of(message: &DynamicMessage, field: &str) -> DecodeResult<Bytes> {
    let text = message.get(field).and_then(|value| value.as_str());
    let text = text.ok_or_else(|| malformed(field, "no text".to_owned()))?;
    Ok(Bytes::copy_from_slice(text.as_bytes()))
}

fn unwritable(fault: &ValueError) -> EncodeError {
    EncodeError::unrepresentable("a service", fault.to_string(), "check the definition of its type")
}

fn malformed(field: &str, reason: String) -> DecodeError {
    DecodeError::Malformed { format: "CDR", path: format!("$.{field}"), reason }
}

fn mismatch(expected: DataType, actual: DataType) -> DecodeError {
    DecodeError::mismatch(expected.to_string(), actual.to_string())
}

/// Reason as which a message that cannot be used is counted; `None` where DDS itself fails.
pub(super) fn drop_reason(error: &GraphError) -> Option<DropReason> {
    match error {
        GraphError::TooLarge { .. } => Some(DropReason::Oversize),
        GraphError::NoIdentity { .. } => Some(DropReason::Malformed),
        GraphError::ForeignMapping { .. } => Some(DropReason::ServiceMapping),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::{
        AudioChunk, Encoding, Image, Map, RawPixels, SampleFormat, ServiceKind, Stamp, Tensor,
        Value,
    };

    fn codec(kind: ServiceKind) -> ServiceCodec {
        ServiceCodec::new(&ServiceSpec::new("/x", kind)).unwrap()
    }

    fn request() -> Request {
        let array = Tensor::from_elements(&[2], vec![1.5_f32, 2.5]).unwrap();
        Request::new([1.into(), "a".into(), Value::from(array)]).with(Map::from([("k", 2)]))
    }

    /// The fields of a request.
    fn asked(codec: &ServiceCodec, cdr: &Bytes) -> DynamicMessage {
        codec.fields(codec.service.request(), cdr).unwrap()
    }

    #[test]
    fn arguments_travel_and_come_back() {
        for kind in ServiceKind::ALL {
            let codec = codec(kind);
            for request in [request(), Request::default()] {
                let cdr = codec.encode_request(&request).unwrap();
                assert_eq!(codec.decode_request(&cdr).unwrap(), request, "{kind}");
            }
        }
        let text = |kind, field| {
            let codec = codec(kind);
            let request =
                Request::new([Value::from(Map::from([("a", 1)]))]).with(Map::from([("k", 2)]));
            let message = asked(&codec, &codec.encode_request(&request).unwrap());
            message.get(field).and_then(|text| text.as_str()).unwrap().to_owned()
        };
        assert_eq!(
            text(ServiceKind::NativeObject, "request.json"),
            r#"{"args": [{"a": 1}], "kwargs": {"k": 2}}"#
        );
        assert_eq!(
            text(ServiceKind::UpstreamNativeObject, "request"),
            r#"[{"__wrapyfi__": ["tuple", [{"a": 1}]]}, {"k": 2}]"#
        );
    }

    #[test]
    fn what_is_returned_comes_back() {
        let raw = RawPixels::dense(2, 1, Encoding::Bgr8, vec![1, 2, 3, 4, 5, 6]).unwrap();
        let stamp = Stamp { sec: 7, nanosec: 5 };
        let sound = AudioChunk::new(stamp, 1, 2, 8000, SampleFormat::F32Le, vec![0; 8]).unwrap();
        for kind in ServiceKind::ALL {
            let codec = codec(kind);
            let payload: Payload = match kind.data_type() {
                DataType::Image => Image::new(stamp, raw.clone()).into(),
                DataType::AudioChunk => sound.clone().into(),
                _ => Value::from(Map::from([("n", 1)])).into(),
            };
            let got = codec.decode_reply(&codec.encode_reply(&payload).unwrap()).unwrap();
            if kind == ServiceKind::CompressedImage {
                assert_eq!(got.map(|payload| payload.data_type()), Ok(DataType::Image));
            } else {
                assert_eq!(got, Ok(payload), "{kind}");
            }
            let other: Payload = match kind.data_type() {
                DataType::Image => sound.clone().into(),
                _ => Image::new(stamp, raw.clone()).into(),
            };
            let error = codec.encode_reply(&other).unwrap_err();
            assert!(matches!(error, EncodeError::Mismatch { .. }), "{error}");
        }
    }

    /// A service that is no function: what comes is what goes, and nothing is taken apart.
    #[test]
    fn services_of_ros_are_bytes() {
        let resolved = TypeStore::generated().resolve_name("std_srvs/srv/SetBool").unwrap();
        let switch = RosService::new(&resolved).unwrap();
        let codec = codec(ServiceKind::Ros(switch));
        // As a big-endian node of another vendor may write it.
        let asked = Bytes::from_static(&[0, 0, 0, 0, 1]);
        let request = codec.decode_request(&asked).unwrap();
        assert_eq!(request, Request::Message(RosMessage::new(switch.request(), asked.clone())));
        assert_eq!(codec.encode_request(&request).unwrap(), asked);
        let replied = Bytes::from_static(&[0, 1, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, b'n', b'o', 0]);
        let reply = codec.decode_reply(&replied).unwrap().unwrap();
        assert_eq!(codec.encode_reply(&reply).unwrap(), replied);
        let Payload::RosMessage(message) = reply else { panic!("{reply:?}") };
        assert_eq!(message.to_value(100).unwrap().get("message"), Some(&Value::from("no")));
        let error = codec.decode_request(&Bytes::from_static(&[0, 1, 0, 0])).unwrap_err();
        assert!(matches!(error, DecodeError::Malformed { .. }), "{error}");
    }

    #[test]
    fn errors_are_told_where_the_type_has_room() {
        for kind in ServiceKind::ALL {
            let codec = codec(kind);
            match codec.error_reply("no camera") {
                None => assert!(kind.is_upstream(), "{kind}"),
                Some(reply) => {
                    let told = codec.decode_reply(&reply).unwrap();
                    assert_eq!(told, Err("no camera".to_owned()), "{kind}");
                }
            }
        }
    }

    #[test]
    fn arguments_that_are_none_are_named() {
        let refusal = |codec: &ServiceCodec, field, text: &str| {
            let cdr = written(codec.service.request(), [(field, text.into())]).unwrap();
            codec.decode_request(&cdr).unwrap_err().to_string()
        };
        let ours = codec(ServiceKind::Image);
        for (json, words) in [
            ("5", "expected a list of arguments, or a map with args and kwargs, received int"),
            ("{\"args\": 1}", "expected a list under args, received int"),
            ("{", "malformed JSON"),
            ("{\"__wrapyfi__\": [\"tensor\", 0]}", "tensor"),
        ] {
            let error = refusal(&ours, "request.json", json);
            assert!(error.contains(words), "{json}: {error}");
        }
        let error = refusal(&codec(ServiceKind::UpstreamImage), "request", "[]");
        assert!(error.contains("expected a request [args, kwargs]"), "{error}");
    }
}
