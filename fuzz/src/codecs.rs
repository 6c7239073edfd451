//! Targets of `wrapyfi_endpoint::codec`.

use bytes::Bytes;
use wrapyfi_data::Limits;
use wrapyfi_data::types::{Encoding, MessageType, Properties, Stamp};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::npy::NpyArray;
use wrapyfi_endpoint::codec::{jpeg as jpeg_file, json as text, npy as file, ros};
use wrapyfi_zeromq::codec as zeromq;

use crate::{LIMITS, bounded};

/// Memory a value may take for each byte of its text: a value is tens of bytes, the shortest text
/// of one is two, and vectors grow by doubling.
const TEXT: usize = 160;
/// Memory for each byte where bytes are shared or copied, not turned into values.
const BYTES: usize = 4;

/// Length of a text for [`TEXT`]. Objects that are packed may become as large as a message, however
/// short they are; with what their decoders need, four times that.
fn text_of(data: &[u8]) -> usize {
    const PACKED: [&[u8]; 2] = [b"PILImage", b"ZarrData"];
    let packed = data.windows(8).any(|window| PACKED.contains(&window));
    data.len() + if packed { 4 * LIMITS.message_bytes / TEXT } else { 0 }
}

/// Limits for reading back: a written message may be longer, by spaces, escapes and wider floats.
const WIDE: Limits = Limits { message_bytes: 16 * LIMITS.message_bytes, ..LIMITS };

/// Wrapyfi's JSON, arrays in it included.
pub fn json(data: &[u8]) {
    let data = Bytes::copy_from_slice(data);
    let Ok(value) = bounded(text_of(&data), TEXT, || {
        text::decode(&data, &LIMITS, &wrapyfi_plugins::standard())
    }) else {
        return;
    };
    let written =
        text::encode(&value, &wrapyfi_plugins::standard()).expect("what was read can be written");
    let again = text::decode(&written.clone().into(), &WIDE, &wrapyfi_plugins::standard())
        .expect("what was written is read");
    // Not the values: one with a NaN inside differs from itself.
    let rewritten =
        text::encode(&again, &wrapyfi_plugins::standard()).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");

    if let Ok(properties) = Properties::from_value(&value) {
        let again = Properties::from_value(&properties.to_value()).expect("properties are a dict");
        assert!(properties.names().eq(again.names()), "names changed");
    }

    // Refused where a plug-in has taken the name by which arrays are meant there.
    let Ok((beside, tensors)) = text::encode_with_tensors(&value, &wrapyfi_plugins::standard())
    else {
        return;
    };
    let whole =
        text::decode_with_tensors(&beside.into(), &tensors, &WIDE, &wrapyfi_plugins::standard())
            .expect("its own text");
    let rewritten =
        text::encode(&whole, &wrapyfi_plugins::standard()).expect("what was read can be written");
    assert!(written == rewritten, "changed by arrays beside the text");
}

/// NumPy's array file.
pub fn npy(data: &[u8]) {
    let data = Bytes::copy_from_slice(data);
    let Ok(array) = bounded(data.len(), BYTES, || file::read(&data)) else { return };
    let written = match &array {
        NpyArray::Tensor(tensor) => file::write(tensor),
        NpyArray::Array(other) => file::write_array(other),
    };
    let again = file::read(&written.into()).expect("what was written is read");
    assert!(array == again, "changed by writing and reading");
}

/// A message of Wrapyfi on ZeroMQ. The first byte chooses type and channel order; then each frame
/// with its length in two bytes before it, the last one without.
pub fn frames(data: &[u8]) {
    let Some((&choice, mut rest)) = data.split_first() else { return };
    let message_type = message_type(choice);
    let mut spec = TopicSpec::new("/t", message_type);
    spec.limits = LIMITS;
    spec.color_order = if choice & 0x80 == 0 { Encoding::Bgr8 } else { Encoding::Rgb8 };
    let mut message = vec![Bytes::from_static(b"/t")];
    while let Some((length, after)) = rest.split_first_chunk::<2>() {
        let length = usize::from(u16::from_le_bytes(*length));
        let (frame, after) = after.split_at_checked(length).unwrap_or((after, &[]));
        message.push(Bytes::copy_from_slice(frame));
        rest = after;
        if message.len() > 20 {
            break;
        }
    }
    let now = Stamp { sec: 1, nanosec: 2 };
    let Ok(payload) = bounded(text_of(data), TEXT, || zeromq::decode(&message, &spec, now)) else {
        return;
    };
    assert_eq!(payload.data_type(), message_type.data_type());
    spec.limits = WIDE;
    // A frame of the other form is converted on the way out, or refused.
    let Ok(written) = zeromq::encode(&payload, &spec) else { return };
    let read = |frames: &[Vec<u8>]| {
        let frames: Vec<Bytes> = frames.iter().map(|f| Bytes::copy_from_slice(f)).collect();
        zeromq::decode(&frames, &spec, now).expect("what was written is read")
    };
    let rewritten = zeromq::encode(&read(&written), &spec).expect("what was read can be written");
    assert!(written == rewritten, "changed by writing and reading");
}

/// A JPEG file. The first byte chooses the channel order.
pub fn jpeg(data: &[u8]) {
    // The picture may be larger than its file, but not than a message.
    const LIMIT: usize = 256 << 10;
    let limits = Limits { message_bytes: LIMIT, ..LIMITS };
    let Some((&choice, body)) = data.split_first() else { return };
    let order = [None, Some(Encoding::Rgb8), Some(Encoding::Bgr8), Some(Encoding::Mono16)];
    let order = order.get(usize::from(choice % 4)).copied().flatten();
    let body = Bytes::copy_from_slice(body);
    let read = bounded(data.len() + LIMIT, 8, || jpeg_file::decode(&body, &limits, order));
    let Ok(picture) = read else { return };
    assert!(picture.data.len() <= LIMIT);
    assert_eq!(picture.data.len(), picture.step as usize * picture.height as usize);
    let written = jpeg_file::encode(&picture, 95).expect("what was read can be written");
    let again = jpeg_file::decode(&written, &limits, order).expect("what was written is read");
    assert_eq!((again.width, again.height), (picture.width, picture.height));
    assert_eq!(again.encoding, picture.encoding);
}

/// A ROS message as CDR. The first byte chooses its type.
pub fn cdr(data: &[u8]) {
    let Some((&choice, body)) = data.split_first() else { return };
    let message_type = message_type(choice);
    let factor = match message_type {
        MessageType::NativeObject | MessageType::StringJson => TEXT,
        _ => BYTES,
    };
    let body = Bytes::copy_from_slice(body);
    let read = bounded(text_of(data), factor, || {
        ros::decode(&body, message_type, &LIMITS, &wrapyfi_plugins::standard())
    });
    let Ok(payload) = read else { return };
    assert_eq!(payload.data_type(), message_type.data_type());
    let written = ros::encode(&payload, message_type, &wrapyfi_plugins::standard())
        .expect("what was read can be written");
    let written = written.to_bytes();
    let again = ros::decode(&written, message_type, &WIDE, &wrapyfi_plugins::standard())
        .expect("what was written is read");
    let rewritten = ros::encode(&again, message_type, &wrapyfi_plugins::standard())
        .expect("what was read can be written");
    assert!(written == rewritten.to_bytes(), "changed by writing and reading");
}

fn message_type(choice: u8) -> MessageType {
    let all = MessageType::TOPICS;
    all.get(usize::from(choice & 0x7f) % all.len()).copied().unwrap_or(MessageType::NativeObject)
}
