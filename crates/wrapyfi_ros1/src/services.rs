//! Services: their types, and the bytes of requests and replies.
//!
//! ```text
//!   request   std_msgs/String or `string request`: u32 │ JSON [args, kwargs]
//!   reply     1 │ u32 size │ std_msgs/String, sensor_msgs/Image or ROSAudioMessage
//!             0 │ u32 size │ why there is none
//! ```
//!
//! That is how functions of Wrapyfi's go; two of their three types exist in no package: Python Wrapyfi
//! makes them by hand, with sums of its own. Requests and replies of any other service go from bytes to bytes,
//! by a plan compiled from both definitions.

use bytes::{BufMut as _, Bytes};
use wrapyfi_interfaces::ros1::PairPlan;

use super::config::NAME;
use super::conversion::{from_ros1, in_order, to_ros1};
use super::core::Core;
use super::differences;
use wrapyfi_data::types::{DataType, MessageType, Payload, RosService, ServiceKind};
use wrapyfi_data::{DecodeError, EncodeError};
use wrapyfi_endpoint::codec::{convert, requests, ros1};
use wrapyfi_endpoint::{OpenError, Request, ServiceSpec};

/// Name of the format in errors.
const FORMAT: &str = "ROS 1";

/// Longest text of an error, in bytes.
pub(super) const MAX_ERROR_BYTES: usize = 64 * 1024;

/// A type of service as nodes name it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ServiceType {
    pub(super) name: String,
    pub(super) md5: String,
    pub(super) request: String,
    pub(super) response: String,
}

/// A service, and how its messages are read and written.
pub(super) struct ServiceCodec {
    pub(super) spec: ServiceSpec,
    pub(super) wire_type: ServiceType,
    /// Definition and plans of a service that is no function of Wrapyfi's.
    any: Option<AnyService>,
}

/// A service whose definition is known while running.
struct AnyService {
    service: RosService,
    request: PairPlan,
    response: PairPlan,
}

impl ServiceCodec {
    /// The codec of a function, or of any service whose ROS 1 definition can be had; of the one of this checksum, where a
    /// server has told it.
    pub(super) fn new(
        core: &Core,
        spec: &ServiceSpec,
        md5sum: Option<&str>,
    ) -> Result<Self, OpenError> {
        let ServiceKind::Ros(service) = spec.kind else {
            return Ok(Self { spec: spec.clone(), wire_type: known(spec.kind), any: None });
        };
        let found = differences::service_towards(&mut core.types(), service, md5sum);
        let (definition, [request, response]) = found.map_err(|error| {
            OpenError::transport(
                NAME,
                &spec.service,
                format!("{service} cannot be used on ROS 1: {error}"),
            )
        })?;
        for (plan, part) in [(&request, service.request()), (&response, service.response())] {
            for difference in differences::of_plan(plan, part) {
                tracing::warn!(service = spec.service, "{difference}");
            }
        }
        let wire_type = ServiceType {
            name: definition.ros1_name(),
            md5: definition.md5sum.clone(),
            request: definition.request_type(),
            response: definition.response_type(),
        };
        let any = Some(AnyService { service, request, response });
        Ok(Self { spec: spec.clone(), wire_type, any })
    }

    /// Writes a request with its size.
    pub(super) fn encode_request(&self, request: &Request) -> Result<Bytes, EncodeError> {
        let body = match &self.any {
            None => {
                let text = requests::encode_request(request, &self.spec)?;
                let mut body = Vec::with_capacity(text.len() + 4);
                body.put_u32_le(countable(text.len())?);
                body.put_slice(&text);
                body
            }
            Some(AnyService { service, request: plan, .. }) => {
                let limits = &self.spec.limits;
                let message =
                    requests::asked_message(request, service.request(), limits.message_bytes)?;
                to_ros1(&message, plan, 0, limits)?
            }
        };
        let mut bytes = Vec::with_capacity(body.len() + 4);
        bytes.put_u32_le(countable(body.len())?);
        bytes.put_slice(&body);
        Ok(bytes.into())
    }

    /// Reads a request without its size.
    pub(super) fn decode_request(&self, body: &Bytes) -> Result<Request, DecodeError> {
        if let Some(AnyService { service, request: plan, .. }) = &self.any {
            let read = from_ros1(body, plan, service.request(), &self.spec.limits);
            return read.map(Request::Message);
        }
        let malformed = |reason: String| DecodeError::Malformed {
            format: FORMAT,
            path: "$.data".into(),
            reason,
        };
        let Some((size, text)) = body.split_first_chunk::<4>() else {
            return Err(malformed(format!("{} bytes are no request", body.len())));
        };
        let size = u32::from_le_bytes(*size);
        if u32::try_from(text.len()) != Ok(size) {
            return Err(malformed(format!("{size} bytes are announced, {} are there", text.len())));
        }
        requests::decode_request(&body.slice(4..), &self.spec)
    }

