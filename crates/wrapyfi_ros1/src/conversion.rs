//! Conversion between the messages of a ROS 1 topic and payloads, chosen by the topic's type.
//!
//! ```text
//!   Wrapyfi's types    ROS 1 bytes ◀─ codec::ros1 ─▶ payload
//!   any other type     ROS 1 bytes ◀─ plan ─▶ CDR    one for each pair of definitions: a publisher
//!                                                    shows its own when the connection begins
//! ```

use std::borrow::Cow;

use bytes::Bytes;
use wrapyfi_interfaces::parser::InterfaceKind;
use wrapyfi_interfaces::ros1::{
    ActionMessage, Definition, Options, PairPlan, TranscodeError, Types,
};

use super::config::NAME;
use super::core::Core;
use super::differences::towards;
use super::header::Header;
use super::xmlrpc::shortened;
use wrapyfi_data::types::{Encoding, Image, MessageType, Payload, Pixels, RosMessage, RosType};
use wrapyfi_data::{DecodeError, DecodeResult, EncodeError, EncodeResult, Limits};
use wrapyfi_endpoint::codec::ros1::{self, Ros1Type};
use wrapyfi_endpoint::{OpenError, OpenResult, PeerFault, TopicSpec};

/// Any type: a publisher says which.
pub(super) const ANY: &str = "*";

/// Type that a subscriber names in its connection header; `None` where ROS 1 has none for
/// `message_type`.
pub(super) fn wanted(core: &Core, message_type: MessageType) -> Option<Ros1Type> {
    let MessageType::Ros(ros_type) = message_type else { return Ros1Type::of(message_type) };
    // The name is for people; which definition it is the publisher shows.
    let likely = towards(&mut core.types(), ros_type);
    let name = likely.map_or_else(|_e| ANY.to_owned(), |(definition, _)| definition.ros1_name());
    Some(Ros1Type { name, md5: ANY.to_owned(), definition: String::new() })
}

/// Type that a publisher announces, and the plan that converts CDR to it where no codec of its own
/// exists; `None` where ROS 1 has no such type.
pub(super) fn offered(
    core: &Core,
    spec: &TopicSpec,
) -> OpenResult<Option<(Ros1Type, Option<PairPlan>)>> {
    let message_type = spec.message_type;
    let MessageType::Ros(ros_type) = message_type else {
        return Ok(Ros1Type::of(message_type).map(|known| (known, None)));
    };
    match towards(&mut core.types(), ros_type) {
        Ok((definition, plan)) => {
            let name = definition.ros1_name();
            let Definition { md5sum: md5, text: definition, .. } = definition;
            Ok(Some((Ros1Type { name, md5, definition }, Some(plan))))
        }
        Err(error) => Err(OpenError::UnsupportedType {
            middleware: NAME,
            message_type,
            remedy: error.to_string(),
        }),
    }
}

/// The plan for what a publisher shows in its header, where the type has no codec of its own.
pub(super) fn publisher_plan(
    core: &Core,
    header: &Header,
    message_type: MessageType,
) -> Result<Option<PairPlan>, PeerFault> {
    let MessageType::Ros(ros_type) = message_type else { return Ok(None) };
    let name = header.get("type").unwrap_or(ANY);
    let announced = header.get("md5sum").zip(header.get("message_definition"));
    plan(&mut core.types(), name, announced, ros_type).map(Some).map_err(|reason| {
        let (theirs, ours) = (shortened(name), ros_type.to_string());
        PeerFault::Unreadable { theirs, ours, reason: shortened(&reason) }
    })
}

fn plan(
    types: &mut Types,
    name: &str,
    announced: Option<(&str, &str)>,
    ros_type: RosType,
) -> Result<PairPlan, String> {
    let definition = match announced {
        // Some nodes show nothing.
        None | Some(("*", "")) => types.definition(name),
        Some((md5sum, text)) => types.show(name, md5sum, text),
    };
    let definition = definition.map_err(|error| error.to_string())?;
    let (rules, wanted) = (types.rules(), ros_type.resolved().name());
    let ros1 = match wanted.kind() {
        InterfaceKind::Action => ActionMessage::new(definition).map_err(|e| e.to_string())?.part,
        _ => definition.resolved,
    };
    let belong = rules.ros2_names(ros1.name()).contains(wanted)
        || rules.ros1_names(wanted).contains(ros1.name());
    if !belong {
        return Err("it is the counterpart of another type; name that as the type".to_owned());
    }
    PairPlan::compile(&ros1, ros_type.resolved(), rules).map_err(|e| e.to_string())
}

/// Converts ROS 1 bytes by `plan` into a message of `ros_type`, whose size may differ from that of ROS 1.
pub(super) fn from_ros1(
    bytes: &Bytes,
    plan: &PairPlan,
    ros_type: RosType,
    limits: &Limits,
) -> DecodeResult<RosMessage> {
    let options = Options { message_bytes: limits.message_bytes, ..Options::default() };
    let mut cdr = Vec::new();
    plan.to_cdr(bytes, &options, &mut cdr).map_err(|error| fault(&error))?;
    Ok(RosMessage::new(ros_type, cdr))
}

