//! Quantiles, medians, slopes, and how sure a figure is.

/// Number of times that the rounds are drawn again for an interval.
pub(crate) const RESAMPLES: usize = 10_000;
/// Fewest rounds that an interval is given for: with six, the lowest and the highest hold the
/// median between them with a probability of 1 - 2 / 2^6 = 97 %, with five only 94 %.
pub(crate) const FEWEST: usize = 6;
/// Seed of the draws: always the same, so that the same figures give the same interval.
const SEED: u64 = 0x5EED;

/// The value below which `fraction` of `values` lie, by the nearest rank.
pub(crate) fn quantile(values: &[f64], fraction: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let rank = (sorted.len() as f64 * fraction).ceil() as usize;
    sorted.get(rank.saturating_sub(1).min(sorted.len().checked_sub(1)?)).copied()
}

/// The middle value; the mean of the two middle ones of an even number.
pub(crate) fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    if sorted.len() % 2 == 1 {
        return Some(upper);
    }
    Some(f64::midpoint(upper, *sorted.get(sorted.len() / 2 - 1)?))
}

/// Slope of the least-squares line through `(x, y)` points.
pub(crate) fn slope(points: &[(f64, f64)]) -> Option<f64> {
    #[allow(clippy::cast_precision_loss)]
    let n = points.len() as f64;
    let (sx, sy) = points.iter().fold((0.0, 0.0), |(sx, sy), (x, y)| (sx + x, sy + y));
    let (mx, my) = (sx / n, sy / n);
    let (top, bottom) = points.iter().fold((0.0, 0.0), |(top, bottom), (x, y)| {
        (top + (x - mx) * (y - my), bottom + (x - mx) * (x - mx))
    });
    (bottom > 0.0).then(|| top / bottom)
}

/// Bootstrap interval of 95 % of a `statistic` of `rounds` rounds: they are drawn with replacement
/// [`RESAMPLES`] times, and the statistic of the drawn ones lies between the bounds in 95 % of the
/// cases. Whole rounds are drawn, so what drifts together stays together.
///
/// The statistic is told the indices that were drawn, from 0 on. `None` for fewer rounds than
/// [`FEWEST`], and where the statistic has no value.
pub(crate) fn interval(
    rounds: usize,
    statistic: impl Fn(&[usize]) -> Option<f64>,
) -> Option<(f64, f64)> {
    if rounds < FEWEST {
        return None;
    }
    let mut state = SEED;
    let mut drawn = vec![0; rounds];
    let mut found = Vec::with_capacity(RESAMPLES);
    for _ in 0..RESAMPLES {
        drawn.fill_with(|| below(&mut state, rounds));
        found.push(statistic(&drawn).filter(|value| value.is_finite())?);
    }
    Some((quantile(&found, 0.025)?, quantile(&found, 0.975)?))
}

/// A number below `end`, evenly: the high half of a product with SplitMix64's next number.
fn below(state: &mut u64, end: usize) -> usize {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut mixed = *state;
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    mixed ^= mixed >> 31;
    #[allow(clippy::cast_possible_truncation)]
    let number = ((u128::from(mixed) * end as u128) >> 64) as usize;
    number
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64], drawn: &[usize]) -> Vec<f64> {
        drawn.iter().map(|&index| values[index]).collect()
    }

    #[test]
    fn the_interval_of_a_median_is_where_the_binomial_puts_it() {
        // The median of 7 draws from 1..=7 is at most k where at least 4 of them are:
        // P(Bin(7, 1/7) >= 4) = 0.010 and P(Bin(7, 2/7) >= 4) = 0.108, so 2.5 % falls on 2,
        // and 97.5 % on 6 by symmetry.
        let values: Vec<f64> = (1..=7).map(f64::from).collect();
        let found = interval(7, |drawn| median(&of(&values, drawn)));
        assert_eq!(found, Some((2.0, 6.0)));
    }

    #[test]
    fn the_interval_of_a_lowest_value_is_where_the_powers_put_it() {
        // All 6 draws miss 1 in (5/6)^6 = 33 % of the cases, 1 and 2 in (4/6)^6 = 8.8 %, 1 to 3 in
        // (3/6)^6 = 1.6 %: 97.5 % of the lowest values are at most 3.
        let values: Vec<f64> = (1..=6).map(f64::from).collect();
        let found = interval(6, |drawn| quantile(&of(&values, drawn), 0.0));
        assert_eq!(found, Some((1.0, 3.0)));
    }

    #[test]
    fn a_ratio_of_what_drifts_together_is_certain() {
        let parts = [100.0, 900.0, 300.0, 50.0, 700.0, 200.0, 400.0];
        let whole = parts.map(|part| part * 2.0);
        let ratio =
            |drawn: &[usize]| Some(median(&of(&whole, drawn))? / median(&of(&parts, drawn))?);
        assert_eq!(interval(7, ratio), Some((2.0, 2.0)));
    }

    #[test]
    fn too_little_has_no_interval() {
        assert_eq!(interval(5, |_| Some(1.0)), None);
        assert_eq!(interval(6, |_| Some(1.0)), Some((1.0, 1.0)));
        assert_eq!(interval(6, |_| None), None);
        assert_eq!(interval(6, |_| Some(f64::NAN)), None);
    }

    #[test]
    fn draws_are_even_and_always_the_same() {
        let mut state = SEED;
        let mut counts = [0_u32; 10];
        for _ in 0..100_000 {
            counts[below(&mut state, 10)] += 1;
        }
        // Standard deviation 95.
        assert!(counts.iter().all(|&count| (9_500..10_500).contains(&count)), "{counts:?}");
        let spread = |drawn: &[usize]| Some(drawn.iter().sum::<usize>() as f64);
        assert_eq!(interval(20, spread), interval(20, spread));
    }

    #[test]
    fn ranks() {
        let values: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(quantile(&values, 0.5), Some(50.0));
        assert_eq!(quantile(&values, 0.99), Some(99.0));
        assert_eq!(quantile(&values, 1.0), Some(100.0));
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0]), Some(2.5));
    }

    #[test]
    fn slopes() {
        assert_eq!(slope(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]), Some(2.0));
        assert_eq!(slope(&[(1.0, 1.0)]), None);
    }
}
