//! Claims of TIFF and BMP files about their size, checked before a decoder allocates by them.
//!
//! ```text
//!   TIFF   "II" 42 │ offset of the directory ──▶ count │ tag │ type │ values │ their offset │ …
//!   BMP    "BM" … │ header size │ width │ height │ planes │ bits │ compression │ … │ rows
//! ```
//!
//! The crate `tiff` allocates as many values as an entry claims before it reads the first, and
//! decoders of BMP allocate a picture whose rows are not in the file.

use super::super::fields::Fields;

/// Largest number of values in an entry that decoders read: offsets of strips, colours of a
/// palette.
const MOST_VALUES: u64 = 1 << 18;
/// First of the private tags, which belong to other programs and are not read here.
const PRIVATE: u16 = 0x8000;
/// Length of an entry in bytes.
const ENTRY: usize = 12;

/// Checks that the values of every entry of the first directory lie in the file.
pub(super) fn check_tiff(file: &[u8]) -> Result<(), String> {
    let little_endian = file.starts_with(b"II");
    let fields = Fields { file, little_endian };
    if fields.u16(2)? != 42 {
        return Err("it is BigTIFF, which is not read".into());
    }
    let directory = fields.u32(4)? as usize;
    let entries = usize::from(fields.u16(directory)?);
    for index in 0..entries {
        let at = directory.saturating_add(2 + index * ENTRY);
        let (tag, kind) = (fields.u16(at)?, fields.u16(at.saturating_add(2))?);
        let values = u64::from(fields.u32(at.saturating_add(4))?);
        let size = match kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 4,
        };
        let place = u64::from(fields.u32(at.saturating_add(8))?);
        let length = values * size;
        if length > 4 && place + length > file.len() as u64 {
            let have = file.len();
            return Err(format!("tag {tag} has {length} bytes at {place}, the file has {have}"));
        }
        if tag < PRIVATE && values > MOST_VALUES {
            return Err(format!("tag {tag} has {values} values, the limit is {MOST_VALUES}"));
        }
    }
    Ok(())
}

/// Checks that the rows of a file that is not compressed can lie in it.
pub(super) fn check_bmp(file: &[u8]) -> Result<(), String> {
    /// Length of the first header whose fields are these; the one before has no large pictures.
    const HEADER: u32 = 40;
    /// Compressions that are none: colours as they are, or with masks before them.
    const RAW: [u32; 3] = [0, 3, 6];
    let fields = Fields { file, little_endian: true };
    let (width, height, bits) = if fields.u32(14)? < HEADER {
        (u64::from(fields.u16(18)?), u64::from(fields.u16(20)?), fields.u16(24)?)
    } else if RAW.contains(&fields.u32(30)?) {
        let height = fields.u32(22)?.cast_signed().unsigned_abs();
        (u64::from(fields.u32(18)?), u64::from(height), fields.u16(28)?)
    } else {
        return Ok(());
    };
    let row = (width * u64::from(bits)).div_ceil(32) * 4;
    let (needed, have) = (row.saturating_mul(height), file.len());
    if needed > have as u64 {
        return Err(format!(
            "{width}x{height} of {bits} bits need {needed} bytes, the file has {have}"
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_beyond_the_file_are_refused() {
        let file = |order: &[u8; 2], values: u32, place: u32| {
            let word =
                |value: u32| if order == b"II" { value.to_le_bytes() } else { value.to_be_bytes() };
            let half =
                |value: u16| if order == b"II" { value.to_le_bytes() } else { value.to_be_bytes() };
            let mut file = order.to_vec();
            file.extend(half(42));
            file.extend(word(8));
            for field in [half(1), half(273), half(4)] {
                file.extend(field);
            }
            file.extend(word(values));
            file.extend(word(place));
            file
        };
        for order in [b"II", b"MM"] {
            assert_eq!(check_tiff(&file(order, 1, 999)), Ok(()));
            assert_eq!(check_tiff(&file(order, 2, 14)), Ok(()));
            let error = check_tiff(&file(order, 2, 15)).unwrap_err();
            assert_eq!(error, "tag 273 has 8 bytes at 15, the file has 22");
            assert!(check_tiff(&file(order, u32::MAX, u32::MAX)).is_err());
            for end in 0..22 {
                assert!(check_tiff(&file(order, 1, 0)[..end]).is_err(), "{end}");
            }
        }
        let mut many = file(b"II", MOST_VALUES as u32 + 1, 22);
        many.resize(4 << 20, 0);
        assert!(check_tiff(&many).unwrap_err().contains("the limit is 262144"));
    }

    #[test]
    fn a_bitmap_must_have_its_rows() {
        let file = |width: u32, height: i32, bits: u16, compression: u32| {
            let mut file = vec![0; 54];
            file[14..18].copy_from_slice(&40_u32.to_le_bytes());
            file[18..22].copy_from_slice(&width.to_le_bytes());
            file[22..26].copy_from_slice(&height.to_le_bytes());
            file[28..30].copy_from_slice(&bits.to_le_bytes());
            file[30..34].copy_from_slice(&compression.to_le_bytes());
            file
        };
        assert_eq!(check_bmp(&file(3, 4, 24, 0)), Ok(()));
        assert_eq!(check_bmp(&file(3, -4, 24, 3)), Ok(()));
        let error = check_bmp(&file(300, -400, 1, 0)).unwrap_err();
        assert_eq!(error, "300x400 of 1 bits need 16000 bytes, the file has 54");
        assert!(check_bmp(&file(u32::MAX, i32::MIN, u16::MAX, 0)).is_err());
        // Run lengths may stand for more: the picture's size is checked against the limit only.
        assert_eq!(check_bmp(&file(300, 400, 8, 1)), Ok(()));
    }
}
