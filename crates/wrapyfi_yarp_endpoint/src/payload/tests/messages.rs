//! ROS messages, one line of the table each.

use std::f64::consts::{FRAC_PI_2, PI};

use super::*;
use wrapyfi_data::types::Tensor;

fn floats(value: Option<&Value>) -> Vec<f64> {
    value.and_then(Value::as_tensor).and_then(Tensor::to_vec).unwrap()
}

fn strings(value: Option<&Value>) -> Vec<String> {
    let items = value.and_then(Value::as_items).unwrap_or_default();
    items.iter().filter_map(Value::as_str).map(str::to_owned).collect()
}

fn dims(fields: &Value) -> Vec<(String, i64, i64)> {
    let dims = fields.get("layout").unwrap().get("dim").unwrap().as_items().unwrap();
    let number = |dim: &Value, key: &str| dim.get(key).and_then(Value::as_i64).unwrap();
    dims.iter()
        .map(|dim| {
            let label = dim.get("label").and_then(Value::as_str).unwrap().to_owned();
            (label, number(dim, "size"), number(dim, "stride"))
        })
        .collect()
}

#[test]
fn vectors_and_matrices_are_multi_arrays() {
    let spec = topic(MessageType::Ros(ros("std_msgs/msg/Float64MultiArray")), []);
    let rows_of_3 = [("rows".to_owned(), 2, 6), ("columns".to_owned(), 3, 3)];
    for (text, layout, back) in [
        ("1.0 2.5 -3.0", &[("elements".to_owned(), 3, 3)][..], "1.0 2.5 -3.0"),
        ("1 2.5", &[("elements".to_owned(), 2, 2)], "1.0 2.5"),
        ("2 3 (1.0 2.0 3.0 4.0 5.0 6.0)", &rows_of_3, "2 3 (1.0 2.0 3.0 4.0 5.0 6.0)"),
        ("(1 2 3) (4 5 6)", &rows_of_3, "2 3 (1.0 2.0 3.0 4.0 5.0 6.0)"),
        ("", &[("elements".to_owned(), 0, 0)], ""),
    ] {
        let payload = read(typed(text), &spec).unwrap();
        assert_eq!(dims(&value(&payload)), layout, "{text}");
        assert_eq!(shown(&bytes_of(&payload, &spec)), back, "{text}");
    }
    for text in ["a b", "(1 2) (3)", "2 3 (1 2)", "(1 2) 3"] {
        let error = read(typed(text), &spec).unwrap_err().to_string();
        assert!(error.starts_with("expected a vector or a matrix of numbers"), "{text}: {error}");
    }
}

#[test]
fn the_layout_of_a_multi_array_is_followed() {
    let ros_type = ros("std_msgs/msg/Float64MultiArray");
    let spec = topic(MessageType::Ros(ros_type), []);
    let array = |sizes: &[(i64, i64)], offset: i64| {
        let dim = |&(size, stride): &(i64, i64)| {
            Value::from(Map::from([("size", Value::from(size)), ("stride", stride.into())]))
        };
        let dims = sizes.iter().map(dim).collect::<Value>();
        let data = Tensor::from_elements(&[8], (0..8).map(f64::from).collect()).unwrap();
        let layout = Map::from([("dim", dims), ("data_offset", offset.into())]);
        message(
            ros_type,
            &Map::from([("layout", Value::from(layout)), ("data", data.into())]).into(),
        )
    };
    for (sizes, offset, wanted) in [
        (&[][..], 0, "0.0 1.0 2.0 3.0 4.0 5.0 6.0 7.0"),
        (&[(8, 8)], 6, "6.0 7.0"),
        (&[(2, 0), (3, 0)], 0, "2 3 (0.0 1.0 2.0 3.0 4.0 5.0)"),
        (&[(2, 8), (3, 4)], 1, "2 3 (1.0 2.0 3.0 5.0 6.0 7.0)"),
    ] {
        assert_eq!(shown(&bytes_of(&array(sizes, offset), &spec)), wanted);
    }
    let error = written(&array(&[(2, 2), (2, 2), (2, 2)], 0), &spec).unwrap_err().to_string();
    assert!(error.contains("an array of 3 dimensions"), "{error}");
    for (sizes, offset) in [(&[(3, 9), (3, 3)][..], 0), (&[(2, 8), (3, 5)], 1), (&[], 9)] {
        let error = written(&array(sizes, offset), &spec).unwrap_err().to_string();
        assert!(error.ends_with("was given data of 8"), "{error}");
    }
}

