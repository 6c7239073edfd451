//! The steps of regular times, `freq` of an index, in the words of pandas 2.2 and later.
//!
//! ```text
//!   offsets.Minute(15, False) ◀─▶ 15min        offsets.QuarterBegin(2, False, 2) ◀─▶ 2QS-FEB
//! ```

use super::super::PluginError;
use crate::pickle::{Node, PickleError, Writer};

/// Kind of the suffix behind the code: `W-MON`, `QE-DEC`, `SME-15`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Anchor {
    None,
    Weekday,
    Month,
    Day,
}

/// pandas's classes, whose names are stable, and their codes, which were others before 2.2.
const OFFSETS: [(&str, &str, Anchor); 24] = [
    ("Day", "D", Anchor::None),
    ("Hour", "h", Anchor::None),
    ("Minute", "min", Anchor::None),
    ("Second", "s", Anchor::None),
    ("Milli", "ms", Anchor::None),
    ("Micro", "us", Anchor::None),
    ("Nano", "ns", Anchor::None),
    ("BusinessDay", "B", Anchor::None),
    ("MonthEnd", "ME", Anchor::None),
    ("MonthBegin", "MS", Anchor::None),
    ("BusinessMonthEnd", "BME", Anchor::None),
    ("BusinessMonthBegin", "BMS", Anchor::None),
    ("Week", "W", Anchor::Weekday),
    ("QuarterEnd", "QE", Anchor::Month),
    ("QuarterBegin", "QS", Anchor::Month),
    ("BQuarterEnd", "BQE", Anchor::Month),
    ("BQuarterBegin", "BQS", Anchor::Month),
    ("YearEnd", "YE", Anchor::Month),
    ("YearBegin", "YS", Anchor::Month),
    ("BYearEnd", "BYE", Anchor::Month),
    ("BYearBegin", "BYS", Anchor::Month),
    ("SemiMonthEnd", "SME", Anchor::Day),
    ("SemiMonthBegin", "SMS", Anchor::Day),
    // A week that counts from any day has no anchor.
    ("Week", "W", Anchor::None),
];

const WEEKDAYS: [&str; 7] = ["MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN"];
const MONTHS: [&str; 12] =
    ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];

impl Anchor {
    fn text(self, number: i64) -> Option<String> {
        let from = |names: &[&str], first: i64| {
            let place = usize::try_from(number.checked_sub(first)?).ok()?;
            names.get(place).map(|name| (*name).to_owned())
        };
        match self {
            Self::None => None,
            Self::Weekday => from(&WEEKDAYS, 0),
            Self::Month => from(&MONTHS, 1),
            Self::Day => (1..=31).contains(&number).then(|| number.to_string()),
        }
    }

    fn number(self, text: &str) -> Option<i64> {
        let place = |names: &[&str]| {
            let place = names.iter().position(|name| *name == text)?;
            i64::try_from(place).ok()
        };
        match self {
            Self::None => None,
            Self::Weekday => place(&WEEKDAYS),
            Self::Month => place(&MONTHS).map(|place| place + 1),
            Self::Day => text.parse().ok().filter(|day| (1..=31).contains(day)),
        }
    }
}

/// Reads an offset; nothing for `None`, the step of times that are not regular.
pub(super) fn read(node: &Node<'_>) -> Result<Option<String>, PickleError> {
    let Some(node) = node.option() else { return Ok(None) };
    let call = node.any_call()?;
    let unknown = || node.unexpected("a step of pandas that is read here");
    let (class, args) = (call.global(), call.args());
    let anchor = args.find(2).and_then(|anchor| anchor.int().ok());
    let found = OFFSETS.iter().find(|(name, _, kind)| {
        class.module == "pandas._libs.tslibs.offsets"
            && *name == class.name
            && (*kind == Anchor::None || anchor.is_some())
    });
    let (name, code, kind) = found.ok_or_else(unknown)?;
    if call.arg(1)?.bool()? {
        return Err(node.unexpected("a step that does not move times to midnight"));
    }
    // A business day may have a time of day besides.
    if *name == "BusinessDay" && args.find(2).is_some_and(|more| !is_zero(&more)) {
        return Err(unknown());
    }
    let count = match call.arg(0)?.int()? {
        1 => String::new(),
        count => count.to_string(),
    };
    let anchor = match anchor.filter(|_| *kind != Anchor::None) {
        Some(number) => format!("-{}", kind.text(number).ok_or_else(unknown)?),
        None => String::new(),
    };
    Ok(Some(format!("{count}{code}{anchor}")))
}

fn is_zero(delta: &Node<'_>) -> bool {
    delta.timedelta().is_ok_and(|delta| delta.is_zero())
}

/// Writes the offset that `text` says.
pub(super) fn write(to: &mut Writer, text: &str) -> Result<(), PluginError> {
    let unknown = || {
        PluginError::unsupported(
            format!("times whose freq is {text:?}"),
            "leave it out, or use a code of pandas such as 15min, D, W-MON or QS-JAN",
        )
    };
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '-').ok_or_else(unknown)?;
    let (count, code) = text.split_at(digits);
    let count = match count {
        "" => 1,
        "-" => -1,
        count => count.parse().map_err(|_no_number| unknown())?,
    };
    let (code, anchor) = match code.split_once('-') {
        Some((code, anchor)) => (code, Some(anchor)),
        None => (code, None),
    };
    let found = OFFSETS
        .iter()
        .find(|(_, known, kind)| *known == code && (*kind == Anchor::None) == anchor.is_none());
    let (class, _, kind) = found.ok_or_else(unknown)?;
    to.global("pandas._libs.tslibs.offsets", class).mark().int(count).bool(false);
    if let Some(anchor) = anchor {
        to.int(kind.number(anchor).ok_or_else(unknown)?);
    }
    to.tuple_since_mark().reduce();
    Ok(())
}
