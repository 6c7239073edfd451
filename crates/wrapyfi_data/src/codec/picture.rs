//! Pictures inside native objects, and the arrays that hold them.
//!
//! ```text
//!   Tensor uint8 (H, W), (H, W, 3), (H, W, 4) … ─▶ Image, in the channel order of the topic ─▶ Tensor
//!   Picture (Pillow) ─────────────────────────────▶ Image, as it is; CMYK as rgb8
//! ```

use super::{DecodeError, DecodeResult, EncodeError, jpeg};
use crate::Limits;
use crate::types::{Dtype, Encoding, Image, MessageType, Pixels, RawPixels, Stamp, Tensor, Value};

/// Mode of a picture of four inks a pixel: no encoding has them, the mode says what the channels are.
pub const INKS: &str = "CMYK";

impl Image {
    /// The picture in a native object: a Pillow image, or an array as OpenCV and Wrapyfi have them,
    /// of whatever library.
    ///
    /// | array | encoding |
    /// | --- | --- |
    /// | `uint8` (H, W) or (H, W, 1) | `mono8` |
    /// | `uint8` (H, W, 3), (H, W, 4) | `bgr8`, `bgra8`, or `rgb8`, `rgba8`, as `color_order` says |
    /// | `uint16`, `int32`, `float32` (H, W) | `mono16`, `32SC1`, `32FC1` |
    /// | `float32` (H, W, 3) | `32FC3` |
    ///
    /// ```
    /// # mod wrapyfi_core { pub use wrapyfi_data::types; }
    /// use wrapyfi_core::types::{Encoding, Image, Pixels, Stamp, Tensor, Value};
    /// let frame = Value::from(Tensor::from_elements(&[2, 3, 3], vec![0_u8; 18])?);
    /// let image = Image::from_value(&frame, Encoding::Bgr8, Stamp::now())?;
    /// let Pixels::Raw(raw) = &image.pixels else { panic!("pixels") };
    /// assert_eq!((raw.width, raw.height, raw.encoding), (3, 2, Encoding::Bgr8));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// A mismatch when `value` is anything else; the error says what it is.
    pub fn from_value(value: &Value, color_order: Encoding, stamp: Stamp) -> DecodeResult<Self> {
        match value {
            Value::Tensor(tensor) => {
                raw_pixels(tensor, color_order).map(|raw| Self::new(stamp, raw))
            }
            Value::Picture(picture) => match &picture.image.pixels {
                #[cfg(feature = "pictures")]
                Pixels::Raw(raw) if picture.mode.as_deref() == Some(INKS) => {
                    Ok(Self::new(stamp, super::image_file::inks_to_rgb(raw)))
                }
                _ => Ok(Self { stamp, ..picture.image.clone() }),
            },
            other => Err(DecodeError::mismatch(
                "an image: an array or a Pillow image",
                match other {
                    Value::Tagged(tagged) => match &tagged.refused {
                        Some(reason) => format!("an object that was not read: {reason}"),
                        None => format!("an object of the unknown plug-in {:?}", tagged.key),
                    },
                    other => other.kind().to_owned(),
                },
            )),
        }
    }

    /// The picture as an array in the channel order `color_order`, decompressed where it is a file:
    /// what a Wrapyfi script without Pillow can use. For Pillow make a
    /// [`Picture`](crate::types::Picture) of the image. Time stamp and coordinate frame have no place
    /// in either.
    ///
    /// # Errors
    /// When its file is broken, or its pixels would exceed `message_bytes`.
    pub fn to_value(&self, color_order: Encoding, limits: &Limits) -> Result<Value, EncodeError> {
        match jpeg::convert(self.clone(), MessageType::Image, color_order, limits)?.pixels {
            Pixels::Raw(raw) => array(raw, color_order).map(Value::Tensor),
            Pixels::Compressed { format, .. } => {
                Err(EncodeError::mismatch("pixels", format!("a {format} image")))
            }
        }
    }
}

/// The picture in an array of shape (height, width) or (height, width, channels).
fn raw_pixels(tensor: &Tensor, color_order: Encoding) -> DecodeResult<RawPixels> {
    let mismatch = || {
        DecodeError::mismatch(
            "uint8 of shape (H, W), (H, W, 3) or (H, W, 4), float32 of shape (H, W) or \
                   (H, W, 3), or uint16 or int32 of shape (H, W)",
            format!("{} of shape {:?}", tensor.dtype, tensor.shape),
        )
    };
    let (height, width, channels) = match *tensor.shape {
        [height, width] => (height, width, 1),
        [height, width, channels] => (height, width, channels),
        _ => return Err(mismatch()),
    };
    let encoding = encoding(tensor.dtype, channels, color_order).ok_or_else(mismatch)?;
    let (Ok(width), Ok(height)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(mismatch());
    };
    RawPixels::dense(width, height, encoding, tensor.data.clone())
        .map_err(|error| DecodeError::malformed("image", error.to_string()))
}

/// Encoding of the pixels in an array of this element type and number of channels; `None` where there is none.
pub fn encoding(dtype: Dtype, channels: usize, color_order: Encoding) -> Option<Encoding> {
    let red_first = color_order.color_order() == Some(Encoding::Rgb8);
    Some(match (dtype, channels) {
        (Dtype::U8, 1) => Encoding::Mono8,
        (Dtype::U8, 3) if red_first => Encoding::Rgb8,
        (Dtype::U8, 3) => Encoding::Bgr8,
        (Dtype::U8, 4) if red_first => Encoding::Rgba8,
        (Dtype::U8, 4) => Encoding::Bgra8,
        (Dtype::U16, 1) => Encoding::Mono16,
        (Dtype::I32, 1) => Encoding::I32C1,
        (Dtype::F32, 1) => Encoding::F32C1,
        (Dtype::F32, 3) => Encoding::F32C3,
        _ => return None,
    })
}

/// The array for a picture, in the channel order `color_order`.
pub fn array(raw: RawPixels, color_order: Encoding) -> Result<Tensor, EncodeError> {
    let dense = raw.to_dense();
    drop(raw);
    let dense = dense.in_color_order(color_order);
    let (dtype, shape) = layout(&dense);
    let what = format!("{} image of {}x{}", dense.encoding, dense.width, dense.height);
    Tensor::new(dtype, shape, dense.data).map_err(|error| {
        EncodeError::unrepresentable("array", what, format!("its bytes do not fit: {error}"))
    })
}

/// Element type and shape of the array for a picture.
pub(super) fn layout(pixels: &RawPixels) -> (Dtype, Vec<usize>) {
    let dtype = match pixels.encoding {
        Encoding::I32C1 => Dtype::I32,
        Encoding::F32C1 | Encoding::F32C3 => Dtype::F32,
        encoding if encoding.bytes_per_pixel() == 2 => Dtype::U16,
        _ => Dtype::U8,
    };
    let mut shape = vec![pixels.height as usize, pixels.width as usize];
    if pixels.encoding.channels() > 1 {
        shape.push(pixels.encoding.channels());
    }
    (dtype, shape)
}
