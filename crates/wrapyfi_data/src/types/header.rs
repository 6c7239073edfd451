//! Time and coordinate frame of a message: `std_msgs/msg/Header`, whichever payload it is part of.

use super::{Map, NativeObject, Payload, RosMessage, RosType, RosValueError, Stamp, Value};

/// Time and coordinate frame of a message.
///
/// ```
/// use wrapyfi_data::types::{Header, Map, Stamp, Value};
/// let header = Header { stamp: Stamp { sec: 5, nanosec: 0 }, frame_id: "map".into() };
/// let pose = Value::from(Map::from([("header", header.to_fields())]));
/// assert_eq!(Header::of_fields(&pose), Some(header));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Header {
    /// Time at which the message was made; zero where the sender does not say.
    pub stamp: Stamp,
    /// Coordinate frame; empty where the sender names none.
    pub frame_id: String,
}

impl Header {
    /// Reads the member `header` of a dict of fields, if it has the fields of one; else the dict
    /// itself, if it has a `stamp`, as `std_msgs/msg/Header` and `rcl_interfaces/msg/Log` do.
    pub fn of_fields(fields: &Value) -> Option<Self> {
        let header = fields.get("header").unwrap_or(fields);
        let time = header.get("stamp")?;
        let sec = i32::try_from(time.get("sec")?.as_i64()?).ok()?;
        let nanosec = u32::try_from(time.get("nanosec")?.as_i64()?).ok()?;
        let frame_id = header.get("frame_id").and_then(Value::as_str).unwrap_or_default();
        Some(Self { stamp: Stamp { sec, nanosec }, frame_id: frame_id.to_owned() })
    }

    /// Writes the dict that [`Header::of_fields`] reads.
    pub fn to_fields(&self) -> Map {
        Map::from([("stamp", self.time()), ("frame_id", self.frame_id.as_str().into())])
    }

    /// Writes the time as the fields of a `builtin_interfaces/msg/Time`.
    fn time(&self) -> Value {
        let Stamp { sec, nanosec } = self.stamp;
        Map::from([("sec", Value::from(sec)), ("nanosec", nanosec.into())]).into()
    }
}

/// Changes to a header.
///
/// ```
/// use wrapyfi_data::types::{HeaderChange, Payload, Value};
/// let mut payload = Payload::from(Value::from(1.5));
/// let change = HeaderChange { frame_id: Some("map"), ..HeaderChange::default() };
/// payload.change_header(&change, 1 << 20)?;
/// assert!(matches!(payload, Payload::NativeObject(object) if object.frame_id == "map"));
/// # Ok::<(), wrapyfi_data::types::RosValueError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct HeaderChange<'a> {
    /// New time; `None` leaves it.
    pub stamp: Option<Stamp>,
    /// New coordinate frame; `None` leaves it.
    pub frame_id: Option<&'a str>,
}

impl Payload {
    /// Changes the header. A payload without a header (properties, most ROS types) stays as it is,
    /// at no cost; that of a ROS message is changed by reading and writing all fields.
    ///
    /// # Errors
    /// When the bytes of a ROS message are none of its type, or more than `max_bytes`.
    #[doc(hidden)]
    pub fn change_header(
        &mut self,
        change: &HeaderChange<'_>,
        max_bytes: usize,
    ) -> Result<(), RosValueError> {
        let (stamp, frame_id) = match self {
            Self::NativeObject(object) => {
                let NativeObject { stamp, frame_id, .. } = object.as_mut();
                (stamp, frame_id)
            }
            Self::Image(image) => (&mut image.stamp, &mut image.frame_id),
            Self::AudioChunk(sound) => (&mut sound.stamp, &mut sound.frame_id),
            Self::RosMessage(message) => return message.change_header(change, max_bytes),
            Self::Properties(_) => return Ok(()),
        };
        if let Some(to) = change.stamp {
            *stamp = to;
        }
        if let Some(to) = change.frame_id {
            to.clone_into(frame_id);
        }
        Ok(())
    }
}

impl RosMessage {
    fn change_header(
        &mut self,
        change: &HeaderChange<'_>,
        max_bytes: usize,
    ) -> Result<(), RosValueError> {
        if !self.ros_type.has_header() || *change == HeaderChange::default() {
            return Ok(());
        }
        let mut fields = self.fields(max_bytes)?;
        if let Some(Stamp { sec, nanosec }) = change.stamp {
            fields.set("header.stamp.sec", sec)?;
            fields.set("header.stamp.nanosec", nanosec)?;
        }
        if let Some(frame_id) = change.frame_id {
            fields.set("header.frame_id", frame_id)?;
        }
        *self = Self::from_fields(self.ros_type, &fields)?;
        Ok(())
    }

