//! Native objects: JSON with its arrays beside it, or JSON alone as Python Wrapyfi sends it.

use bytes::Bytes;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::cdr::{CdrParts, CdrReader, CdrWriter};
use wrapyfi_interfaces::std_msgs::msg::String as Text;
use wrapyfi_interfaces::wrapyfi_msgs::msg;

use super::part::{FORMAT, countable, fault, header, malformed, quote, stamp};
use crate::Limits;
use crate::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult, json};
use crate::plugin::Plugins;
use crate::types::{Dtype, NativeObject, Tensor, Value};

pub(super) fn message(object: &NativeObject, plugins: &Plugins) -> EncodeResult<msg::NativeObject> {
    let (json, tensors) = json::encode_with_tensors(&object.value, plugins)?;
    let tensors = tensors.into_iter().map(tensor_message).collect::<Result<_, _>>()?;
    let header = header(object.stamp, &object.frame_id);
    Ok(msg::NativeObject { header, json: text(json)?, tensors })
}

/// Writes a `std_msgs/msg/String`. Its text holds whole images: it is shared, not copied.
pub(super) fn encode_text(value: &Value, plugins: &Plugins) -> Result<CdrParts, EncodeError> {
    let json = json::encode(value, plugins)?;
    countable("data", json.len().saturating_add(1))?; // with the terminator
    let mut writer = CdrWriter::new();
    writer.write_text(&Bytes::from(json));
    Ok(writer.finish())
}

/// Writes a text as it is, as ROS users write and read it.
pub(super) fn encode_plain(value: &Value) -> EncodeResult<CdrParts> {
    let text = plain(value)?;
    countable("data", text.len())?;
    Ok(Text { data: text.to_owned() }.encode())
}

/// The text that goes into a `std_msgs/msg/String` as it is.
pub(in crate::codec) fn plain(value: &Value) -> EncodeResult<&str> {
    value.as_str().ok_or_else(|| EncodeError::mismatch("a text", format!("a {}", value.kind())))
}

pub(super) fn decode(
    message: msg::NativeObject,
    limits: &Limits,
    plugins: &Plugins,
) -> DecodeResult<NativeObject> {
    let stamp = stamp(&message.header);
    let tensors = message
        .tensors
        .into_iter()
        .enumerate()
        .map(|(index, tensor)| tensor_from(index, tensor))
        .collect::<Result<Vec<_>, _>>()?;
    let json = Bytes::from(message.json);
    let value = json::decode_with_tensors(&json, &tensors, limits, plugins)?;
    Ok(NativeObject { stamp, frame_id: message.header.frame_id, value })
}

/// Reads a `std_msgs/msg/String` without copying its JSON; other text is a text.
pub(super) fn decode_text(cdr: &Bytes, limits: &Limits, plugins: &Plugins) -> DecodeResult<Value> {
    DecodeError::check_size(cdr.len(), limits.message_bytes)?;
    let text = CdrReader::new(cdr)
        .and_then(|mut reader| reader.read_text())
        .map_err(|error| fault(&error.in_field("data")))?;
    json::decode_or_text(&text, limits, plugins)
}

fn text(json: Vec<u8>) -> Result<String, EncodeError> {
    countable("json", json.len().saturating_add(1))?; // with the terminator
    String::from_utf8(json).map_err(|error| {
        EncodeError::unrepresentable(
            FORMAT,
            format!("JSON that is not UTF-8 from byte {} on", error.utf8_error().valid_up_to()),
            "write it in UTF-8",
        )
    })
}

fn tensor_message(tensor: Tensor) -> Result<msg::Tensor, EncodeError> {
    countable("tensors", tensor.data.len())?;
    Ok(msg::Tensor {
        dtype: tensor.dtype.name().to_owned(),
        shape: tensor.shape.iter().map(|extent| *extent as u64).collect(),
        device: tensor.device,
        data: tensor.data,
    })
}

fn tensor_from(index: usize, message: msg::Tensor) -> DecodeResult<Tensor> {
    let misfit = |field: &str, reason| malformed(&format!("tensors[{index}].{field}"), reason);
    let dtype = Dtype::from_name(&message.dtype).ok_or_else(|| {
        let known = Dtype::ALL.map(Dtype::name).join(", ");
        misfit("dtype", format!("{} is none of {known}", quote(&message.dtype)))
    })?;
    let shape = message
        .shape
        .iter()
        .map(|extent| usize::try_from(*extent))
        .collect::<Result<Vec<_>, _>>()
        .map_err(|error| misfit("shape", format!("{:?}: {error}", message.shape)))?;
    let tensor = Tensor::new(dtype, shape, message.data)
        .map_err(|error| misfit("data", error.to_string()))?;
    Ok(tensor.with_device(message.device))
}
