//! JPEG files with restart markers, decompressed on several cores.
//!
//! ```text
//!   header │ rows 0 to 15 │ RST0 │ rows 16 to 31 │ RST1 │ … │ EOI
//!            └────── strip 1 ─────┴─ 1 more ─┘                      ── core 1 ──▶ upper pixels
//!                          └─ 1 more ─┴────── strip 2 ──────┘       ── core 2 ──▶ lower pixels
//! ```
//!
//! A decoder begins anew at a restart marker, so that a strip of whole intervals is a picture of its own. Where
//! two rows share their colours, these are spread over the rows of the strips above and below, so that a strip is
//! decompressed with one interval more on each side, whose pixels are dropped: what is left are the pixels of the
//! whole file. A file of another kind, or one of whose strips makes libjpeg warn, is decompressed as a whole.

use std::ops::Range;

use bytes::Bytes;
use memchr::memchr_iter;
use turbojpeg::{Decompressor, Error, Image, PixelFormat};

use super::cores::{Kept, cores, share};
use super::jpeg_header::marker;

/// Longest header that is copied for every strip.
const LONGEST_HEADER: usize = 128 << 10;

/// Fewest intervals of a strip: one or two more are decompressed with each.
const SHORTEST_STRIP: usize = 4;

/// Fewest blocks of 8 x 8 samples of a picture that is worth a second thread: 320 x 240 pixels in colour.
pub(super) const FEWEST_BLOCKS: usize = 1800;

/// Most bytes of one buffer that is kept for the next picture.
pub(super) const MOST_KEPT: usize = 4 << 20;

/// Places of the parts of a baseline file of one scan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    /// Position of the two bytes with the number of rows.
    pub(super) height_at: usize,
    /// Position of the segment that begins the scan.
    pub(super) scan_at: usize,
    /// Position of the first coded byte.
    pub(super) data_at: usize,
    width: usize,
    height: usize,
    /// Samples of a coded unit: columns, rows, and blocks of 8 x 8 that it has.
    unit: (usize, usize, usize),
    /// Number of coded units between two restart markers, or 0.
    units_between: usize,
}

impl Layout {
    /// Reads the header of a file; nothing where the file may be another kind of JPEG.
    pub(super) fn read(file: &[u8]) -> Option<Self> {
        let (mut rest, mut units_between) = (file.strip_prefix(&[0xFF, 0xD8])?, 0);
        let mut frame: Option<Self> = None;
        let of = |high, low| usize::from(u16::from_be_bytes([high, low]));
        loop {
            let begin = file.len() - rest.len();
            let (marker, after) = marker(rest).ok()?;
            let (&[high, low], after) = after.split_first_chunk::<2>()?;
            let (segment, after) = after.split_at_checked(of(high, low).checked_sub(2)?)?;
            let end = file.len() - after.len();
            match (marker, segment) {
                // Tables, applications' segments, comments.
                (0xC4 | 0xDB | 0xE0..=0xEF | 0xFE, _) => {}
                (0xDD, &[high, low]) => units_between = of(high, low),
                (0xC0, &[8, h1, h0, w1, w0, ref components @ ..]) if frame.is_none() => {
                    let unit = match *components {
                        [1, _, 0x11, _] => (8, 8, 1),
                        [3, _, luma, _, _, 0x11, _, _, 0x11, _] => match luma {
                            0x11 => (8, 8, 3),
                            0x21 => (16, 8, 4),
                            0x12 => (8, 16, 4),
                            0x22 => (16, 16, 6),
                            0x41 => (32, 8, 6),
                            _ => return None,
                        },
                        _ => return None,
                    };
                    let (width, height, height_at) =
                        (of(w1, w0), of(h1, h0), end - segment.len() + 1);
                    let (scan_at, data_at, units_between) = (0, 0, 0);
                    frame = Some(Self {
                        height_at,
                        scan_at,
                        data_at,
                        width,
                        height,
                        unit,
                        units_between,
                    });
                }
                (0xDA, &[components, .., 0, 63, 0]) => {
                    let frame = frame.filter(|it| (it.unit.2 == 1) == (components == 1))?;
                    let is_all = usize::from(components) * 2 + 4 == segment.len()
                        && matches!(components, 1 | 3);
                    return is_all.then_some(Self {
                        scan_at: begin,
                        data_at: end,
                        units_between,
                        ..frame
                    });
                }
                _ => return None,
            }
            rest = after;
        }
    }

    /// Rows of pixels between two restart markers, where each stands at the end of a row of coded units.
    fn rows_between(&self) -> Option<usize> {
        let (columns, rows, _) = self.unit;
        let across = self.width.div_ceil(columns);
        let is_whole = self.units_between > 0 && self.units_between.checked_rem(across)? == 0;
        is_whole.then(|| self.units_between / across * rows)
    }

    fn blocks(&self) -> usize {
        let (columns, rows, blocks) = self.unit;
        self.width.div_ceil(columns) * self.height.div_ceil(rows) * blocks
    }
}

