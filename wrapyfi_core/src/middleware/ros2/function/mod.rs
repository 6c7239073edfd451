//! Functions of Wrapyfi as ROS 2 services: how calls and what they return are written.
//!
//! ```text
//!              wrapyfi_msgs/srv/…                          wrapyfi_ros2_interfaces/srv/…
//!   request    NativeObject {"args": […], "kwargs": {…}}   text: [args, kwargs], as Python's clients
//!   reply      success, message, response                  response
//!   error      success false, message                      has no form
//! ```
//!
//! Arrays travel beside the JSON in ours, and as base64 in Python's. Any other service is called with the
//! fields of its request as arguments, and returns a dict of those of its reply.

mod client;
mod server;

use bytes::Bytes;
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue, Plan, ValueError};
use wrapyfi_interfaces::store::TypeStore;

pub(super) use client::FunctionClient;
pub(super) use server::FunctionServer;

use super::service::{ServiceOptions, ServiceType};
use super::{AnyError, NAME, Ros2, payload};
use crate::codec::requests;
use crate::codec::{json, ros};
use crate::endpoint::{OpenError, Request, ServiceSpec};
use crate::types::{
    DataType, MessageType, Payload, RosService, RosValueError, ServiceKind, fields_of_call,
    fields_of_return, value_of,
};
use crate::{DecodeError, EncodeError};

/// A function: its service type, and the messages in it.
struct Function {
    spec: ServiceSpec,
    service: ServiceType,
    messages: Messages,
}

/// What a function of Wrapyfi returned, or why it did not, in the reply of a service of this kind.
///
/// # Errors
/// When the reply does not hold what such services return.
pub fn returned(
    kind: ServiceKind,
    reply: &DynamicMessage,
) -> Result<Result<Payload, String>, DecodeError> {
    let function = Function::new(&ServiceSpec::new("", kind));
    let function = function.map_err(|error| malformed("response", error.to_string()))?;
    function.read_reply(reply).map(|(returned, _size)| returned)
}

/// How requests and replies are laid out.
enum Messages {
    /// Wrapyfi's: the plans of a request's arguments, and of what is returned.
    Wrapped { arguments: Plan, returned: Plan },
    /// Fields of any service.
    Fields(RosService),
}

impl Function {
    fn new(spec: &ServiceSpec) -> Result<Self, OpenError> {
        let mut store = TypeStore::generated();
        let refused = |reason: String| OpenError::Transport {
            middleware: NAME,
            topic: spec.service.clone(),
            reason,
        };
        if let ServiceKind::Ros(service) = spec.kind {
            let messages = Messages::Fields(service);
            let service = ServiceType::new(service.resolved());
            let service = service.map_err(|error| refused(error.to_string()))?;
            return Ok(Self { spec: spec.clone(), service, messages });
        }
        let mut plan = |name: &str| {
            let resolved = store.resolve_name(name).map_err(|error| refused(error.to_string()))?;
            resolved.plan().map_err(|error| refused(error.to_string()))
        };
        let arguments = plan(MessageType::NativeObject.ros_type())?;
        let returned = plan(spec.kind.message_type().ros_type())?;
        let resolved = TypeStore::generated()
            .resolve_name(spec.kind.ros_type())
            .map_err(|error| refused(error.to_string()))?;
        let service = ServiceType::new(&resolved).map_err(|error| refused(error.to_string()))?;
        let messages = Messages::Wrapped { arguments, returned };
        Ok(Self { spec: spec.clone(), service, messages })
    }

    fn options(&self) -> ServiceOptions {
        ServiceOptions {
            timeout: self.spec.timeout,
            pending: self.spec.pending,
            max_bytes: self.spec.limits.message_bytes,
            // All that may be under way at once: DDS overwrites what exceeds its depth.
            depth: u32::try_from(self.spec.pending).unwrap_or(u32::MAX).max(10),
            mark: self.spec.mark.clone(),
        }
    }

