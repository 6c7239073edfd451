//! Images: YARP's `ImageOf` of any pixel, and its `FlexImage`.
//!
//! ```text
//!   header │ row, row, … each padded to the quantum      data: a slice of the message, no copy
//!     60   │ r g b r g b … ░░                            row(y): the pixels without ░
//!
//!   Wrapyfi announces padded rows and sends packed ones:  r g b r g b …│r g b …│ ░░░░ (its memory)
//! ```

use bytes::Bytes;

use super::error::{SigError, contradictory, unwritable};
use super::image_header::{IMAGE_HEADER_BYTES, ImageHeader, WHAT};
use super::pixel::PixelCode;
use crate::WireLimits;

/// Layout of the rows of an image behind its header.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Rows {
    /// Rows as the header says: YARP's own images.
    #[default]
    Announced,
    /// Without padding, whatever the header says; what is left of the announced bytes comes last
    /// and means nothing. Wrapyfi's publishers and listeners do so where a row is not a multiple of
    /// 8 bytes.
    Packed,
}

/// An image. Its pixels are those of the message it was read from, not a copy.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    header: ImageHeader,
    data: Bytes,
}

impl Image {
    /// An image of rows that lie one behind the other without padding, as nearly every library has
    /// them. It is written with quantum 1, as YARP writes images over foreign memory.
    ///
    /// # Errors
    /// When `data` is not `width` x `height` pixels.
    pub fn from_packed(
        pixel: PixelCode,
        width: usize,
        height: usize,
        data: Bytes,
    ) -> Result<Self, SigError> {
        Self::from_parts(ImageHeader::new(pixel, width, height, 1)?, data)
    }

    /// An image of a header and the rows that it announces.
    ///
    /// # Errors
    /// When `data` is not as long as `header` says.
    pub fn from_parts(header: ImageHeader, data: Bytes) -> Result<Self, SigError> {
        if data.len() != header.image_bytes() || header.stride < header.row_bytes() {
            let size = (header.width, header.height);
            return Err(contradictory(size, header.pixel_bytes, data.len()));
        }
        Ok(Self { header, data })
    }

    /// Reads an image of whatever pixels, as `FlexImage` does, of a sender whose rows lie as `rows`
    /// says. The rows share `bytes`; what follows them is left alone.
    ///
    /// # Errors
    /// When the bytes are no image, or exceed `limits`.
    pub fn decode(bytes: &Bytes, rows: Rows, limits: &WireLimits) -> Result<Self, SigError> {
        let mut header = ImageHeader::read(bytes, limits)?;
        let needed = IMAGE_HEADER_BYTES + header.image_bytes();
        let given = bytes.len();
        if given < needed {
            return Err(SigError::Truncated { what: WHAT, needed, given });
        }
        if rows == Rows::Packed {
            header.stride = header.row_bytes();
            header.quantum = header.quantum.min(1);
        }
        let end = IMAGE_HEADER_BYTES + header.image_bytes();
        Ok(Self { header, data: bytes.slice(IMAGE_HEADER_BYTES..end) })
    }

    /// Header and rows in one piece, for a receiver that expects rows as `rows` says. For
    /// [`Rows::Packed`], the header announces rows padded to YARP's 8 bytes, the pixels follow
    /// packed, and zeros fill up. To send without this copy, send the bytes of
    /// [`ImageHeader::write`] and [`Image::data`] one after the other.
    ///
    /// # Errors
    /// When a size exceeds 31 bits.
    pub fn encode(&self, rows: Rows) -> Result<Vec<u8>, SigError> {
        if rows == Rows::Announced {
            return Ok([&self.header.write()?[..], &self.data].concat());
        }
        let announced = self.header.padded(super::DEFAULT_QUANTUM)?;
        let length = IMAGE_HEADER_BYTES + announced.image_bytes();
        let mut out = Vec::with_capacity(length);
        out.extend_from_slice(&announced.write()?);
        self.rows().for_each(|row| out.extend_from_slice(row));
        out.resize(length, 0);
        Ok(out)
    }

    /// Header of the image: format and layout of the pixels.
    pub const fn header(&self) -> &ImageHeader {
        &self.header
    }

    /// All rows with what pads them, [`ImageHeader::stride`] bytes each.
    pub const fn data(&self) -> &Bytes {
        &self.data
    }

    /// The pixels of row `y`, counted from the top, without padding.
    pub fn row(&self, y: usize) -> Option<&[u8]> {
        let start = y.checked_mul(self.header.stride)?;
        let row = self.data.get(start..start.checked_add(self.header.row_bytes())?)?;
        (y < self.header.height).then_some(row)
    }

    /// The pixels of every row from the top, without padding.
    pub fn rows(&self) -> impl Iterator<Item = &[u8]> {
        let rows = if self.header.is_empty() { 0 } else { self.header.height };
        (0..rows).filter_map(|y| self.row(y))
    }
}

impl ImageHeader {
    /// The same image with rows at multiples of `quantum` bytes.
    fn padded(&self, quantum: u16) -> Result<Self, SigError> {
        let stride = self.row_bytes().checked_next_multiple_of(usize::from(quantum.max(1)));
        let stride = stride.filter(|stride| stride.checked_mul(self.height).is_some());
        let stride = stride.ok_or_else(|| unwritable(WHAT, "width", self.width))?;
        Ok(Self { quantum, stride, ..*self })
    }
}
