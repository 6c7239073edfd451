//! Size of a picture from the header of its JPEG file, read before anything is allocated for it.

use memchr::memmem;

/// Most scans of a progressive file. Encoders write ten; each makes the decoder go over the whole picture.
const MAX_SCANS: usize = 100;

/// Size of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct JpegHeader {
    pub(super) width: u16,
    pub(super) height: u16,
    /// 1: grey; 3: colours; 4: inks.
    pub(super) components: u8,
}

impl JpegHeader {
    /// Walks the segments up to the frame header.
    pub(super) fn read(file: &[u8]) -> Result<Self, String> {
        let mut rest = file.strip_prefix(&[0xFF, 0xD8]).ok_or("no JPEG file: FF D8 is missing")?;
        loop {
            let (marker, after) = marker(rest)?;
            rest = after;
            match marker {
                // Markers without a segment.
                0x01 | 0xD0..=0xD7 => continue,
                0xD8..=0xDA => return Err("no frame header before the picture".to_owned()),
                _ => {}
            }
            let (size, after) = rest.split_first_chunk::<2>().ok_or(ENDS)?;
            let size = usize::from(u16::from_be_bytes(*size)).checked_sub(2);
            let size =
                size.ok_or_else(|| format!("a segment {marker:02X} shorter than its size"))?;
            let (segment, after) = after.split_at_checked(size).ok_or(ENDS)?;
            rest = after;
            let is_frame = matches!(marker, 0xC0..=0xCF) && !matches!(marker, 0xC4 | 0xC8 | 0xCC);
            if !is_frame {
                continue;
            }
            let is_progressive = matches!(marker, 0xC2 | 0xC6 | 0xCA | 0xCE);
            // Inside the picture FF is always followed by 00 or a marker.
            let scans = memmem::find_iter(rest, &[0xFF, 0xDA]).take(MAX_SCANS + 1).count();
            if is_progressive && scans > MAX_SCANS {
                return Err(format!("more than {MAX_SCANS} scans"));
            }
            return Self::of_frame(segment);
        }
    }

    fn of_frame(segment: &[u8]) -> Result<Self, String> {
        let Some(&[precision, h1, h0, w1, w0, components]) = segment.first_chunk::<6>() else {
            return Err(format!("a frame header of {} bytes", segment.len()));
        };
        let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
        if precision != 8 {
            return Err(format!("{precision} bits per channel where 8 are read"));
        }
        if width == 0 || height == 0 {
            return Err(format!("a picture of {width}x{height}"));
        }
        Ok(Self { width, height, components })
    }
}

const ENDS: &str = "the file ends before its frame header";

/// The next marker, and what follows it. Any number of FF may stand before it.
fn marker(bytes: &[u8]) -> Result<(u8, &[u8]), String> {
    let after = bytes.strip_prefix(&[0xFF]).ok_or("a segment that begins with no marker")?;
    let fill = after.iter().take_while(|&&byte| byte == 0xFF).count();
    let (marker, rest) = after.get(fill..).and_then(<[u8]>::split_first).ok_or(ENDS)?;
    Ok((*marker, rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRAME: [u8; 17] = [0xFF, 0xC0, 0, 17, 8, 0, 7, 0, 9, 3, 1, 0x22, 0, 2, 0x11, 1, 3];

    fn file(before: &[u8], frame: &[u8]) -> Vec<u8> {
        [&[0xFF, 0xD8], before, frame, &[0; 4]].concat()
    }

    #[test]
    fn the_frame_is_found_behind_other_segments() {
        let wanted = Ok(JpegHeader { width: 9, height: 7, components: 3 });
        assert_eq!(JpegHeader::read(&file(&[], &FRAME)), wanted);
        // A thumbnail inside a segment is not looked at.
        let thumbnail = [&[0xFF, 0xE1, 0, 10, 0xFF, 0xD8, 0xFF, 0xC0][..], &[0; 4]].concat();
        assert_eq!(JpegHeader::read(&file(&thumbnail, &FRAME)), wanted);
        assert_eq!(JpegHeader::read(&file(&[0xFF, 0xFF], &FRAME)), wanted);
    }

    #[test]
    fn what_is_no_header_is_told() {
        let with = |at: usize, byte: u8| {
            let mut frame = FRAME;
            frame[at] = byte;
            JpegHeader::read(&file(&[], &frame)).unwrap_err()
        };
        assert_eq!(with(4, 12), "12 bits per channel where 8 are read");
        assert_eq!(with(8, 0), "a picture of 0x7");
        assert_eq!(with(3, 1), "a segment C0 shorter than its size");
        assert_eq!(with(2, 9), ENDS);
        assert_eq!(with(1, 0xDA), "no frame header before the picture");
        assert!(JpegHeader::read(b"GIF89a").unwrap_err().starts_with("no JPEG file"));
        let mut progressive = FRAME;
        progressive[1] = 0xC2;
        let bomb = [file(&[], &progressive), [0xFF, 0xDA, 0, 0].repeat(101)].concat();
        assert_eq!(JpegHeader::read(&bomb).unwrap_err(), "more than 100 scans");
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            drop(JpegHeader::read(&bytes));
            drop(JpegHeader::read(&file(&bytes, &FRAME)));
        }
    }
}