    fn write_request(
        &self,
        request: &Request,
        mut message: DynamicMessage,
    ) -> Result<DynamicMessage, EncodeError> {
        let arguments = match &self.messages {
            Messages::Wrapped { arguments, .. } => arguments,
            Messages::Fields(service) => {
                let most = self.spec.limits.message_bytes;
                let Request { args, kwargs } = request;
                return fields_of_call(service.request(), args, kwargs, most)
                    .map_err(|error| unsuitable(&error));
            }
        };
        if self.spec.kind.is_upstream() {
            let text = text(requests::encode_request(request, &self.spec)?)?;
            message.set("request", text).map_err(|fault| unwritable(&fault))?;
            return Ok(message);
        }
        // Refuses what no caller may send, such as keywords that are no text.
        let call = Payload::from(requests::to_value(request));
        let arguments = self.message(&call, MessageType::NativeObject, arguments)?;
        message.set("request", arguments).map_err(|fault| unwritable(&fault))?;
        Ok(message)
    }

    /// The call in a request, and its size in bytes.
    fn read_request(&self, message: &DynamicMessage) -> Result<(Request, usize), DecodeError> {
        let arguments = match &self.messages {
            Messages::Wrapped { arguments, .. } => arguments,
            Messages::Fields(_) => {
                let fields = value_of(message);
                let size = fields.size_hint();
                let kwargs = fields.as_map().cloned().unwrap_or_default();
                return Ok((Request::default().with(kwargs), size));
            }
        };
        if self.spec.kind.is_upstream() {
            let text = text_of(message, "request")?;
            let size = text.len();
            return Ok((requests::decode_request(&text, &self.spec)?, size));
        }
        let cdr = self.cdr(message, "request", arguments)?;
        match self.payload(&cdr, MessageType::NativeObject)? {
            Payload::NativeObject(object) => Ok((requests::from_value(object.value)?, cdr.len())),
            other => Err(mismatch(DataType::NativeObject, other.data_type())),
        }
    }

    fn write_reply(
        &self,
        returned: &Payload,
        mut message: DynamicMessage,
    ) -> Result<DynamicMessage, EncodeError> {
        let wanted = self.spec.kind.data_type();
        if returned.data_type() != wanted {
            let (expected, actual) = (wanted.to_string(), returned.data_type().to_string());
            return Err(EncodeError::Mismatch { expected, actual });
        }
        let plan = match &self.messages {
            Messages::Wrapped { returned, .. } => returned,
            Messages::Fields(service) => {
                let Payload::NativeObject(value) = returned else { return Ok(message) };
                return fields_of_return(service.response(), value, self.spec.limits.message_bytes)
                    .map_err(|error| unsuitable(&error));
            }
        };
        let message_type = self.spec.kind.message_type();
        let set = match (message_type, returned) {
            (MessageType::StringJson, Payload::NativeObject(value)) => {
                message.set("response", text(json::encode_with(value, &self.spec.plugins)?)?)
            }
            _ => message.set("response", self.message(returned, message_type, plan)?),
        };
        set.map_err(|fault| unwritable(&fault))?;
        if !self.spec.kind.is_upstream() {
            message.set("success", true).map_err(|fault| unwritable(&fault))?;
        }
        Ok(message)
    }

    /// What a reply says, and its size in bytes: what the function returned, or why it did not.
    fn read_reply(
        &self,
        message: &DynamicMessage,
    ) -> Result<(Result<Payload, String>, usize), DecodeError> {
        let Messages::Wrapped { returned, .. } = &self.messages else {
            let fields = value_of(message);
            let size = fields.size_hint();
            return Ok((Ok(fields.into()), size));
        };
        let failed = matches!(message.get("success"), Some(DynamicValue::Bool(false)));
        if !self.spec.kind.is_upstream() && failed {
            let reason = message.get("message").and_then(|text| text.as_str()).unwrap_or_default();
            return Ok((Err(reason.to_owned()), reason.len()));
        }
        let message_type = self.spec.kind.message_type();
        if message_type == MessageType::StringJson {
            let text = text_of(message, "response")?;
            let value = json::decode_with(&text, &self.spec.limits, &self.spec.plugins)?;
            return Ok((Ok(value.into()), text.len()));
        }
        let cdr = self.cdr(message, "response", returned)?;
        Ok((Ok(self.payload(&cdr, message_type)?), cdr.len()))
    }

