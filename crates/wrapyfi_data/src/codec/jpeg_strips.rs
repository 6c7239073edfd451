//! Pictures compressed to JPEG on several cores.
//!
//! ```text
//!   picture ─┬─ rows 0 to 15  ── core 1 ─┐
//!            ├─ rows 16 to 31 ── core 2 ─┼─▶ header │ coded rows │ RST0 │ coded rows │ RST1 │ … │ EOI
//!            └─ …                        ┘
//! ```
//!
//! Every strip is compressed as a picture of its own. Behind a restart marker a decoder knows nothing of what was
//! before it, as at the beginning of a picture, so that the coded bytes of the strips with markers between them
//! are one baseline file: with the pixels of a picture that was compressed as one, and as large within 0.03 %
//! (640x480 at quality 95). The file can be decompressed on several cores too.

use bytes::Bytes;
use turbojpeg::{Compressor, Error, Image, Subsamp};

use super::cores::{Kept, cores, share};
use super::jpeg_restart::{FEWEST_BLOCKS, Layout, MOST_KEPT};

/// Fewest blocks of 8 x 8 samples of a strip: to begin one takes as long as 40 of these.
const STRIP_BLOCKS: usize = 200;

/// Fewest strips that a picture is cut into.
const FEWEST_STRIPS: usize = 4;

/// Number of rows of each strip but the last, and of coded units in it.
#[derive(Clone, Copy)]
struct Cut {
    rows: usize,
    units: u16,
}

impl Cut {
    /// Cuts a picture; nothing where it is too small for more than one thread.
    fn of(width: usize, height: usize, subsampling: Subsamp) -> Option<Self> {
        let (extent, blocks) = if subsampling == Subsamp::Gray { (8, 1) } else { (16, 6) };
        let (across, down) = (width.div_ceil(extent), height.div_ceil(extent));
        let high = STRIP_BLOCKS.div_ceil(across * blocks);
        let is_worth_it =
            across * down * blocks >= FEWEST_BLOCKS && down.div_ceil(high) >= FEWEST_STRIPS;
        let units = u16::try_from(across * high).ok()?;
        is_worth_it.then_some(Self { rows: high * extent, units })
    }
}

/// A compressor of one picture, or of strips of it.
struct Encoder {
    compressor: Compressor,
    /// Room for the worst case, of which only what is written is ever touched.
    file: Vec<u8>,
}

static KEPT: Kept<Encoder> = Kept::new();

/// Compresses a picture or a strip of one.
fn compress_one(image: Image<&[u8]>, subsampling: Subsamp, quality: u8) -> Result<Bytes, Error> {
    let new = || Ok::<_, Error>(Encoder { compressor: Compressor::new()?, file: Vec::new() });
    let mut encoder = KEPT.take().map_or_else(new, Ok)?;
    let Encoder { compressor, file } = &mut encoder;
    compressor.set_quality(i32::from(quality));
    compressor.set_subsamp(subsampling);
    let room = compressor.buf_len(image.width, image.height)?;
    if file.len() < room {
        *file = vec![0; room];
    }
    let length = compressor.compress_to_slice(image, file)?;
    let written = Bytes::copy_from_slice(file.get(..length).unwrap_or_default());
    if room <= MOST_KEPT {
        KEPT.give(encoder);
    }
    Ok(written)
}

/// Compresses a picture.
pub(super) fn compress(
    picture: &Image<Bytes>,
    subsampling: Subsamp,
    quality: u8,
) -> Result<Bytes, Error> {
    Cut::of(picture.width, picture.height, subsampling)
        .filter(|_| cores() > 1)
        .and_then(|cut| in_strips(cores(), picture, subsampling, quality, cut))
        .map_or_else(|| compress_one(picture.as_deref(), subsampling, quality), Ok)
}

/// A file of strips; nothing where libjpeg's strips make no file.
fn in_strips(
    cores: usize,
    picture: &Image<Bytes>,
    subsampling: Subsamp,
    quality: u8,
    cut: Cut,
) -> Option<Bytes> {
    let &Image { width, pitch, height, format, .. } = picture;
    let (size, pixels) = (cut.rows * pitch, picture.pixels.clone());
    let strips = share(cores, height.div_ceil(cut.rows), move |number| {
        let begin = number * size;
        let pixels = pixels.get(begin..pixels.len().min(begin + size))?;
        let height = pixels.len() / pitch;
        compress_one(Image { pixels, width, pitch, height, format }, subsampling, quality).ok()
    });
    let strips: Vec<Bytes> = strips.into_iter().collect::<Option<_>>()?;
    join(&strips, height, cut.units).map(Bytes::from)
}

