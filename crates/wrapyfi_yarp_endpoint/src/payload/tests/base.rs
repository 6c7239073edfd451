//! Lasers, mobile bases and calibrations of cameras, as real YARP writes and reads them.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use super::golden::hex;
use super::*;
use crate::intrinsics::Intrinsics;
use wrapyfi_data::types::Tensor;

/// Bytes of `yarp::sig::LaserScan2D` of YARP 3.12.3: -90 90 0.1 8 (1.5 inf 0.25 8) 1.
const SCAN: &str = "00010000060000000a00000000000000008056c00a00000000000000008056400a0000009a9999999999b93f0a0000\
     0000000000000020400a01000004000000000000000000f83f000000000000f07f000000000000d03f00000000000020400100000001000000";
/// `yarp::dev::OdometryData`: at 1.5 -2, turned by 90 degrees, 0.5 0.25 and 45 degrees a second.
const ODOMETRY: &str = "00010000090000000a000000000000000000f83f0a00000000000000000000c00a00000000000000008056400a00\
     0000000000000000e03f0a000000000000000000d03f0a00000000000000008046400a000000000000000000d0bf0a00000000\
     0000000000e03f0a0000000000000000804640";
/// `yarp::dev::MobileBaseVelocity`: 0.5 -0.25 and 90 degrees a second.
const VELOCITY: &str =
    "00010000030000000a000000000000000000e03f0a000000000000000000d0bf0a0000000000000000805640";

fn of(name: &str) -> MessageType {
    MessageType::Ros(ros(name))
}

fn number(fields: &Value, path: &str) -> f64 {
    let found = path.split('.').fold(fields, |fields, name| fields.get(name).unwrap());
    found.as_f64().unwrap()
}

fn bottle(bytes: impl Into<Bytes>) -> Bottle {
    let limits = wrapyfi_yarp::WireLimits::default();
    Bottle::decode_whole(&bytes.into(), Dialect::V3, &limits).unwrap()
}

fn near(found: f64, wanted: f64) {
    assert!((found - wanted).abs() < 1e-6, "{found}, not {wanted}");
}

fn numbers(fields: &Value, name: &str) -> Vec<f64> {
    fields.get(name).and_then(Value::as_tensor).and_then(Tensor::to_vec::<f64>).unwrap()
}

#[test]
fn a_scan_of_yarp_is_one_of_ros() {
    let spec = topic(of("sensor_msgs/msg/LaserScan"), [("frame_id", "laser".into())]);
    let payload = read(hex(SCAN), &spec).unwrap();
    let fields = value(&payload);
    near(number(&fields, "angle_min"), -FRAC_PI_2);
    near(number(&fields, "angle_increment"), FRAC_PI_4);
    // The last ray, as ROS counts: four rays are three steps.
    near(number(&fields, "angle_max"), FRAC_PI_4);
    near(number(&fields, "range_min"), 0.1);
    near(number(&fields, "range_max"), 8.0);
    let ranges = fields.get("ranges").and_then(Value::as_tensor).unwrap();
    assert_eq!(ranges.to_vec::<f32>().unwrap(), [1.5, f32::INFINITY, 0.25, 8.0]);
    assert_eq!(fields.get("header").unwrap().get("frame_id"), Some(&"laser".into()));
    // And back: YARP's last angle is the end of the last ray's share.
    let back = bottle(bytes_of(&payload, &spec));
    let real = bottle(hex(SCAN));
    assert_eq!((back.len(), back.get(4)), (6, real.get(4)));
    for (ours, theirs) in back.values.iter().zip(&real.values).take(4) {
        let (ours, theirs) = (ours.as_f64().unwrap(), theirs.as_f64().unwrap());
        // ROS has 32 bits for it.
        assert!((ours - theirs).abs() < 1e-4, "{ours}, not {theirs}");
    }
    let none = value(&read(typed("0.0 360.0 0.1 8.0 () 3"), &spec).unwrap());
    assert_eq!((number(&none, "angle_max"), number(&none, "angle_increment")), (0.0, 0.0));
    for text in
        ["1.0 2.0", "0.0 1.0 0.0 1.0 (1.0 x) 0", "0.0 1.0 0.0 (1.0) 0", "0.0 1.0 0.0 1.0 (1.0) x"]
    {
        let error = read(typed(text), &spec).unwrap_err().to_string();
        assert!(error.starts_with("expected a scan: angle_min angle_max"), "{text}: {error}");
    }
    let radians = topic(of("sensor_msgs/msg/LaserScan"), [("degrees", false.into())]);
    let fields = value(&read(typed("0.0 2.0 0.1 8.0 (1.0 1.0) 0"), &radians).unwrap());
    assert_eq!(number(&fields, "angle_increment"), 1.0);
}

