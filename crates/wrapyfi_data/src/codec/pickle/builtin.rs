//! Values of Python's standard library as pickles describe them.

use chrono::{FixedOffset, NaiveDate, NaiveTime, TimeDelta};

use super::error::PickleError;
use super::node::{Node, View};
use crate::types::DateTime;

/// A `slice`.
///
/// ```
/// use wrapyfi_data::codec::pickle::Slice;
/// let every_second = Slice { start: Some(0), stop: Some(6), step: Some(2) };
/// assert_eq!(every_second.indices().unwrap().collect::<Vec<_>>(), [0, 2, 4]);
/// let backwards = Slice { step: Some(-1), ..every_second };
/// assert!(backwards.indices().is_none());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slice {
    /// First index.
    pub start: Option<i64>,
    /// Index behind the last.
    pub stop: Option<i64>,
    /// Step from one index to the next.
    pub step: Option<i64>,
}

impl Slice {
    /// Indices of the slice, when it counts up from its start to its stop.
    pub fn indices(&self) -> Option<std::iter::StepBy<std::ops::Range<usize>>> {
        let start = usize::try_from(self.start.unwrap_or(0)).ok()?;
        let stop = usize::try_from(self.stop?).ok()?;
        let step = usize::try_from(self.step.unwrap_or(1)).ok().filter(|&step| step > 0)?;
        Some((start..stop).step_by(step))
    }
}

type Result<T> = std::result::Result<T, PickleError>;

impl Node<'_> {
    /// Reads a `slice`.
    ///
    /// # Errors
    /// When the object is of another kind; so for all that follow.
    pub fn slice(&self) -> Result<Slice> {
        let parts: [Node<'_>; 3] = self.call("builtins.slice")?.args().exact()?;
        let [start, stop, step] =
            parts.map(|part| part.option().map(|part| part.int()).transpose());
        Ok(Slice { start: start?, stop: stop?, step: step? })
    }

    /// Reads a `decimal.Decimal` as its text: `1.50`, `NaN`.
    ///
    /// # Errors
    /// As [`Self::slice`].
    pub fn decimal(&self) -> Result<&str> {
        let [text] = self.call("decimal.Decimal")?.args().exact()?;
        text.str()
    }

    /// Reads a `datetime.datetime`.
    ///
    /// # Errors
    /// As [`Self::slice`].
    pub fn datetime(&self) -> Result<DateTime> {
        let args = self.call("datetime.datetime")?.args();
        let bytes = args.get(0)?.bytes()?;
        let local = match *bytes {
            [y, year, month, day, hour, minute, second, a, b, c] => {
                // The highest bit of the month marks the second pass of an hour that comes twice.
                date(y, year, month & 0x7F, day)
                    .and_then(|date| Some(date.and_time(time(hour, minute, second, [a, b, c])?)))
            }
            _ => None,
        };
        let local = local.ok_or_else(|| self.invalid("datetime", "no such date and time"))?;
        Ok(DateTime { local, offset: args.find(1).and_then(Node::option).map(offset).transpose()? })
    }

    /// Reads a `datetime.date`.
    ///
    /// # Errors
    /// As [`Self::slice`].
    pub fn date(&self) -> Result<NaiveDate> {
        let [bytes] = self.call("datetime.date")?.args().exact()?;
        let date = match *bytes.bytes()? {
            [y, year, month, day] => date(y, year, month, day),
            _ => None,
        };
        date.ok_or_else(|| self.invalid("date", "no such date"))
    }

    /// Reads a `datetime.time`, with its offset from UTC where it has one.
    ///
    /// # Errors
    /// As [`Self::slice`].
    pub fn time(&self) -> Result<(NaiveTime, Option<FixedOffset>)> {
        let args = self.call("datetime.time")?.args();
        let time = match *args.get(0)?.bytes()? {
            [hour, minute, second, a, b, c] => time(hour & 0x7F, minute, second, [a, b, c]),
            _ => None,
        };
        let time = time.ok_or_else(|| self.invalid("time", "no such time"))?;
        Ok((time, args.find(1).and_then(Node::option).map(offset).transpose()?))
    }

    /// Reads a `datetime.timedelta`, to the microsecond.
    ///
    /// # Errors
    /// As [`Self::slice`].
    pub fn timedelta(&self) -> Result<TimeDelta> {
        let [days, seconds, micros] = self.call("datetime.timedelta")?.args().exact()?;
        let delta = TimeDelta::try_days(days.int()?)
            .zip(TimeDelta::try_seconds(seconds.int()?))
            .and_then(|(days, seconds)| days.checked_add(&seconds))
            .and_then(|delta| delta.checked_add(&TimeDelta::microseconds(micros.int().ok()?)));
        delta.ok_or_else(|| self.invalid("timedelta", "larger than can be"))
    }
}

fn date(y: u8, year: u8, month: u8, day: u8) -> Option<NaiveDate> {
    let year = u16::from_be_bytes([y, year]);
    NaiveDate::from_ymd_opt(year.into(), month.into(), day.into())
        .filter(|_| (1..=9999).contains(&year))
}

fn time(hour: u8, minute: u8, second: u8, [a, b, c]: [u8; 3]) -> Option<NaiveTime> {
    let micros = u32::from_be_bytes([0, a, b, c]);
    NaiveTime::from_hms_micro_opt(hour.into(), minute.into(), second.into(), micros)
        .filter(|_| micros < 1_000_000)
}

/// The offset of a `datetime.timezone`, to the second.
fn offset(zone: Node<'_>) -> Result<FixedOffset> {
    let delta = match zone.call("datetime.timezone")?.arg(0)?.view() {
        View::Call(call) => call.node().timedelta()?,
        _ => return Err(zone.unexpected("a timezone with an offset")),
    };
    let seconds = i32::try_from(delta.num_seconds()).ok().filter(|_| delta.subsec_nanos() == 0);
    seconds
        .and_then(FixedOffset::east_opt)
        .ok_or_else(|| zone.invalid("timezone", "no offset of whole seconds within a day"))
}