#[test]
fn the_network_clock_is_two_integers() {
    let spec = topic(MessageType::Ros(ros("rosgraph_msgs/msg/Clock")), []);
    let payload = read(typed("1700000000 500"), &spec).unwrap();
    let time = value(&payload);
    let part = |name| time.get("clock").and_then(|clock| clock.get(name)).and_then(Value::as_i64);
    assert_eq!((part("sec"), part("nanosec")), (Some(1_700_000_000), Some(500)));
    assert_eq!(shown(&bytes_of(&payload, &spec)), "1700000000 500");
    for text in ["1", "1 2 3", "1.5 2", "1 1000000000", "1 -1", "a b"] {
        let error = read(typed(text), &spec).unwrap_err().to_string();
        assert!(error.contains("seconds and nanoseconds"), "{text}: {error}");
    }
}

#[test]
fn joints_have_names_and_radians() {
    let ros_type = ros("sensor_msgs/msg/JointState");
    let names: Value = ["neck_pitch", "neck_roll"].into_iter().collect();
    let spec =
        topic(MessageType::Ros(ros_type), [("joints", names.clone()), ("frame_id", "head".into())]);
    let options = YarpOptions::of_topic(&spec).unwrap();
    let sent = Bytewise::object(typed("180.0 -90.0"));
    let envelope = Some(sig::Stamp { count: 3, time_s: 12.5 });
    let payload = decode(&sent, envelope, &spec, &options, Dialect::V3, NOW).unwrap();
    let fields = value(&payload);
    assert_eq!(strings(fields.get("name")), ["neck_pitch", "neck_roll"]);
    assert_eq!(floats(fields.get("position")), [PI, -FRAC_PI_2]);
    assert!(floats(fields.get("velocity")).is_empty());
    let header = fields.get("header").unwrap();
    assert_eq!(header.get("frame_id"), Some(&"head".into()));
    assert_eq!(header.get("stamp").unwrap().get("sec"), Some(&12.into()));
    let back = written(&payload, &spec).unwrap();
    assert_eq!(shown(&back.payload.bytes), "180.0 -90.0");
    assert_eq!(back.stamp, Some(sig::Stamp { count: 0, time_s: 12.5 }));

    let error = read(typed("1.0 2.0 3.0"), &spec).unwrap_err().to_string();
    assert_eq!(error, "expected 2 joints, as option joints names, received 3 positions");
    let error = read(typed("a b"), &spec).unwrap_err().to_string();
    assert!(error.contains("received a bottle of 2: a b"), "{error}");
    let error = read(typed("1 2 (1.0 2.0)"), &spec).unwrap_err().to_string();
    assert!(error.contains("received a matrix of 1 x 2"), "{error}");

    let radians = topic(MessageType::Ros(ros_type), [("degrees", false.into())]);
    let payload = read(typed("0.5 1.5"), &radians).unwrap();
    assert_eq!(floats(value(&payload).get("position")), [0.5, 1.5]);
    assert_eq!(shown(&bytes_of(&payload, &radians)), "0.5 1.5");
}

#[test]
fn the_extended_state_has_velocities_and_torques() {
    let spec = topic(MessageType::Ros(ros("sensor_msgs/msg/JointState")), []);
    let text = |velocity: &str| {
        format!(
            "(90.0 180.0) [ok] (180.0 0.0) {velocity} (0.0 0.0) [ok] (1.0 2.0) [ok] (0.0 0.0) [ok] \
             (0.0 0.0) [ok] (1.5 -2.5) 1 (0.0 0.0) [ok] (0.0 0.0) [ok] (1 1) [ok] (1 1) [ok]"
        )
    };
    for valid in ["[ok]", "true", "1"] {
        let fields = value(&read(typed(&text(valid)), &spec).unwrap());
        assert_eq!(floats(fields.get("position")), [FRAC_PI_2, PI]);
        assert_eq!(floats(fields.get("velocity")), [PI, 0.0]);
        assert_eq!(floats(fields.get("effort")), [1.5, -2.5]);
    }
    for invalid in ["[fail]", "false", "0"] {
        let fields = value(&read(typed(&text(invalid)), &spec).unwrap());
        assert!(floats(fields.get("velocity")).is_empty());
    }
    assert!(read(typed(&text("[maybe]")), &spec).is_err());
}