/// A file and its coded bytes between restart markers.
struct Intervals {
    file: Bytes,
    layout: Layout,
    /// Rows of pixels of each interval but the last.
    rows: usize,
    places: Vec<Range<usize>>,
}

impl Intervals {
    /// Cuts a file; nothing where a marker is missing, too many or out of its order.
    fn of(file: &Bytes) -> Option<Self> {
        let layout = Layout::read(file).filter(|layout| {
            layout.data_at <= LONGEST_HEADER && layout.blocks() >= FEWEST_BLOCKS
        })?;
        let rows = layout.rows_between()?;
        let count = layout.height.div_ceil(rows);
        let mut places = Vec::with_capacity(count);
        let mut begin = layout.data_at;
        for end in memchr_iter(0xFF, file.get(begin..)?).map(|at| layout.data_at + at) {
            let marker = *file.get(end + 1)?;
            if marker == 0 {
                continue;
            }
            places.push(begin..end);
            let is_last = places.len() == count;
            if is_last && marker == 0xD9 {
                return Some(Self { file: file.clone(), layout, rows, places });
            }
            if is_last || usize::from(marker) != 0xD0 + (places.len() - 1) % 8 {
                return None;
            }
            begin = end + 2;
        }
        None
    }

    /// Intervals of strip `number` of `strips`.
    fn own(&self, number: usize, strips: usize) -> Range<usize> {
        let count = self.places.len();
        number * count / strips..(number + 1) * count / strips
    }
}

/// Buffers that a strip is decompressed from, and to. Its decompressor is new each time: one that was used keeps tables of
/// that file for the next, which may have none.
#[derive(Default)]
struct Room {
    /// The strip as a file.
    file: Vec<u8>,
    /// Pixels of the strip and its neighbours.
    pixels: Vec<u8>,
}

static KEPT: Kept<Room> = Kept::new();

impl Room {
    /// Decompresses the intervals `own` of a file; where their pixels are in `pixels`.
    fn decompress(
        &mut self,
        whole: &Intervals,
        own: Range<usize>,
        format: PixelFormat,
    ) -> Option<Range<usize>> {
        let Intervals { ref file, layout, rows, ref places } = *whole;
        // Only where rows of colours are fewer than rows of pixels do strips look across their borders.
        let needs_more = layout.unit.1 > 8;
        let above = usize::from(needs_more && own.start > 0);
        let below = usize::from(needs_more && own.end < places.len());
        let all = own.start - above..own.end + below;
        let height = (all.end * rows).min(layout.height) - all.start * rows;

        self.file.clear();
        self.file.extend_from_slice(file.get(..layout.data_at)?);
        let height_bytes = u16::try_from(height).ok()?.to_be_bytes();
        self.file.get_mut(layout.height_at..layout.height_at + 2)?.copy_from_slice(&height_bytes);
        for (place, marker) in places.get(all)?.iter().zip((0xD0..=0xD7).cycle()) {
            self.file.extend_from_slice(file.get(place.clone())?);
            self.file.extend_from_slice(&[0xFF, marker]);
        }
        // The picture ends where another interval would begin.
        *self.file.last_mut()? = 0xD9;

        let (width, pitch) = (layout.width, layout.width * format.size());
        let size = height * pitch;
        if self.pixels.len() < size {
            self.pixels = vec![0; size];
        }
        let image = Image { pixels: self.pixels.as_mut_slice(), width, pitch, height, format };
        Decompressor::new().and_then(|mut it| it.decompress(&self.file, image)).ok()?;
        let begin = above * rows * pitch;
        let own_rows = (own.end * rows).min(layout.height) - own.start * rows;
        Some(begin..begin + own_rows * pitch)
    }
}

/// Decompresses a file of `height` rows into rows without padding, and says what libjpeg says.
pub(super) fn decompress(
    file: &Bytes,
    (width, height): (usize, usize),
    format: PixelFormat,
) -> (Vec<u8>, Result<(), Error>) {
    match in_strips(cores(), file, format) {
        Some(pixels) => (pixels, Ok(())),
        None => as_a_whole(file, (width, height), format),
    }
}

fn as_a_whole(
    file: &Bytes,
    (width, height): (usize, usize),
    format: PixelFormat,
) -> (Vec<u8>, Result<(), Error>) {
    let pitch = width * format.size();
    let mut pixels = vec![0; height * pitch];
    let image = Image { pixels: pixels.as_mut_slice(), width, pitch, height, format };
    let done = Decompressor::new().and_then(|mut it| it.decompress(file, image));
    (pixels, done)
}

