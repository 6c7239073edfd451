//! Pictures of the sensor examples: files, pixels, and a sketch of letters for a terminal.
//!
//! ```text
//!   folder of *.png ─ sorted by name ─▶ bgr8, as OpenCV has it ─▶ Image
//!   Image ─▶ pixels ─┬─▶ 00001.png, 00002.png, …
//!                    └─▶ a sketch
//! ```

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use wrapyfi_core::Limits;
use wrapyfi_core::codec::image_file;
use wrapyfi_core::types::{Encoding, Image, Pixels, RawPixels, Stamp};

/// The PNG files in a folder, by name.
///
/// # Errors
/// When the folder cannot be read or has none.
pub fn png_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let name = folder.display();
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| format!("cannot read folder {name}"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("png")) {
            files.push(path);
        }
    }
    ensure!(
        !files.is_empty(),
        "{name} has no .png file: put a sequence there, 000.png, 001.png, …"
    );
    files.sort();
    Ok(files)
}

/// The picture in a file, in colour and in OpenCV's order, as `cv2.imread` reads it.
///
/// # Errors
/// When the file cannot be read, is too large, or is no picture.
pub fn read(path: &Path) -> anyhow::Result<RawPixels> {
    let name = path.display();
    let limits = Limits::default();
    let limit = limits.message_bytes as u64;
    let file = File::open(path).with_context(|| format!("cannot open {name}"))?;
    let mut content = Vec::new();
    file.take(limit + 1)
        .read_to_end(&mut content)
        .with_context(|| format!("cannot read {name}"))?;
    ensure!(content.len() as u64 <= limit, "{name} is larger than {limit} bytes, the limit");
    let pixels = image_file::decode(&content.into(), &limits, Some(Encoding::Bgr8))
        .with_context(|| format!("{name} is no picture"))?;
    in_colour(&pixels).with_context(|| name.to_string())
}

/// The pixels of an image, decompressed where it is a file.
///
/// # Errors
/// When the file in it is broken or of another format.
pub fn pixels(image: &Image) -> anyhow::Result<RawPixels> {
    match &image.pixels {
        Pixels::Raw(raw) => in_colour(raw),
        Pixels::Compressed { data, .. } => {
            in_colour(&image_file::decode(data, &Limits::default(), Some(Encoding::Bgr8))?)
        }
    }
}

/// Grey as three equal channels, red first as blue first, without alpha.
fn in_colour(pixels: &RawPixels) -> anyhow::Result<RawPixels> {
    let dense = pixels.to_dense();
    let data: Vec<u8> = match dense.encoding {
        Encoding::Bgr8 => return Ok(dense),
        Encoding::Rgb8 => return Ok(dense.swap_red_blue()),
        Encoding::Mono8 => dense.data.iter().flat_map(|&grey| [grey; 3]).collect(),
        Encoding::Rgba8 | Encoding::Bgra8 => {
            let blue_first =
                if dense.encoding == Encoding::Bgra8 { dense } else { dense.swap_red_blue() };
            let (pixels, _) = blue_first.data.as_chunks::<4>();
            let data: Vec<u8> = pixels.iter().flat_map(|&[b, g, r, _]| [b, g, r]).collect();
            return bgr(blue_first.width, blue_first.height, data);
        }
        other => anyhow::bail!("pixels of type {other} have no colours of 8 bits"),
    };
    bgr(dense.width, dense.height, data)
}

/// Pixels in OpenCV's order.
///
/// # Errors
/// When `data` is not `width * height` pixels.
pub fn bgr(width: u32, height: u32, data: Vec<u8>) -> anyhow::Result<RawPixels> {
    Ok(RawPixels::dense(width, height, Encoding::Bgr8, data)?)
}

/// These pixels, taken now.
#[must_use]
pub fn taken_now(pixels: RawPixels) -> Image {
    Image::new(Stamp::now(), pixels)
}

