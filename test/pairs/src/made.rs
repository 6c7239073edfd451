//! Messages that depend on a number, and messages turned around.

use wrapyfi_core::communicator::{self, kind};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    AudioChunk, Encoding, Image, Map, MessageType, Payload, Pixels, Properties, RawPixels,
    RosMessage, SampleFormat, Stamp, Tensor, Value,
};
use wrapyfi_endpoint::codec::jpeg;
use wrapyfi_interfaces::Message;
use wrapyfi_interfaces::geometry_msgs::msg::{Twist, Vector3};
use wrapyfi_interfaces::sensor_msgs::msg::JointState;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const FRAMES: u32 = 441;

/// Something of everything that a native object may hold.
pub(crate) fn object(number: i64) -> Value {
    let low = i32::try_from(number).unwrap_or_default();
    let matrix = (0..12).map(|place| place * 2 + low).collect::<Vec<i32>>();
    let array = |tensor: Option<Tensor>| Value::from(tensor);
    let deep = Map::from([("list", Value::from_iter([Value::Tuple(vec![1.into(), 2.into()])]))]);
    Value::from(Map::from([
        ("seq", number.into()),
        ("text", "naïve 日本語 🚀 \"quoted\" \\ \n".into()),
        ("e", std::f64::consts::E.into()),
        ("yes", true.into()),
        ("nothing", Value::Null),
        ("big", u64::MAX.into()),
        ("pair", Value::Tuple(vec![number.into(), "b".into()])),
        ("letters", Value::Set(vec!["x".into()])),
        ("at", "2025-06-07T08:09:10.112131".parse().map_or(Value::Null, Value::DateTime)),
        ("matrix", array(Tensor::from_elements(&[3, 4], matrix).ok())),
        ("flags", array(Tensor::from_elements(&[3], vec![true, false, true]).ok())),
        ("ramp", array(Tensor::from_elements(&[2, 1, 2], vec![0.5_f64, -2.0, 1e300, 0.0]).ok())),
        ("deep", deep.into()),
    ]))
}

/// The same around another one.
pub(crate) fn turned_object(given: Value) -> Value {
    if given == Value::Null {
        return given;
    }
    Map::from([("back", given)]).into()
}

/// A frame of which every byte depends on the number.
pub(crate) fn image(number: i64) -> Option<Image> {
    let data = (0..WIDTH * HEIGHT * 3).map(|place| low_byte(i64::from(place % 251) + number));
    frame(data.collect())
}

/// A frame of one colour, which compression hardly changes; blue, green and red differ.
pub(crate) fn plain_image(number: i64) -> Option<Image> {
    let colour = [40, 120, 200].map(|base| low_byte(base + number % 30));
    frame(colour.repeat(usize::try_from(WIDTH * HEIGHT).ok()?))
}

fn frame(data: Vec<u8>) -> Option<Image> {
    let pixels = RawPixels::dense(WIDTH, HEIGHT, Encoding::Bgr8, data).ok()?;
    Some(Image::new(Stamp::now(), pixels))
}

fn low_byte(number: i64) -> u8 {
    u8::try_from(number.rem_euclid(256)).unwrap_or_default()
}

/// The negative of a frame.
pub(crate) fn turned_image(image: &Image) -> Option<Image> {
    let Pixels::Raw(raw) = &image.pixels else { return None };
    let data: Vec<u8> = raw.to_dense().data.iter().map(|value| 255 - value).collect();
    let pixels = RawPixels::dense(raw.width, raw.height, raw.encoding, data).ok()?;
    Some(Image::new(Stamp::now(), pixels))
}

/// The pixels of a picture, whatever its form.
pub(crate) fn pixels(image: Image) -> Option<Image> {
    jpeg::convert(image, MessageType::Image, Encoding::Bgr8, &Limits::default()).ok()
}

/// Stereo samples that depend on the number.
pub(crate) fn sound(number: i64) -> Option<AudioChunk> {
    let low = i16::from(low_byte(number));
    let samples = (0..FRAMES * 2).map(|place| {
        f32::from(i16::try_from(place % 251).unwrap_or_default() + low) / 1024.0 - 0.25
    });
    chunk(samples.collect())
}

fn chunk(samples: Vec<f32>) -> Option<AudioChunk> {
    let data: Vec<u8> = samples.into_iter().flat_map(f32::to_le_bytes).collect();
    AudioChunk::new(Stamp::now(), FRAMES, 2, 16_000, SampleFormat::F32Le, data).ok()
}

/// The same sound upside down.
pub(crate) fn turned_sound(sound: &AudioChunk) -> Option<AudioChunk> {
    let samples = sound.data.chunks_exact(4).filter_map(|bytes| bytes.try_into().ok());
    chunk(samples.map(|bytes| -f32::from_le_bytes(bytes)).collect())
}

/// A `geometry_msgs/msg/Twist`; of one that is given, the same the other way.
pub(crate) fn twist(number: i64, prev: Option<RosMessage>) -> RosMessage {
    let forth = f64::from(low_byte(number)) + 0.25;
    let given = prev.and_then(|prev| Message::decode(&prev.cdr, prev.cdr.len()).ok());
    let twist = given.map_or(forward(forth), |given: Twist| forward(-given.linear.x));
    let Some(Payload::RosMessage(message)) = payload(&twist) else {
        unreachable!("the type is generated");
    };
    message
}

fn forward(x: f64) -> Twist {
    Twist { linear: Vector3 { x, y: 0.0, z: 0.5 }, ..Twist::default() }
}

/// The state of two joints; of one that is given, the same the other way.
pub(crate) fn joints(number: i64, prev: Option<JointState>) -> JointState {
    let Some(prev) = prev else {
        return JointState {
            name: vec!["left".into(), "right".into()],
            position: vec![f64::from(low_byte(number)), -0.5],
            ..JointState::default()
        };
    };
    let position = prev.position.iter().map(|position| -position).collect();
    JointState { position, ..prev }
}

/// A generated message as the library sends it.
pub(crate) fn payload<M: Message>(message: &M) -> Option<Payload> {
    communicator::Returned::<kind::RosMessage>::to_payload(message).ok().flatten()
}

/// Parameters of the node that the test starts.
pub(crate) fn properties(number: i64) -> Properties {
    Properties::from([("gain", f64::from(low_byte(number)) + 0.5)])
}