/// Joins files of strips to the file of the picture; nothing where their headers differ in more than the height.
fn join(strips: &[Bytes], height: usize, units: u16) -> Option<Vec<u8>> {
    let first = strips.first()?;
    let Layout { height_at, scan_at, data_at, .. } = Layout::read(first)?;
    let (height_place, height_end) = (height_at..height_at + 2, height_at + 2);
    let mut file = Vec::with_capacity(strips.iter().map(Bytes::len).sum());
    file.extend_from_slice(first.get(..scan_at)?);
    file.get_mut(height_place)?.copy_from_slice(&u16::try_from(height).ok()?.to_be_bytes());
    let [high, low] = units.to_be_bytes();
    file.extend_from_slice(&[0xFF, 0xDD, 0, 4, high, low]);
    file.extend_from_slice(first.get(scan_at..data_at)?);
    for (strip, marker) in strips.iter().zip((0xD0..=0xD7).cycle()) {
        let is_alike = strip.get(..height_at) == first.get(..height_at)
            && strip.get(height_end..data_at) == first.get(height_end..data_at);
        let coded = strip.get(data_at..)?.strip_suffix(&[0xFF, 0xD9]).filter(|_| is_alike)?;
        file.extend_from_slice(coded);
        file.extend_from_slice(&[0xFF, marker]);
    }
    // The end of the picture stands where another strip would begin.
    *file.last_mut()? = 0xD9;
    Some(file)
}

#[cfg(test)]
pub(super) mod tests {
    use turbojpeg::{Decompressor, PixelFormat};

    use super::*;

    /// A picture with much detail.
    pub(in super::super) fn noise(
        width: usize,
        height: usize,
        format: PixelFormat,
    ) -> Image<Bytes> {
        let (pitch, mut state) = (width * format.size() + 3, 0x2545_F491_4F6C_DD1D_u64);
        let mut byte = |at: usize| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (at / 7 + at / pitch + (state % 40) as usize) as u8
        };
        let pixels: Bytes = (0..pitch * height).map(&mut byte).collect();
        Image { pixels, width, pitch, height, format }
    }

    /// A file with a restart marker behind each `rows` rows.
    pub(in super::super) fn in_rows(
        picture: &Image<Bytes>,
        subsampling: Subsamp,
        quality: u8,
        rows: usize,
    ) -> Bytes {
        let (columns, high) = (subsampling.width(), subsampling.height());
        let units = picture.width.div_ceil(8 * columns) * (rows / (8 * high));
        let cut = Cut { rows, units: units as u16 };
        in_strips(2, picture, subsampling, quality, cut).unwrap()
    }

    fn pixels(file: &[u8], picture: &Image<Bytes>) -> Vec<u8> {
        let Image { width, height, format, .. } = *picture;
        let pitch = width * format.size();
        let mut pixels = vec![0; pitch * height];
        let image = Image { pixels: pixels.as_mut_slice(), width, pitch, height, format };
        Decompressor::new().unwrap().decompress(file, image).unwrap();
        pixels
    }

    #[test]
    fn strips_are_the_picture_that_one_strip_is() {
        for (format, subsampling) in [
            (PixelFormat::GRAY, Subsamp::Gray),
            (PixelFormat::BGR, Subsamp::Sub2x2),
            (PixelFormat::RGBX, Subsamp::Sub2x2),
        ] {
            for (width, height) in [(640, 480), (417, 331), (2000, 65)] {
                let picture = noise(width, height, format);
                for quality in [30, 95, 100] {
                    let one = compress_one(picture.as_deref(), subsampling, quality).unwrap();
                    let cut = Cut::of(width, height, subsampling).unwrap();
                    let many = in_strips(3, &picture, subsampling, quality, cut).unwrap();
                    assert!(one != many && many.len() < one.len() * 11 / 10);
                    let what = format!("{format:?} {width}x{height}, quality {quality}");
                    assert!(pixels(&one, &picture) == pixels(&many, &picture), "{what}");
                }
            }
        }
    }

    #[test]
    fn small_pictures_are_not_cut() {
        let rows = |width, height, of| Cut::of(width, height, of).map(|cut| cut.rows);
        assert_eq!(rows(640, 480, Subsamp::Sub2x2), Some(16));
        assert_eq!(rows(320, 240, Subsamp::Sub2x2), Some(32));
        assert_eq!(rows(640, 480, Subsamp::Gray), Some(24));
        assert_eq!(rows(160, 120, Subsamp::Sub2x2), None);
        assert_eq!(rows(65_500, 16, Subsamp::Sub2x2), None);
    }

    #[test]
    fn strips_with_other_tables_make_no_file() {
        let picture = noise(64, 64, PixelFormat::BGR);
        let of = |quality| compress_one(picture.as_deref(), Subsamp::Sub2x2, quality).unwrap();
        assert!(join(&[of(90), of(90)], 128, 16).is_some());
        assert!(join(&[of(90), of(80)], 128, 16).is_none());
    }
}