    /// A payload as the message that a field holds. Pixels and samples are copied in one piece.
    fn message(
        &self,
        payload: &Payload,
        message_type: MessageType,
        plan: &Plan,
    ) -> Result<DynamicMessage, EncodeError> {
        let ServiceSpec { color_order, limits, plugins, .. } = &self.spec;
        let cdr = payload::encode(payload, message_type, *color_order, limits, plugins)?.to_bytes();
        plan.decode(&cdr, limits.message_bytes).map_err(|fault| EncodeError::Unrepresentable {
            format: "a service",
            what: fault.to_string(),
            path: "$".to_owned(),
            remedy: "raise max_message_mib".to_owned(),
        })
    }

    /// The message in a field, as CDR.
    fn cdr(&self, of: &DynamicMessage, field: &str, plan: &Plan) -> Result<Bytes, DecodeError> {
        let nested = of.get(field).and_then(|value| value.as_message());
        let nested = nested.ok_or_else(|| malformed(field, "no message".to_owned()))?;
        let cdr = plan.encode(nested).map_err(|fault| malformed(field, fault.to_string()))?;
        Ok(cdr.to_bytes())
    }

    fn payload(&self, cdr: &Bytes, message_type: MessageType) -> Result<Payload, DecodeError> {
        ros::decode_with(cdr, message_type, &self.spec.limits, &self.spec.plugins)
    }
}

fn unsuitable(error: &RosValueError) -> EncodeError {
    EncodeError::Unrepresentable {
        format: "a service",
        what: error.to_string(),
        path: "$".to_owned(),
        remedy: "give the fields of its definition".to_owned(),
    }
}

fn text(json: Vec<u8>) -> Result<String, EncodeError> {
    String::from_utf8(json).map_err(|error| EncodeError::Unrepresentable {
        format: "a service",
        what: format!("JSON that is not UTF-8: {error}"),
        path: "$".to_owned(),
        remedy: "write it in UTF-8".to_owned(),
    })
}

fn text_of(message: &DynamicMessage, field: &str) -> Result<Bytes, DecodeError> {
    let text = message.get(field).and_then(|value| value.as_str());
    let text = text.ok_or_else(|| malformed(field, "no text".to_owned()))?;
    Ok(Bytes::copy_from_slice(text.as_bytes()))
}

fn unwritable(fault: &ValueError) -> EncodeError {
    EncodeError::Unrepresentable {
        format: "a service",
        what: fault.to_string(),
        path: "$".to_owned(),
        remedy: "check the definition of its type".to_owned(),
    }
}

fn malformed(field: &str, reason: String) -> DecodeError {
    DecodeError::Malformed { format: "CDR", path: format!("$.{field}"), reason }
}

fn mismatch(expected: DataType, actual: DataType) -> DecodeError {
    DecodeError::Mismatch { expected: expected.to_string(), actual: actual.to_string() }
}

/// What stands in the way of opening a service.
fn refused(spec: &ServiceSpec, error: &AnyError) -> OpenError {
    OpenError::Transport {
        middleware: NAME,
        topic: spec.service.clone(),
        reason: error.to_string(),
    }
}

/// Checks the name before anything is opened: a wrong one stays wrong.
fn check_name(ros2: &Ros2, spec: &ServiceSpec) -> Result<(), OpenError> {
    ros2.resolve(&spec.service).map(drop)
}

#[cfg(test)]
mod tests;