#[test]
fn an_odometry_of_yarp_is_one_of_ros() {
    let kind = of("nav_msgs/msg/Odometry");
    let spec = topic(kind, []);
    let payload = read(hex(ODOMETRY), &spec).unwrap();
    let fields = value(&payload);
    for (path, wanted) in [
        ("pose.pose.position.x", 1.5),
        ("pose.pose.position.y", -2.0),
        ("pose.pose.orientation.z", FRAC_PI_4.sin()),
        ("pose.pose.orientation.w", FRAC_PI_4.cos()),
        ("twist.twist.linear.x", 0.5),
        ("twist.twist.linear.y", 0.25),
        ("twist.twist.angular.z", FRAC_PI_4),
    ] {
        near(number(&fields, path), wanted);
    }
    let frames = |fields: &Value| {
        let text = |value: &Value| value.as_str().unwrap().to_owned();
        let header = fields.get("header").unwrap();
        (text(header.get("frame_id").unwrap()), text(fields.get("child_frame_id").unwrap()))
    };
    assert_eq!(frames(&fields), ("odom".to_owned(), "base_link".to_owned()));
    assert_eq!(number(&fields, "header.stamp.sec"), f64::from(NOW.sec));
    let named = [("frame_id", "world".into()), ("child_frame_id", "base".into())];
    let own = value(&read(hex(ODOMETRY), &topic(kind, named)).unwrap());
    assert_eq!(frames(&own), ("world".to_owned(), "base".to_owned()));
    // And back, with the velocity in the world, which the robot's is turned into.
    let back = bottle(bytes_of(&payload, &spec));
    let real = bottle(hex(ODOMETRY));
    assert_eq!(back.len(), real.len());
    for (ours, theirs) in back.values.iter().zip(&real.values) {
        near(ours.as_f64().unwrap(), theirs.as_f64().unwrap());
    }
    for text in ["1.0 2.0 3.0", "1.0 2.0 3.0 4.0 5.0 6.0 7.0 8.0 9.0 10.0"] {
        let error = read(typed(text), &spec).unwrap_err().to_string();
        assert!(
            error.starts_with("expected 9 numbers of an odometry, received a vector of"),
            "{error}"
        );
    }
}

fn twist(x: f64, y: f64, turn: f64) -> Value {
    let vector = |x: f64, y: f64, z: f64| Value::from(Map::from([("x", x), ("y", y), ("z", z)]));
    // Motions that a base cannot make are left out.
    Map::from([("linear", vector(x, y, 9.0)), ("angular", vector(8.0, 7.0, turn))]).into()
}

#[test]
fn a_twist_is_the_velocity_of_a_base() {
    let (plain, stamped) = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped");
    let asked = twist(0.5, -0.25, FRAC_PI_2);
    let messages = [
        (plain, message(ros(plain), &asked)),
        (stamped, message(ros(stamped), &Map::from([("twist", asked)]).into())),
    ];
    let real = bottle(hex(VELOCITY));
    for (name, payload) in &messages {
        let of_base = |base: &str| topic(of(name), [("base", base.into())]);
        assert_eq!(shown(&bytes_of(payload, &of_base("velocity"))), real.to_text(), "{name}");
        let control = bytes_of(payload, &of_base("control"));
        assert_eq!(shown(&control), "3 0.5 -0.25 90.0 100.0", "{name}");
        // Without the option it is a message like any other.
        assert!(shown(&bytes_of(payload, &topic(of(name), []))).contains("(linear "), "{name}");
    }
    let radians = topic(of(plain), [("base", "velocity".into()), ("degrees", false.into())]);
    let slow = message(ros(plain), &twist(0.5, 0.25, 0.125));
    assert_eq!(shown(&bytes_of(&slow, &radians)), "0.5 0.25 0.125");
    let odd = message(ros(plain), &twist(0.5, f64::NAN, 0.0));
    let error = written(&odd, &radians).unwrap_err().to_string();
    assert_eq!(error, "expected a velocity of numbers, was given NaN");
}

#[test]
fn each_picture_has_the_calibration_of_its_camera() {
    let spec = topic(of("sensor_msgs/msg/CameraInfo"), [("frame_id", "eye".into())]);
    let told = Intrinsics {
        focal: [512.0, 510.0],
        center: [160.0, 120.0],
        model: "plumb_bob".to_owned(),
        distortion: [0.5, 0.25, 0.1, 0.2, 0.3],
    };
    let untold = YarpOptions::of_topic(&spec).unwrap();
    let options = YarpOptions { intrinsics: Some(told), ..untold.clone() };
    let envelope = Some(sig::Stamp { count: 1, time_s: 12.5 });
    for (code, pixel) in [(sig::PixelCode::Rgb, 3), (sig::PixelCode::Float, 4)] {
        let picture = sig::Image::from_packed(code, 5, 2, vec![7; 10 * pixel].into()).unwrap();
        let sent = Bytewise::object(picture.encode(sig::Rows::Announced).unwrap());
        let info = |options: &YarpOptions| {
            value(&decode(&sent, envelope, &spec, options, Dialect::V3, NOW).unwrap())
        };
        let fields = info(&options);
        assert_eq!((number(&fields, "width"), number(&fields, "height")), (5.0, 2.0));
        assert_eq!(number(&fields, "header.stamp.sec"), 12.0);
        assert_eq!(number(&fields, "header.stamp.nanosec"), 5e8);
        assert_eq!(fields.get("header").unwrap().get("frame_id"), Some(&"eye".into()));
        assert_eq!(fields.get("distortion_model"), Some(&"plumb_bob".into()));
        assert_eq!(numbers(&fields, "d"), [0.5, 0.25, 0.1, 0.2, 0.3]);
        assert_eq!(numbers(&fields, "k"), [512.0, 0.0, 160.0, 0.0, 510.0, 120.0, 0.0, 0.0, 1.0]);
        assert_eq!(numbers(&fields, "r"), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let projection = [512.0, 0.0, 160.0, 0.0, 0.0, 510.0, 120.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        assert_eq!(numbers(&fields, "p"), projection);
        // Zeros are ROS's word for no calibration.
        let fields = info(&untold);
        assert_eq!((number(&fields, "width"), numbers(&fields, "k")), (5.0, vec![0.0; 9]));
        assert_eq!(fields.get("distortion_model"), Some(&"".into()));
    }
    // Another program's messages are read as those of any type.
    let fields = value(&read(typed("(width 7) (height 3)"), &spec).unwrap());
    assert_eq!(number(&fields, "width"), 7.0);
}
