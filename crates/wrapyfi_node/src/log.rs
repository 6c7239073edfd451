//! Log lines as `/rosout` carries them.

use std::time::Duration;

use wrapyfi_interfaces::rcl_interfaces::msg::Log;

use super::{LogLevel, time};
use wrapyfi_data::types::Stamp;

/// A line of a log, before it has a time.
///
/// ```
/// use wrapyfi_node::{LogLevel, LogLine};
/// use wrapyfi_data::types::Stamp;
/// let line = LogLine {
///     level: LogLevel::Warn,
///     logger: "robot.bridge".into(),
///     text: "nobody listens".into(),
///     file: file!().into(),
///     function: "tick".into(),
///     line: line!(),
/// };
/// assert_eq!(line.to_message(Stamp::now()).level, 30);
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LogLine {
    /// Severity; [`LogLevel::Unset`] is none.
    pub level: LogLevel,
    /// Name of the logger: that of the node with dots, and dots behind it for parts of the node.
    pub logger: String,
    /// Text of the line.
    pub text: String,
    /// Source file of the call that logs the line; may be empty.
    pub file: String,
    /// Function that logs the line; may be empty.
    pub function: String,
    /// Number of the line in the source file; 0 where it is not known.
    pub line: u32,
}

impl LogLine {
    /// Topic of the log.
    pub const TOPIC: &'static str = "/rosout";
    /// Number of lines that a node keeps for later readers: keep last, transient local, reliable.
    pub const DEPTH: u32 = 1000;
    /// Age at which a line is no longer delivered to readers.
    pub const LIFESPAN: Duration = Duration::from_secs(10);
    /// Longest text of a line in bytes; a longer one is cut, and says so at its end.
    pub const MAX_TEXT_BYTES: usize = 64 * 1024;

    /// Converts the line to a message.
    pub fn to_message(&self, stamp: Stamp) -> Log {
        Log {
            stamp: time(stamp),
            level: self.level.number(),
            name: self.logger.clone(),
            msg: cut(&self.text),
            file: self.file.clone(),
            function: self.function.clone(),
            line: self.line,
        }
    }
}

/// The text, at most [`LogLine::MAX_TEXT_BYTES`] of it. A NUL would end it on the wire.
fn cut(text: &str) -> String {
    let most = LogLine::MAX_TEXT_BYTES.min(text.len());
    let end = (0..=most).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    let (kept, beyond) = text.split_at_checked(end).unwrap_or((text, ""));
    let mut kept = kept.replace('\0', "\u{fffd}");
    if !beyond.is_empty() {
        kept.push_str(&format!(" … ({} more bytes)", beyond.len()));
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_data::{self, RMWS};
    use wrapyfi_interfaces::Message;

    #[test]
    fn lines_are_the_recorded_messages() {
        for rmw in RMWS {
            for (index, (_, recorded)) in test_data::group(rmw, "rosout").iter().enumerate() {
                let line = LogLine {
                    level: LogLevel::Info,
                    logger: "talker".into(),
                    text: format!("Publishing: \"Hello World: {index}\""),
                    file: "/srv/demo/roles.py".into(),
                    function: "cb".into(),
                    line: 21,
                };
                let stamp = Log::decode(recorded, 1 << 16).unwrap().stamp;
                let stamp = Stamp { sec: stamp.sec, nanosec: stamp.nanosec };
                let cdr = line.to_message(stamp).encode().to_bytes();
                assert_eq!(test_data::padded(&cdr), test_data::clean::<Log>(rmw, recorded));
            }
        }
    }

    #[test]
    fn levels_have_the_numbers_of_the_message() {
        let levels =
            [LogLevel::Debug, LogLevel::Info, LogLevel::Warn, LogLevel::Error, LogLevel::Fatal];
        let numbers = [Log::DEBUG, Log::INFO, Log::WARN, Log::ERROR, Log::FATAL];
        assert_eq!(levels.map(LogLevel::number), numbers);
        assert_eq!(numbers, [10, 20, 30, 40, 50]);
    }

    #[test]
    fn long_texts_are_cut_and_say_so() {
        let line = |text: String| LogLine { text, ..LogLine::default() };
        let text = |text: String| line(text).to_message(Stamp::default()).msg;
        let most = LogLine::MAX_TEXT_BYTES;
        assert_eq!(text("x".repeat(most)).len(), most);
        assert!(text("x".repeat(most + 5)).ends_with("x … (5 more bytes)"));
        // Text is cut between characters only.
        assert!(text("€".repeat(most)).contains("€ … ("));
        assert_eq!(text("a\0b".into()), "a\u{fffd}b");
    }
}