/// Converts a message by `plan` into ROS 1 bytes.
pub(super) fn to_ros1(
    message: &RosMessage,
    plan: &PairPlan,
    sequence: u32,
    limits: &Limits,
) -> EncodeResult<Vec<u8>> {
    let options = Options { message_bytes: limits.message_bytes, ..Options::default() };
    let mut bytes = Vec::new();
    let done = plan.to_ros1(&message.cdr, sequence, &options, &mut bytes);
    done.map_err(|error| unwritable(message.ros_type, error))?;
    Ok(bytes)
}

/// Reads a message.
pub(super) fn decode(
    message: &Bytes,
    plan: Option<&PairPlan>,
    spec: &TopicSpec,
) -> DecodeResult<Payload> {
    let TopicSpec { message_type, limits, plugins, .. } = spec;
    let (MessageType::Ros(ros_type), Some(plan)) = (message_type, plan) else {
        return ros1::decode(message, *message_type, limits, plugins);
    };
    from_ros1(message, plan, *ros_type, limits).map(Payload::from)
}

fn unwritable(ros_type: RosType, error: TranscodeError) -> EncodeError {
    match error {
        TranscodeError::TooLarge { actual, limit } => EncodeError::too_large(actual, limit),
        other => EncodeError::unrepresentable(
            "ROS 1",
            format!("a malformed {ros_type}: {other}"),
            "look at its publisher",
        ),
    }
}

fn fault(error: &TranscodeError) -> DecodeError {
    match error {
        TranscodeError::TooLarge { actual, limit } => DecodeError::too_large(*actual, *limit),
        other => DecodeError::malformed("ROS 1", other.to_string()),
    }
}

/// Writes a message, in pieces.
pub(super) fn encode(
    payload: &Payload,
    plan: Option<&PairPlan>,
    sequence: u32,
    spec: &TopicSpec,
) -> EncodeResult<Vec<Bytes>> {
    let TopicSpec { message_type, limits, plugins, color_order, .. } = spec;
    match (payload, message_type, plan) {
        (Payload::RosMessage(message), MessageType::Ros(ros_type), Some(plan))
            if message.ros_type == *ros_type =>
        {
            Ok(vec![to_ros1(message, plan, sequence, limits)?.into()])
        }
        _ => {
            let payload = in_order(payload, *color_order);
            ros1::encode(&payload, *message_type, sequence, limits, plugins)
        }
    }
}

/// The payload with colours in the order that listeners read: Wrapyfi's take `bgr8` only, so pixels in the other order are
/// turned, unless `color_order` asks for that order.
pub(super) fn in_order(payload: &Payload, color_order: Encoding) -> Cow<'_, Payload> {
    match payload {
        Payload::Image(image @ Image { pixels: Pixels::Raw(raw), .. })
            if (raw.encoding, color_order) == (Encoding::Rgb8, Encoding::Bgr8) =>
        {
            let pixels = Pixels::Raw(raw.clone().swap_red_blue());
            Cow::Owned(Payload::Image(Image { pixels, ..image.clone() }))
        }
        _ => Cow::Borrowed(payload),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::RawPixels;

    fn encoding_of(pixels: RawPixels, color_order: Encoding) -> (Encoding, Vec<u8>) {
        let payload = Payload::Image(Image::new(wrapyfi_data::types::Stamp::default(), pixels));
        let payload = in_order(&payload, color_order).into_owned();
        let Payload::Image(Image { pixels: Pixels::Raw(raw), .. }) = payload else {
            panic!("pixels stay pixels");
        };
        (raw.encoding, raw.data.to_vec())
    }

    #[test]
    fn colour_is_as_wrapyfi_takes_it_unless_the_other_order_is_asked_for() {
        let pixel =
            |encoding, bytes: &[u8]| RawPixels::dense(1, 1, encoding, bytes.to_vec()).unwrap();
        let red = || pixel(Encoding::Rgb8, &[255, 1, 0]);
        assert_eq!(encoding_of(red(), Encoding::Bgr8), (Encoding::Bgr8, vec![0, 1, 255]));
        assert_eq!(encoding_of(red(), Encoding::Rgb8), (Encoding::Rgb8, vec![255, 1, 0]));
        let blue = || pixel(Encoding::Bgr8, &[255, 1, 0]);
        assert_eq!(encoding_of(blue(), Encoding::Rgb8), (Encoding::Bgr8, vec![255, 1, 0]));
        let grey = pixel(Encoding::Mono8, &[9]);
        assert_eq!(encoding_of(grey, Encoding::Bgr8), (Encoding::Mono8, vec![9]));
    }
}
