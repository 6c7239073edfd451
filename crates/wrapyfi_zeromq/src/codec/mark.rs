//! The mark of our clients: one frame in the envelope of a request.
//!
//! ```text
//!   request  │ mark │ "" │ JSON │          reply of Python  │ mark as it was │ "" │ Wrapyfi's form │
//!                                          reply of ours    │ mark: CDR      │ "" │ CDR            │
//!                                                           │ mark: error    │ "" │ text           │
//!
//!   57 52 43 02 │ kind │ content │ 00 00 │ timeout, ms, 4 │ number, 8 │ machine, 4 │ end, ms, 8 │
//! ```
//!
//! All numbers are little-endian, with the size given.
//!
//! ZeroMQ's envelope is every frame before the empty one. A REP socket, as Python's servers have,
//! hands it back unread: so a reply with the mark as it was is Wrapyfi's own, and one with another
//! kind was written by a program that knows this page. Either names its call by the number.

use bytes::Bytes;
use wrapyfi_data::codec::{DecodeError, DecodeResult, EncodeError, EncodeResult, ros};
use wrapyfi_data::types::{DataType, MessageType, Payload};
use wrapyfi_endpoint::ServiceSpec;
use wrapyfi_endpoint::codec::requests::without_messages;

/// First bytes of a mark: `WRC`, version 2.
const MAGIC: [u8; 4] = *b"WRC\x02";
/// Size of a mark in bytes.
pub const SIZE: usize = 32;

/// Kind of a message with a mark.
///
/// See [`Mark`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A request; on a reply: Wrapyfi's own form, from a server that handed the mark back.
    Request = 0,
    /// A reply whose body is CDR.
    Binary = 1,
    /// A reply whose body is UTF-8 text with the reason that there is none.
    Error = 2,
}

impl Kind {
    const ALL: [Self; 3] = [Self::Request, Self::Binary, Self::Error];
}

/// Message of the data model that a call returns.
///
/// See [`Mark`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Content {
    NativeObject = 1,
    Image = 2,
    CompressedImage = 3,
    AudioChunk = 4,
}

impl Content {
    const ALL: [Self; 4] =
        [Self::NativeObject, Self::Image, Self::CompressedImage, Self::AudioChunk];

    /// Message that holds a payload of this type.
    pub fn of(message_type: MessageType) -> Self {
        match message_type {
            MessageType::CompressedImage => Self::CompressedImage,
            other => match other.data_type() {
                DataType::Image => Self::Image,
                DataType::AudioChunk => Self::AudioChunk,
                _ => Self::NativeObject,
            },
        }
    }

    /// Type of the CDR.
    pub fn message_type(self) -> MessageType {
        match self {
            Self::NativeObject => MessageType::NativeObject,
            Self::Image => MessageType::Image,
            Self::CompressedImage => MessageType::CompressedImage,
            Self::AudioChunk => MessageType::AudioChunk,
        }
    }
}

/// The mark of a call.
///
/// ```
/// use wrapyfi_zeromq::codec::mark::{Content, Kind, Mark, SIZE};
/// let (kind, content) = (Kind::Request, Content::Image);
/// let mark = Mark { kind, content, timeout_ms: 5000, number: 7, machine: 0, ends_ms: 0 };
/// let frame = mark.encode();
/// assert_eq!((frame.len(), Mark::decode(&frame)), (SIZE, Some(mark)));
/// assert_eq!(Mark::decode(b"a frame of another program"), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    /// Kind of this message.
    pub kind: Kind,
    /// Message that the caller expects, or that the reply holds.
    pub content: Content,
    /// Time for which the caller waits from now on, in milliseconds.
    pub timeout_ms: u32,
    /// Number that the caller gave the call.
    pub number: u64,
    /// Number of the caller's machine: on the same one clocks agree. 0 where it is not known.
    pub machine: u32,
    /// Time at which the caller gives up, in milliseconds of Unix time by the clock of its machine.
    pub ends_ms: u64,
}

