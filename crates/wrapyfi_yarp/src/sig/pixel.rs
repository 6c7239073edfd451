//! Formats of the pixels of an image.

use std::fmt;

use crate::bottle::Vocab;

macro_rules! pixel_codes {
    ($($(#[doc = $doc:literal])+ $name:ident = $code:literal, $bytes:literal;)+) => {
        /// Code of a pixel type, as it stands in the header of an image.
        #[derive(Clone, Copy, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum PixelCode {
            $($(#[doc = $doc])+ $name,)+
            /// A code that is not known here. The header says how many bytes a pixel takes.
            Other(Vocab),
        }

        impl PixelCode {
            /// Every code that is known.
            pub const ALL: &'static [Self] = &[$(Self::$name),+];

            /// The code as a vocab.
            pub fn vocab(self) -> Vocab {
                match self {
                    $(Self::$name => Vocab::new($code),)+
                    Self::Other(vocab) => vocab,
                }
            }

            /// Bytes of one pixel; none for codes that are not known. YARP's own code for other sizes
            /// is the size, negative.
            pub fn bytes(self) -> Option<usize> {
                match self {
                    $(Self::$name => Some($bytes),)+
                    Self::Other(Vocab(size)) if size < 0 => {
                        usize::try_from(size.unsigned_abs()).ok()
                    }
                    Self::Other(_) => None,
                }
            }
        }
    };
}

pixel_codes! {
    /// Grey, 8 bits.
    Mono = "mono", 1;
    /// Grey, 16 bits.
    Mono16 = "mo16", 2;
    /// Grey, 8 bits, signed.
    MonoSigned = "sign", 1;
    /// One whole number of 32 bits.
    Int = "int", 4;
    /// Grey in single precision: YARP's `PixelFloat`.
    Float = "dec", 4;
    /// Red, green, blue, 8 bits each.
    Rgb = "rgb", 3;
    /// Blue, green, red, 8 bits each.
    Bgr = "bgr", 3;
    /// Red, green, blue, opacity, 8 bits each.
    Rgba = "rgba", 4;
    /// Blue, green, red, opacity, 8 bits each.
    Bgra = "bgra", 4;
    /// Hue, saturation, value, 8 bits each.
    Hsv = "hsv", 3;
    /// Red, green, blue, signed 8 bits each.
    RgbSigned = "rgb-", 3;
    /// Red, green, blue, 32 bits each.
    RgbInt = "rgbi", 12;
    /// Red, green, blue in single precision.
    RgbFloat = "rgb.", 12;
    /// Hue, saturation, value in single precision.
    HsvFloat = "hsv.", 12;
    /// Bayer mosaic that begins green, red; 8 bits.
    BayerGrbg8 = "grbg", 1;
    /// Bayer mosaic that begins green, red; 16 bits.
    BayerGrbg16 = "gr16", 2;
    /// Bayer mosaic that begins blue, green; 8 bits.
    BayerBggr8 = "bggr", 1;
    /// Bayer mosaic that begins blue, green; 16 bits.
    BayerBggr16 = "bg16", 2;
    /// Bayer mosaic that begins green, blue; 8 bits.
    BayerGbrg8 = "gbrg", 1;
    /// Bayer mosaic that begins green, blue; 16 bits.
    BayerGbrg16 = "gb16", 2;
    /// Bayer mosaic that begins red, green; 8 bits.
    BayerRggb8 = "rggb", 1;
    /// Bayer mosaic that begins red, green; 16 bits.
    BayerRggb16 = "rg16", 2;
    /// YUV 4:2:0; YARP counts one byte a pixel.
    Yuv420 = "yuva", 1;
    /// YUV 4:4:4; YARP counts one byte a pixel.
    Yuv444 = "yuvb", 1;
    /// YUV 4:2:2; YARP counts one byte a pixel.
    Yuv422 = "yuvc", 1;
    /// YUV 4:1:1; YARP counts one byte a pixel.
    Yuv411 = "yuvd", 1;
}

impl PixelCode {
    /// Pixel format that a vocab means.
    pub fn of(vocab: Vocab) -> Self {
        let known = Self::ALL.iter().find(|code| code.vocab() == vocab);
        known.copied().unwrap_or(Self::Other(vocab))
    }
}

impl fmt::Debug for PixelCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.vocab(), f)
    }
}

impl fmt::Display for PixelCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}
