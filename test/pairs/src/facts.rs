//! Facts that tell one message from another, as Python computes them too.

use serde_json::{Value as Json, json};
use wrapyfi_data::types::{Image, Payload, Pixels, Value};

/// Digest and shape; nothing of what is nothing. A ROS message is the dict of its fields, as a script
/// hears it.
pub(crate) fn described(payload: impl Into<Payload>) -> Json {
    let payload = match payload.into() {
        Payload::RosMessage(message) => {
            message.to_value(message.cdr.len()).unwrap_or_default().into()
        }
        other => other,
    };
    if matches!(&payload, Payload::NativeObject(object) if object.value == Value::Null) {
        return Json::Null;
    }
    serde_json::from_str(&wrapyfi_bridge::describe::describe(&payload)).unwrap_or_default()
}

/// Shape and mean of each channel: what compression leaves nearly as it was.
pub(crate) fn described_jpeg(image: &Image) -> Json {
    let Pixels::Raw(raw) = &image.pixels else { return Json::Null };
    let channels = raw.encoding.channels();
    let dense = raw.to_dense().data;
    let mean = |channel: usize| {
        let values: Vec<u64> =
            dense.iter().skip(channel).step_by(channels).map(|&value| value.into()).collect();
        values.iter().sum::<u64>() / u64::try_from(values.len()).unwrap_or(1).max(1)
    };
    let means: Vec<u64> = (0..channels).map(mean).collect();
    json!({ "shape": [raw.height, raw.width, channels], "means": means })
}
