//! Head orientation: two stand-ins for sensors, and the neck of a simulated robot.
//!
//! # Both sensors are stand-ins
//!
//! The paper has an eye tracker with an IMU, and a neural network that estimates the pose of a head in
//! a picture. Here the first is a slow circle, the second the place of what is bright in a frame. They
//! show the choice between two sources; put yours in their place.
//!
//! ```text
//!   worn_stand_in(seq) ─▶ roll, pitch, yaw and gaze ──┐
//!                                                     ├─▶ Neck::follow ─▶ joints within their limits
//!   seen_stand_in(frame) ─▶ pitch, yaw ───────────────┘
//! ```

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use wrapyfi_core::types::RawPixels;

use crate::picture;

/// Orientation of a head, in degrees; a dict in Python.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Orientation {
    /// `worn` or `seen`.
    pub source: String,
    /// Counts what this source measured.
    pub seq: u32,
    /// Towards the shoulder.
    pub roll_deg: f64,
    /// Up.
    pub pitch_deg: f64,
    /// Angle to the left.
    pub yaw_deg: f64,
    /// Right and up, -1 to 1; only an eye tracker knows.
    pub gaze: Option<(f64, f64)>,
}

/// Stands in for an eye tracker with an IMU: a head that goes round, 40 steps each time, with the eyes
/// ahead of it.
#[must_use]
pub fn worn_stand_in(seq: u32) -> Orientation {
    let turn = f64::from(seq % 40) / 40.0 * TAU;
    Orientation {
        source: "worn".to_owned(),
        seq,
        roll_deg: 5.0 * turn.sin(),
        pitch_deg: 20.0 * turn.sin(),
        yaw_deg: 70.0 * turn.cos(),
        gaze: Some(((turn + 0.3).cos(), (turn + 0.3).sin())),
    }
}

/// Stands in for a network that sees heads: where the brightness of a frame has its middle. `None` for a
/// black frame.
#[must_use]
pub fn seen_stand_in(seq: u32, pixels: &RawPixels) -> Option<Orientation> {
    let width = usize::try_from(pixels.width).ok().filter(|width| *width > 0)?;
    let (mut all, mut columns, mut rows) = (0_u64, 0_u64, 0_u64);
    for (place, grey) in picture::greys(pixels).enumerate() {
        let grey = u64::from(grey);
        all += grey;
        columns += grey * (place % width) as u64;
        rows += grey * (place / width) as u64;
    }
    // -1 to 1 from one edge to the other.
    let middle = |sum: u64, length: u32| {
        let mean = (all > 0).then(|| exact(sum) / exact(all))?;
        Some(2.0 * mean / f64::from(length.max(2) - 1) - 1.0)
    };
    Some(Orientation {
        source: "seen".to_owned(),
        seq,
        roll_deg: 0.0,
        pitch_deg: -40.0 * middle(rows, pixels.height)?,
        yaw_deg: -60.0 * middle(columns, pixels.width)?,
        gaze: None,
    })
}

/// Chooses between the two: what is worn, until it has been silent for a second.
#[derive(Debug, Clone, Copy, Default)]
pub struct Choice {
    worn_at: Option<Instant>,
}

impl Choice {
    /// The orientation to follow, of those that came just now.
    pub fn choose(
        &mut self,
        now: Instant,
        worn: Option<Orientation>,
        seen: Option<Orientation>,
    ) -> Option<Orientation> {
        if worn.is_some() {
            self.worn_at = Some(now);
            return worn;
        }
        let silent = |at| now.saturating_duration_since(at) > Duration::from_secs(1);
        seen.filter(|_| self.worn_at.is_none_or(silent))
    }
}

/// Sums of a frame's brightness are far below 2^53.
fn exact(sum: u64) -> f64 {
    sum as f64
}

/// Least and largest angle of each joint, about those of iCub's neck.
const LIMITS_DEG: [(f64, f64); 3] = [(-40.0, 30.0), (-60.0, 60.0), (-50.0, 50.0)];

/// The head of a simulated robot.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct Head {
    /// Pitch, roll and yaw in degrees.
    pub neck_deg: [f64; 3],
    /// Tilt and version of the eyes in degrees.
    pub eyes_deg: [f64; 2],
}

impl Head {
    /// Moves to where the other head points, as far as the joints reach.
    pub fn follow(&mut self, other: &Orientation) {
        let wanted = [other.pitch_deg, other.roll_deg, other.yaw_deg];
        for ((joint, angle), (least, largest)) in
            self.neck_deg.iter_mut().zip(wanted).zip(LIMITS_DEG)
        {
            *joint = angle.clamp(least, largest);
        }
        // Without an eye tracker the eyes look ahead.
        let (right, up) = other.gaze.unwrap_or_default();
        self.eyes_deg = [30.0 * up.clamp(-1.0, 1.0), 30.0 * right.clamp(-1.0, 1.0)];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bright_place_is_where_the_head_looks() {
        let mut data = vec![0; 5 * 3 * 3];
        data[..3].fill(200); // the upper left corner
        let corner = seen_stand_in(1, &picture::bgr(5, 3, data).unwrap()).unwrap();
        assert_eq!((corner.pitch_deg, corner.yaw_deg, corner.gaze), (40.0, 60.0, None));
        let even = seen_stand_in(1, &picture::bgr(5, 3, vec![9; 45]).unwrap()).unwrap();
        assert_eq!((even.pitch_deg, even.yaw_deg), (0.0, 0.0));
        assert_eq!(seen_stand_in(1, &picture::bgr(5, 3, vec![0; 45]).unwrap()), None);
    }

    #[test]
    fn what_is_seen_is_followed_where_nothing_is_worn() {
        let (worn, seen) = (worn_stand_in(1), Orientation { gaze: None, ..worn_stand_in(2) });
        let start = Instant::now();
        let mut choice = Choice::default();
        let mut chosen = |after_ms, worn: Option<&Orientation>| {
            let now = start + Duration::from_millis(after_ms);
            choice.choose(now, worn.cloned(), Some(seen.clone())).map(|chosen| chosen.seq)
        };
        assert_eq!(chosen(0, None), Some(2));
        assert_eq!(chosen(10, Some(&worn)), Some(1));
        assert_eq!(chosen(1010, None), None);
        assert_eq!(chosen(1011, None), Some(2));
    }

    #[test]
    fn joints_stay_within_their_limits() {
        let mut head = Head::default();
        let worn = worn_stand_in(0);
        assert_eq!(worn.yaw_deg, 70.0);
        head.follow(&worn);
        assert_eq!(head.neck_deg, [0.0, 0.0, 50.0]);
        assert!(head.eyes_deg[0] > 0.0 && head.eyes_deg[1] > 0.0);
        head.follow(&Orientation { gaze: None, pitch_deg: -90.0, ..worn });
        assert_eq!((head.neck_deg[0], head.eyes_deg), (-40.0, [0.0, 0.0]));
    }
}
