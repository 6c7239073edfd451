//! Control boards, sensors and coordinate frames, as real YARP writes and reads them.

use std::f64::consts::{FRAC_PI_2, PI};
use std::time::Duration;

use proptest::prelude::*;

use super::golden::sent;
use super::*;
use crate::options::Axis;
use wrapyfi_data::types::Tensor;

const JOINTS: [&str; 3] = ["neck", "eye", "heave"];

/// A topic of a control board that has told of its joints, the last one of which slides.
fn board(name: &str, options: &[(&str, Value)]) -> (TopicSpec, YarpOptions) {
    let mut spec = topic(MessageType::Ros(ros(name)), []);
    spec.topic = "/icub/head/command:i".to_owned();
    for (option, value) in options {
        spec.options.insert(*option, value.clone());
    }
    let axes = vec![Axis::Revolute, Axis::Revolute, Axis::Prismatic];
    let joints = JOINTS.map(str::to_owned).to_vec();
    let options = YarpOptions { joints, axes, ..YarpOptions::of_topic(&spec).unwrap() };
    (spec, options)
}

fn numbers(values: &[f64]) -> Value {
    Tensor::from_elements(&[values.len()], values.to_vec()).unwrap().into()
}

fn state(names: &[&str], field: &str, values: &[f64]) -> Payload {
    let names: Value = names.iter().copied().collect();
    let fields = Map::from([("name", names), (field, numbers(values))]);
    message(ros("sensor_msgs/msg/JointState"), &fields.into())
}

fn commanded(payload: &Payload, options: &[(&str, Value)]) -> Result<Bytes, EncodeError> {
    let (spec, options) = board("sensor_msgs/msg/JointState", options);
    encode(payload, &spec, &options, Dialect::V3).map(|out| out.payload.bytes)
}

#[test]
fn movements_are_those_of_yarp() {
    let direct = ("control", Value::from("position_direct"));
    let metres = ("degrees", Value::from(false));
    let some = ["neck", "heave"];
    let movements = [
        (state(&[], "velocity", &[1.0, 2.0, 3.0]), vec![metres.clone()]),
        (state(&JOINTS, "position", &[11.0, -21.0, 0.06]), vec![metres.clone(), direct.clone()]),
        (state(&JOINTS, "effort", &[0.5, 0.25, 0.125]), vec![]),
        (state(&some, "position", &[11.0, 0.06]), vec![metres.clone(), direct]),
        (state(&some, "velocity", &[11.0, 0.06]), vec![metres]),
    ];
    let recorded = sent("command_tcp.json");
    assert_eq!(recorded.len(), movements.len());
    for ((payload, options), (bytes, _)) in movements.iter().zip(recorded) {
        let written = commanded(payload, options).unwrap();
        assert_eq!(written, bytes, "{}, not {}", shown(&written), shown(&bytes));
    }
}

#[test]
fn a_state_in_full_has_the_form_that_its_name_promises() {
    let (mut spec, options) = board("sensor_msgs/msg/JointState", &[]);
    spec.topic = "/arm/stateExt:o".to_owned();
    let names: Value = ["eye", "neck", "heave"].into_iter().collect();
    let fields = Map::from([
        ("name", names),
        ("position", numbers(&[PI, FRAC_PI_2, 0.5])),
        ("velocity", numbers(&[0.0, PI, 0.25])),
    ]);
    let state = message(ros("sensor_msgs/msg/JointState"), &fields.into());
    let bytes = encode(&state, &spec, &options, Dialect::V3).unwrap().payload.bytes;
    let (zeros, words) = ("(0.0 0.0 0.0)", "(0 0 0)");
    assert_eq!(
        shown(&bytes),
        format!(
            "(90.0 180.0 0.5) [ok] (180.0 0.0 0.25) [ok] {zeros} [fail] {zeros} [fail] {zeros} [fail] {zeros} [fail] \
             {zeros} [fail] {zeros} [fail] {zeros} [fail] {words} [fail] {words} [fail]"
        )
    );
    let back =
        decode(&Bytewise::object(bytes), None, &spec, &options, Dialect::V3, Stamp::default());
    let Payload::RosMessage(back) = back.unwrap() else { panic!("a message") };
    let back = back.to_value(1 << 20).unwrap();
    assert_eq!(super::super::floats(&back, "velocity"), [PI, 0.0, 0.25]);
    assert!(super::super::floats(&back, "effort").is_empty(), "what is not told is left out");
}