impl Mark {
    /// False where the caller waits for ever, or longer than the mark can say.
    pub fn has_limit(&self) -> bool {
        self.timeout_ms < u32::MAX
    }

    /// Frame of the mark.
    pub fn encode(&self) -> Vec<u8> {
        let mut frame = MAGIC.to_vec();
        frame.extend([self.kind as u8, self.content as u8, 0, 0]);
        frame.extend(self.timeout_ms.to_le_bytes());
        frame.extend(self.number.to_le_bytes());
        frame.extend(self.machine.to_le_bytes());
        frame.extend(self.ends_ms.to_le_bytes());
        frame
    }

    /// Reads the mark in a frame of an envelope; `None` where it is no mark of ours, or of an
    /// unknown version. Such a caller is answered as Python's are.
    #[must_use]
    pub fn decode(frame: &[u8]) -> Option<Self> {
        let frame: &[u8; SIZE] = frame.try_into().ok()?;
        let (head, numbers) = frame.split_first_chunk::<8>()?;
        let [m0, m1, m2, m3, kind, content, 0, 0] = *head else { return None };
        if [m0, m1, m2, m3] != MAGIC {
            return None;
        }
        let (timeout_ms, numbers) = numbers.split_first_chunk()?;
        let (number, numbers) = numbers.split_first_chunk()?;
        let (machine, numbers) = numbers.split_first_chunk()?;
        let (ends_ms, _) = numbers.split_first_chunk()?;
        let kind = Kind::ALL.into_iter().find(|&known| known as u8 == kind)?;
        let content = Content::ALL.into_iter().find(|&known| known as u8 == content)?;
        Some(Self {
            kind,
            content,
            timeout_ms: u32::from_le_bytes(*timeout_ms),
            number: u64::from_le_bytes(*number),
            machine: u32::from_le_bytes(*machine),
            ends_ms: u64::from_le_bytes(*ends_ms),
        })
    }
}

/// Writes a reply as our clients read it: a message of the data model as CDR, and its kind.
///
/// # Errors
/// When `payload` is not of the service's kind, has no form there, or exceeds the message size.
pub fn encode(payload: &Payload, spec: &ServiceSpec) -> EncodeResult<(Content, Bytes)> {
    let content = Content::of(spec.kind.message_type());
    let payload = &*without_messages(payload)?;
    let (expected, actual) = (spec.kind.data_type(), payload.data_type());
    if actual != expected {
        return Err(EncodeError::mismatch(expected.to_string(), actual.to_string()));
    }
    let body = ros::encode(payload, content.message_type(), &spec.plugins)?;
    EncodeError::check_size(body.len(), spec.limits.message_bytes)?;
    Ok((content, body.to_bytes()))
}

