//! Hashes of types as texts, and as the bytes that rmw has.

use std::fmt::Write as _;

use wrapyfi_rmw::TypeHash;

/// Prefix of a hash of version 1, by REP-2016.
const HASH_BEGINS: &str = "RIHS01_";

pub(super) fn hash_from_text(text: &str) -> Option<TypeHash> {
    let digits = text.strip_prefix(HASH_BEGINS).filter(|digits| digits.len() == 64)?;
    let mut hash = [0; 32];
    for (byte, pair) in hash.iter_mut().zip(digits.as_bytes().chunks_exact(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(hash)
}

pub(super) fn hash_to_text(hash: &TypeHash) -> String {
    let mut text = HASH_BEGINS.to_owned();
    for byte in hash {
        // Writing to a string does not fail.
        _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_texts_and_bytes() {
        let text = format!("RIHS01_{}", "0f".repeat(32));
        assert_eq!(hash_from_text(&text).as_ref().map(hash_to_text), Some(text));
        for wrong in ["", "RIHS01_", "RIHS02_00", &format!("RIHS01_{}", "zz".repeat(32))] {
            assert_eq!(hash_from_text(wrong), None);
        }
    }
}