#[test]
fn positions_are_moved_to_in_the_units_and_the_order_of_the_board() {
    let names = ["heave", "neck", "eye"];
    let payload = state(&names, "position", &[0.25, PI, -FRAC_PI_2]);
    assert_eq!(shown(&commanded(&payload, &[]).unwrap()), "([poss]) (180.0 -90.0 0.25)");
    let some = state(&["heave", "eye"], "velocity", &[0.25, PI]);
    assert_eq!(shown(&commanded(&some, &[]).unwrap()), "([vmog] 2 (2 1)) (0.25 180.0)");
    // The port may be the one that ours connects itself to.
    let (mut spec, mut options) = board("sensor_msgs/msg/JointState", &[]);
    spec.topic = "/bridge/head".into();
    let written = |options: &YarpOptions| {
        let bytes = encode(&payload, &spec, options, Dialect::V3).unwrap().payload.bytes;
        shown(&bytes)
    };
    assert_eq!(written(&options), "180.0 -90.0 0.25");
    options.out_topic_connect = Some("/icub/head/command:i".into());
    assert_eq!(written(&options), "([poss]) (180.0 -90.0 0.25)");
    // YARP 4 has the interface before the word.
    let bytes = encode(&payload, &spec, &options, Dialect::V4).unwrap().payload.bytes;
    let read = Bottle::decode_whole(&bytes, Dialect::V4, &wrapyfi_yarp::WireLimits::default());
    assert_eq!(read.unwrap().to_text(), "([ipos] [poss]) (180.0 -90.0 0.25)");
}

#[test]
fn positions_of_some_joints_are_a_request() {
    let (spec, options) = board("sensor_msgs/msg/JointState", &[]);
    let asked = |payload: &Payload, dialect| {
        of_some_joints(payload, &spec, &options, dialect).unwrap().map(|asked| asked.to_text())
    };
    let eye = state(&["eye"], "position", &[std::f64::consts::PI]);
    assert_eq!(asked(&eye, Dialect::V3).unwrap(), "[set] [posg] 1 (1) (180.0)");
    let two = state(&["heave", "neck"], "position", &[0.5, 0.0]);
    assert_eq!(asked(&two, Dialect::V3).unwrap(), "[set] [posg] 2 (2 0) (0.5 0.0)");
    assert_eq!(asked(&eye, Dialect::V4), None);
    for all in [state(&JOINTS, "position", &[0.0; 3]), state(&["eye"], "velocity", &[1.0])] {
        assert_eq!(asked(&all, Dialect::V3), None);
    }
}

#[test]
fn what_a_board_would_misread_is_refused() {
    let error = |payload: &Payload| commanded(payload, &[]).unwrap_err().to_string();
    for (payload, wanted) in [
        (
            state(&[], "position", &[1.0]),
            "expected positions of the 3 joints of /icub/head/command:i",
        ),
        (
            state(&["neck"], "position", &[1.0]),
            "option control: position_direct, was given 1 of them",
        ),
        (state(&["elbow"], "velocity", &[1.0]), "neck, eye, heave, was given \"elbow\""),
        (
            state(&["eye", "eye"], "velocity", &[1.0, 2.0]),
            "each joint once, was given \"eye\" twice",
        ),
        (
            state(&["eye"], "velocity", &[1.0, 2.0]),
            "expected 1 velocities, one a name, was given 2",
        ),
        (state(&["eye"], "velocity", &[f64::NAN]), "was given NaN"),
        (state(&JOINTS, "position", &[]), "one a name, was given 0"),
    ] {
        let error = error(&payload);
        assert!(error.contains(wanted), "{error}");
    }
    let (spec, told) = board("sensor_msgs/msg/JointState", &[]);
    let untold = YarpOptions { joints: Vec::new(), axes: Vec::new(), ..told };
    let payload = state(&[], "position", &[1.0]);
    let error = encode(&payload, &spec, &untold, Dialect::V3).unwrap_err().to_string();
    assert!(error.contains("its port /icub/head/rpc:i has not told: set option joints"), "{error}");
}