    /// Converts a dict of fields to a message. Missing fields have their default value, but a
    /// missing header is `header`, and so is a missing `stamp` in a message without header.
    ///
    /// # Errors
    /// As [`RosMessage::from_value`].
    #[doc(hidden)]
    pub fn from_value_with(
        ros_type: RosType,
        mut value: Value,
        header: impl FnOnce() -> Header,
        max_bytes: usize,
    ) -> Result<Self, RosValueError> {
        if let Value::Map(fields) = &mut value {
            if ros_type.has_header() && fields.get("header").is_none() {
                fields.insert("header", header().to_fields());
            } else if ros_type.has_stamp() && fields.get("stamp").is_none() {
                fields.insert("stamp", header().time());
            }
        }
        Self::from_value(ros_type, &value, max_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{Encoding, Image};
    use crate::types::{MessageType, RawPixels};
    use wrapyfi_interfaces::store::TypeStore;

    const THEN: Stamp = Stamp { sec: 5, nanosec: 7 };

    fn ros_type(name: &str) -> RosType {
        match MessageType::resolve(name, &mut TypeStore::generated()).unwrap() {
            MessageType::Ros(ros_type) => ros_type,
            other => panic!("{other}"),
        }
    }

    fn head() -> Header {
        Header { stamp: THEN, frame_id: "head".into() }
    }

    #[test]
    fn a_dict_without_a_header_gets_one_and_one_with_keeps_its_own() {
        let joints = ros_type("sensor_msgs/msg/JointState");
        assert!(joints.has_header() && !ros_type("geometry_msgs/msg/Twist").has_header());
        let read = |value: Value| {
            let message = RosMessage::from_value_with(joints, value, head, 1 << 20).unwrap();
            Header::of_fields(&message.to_value(1 << 20).unwrap()).unwrap()
        };
        assert_eq!(read(Map::from([("position", Value::List(vec![0.5.into()]))]).into()), head());
        let own = Header { stamp: Stamp { sec: 1, nanosec: 0 }, frame_id: "arm".into() };
        assert_eq!(read(Map::from([("header", own.to_fields())]).into()), own);
        let twist = ros_type("geometry_msgs/msg/Twist");
        RosMessage::from_value_with(twist, Map::new().into(), head, 1 << 20).unwrap();
        let itself = ros_type("std_msgs/msg/Header");
        let named = Map::from([("frame_id", "arm")]);
        let message = RosMessage::from_value_with(itself, named.into(), head, 1 << 20).unwrap();
        let stamped = Header { stamp: THEN, frame_id: "arm".into() };
        assert_eq!(Header::of_fields(&message.to_value(1 << 20).unwrap()).unwrap(), stamped);
    }

    #[test]
    fn headers_change_and_all_else_stays() {
        let joints = ros_type("sensor_msgs/msg/JointState");
        let names: Value = ["a", "bc"].into_iter().collect();
        let fields = Map::from([("name", names.clone())]);
        let message =
            RosMessage::from_value_with(joints, fields.into(), Header::default, 1 << 20).unwrap();
        let raw = RawPixels::dense(1, 1, Encoding::Mono8, vec![7]).unwrap();
        let all = [
            Payload::from(Value::from(5)),
            Image::new(Stamp::default(), raw).into(),
            message.clone().into(),
        ];
        let change = HeaderChange { stamp: Some(THEN), frame_id: Some("head") };
        for mut payload in all {
            let kind = payload.data_type();
            payload.change_header(&HeaderChange::default(), 1 << 20).unwrap();
            payload.change_header(&change, 1 << 20).unwrap();
            let found = match payload {
                Payload::NativeObject(object) => {
                    assert_eq!(object.value, Value::from(5));
                    Header { stamp: object.stamp, frame_id: object.frame_id }
                }
                Payload::Image(image) => Header { stamp: image.stamp, frame_id: image.frame_id },
                Payload::RosMessage(message) => {
                    let value = message.to_value(1 << 20).unwrap();
                    assert_eq!(value.get("name"), Some(&names));
                    Header::of_fields(&value).unwrap()
                }
                other => panic!("{other:?}"),
            };
            assert_eq!(found, head(), "{kind}");
        }
        let mut cut = Payload::from(RosMessage::new(joints, message.cdr.slice(..8)));
        assert!(cut.change_header(&change, 1 << 20).is_err());
    }
}
