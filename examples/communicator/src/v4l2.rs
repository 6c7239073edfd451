//! Cameras of Linux, by the ioctls of V4L2: no library of the system is linked.
//!
//! ```text
//!   /dev/video0 ─ asked for YUYV, else MJPG ─▶ buffers mapped from the driver ─▶ bgr8
//! ```

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use linuxvideo::BufType;
use linuxvideo::format::{PixFormat, PixelFormat};
use linuxvideo::stream::ReadStream;
use wrapyfi_core::Limits;
use wrapyfi_core::codec::jpeg;
use wrapyfi_core::types::{Encoding, RawPixels};

use crate::picture;

/// Damaged frames in a row after which a camera counts as broken.
const DAMAGED: u32 = 100;

/// A camera that streams.
pub(crate) struct Device {
    name: PathBuf,
    stream: ReadStream,
    layout: Layout,
}

/// Format that the driver agreed to.
#[derive(Debug, Clone, Copy)]
struct Layout {
    pixels: PixelFormat,
    width: u32,
    height: u32,
    /// Bytes from one row to the next.
    step: usize,
}

impl std::fmt::Debug for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Device").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Device {
    /// Starts the camera at about this size.
    ///
    /// # Errors
    /// When there is no such device, another program uses it, or it has neither YUYV nor MJPG.
    pub(crate) fn open(name: &Path, width: u32, height: u32) -> anyhow::Result<Self> {
        let shown = name.display();
        let device = linuxvideo::Device::open(name)
            .with_context(|| format!("cannot open the camera {shown}"))?;
        let offered = device
            .formats(BufType::VIDEO_CAPTURE)
            .map(|format| format.map(|format| format.pixel_format()))
            .collect::<Result<Vec<_>, _>>()
            .with_context(|| format!("{shown} does not say which formats it has"))?;
        let Some(wanted) =
            [PixelFormat::YUYV, PixelFormat::MJPG].into_iter().find(|one| offered.contains(one))
        else {
            bail!("{shown} has neither YUYV nor MJPG, only {offered:?}: use another camera");
        };
        let capture = device
            .video_capture(PixFormat::new(width, height, wanted))
            .with_context(|| format!("{shown} refuses {wanted:?} of {width}x{height}"))?;
        let agreed = capture.format();
        let layout = Layout {
            pixels: agreed.pixel_format(),
            width: agreed.width(),
            height: agreed.height(),
            step: usize::try_from(agreed.bytes_per_line())?,
        };
        let stream = capture.into_stream().with_context(|| format!("{shown} does not stream"))?;
        Ok(Self { name: name.to_owned(), stream, layout })
    }

    /// Waits for the next frame that is whole.
    ///
    /// # Errors
    /// When the device ends, or sends nothing but damaged frames.
    pub(crate) fn frame(&mut self) -> anyhow::Result<RawPixels> {
        let shown = self.name.display();
        let mut last = None;
        for _ in 0..DAMAGED {
            let bytes = self
                .stream
                .dequeue(|buffer| Ok((!buffer.is_error()).then(|| buffer.to_vec())))
                .with_context(|| format!("{shown} ended"))?;
            // USB cameras damage a frame now and then, the first ones most of all.
            match bytes.map(|bytes| decoded(bytes, self.layout)) {
                Some(Ok(frame)) => return Ok(frame),
                Some(Err(reason)) => last = Some(reason),
                None => {}
            }
        }
        let reason = last.map_or_else(|| "the driver says so".to_owned(), |why| format!("{why:#}"));
        bail!("{shown} sent {DAMAGED} damaged frames in a row: {reason}")
    }
}

fn decoded(bytes: Vec<u8>, layout: Layout) -> anyhow::Result<RawPixels> {
    match layout.pixels {
        PixelFormat::MJPG => {
            Ok(jpeg::decode(&bytes.into(), &Limits::default(), Some(Encoding::Bgr8))?)
        }
        PixelFormat::YUYV => from_yuyv(&bytes, layout.width, layout.height, layout.step),
        other => bail!("frames of type {other:?}, which nobody asked for"),
    }
}

/// Two pixels of four bytes, `y0 u y1 v`, as two of three.
fn from_yuyv(bytes: &[u8], width: u32, height: u32, step: usize) -> anyhow::Result<RawPixels> {
    let row_bytes = usize::try_from(width)? * 2;
    let rows: Vec<&[u8]> =
        bytes.chunks(step.max(row_bytes).max(1)).take(usize::try_from(height)?).collect();
    let mut data = Vec::with_capacity(rows.len() * row_bytes * 3 / 2);
    for row in rows {
        let (pairs, _) = row.get(..row_bytes).context("a row is cut off")?.as_chunks::<4>();
        for &[first, u, second, v] in pairs {
            data.extend(colour(first, u, v));
            data.extend(colour(second, u, v));
        }
    }
    picture::bgr(width, height, data)
}

/// BT.601 in its narrow range, as cameras send it, in thousandths.
fn colour(y: u8, u: u8, v: u8) -> [u8; 3] {
    let (y, u, v) = (1164 * (i32::from(y) - 16), i32::from(u) - 128, i32::from(v) - 128);
    let byte = |thousandths: i32| u8::try_from((thousandths / 1000).clamp(0, 255)).unwrap_or(0);
    [byte(y + 2017 * u), byte(y - 392 * u - 813 * v), byte(y + 1596 * v)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luminance_and_colour_become_blue_green_and_red() {
        let padded = [235, 128, 16, 128, 0, 0, 81, 90, 81, 240, 0, 0];
        let frame = from_yuyv(&padded, 2, 2, 6).unwrap();
        // White and black; twice BT.601's red.
        assert_eq!(*frame.data, [254, 254, 254, 0, 0, 0, 0, 0, 254, 0, 0, 254]);
    }

    #[test]
    fn a_frame_that_is_cut_off_is_refused() {
        assert!(from_yuyv(&[0; 7], 2, 2, 4).is_err());
        assert!(from_yuyv(&[0; 4], 2, 2, 4).is_err());
    }

    #[test]
    fn a_missing_camera_is_named() {
        let missing = Path::new("/dev/no_such_camera");
        let refused = Device::open(missing, 640, 480).unwrap_err().to_string();
        assert_eq!(refused, "cannot open the camera /dev/no_such_camera");
    }
}