fn point(positions: &[f64], sec: i64, nanosec: i64) -> Value {
    let time = Map::from([("sec", sec), ("nanosec", nanosec)]);
    Map::from([("positions", numbers(positions)), ("time_from_start", time.into())]).into()
}

fn moves(points: Vec<Value>, begin: i64) -> Result<Vec<(Duration, String)>, EncodeError> {
    let name = "trajectory_msgs/msg/JointTrajectory";
    let (spec, options) = board(name, &[]);
    let stamp = Map::from([("sec", begin), ("nanosec", 0)]);
    let header = Map::from([("stamp", stamp)]);
    let names: Value = ["eye", "neck", "heave"].into_iter().collect();
    let fields = Map::from([
        ("header", Value::from(header)),
        ("joint_names", names),
        ("points", Value::List(points)),
    ]);
    let payload = message(ros(name), &fields.into());
    let now = Stamp { sec: 100, nanosec: 0 };
    let moves = trajectory(&payload, &spec, &options, Dialect::V3, now)?.unwrap();
    let moves = moves.into_iter().map(|(due, out)| (due, shown(&out.payload.bytes)));
    Ok(moves.collect())
}

#[test]
fn a_trajectory_is_a_movement_for_each_point_at_its_time() {
    let points = || vec![point(&[0.0, PI, 0.5], 0, 0), point(&[PI, 0.0, 0.25], 1, 500_000_000)];
    let wanted = ["([poss]) (180.0 0.0 0.5)", "([poss]) (0.0 180.0 0.25)"];
    let due = |begin: u64| [begin * 1000, begin * 1000 + 1500].map(Duration::from_millis);
    for (begin, wait) in [(0, 0), (99, 0), (103, 3)] {
        let moves = moves(points(), begin).unwrap();
        let (times, texts): (Vec<_>, Vec<_>) = moves.into_iter().unzip();
        assert_eq!(
            (times.as_slice(), texts.as_slice()),
            (&due(wait)[..], &wanted.map(String::from)[..])
        );
    }
    assert!(moves(Vec::new(), 0).unwrap().is_empty(), "no points are a stop");
    let mut backwards = points();
    backwards.reverse();
    let error = moves(backwards, 0).unwrap_err().to_string();
    assert!(error.contains("points in the order of their times"), "{error}");
    let error = moves(vec![point(&[0.0, 0.0, 0.0], -1, 0)], 0).unwrap_err().to_string();
    assert!(error.contains("was given -1 s and 0 ns"), "{error}");
    // To other ports it goes as any message does.
    let plain = topic(MessageType::Ros(ros("trajectory_msgs/msg/JointTrajectory")), []);
    let payload = message(ros("trajectory_msgs/msg/JointTrajectory"), &Map::new().into());
    let options = YarpOptions::default();
    assert_eq!(trajectory(&payload, &plain, &options, Dialect::V3, NOW).unwrap(), None);
    assert!(shown(&bytes_of(&payload, &plain)).contains("(joint_names ())"));
}

fn part(fields: &Value, path: &str) -> f64 {
    let found = path.split('.').fold(fields, |fields, name| fields.get(name).unwrap());
    found.as_f64().unwrap()
}

