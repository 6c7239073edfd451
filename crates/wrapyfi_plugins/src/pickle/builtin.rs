//! Values of Python's standard library as pickles describe them.

use std::iter::StepBy;
use std::ops::Range;

use chrono::{FixedOffset, NaiveDate, NaiveTime, TimeDelta};

use super::error::PickleError;
use super::node::{Node, View};
use wrapyfi_data::types::DateTime;

type Result<T> = std::result::Result<T, PickleError>;

impl Node<'_> {
    /// Reads a `slice` as the indices from its start to its stop; `None` where it does not count up.
    ///
    /// # Errors
    /// When the object is of another kind; so for all that follow.
    pub fn slice(&self) -> Result<Option<StepBy<Range<usize>>>> {
        let parts: [Node<'_>; 3] = self.call("builtins.slice")?.args().exact()?;
        let [start, stop, step] =
            parts.map(|part| part.option().map(|part| part.int()).transpose());
        let size = |part| usize::try_from(part).ok();
        let (start, step) = (size(start?.unwrap_or(0)), size(step?.unwrap_or(1)));
        let range = start.zip(stop?.and_then(size)).map(|(start, stop)| start..stop);
        let step = step.filter(|&step| step > 0);
        Ok(range.zip(step).map(|(range, step)| range.step_by(step)))
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
