//! Payloads of the benchmark, and their bytes on each wire with a number in them.
//!
//! ```text
//!   Image, AudioChunk   the number is the stamp's seconds above BASE: header frame, CDR bytes 4..8
//!   NativeObject        the number is the member `seq`, ten digits: in JSON text on both wires
//! ```
//!
//! A message that was encoded once can thus be numbered in place, and a sink finds the number in
//! the bytes that arrive without decoding them.

use anyhow::{Context as _, Result, bail};
use bytes::Bytes;
use clap::ValueEnum;
use memchr::memmem;
use serde::{Deserialize, Serialize};
use wrapyfi_data::Limits;
use wrapyfi_data::types::{
    AudioChunk, CompressedFormat, Dtype, Encoding, Image, Map, MessageType, Payload, Pixels,
    RawPixels, SampleFormat, Stamp, Tensor, Value,
};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::{self, jpeg, ros};
use wrapyfi_interfaces::named;
use wrapyfi_zeromq::codec as frames;

/// Numbers are counted from here: ten digits, and a plausible time.
pub(crate) const BASE: u32 = 1_700_000_000;

named! {
    /// A payload of the measurements.
    #[derive(PartialOrd, Ord, Serialize, Deserialize, ValueEnum)]
    #[serde(rename_all = "kebab-case")]
    pub(crate) enum Kind {
        /// A dict of a few numbers and words.
        Small => "small dict",
        /// 8820 float32 samples at 44.1 kHz.
        Audio => "audio, 8820 samples",
        /// A dict with a uint8 array of 200 x 200 x 3.
        U8Rgb200 => "dict with u8 200x200x3",
        /// A 640 x 480 colour picture as a JPEG file.
        VgaJpeg => "640x480 JPEG",
        /// A dict with 1 MiB of float32.
        F32Mib => "dict with 1 MiB float32",
        /// 640 x 480 RGB.
        VgaRgb => "640x480 RGB",
        /// A file of 1 MiB that goes as it is: no coding.
        FileMib => "file of 1 MiB",
        /// 1920 x 1080 RGB.
        FullHdRgb => "1920x1080 RGB",
    }
    /// Title of the payload, for people.
    pub fn title;
}

impl Kind {
    /// Type that a route for the payload is configured with.
    pub(crate) fn message_type(self) -> MessageType {
        match self {
            Self::Small | Self::U8Rgb200 | Self::F32Mib => MessageType::NativeObject,
            Self::Audio => MessageType::AudioChunk,
            Self::VgaJpeg | Self::FileMib => MessageType::CompressedImage,
            Self::VgaRgb | Self::FullHdRgb => MessageType::Image,
        }
    }

    /// Messages that queues hold: more than are under way at once.
    pub(crate) fn depth(self) -> u32 {
        if self == Self::Small { 100 } else { 10 }
    }

    fn is_stamped(self) -> bool {
        self.message_type() != MessageType::NativeObject
    }
}

/// Name of an option's value on the command line, in tables and in files.
pub(crate) fn name(value: &impl ValueEnum) -> String {
    value.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
}

/// Bytes that look like a picture to a compressor: a gradient with some noise on it.
fn texture(width: usize, height: usize) -> Vec<u8> {
    let mut noise = 0x2545_F491_4F6C_DD1D_u64;
    let mut bytes = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..3 {
                noise ^= noise << 13;
                noise ^= noise >> 7;
                noise ^= noise << 17;
                let value = (x * (channel + 1) / 5 + y / 3) as u64 + noise % 40;
                bytes.push((value % 256) as u8);
            }
        }
    }
    bytes
}

/// Makes the messages of one kind.
pub(crate) struct Maker {
    kind: Kind,
    /// Everything but the number.
    prototype: Payload,
}

