//! Bytes of any program: nothing panics, and what was read can be written.

use proptest::prelude::*;

use super::*;
use wrapyfi_data::types::ServiceKind;
use wrapyfi_endpoint::ServiceSpec;

fn topics() -> Vec<TopicSpec> {
    let named = [
        "std_msgs/msg/Float64MultiArray",
        "sensor_msgs/msg/JointState",
        "std_msgs/msg/Header",
        "sensor_msgs/msg/Imu",
        "geometry_msgs/msg/WrenchStamped",
        "tf2_msgs/msg/TFMessage",
        "sensor_msgs/msg/LaserScan",
        "sensor_msgs/msg/CameraInfo",
        "nav_msgs/msg/Odometry",
    ];
    let types = MessageType::ALL.into_iter().chain(named.map(|name| MessageType::Ros(ros(name))));
    types
        .flat_map(|kind| {
            [
                topic(kind, []),
                topic(kind, [("bottle", true.into()), ("packed_rows", true.into())]),
                topic(kind, [("bottle", "property".into()), ("wrapyfi_images", true.into())]),
            ]
        })
        .collect()
}

fn all(bytes: &Bytes, dialect: Dialect) {
    for spec in topics() {
        let options = YarpOptions::of_topic(&spec).unwrap();
        let sent = Bytewise::object(bytes.clone());
        if let Ok(payload) = decode(&sent, None, &spec, &options, dialect, NOW) {
            // As a route does, which has one form of pictures.
            let payload = spec.conversion().convert(payload, || NOW).unwrap();
            let back = encode(&payload, &spec, &options, dialect);
            // A picture may have no place on a port of Wrapyfi, and bytes have none in JSON;
            // everything else goes back.
            let known = matches!(&back, Err(EncodeError::Unrepresentable { format, .. })
                if *format == "JSON" || (*format == "image" && options.wrapyfi_images));
            assert!(back.is_ok() || known, "{back:?}");
        }
    }
    let trigger =
        ServiceKind::resolve("std_srvs/srv/SetBool", &mut TypeStore::generated()).unwrap();
    for kind in ServiceKind::ALL.into_iter().chain([trigger]) {
        let spec = ServiceSpec::new("/s", kind);
        for bottle in [None, Some(BottleFormat::Bottle), Some(BottleFormat::Property)] {
            let options = YarpOptions { bottle, ..YarpOptions::default() };
            _ = decode_request(bytes, &spec, &options, dialect);
            _ = decode_reply(bytes, &spec, &options, dialect, NOW);
        }
    }
}

/// Messages of every kind, to be cut and changed.
fn seeds() -> Vec<Bytes> {
    let sound = sig::Sound::from_interleaved(&[1, 2, 3, 4], 2, 8000).unwrap();
    let image = sig::Image::from_packed(sig::PixelCode::Rgb, 2, 2, vec![7; 12].into()).unwrap();
    let matrix = sig::Matrix::new(2, 2, vec![1.0, 2.0, 3.0, 4.0]).unwrap();
    vec![
        sound.encode(Dialect::V3).unwrap().into(),
        image.encode(sig::Rows::Announced).unwrap().into(),
        matrix.encode(Dialect::V3).unwrap().into(),
        typed("1.0 2.0").into(),
        typed("1.0 2.0 3.0 4.0 5.0 6.0").into(),
        typed("0 ((root head 5.5 0 1.0 2.0 3.0 0.0 0.0 0.0 1.0))").into(),
        typed("(((1.0 2.0 3.0) 0.5)) () () () () (((1.0 2.0 3.0 4.0 5.0 6.0) 1.5))").into(),
        typed("[set] (a 1) ((b 2)) \"{\\\"x\\\": 1}\"").into(),
        typed("\"[{\\\"__wrapyfi__\\\": [\\\"tuple\\\", []]}, {}]\"").into(),
        typed("(frame_id map) (stamp ((sec 1)))").into(),
    ]
}

#[test]
fn every_message_in_every_place() {
    seeds().iter().for_each(|bytes| all(bytes, Dialect::V3));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn arbitrary_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..200), v4: bool) {
        all(&bytes.into(), if v4 { Dialect::V4 } else { Dialect::V3 });
    }

    #[test]
    fn damaged_messages(
        which in 0_usize..7, at: prop::sample::Index, byte: u8, end: prop::sample::Index, v4: bool,
    ) {
        let mut bytes = seeds().swap_remove(which).to_vec();
        let at = at.index(bytes.len());
        bytes[at] = byte;
        bytes.truncate(end.index(bytes.len() + 1).max(at));
        all(&bytes.into(), if v4 { Dialect::V4 } else { Dialect::V3 });
    }
}
