//! Little-endian numbers at fixed places: headers of images, sounds and vectors.

/// `N` 32-bit integers at byte `at`; none where the bytes end before.
pub(super) fn ints<const N: usize>(bytes: &[u8], at: usize) -> Option<[i32; N]> {
    let (words, _) = bytes.get(at..)?.as_chunks::<4>();
    let words = words.first_chunk::<N>()?;
    Some(words.map(i32::from_le_bytes))
}

/// Appends 32-bit integers.
pub(super) fn put(out: &mut Vec<u8>, numbers: &[i32]) {
    for number in numbers {
        out.extend_from_slice(&number.to_le_bytes());
    }
}