impl Maker {
    /// Builds what all messages share.
    pub(crate) fn new(kind: Kind) -> Result<Self> {
        let stamp = Stamp::default();
        let picture = |width: u32, height: u32| {
            let bytes = texture(width as usize, height as usize);
            RawPixels::dense(width, height, Encoding::Bgr8, bytes)
        };
        let array = |dtype, shape: &[usize], bytes: Vec<u8>| -> Result<Payload> {
            let tensor = Tensor::new(dtype, shape, bytes)?;
            Ok(Value::from(Map::from([("seq", Value::from(0)), ("data", Value::from(tensor))]))
                .into())
        };
        let file = |data: Bytes| -> Payload {
            Image::new(stamp, Pixels::Compressed { format: CompressedFormat::Jpeg, data }).into()
        };
        let floats =
            |count: u32| (0..count).flat_map(|n| (n as f32 / 1e4).sin().to_le_bytes()).collect();
        let prototype = match kind {
            Kind::Small => Value::from(Map::from([
                ("seq", Value::from(0)),
                ("name", "left_arm".into()),
                ("speed", Value::Float(0.25)),
                ("joints", Value::from_iter([0.1_f32.into(), -1.5, 3.0].map(Value::Float))),
            ]))
            .into(),
            Kind::U8Rgb200 => array(Dtype::U8, &[200, 200, 3], texture(200, 200))?,
            Kind::F32Mib => array(Dtype::F32, &[512, 512], floats(512 * 512))?,
            Kind::Audio => {
                AudioChunk::new(stamp, 8820, 1, 44_100, SampleFormat::F32Le, floats(8820))?.into()
            }
            Kind::VgaRgb => Image::new(stamp, picture(640, 480)?).into(),
            Kind::FullHdRgb => Image::new(stamp, picture(1920, 1080)?).into(),
            Kind::VgaJpeg => file(jpeg::encode(&picture(640, 480)?, jpeg::WRAPYFI_QUALITY)?),
            // The first bytes tell that it is a file.
            Kind::FileMib => file([&[0xFF, 0xD8, 0xFF][..], &vec![7; 1 << 20]].concat().into()),
        };
        Ok(Self { kind, prototype })
    }

    /// Message number `seq`; shares the bulk of its bytes with the others.
    pub(crate) fn payload(&self, seq: u32) -> Payload {
        let mut payload = self.prototype.clone();
        number_payload(&mut payload, seq);
        payload
    }

    /// Message number `seq` as a program has it before any coding: pixels where a file is sent.
    pub(crate) fn uncoded(&self, seq: u32) -> Result<Payload> {
        decompress(self.payload(seq))
    }

    /// The frames of message 0 on ZeroMQ.
    pub(crate) fn frames(&self, topic: &str) -> Result<Numbered> {
        let mut pieces = frames::encode(&self.payload(0), &self.spec(topic))?;
        let body = pieces.pop().context("a message without a body")?;
        Ok(Numbered { kind: self.kind, number_at: self.number_at(&body)?, body })
    }

    /// Message 0 in CDR.
    pub(crate) fn cdr(&self) -> Result<Numbered> {
        let parts =
            ros::encode(&self.payload(0), self.kind.message_type(), &wrapyfi_plugins::standard())?;
        let body: Vec<u8> =
            parts.pieces().iter().flat_map(|piece| piece.as_ref().to_vec()).collect();
        let number_at = if self.kind.is_stamped() { 4 } else { self.number_at(&body)? };
        Ok(Numbered { kind: self.kind, number_at, body })
    }

    /// Topic settings under which the product codes this kind.
    pub(crate) fn spec(&self, topic: &str) -> TopicSpec {
        TopicSpec::new(topic, self.kind.message_type())
    }

    /// Offset of the ten digits in JSON.
    fn number_at(&self, body: &[u8]) -> Result<usize> {
        if self.kind.is_stamped() {
            return Ok(0);
        }
        let found = memmem::find(body, BASE.to_string().as_bytes());
        found.context("no number in the text of a native object")
    }
}

/// Makes a payload message number `seq`.
pub(crate) fn number_payload(payload: &mut Payload, seq: u32) {
    let number = BASE + seq;
    let stamp = Stamp { sec: number.cast_signed(), nanosec: 0 };
    match payload {
        Payload::Image(image) => image.stamp = stamp,
        Payload::AudioChunk(sound) => sound.stamp = stamp,
        Payload::NativeObject(value) => {
            if let Value::Map(map) = &mut value.value {
                map.insert("seq", number);
            }
        }
        _ => {}
    }
}

/// A message that was encoded once.
#[derive(Debug, Clone)]
pub(crate) struct Numbered {
    kind: Kind,
    number_at: usize,
    /// Body frame, or CDR.
    pub(crate) body: Vec<u8>,
}

impl Numbered {
    /// Numbers the CDR.
    pub(crate) fn number_cdr(&mut self, seq: u32) {
        let number = BASE + seq;
        if self.kind.is_stamped() {
            self.write(&number.to_le_bytes());
        } else {
            self.write(number.to_string().as_bytes());
        }
    }

    /// Header frame where the kind has one, and body with the number in one of them.
    pub(crate) fn number_frames(&self, seq: u32) -> (Option<Vec<u8>>, Vec<u8>) {
        let number = BASE + seq;
        if self.kind.is_stamped() {
            return (Some(Self::header(seq)), self.body.clone());
        }
        let mut copy = self.clone();
        copy.write(number.to_string().as_bytes());
        (None, copy.body)
    }

    /// Header frame of message `seq`.
    fn header(seq: u32) -> Vec<u8> {
        format!("{{timestamp:{}.0}}", BASE + seq).into_bytes()
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(place) = self.body.get_mut(self.number_at..self.number_at + bytes.len()) {
            place.copy_from_slice(bytes);
        }
    }
}

