//! Movements for a control board, as its port `command:i` reads them.
//!
//! ```text
//!   position          ([poss]) (p p p …)      all joints, on the board's own trajectory
//!                     [set] [posg] 2 (0 2) (p p)    some joints, to the board's port for requests
//!   position_direct   ([dpos]) (p p p …)      ([dpog] 2 (0 2)) (p p)     some joints
//!   velocity          ([vmos]) (v v v …)      ([vmog] 2 (0 2)) (v v)
//!   torque            ([dtqs]) (t t t …)      ([dtqg] 2 (0 2)) (t t)
//! ```
//!
//! YARP 4 has the interface before the word: `[ipos]`, `[ipod]`, `[ivel]`, `[itrq]`. Its dialect tells.
//!
//! YARP's own `StreamingMessagesParser` is the specification. It takes a vector that is too short for one
//! that is long enough, so nothing is written here before the number of joints is known. Limits are
//! kept by the board itself: what is beyond them is written, and named in the log.

use std::time::Duration;

use wrapyfi_yarp::port::PortPayload;
use wrapyfi_yarp::{Bottle, Dialect, Value as Element, sig};

use super::super::joint_limits;
use super::super::options::{Axis, Control, YarpOptions};
use super::joints::{floats, texts};
use super::outgoing::Outgoing;
use super::rules::Rules;
use super::{native, ros};
use wrapyfi_data::types::{Header, MessageType, Payload, Stamp, Value};
use wrapyfi_endpoint::TopicSpec;
use wrapyfi_endpoint::codec::{EncodeError, EncodeResult};

/// Ending of the name of the port on which a control board takes commands.
pub(crate) const COMMAND_PORT: &str = "/command:i";
/// Names of joints that an error shows.
const SHOWN: usize = 32;

/// The port that messages of a topic are for.
fn destination<'a>(spec: &'a TopicSpec, options: &'a YarpOptions) -> &'a str {
    options.out_topic_connect.as_deref().unwrap_or(&spec.topic)
}

/// True when the messages of a topic are for a control board.
pub(super) fn is_for(spec: &TopicSpec, options: &YarpOptions) -> bool {
    options.control.is_some() || destination(spec, options).ends_with(COMMAND_PORT)
}

/// The movement that a `JointState` asks for.
pub(super) fn of_state(
    fields: &Value,
    spec: &TopicSpec,
    rules: Rules<'_>,
) -> EncodeResult<Vec<u8>> {
    let lists = ["position", "velocity", "effort"].map(|name| floats(fields, name));
    let port = destination(spec, rules.options);
    let movement = Movement::of(&texts(fields, "name"), lists, port, rules.options)?;
    movement.encode(port, rules.options, rules.dialect)
}

/// The request that moves some joints of a board on its own trajectory, for which its port for commands has no word;
/// none where `payload` is anything else. A board of YARP 4 has no such request.
pub(crate) fn of_some_joints(
    payload: &Payload,
    spec: &TopicSpec,
    options: &YarpOptions,
    dialect: Dialect,
) -> EncodeResult<Option<Bottle>> {
    let Payload::RosMessage(message) = payload else { return Ok(None) };
    let is_wanted = spec.message_type == MessageType::Ros(message.ros_type);
    let is_state = message.ros_type.name() == ros::JOINTS && options.bottle.is_none();
    if dialect != Dialect::V3 || !(is_wanted && is_state && is_for(spec, options)) {
        return Ok(None);
    }
    let fields = ros::fields(message, spec)?;
    let lists = ["position", "velocity", "effort"].map(|name| floats(&fields, name));
    let port = destination(spec, options);
    let Movement { control, joints, values } =
        Movement::of(&texts(&fields, "name"), lists, port, options)?;
    let (Control::Position, Some(joints)) = (control, joints) else { return Ok(None) };
    let values = values.into_iter().map(Element::Float64).collect();
    let words = [Element::vocab("set"), Element::vocab("posg"), number(joints.len())];
    let lists = [joints.into_iter().map(number).collect(), values].map(Element::List);
    Ok(Some(words.into_iter().chain(lists).collect()))
}