#[test]
fn sensors_of_yarp_are_an_imu() {
    let spec = topic(MessageType::Ros(ros("sensor_msgs/msg/Imu")), [("frame_id", "imu".into())]);
    for (bytes, _) in sent("multiple_analog_sensors_tcp.json") {
        let fields = value(&read(bytes, &spec).unwrap());
        assert!(
            (part(&fields, "linear_acceleration.z") + 9.661_114_745).abs() < 1e-6,
            "{fields:?}"
        );
        assert!((part(&fields, "angular_velocity.x") - 10_f64.to_radians()).abs() < 1e-12);
        // Roll, pitch and yaw of 10 degrees each.
        for (name, wanted) in [("x", 0.078_9), ("y", 0.094_1), ("z", 0.078_9), ("w", 0.989_3)] {
            let found = part(&fields, &format!("orientation.{name}"));
            assert!((found - wanted).abs() < 1e-4, "{name}: {found}");
        }
        assert_eq!(fields.get("header").unwrap().get("frame_id"), Some(&"imu".into()));
    }
    let other = topic(MessageType::Ros(ros("sensor_msgs/msg/Imu")), [("sensor", 1.into())]);
    let (bytes, _) = sent("multiple_analog_sensors_tcp.json").remove(0);
    let error = read(bytes.clone(), &other).unwrap_err().to_string();
    assert!(error.contains("an inertial sensor number 1 (option sensor)"), "{error}");
    let wrench = topic(MessageType::Ros(ros("geometry_msgs/msg/WrenchStamped")), []);
    let error = read(bytes, &wrench).unwrap_err().to_string();
    assert!(error.contains("a force and torque sensor number 0"), "{error}");
}

#[test]
fn old_inertials_and_forces_are_vectors() {
    let imu = topic(MessageType::Ros(ros("sensor_msgs/msg/Imu")), []);
    let text = "0.0 0.0 90.0 0.5 0.0 9.75 180.0 0.0 0.0 0.0 0.0 0.0";
    let fields = value(&read(typed(text), &imu).unwrap());
    assert!((part(&fields, "orientation.z") - FRAC_PI_2.sin() / 2_f64.sqrt()).abs() < 1e-12);
    assert_eq!(part(&fields, "angular_velocity.x"), PI);
    assert_eq!(part(&fields, "linear_acceleration.z"), 9.75);
    let error = read(typed("1.0 2.0"), &imu).unwrap_err().to_string();
    assert_eq!(error, "expected 12 numbers of an inertial sensor, received a vector of 2");
    let error = read(typed("a b"), &imu).unwrap_err().to_string();
    assert!(error.contains("received a bottle of 2: a b"), "{error}");
    // Without an orientation ROS is told so.
    let bare = "(((1.0 2.0 3.0) 0.5)) () () () () ()";
    let fields = value(&read(typed(bare), &imu).unwrap());
    let covariance = |name: &str| {
        let tensor = fields.get(name).and_then(Value::as_tensor).unwrap();
        tensor.to_vec::<f64>().unwrap()[0]
    };
    assert_eq!(covariance("orientation_covariance"), -1.0);
    assert_eq!(covariance("angular_velocity_covariance"), 0.0);
    assert_eq!(covariance("linear_acceleration_covariance"), -1.0);

    let wrench = topic(MessageType::Ros(ros("geometry_msgs/msg/WrenchStamped")), []);
    let payload = read(typed("1.0 2.0 3.0 0.5 0.25 0.125"), &wrench).unwrap();
    assert_eq!(part(&value(&payload), "wrench.force.y"), 2.0);
    assert_eq!(part(&value(&payload), "wrench.torque.z"), 0.125);
    assert_eq!(shown(&bytes_of(&payload, &wrench)), "1.0 2.0 3.0 0.5 0.25 0.125");
    let measures = "() () () () () (((9.0 8.0 7.0 6.0 5.0 4.0) 1.5))";
    assert_eq!(part(&value(&read(typed(measures), &wrench).unwrap()), "wrench.force.x"), 9.0);
}