/// Number of a message in CDR.
pub(crate) fn number_in_cdr(kind: Kind, cdr: &[u8]) -> Result<u32> {
    if !kind.is_stamped() {
        return number_in_text(cdr);
    }
    let bytes = cdr.get(4..8).context("a message shorter than its stamp")?;
    above_base(u32::from_le_bytes(bytes.try_into()?))
}

/// Number of a message in frames.
pub(crate) fn number_in_frames(kind: Kind, frames: &[impl AsRef<[u8]>]) -> Result<u32> {
    let frame = frames.get(1).context("a message without frame 1")?.as_ref();
    if !kind.is_stamped() {
        return number_in_text(frame);
    }
    let text = str::from_utf8(frame)?.trim_start_matches("{timestamp:");
    above_base(text.split(['.', '}']).next().unwrap_or_default().parse()?)
}

/// Number of a decoded message.
pub(crate) fn number_in_payload(payload: &Payload) -> Result<u32> {
    above_base(match payload {
        Payload::Image(image) => image.stamp.sec.cast_unsigned(),
        Payload::AudioChunk(sound) => sound.stamp.sec.cast_unsigned(),
        Payload::NativeObject(value) => {
            let seq = value.get("seq").and_then(Value::as_i64).context("an object without seq")?;
            u32::try_from(seq)?
        }
        _ => bail!("a payload of an unknown kind"),
    })
}

/// Finds `"seq": ` near the start: large arrays come after it.
fn number_in_text(bytes: &[u8]) -> Result<u32> {
    let start = bytes.get(..bytes.len().min(256)).unwrap_or(bytes);
    let key = b"\"seq\": ";
    let at = memmem::find(start, key).context("no seq in the text")? + key.len();
    let digits = bytes.get(at..at + 10).context("the text ends in its number")?;
    above_base(str::from_utf8(digits)?.parse()?)
}

fn above_base(number: u32) -> Result<u32> {
    number.checked_sub(BASE).with_context(|| format!("{number} is no number of a message"))
}

/// Decodes frames as the product does.
pub(crate) fn decode_frames(frames: &[Bytes], spec: &TopicSpec) -> Result<Payload> {
    Ok(wrapyfi_zeromq::codec::decode(frames, spec, Stamp::default())?)
}

/// Turns the pixels of a camera into the file that is sent; other payloads stay as they are.
pub(crate) fn compress(payload: Payload) -> Result<Payload> {
    convert(payload, MessageType::CompressedImage)
}

/// Turns a file that was received into pixels; other payloads stay as they are.
pub(crate) fn decompress(payload: Payload) -> Result<Payload> {
    convert(payload, MessageType::Image)
}

fn convert(payload: Payload, to: MessageType) -> Result<Payload> {
    Ok(match payload {
        Payload::Image(image) => {
            codec::convert(image, to, Encoding::Bgr8, &Limits::default())?.into()
        }
        other => other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_carries_its_number() {
        for &kind in Kind::value_variants() {
            let maker = Maker::new(kind).unwrap();
            assert_eq!(number_in_payload(&maker.payload(7)).unwrap(), 7, "{kind:?}");
            let mut cdr = maker.cdr().unwrap();
            cdr.number_cdr(123_456);
            assert_eq!(number_in_cdr(kind, &cdr.body).unwrap(), 123_456, "{kind:?}");
            let (header, body) = maker.frames("/t").unwrap().number_frames(99);
            let frames: Vec<Bytes> = [Some(b"/t".to_vec()), header, Some(body)]
                .into_iter()
                .flatten()
                .map(Bytes::from)
                .collect();
            assert_eq!(number_in_frames(kind, &frames).unwrap(), 99, "{kind:?}");
            let decoded = decode_frames(&frames, &maker.spec("/t")).unwrap();
            assert_eq!(decoded, maker.payload(99), "{kind:?}");
        }
    }

    #[test]
    fn a_program_has_pixels_on_both_ends_of_a_jpeg_route() {
        let maker = Maker::new(Kind::VgaJpeg).unwrap();
        let before = maker.uncoded(5).unwrap();
        let sent = compress(before.clone()).unwrap();
        let after = decompress(sent.clone()).unwrap();
        let is_raw = |payload: &Payload| {
            let Payload::Image(image) = payload else { panic!("no picture") };
            matches!(image.pixels, Pixels::Raw(_))
        };
        assert_eq!([&before, &sent, &after].map(is_raw), [true, false, true]);
        assert!([before, sent, after].iter().all(|p| number_in_payload(p).unwrap() == 5));
    }

    #[test]
    fn the_picture_is_as_long_as_wrapyfis() {
        let body = Maker::new(Kind::VgaRgb).unwrap().frames("/t").unwrap().body.len();
        assert!((1_228_900..1_229_100).contains(&body), "{body}");
    }
}