/// The movements that a `JointTrajectory` for a control board asks for, each with its time from now on;
/// none where `payload` is something else, or for another port. A trajectory that begins later waits.
pub(crate) fn trajectory(
    payload: &Payload,
    spec: &TopicSpec,
    options: &YarpOptions,
    dialect: Dialect,
    now: Stamp,
) -> EncodeResult<Option<Vec<(Duration, Outgoing)>>> {
    let Payload::RosMessage(message) = payload else { return Ok(None) };
    let is_wanted = spec.message_type == MessageType::Ros(message.ros_type);
    let is_movement = message.ros_type.name() == ros::TRAJECTORY && options.bottle.is_none();
    if !(is_wanted && is_movement && is_for(spec, options)) {
        return Ok(None);
    }
    let fields = ros::fields(message, spec)?;
    let begin = Header::of_fields(&fields).unwrap_or_default().stamp;
    let wait = Duration::try_from_secs_f64(begin.as_secs_f64() - now.as_secs_f64());
    let (port, names) = (destination(spec, options), texts(&fields, "joint_names"));
    let mut movements: Vec<(Duration, Outgoing)> = Vec::new();
    for point in fields.get("points").and_then(Value::as_items).unwrap_or_default() {
        let time = from_start(point)?;
        let due = wait.as_ref().copied().unwrap_or_default().saturating_add(time);
        if movements.last().is_some_and(|(before, _)| *before > due) {
            return Err(EncodeError::mismatch(
                "points in the order of their times",
                format!("one at {time:?} behind a later one"),
            ));
        }
        let lists = ["positions", "velocities", "effort"].map(|name| floats(point, name));
        let bytes = Movement::of(&names, lists, port, options)?.encode(port, options, dialect)?;
        EncodeError::check_size(bytes.len(), spec.limits.message_bytes)?;
        let sent_at = |begin: Stamp| sig::Stamp {
            count: 0,
            time_s: begin.as_secs_f64() + time.as_secs_f64(),
        };
        let stamp = (begin != Stamp::default()).then(|| sent_at(begin));
        movements.push((due, Outgoing { payload: PortPayload::object(bytes), stamp }));
    }
    Ok(Some(movements))
}

/// The time of a point since its trajectory began.
fn from_start(point: &Value) -> EncodeResult<Duration> {
    let time = point.get("time_from_start");
    let part = |name| time.and_then(|time| time.get(name)).and_then(Value::as_i64).unwrap_or(0);
    let (sec, nanosec) = (part("sec"), part("nanosec"));
    let found = u64::try_from(sec).ok().zip(u32::try_from(nanosec).ok());
    let found = found.map(|(sec, nanosec)| {
        Duration::from_secs(sec).saturating_add(Duration::from_nanos(nanosec.into()))
    });
    found.ok_or_else(|| {
        EncodeError::mismatch(
            "times from the start of the trajectory",
            format!("{sec} s and {nanosec} ns"),
        )
    })
}

/// One message for a control board.
struct Movement {
    control: Control,
    /// Places of the joints; none where they are all, in order.
    joints: Option<Vec<usize>>,
    values: Vec<f64>,
}

impl Movement {
    /// Movement that `positions`, `velocities` or `efforts` of the joints `names` demand of the
    /// board at `port`.
    fn of(
        names: &[&str],
        [positions, velocities, efforts]: [Vec<f64>; 3],
        port: &str,
        options: &YarpOptions,
    ) -> EncodeResult<Self> {
        let control = options.control.unwrap_or(if !positions.is_empty() {
            Control::Position
        } else if !velocities.is_empty() {
            Control::Velocity
        } else {
            Control::Torque
        });
        let (values, what) = match control {
            Control::Position | Control::PositionDirect => (positions, "positions"),
            Control::Velocity => (velocities, "velocities"),
            Control::Torque => (efforts, "efforts"),
        };
        if let Some(odd) = values.iter().find(|value| !value.is_finite()) {
            let wanted = format!("{what} that are numbers: leave out joints that shall not move");
            return Err(mismatch(wanted, odd));
        }
        let (joints, mut values) = select(names, values, what, port, options)?;
        if control != Control::Torque {
            for (place, value) in values.iter_mut().enumerate() {
                let joint = joints.as_ref().map_or(Some(&place), |joints| joints.get(place));
                let Some(&joint) = joint else { continue };
                if options.has_degrees(joint) {
                    *value = value.to_degrees();
                }
                if control != Control::Velocity
                    && let Some(range) = options.limits.news(joint, *value)
                {
                    let name = options.joints.get(joint).cloned();
                    let name = name.unwrap_or_else(|| joint.to_string());
                    let turns = options.axes.get(joint) != Some(&Axis::Prismatic);
                    let text = joint_limits::warning(&name, *value, range, turns, options.degrees);
                    tracing::warn!("{port}: {text}");
                }
            }
        }
        Ok(Self { control, joints, values })
    }