#[test]
fn frames_of_yarp_are_transforms() {
    let spec = topic(MessageType::Ros(ros("tf2_msgs/msg/TFMessage")), []);
    for (bytes, _) in sent("frame_transforms_tcp.json") {
        let payload = read(bytes, &spec).unwrap();
        let fields = value(&payload);
        let [root, eye] = fields.get("transforms").unwrap().as_items().unwrap() else { panic!() };
        let name = |fields: &Value, path: &[&str]| {
            let found = path.iter().fold(fields, |fields, name| fields.get(name).unwrap());
            found.as_str().unwrap().to_owned()
        };
        assert_eq!(name(root, &["header", "frame_id"]), "root");
        assert_eq!(name(root, &["child_frame_id"]), "head");
        assert!(part(root, "header.stamp.sec") > 1.7e9);
        assert_eq!(part(root, "transform.translation.z"), 3.0);
        assert_eq!(name(eye, &["child_frame_id"]), "left_eye");
        assert_eq!(part(eye, "header.stamp.sec"), f64::from(NOW.sec), "it has no time of its own");
        assert_eq!(part(eye, "transform.rotation.z"), 0.6);
        assert_eq!(part(eye, "transform.rotation.w"), 0.8);
        // And back: what has a time has it to the nanosecond, which is finer than a double.
        let again = bytes_of(&payload, &spec);
        assert_eq!(read(again, &spec).unwrap(), payload);
    }
    let one = "root head 5.5 0 1.0 2.0 3.0 0.0 0.0 0.0 1.0";
    for text in [one.to_owned(), format!("({one})"), format!("0 (({one}))")] {
        let payload = read(typed(&text), &spec).unwrap();
        assert_eq!(shown(&bytes_of(&payload, &spec)), format!("0 (({one}))"), "{text}");
        assert_eq!(written(&payload, &spec).unwrap().stamp.unwrap().time_s, 5.5);
    }
    for text in ["root head", "0 ((root head))", "0 (1)", "1 2 3"] {
        let error = read(typed(text), &spec).unwrap_err().to_string();
        assert!(error.starts_with("expected transforms (parent child time"), "{text}: {error}");
    }
}

proptest! {
    /// Whichever joints are named in whichever order: each gets its value, and no other moves.
    #[test]
    fn every_joint_gets_its_own_value(
        order in Just(JOINTS.to_vec()).prop_shuffle(),
        count in 1_usize..=3,
        values in proptest::collection::vec(-3.0..3.0, 3),
        v4: bool,
    ) {
        let dialect = if v4 { Dialect::V4 } else { Dialect::V3 };
        let (spec, options) = board("sensor_msgs/msg/JointState", &[("control", "velocity".into())]);
        let (names, values) = (&order[..count], &values[..count]);
        let payload = state(names, "velocity", values);
        let bytes = encode(&payload, &spec, &options, dialect).unwrap().payload.bytes;
        let limits = wrapyfi_yarp::WireLimits::default();
        let bottle = Bottle::decode_whole(&bytes, dialect, &limits).unwrap();
        let [head, body] = bottle.values.as_slice() else { panic!("{bottle:?}") };
        let (head, body) = (head.as_list().unwrap(), body.as_list().unwrap());
        // YARP 4 has the interface first.
        let word = usize::from(v4);
        let places: Vec<usize> = match head.get(word + 2) {
            None => (0..3).collect(),
            Some(list) => list.as_list().unwrap().into_iter()
                .map(|place| usize::try_from(place.as_i64().unwrap()).unwrap()).collect(),
        };
        prop_assert_eq!(head.get(word).unwrap().is_word("vmos"), count == 3);
        prop_assert_eq!((places.len(), body.len()), (count, count));
        for (place, number) in places.into_iter().zip(body) {
            let name = JOINTS[place];
            let given = values[names.iter().position(|other| *other == name).unwrap()];
            let wanted = if name == "heave" { given } else { given.to_degrees() };
            prop_assert_eq!(number.as_f64(), Some(wanted));
        }
    }
}
