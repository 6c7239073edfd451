//! Sources of pictures for the sensor examples.
//!
//! ```text
//!   folder ───────▶ its PNG files, again and again or once   (works everywhere, tested)
//!   /dev/video0 ──▶ V4L2 ─▶ YUYV or MJPG ─▶ bgr8             (feature `v4l2`)
//!   drawn ────────▶ a bright square that goes round, or frames from black to white
//! ```

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use wrapyfi_core::types::RawPixels;

use crate::picture;

/// A source of frames in OpenCV's channel order.
#[derive(Debug)]
pub struct Camera {
    source: Source,
    taken: u64,
}

#[derive(Debug)]
enum Source {
    Files {
        files: Vec<PathBuf>,
        is_repeated: bool,
    },
    Drawn {
        width: u32,
        height: u32,
    },
    Shades {
        width: u32,
        height: u32,
    },
    #[cfg(feature = "v4l2")]
    Device(crate::v4l2::Device),
}

impl Camera {
    /// Opens a camera: a folder with PNG files, a device below `/dev`, or without a name frames that
    /// this program draws. Folders have the size of their files; a device takes what is nearest to
    /// `width` and `height`.
    ///
    /// # Errors
    /// When there is no such camera.
    pub fn open(
        name: Option<&Path>,
        is_repeated: bool,
        width: u32,
        height: u32,
    ) -> anyhow::Result<Self> {
        let source = match name {
            None => Source::Drawn { width, height },
            Some(device) if device.starts_with("/dev") => open_device(device, width, height)?,
            Some(folder) => Source::Files { files: picture::png_files(folder)?, is_repeated },
        };
        Ok(Self { source, taken: 0 })
    }

    /// Frames of one shade each, from black to white and again.
    #[must_use]
    pub fn shades(width: u32, height: u32) -> Self {
        Self { source: Source::Shades { width, height }, taken: 0 }
    }

    /// True where the program that looks has to keep the pace, because the source does not.
    #[must_use]
    pub fn is_unpaced(&self) -> bool {
        match self.source {
            Source::Files { .. } | Source::Drawn { .. } | Source::Shades { .. } => true,
            #[cfg(feature = "v4l2")]
            Source::Device(_) => false,
        }
    }

    /// The next frame; `None` after the last.
    ///
    /// # Errors
    /// When the file is no picture, or the device fails.
    pub fn frame(&mut self) -> anyhow::Result<Option<RawPixels>> {
        let number = self.taken;
        self.taken += 1;
        match &mut self.source {
            Source::Files { files, is_repeated } => {
                let count = files.len().max(1) as u64;
                if number >= count && !*is_repeated {
                    return Ok(None);
                }
                let place = usize::try_from(number % count).unwrap_or_default();
                files.get(place).map(|file| picture::read(file)).transpose()
            }
            Source::Drawn { width, height } => drawn(number, *width, *height).map(Some),
            Source::Shades { width, height } => {
                let shade = u8::try_from(number % 256)?;
                let pixels = usize::try_from(*width)?.checked_mul(usize::try_from(*height)?);
                let bytes = pixels.and_then(|count| count.checked_mul(3)).context("too large")?;
                picture::bgr(*width, *height, vec![shade; bytes]).map(Some)
            }
            #[cfg(feature = "v4l2")]
            Source::Device(device) => device.frame().map(Some),
        }
    }
}

#[cfg(feature = "v4l2")]
fn open_device(name: &Path, width: u32, height: u32) -> anyhow::Result<Source> {
    crate::v4l2::Device::open(name, width, height).map(Source::Device)
}

#[cfg(not(feature = "v4l2"))]
fn open_device(name: &Path, _width: u32, _height: u32) -> anyhow::Result<Source> {
    anyhow::bail!(
        "{} is a device, and this program was built without V4L2: build it with `--features v4l2`, or \
         give a folder of PNG files",
        name.display()
    )
}

/// Steps in which the drawn square goes round.
const STEPS: u64 = 40;

/// A dark frame with a bright square, a quarter of each side long, on a circle.
fn drawn(number: u64, width: u32, height: u32) -> anyhow::Result<RawPixels> {
    let turn = f64::from(u32::try_from(number % STEPS)?) / 40.0 * std::f64::consts::TAU;
    let on = |length: u32, swing: f64| {
        let middle = f64::from(length) * (0.5 + 0.3 * swing);
        let half = f64::from(length) / 8.0;
        move |place: u32| (f64::from(place) + 0.5 - middle).abs() < half
    };
    let (in_column, in_row) = (on(width, turn.cos()), on(height, turn.sin()));
    let bright = |row, column| if in_row(row) && in_column(column) { 240 } else { 16 };
    let data = (0..height)
        .flat_map(|row| (0..width).map(move |column| (row, column)))
        .flat_map(|(row, column)| [bright(row, column); 3])
        .collect();
    picture::bgr(width, height, data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_a_camera() {
        let folder = std::env::temp_dir().join(format!("wrapyfi_camera_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for shade in [10, 20] {
            let frame = picture::bgr(1, 1, vec![shade; 3]).unwrap();
            picture::save(&frame, &folder.join(format!("{shade}.png"))).unwrap();
        }
        let shades = |is_repeated| {
            let mut camera = Camera::open(Some(&folder), is_repeated, 9, 9).unwrap();
            (0..3).map(|_| camera.frame().unwrap().map(|f| f.data[0])).collect::<Vec<_>>()
        };
        assert_eq!(shades(false), [Some(10), Some(20), None]);
        assert_eq!(shades(true), [Some(10), Some(20), Some(10)]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn the_square_moves() {
        let mut camera = Camera::open(None, true, 16, 8).unwrap();
        let [one, two] = [(); 2].map(|()| {
            let frames = [(); 20].map(|()| camera.frame().unwrap().unwrap());
            frames[0].clone()
        });
        assert_eq!((one.width, one.height, one.data.len()), (16, 8, 16 * 8 * 3));
        assert_ne!(one, two);
    }

    #[test]
    fn shades_begin_again() {
        let mut camera = Camera::shades(2, 1);
        let shades: Vec<_> = (0..257).map(|_| camera.frame().unwrap().unwrap().data[5]).collect();
        assert_eq!((shades[0], shades[255], shades[256]), (0, 255, 0));
    }

    #[cfg(not(feature = "v4l2"))]
    #[test]
    fn a_device_needs_the_feature() {
        let refused = Camera::open(Some(Path::new("/dev/video0")), true, 1, 1).unwrap_err();
        assert!(refused.to_string().contains("--features v4l2"), "{refused}");
    }
}
