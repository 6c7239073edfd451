//! Camera frames.
//!
//! ```text
//!   Image { stamp, frame_id, pixels } ── Raw { header, rows of bytes } checked to fit each other
//!                                    └── Compressed { jpeg | png, the file }
//! ```

use bytes::{Bytes, BytesMut};
use wrapyfi_interfaces::named;

use super::Stamp;
use super::shape::ShapeError;

/// One frame: `sensor_msgs/msg/Image` or `CompressedImage` in ROS 2, an `(H, W, 3)` or `(H, W)`
/// array or a JPEG file in Wrapyfi.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Encoding, Image, RawPixels, Stamp};
/// let grey = RawPixels::dense(2, 1, Encoding::Mono8, vec![0_u8, 255])?;
/// let image = Image { frame_id: "camera".into(), ..Image::new(Stamp::now(), grey.clone()) };
/// assert_eq!(image.pixels, grey.into());
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Time at which the frame was taken; reception time where the sender does not say.
    pub stamp: Stamp,
    /// Coordinate frame; empty from Wrapyfi.
    pub frame_id: String,
    /// Picture of the frame.
    pub pixels: Pixels,
}

impl Image {
    /// Makes a frame without a coordinate frame.
    pub fn new(stamp: Stamp, pixels: impl Into<Pixels>) -> Self {
        Self { stamp, frame_id: String::new(), pixels: pixels.into() }
    }
}

/// The picture of an [`Image`], which stays compressed until a consumer needs pixels.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Encoding, Image, Pixels, RawPixels, Stamp};
/// let grey = RawPixels::dense(2, 1, Encoding::Mono8, vec![0_u8, 255])?;
/// let image = Image::new(Stamp::now(), grey);
/// let text = match &image.pixels {
///     Pixels::Raw(raw) => format!("{} of {}x{}", raw.encoding, raw.width, raw.height),
///     Pixels::Compressed { format, data } => format!("{format} of {} bytes", data.len()),
/// };
/// assert_eq!(text, "mono8 of 2x1");
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pixels {
    /// Uncompressed rows.
    Raw(RawPixels),
    /// A complete image file.
    Compressed {
        /// `jpeg` or `png`, as `sensor_msgs/msg/CompressedImage.format` begins.
        format: CompressedFormat,
        /// Bytes of the file.
        data: Bytes,
    },
}

impl From<RawPixels> for Pixels {
    fn from(raw: RawPixels) -> Self {
        Self::Raw(raw)
    }
}

named! {
    /// Format of a compressed [`Image`].
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::CompressedFormat;
    /// assert_eq!(CompressedFormat::sniff(b"\x89PNG\r\n\x1a\n"), Some(CompressedFormat::Png));
    /// assert_eq!(CompressedFormat::sniff(b"P6 2 1 255"), None);
    /// ```
    #[non_exhaustive]
    #[allow(missing_docs)]
    pub enum CompressedFormat {
        Jpeg => "jpeg",
        Png => "png",
    }
    /// `jpeg` or `png`.
    pub fn name;
}

impl CompressedFormat {
    /// Format of a file by its first bytes.
    pub fn sniff(file: &[u8]) -> Option<Self> {
        if file.starts_with(&[0xFF, 0xD8, 0xFF]) {
            Some(Self::Jpeg)
        } else if file.starts_with(b"\x89PNG\r\n\x1a\n") {
            Some(Self::Png)
        } else {
            None
        }
    }
}

/// Uncompressed rows of pixels.
///
/// `data.len()` is always `height * step` when made by [`RawPixels::new`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{Encoding, RawPixels};
/// // Two rows of one grey pixel, each padded to four bytes.
/// let rows = vec![7_u8, 0, 0, 0, 8, 0, 0, 0];
/// let padded = RawPixels::new(1, 2, Encoding::Mono8, 4, rows)?;
/// assert_eq!(padded.rows().collect::<Vec<_>>(), [[7], [8]]);
/// assert_eq!(*padded.to_dense().data, [7, 8]);
/// # Ok::<(), wrapyfi_data::types::ShapeError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawPixels {
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Order and type of the channels.
    pub encoding: Encoding,
    /// Number of bytes from one row to the next, at least `width * encoding.bytes_per_pixel()`.
    pub step: u32,
    /// `height * step` bytes, little-endian.
    pub data: Bytes,
}

