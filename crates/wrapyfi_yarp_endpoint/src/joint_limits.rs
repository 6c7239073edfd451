//! Limits of the joints of a control board, as the board tells them; a movement beyond is reported
//! once a joint.
//!
//! ```text
//!   [get] [llim] 0 ─▶ [is] [llim] -30.0 22.0 …     in YARP's units
//!   neck_pitch to 1.57 rad ─▶ a warning, and on to the board, which keeps its limits itself
//! ```

use std::collections::BTreeSet;
use wrapyfi_endpoint::Mutex;

/// Least and greatest position of a joint, in YARP's units.
pub(super) type Range = (f64, f64);

/// Limits of the joints of a board, in its order; none where it has told none.
#[derive(Debug, Default)]
pub struct JointLimits {
    ranges: Vec<Option<Range>>,
    /// Joints that were named.
    named: Mutex<BTreeSet<usize>>,
}

impl PartialEq for JointLimits {
    fn eq(&self, other: &Self) -> bool {
        self.ranges == other.ranges
    }
}

impl JointLimits {
    /// Limits as they were told. Those that leave no room were never set.
    pub(super) fn new(told: Vec<Option<Range>>) -> Self {
        let is_set = |(least, most): &Range| least < most;
        let ranges = told.into_iter().map(|range| range.filter(is_set)).collect();
        Self { ranges, named: Mutex::default() }
    }

    /// The limits of a joint that `value` is beyond, the first time that it is.
    pub(super) fn news(&self, joint: usize, value: f64) -> Option<Range> {
        let range = self.ranges.get(joint).copied().flatten()?;
        if (range.0..=range.1).contains(&value) {
            return None;
        }
        let mut named = self.named.lock();
        named.insert(joint).then_some(range)
    }
}

/// Warning about the joint `joint` that shall go beyond its limits. Joints that turn are given in
/// radians and degrees; `in_degrees` says in which of them YARP has them.
pub(super) fn warning(
    joint: &str,
    value: f64,
    (least, most): Range,
    turns: bool,
    in_degrees: bool,
) -> String {
    let shown = |value: f64| match (turns, in_degrees) {
        (false, _) => format!("{value:.3} m"),
        (true, true) => format!("{:.3} rad ({value:.1}°)", value.to_radians()),
        (true, false) => format!("{value:.3} rad ({:.1}°)", value.to_degrees()),
    };
    let wanted = shown(value);
    format!(
        "joint {joint} is to go to {wanted}, beyond its limits, {} and {}: the board goes no further \
         than those, or refuses",
        shown(least),
        shown(most)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_joint_that_goes_beyond_its_limits_is_named_once() {
        let limits = JointLimits::new(vec![Some((-30.0, 22.0)), None, Some((0.0, 0.0))]);
        for inside in [-30.0, 0.0, 22.0] {
            assert_eq!(limits.news(0, inside), None);
        }
        assert_eq!(limits.news(0, 22.5), Some((-30.0, 22.0)));
        assert_eq!(limits.news(0, -31.0), None, "it was named");
        for (joint, why) in [(1, "it told none"), (2, "never set"), (3, "no such joint")] {
            assert_eq!(limits.news(joint, 1e9), None, "{why}");
        }
    }

    #[test]
    fn limits_are_told_in_both_units_of_angles() {
        let text = warning("neck", 90.0, (-30.0, 22.0), true, true);
        assert!(text.contains("neck is to go to 1.571 rad (90.0°)"), "{text}");
        assert!(text.contains("-0.524 rad (-30.0°) and 0.384 rad (22.0°)"), "{text}");
        let same = warning("neck", 1.571, (-0.5, 0.384), true, false);
        assert!(same.contains("1.571 rad (90.0°)"), "{same}");
        let heave = warning("heave", 0.5, (0.0, 0.1), false, true);
        assert!(heave.contains("0.500 m") && !heave.contains("rad"), "{heave}");
    }
}
