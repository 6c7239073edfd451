//! Base64 as Python reads and writes it.

use base64_simd::STANDARD;

/// Decodes text in the standard alphabet with padding, at the speed of the machine; `None` for
/// anything else.
pub fn decode_strictly(text: &[u8]) -> Option<Vec<u8>> {
    STANDARD.decode_to_vec(text).ok()
}

/// Decodes text by Python's rules, which skip foreign characters and stop at the padding.
pub fn decode_leniently(text: &[u8]) -> Result<Vec<u8>, String> {
    if !text.is_ascii() {
        return Err("base64 text holds characters beyond ASCII".into());
    }
    let (mut digits, mut padding) = (Vec::with_capacity(text.len()), 0);
    for &byte in text {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'+' | b'/' => {
                digits.push(byte);
                padding = 0;
            }
            b'=' => padding += 1,
            _ => {}
        }
        if digits.len() % 4 >= 2 && digits.len() % 4 + padding >= 4 {
            break;
        }
    }
    // Bits that are left over are no fault, but padding that is missing is one.
    let begun = digits.len() % 4;
    let padded = begun == 0 || begun + padding >= 4;
    let decoded = padded.then(|| base64_simd::forgiving_decode_to_vec(&digits).ok()).flatten();
    decoded.ok_or_else(|| {
        format!("base64 text of {} characters ends inside a group of four", text.len())
    })
}

/// Length of `bytes` bytes in base64.
pub(crate) fn encoded_length(bytes: usize) -> usize {
    bytes.div_ceil(3).saturating_mul(4)
}

/// Appends `head` followed by `body` in base64 without joining them first.
pub fn append(head: &[u8], body: &[u8], out: &mut Vec<u8>) {
    // Base64 takes three bytes at a time: only the group across the seam is put together.
    let whole = head.len() - head.len() % 3;
    let (head, rest) = head.split_at_checked(whole).unwrap_or((head, &[]));
    let missing = (3 - rest.len()) % 3;
    let (start, body) = body.split_at_checked(missing).unwrap_or((body, &[]));
    STANDARD.encode_append(head, out);
    if !rest.is_empty() {
        STANDARD.encode_append([rest, start].concat(), out);
    }
    STANDARD.encode_append(body, out);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn python_rules() {
        for (text, wanted) in [
            ("QUJD", Some("ABC")),
            ("QU\nJD ", Some("ABC")),
            ("@@@", Some("")),
            ("", Some("")),
            ("QUI=", Some("AB")),
            ("QQ==", Some("A")),
            ("QQ==QUJD", Some("A")),
            ("QQ=-=", Some("A")),
            ("=QUJD", Some("ABC")),
            ("QUJ=D=", Some("AB")),
            ("QUJ", None),
            ("QQ", None),
            ("Q===", None),
            ("QR==", Some("A")), // bits left over
            ("QUJDé", None),
        ] {
            let decoded = decode_leniently(text.as_bytes()).ok();
            assert_eq!(decoded.as_deref(), wanted.map(str::as_bytes), "{text}");
            let strict = decode_strictly(text.as_bytes());
            assert!(strict.is_none() || strict == decoded, "{text}");
        }
    }

    proptest! {
        #[test]
        fn two_pieces_encode_as_one(
            head in proptest::collection::vec(any::<u8>(), 0..10),
            body in proptest::collection::vec(any::<u8>(), 0..10),
        ) {
            let mut out = Vec::new();
            append(&head, &body, &mut out);
            let joined = [head, body].concat();
            prop_assert_eq!(&*out, &*STANDARD.encode_type::<Vec<u8>>(&joined));
            prop_assert_eq!(out.len(), encoded_length(joined.len()));
            prop_assert_eq!(decode_leniently(&out).unwrap(), joined);
        }
    }
}
