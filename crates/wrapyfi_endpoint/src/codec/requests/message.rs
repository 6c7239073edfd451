//! Requests and replies of ROS services as bytes.
//!
//! ```text
//!   Request::Message, Payload::RosMessage ── as they are ──▶ CDR
//!   arguments, a dict, a list, one value ── fields ────────▶ CDR
//! ```

use crate::codec::{EncodeError, EncodeResult};
use crate::{Call, Request};
use wrapyfi_data::types::{
    Payload, RosMessage, RosType, RosValueError, fields_of_call, fields_of_return,
};

/// Encodes a request as a message of type `ros_type`, the request of a service or the goal of an action.
pub fn asked_message(
    request: &Request,
    ros_type: RosType,
    most: usize,
) -> EncodeResult<RosMessage> {
    match request {
        Request::Message(message) => given(message, ros_type, most),
        Request::Call(Call { args, kwargs }) => fields_of_call(ros_type, args, kwargs, most)
            .and_then(|fields| Ok(RosMessage::from_fields(ros_type, &fields)?))
            .map_err(|error| unsuitable(ros_type, &error)),
    }
}

/// Encodes a returned value as a message of type `ros_type`, the response of a service or the result of an action.
pub fn returned_message(
    payload: &Payload,
    ros_type: RosType,
    most: usize,
) -> EncodeResult<RosMessage> {
    match payload {
        Payload::RosMessage(message) => given(message, ros_type, most),
        Payload::NativeObject(value) => fields_of_return(ros_type, value, most)
            .and_then(|fields| Ok(RosMessage::from_fields(ros_type, &fields)?))
            .map_err(|error| unsuitable(ros_type, &error)),
        other => Err(EncodeError::mismatch(ros_type.to_string(), other.data_type().to_string())),
    }
}

/// Passes a message on unread, if it is of the type and not too large.
fn given(message: &RosMessage, wanted: RosType, most: usize) -> EncodeResult<RosMessage> {
    if message.ros_type != wanted {
        let (expected, actual) = (wanted.to_string(), message.ros_type.to_string());
        return Err(EncodeError::mismatch(expected, actual));
    }
    EncodeError::check_size(message.cdr.len(), most)?;
    Ok(message.clone())
}

fn unsuitable(ros_type: RosType, error: &RosValueError) -> EncodeError {
    EncodeError::mismatch(format!("the fields of {ros_type}"), error.to_string())
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;
    use wrapyfi_data::types::{Map, RosService, Value};

    fn service(name: &str) -> RosService {
        RosService::new(&TypeStore::generated().resolve_name(name).unwrap()).unwrap()
    }

    #[test]
    fn calls_become_the_bytes_of_the_service_and_bytes_stay_as_they_are() {
        let switch = service("std_srvs/srv/SetBool");
        let golden: &[u8] = &[0, 1, 0, 0, 1];
        for request in [
            Request::new([true.into()]),
            Request::default().with(Map::from([("data", true)])),
            Request::new([Value::from(Map::from([("data", true)]))]),
        ] {
            let message = asked_message(&request, switch.request(), 100).unwrap();
            assert_eq!(message.cdr[..5], *golden);
            assert_eq!(
                Request::Message(message.clone()).call().unwrap().kwargs,
                Map::from([("data", true)])
            );
            // The bytes pass unread, even a byte that is no bool.
            let odd = RosMessage::new(switch.request(), &b"\0\x01\0\0\x07"[..]);
            assert_eq!(
                asked_message(&Request::Message(odd.clone()), switch.request(), 100),
                Ok(odd)
            );
        }
        // success, three bytes of padding, length with the NUL, text
        let golden: &[u8] = &[0, 1, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, b'o', b'k', 0];
        let reply =
            Value::from(Map::from([("success", Value::from(true)), ("message", "ok".into())]));
        let message = returned_message(&reply.into(), switch.response(), 100).unwrap();
        assert_eq!(message.cdr[..golden.len()], *golden);
        assert_eq!(returned_message(&message.clone().into(), switch.response(), 100), Ok(message));
    }

    #[test]
    fn messages_of_another_type_and_too_large_ones_are_refused() {
        let (switch, trigger) = (service("std_srvs/srv/SetBool"), service("std_srvs/srv/Trigger"));
        let message = asked_message(&Request::new([true.into()]), switch.request(), 100).unwrap();
        let error =
            asked_message(&Request::Message(message.clone()), trigger.request(), 100).unwrap_err();
        assert!(matches!(error, EncodeError::Mismatch { .. }), "{error}");
        let error = asked_message(&Request::Message(message), switch.request(), 4).unwrap_err();
        assert!(matches!(error, EncodeError::TooLarge { limit: 4, .. }), "{error}");
    }
}