#[test]
fn positions_are_put_into_the_order_of_the_port() {
    let ros_type = ros("sensor_msgs/msg/JointState");
    let joints: Value = ["a", "b"].into_iter().collect();
    let spec = topic(MessageType::Ros(ros_type), [("joints", joints), ("degrees", false.into())]);
    let state = |names: &[&str], position: &[f64]| {
        let position = Tensor::from_elements(&[position.len()], position.to_vec()).unwrap();
        let names: Value = names.iter().copied().collect();
        message(ros_type, &Map::from([("name", names), ("position", position.into())]).into())
    };
    assert_eq!(shown(&bytes_of(&state(&["b", "c", "a"], &[2.0, 3.0, 1.0]), &spec)), "1.0 2.0");
    assert_eq!(shown(&bytes_of(&state(&[], &[1.0, 2.0]), &spec)), "1.0 2.0");
    for (names, position, wanted) in [
        (&["a", "c"][..], &[1.0, 2.0][..], "\"b\" among them, was given 2 others"),
        (&[], &[1.0], "expected 2 joints, as option joints names, was given 1 positions"),
        (&["a", "b"], &[1.0], "expected 2 positions, one a name, was given 1"),
    ] {
        let error = written(&state(names, position), &spec).unwrap_err().to_string();
        assert!(error.ends_with(wanted), "{error}");
    }
}

#[test]
fn any_other_message_is_pairs_of_field_and_value() {
    let ros_type = ros("sensor_msgs/msg/CompressedImage");
    let spec = topic(MessageType::Ros(ros_type), []);
    let time = Map::from([("sec", 5)]);
    let header = Map::from([("stamp", Value::from(time)), ("frame_id", "base".into())]);
    let data = Value::Bytes(vec![1, 255].into());
    let fields =
        Map::from([("header", Value::from(header)), ("format", "png".into()), ("data", data)]);
    let payload = message(ros_type, &fields.into());
    let out = written(&payload, &spec).unwrap();
    let text = shown(&out.payload.bytes);
    assert_eq!(
        text,
        "(header ((stamp ((sec 5) (nanosec 0))) (frame_id base))) (format png) (data {1 255})"
    );
    assert_eq!(out.stamp.unwrap().time_s, 5.0);
    assert_eq!(read(out.payload.bytes, &spec).unwrap(), payload);
    // The same over a text carrier, which makes lists of dicts.
    assert_eq!(read(typed(&text), &spec).unwrap(), payload);
    assert_eq!(read(typed(&text.replace("{1 255}", "(1 255)")), &spec).unwrap(), payload);

    // A message without a header is stamped by the envelope, or on arrival.
    let bare = value(&read(typed("(format png)"), &spec).unwrap());
    let stamp = bare.get("header").unwrap().get("stamp").unwrap();
    assert_eq!(stamp.get("sec"), Some(&NOW.sec.into()));

    let error = read(typed("(speed 1)"), &spec).unwrap_err().to_string();
    let start = "expected sensor_msgs/msg/CompressedImage, received other fields: ";
    assert!(error.starts_with(start) && error.contains("speed"), "{error}");
    assert!(read(typed("1 2 3"), &spec).is_err());

    let json = topic(MessageType::Ros(ros_type), [("bottle", false.into())]);
    let bytes = bytes_of(&payload, &json);
    assert!(shown(&bytes).starts_with(r#""{\"header\": "#), "{}", shown(&bytes));
    assert_eq!(read(bytes.clone(), &json).unwrap(), payload);
    assert_eq!(read(bytes, &spec).unwrap(), payload);
}
