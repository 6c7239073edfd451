//! A figure made of several measurements, how sure it is, and what that says of a limit.
//!
//! ```text
//!   rounds     1    2    3  …           medians over the rounds ── combine ──▶ value
//!   bridge   684  603  812  …  ─┬─▶
//!   raw hop  313  291  472  …  ─┘       rounds drawn again, 10,000 times ────▶ interval of 95 %
//! ```

use std::collections::BTreeMap;

use crate::stats::{interval, median};

/// A measurement: its value in each round, by the number of the round.
pub(crate) type Series = BTreeMap<u32, f64>;

/// A figure and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate<const N: usize> {
    /// Medians of the measurements it is made of.
    pub(crate) parts: [f64; N],
    pub(crate) value: f64,
    /// Bootstrap interval of 95 %; `None` where there are too few rounds.
    pub(crate) interval: Option<(f64, f64)>,
}

impl<const N: usize> Estimate<N> {
    /// `combine` of the medians of `series`, over the rounds that all of them have.
    pub(crate) fn of(series: [&Series; N], combine: impl Fn([f64; N]) -> f64) -> Option<Self> {
        let first = series.first()?;
        let common: Vec<u32> = first
            .keys()
            .filter(|key| series.iter().all(|s| s.contains_key(key)))
            .copied()
            .collect();
        let columns = series
            .map(|s| common.iter().filter_map(|round| s.get(round).copied()).collect::<Vec<f64>>());
        let medians = |drawn: &[usize]| -> Option<[f64; N]> {
            let mut found = [0.0; N];
            for (found, column) in found.iter_mut().zip(&columns) {
                let values: Vec<f64> =
                    drawn.iter().filter_map(|&index| column.get(index).copied()).collect();
                *found = median(&values)?;
            }
            Some(found)
        };
        let all: Vec<usize> = (0..common.len()).collect();
        let parts = medians(&all)?;
        let interval = interval(common.len(), |drawn| medians(drawn).map(&combine));
        Some(Self { parts, value: combine(parts), interval })
    }
}

/// Promise about a figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Limit {
    AtMost(f64),
    AtLeast(f64),
}

/// Outcome of a promise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The whole interval keeps it.
    Met,
    /// The whole interval breaks it.
    Missed,
    /// The interval holds the limit, or there is none.
    Undecided,
}

impl Limit {
    /// Compares the promise with an interval.
    pub(crate) fn judge(self, interval: Option<(f64, f64)>) -> Verdict {
        let Some((low, high)) = interval else { return Verdict::Undecided };
        let (kept, broken) = match self {
            Self::AtMost(limit) => (high <= limit, low > limit),
            Self::AtLeast(limit) => (low >= limit, high < limit),
        };
        match (kept, broken) {
            (true, _) => Verdict::Met,
            (_, true) => Verdict::Missed,
            _ => Verdict::Undecided,
        }
    }
}

impl std::fmt::Display for Limit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::AtMost(limit) => write!(f, "at most {limit}"),
            Self::AtLeast(limit) => write!(f, "at least {limit}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(values: &[(u32, f64)]) -> Series {
        values.iter().copied().collect()
    }

    #[test]
    fn only_rounds_that_all_parts_have_count() {
        let whole = series(&[(1, 10.0), (2, 30.0), (3, 20.0), (4, 900.0)]);
        let part = series(&[(1, 5.0), (2, 4.0), (3, 6.0), (7, 800.0)]);
        let ratio = Estimate::of([&whole, &part], |[whole, part]| whole / part).unwrap();
        // Medians of 10, 30, 20 and of 5, 4, 6.
        assert_eq!(ratio, Estimate { parts: [20.0, 5.0], value: 4.0, interval: None });
        assert_eq!(Estimate::of([&whole, &series(&[(9, 1.0)])], |[a, b]| a / b), None);
    }

    #[test]
    fn the_interval_is_of_the_combination() {
        // As stats.rs works it out for the median of 1..=7, moved by ten.
        let one: Series = (1..=7).map(|round| (round, f64::from(round))).collect();
        let ten: Series = (1..=7).map(|round| (round, 10.0)).collect();
        let sum = Estimate::of([&one, &ten], |[one, ten]| one + ten).unwrap();
        assert_eq!(sum, Estimate { parts: [4.0, 10.0], value: 14.0, interval: Some((12.0, 16.0)) });
    }

    #[test]
    fn a_limit_inside_the_interval_decides_nothing() {
        let most = Limit::AtMost(1.3);
        assert_eq!(most.judge(Some((1.1, 1.3))), Verdict::Met);
        assert_eq!(most.judge(Some((1.2, 1.31))), Verdict::Undecided);
        assert_eq!(most.judge(Some((1.3, 1.4))), Verdict::Undecided);
        assert_eq!(most.judge(Some((1.31, 1.4))), Verdict::Missed);
        assert_eq!(most.judge(None), Verdict::Undecided);
        let least = Limit::AtLeast(10.0);
        assert_eq!(least.judge(Some((10.0, 12.0))), Verdict::Met);
        assert_eq!(least.judge(Some((9.0, 12.0))), Verdict::Undecided);
        assert_eq!(least.judge(Some((8.0, 9.9))), Verdict::Missed);
    }
}
