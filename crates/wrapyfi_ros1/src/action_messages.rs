//! Messages of actionlib around goals, results and feedback, and the types of its topics.
//!
//! ```text
//!   goal               Header │ GoalID │ goal            cancel   GoalID
//!   result, feedback   Header │ GoalStatus │ part        status   Header │ GoalStatus …
//!   GoalID   time stamp │ string id                      GoalStatus   GoalID │ uint8 status │ string text
//! ```
//!
//! Ids are any bytes. Nothing is copied or allocated by a length that a message claims.

use std::collections::BTreeMap;
use std::fmt;

use bytes::{BufMut as _, Bytes};

use super::config::NAME;
use super::core::Core;
use wrapyfi_data::types::{RosAction, RosType, Stamp};
use wrapyfi_endpoint::codec::requests;
use wrapyfi_endpoint::codec::ros1::Ros1Type;
use wrapyfi_endpoint::{Clock, OpenError};

/// Longest id of a goal, in bytes.
pub(super) const MAX_ID_BYTES: usize = 4096;
/// Longest text of a status that is written, in bytes.
const MAX_TEXT_BYTES: usize = 4096;

/// Id of a goal.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct GoalId(pub(super) Vec<u8>);

impl fmt::Display for GoalId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", String::from_utf8_lossy(&self.0))
    }
}

/// A time of ROS 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct RosTime {
    pub(super) secs: u32,
    pub(super) nsecs: u32,
}

impl RosTime {
    const ZERO: Self = Self { secs: 0, nsecs: 0 };

    pub(super) fn is_zero(self) -> bool {
        self == Self::ZERO
    }

    /// The next time after this one.
    fn after(self) -> Self {
        match self.nsecs {
            999_999_999.. => Self { secs: self.secs.saturating_add(1), nsecs: 0 },
            nsecs => Self { nsecs: nsecs + 1, ..self },
        }
    }
}

impl From<Stamp> for RosTime {
    fn from(stamp: Stamp) -> Self {
        Self { secs: u32::try_from(stamp.sec).unwrap_or(0), nsecs: stamp.nanosec }
    }
}

/// `actionlib_msgs/GoalID`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct StampedId {
    pub(super) stamp: RosTime,
    pub(super) id: GoalId,
}

impl StampedId {
    /// True where a cancel with it means all goals.
    pub(super) fn is_all(&self) -> bool {
        *self == Self::default()
    }
}

/// State of a goal in a `actionlib_msgs/GoalStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum GoalState {
    Pending = 0,
    Active = 1,
    Preempted = 2,
    Succeeded = 3,
    Aborted = 4,
    Rejected = 5,
    Preempting = 6,
    Recalling = 7,
    Recalled = 8,
    Lost = 9,
}

impl GoalState {
    /// The state of a number; one that no state has means that the goal is lost.
    fn of(number: u8) -> Self {
        match number {
            0 => Self::Pending,
            1 => Self::Active,
            2 => Self::Preempted,
            3 => Self::Succeeded,
            4 => Self::Aborted,
            5 => Self::Rejected,
            6 => Self::Preempting,
            7 => Self::Recalling,
            8 => Self::Recalled,
            _ => Self::Lost,
        }
    }

    pub(super) fn is_end(self) -> bool {
        !matches!(self, Self::Pending | Self::Active | Self::Preempting | Self::Recalling)
    }
}

/// `actionlib_msgs/GoalStatus`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct GoalStatus {
    pub(super) goal: StampedId,
    pub(super) state: GoalState,
    pub(super) text: String,
}

/// States and texts of an `actionlib_msgs/GoalStatusArray`, by the ids of the goals.
pub(super) type Statuses<'m> = BTreeMap<&'m [u8], (GoalState, &'m [u8])>;

/// Bytes that are still to be read.
pub(super) struct Reader<'m>(pub(super) &'m [u8]);

impl<'m> Reader<'m> {
    pub(super) fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.bytes().map(u32::from_le_bytes)
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.bytes().map(u8::from_le_bytes)
    }

    pub(super) fn text(&mut self) -> Option<&'m [u8]> {
        let size = usize::try_from(self.u32()?).ok()?;
        let (text, rest) = self.0.split_at_checked(size)?;
        self.0 = rest;
        Some(text)
    }

    fn header(&mut self) -> Option<()> {
        let (_sequence, _secs, _nsecs) = (self.u32()?, self.u32()?, self.u32()?);
        self.text().map(drop)
    }

    fn goal_id(&mut self) -> Option<(RosTime, &'m [u8])> {
        let stamp = RosTime { secs: self.u32()?, nsecs: self.u32()? };
        Some((stamp, self.text()?))
    }

    fn stamped_id(&mut self) -> Option<StampedId> {
        let (stamp, id) = self.goal_id()?;
        (id.len() <= MAX_ID_BYTES).then(|| StampedId { stamp, id: GoalId(id.to_vec()) })
    }
}

