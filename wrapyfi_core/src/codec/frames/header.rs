//! The header frame: `{timestamp:1795214428.9634051}`. It looks like JSON but is not: the key has
//! no quotes.

use crate::codec::json;
use crate::types::Stamp;

const KEY: &str = "timestamp";

/// The time in a header; `None` when it holds none that a clock could have shown. Quotes and
/// spaces are put up with.
pub(super) fn stamp(header: &[u8]) -> Option<Stamp> {
    let (_, rest) = str::from_utf8(header).ok()?.split_once(KEY)?;
    let rest = rest.trim_start_matches(['"', '\'', ' ', ':']);
    let end = rest.find(|c: char| !matches!(c, '0'..='9' | '.' | 'e' | 'E' | '+' | '-'));
    let seconds: f64 = rest.get(..end.unwrap_or(rest.len()))?.parse().ok()?;
    // What a ROS time cannot hold becomes zero, which no sender means.
    Some(Stamp::from_secs_f64(seconds)).filter(|&stamp| stamp != Stamp::default())
}

/// A header with the time as Python writes it.
pub(super) fn write(stamp: Stamp) -> Vec<u8> {
    format!("{{{KEY}:{}}}", json::repr(stamp.as_secs_f64())).into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_that_are_read() {
        let wanted = Stamp { sec: 1_795_214_428, nanosec: 500_000_000 };
        for text in [
            "{timestamp:1795214428.5}",
            "{\"timestamp\": 1795214428.5, \"frame\": 3}",
            "timestamp: 1.7952144285e9",
        ] {
            assert_eq!(stamp(text.as_bytes()), Some(wanted), "{text}");
        }
        assert_eq!(write(wanted), b"{timestamp:1795214428.5}");
    }

    #[test]
    fn everything_else_is_no_time() {
        for text in
            ["", "{}", "{timestamp:}", "{timestamp:nan}", "{timestamp:-1}", "{timestamp:1e99}"]
        {
            assert_eq!(stamp(text.as_bytes()), None, "{text}");
        }
        assert_eq!(stamp(b"\xff{timestamp:1}"), None);
    }
}
