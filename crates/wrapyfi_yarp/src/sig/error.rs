//! Faults of images, sounds, vectors and matrices.

use super::pixel::PixelCode;
use crate::Dialect;

/// Fault of the bytes of an object, or of an object that is to be written. `what` is `an image`, `a sound`, and
/// so on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SigError {
    /// The bytes end too early.
    #[error("{what} of {needed} bytes, {given} were given: the message was cut short")]
    Truncated {
        /// Object.
        what: &'static str,
        /// Bytes that there should be.
        needed: usize,
        /// Bytes that there are.
        given: usize,
    },
    /// The bytes are something else.
    #[error("byte {at} holds {found}, {what} has {wanted} there ({part})")]
    Other {
        /// Object.
        what: &'static str,
        /// What stands there, or why another number may.
        part: &'static str,
        /// Place of the first difference.
        at: usize,
        /// Number that stands there.
        found: i32,
        /// Number that the object has there.
        wanted: i32,
    },
    /// The bytes are of another version.
    #[error(
        "a list of {found} elements is {meaning}; this connection reads {dialect}, where a sound has {wanted}"
    )]
    OtherVersion {
        /// Elements of the list.
        found: i32,
        /// What has so many.
        meaning: &'static str,
        /// Dialect of the connection.
        dialect: Dialect,
        /// Elements that a sound has in it.
        wanted: i32,
    },
    /// A size is negative.
    #[error("{what} whose {part} is {value}: the message is damaged")]
    Negative {
        /// Object.
        what: &'static str,
        /// Size.
        part: &'static str,
        /// Value of the size.
        value: i32,
    },
    /// The object is larger than allowed.
    #[error("{what} of {length} bytes, the limit is {limit}: raise Limits::max_message_bytes")]
    TooLong {
        /// Object.
        what: &'static str,
        /// Bytes of the object.
        length: usize,
        /// Limit.
        limit: usize,
    },
    /// A size does not fit in the message.
    #[error("{what} whose {part} is {value} cannot be written: YARP's sizes end at {max}", max = i32::MAX)]
    Unwritable {
        /// Object.
        what: &'static str,
        /// Size.
        part: &'static str,
        /// Value of the size.
        value: usize,
    },
    /// Pixels have another size than their code says.
    #[error("pixels {pixel} of {given} bytes, YARP's have {wanted}: the message is damaged")]
    PixelBytes {
        /// Code of the pixels.
        pixel: PixelCode,
        /// Bytes that the header says.
        given: usize,
        /// Bytes that the code says.
        wanted: usize,
    },
    /// Width, height and pixel size contradict the number of bytes.
    #[error(
        "{width} x {height} pixels of {pixel_bytes} bytes do not fit {image_bytes} bytes of rows: \
         the message is damaged"
    )]
    Sizes {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes of a pixel.
        pixel_bytes: usize,
        /// Bytes of all rows.
        image_bytes: usize,
    },
    /// The blob of the rows has another size.
    #[error("an image of {image_bytes} bytes in a blob of {blob_bytes}: the message is damaged")]
    Blob {
        /// Bytes of all rows.
        image_bytes: usize,
        /// Bytes of the blob.
        blob_bytes: usize,
    },
    /// Nobody says how large a pixel is.
    #[error("the size of pixels {pixel} is not known: use ImageHeader with their size")]
    UnknownPixel {
        /// Code of the pixels.
        pixel: PixelCode,
    },
    /// Samples of another width.
    #[error("a sound of {bytes} bytes a sample: YARP transmits 2 only")]
    SampleBytes {
        /// Bytes of a sample.
        bytes: i32,
    },
    /// Samples do not fill the channels.
    #[error("{count} samples for {channels} channels of {samples}: the message is damaged")]
    Count {
        /// Number of samples.
        count: usize,
        /// Samples of one channel.
        samples: usize,
        /// Number of channels.
        channels: usize,
    },
    /// A bottle without the elements of a sound.
    #[error("the bottle is no sound: it has to be samples, channels, 2, frequency (numbers)")]
    Bottle,
    /// Numbers do not fill a matrix.
    #[error("{count} numbers for {rows} rows of {columns}: a matrix has as many as fit exactly")]
    Shape {
        /// Rows.
        rows: usize,
        /// Columns.
        columns: usize,
        /// Number of numbers.
        count: usize,
    },
    /// The dialect has no such vectors.
    #[error("dialect v3 has no vectors of float32: send float64, or set dialect v4")]
    NoFloat32,
}

impl SigError {
    /// True for bytes that are something else, and not a damaged object.
    #[must_use]
    pub const fn is_mismatch(&self) -> bool {
        matches!(self, Self::Other { .. } | Self::OtherVersion { .. } | Self::Bottle)
    }
}

/// A size that was read.
pub(super) fn size(what: &'static str, part: &'static str, value: i32) -> Result<usize, SigError> {
    usize::try_from(value).ok().ok_or(SigError::Negative { what, part, value })
}

/// A size as it is written.
pub(super) fn written(
    what: &'static str,
    part: &'static str,
    value: usize,
) -> Result<i32, SigError> {
    i32::try_from(value).ok().ok_or(SigError::Unwritable { what, part, value })
}

/// Checks numbers that every object of the kind has: what stands there, its place, the number, and the right one.
pub(super) fn check(
    what: &'static str,
    fixed: impl IntoIterator<Item = (&'static str, usize, i32, i32)>,
) -> Result<(), SigError> {
    match fixed.into_iter().find(|(_, _, found, wanted)| found != wanted) {
        Some((part, at, found, wanted)) => Err(SigError::Other { what, part, at, found, wanted }),
        None => Ok(()),
    }
}