/// Reads a goal: its id, and the bytes of the goal itself. `None` where the message is none, or its id is too long.
pub(super) fn read_goal(message: &Bytes) -> Option<(StampedId, Bytes)> {
    let mut reader = Reader(message);
    reader.header()?;
    let goal = reader.stamped_id()?;
    Some((goal, message.slice_ref(reader.0)))
}

/// Reads a result or feedback: the status of its goal, and the bytes of the part itself.
pub(super) fn read_part(message: &Bytes) -> Option<(GoalStatus, Bytes)> {
    let mut reader = Reader(message);
    reader.header()?;
    let (goal, state) = (reader.stamped_id()?, GoalState::of(reader.u8()?));
    let text = shown(reader.text()?);
    Some((GoalStatus { goal, state, text }, message.slice_ref(reader.0)))
}

/// Reads a wish to cancel.
pub(super) fn read_cancel(message: &[u8]) -> Option<StampedId> {
    Reader(message).stamped_id()
}

/// Reads the states of all goals.
pub(super) fn read_statuses(message: &[u8]) -> Option<Statuses<'_>> {
    let mut reader = Reader(message);
    reader.header()?;
    let mut statuses = Statuses::new();
    for _ in 0..reader.u32()? {
        let ((_stamp, id), state) = (reader.goal_id()?, reader.u8()?);
        statuses.insert(id, (GoalState::of(state), reader.text()?));
    }
    Some(statuses)
}

/// A text of another node, shortened.
pub(super) fn shown(text: &[u8]) -> String {
    let text = text.get(..MAX_TEXT_BYTES).unwrap_or(text);
    String::from_utf8_lossy(text).into_owned()
}

fn put_text(bytes: &mut Vec<u8>, text: &[u8]) {
    // Texts are much shorter than a size can say.
    bytes.put_u32_le(u32::try_from(text.len()).unwrap_or(0));
    bytes.put_slice(text);
}

/// Begin of a message with a header.
pub(super) fn header(sequence: u32, stamp: RosTime) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(128);
    [sequence, stamp.secs, stamp.nsecs].into_iter().for_each(|number| bytes.put_u32_le(number));
    put_text(&mut bytes, b"");
    bytes
}

pub(super) fn put_id(bytes: &mut Vec<u8>, StampedId { stamp, id }: &StampedId) {
    [stamp.secs, stamp.nsecs].into_iter().for_each(|number| bytes.put_u32_le(number));
    put_text(bytes, &id.0);
}

pub(super) fn put_status(bytes: &mut Vec<u8>, goal: &StampedId, state: GoalState, text: &str) {
    put_id(bytes, goal);
    bytes.put_u8(state as u8);
    put_text(bytes, requests::beginning(text, MAX_TEXT_BYTES).as_bytes());
}

/// Stamps of goals, each later than the one before: a goal that is not newer than another is cancelled by its server.
#[derive(Debug, Default)]
pub(super) struct Stamps(RosTime);

impl Stamps {
    pub(super) fn next(&mut self, clock: &Clock) -> RosTime {
        let now = RosTime::from(clock.ros_now().stamp);
        self.0 = now.max(self.0.after());
        self.0
    }

    /// A new id with its stamp.
    pub(super) fn next_id(&mut self, core: &Core, clock: &Clock) -> StampedId {
        let stamp = self.next(clock);
        let RosTime { secs, nsecs } = stamp;
        let id = format!("{}-{}-{secs}.{nsecs}", core.name.full(), core.next_id());
        StampedId { stamp, id: GoalId(id.into_bytes()) }
    }
}

/// Type of a topic whose messages are the same for all actions: on the wire, and in ROS 2.
pub(super) struct CommonType {
    pub(super) wire_type: Ros1Type,
    pub(super) ros_type: RosType,
}