impl RawPixels {
    /// Makes a picture of rows of `step` bytes.
    ///
    /// # Errors
    /// When a row does not fit `step`, or `data` is not `height * step` bytes.
    pub fn new(
        width: u32,
        height: u32,
        encoding: Encoding,
        step: u32,
        data: impl Into<Bytes>,
    ) -> Result<Self, ShapeError> {
        let data = data.into();
        let what = || format!("{encoding} image of {width}x{height}");
        let overflow = || ShapeError::Overflow(what());
        let row = row_bytes(width, encoding).ok_or_else(overflow)?;
        let step_bytes = step as usize;
        if step_bytes < row {
            return Err(ShapeError::Step { what: what(), step: step_bytes, row });
        }
        let expected = step_bytes.checked_mul(height as usize).ok_or_else(overflow)?;
        if expected != data.len() {
            return Err(ShapeError::Length { what: what(), expected, actual: data.len() });
        }
        Ok(Self { width, height, encoding, step, data })
    }

    /// Makes a picture of rows without padding.
    ///
    /// # Errors
    /// When `data` is not exactly `height * width` pixels.
    pub fn dense(
        width: u32,
        height: u32,
        encoding: Encoding,
        data: impl Into<Bytes>,
    ) -> Result<Self, ShapeError> {
        let step = row_bytes(width, encoding).and_then(|row| u32::try_from(row).ok());
        let step = step
            .ok_or_else(|| ShapeError::Overflow(format!("{encoding} image of {width}x{height}")))?;
        Self::new(width, height, encoding, step, data)
    }

    /// Size of one row's pixels in bytes, without padding.
    pub fn row_bytes(&self) -> usize {
        row_bytes(self.width, self.encoding).unwrap_or_default()
    }

    /// Bytes of each row's pixels, without padding.
    pub fn rows(&self) -> impl Iterator<Item = &[u8]> {
        let row = self.row_bytes();
        let step = (self.step as usize).max(1);
        self.data.chunks(step).map(move |padded| padded.get(..row).unwrap_or(padded))
    }

    /// Removes the padding between rows; shares the bytes when there is none.
    #[must_use]
    pub fn to_dense(&self) -> Self {
        let row = self.row_bytes();
        if self.step as usize == row {
            return self.clone();
        }
        let mut data = Vec::with_capacity(row.saturating_mul(self.height as usize));
        self.rows().for_each(|row| data.extend_from_slice(row));
        // A row is no longer than the step, which is a u32.
        Self { step: u32::try_from(row).unwrap_or(self.step), data: data.into(), ..self.clone() }
    }

    /// Exchanges red and blue where the picture has the other order than `order`. A picture without a channel order
    /// stays as it is.
    #[must_use]
    pub fn in_color_order(self, order: Encoding) -> Self {
        let orders = self.encoding.color_order().zip(order.color_order());
        if orders.is_some_and(|(has, wanted)| has != wanted) { self.swap_red_blue() } else { self }
    }

    /// Exchanges red and blue: [`Encoding::swapped`]. A picture without a channel order stays as it
    /// is.
    #[must_use]
    pub fn swap_red_blue(self) -> Self {
        let encoding = self.encoding.swapped();
        if encoding == self.encoding {
            return self;
        }
        // In place when no other owner holds the bytes.
        let mut data = self.data.try_into_mut().unwrap_or_else(|shared| BytesMut::from(&*shared));
        let row = row_bytes(self.width, encoding).unwrap_or_default();
        let step = (self.step as usize).max(1);
        for padded in data.chunks_mut(step) {
            let (pixels, _padding) = padded.split_at_mut(row.min(padded.len()));
            match encoding.bytes_per_pixel() {
                3 => pixels
                    .as_chunks_mut::<3>()
                    .0
                    .iter_mut()
                    .for_each(|[r, _, b]| std::mem::swap(r, b)),
                _ => pixels
                    .as_chunks_mut::<4>()
                    .0
                    .iter_mut()
                    .for_each(|[r, _, b, _]| std::mem::swap(r, b)),
            }
        }
        Self { encoding, data: data.freeze(), ..self }
    }
}

fn row_bytes(width: u32, encoding: Encoding) -> Option<usize> {
    (width as usize).checked_mul(encoding.bytes_per_pixel())
}

named! {
    /// Pixel encodings, by their names in `sensor_msgs/image_encodings.hpp`.
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::Encoding;
    /// assert_eq!(Encoding::from_name("8UC3"), Some(Encoding::Bgr8));
    /// assert_eq!((Encoding::Bgr8.channels(), Encoding::Bgr8.swapped()), (3, Encoding::Rgb8));
    /// ```
    #[non_exhaustive]
    #[allow(missing_docs)]
    pub enum Encoding {
        Mono8 => "mono8",
        Mono16 => "mono16",
        Rgb8 => "rgb8",
        Bgr8 => "bgr8",
        Rgba8 => "rgba8",
        Bgra8 => "bgra8",
        I32C1 => "32SC1",
        F32C1 => "32FC1",
        F32C3 => "32FC3",
        BayerRggb8 => "bayer_rggb8",
        BayerBggr8 => "bayer_bggr8",
        BayerGbrg8 => "bayer_gbrg8",
        BayerGrbg8 => "bayer_grbg8",
        BayerRggb16 => "bayer_rggb16",
        BayerBggr16 => "bayer_bggr16",
        BayerGbrg16 => "bayer_gbrg16",
        BayerGrbg16 => "bayer_grbg16",
    }
    /// Name in `sensor_msgs/msg/Image.encoding`.
    pub fn name;
}

