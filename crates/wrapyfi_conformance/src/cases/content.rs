//! Messages of every type arrive as they were sent.

use wrapyfi_data::types::{CompressedFormat, Encoding, MessageType, Payload, SampleFormat};
use wrapyfi_endpoint::TopicSpec;

use crate::payloads::{file, frame, in_frame, number, rich, sound};
use crate::{Testbed, WireEnd, connect};

/// Sends each payload over a topic of its own, both ways.
#[track_caller]
fn arrive_unchanged<R: Testbed>(
    message_type: MessageType,
    payloads: impl IntoIterator<Item = (Payload, Encoding)>,
) {
    let testbed = R::start();
    for (index, (payload, color_order)) in payloads.into_iter().enumerate() {
        let payload =
            if R::CAPABILITIES.frame_id { in_frame(payload, "optical_frame") } else { payload };
        for from in WireEnd::BOTH {
            let mut spec = TopicSpec::new(format!("/{from:?}_{index}"), message_type);
            spec.color_order = color_order;
            let (mut source, mut sink) = connect(&testbed, from, &spec);
            source.send(&payload);
            // Not assert_eq: a failure would print megabytes.
            let arrived = sink.receive();
            assert!(arrived == payload, "payload {index} from {from:?}: {}", shorten(&arrived));
            let counters = sink.counters();
            assert_eq!((counters.received, counters.dropped()), (1, 0));
        }
    }
}

fn shorten(payload: &Payload) -> String {
    format!("{payload:?}").chars().take(2000).collect()
}

fn in_any_order(payload: Payload) -> (Payload, Encoding) {
    (payload, Encoding::Bgr8)
}

/// `wrapyfi_msgs/msg/NativeObject`: everything Wrapyfi's JSON can write.
pub fn native_objects_arrive_unchanged<R: Testbed>() {
    let payloads = [rich(), number(1)].map(in_any_order);
    arrive_unchanged::<R>(MessageType::NativeObject, payloads);
}

/// `std_msgs/msg/String`: the same as text.
pub fn text_objects_arrive_unchanged<R: Testbed>() {
    let payloads = [rich(), number(1)].map(in_any_order);
    arrive_unchanged::<R>(MessageType::StringJson, payloads);
}

/// `sensor_msgs/msg/Image` in every encoding, and one of a camera's size.
pub fn raw_images_arrive_unchanged<R: Testbed>() {
    let is_kept = |encoding: &Encoding| {
        R::CAPABILITIES.names_encodings || !encoding.name().starts_with("bayer_")
    };
    let small = Encoding::ALL.into_iter().filter(is_kept).map(|encoding| (17, 5, encoding));
    let payloads = small.chain([(1280, 720, Encoding::Bgr8)]).map(|(w, h, encoding)| {
        // A wire without channel order has both sides told of it.
        let order = match encoding {
            Encoding::Rgb8 | Encoding::Rgba8 => Encoding::Rgb8,
            _ => Encoding::Bgr8,
        };
        (frame(w, h, encoding), order)
    });
    arrive_unchanged::<R>(MessageType::Image, payloads);
}

/// `sensor_msgs/msg/CompressedImage`: the file byte for byte.
pub fn image_files_arrive_unchanged<R: Testbed>() {
    let payloads =
        [CompressedFormat::Jpeg, CompressedFormat::Png].map(|format| in_any_order(file(format)));
    arrive_unchanged::<R>(MessageType::CompressedImage, payloads);
}

/// `wrapyfi_msgs/msg/AudioChunk`.
pub fn sound_arrives_unchanged<R: Testbed>() {
    let mut payloads = Vec::new();
    if R::CAPABILITIES.float_sound {
        payloads.extend([
            sound(1024, 1, SampleFormat::F32Le),
            sound(441, 2, SampleFormat::F32Le),
            sound(0, 1, SampleFormat::F32Le),
        ]);
    }
    if R::CAPABILITIES.integer_sound {
        payloads.push(sound(441, 2, SampleFormat::S16Le));
    }
    arrive_unchanged::<R>(MessageType::AudioChunk, payloads.into_iter().map(in_any_order));
}

/// `wrapyfi_ros2_interfaces/msg/ROS2AudioMessage`, which carries floats.
pub fn upstream_sound_arrives_unchanged<R: Testbed>() {
    let payloads = [sound(1024, 1, SampleFormat::F32Le), sound(441, 2, SampleFormat::F32Le)];
    arrive_unchanged::<R>(MessageType::UpstreamAudio, payloads.map(in_any_order));
}