/// Types of the topics `cancel` and `status`; from then on the node knows the definition of the action, too.
pub(super) fn common_types(
    core: &Core,
    action: &str,
    kind: RosAction,
) -> Result<[CommonType; 2], OpenError> {
    let mut types = core.types();
    types.add_ros2(kind.resolved());
    let mut common = |name: &str| {
        let unusable = |reason: String| {
            OpenError::transport(NAME, action, format!("{name} cannot be used on ROS 1: {reason}"))
        };
        let found = types.definition(name).map_err(|error| unusable(error.to_string()))?;
        let ros2 = types.ros2_type(&found.resolved).map_err(|error| unusable(error.to_string()))?;
        let ros_type = RosType::new(&ros2).map_err(|error| unusable(error.to_string()))?;
        let wire_type =
            Ros1Type { name: found.ros1_name(), md5: found.md5sum, definition: found.text };
        Ok::<_, OpenError>(CommonType { wire_type, ros_type })
    };
    Ok([common("actionlib_msgs/GoalID")?, common("actionlib_msgs/GoalStatusArray")?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamped(secs: u32, id: &str) -> StampedId {
        StampedId { stamp: RosTime { secs, nsecs: 7 }, id: GoalId(id.into()) }
    }

    #[test]
    fn messages_are_read_as_they_are_written() {
        let mut bytes = header(3, RosTime { secs: 1, nsecs: 2 });
        put_id(&mut bytes, &stamped(5, "/n-1-5.7"));
        bytes.extend_from_slice(b"goal");
        let (id, rest) = read_goal(&bytes.into()).unwrap();
        assert_eq!((id, &rest[..]), (stamped(5, "/n-1-5.7"), &b"goal"[..]));
        let mut bytes = header(3, RosTime::default());
        put_status(&mut bytes, &stamped(5, "a"), GoalState::Recalling, "text");
        let (status, rest) = read_part(&bytes.into()).unwrap();
        assert_eq!((status.state, status.text.as_str()), (GoalState::Recalling, "text"));
        assert!(rest.is_empty());
    }

    /// Ids that are no text, claims of many entries and of long texts, and cut messages.
    #[test]
    fn any_bytes_are_read_or_refused() {
        let mut bytes = header(0, RosTime::default());
        bytes.put_u32_le(2);
        let odd = StampedId { id: GoalId(vec![0xff, 0, 0xfe]), ..StampedId::default() };
        put_status(&mut bytes, &odd, GoalState::Active, "");
        put_status(&mut bytes, &stamped(1, ""), GoalState::Lost, "");
        assert_eq!(read_statuses(&bytes).unwrap().len(), 2);
        for cut in 0..bytes.len() {
            assert!(read_statuses(&bytes[..cut]).is_none(), "{cut}");
            let cut = Bytes::copy_from_slice(&bytes[..cut]);
            _ = (read_goal(&cut), read_part(&cut), read_cancel(&cut));
        }
        let mut claims = header(0, RosTime::default());
        claims.put_u32_le(u32::MAX);
        assert!(read_statuses(&claims).is_none());
        let long = StampedId { id: GoalId(vec![b'x'; MAX_ID_BYTES + 1]), ..StampedId::default() };
        let mut cancel = Vec::new();
        put_id(&mut cancel, &long);
        assert!(read_cancel(&cancel).is_none());
    }

    #[test]
    fn a_status_array_of_ten_thousand_entries_is_read() {
        let mut bytes = header(0, RosTime::default());
        bytes.put_u32_le(10_000);
        for number in 0..10_000 {
            put_status(&mut bytes, &stamped(number, &number.to_string()), GoalState::Active, "");
        }
        assert_eq!(read_statuses(&bytes).unwrap().len(), 10_000);
    }

    /// Also where the simulation stands still, or begins again.
    #[test]
    fn stamps_rise_strictly_in_simulated_time_too() {
        use wrapyfi_endpoint::RosNow;
        let at = |sec| {
            let stamp = Stamp { sec, nanosec: 999_999_999 };
            Clock::default().with_ros_time(move || RosNow { stamp, simulated: true })
        };
        let mut stamps = Stamps::default();
        let seen = [5, 5, 5, 3, 6].map(|sec| stamps.next(&at(sec)));
        assert!(seen.is_sorted_by(|one, two| one < two), "{seen:?}");
        assert_eq!(seen[0], RosTime { secs: 5, nsecs: 999_999_999 });
        assert_eq!(seen[1], RosTime { secs: 6, nsecs: 0 });
    }
}
