//! The body of a sound: JSON of `(chunk, channels, rate, array)`.

use bytes::Bytes;

use wrapyfi_data::codec::{DecodeResult, EncodeError, json, sound};
use wrapyfi_data::types::{AudioChunk, Dtype, SampleFormat, Stamp, Tensor, Value};
use wrapyfi_endpoint::TopicSpec;

pub(super) fn decode(body: &Bytes, stamp: Stamp, spec: &TopicSpec) -> DecodeResult<AudioChunk> {
    sound::from_message(&json::decode(body, &spec.limits, &spec.plugins)?, stamp)
}

pub(super) fn encode(sound: &AudioChunk, spec: &TopicSpec) -> Result<Vec<u8>, EncodeError> {
    let sound = sound.to_format(SampleFormat::F32Le);
    let array = Tensor::new(Dtype::F32, sound.shape(), sound.data).map_err(|error| {
        EncodeError::unrepresentable("sound", error.to_string(), "make chunks with AudioChunk::new")
    })?;
    json::encode(
        &Value::Tuple(vec![
            sound.frames.into(),
            sound.channels.into(),
            sound.sample_rate.into(),
            array.into(),
        ]),
        &spec.plugins,
    )
}
