//! Replies of functions of Wrapyfi, as services of ROS 2 carry them.
//!
//! ```text
//!   wrapyfi_msgs/srv/…                success, message, response
//!   wrapyfi_ros2_interfaces/srv/…     response: the bytes of its message, because it is the only field
//! ```

use bytes::Bytes;
use wrapyfi_interfaces::Message as _;
use wrapyfi_interfaces::cdr::CdrParts;
use wrapyfi_interfaces::wrapyfi_msgs::srv::{
    AudioService_Response, ImageService_Response, NativeObjectService_Response,
};

use super::{audio, image, native, read};
use crate::Limits;
use crate::codec::{DecodeResult, EncodeResult};
use crate::plugin::Plugins;
use crate::types::{Payload, ServiceKind};

/// Writes what a function returned as the reply of its service. Other services than those of functions are not written
/// here.
///
/// # Errors
/// As [`super::encode`], for the message of the reply.
pub fn encode_reply(
    payload: &Payload,
    kind: ServiceKind,
    plugins: &Plugins,
) -> EncodeResult<CdrParts> {
    let (success, message) = (true, String::new());
    Ok(match (payload, kind) {
        (Payload::NativeObject(object), ServiceKind::NativeObject) => {
            let response = native::message(object, plugins)?;
            NativeObjectService_Response { success, message, response }.encode()
        }
        (Payload::Image(picture), ServiceKind::Image) => {
            let response = image::raw_message(picture)?;
            ImageService_Response { success, message, response }.encode()
        }
        (Payload::AudioChunk(sound), ServiceKind::AudioChunk) => {
            let response = audio::message(sound)?;
            AudioService_Response { success, message, response }.encode()
        }
        _ => super::encode(payload, kind.message_type(), plugins)?,
    })
}

/// Reads the reply of a function's service: what it returned, or the words of its error.
///
/// # Errors
/// As [`super::decode`], for the message of the reply.
pub fn decode_reply(
    cdr: &Bytes,
    kind: ServiceKind,
    limits: &Limits,
    plugins: &Plugins,
) -> DecodeResult<Result<Payload, String>> {
    let (message, payload) = match kind {
        ServiceKind::NativeObject => {
            let reply: NativeObjectService_Response = read(cdr, limits)?;
            let read = || native::decode(reply.response, limits, plugins).map(Payload::from);
            (reply.message, reply.success.then(read))
        }
        ServiceKind::Image => {
            let reply: ImageService_Response = read(cdr, limits)?;
            let read = || image::decode_raw(reply.response).map(Payload::from);
            (reply.message, reply.success.then(read))
        }
        ServiceKind::AudioChunk => {
            let reply: AudioService_Response = read(cdr, limits)?;
            let read = || audio::decode(reply.response).map(Payload::from);
            (reply.message, reply.success.then(read))
        }
        _ => return super::decode(cdr, kind.message_type(), limits, plugins).map(Ok),
    };
    payload.transpose().map(|payload| payload.ok_or(message))
}