/// Pixels of a file; nothing where libjpeg must be asked what it makes of the whole file.
fn in_strips(cores: usize, file: &Bytes, format: PixelFormat) -> Option<Vec<u8>> {
    let whole = (cores > 1).then(|| Intervals::of(file)).flatten()?;
    let strips = (whole.places.len() / SHORTEST_STRIP).min(cores);
    if strips < 2 {
        return None;
    }
    let size = whole.layout.width * whole.layout.height * format.size();
    let decompressed = share(strips, strips, move |number| {
        let mut room = KEPT.take().unwrap_or_default();
        let place = room.decompress(&whole, whole.own(number, strips), format)?;
        Some((room, place))
    });
    let mut pixels = Vec::with_capacity(size);
    for strip in decompressed {
        let (room, place) = strip?;
        pixels.extend_from_slice(room.pixels.get(place)?);
        if room.file.capacity().max(room.pixels.capacity()) <= MOST_KEPT {
            KEPT.give(room);
        }
    }
    Some(pixels)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use turbojpeg::Subsamp;

    use super::super::jpeg_strips::tests::{in_rows, noise};
    use super::*;

    /// Every kind of subsampling, and rows of its coded units.
    const KINDS: [(Subsamp, usize); 6] = [
        (Subsamp::Gray, 8),
        (Subsamp::None, 8),
        (Subsamp::Sub2x1, 8),
        (Subsamp::Sub1x2, 16),
        (Subsamp::Sub2x2, 16),
        (Subsamp::Sub4x1, 8),
    ];

    fn format(subsampling: Subsamp) -> PixelFormat {
        if subsampling == Subsamp::Gray { PixelFormat::GRAY } else { PixelFormat::BGR }
    }

    /// Checks that the whole file gives the pixels that strips give, and no more than a harmless warning; true where
    /// strips give any.
    fn same_as_the_whole(file: &Bytes, format: PixelFormat) -> bool {
        let mut is_cut = false;
        for cores in 2..=4 {
            let Some(pixels) = in_strips(cores, file, format) else { continue };
            let layout = Layout::read(file).unwrap();
            let (whole, done) = as_a_whole(file, (layout.width, layout.height), format);
            if let Err(error) = done {
                assert!(error.to_string().contains("extraneous bytes"), "{error}");
            }
            assert!(pixels == whole, "{}x{} on {cores}", layout.width, layout.height);
            is_cut = true;
        }
        is_cut
    }

    #[test]
    fn strips_have_the_pixels_of_the_whole() {
        for (subsampling, unit) in KINDS {
            for (width, height, rows) in [(640, 480, unit), (417, 331, unit * 2)] {
                let format = format(subsampling);
                let file = in_rows(&noise(width, height, format), subsampling, 90, rows);
                assert!(same_as_the_whole(&file, format), "{subsampling:?} {width}x{height}");
            }
        }
    }

    #[test]
    fn other_files_are_read_as_a_whole() {
        let file = in_rows(&noise(640, 480, PixelFormat::BGR), Subsamp::Sub2x2, 90, 16);
        assert!(in_strips(2, &file, PixelFormat::BGR).is_some());
        assert!(in_strips(1, &file, PixelFormat::BGR).is_none());
        let at = |marker: u8| file.windows(2).position(|it| it == [0xFF, marker]).unwrap();
        let with = |place: usize, byte: u8| {
            let mut other = file.to_vec();
            other[place] = byte;
            in_strips(2, &other.into(), PixelFormat::BGR)
        };
        assert!(with(at(0xC0) + 1, 0xC2).is_none(), "a progressive file");
        assert!(with(at(0xC0) + 11, 0x31).is_none(), "three samples of grey for one of colour");
        assert!(with(at(0xDD) + 5, 41).is_none(), "a marker inside a row");
        assert!(with(at(0xDD) + 5, 80).is_none(), "more markers than are needed");
        assert!(with(at(0xD3) + 1, 0xD4).is_none(), "markers that are out of their order");
        assert!(in_strips(2, &file.slice(..file.len() - 2), PixelFormat::BGR).is_none(), "no end");
        let long = [&file[..2], &[0xFF, 0xE1, 0xFF, 0xFF], &[0; 65_533]].concat();
        let long = [&long, &long[2..], &long[2..], &file[2..]].concat();
        assert!(in_strips(2, &long.into(), PixelFormat::BGR).is_none(), "a header of 190 KiB");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn broken_files_are_what_the_whole_is(
            kind in 0..KINDS.len(),
            at in any::<prop::sample::Index>(),
            byte: u8,
            way in 0..4,
        ) {
            let (subsampling, rows) = KINDS[kind];
            let format = format(subsampling);
            let file = in_rows(&noise(400, 304, format), subsampling, 50, rows);
            let at = at.index(file.len());
            let (before, behind) = file.split_at(at);
            let broken = match way {
                0 => [before, &[byte], &behind[1..]].concat(),
                1 => [before, &[byte], behind].concat(),
                2 => [before, &behind[1..]].concat(),
                _ => [before, &[0xFF, 0xD0 + byte % 10], behind].concat(),
            };
            same_as_the_whole(&broken.into(), format);
            same_as_the_whole(&file.slice(..at), format);
        }
    }
}
