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
use wrapyfi_interfaces::cdr::{CdrParts, CdrReader, CdrWriter};
use wrapyfi_interfaces::description::HIDDEN_FIELD;
use wrapyfi_interfaces::dynamic::DynamicMessage;
use wrapyfi_interfaces::store::TypeStore;

use crate::graph::{GraphError, ServiceDescription};
use crate::ros2::no_service;
use wrapyfi_data::types::{
    DataType, MessageType, Payload, RosMessage, RosService, RosType, ServiceKind,
};
use wrapyfi_data::{DecodeError, DecodeResult, EncodeError, EncodeResult};
use wrapyfi_endpoint::codec::{requests, ros};
use wrapyfi_endpoint::{DropReason, OpenError, Request, ServiceSpec};

/// Codec of one service: how its requests and replies are written.
pub(super) struct ServiceCodec {
    /// Service, whose name is absolute.
    pub(super) spec: ServiceSpec,
    pub(super) service: RosService,
}

impl ServiceCodec {
    pub(super) fn new(spec: &ServiceSpec) -> Result<Self, OpenError> {
        let spec = spec.clone();
        if let ServiceKind::Ros(service) = spec.kind {
            return Ok(Self { spec, service });
        }
        let resolved = TypeStore::generated().resolve_name(spec.kind.ros_type());
        let resolved = resolved.map_err(|error| no_service(&spec, &error))?;
        let service = RosService::new(&resolved).map_err(|error| no_service(&spec, &error))?;
        Ok(Self { spec, service })
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
        let spec = &self.spec;
        if let ServiceKind::Ros(service) = spec.kind {
            return requests::asked_message(request, service.request(), self.most())
                .map(|asked| asked.cdr.to_bytes());
        }
        // The only field of a request has the bytes of the message.
        let parts = if spec.kind.is_upstream() {
            let mut writer = CdrWriter::new();
            writer.write_text(&requests::encode_request(request, spec)?.into());
            writer.finish()
        } else {
            // Refuses what no caller may send, such as keywords that are no text.
            let call = Payload::from(requests::to_value(&*requests::call(request)?));
            ros::encode(&call, MessageType::NativeObject, &spec.plugins)?
        };
        self.within_limit(&parts)
    }

    pub(super) fn decode_request(&self, cdr: &Bytes) -> DecodeResult<Request> {
        let ServiceSpec { kind, limits, plugins, .. } = &self.spec;
        if let ServiceKind::Ros(service) = kind {
            return self.own(service.request(), cdr).map(Request::Message);
        }
        if kind.is_upstream() {
            let text =
                CdrReader::within(cdr, self.most()).and_then(|mut reader| reader.read_text());
            let text = text.map_err(|error| ros::fault(&error.in_field("request")))?;
            return requests::decode_request(&text, &self.spec);
        }
        match ros::decode(cdr, MessageType::NativeObject, limits, plugins)? {
            Payload::NativeObject(object) => requests::from_value(object.value),
            other => Err(DecodeError::mismatch(
                DataType::NativeObject.to_string(),
                other.data_type().to_string(),
            )),
        }
    }

    pub(super) fn encode_reply(&self, returned: &Payload) -> EncodeResult<Bytes> {
        let ServiceSpec { kind, plugins, .. } = &self.spec;
        if let ServiceKind::Ros(service) = kind {
            let message = requests::returned_message(returned, service.response(), self.most());
            return message.map(|message| message.cdr.to_bytes());
        }
        let returned = &*requests::without_messages(returned)?;
        self.within_limit(&ros::encode_reply(returned, *kind, plugins)?)
    }

    fn within_limit(&self, parts: &CdrParts) -> EncodeResult<Bytes> {
        EncodeError::check_size(parts.len(), self.most())?;
        Ok(parts.to_bytes())
    }

    /// Payload or error that a reply carries.
    pub(super) fn decode_reply(&self, cdr: &Bytes) -> DecodeResult<Result<Payload, String>> {
        let ServiceSpec { kind, limits, plugins, .. } = &self.spec;
        match kind {
            ServiceKind::Ros(service) => {
                self.own(service.response(), cdr).map(|message| Ok(message.into()))
            }
            _ => ros::decode_reply(cdr, *kind, limits, plugins),
        }
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
        codec.service.request().plan().decode_exact(cdr, codec.most()).unwrap()
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
            let conversion = codec.spec.conversion().unwrap();
            let payload = conversion.convert(payload, Stamp::now).unwrap();
            let got = codec.decode_reply(&codec.encode_reply(&payload).unwrap()).unwrap();
            assert_eq!(got, Ok(payload), "{kind}");
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
            let plan = codec.service.request().plan();
            let mut message = plan.default_message();
            message.set(field, text).unwrap();
            let cdr = plan.encode(&message).unwrap().to_bytes();
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
