//! YARP's number: eight bytes that begin a connection, an index or an acknowledgement.
//!
//! ```text
//!   'Y' 'A'  i32, little endian  'R' 'P'
//! ```

/// Bytes of a number.
pub const SIZE: usize = 8;

/// The bytes of `value`.
pub const fn encode(value: i32) -> [u8; SIZE] {
    let [a, b, c, d] = value.to_le_bytes();
    [b'Y', b'A', a, b, c, d, b'R', b'P']
}

/// The number in the first eight of `bytes`; `None` when it is none.
pub fn decode(bytes: &[u8]) -> Option<i32> {
    match *bytes {
        [b'Y', b'A', a, b, c, d, b'R', b'P', ..] => Some(i32::from_le_bytes([a, b, c, d])),
        _ => None,
    }
}

/// The acknowledgement of a message on tcp: the number 0, no bytes behind it.
pub const ACK: [u8; SIZE] = encode(0);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_letters_around_them() {
        assert_eq!(encode(7908), [0x59, 0x41, 0xe4, 0x1e, 0, 0, 0x52, 0x50]);
        assert_eq!(decode(&encode(-5)), Some(-5));
        assert_eq!(decode(b"YA\0\0\0\0RQ"), None);
        assert_eq!(decode(b"YA\0\0\0\0R"), None);
    }
}
