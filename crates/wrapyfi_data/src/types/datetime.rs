//! `datetime.datetime` as Python writes and reads it.

use std::fmt;
use std::str::FromStr;

use chrono::{FixedOffset, NaiveDate, NaiveDateTime, Timelike};

/// `datetime.datetime` to the microsecond, written as by Python's `isoformat()`.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::DateTime;
/// let when: DateTime = "2024-01-02T03:04:05.5Z".parse()?;
/// assert_eq!(when.to_string(), "2024-01-02T03:04:05.500000+00:00");
/// # Ok::<(), wrapyfi_data::types::ParseDateTimeError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DateTime {
    /// Wall time at the offset.
    pub local: NaiveDateTime,
    /// Offset from UTC; `None` for a naive value.
    pub offset: Option<FixedOffset>,
}

/// Error of reading an ISO 8601 date and time.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::DateTime;
/// let error = "yesterday".parse::<DateTime>().unwrap_err();
/// assert!(error.to_string().starts_with("\"yesterday\" is no date and time such as 2024-01-02"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is no date and time such as 2024-01-02T03:04:05.678901+00:00")]
pub struct ParseDateTimeError {
    text: String,
}

impl fmt::Display for DateTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.local.format("%Y-%m-%dT%H:%M:%S"))?;
        let micros = self.local.nanosecond() / 1000 % 1_000_000;
        if micros > 0 {
            write!(f, ".{micros:06}")?;
        }
        if let Some(offset) = self.offset {
            write!(f, "{offset}")?;
        }
        Ok(())
    }
}

impl FromStr for DateTime {
    type Err = ParseDateTimeError;

    /// Reads `YYYY-MM-DD[Thh[:mm[:ss[.fraction]]]][Z|±hh:mm[:ss]]`, any character in place of
    /// `T`. Digits beyond microseconds are cut, as Python does.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        parse(text).ok_or_else(|| ParseDateTimeError { text: text.chars().take(64).collect() })
    }
}

fn parse(text: &str) -> Option<DateTime> {
    let mut rest = Scanner(text);
    let year = rest.digits(4)?;
    rest.literal('-')?;
    let month = rest.digits(2)?;
    rest.literal('-')?;
    let day = rest.digits(2)?;
    let date = NaiveDate::from_ymd_opt(i32::try_from(year).ok()?, month, day)?;
    if year == 0 {
        return None;
    }
    if rest.0.is_empty() {
        return Some(DateTime { local: date.and_hms_opt(0, 0, 0)?, offset: None });
    }
    rest.any()?;
    let (hour, minute, second) = rest.clock()?;
    let micros =
        if rest.literal('.').or_else(|| rest.literal(',')).is_some() { rest.micros()? } else { 0 };
    let offset = match rest.any() {
        None => None,
        Some('Z') => Some(FixedOffset::east_opt(0)?),
        Some(sign @ ('+' | '-')) => {
            let (hours, minutes, seconds) = rest.clock()?;
            let seconds = i32::try_from(hours * 3600 + minutes * 60 + seconds).ok()?;
            Some(FixedOffset::east_opt(if sign == '-' { -seconds } else { seconds })?)
        }
        Some(_) => return None,
    };
    if !rest.0.is_empty() {
        return None;
    }
    Some(DateTime { local: date.and_hms_micro_opt(hour, minute, second, micros)?, offset })
}

/// Text that has not been read yet.
struct Scanner<'a>(&'a str);

impl Scanner<'_> {
    fn any(&mut self) -> Option<char> {
        let mut chars = self.0.chars();
        let next = chars.next()?;
        self.0 = chars.as_str();
        Some(next)
    }

    fn literal(&mut self, wanted: char) -> Option<()> {
        self.0 = self.0.strip_prefix(wanted)?;
        Some(())
    }

    fn digits(&mut self, count: usize) -> Option<u32> {
        let (digits, rest) = self.0.split_at_checked(count)?;
        if !digits.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        self.0 = rest;
        digits.parse().ok()
    }

    /// Reads `hh[:mm[:ss]]`.
    fn clock(&mut self) -> Option<(u32, u32, u32)> {
        let hours = self.digits(2)?;
        let mut sixtieths = || match self.literal(':') {
            Some(()) => self.digits(2).filter(|&count| count < 60),
            None => Some(0),
        };
        Some((hours, sixtieths()?, sixtieths()?))
    }

    fn micros(&mut self) -> Option<u32> {
        let (mut micros, mut unit, mut read) = (0, 100_000, 0);
        while let Some(digit) = self.0.chars().next().and_then(|c| c.to_digit(10)) {
            micros += digit * unit;
            unit /= 10;
            read += 1;
            self.any();
        }
        (read > 0).then_some(micros)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn python_forms() {
        for (text, written) in [
            ("2024-01-02T03:04:05.678901", "2024-01-02T03:04:05.678901"),
            ("2024-01-02T03:04:05+00:00", "2024-01-02T03:04:05+00:00"),
            ("2024-01-02T03:04:05.000001+05:30", "2024-01-02T03:04:05.000001+05:30"),
            ("2024-01-02 03:04-11:59:58", "2024-01-02T03:04:00-11:59:58"),
            ("2024-01-02T03:04:05.1234567899Z", "2024-01-02T03:04:05.123456+00:00"),
            ("0001-12-31", "0001-12-31T00:00:00"),
            ("9999-12-31T23:59:59.999999", "9999-12-31T23:59:59.999999"),
        ] {
            assert_eq!(text.parse::<DateTime>().unwrap().to_string(), written, "{text}");
        }
    }

    #[test]
    fn nonsense_is_refused() {
        for text in [
            "yesterday",
            "NaT",
            "",
            "2024",
            "2024-13-01",
            "2024-02-30T00:00:00",
            "0000-01-01",
            "2024-01-02T",
            "2024-01-02T24:00:00",
            "2024-01-02T03:60:00",
            "2024-01-02T03:04:60",
            "2024-01-02T03:04:05+24:00",
            "2024-01-02T03:04:05.",
            "2024-01-02T03:04:05Zx",
            "2024-01-02T03:04:05x",
            "2024-01-02T0\u{663}:04:05",
            "+024-01-02",
        ] {
            assert!(text.parse::<DateTime>().is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn written_then_read_is_the_same(
            days in -719_162_i32..2_932_896, seconds in 0_u32..86_400, micros in 0_u32..1_000_000,
            offset in proptest::option::of(-86_399..86_400),
        ) {
            let local = NaiveDate::from_epoch_days(days).unwrap()
                .and_hms_micro_opt(seconds / 3600, seconds / 60 % 60, seconds % 60, micros).unwrap();
            let when = DateTime { local, offset: offset.and_then(FixedOffset::east_opt) };
            prop_assert_eq!(when.to_string().parse::<DateTime>().unwrap(), when);
        }
    }
}