/// Reads what [`encode`] wrote.
///
/// # Errors
/// When the reply is of another kind than the service's, malformed, or exceeds a limit.
pub fn decode(content: Content, body: &Bytes, spec: &ServiceSpec) -> DecodeResult<Payload> {
    let message_type = content.message_type();
    let (expected, actual) = (spec.kind.data_type(), message_type.data_type());
    if actual != expected {
        return Err(DecodeError::mismatch(expected.to_string(), actual.to_string()));
    }
    ros::decode(body, message_type, &spec.limits, &spec.plugins)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use wrapyfi_data::types::{
        AudioChunk, Encoding, Image, RawPixels, SampleFormat, ServiceKind, Stamp, Tensor, Value,
    };

    use super::*;

    const NOW: Stamp = Stamp { sec: 7, nanosec: 5 };

    fn picture(width: u32, height: u32, encoding: Encoding, data: Vec<u8>) -> Payload {
        Image::new(NOW, RawPixels::dense(width, height, encoding, data).unwrap()).into()
    }

    #[test]
    fn between_ours_nothing_is_lost() {
        let color = picture(2, 1, Encoding::Rgb8, vec![1, 2, 3, 4, 5, 6]);
        let whole =
            AudioChunk::new(NOW, 1, 2, 8000, SampleFormat::S16Le, vec![1, 2, 3, 4]).unwrap();
        let array = Tensor::from_elements(&[2], vec![1.5_f64, 2.5]).unwrap();
        for (kind, payload) in [
            (ServiceKind::Image, color),
            (ServiceKind::AudioChunk, whole.into()),
            (ServiceKind::NativeObject, Value::from(array).into()),
        ] {
            let spec = ServiceSpec::new("/x", kind);
            let (content, body) = encode(&payload, &spec).unwrap();
            assert_eq!(decode(content, &body, &spec), Ok(payload.clone()));
            for other in [ServiceKind::Image, ServiceKind::AudioChunk, ServiceKind::NativeObject] {
                if other == kind {
                    continue;
                }
                let other = ServiceSpec::new("/x", other);
                let read = decode(content, &body, &other);
                assert!(matches!(read, Err(DecodeError::Mismatch { .. })), "{read:?}");
                let refused = encode(&payload, &other);
                assert!(matches!(refused, Err(EncodeError::Mismatch { .. })), "{refused:?}");
            }
        }
    }

    #[test]
    fn pictures_go_in_the_form_of_the_service_and_sizes_are_checked() {
        let grey = picture(8, 8, Encoding::Mono8, vec![100; 64]);
        let lists = ServiceSpec::new("/x", ServiceKind::Image);
        let file = ServiceSpec::new("/x", ServiceKind::CompressedImage);
        let (content, body) = encode(&grey, &lists).unwrap();
        let refused = encode(&grey, &file);
        assert!(matches!(refused, Err(EncodeError::Mismatch { .. })), "{refused:?}");
        assert_eq!(decode(content, &body, &file), Ok(grey.clone()));
        let mut narrow = lists;
        narrow.limits.message_bytes = 60;
        let error = encode(&grey, &narrow);
        assert!(matches!(error, Err(EncodeError::TooLarge { limit: 60, .. })), "{error:?}");
    }

    #[test]
    fn its_bytes() {
        let mark = Mark {
            kind: Kind::Binary,
            content: Content::AudioChunk,
            timeout_ms: 5000,
            number: 0x0102,
            machine: 3,
            ends_ms: 0x0405,
        };
        let bytes = b"WRC\x02\x01\x04\0\0\x88\x13\0\0\x02\x01\0\0\0\0\0\0\
                      \x03\0\0\0\x05\x04\0\0\0\0\0\0";
        assert_eq!(mark.encode(), bytes);
        assert_eq!(Mark::decode(bytes), Some(mark));
        for at in [0, 3, 4, 5, 6, 7] {
            let mut other = *bytes;
            other[at] = 9;
            assert_eq!(Mark::decode(&other), None, "byte {at}");
        }
        assert_eq!(Mark::decode(&bytes[..SIZE - 1]), None);
        // The routing id of a ROUTER: a zero and four bytes.
        assert_eq!(Mark::decode(&[0, 1, 2, 3, 4]), None);
    }

    proptest! {
        #[test]
        fn read_as_written(frame: [u8; SIZE]) {
            if let Some(mark) = Mark::decode(&frame) {
                prop_assert_eq!(mark.encode(), frame);
            }
        }

        #[test]
        fn every_mark_is_read(
            number: u64,
            timeout_ms: u32,
            machine: u32,
            ends_ms: u64,
            choice in 0..12_usize,
        ) {
            let kind = [Kind::Request, Kind::Binary, Kind::Error][choice % 3];
            let content = Content::ALL[choice / 3];
            let mark = Mark { kind, content, timeout_ms, number, machine, ends_ms };
            prop_assert_eq!(Mark::decode(&mark.encode()), Some(mark));
        }
    }
}