/// Writes pixels as a PNG file: whole, or not at all, because others may watch the folder.
///
/// # Errors
/// When they are empty or the file cannot be written.
pub fn save(pixels: &RawPixels, path: &Path) -> anyhow::Result<()> {
    let file = image_file::encode(pixels, None)?;
    let part = path.with_extension("part");
    std::fs::write(&part, file)
        .and_then(|()| std::fs::rename(&part, path))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Mean brightness of each pixel, row after row: the sum of its channels by three.
pub fn greys(pixels: &RawPixels) -> impl Iterator<Item = u8> {
    let (colours, _) = pixels.data.as_chunks::<3>();
    colours.iter().map(|&[b, g, r]| {
        // A third of three bytes is a byte.
        u8::try_from((u16::from(b) + u16::from(g) + u16::from(r)) / 3).unwrap_or(u8::MAX)
    })
}

/// Characters from dark to bright.
const INK: &[u8; 10] = b" .:-=+*#%@";

/// The picture as letters, `columns` in a line; lines are half as many as the shape asks for, because
/// letters are twice as high as wide.
#[must_use]
pub fn sketch(pixels: &RawPixels, columns: u32) -> String {
    let (width, height) = (pixels.width, pixels.height);
    if width == 0 || height == 0 || columns == 0 {
        return String::new();
    }
    let columns = columns.min(width);
    let lines = (u64::from(height) * u64::from(columns) / u64::from(width) / 2).max(1);
    let bright: Vec<u8> = greys(pixels).collect();
    let mut text = String::new();
    for line in 0..lines {
        let row = line * u64::from(height) / lines;
        for column in 0..u64::from(columns) {
            let place = row * u64::from(width) + column * u64::from(width) / u64::from(columns);
            let grey = usize::try_from(place).ok().and_then(|place| bright.get(place)).copied();
            let ink = usize::from(grey.unwrap_or_default()) * INK.len() / 256;
            text.push(INK.get(ink).copied().map_or(' ', char::from));
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_pixel_is_in_opencvs_order() {
        let make = |encoding, data: &[u8]| RawPixels::dense(1, 1, encoding, data.to_vec()).unwrap();
        for (given, expected) in [
            (make(Encoding::Bgr8, &[1, 2, 3]), [1, 2, 3]),
            (make(Encoding::Rgb8, &[3, 2, 1]), [1, 2, 3]),
            (make(Encoding::Mono8, &[7]), [7, 7, 7]),
            (make(Encoding::Rgba8, &[3, 2, 1, 9]), [1, 2, 3]),
            (make(Encoding::Bgra8, &[1, 2, 3, 9]), [1, 2, 3]),
        ] {
            assert_eq!(*in_colour(&given).unwrap().data, expected);
        }
        let floats = RawPixels::dense(1, 1, Encoding::F32C1, vec![0; 4]).unwrap();
        assert!(in_colour(&floats).is_err());
    }

    #[test]
    fn a_saved_picture_is_read_again() {
        let folder = std::env::temp_dir().join(format!("wrapyfi_picture_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        assert!(png_files(&folder).unwrap_err().to_string().contains("has no .png file"));
        let picture = bgr(2, 1, vec![1, 2, 3, 4, 5, 6]).unwrap();
        for name in ["b.png", "a.png"] {
            save(&picture, &folder.join(name)).unwrap();
        }
        let files = png_files(&folder).unwrap();
        assert_eq!(files, [folder.join("a.png"), folder.join("b.png")]);
        assert_eq!(read(&files[0]).unwrap(), picture);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_sketch_shows_what_is_bright() {
        let left_is_black = bgr(4, 4, [[0; 6], [255; 6]].concat().repeat(4)).unwrap();
        assert_eq!(sketch(&left_is_black, 4), "  @@\n  @@\n");
        assert_eq!(sketch(&left_is_black, 2), " @\n");
        assert_eq!(sketch(&left_is_black, 0), "");
    }
}
