//! The time stamp that travels with a message.
//!
//! ```text
//!   envelope   "42 1700000000.5"                                    with any message
//!   data       256 2 │ 1 count │ 10 seconds     (V4: code 20)       as a message of its own
//! ```

use crate::bottle::significant;
use crate::{Bottle, Value, WireLimits};

/// Significant digits of the time in an envelope: C's `DBL_DIG`. Of today's times, microseconds
/// survive.
const DIGITS: i32 = 15;

/// Time at which a message was made, and its number: YARP's `Stamp`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stamp {
    /// Number of the message, counting up.
    pub count: i32,
    /// Time in seconds, since 1970 unless the sender says otherwise.
    pub time_s: f64,
}

impl Stamp {
    /// The stamp in an envelope: `42 1700000000.5`. None where the envelope is something else.
    pub fn from_envelope(envelope: &[u8]) -> Option<Self> {
        let limits =
            WireLimits { max_message_bytes: 1 << 10, max_depth: 2, ..WireLimits::default() };
        Self::from_bottle(&Bottle::from_text(envelope, &limits).ok()?)
    }

    /// The envelope as YARP writes it: 15 significant digits.
    pub fn to_envelope(&self) -> String {
        format!("{} {}", self.count, significant(self.time_s, DIGITS))
    }

    /// The stamp that a bottle is: a whole number, then a time. YARP allows a third element, the
    /// name of a frame as in a ROS header; it is ignored.
    pub fn from_bottle(bottle: &Bottle) -> Option<Self> {
        let ([count, time] | [count, time, Value::String(_)]) = bottle.values.as_slice() else {
            return None;
        };
        Some(Self { count: count.as_i64()?.try_into().ok()?, time_s: time.as_f64()? })
    }
}