impl Encoding {
    /// Encoding with this name. Names of equal layout that cameras also send are accepted: `8UC1`
    /// is `mono8`, `16UC1` is `mono16`, `8UC3` is `bgr8`, `8UC4` is `bgra8`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "8UC1" => Some(Self::Mono8),
            "16UC1" => Some(Self::Mono16),
            "8UC3" => Some(Self::Bgr8),
            "8UC4" => Some(Self::Bgra8),
            _ => Self::ALL.into_iter().find(|encoding| encoding.name() == name),
        }
    }

    /// Order of the colour channels, `rgb8` or `bgr8`; `None` for one channel, as a mosaic has, and for
    /// floats, which name no order.
    #[must_use]
    pub fn color_order(self) -> Option<Self> {
        match self {
            Self::Rgb8 | Self::Rgba8 => Some(Self::Rgb8),
            Self::Bgr8 | Self::Bgra8 => Some(Self::Bgr8),
            _ => None,
        }
    }

    /// Number of channels of a pixel.
    pub fn channels(self) -> usize {
        match self {
            Self::Rgb8 | Self::Bgr8 | Self::F32C3 => 3,
            Self::Rgba8 | Self::Bgra8 => 4,
            _ => 1,
        }
    }

    /// Size of a pixel in bytes.
    pub fn bytes_per_pixel(self) -> usize {
        self.channels()
            * match self {
                Self::Mono8 | Self::Rgb8 | Self::Bgr8 | Self::Rgba8 | Self::Bgra8 => 1,
                Self::BayerRggb8 | Self::BayerBggr8 | Self::BayerGbrg8 | Self::BayerGrbg8 => 1,
                Self::BayerRggb16 | Self::BayerBggr16 | Self::BayerGbrg16 | Self::BayerGrbg16 => 2,
                Self::Mono16 => 2,
                Self::I32C1 | Self::F32C1 | Self::F32C3 => 4,
            }
    }

    /// Encoding with red and blue exchanged; the same encoding where the order has no name.
    #[must_use]
    pub fn swapped(self) -> Self {
        match self {
            Self::Rgb8 => Self::Bgr8,
            Self::Bgr8 => Self::Rgb8,
            Self::Rgba8 => Self::Bgra8,
            Self::Bgra8 => Self::Rgba8,
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_must_fit_the_header() {
        let make = |width, height, step, len| {
            RawPixels::new(width, height, Encoding::Rgb8, step, vec![0; len])
        };
        assert!(make(2, 2, 6, 12).is_ok());
        assert!(make(2, 2, 8, 16).is_ok());
        let short = make(2, 2, 6, 11).unwrap_err().to_string();
        assert_eq!(short, "rgb8 image of 2x2 needs 12 bytes, 11 are there");
        assert!(matches!(make(2, 2, 5, 10), Err(ShapeError::Step { step: 5, row: 6, .. })));
        assert!(make(u32::MAX, u32::MAX, u32::MAX, 0).is_err());
        assert!(RawPixels::dense(u32::MAX, 1, Encoding::F32C3, vec![]).is_err());
    }

    #[test]
    fn red_and_blue_change_places_inside_the_rows_only() {
        let padded = RawPixels::new(2, 2, Encoding::Rgb8, 8, (0..16).collect::<Vec<u8>>()).unwrap();
        let swapped = padded.clone().swap_red_blue();
        assert_eq!(swapped.encoding, Encoding::Bgr8);
        assert_eq!(*swapped.data, [2, 1, 0, 5, 4, 3, 6, 7, 10, 9, 8, 13, 12, 11, 14, 15]);
        assert_eq!(*swapped.to_dense().data, [2, 1, 0, 5, 4, 3, 10, 9, 8, 13, 12, 11]);
        assert_eq!(swapped.swap_red_blue(), padded);
        let rgba = RawPixels::dense(1, 1, Encoding::Bgra8, vec![1, 2, 3, 4]).unwrap();
        assert_eq!(*rgba.swap_red_blue().data, [3, 2, 1, 4]);
    }

    #[test]
    fn names_are_found_again() {
        for encoding in Encoding::ALL {
            assert_eq!(Encoding::from_name(encoding.name()), Some(encoding));
            assert_eq!(encoding.swapped().swapped(), encoding);
        }
    }
}
