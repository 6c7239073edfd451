//! Conversion of payloads to another kind, and of pictures to another form, for routes whose ends
//! carry different types. Routes, methods of the communicator and commands call it with the type of
//! their endpoint; encoders refuse a picture of the other form.
//!
//! ```text
//!   NativeObject (array, Pillow image) ◀─▶ Image
//!   NativeObject (array, rate)         ◀─▶ AudioChunk
//!   NativeObject (dict)                ◀─▶ Properties
//!   NativeObject (dict of its fields)  ◀─▶ RosMessage
//!   Image: pixels                      ◀─▶ Image: file
//! ```

use super::{DecodeError, DecodeResult, EncodeError, EncodeResult, jpeg, ros};
use crate::Limits;
use crate::types::{
    DataType, Encoding, Header, MessageType, NativeObject, Payload, Properties, RosMessage,
    RosType, Stamp, Value,
};

/// Error of converting a payload to another kind.
///
/// ```
/// use wrapyfi_data::Limits;
/// use wrapyfi_data::codec::{Conversion, ConvertError};
/// use wrapyfi_data::types::{Encoding, MessageType, Stamp, Value};
/// let (to, color_order, limits) = (MessageType::Image, Encoding::Bgr8, Limits::default());
/// let conversion = Conversion { to, color_order, limits };
/// let error = conversion.convert(Value::from("no picture").into(), Stamp::now).unwrap_err();
/// assert!(matches!(error, ConvertError::From(_)));
/// assert_eq!(error.to_string(), "expected an image: an array or a Pillow image, received str");
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConvertError {
    /// A native object is no image, no sound, no set of properties or no message.
    #[error(transparent)]
    From(#[from] DecodeError),
    /// An image or a sound has no form as a native object.
    #[error(transparent)]
    To(#[from] EncodeError),
}

/// Reads properties from a native object.
pub fn properties(value: &Value) -> DecodeResult<Properties> {
    Properties::from_value(value).map_err(|error| {
        DecodeError::mismatch("properties", format!("a {}: {error}", value.kind()))
    })
}

/// The properties that a payload sets, and their size in bytes.
///
/// # Errors
/// When it is another payload, or its size is over the limit.
pub fn properties_to_set(payload: &Payload, limit: usize) -> EncodeResult<(&Properties, usize)> {
    let Payload::Properties(properties) = payload else {
        let (expected, actual) = (DataType::Properties, payload.data_type());
        return Err(EncodeError::mismatch(expected.to_string(), actual.to_string()));
    };
    let size = properties.size();
    EncodeError::check_size(size, limit)?;
    Ok((properties, size))
}

/// True when [`Conversion::convert`] can convert one kind to the other.
pub fn is_convertible(from: DataType, to: DataType) -> bool {
    from == to || from == DataType::NativeObject || to == DataType::NativeObject
}

/// Type to which payloads are converted, and what the conversion goes by.
///
/// See [`ConvertError`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conversion {
    /// Type of the messages that the payloads are to be.
    pub to: MessageType,
    /// Channel order of colour arrays and of decompressed pictures.
    pub color_order: Encoding,
    /// Bounds on the result.
    pub limits: Limits,
}

impl Conversion {
    /// Converts `payload` to the kind of messages of the type, and a picture to pixels or a file as
    /// the type has it; free where it is that already. The header goes along; a native object
    /// without a time takes `now`.
    ///
    /// # Errors
    /// A mismatch when the object is none of what [`crate::types::Image::from_value`],
    /// [`crate::types::AudioChunk::from_value`], [`crate::types::Properties::from_value`] or
    /// [`RosMessage::from_value`] reads, or a message is of another type; when a picture has no such
    /// form, is broken, or would exceed the message size.
    pub fn convert(
        &self,
        payload: Payload,
        now: impl FnOnce() -> Stamp,
    ) -> Result<Payload, ConvertError> {
        let Self { to, color_order, limits } = *self;
        Ok(match to_kind(payload, to, color_order, &limits, now)? {
            Payload::Image(image) => jpeg::convert(image, to, color_order, &limits)?.into(),
            other => other,
        })
    }
}

fn to_kind(
    payload: Payload,
    to: MessageType,
    color_order: Encoding,
    limits: &Limits,
    now: impl FnOnce() -> Stamp,
) -> Result<Payload, ConvertError> {
    use crate::types::{AudioChunk, Image};
    let time = |object: &NativeObject| {
        Some(object.stamp).filter(|&stamp| stamp != Stamp::default()).unwrap_or_else(now)
    };
    if let MessageType::Ros(ros_type) = to {
        return match payload {
            Payload::RosMessage(message) if message.ros_type == ros_type => Ok(message.into()),
            Payload::NativeObject(object) => {
                let stamp = time(&object);
                Ok(message_of(*object, ros_type, limits, stamp)?.into())
            }
            other => Err(mismatch(&ros_type, &other)),
        };
    }
    Ok(match (payload, to.data_type()) {
        (payload, kind) if payload.data_type() == kind => payload,
        (Payload::NativeObject(object), DataType::Image) => {
            let image = Image::from_value(&object.value, color_order, time(&object))?;
            Image { frame_id: object.frame_id, ..image }.into()
        }
        (Payload::NativeObject(object), DataType::AudioChunk) => {
            let sound = AudioChunk::from_value(&object.value, time(&object))?;
            AudioChunk { frame_id: object.frame_id, ..sound }.into()
        }
        (Payload::NativeObject(object), DataType::Properties) => properties(&object)?.into(),
        (Payload::Properties(properties), DataType::NativeObject) => properties.to_value().into(),
        (Payload::Image(image), DataType::NativeObject) => {
            let value = image.to_value(color_order, limits)?;
            NativeObject { stamp: image.stamp, frame_id: image.frame_id, value }.into()
        }
        (Payload::AudioChunk(sound), DataType::NativeObject) => {
            let value = sound.to_value();
            NativeObject { stamp: sound.stamp, frame_id: sound.frame_id, value }.into()
        }
        (Payload::RosMessage(message), DataType::NativeObject) => {
            let value =
                message.to_value(limits.message_bytes).map_err(|error| ros::fault(&error))?;
            let Header { stamp, frame_id } = Header::of_fields(&value).unwrap_or_default();
            NativeObject { stamp, frame_id, value }.into()
        }
        (other, kind) => return Err(mismatch(&kind, &other)),
    })
}

fn mismatch(expected: &impl ToString, actual: &Payload) -> ConvertError {
    let (expected, actual) = (expected.to_string(), ros::describe(actual));
    EncodeError::mismatch(expected, actual).into()
}

/// Reads a message from the dict of its fields; `stamp` is the time of a header that the dict leaves out.
///
/// # Errors
/// A mismatch when it is no such dict, or the message would exceed the message size.
pub fn message_of(
    object: NativeObject,
    to: RosType,
    limits: &Limits,
    stamp: Stamp,
) -> DecodeResult<RosMessage> {
    let NativeObject { frame_id, value, .. } = object;
    let (kind, header) = (value.kind(), || Header { stamp, frame_id });
    RosMessage::from_value_with(to, value, header, limits.message_bytes)
        .map_err(|error| DecodeError::mismatch(to.to_string(), format!("a {kind}: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{AudioChunk, Image, Map, Picture, Pixels, RawPixels, SampleFormat, Tensor};
    use wrapyfi_interfaces::store::TypeStore;

    fn convert(payload: impl Into<Payload>, to: DataType) -> Result<Payload, ConvertError> {
        let to = to.to_string().parse::<MessageType>().unwrap();
        let now = Stamp { sec: 7, nanosec: 5 };
        let (color_order, limits) = (Encoding::Bgr8, Limits::default());
        Conversion { to, color_order, limits }.convert(payload.into(), || now)
    }

    #[test]
    fn pixels_of_the_type_already_are_not_copied() {
        let raw = RawPixels::dense(4, 2, Encoding::Bgr8, vec![7; 24]).unwrap();
        let (stamp, pixels) = (Stamp { sec: 1, nanosec: 2 }, raw.data.as_ptr());
        let Ok(Payload::Image(image)) = convert(Image::new(stamp, raw), DataType::Image) else {
            panic!()
        };
        assert!(matches!(image.pixels, Pixels::Raw(raw) if raw.data.as_ptr() == pixels));
    }

    #[test]
    fn an_array_becomes_an_image_with_a_time_and_an_image_an_array() {
        let frame =
            Value::from(Tensor::from_elements(&[1, 2, 3], vec![1_u8, 2, 3, 4, 5, 6]).unwrap());
        let Payload::Image(image) = convert(frame.clone(), DataType::Image).unwrap() else {
            panic!("an image")
        };
        assert_eq!(image.stamp, Stamp { sec: 7, nanosec: 5 });
        let Pixels::Raw(raw) = &image.pixels else { panic!("pixels") };
        assert_eq!((raw.encoding, raw.width, raw.height), (Encoding::Bgr8, 2, 1));
        let image = Image { frame_id: "eye".into(), ..image };
        let back = NativeObject { stamp: image.stamp, frame_id: "eye".into(), value: frame };
        assert_eq!(convert(image.clone(), DataType::NativeObject).unwrap(), back.clone().into());
        assert_eq!(convert(back, DataType::Image).unwrap(), image.into());
    }

    #[test]
    fn a_pillow_image_becomes_an_image_and_red_stays_red() {
        let red = RawPixels::dense(1, 1, Encoding::Rgb8, vec![255, 0, 0]).unwrap();
        let image = Image::new(Stamp::default(), red.clone());
        let picture = Value::from(Picture { image, mode: None });
        let Payload::Image(image) = convert(picture, DataType::Image).unwrap() else {
            panic!("an image")
        };
        assert_eq!(image.pixels, Pixels::Raw(red));
        let bgr = Tensor::from_elements(&[1, 1, 3], vec![0_u8, 0, 255]).unwrap();
        let Payload::NativeObject(back) = convert(image, DataType::NativeObject).unwrap() else {
            panic!("an object")
        };
        assert_eq!(back.value, bgr.into());
    }

    #[test]
    fn sound_goes_both_ways() {
        let sound = AudioChunk::new(
            Stamp { sec: 7, nanosec: 5 },
            2,
            1,
            8000,
            SampleFormat::S16Le,
            vec![1, 0, 2, 0],
        )
        .unwrap();
        let value = convert(sound.clone(), DataType::NativeObject).unwrap();
        assert_eq!(convert(value, DataType::AudioChunk).unwrap(), sound.into());
    }

    #[test]
    fn a_header_goes_into_a_message_and_out_of_it() {
        let joints = "sensor_msgs/msg/JointState";
        let joints = MessageType::resolve(joints, &mut TypeStore::generated()).unwrap();
        let into = |object: NativeObject, to| {
            let (limits, now) = (Limits::default(), || Stamp { sec: 7, nanosec: 5 });
            Conversion { to, color_order: Encoding::Bgr8, limits }
                .convert(object.into(), now)
                .unwrap()
        };
        let dict = Value::from(Map::new());
        for (stamp, wanted) in [(0, 7), (3, 3)] {
            let stamp = Stamp { sec: stamp, nanosec: if stamp == 0 { 0 } else { 5 } };
            let object = NativeObject { stamp, frame_id: "arm".into(), value: dict.clone() };
            let Payload::RosMessage(message) = into(object, joints) else { panic!("a message") };
            let back = convert(message, DataType::NativeObject).unwrap();
            let Payload::NativeObject(back) = back else { panic!("an object") };
            let wanted = Stamp { sec: wanted, nanosec: 5 };
            assert_eq!((back.stamp, back.frame_id.as_str()), (wanted, "arm"));
        }
    }

    #[test]
    fn properties_are_a_dict() {
        let rate = Value::from(Map::from([("camera", Map::from([("rate", 30)]))]));
        let read = convert(rate, DataType::Properties).unwrap();
        assert_eq!(read, Properties::from([("camera.rate", 30_i64)]).into());
        let flat = Value::from(Map::from([("camera.rate", 30)]));
        assert_eq!(convert(read, DataType::NativeObject).unwrap(), flat.into());
        assert!(!is_convertible(DataType::Properties, DataType::Image));
    }

    #[test]
    fn what_does_not_fit_is_a_mismatch_that_says_what_came() {
        let refused = crate::types::Tagged {
            refused: Some("PILImage at $: part 0 is malformed".into()),
            ..crate::types::Tagged::new("PILImage", "{}")
        };
        let flat = Tensor::from_elements(&[4], vec![0_u8; 4]).unwrap();
        let halves = Value::Tuple(vec![flat.clone().into(), 0.5.into()]);
        for (value, to, wanted) in [
            (Value::from("hello"), DataType::Image, "received str"),
            (flat.into(), DataType::Image, "received uint8 of shape [4]"),
            (refused.into(), DataType::Image, "PILImage at $: part 0"),
            (Value::from(5), DataType::AudioChunk, "sound as (array, rate), received int"),
            (Value::List(vec![1.into()]), DataType::AudioChunk, "received (int)"),
            (Value::from(5), DataType::Properties, "properties are a dict"),
            (halves, DataType::AudioChunk, "rate is float, not from 1 to 4294967295"),
        ] {
            let error = convert(value, to).unwrap_err();
            assert!(error.to_string().contains(wanted), "{error}");
            use DecodeError::{Malformed, Mismatch};
            let from = matches!(error, ConvertError::From(Mismatch { .. } | Malformed { .. }));
            assert!(from, "{error}");
        }
        assert!(!is_convertible(DataType::Image, DataType::AudioChunk));
    }
}
