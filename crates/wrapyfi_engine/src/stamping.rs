//! Time and coordinate frame that the messages of a route get.
//!
//! | `stamp:` | time in the header |
//! | --- | --- |
//! | left out | the source's, as `source`; the node's while it uses simulated time and the source is outside ROS, whose clocks know nothing of it |
//! | `source` | the source's; where a native object has none, the node's |
//! | `ros_time` | the node's when the message is passed on: that of `/clock` with `use_sim_time`, else the system's |
//! | `arrival` | the system's when the message arrived |

use std::fmt;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::route::Route;
use wrapyfi_data::types::{HeaderChange, Payload, RosValueError, Stamp};
use wrapyfi_endpoint::{Clock, RoutingProperties};

/// Source of the time in the header of a route's messages.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_engine as engine; }
/// use std::collections::BTreeMap;
/// use wrapyfi_core::engine::{Config, StampSource};
/// let text = "routes:\n  - { from: zeromq:/a, to: ros2:/a, stamp: arrival }\n";
/// let config: Config<BTreeMap<String, String>> = Config::from_yaml(text, "bridge.yaml")?;
/// let stamp = config.routes[0].value.stamp.as_ref().unwrap();
/// assert_eq!(stamp.value, StampSource::Arrival);
/// # Ok::<(), wrapyfi_engine::ConfigError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StampSource {
    /// The message as it came from the source.
    Source,
    /// The node's clock when the message is passed on.
    RosTime,
    /// The system's clock when the message arrived.
    Arrival,
}

impl fmt::Display for StampSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// Sets the header of a message, in the type of its destination, as the route says. `ends` are
/// those of source and destination.
///
/// # Errors
/// When the bytes of a ROS message are none of its type.
pub(super) fn apply(
    spec: &Route,
    payload: &mut Payload,
    ends: [RoutingProperties; 2],
    received_at: Instant,
    clock: &Clock,
) -> Result<(), RosValueError> {
    if !spec.message_types().to.has_header() {
        return Ok(());
    }
    let ([from, to], now) = (ends, clock.ros_now());
    let unsaid =
        matches!(payload, Payload::NativeObject(object) if object.stamp == Stamp::default());
    let stamp = match spec.policy.stamp {
        Some(StampSource::RosTime) => Some(now.stamp),
        Some(StampSource::Arrival) => Some(arrival(clock.age(received_at))),
        None if now.simulated && !from.ros_time => Some(now.stamp),
        // Outside ROS an object without a time is complete: Python Wrapyfi sends no others.
        None | Some(StampSource::Source) => (unsaid && to.ros_time).then_some(now.stamp),
    };
    let change = HeaderChange { stamp, frame_id: spec.policy.frame_id.as_deref() };
    payload.change_header(&change, spec.policy.limits.message_bytes)
}

/// Time of the system's clock so long ago.
fn arrival(age: Duration) -> Stamp {
    let then = SystemTime::now().checked_sub(age);
    let since = then.and_then(|then| then.duration_since(UNIX_EPOCH).ok());
    since.map_or_else(Stamp::now, Stamp::from)
}

#[cfg(test)]
mod tests {
    use super::super::route::RouteTypes;
    use super::*;
    use wrapyfi_data::types::{Encoding, Image, MessageType, NativeObject, RawPixels, Value};
    use wrapyfi_endpoint::RosNow;

    const ROS: RoutingProperties = RoutingProperties {
        any_ros_type: true,
        ros_time: true,
        tells_own: true,
        shows_marks: true,
        subscribes_first: false,
        untyped: false,
        carriers: false,
        action_topics: &[],
    };
    const THEN: Stamp = Stamp { sec: 5, nanosec: 0 };
    const SYSTEM: RosNow = RosNow { stamp: Stamp { sec: 9, nanosec: 0 }, simulated: false };
    const SIMULATED: RosNow = RosNow { simulated: true, ..SYSTEM };

    fn image(stamp: Stamp) -> Payload {
        Image::new(stamp, RawPixels::dense(1, 1, Encoding::Mono8, vec![7]).unwrap()).into()
    }

    fn object(stamp: Stamp) -> Payload {
        NativeObject { stamp, ..NativeObject::from(Value::from(5)) }.into()
    }

    fn spec(payload: &Payload, stamp: Option<StampSource>) -> Route {
        let kind = payload.data_type().name().parse::<MessageType>().unwrap();
        let mut spec = Route::topic("a:/x".parse().unwrap(), "b:/y".parse().unwrap(), kind);
        spec.policy.stamp = stamp;
        spec
    }

    fn stamped(
        mut payload: Payload,
        spec: &Route,
        ends: [RoutingProperties; 2],
        now: RosNow,
    ) -> (i32, String) {
        let clock = Clock::default().with_ros_time(move || now);
        apply(spec, &mut payload, ends, Instant::now(), &clock).unwrap();
        match payload {
            Payload::NativeObject(object) => (object.stamp.sec, object.frame_id),
            Payload::Image(image) => (image.stamp.sec, image.frame_id),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_time_is_that_of_the_source_unless_the_route_says_otherwise() {
        let other = RoutingProperties::default();
        let none = Stamp::default();
        for (payload, said, ends, now, wanted) in [
            (image(THEN), None, [other, ROS], SYSTEM, 5),
            (image(THEN), Some(StampSource::RosTime), [other, ROS], SYSTEM, 9),
            // Wall time has no meaning in a simulation, that of another node of ROS has.
            (image(THEN), None, [other, ROS], SIMULATED, 9),
            (image(THEN), Some(StampSource::Source), [other, ROS], SIMULATED, 5),
            (image(THEN), None, [ROS, other], SIMULATED, 5),
            (object(THEN), None, [ROS, ROS], SYSTEM, 5),
            (object(none), None, [other, ROS], SYSTEM, 9),
            (object(none), Some(StampSource::Source), [other, ROS], SYSTEM, 9),
            // Two frames stay two frames.
            (object(none), None, [ROS, other], SYSTEM, 0),
        ] {
            let spec = spec(&payload, said);
            let what = format!("{payload:?} {said:?} {ends:?} {now:?}");
            assert_eq!(stamped(payload, &spec, ends, now).0, wanted, "{what}");
        }
        let arrival = spec(&image(THEN), Some(StampSource::Arrival));
        let (sec, _) = stamped(image(THEN), &arrival, [other, ROS], SIMULATED);
        assert!(sec > 1_700_000_000, "{sec}");
    }

    #[test]
    fn the_frame_is_that_of_the_route_where_it_says_one() {
        let named = Image {
            frame_id: "eye".into(),
            ..match image(THEN) {
                Payload::Image(image) => image,
                other => panic!("{other:?}"),
            }
        };
        let ends = [RoutingProperties::default(), ROS];
        let mut spec = spec(&image(THEN), None);
        assert_eq!(stamped(named.clone().into(), &spec, ends, SYSTEM).1, "eye");
        spec.policy.frame_id = Some("camera".into());
        assert_eq!(stamped(named.into(), &spec, ends, SYSTEM), (5, "camera".into()));
        spec.types = RouteTypes::Topic(MessageType::Text.into());
        assert_eq!(stamped(object(Stamp::default()), &spec, ends, SYSTEM), (0, String::new()));
    }
}
