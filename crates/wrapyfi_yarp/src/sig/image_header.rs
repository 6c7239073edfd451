//! The 60 bytes before the pixels of an image.
//!
//! ```text
//!    0  256, 4          list of 4
//!    8  9, 'mat'        vocab
//!   16  9, 'rgb'        vocab: pixel code
//!   24  257, 5          list of 5 int32:
//!   32    bytes a pixel, bytes of all rows, quantum (16 bits) and flag (16 bits), width, height
//!   52  12, bytes       blob: the rows
//! ```

use super::error::{SigError, check, contradictory, size, unwritable, written};
use super::fields::{ints, put};
use super::pixel::PixelCode;
use crate::WireLimits;
use crate::bottle::Vocab;

/// Bytes of the header.
pub const IMAGE_HEADER_BYTES: usize = 60;
/// Object, in errors.
pub(super) const WHAT: &str = "an image";
/// The rows of YARP's own images begin at multiples of so many bytes.
pub const DEFAULT_QUANTUM: u16 = 8;

/// Header before the pixels of an image: the same bytes in both dialects.
///
/// For those who read a stream: read 60 bytes, then [`ImageHeader::image_bytes`] further ones
/// straight to where the pixels shall be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageHeader {
    /// Format of the pixels.
    pub pixel: PixelCode,
    /// Bytes of a pixel.
    pub pixel_bytes: usize,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Rows begin at multiples of so many bytes; 0 in empty images.
    pub quantum: u16,
    /// Bytes from one row to the next.
    pub stride: usize,
}

impl ImageHeader {
    /// The header of an image whose rows begin at multiples of `quantum` bytes.
    ///
    /// # Errors
    /// When the size of such pixels is not known, or the image is larger than memory can be.
    pub fn new(
        pixel: PixelCode,
        width: usize,
        height: usize,
        quantum: u16,
    ) -> Result<Self, SigError> {
        let pixel_bytes = pixel.bytes().ok_or_else(|| {
            let what = format!("the size of pixels {pixel} is not known");
            SigError::Unsupported(format!("{what}: use ImageHeader with their size"))
        })?;
        let too_wide = || unwritable(WHAT, "width", width);
        let row = width.checked_mul(pixel_bytes).ok_or_else(too_wide)?;
        let stride =
            row.checked_next_multiple_of(usize::from(quantum.max(1))).ok_or_else(too_wide)?;
        stride.checked_mul(height).ok_or_else(|| unwritable(WHAT, "height", height))?;
        Ok(Self { pixel, pixel_bytes, width, height, quantum, stride })
    }

    /// Reads the header at the start of `bytes`.
    ///
    /// # Errors
    /// When these are not 60 bytes of such a header, its sizes contradict each other, or the image
    /// exceeds `limits`.
    pub fn read(bytes: &[u8], limits: &WireLimits) -> Result<Self, SigError> {
        let truncated =
            SigError::Truncated { what: WHAT, needed: IMAGE_HEADER_BYTES, given: bytes.len() };
        let Some(words) = ints::<15>(bytes, 0) else { return Err(truncated) };
        let [list, four, vocab, mat, code_tag, code, ints_tag, five, rest @ ..] = words;
        let [pixel_bytes, image_bytes, quantum, width, height, blob, blob_bytes] = rest;
        let fixed = [
            ("list", 0, list, 256),
            ("length of the list", 4, four, 4),
            ("vocab", 8, vocab, 9),
            ("word mat", 12, mat, Vocab::new("mat").0),
            ("vocab", 16, code_tag, 9),
            ("list of int32", 24, ints_tag, 257),
            ("length of that list", 28, five, 5),
            ("blob", 52, blob, 12),
        ];
        check(WHAT, fixed)?;
        let size = |part, value| size(WHAT, part, value);
        let pixel = PixelCode::of(Vocab(code));
        let pixel_bytes = size("pixel size", pixel_bytes)?;
        let image_bytes = size("size", image_bytes)?;
        let blob_bytes = size("size", blob_bytes)?;
        let (width, height) = (size("width", width)?, size("height", height)?);
        if let Some(wanted) = pixel.bytes().filter(|&wanted| wanted != pixel_bytes) {
            let what = format!("pixels {pixel} of {pixel_bytes} bytes, YARP's have {wanted}");
            return Err(SigError::Damaged(what));
        }
        if image_bytes != blob_bytes {
            let what = format!("an image of {image_bytes} bytes in a blob of {blob_bytes}");
            return Err(SigError::Damaged(what));
        }
        // The upper half is a flag whose meaning changed with every other version.
        let quantum = (quantum & 0xffff) as u16;
        let mut header = Self { pixel, pixel_bytes, width, height, quantum, stride: 0 };
        header.stride = header
            .find_stride(image_bytes)
            .ok_or_else(|| contradictory((width, height), pixel_bytes, image_bytes))?;
        let (length, limit) = (IMAGE_HEADER_BYTES + header.image_bytes(), limits.max_message_bytes);
        if length > limit {
            return Err(SigError::TooLong { what: WHAT, length, limit });
        }
        Ok(header)
    }

    /// Bytes from row to row: what the size says, which has to leave room for the pixels.
    fn find_stride(&self, image_bytes: usize) -> Option<usize> {
        if self.is_empty() {
            return Some(0);
        }
        let row = self.width.checked_mul(self.pixel_bytes)?;
        let stride = image_bytes / self.height;
        (row > 0 && stride >= row && stride * self.height == image_bytes).then_some(stride)
    }

    /// The 60 bytes.
    ///
    /// # Errors
    /// When a size exceeds 31 bits.
    pub fn write(&self) -> Result<[u8; IMAGE_HEADER_BYTES], SigError> {
        let size = |part, value| written(WHAT, part, value);
        let image_bytes = size("size", self.image_bytes())?;
        let mut out = Vec::with_capacity(IMAGE_HEADER_BYTES);
        put(&mut out, &[256, 4, 9, Vocab::new("mat").0, 9, self.pixel.vocab().0, 257, 5]);
        // The flag beside the quantum is 0: right for every version, YARP 4 included.
        put(&mut out, &[size("pixel size", self.pixel_bytes)?, image_bytes]);
        put(&mut out, &[i32::from(self.quantum), size("width", self.width)?]);
        put(&mut out, &[size("height", self.height)?, 12, image_bytes]);
        let mut header = [0; IMAGE_HEADER_BYTES];
        header.copy_from_slice(&out);
        Ok(header)
    }

    /// Bytes of all rows, as they follow the header.
    pub const fn image_bytes(&self) -> usize {
        // Checked where headers are made.
        self.stride.saturating_mul(self.height)
    }

    /// Bytes of the pixels of one row, without what pads it.
    pub const fn row_bytes(&self) -> usize {
        self.width.saturating_mul(self.pixel_bytes)
    }

    /// True when the image has no pixels.
    pub const fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }
}