    /// Writes it for the port `port` of the board.
    fn encode(self, port: &str, options: &YarpOptions, dialect: Dialect) -> EncodeResult<Vec<u8>> {
        if let (Control::Position, Some(some)) = (self.control, &self.joints) {
            let wanted = format!(
                "positions of all {} joints of {port}, which [poss] moves together, or option \
                 control: position_direct",
                known(options)
            );
            return Err(mismatch(wanted, &format!("{} of them", some.len())));
        }
        let (interface, all, some) = match self.control {
            Control::Position => ("ipos", "poss", ""),
            Control::PositionDirect => ("ipod", "dpos", "dpog"),
            Control::Velocity => ("ivel", "vmos", "vmog"),
            Control::Torque => ("itrq", "dtqs", "dtqg"),
        };
        let mut head = match dialect {
            Dialect::V3 => Vec::new(),
            Dialect::V4 => vec![Element::vocab(interface)],
        };
        match self.joints {
            None => head.push(Element::vocab(all)),
            Some(joints) => {
                let count = number(joints.len());
                let places = joints.into_iter().map(number).collect::<Bottle>();
                head.extend([Element::vocab(some), count, Element::List(places)]);
            }
        }
        let body = self.values.into_iter().map(Element::Float64).collect();
        let pair = [Bottle { values: head }, body].map(Element::List);
        native::bytes(&Bottle { values: pair.into() }, dialect)
    }
}

/// A number of joints, or the place of one.
fn number(place: usize) -> Element {
    Element::Int32(i32::try_from(place).unwrap_or(i32::MAX))
}

/// Number of joints of the control board; 0 where it is not known.
fn known(options: &YarpOptions) -> usize {
    if options.joints.is_empty() { options.axes.len() } else { options.joints.len() }
}

/// Puts values into the order of the board: all of them, or the places of some.
fn select(
    names: &[&str],
    values: Vec<f64>,
    what: &str,
    port: &str,
    options: &YarpOptions,
) -> EncodeResult<(Option<Vec<usize>>, Vec<f64>)> {
    let (count, joints) = (known(options), &options.joints);
    if count == 0 || (joints.is_empty() && !names.is_empty()) {
        let rpc = port.strip_suffix(COMMAND_PORT).unwrap_or(port);
        let wanted = format!(
            "the names of the joints of {port}, which its port {rpc}/rpc:i has not told: set option \
             joints"
        );
        return Err(mismatch(wanted, &format!("a movement of {} joints", values.len())));
    }
    if names.is_empty() {
        if values.len() == count {
            return Ok((None, values));
        }
        let wanted = format!("{what} of the {count} joints of {port}");
        return Err(mismatch(wanted, &values.len()));
    }
    if names.len() != values.len() {
        return Err(mismatch(format!("{} {what}, one a name", names.len()), &values.len()));
    }
    let mut ordered = vec![None; count];
    let mut places = Vec::with_capacity(names.len());
    for (name, value) in names.iter().zip(&values) {
        let place = joints.iter().position(|joint| joint == name);
        let slot = place.and_then(|place| ordered.get_mut(place));
        let (Some(place), Some(slot)) = (place, slot) else {
            let shown: Vec<&str> = joints.iter().take(SHOWN).map(String::as_str).collect();
            let wanted = format!("joints of {port}: {}", shown.join(", "));
            return Err(mismatch(wanted, &format!("{name:?}")));
        };
        if slot.replace(*value).is_some() {
            return Err(mismatch("each joint once".to_owned(), &format!("{name:?} twice")));
        }
        places.push(place);
    }
    match ordered.into_iter().collect::<Option<Vec<f64>>>() {
        Some(all) => Ok((None, all)),
        None => Ok((Some(places), values)),
    }
}

fn mismatch(expected: String, actual: &impl ToString) -> EncodeError {
    EncodeError::mismatch(expected, actual.to_string())
}
