//! The header frame: `{timestamp:1795214428.9634051}` as Wrapyfi writes it. It looks like JSON but is not:
//! the keys have no quotes. No listener of Wrapyfi reads it, so there is room for more:
//!
//! ```text
//!   {timestamp:1795214428.963405123, encoding:"rgb8", frame_id:"left_camera"}
//! ```
//!
//! Other programs write the header as JSON, or the time alone: `1795214428.9634051`.

use wrapyfi_data::codec::json;
use wrapyfi_data::types::{Encoding, Stamp};

const STAMP: &str = "timestamp";
const ENCODING: &str = "encoding";
const FRAME_ID: &str = "frame_id";

/// Longest text of a time alone.
const MAX_TIME_BYTES: usize = 40;

/// True for a frame that is a header.
pub(super) fn is_one(frame: &[u8]) -> bool {
    let start = frame.get(..frame.len().min(MAX_TIME_BYTES)).unwrap_or_default().trim_ascii();
    let keyed = start.strip_prefix(b"{").unwrap_or(start).trim_ascii_start();
    let keyed = keyed.strip_prefix(b"\"").unwrap_or(keyed);
    keyed.starts_with(STAMP.as_bytes())
        || (frame.len() <= MAX_TIME_BYTES && str::from_utf8(start).is_ok_and(is_time))
}

/// True for a time without a key.
fn is_time(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_digit()) && text.parse().is_ok_and(f64::is_finite)
}

/// Time, channel order and frame that a header names.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct FrameHeader {
    /// Time of the message; `None` where the header has no time that a clock could have shown.
    pub(super) stamp: Option<Stamp>,
    /// Order of the channels of an array: `rgb8` or `bgr8`.
    pub(super) color_order: Option<Encoding>,
    /// Coordinate frame; empty where the header names none.
    pub(super) frame_id: String,
}

impl FrameHeader {
    /// Reads as much of a header as can be read. Quotes, spaces and unknown keys are accepted.
    pub(super) fn read(header: &[u8]) -> Self {
        let Ok(text) = str::from_utf8(header) else { return Self::default() };
        // The frame comes last: it may hold any text, also the other keys.
        let (others, frame_id) = match text.split_once(FRAME_ID) {
            Some((others, rest)) => (others, string(rest)),
            None => (text, None),
        };
        let order = others.split_once(ENCODING).and_then(|(_, rest)| string(rest));
        Self {
            stamp: match others.split_once(STAMP) {
                Some((_, rest)) => stamp(rest),
                None => stamp(text.trim()).filter(|_| is_time(text.trim())),
            },
            color_order: order
                .and_then(|name| Encoding::from_name(&name))
                .and_then(Encoding::color_order),
            frame_id: frame_id.unwrap_or_default(),
        }
    }
}

/// Reads the text behind a key.
fn string(rest: &str) -> Option<String> {
    let rest = rest.trim_start_matches(['"', '\'', ' ']).strip_prefix(':')?;
    serde_json::Deserializer::from_str(rest).into_iter().next()?.ok()
}

/// Reads the time behind its key.
fn stamp(rest: &str) -> Option<Stamp> {
    let rest = rest.trim_start_matches(['"', '\'', ' ', ':']);
    let end = rest.find(|c: char| !matches!(c, '0'..='9' | '.' | 'e' | 'E' | '+' | '-'));
    let number = rest.get(..end.unwrap_or(rest.len()))?;
    let stamp = exact(number).or_else(|| Some(Stamp::from_secs_f64(number.parse().ok()?)));
    // What a ROS time cannot hold becomes zero, which no sender means.
    stamp.filter(|&stamp| stamp != Stamp::default())
}

/// Reads seconds with up to nine decimals, which a double would round.
fn exact(number: &str) -> Option<Stamp> {
    let (sec, decimals) = number.split_once('.')?;
    let digits = u32::try_from(decimals.len()).ok().filter(|digits| (1..=9).contains(digits))?;
    if !decimals.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let nanosec = decimals.parse::<u32>().ok()? * 10_u32.pow(9 - digits);
    Some(Stamp { sec: sec.parse().ok().filter(|&sec: &i32| sec >= 0)?, nanosec })
}

/// Writes a header; Wrapyfi's own where only the time is known.
pub(super) fn write(stamp: Stamp, color_order: Option<Encoding>, frame_id: &str) -> Vec<u8> {
    let mut header = format!("{{{STAMP}:").into_bytes();
    if stamp.sec >= 0 && stamp.nanosec < 1_000_000_000 {
        let number = format!("{}.{:09}", stamp.sec, stamp.nanosec);
        let shortest = number.trim_end_matches('0');
        header.extend_from_slice(shortest.as_bytes());
        if shortest.ends_with('.') {
            header.push(b'0');
        }
    } else {
        json::write_float(stamp.as_secs_f64(), &mut header);
    }
    if let Some(order) = color_order {
        header.extend_from_slice(format!(", {ENCODING}:\"{}\"", order.name()).as_bytes());
    }
    if !frame_id.is_empty() {
        let text = serde_json::Value::from(frame_id);
        header.extend_from_slice(format!(", {FRAME_ID}:{text}").as_bytes());
    }
    header.push(b'}');
    header
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn forms_that_are_read() {
        let wanted = Stamp { sec: 1_795_214_428, nanosec: 500_000_000 };
        for text in [
            "{timestamp:1795214428.5}",
            "{\"timestamp\": 1795214428.5, \"frame\": 3}",
            "timestamp: 1.7952144285e9",
            "1795214428.5",
            " 1795214428.500000000\n",
        ] {
            assert!(is_one(text.as_bytes()), "{text}");
            let read = FrameHeader::read(text.as_bytes());
            assert_eq!(read, FrameHeader { stamp: Some(wanted), ..FrameHeader::default() });
        }
        assert_eq!(write(wanted, None, ""), b"{timestamp:1795214428.5}");
        let python = b"{timestamp:1795214428.9634051}";
        let read = FrameHeader::read(python).stamp.unwrap();
        assert_eq!((read.nanosec, write(read, None, "").as_slice()), (963_405_100, &python[..]));
    }

    #[test]
    fn everything_else_is_no_time() {
        for text in [
            "",
            "{}",
            "{timestamp:}",
            "{timestamp:nan}",
            "{timestamp:-1}",
            "{timestamp:1e99}",
            "nan",
            "5, 7",
        ] {
            assert_eq!(FrameHeader::read(text.as_bytes()), FrameHeader::default(), "{text}");
        }
        assert_eq!(FrameHeader::read(b"\xff{timestamp:1}"), FrameHeader::default());
        for text in ["{frame_id:7}", "{frame_id:\"open", "{encoding:\"mono8\"}", "frame_id"] {
            assert_eq!(FrameHeader::read(text.as_bytes()), FrameHeader::default(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(
            (sec, nanosec) in (1_i32.., 0_u32..1_000_000_000),
            frame_id in ".{0,20}|encoding:\"rgb8\"|timestamp:5",
            order in prop::sample::select(vec![None, Some(Encoding::Rgb8), Some(Encoding::Bgr8)]),
        ) {
            let stamp = Stamp { sec, nanosec };
            let wanted = FrameHeader { stamp: Some(stamp), color_order: order, frame_id };
            let header = write(stamp, order, &wanted.frame_id);
            prop_assert_eq!(FrameHeader::read(&header), wanted);
        }

        #[test]
        fn any_bytes_do_no_harm(header in prop::collection::vec(any::<u8>(), 0..80)) {
            FrameHeader::read(&header);
        }
    }
}