    /// Writes what a function returned, in pieces.
    pub(super) fn encode_reply(&self, payload: &Payload) -> Result<Vec<Bytes>, EncodeError> {
        let spec = &self.spec;
        if let Some(AnyService { service, response: plan, .. }) = &self.any {
            let limit = spec.limits.message_bytes;
            let message = requests::returned_message(payload, service.response(), limit)?;
            return Ok(vec![to_ros1(&message, plan, 0, &spec.limits)?.into()]);
        }
        let payload = &*requests::without_messages(payload)?;
        if payload.data_type() != spec.kind.data_type() {
            return Err(EncodeError::mismatch(
                spec.kind.data_type().to_string(),
                payload.data_type().to_string(),
            ));
        }
        let kind = message_type(spec.kind);
        let encode = |payload: &Payload| {
            let payload = in_order(payload, spec.color_order);
            ros1::encode(&payload, kind, 0, &spec.limits, &spec.plugins)
        };
        match payload {
            // The one type of pictures that functions have here carries pixels.
            Payload::Image(image) => {
                let image = convert(image.clone(), kind, spec.color_order, &spec.limits)?;
                encode(&image.into())
            }
            other => encode(other),
        }
    }

    /// Reads what a function returned.
    pub(super) fn decode_reply(&self, body: &Bytes) -> Result<Payload, DecodeError> {
        let spec = &self.spec;
        if let Some(AnyService { service, response: plan, .. }) = &self.any {
            return from_ros1(body, plan, service.response(), &spec.limits).map(Payload::from);
        }
        ros1::decode(body, message_type(spec.kind), &spec.limits, &spec.plugins)
    }
}

/// The type that carries a function of Wrapyfi's.
pub(super) fn known(kind: ServiceKind) -> ServiceType {
    let (name, md5, request, response) = match kind.data_type() {
        DataType::Image => (
            "wrapyfi_services/ROSImage",
            "f720f2021b4bbbe86b0f93b08906381c",
            "std_msgs/String",
            "sensor_msgs/Image",
        ),
        DataType::AudioChunk => (
            "wrapyfi_ros_interfaces/ROSAudioService",
            "955caa7702ad2185dceb7a0219b1db2f",
            "wrapyfi_ros_interfaces/ROSAudioServiceRequest",
            "wrapyfi_ros_interfaces/ROSAudioServiceResponse",
        ),
        _ => (
            "wrapyfi_services/ROSNativeObject",
            "46a550fd1ca640b396e26ebf988aed7b",
            "std_msgs/String",
            "std_msgs/String",
        ),
    };
    let [name, md5, request, response] = [name, md5, request, response].map(str::to_owned);
    ServiceType { name, md5, request, response }
}

/// The message in a reply of a function.
fn message_type(kind: ServiceKind) -> MessageType {
    match kind.data_type() {
        DataType::Image => MessageType::Image,
        DataType::AudioChunk => MessageType::UpstreamAudio,
        _ => MessageType::StringJson,
    }
}

fn countable(size: usize) -> Result<u32, EncodeError> {
    let (actual, limit) = (size as u64, u64::from(u32::MAX));
    u32::try_from(size).map_err(|_e| EncodeError::TooLarge { actual, limit })
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::ros1::Rules;
    use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

    use super::*;
    use wrapyfi_data::types::{RosMessage, RosType};

    /// Bytes of ROS 1 become those of ROS 2, and back, without a look at the values.
    #[test]
    fn services_of_ros_go_from_bytes_to_bytes() {
        let switch = TypeStore::generated().resolve_name("std_srvs/srv/SetBool").unwrap();
        let service = RosService::new(&switch).unwrap();
        let plan = |name: &str, text: &str, ros2: RosType| {
            let name = TypeName::parse(Dialect::Ros1, name).unwrap();
            let ros1 = ResolvedType::from_text(Dialect::Ros1, &name, text).unwrap();
            PairPlan::compile(&ros1, ros2.resolved(), &Rules::built_in()).unwrap()
        };
        let request = plan("std_srvs/SetBoolRequest", "bool data\n", service.request());
        let text = "bool success\nstring message\n";
        let response = plan("std_srvs/SetBoolResponse", text, service.response());
        let codec = ServiceCodec {
            spec: ServiceSpec::new("/light", ServiceKind::Ros(service)),
            wire_type: known(ServiceKind::NativeObject),
            any: Some(AnyService { service, request, response }),
        };

        let asked = codec.decode_request(&Bytes::from_static(&[1])).unwrap();
        let cdr: &[u8] = &[0, 1, 0, 0, 1];
        let Request::Message(message) = &asked else { panic!("{asked:?}") };
        assert_eq!(message.cdr[..cdr.len()], *cdr);
        assert_eq!(codec.encode_request(&asked).unwrap(), [1, 0, 0, 0, 1][..]);
        assert_eq!(
            codec.encode_request(&Request::new([true.into()])).unwrap(),
            [1, 0, 0, 0, 1][..]
        );

        let ros1 = Bytes::from_static(&[1, 2, 0, 0, 0, b'o', b'k']);
        let returned = codec.decode_reply(&ros1).unwrap();
        let cdr: &[u8] = &[0, 1, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, b'o', b'k', 0];
        let Payload::RosMessage(message) = &returned else { panic!("{returned:?}") };
        assert_eq!(message.cdr[..cdr.len()], *cdr);
        assert_eq!(codec.encode_reply(&returned).unwrap(), [ros1]);

        let broken = RosMessage::new(service.request(), &[0, 1, 0, 0][..]);
        let error = codec.encode_request(&Request::Message(broken)).unwrap_err().to_string();
        assert!(error.contains("std_srvs/srv/SetBool_Request"), "{error}");
    }
}
