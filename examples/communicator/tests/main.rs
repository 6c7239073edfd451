//! The listings of Wrapyfi's paper as docs/reference/communicator.md shows them: compiled and run here, and compared
//! with the guide's text. The first one is a program, `read_msg`.
//!
//! Middlewares are in memory, under the names of those that the listings ask for.

#![allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]

use std::sync::Arc;
use std::thread;

use wrapyfi_communicator_examples::{pixels, samples};
use wrapyfi_core::communicator::{CommunicatorContext, Mode, communicator};
use wrapyfi_core::middleware::memory::Memory;
use wrapyfi_core::types::{
    AudioChunk, Dtype, Encoding, Image, ParameterValue, Properties, RawPixels, SampleFormat, Stamp,
    Tensor, Value,
};

// Listing 2
struct ForwardCls;

#[communicator]
impl ForwardCls {
    #[register(
        NativeObject,
        "yarp",
        "ForwardCls",
        "/example/native_yarp_msg",
        carrier = "mcast",
        should_wait = true
    )]
    fn send_yarp(&self, msg: &str) -> String {
        msg.to_owned()
    }

    #[register(
        NativeObject,
        "zeromq",
        "ForwardCls",
        "/example/native_zmq_msg",
        carrier = "tcp",
        should_wait = true
    )]
    fn send_zmq(&self, msg: &str) -> String {
        msg.to_owned()
    }
}
// End

// Listing 3
struct ChannelCls;

#[communicator]
impl ChannelCls {
    #[register(
        NativeObject,
        "yarp",
        "ChannelCls",
        "/example/native_yarp_msg",
        carrier = "mcast",
        should_wait = true
    )]
    #[register(
        Image,
        "ros2",
        "ChannelCls",
        "/example/image_ros_msg",
        carrier = "tcp",
        width = "$img_width",
        height = "$img_height",
        rgb = true,
        queue_size = 10
    )]
    #[register(
        AudioChunk,
        "zeromq",
        "ChannelCls",
        "/example/audio_zmq_msg",
        carrier = "tcp",
        rate = "$aud_rate",
        chunk = "$aud_chunk",
        channels = "$aud_chann"
    )]
    fn read_mulret_mulmware(
        &self,
        img_width: u32,
        img_height: u32,
        aud_rate: u32,
        aud_chunk: u32,
        aud_chann: u8,
    ) -> (Value, Option<Image>, Option<AudioChunk>) {
        let frame = vec![7; img_width as usize * img_height as usize * 3];
        let wave = 0.5_f32.to_le_bytes().repeat(aud_chunk as usize * usize::from(aud_chann));
        let arrays = [
            Tensor::new(Dtype::U8, [img_height as usize, img_width as usize, 3], frame.clone()),
            Tensor::new(Dtype::F32, [aud_chunk as usize, aud_chann.into()], wave.clone()),
        ];
        let yarp_native = Value::List(arrays.map(|array| Value::from(array.ok())).to_vec());
        let pixels = RawPixels::dense(img_width, img_height, Encoding::Bgr8, frame);
        let ros_img = pixels.ok().map(|pixels| Image::new(Stamp::now(), pixels));
        let float = SampleFormat::F32Le;
        let zeromq_aud = AudioChunk::new(Stamp::now(), aud_chunk, aud_chann, aud_rate, float, wave);
        (yarp_native, ros_img, zeromq_aud.ok())
    }
}
// End

struct Settings {
    gain: f64,
}

#[communicator]
impl Settings {
    #[register(Properties, "ros2", "/camera")]
    fn settings(&self) -> Properties {
        Properties::from([("gain", self.gain)])
    }
}

/// A context whose middlewares are in memory and have these names.
fn context(names: &[&str]) -> CommunicatorContext {
    let buses = names.iter().map(|name| Arc::new(Memory::new(*name)));
    let builder = CommunicatorContext::builder();
    let mut is_first = true;
    let all = buses.fold(builder, |builder, bus| {
        if std::mem::take(&mut is_first) { builder.only(bus) } else { builder.middleware(bus) }
    });
    all.build()
}

#[test]
fn a_message_is_forwarded() {
    let context = context(&["yarp", "zeromq"]);
    let start = |first: Mode, second: Mode| {
        let mut chain = ForwardCls.communicator_in(&context);
        chain.activate(ForwardClsMethod::SendYarp, first).unwrap();
        chain.activate(ForwardClsMethod::SendZmq, second).unwrap();
        chain
    };
    let source = start(Mode::Publish, Mode::Disable);
    let middle = start(Mode::Listen, Mode::Publish);
    let sink = start(Mode::Disable, Mode::Listen);
    thread::scope(|scope| {
        scope.spawn(|| assert_eq!(source.send_yarp("hi").unwrap().as_deref(), Some("hi")));
        scope.spawn(|| {
            let msg = middle.send_yarp("").unwrap().unwrap();
            middle.send_zmq(&msg).unwrap();
        });
        assert_eq!(sink.send_zmq("").unwrap().as_deref(), Some("hi"));
        assert_eq!(sink.send_yarp("").unwrap(), None);
    });
}

/// Publishes three values in `here` and returns what a listener there gets.
fn channelled(names: &[&str]) -> (Option<Value>, Option<Image>, Option<AudioChunk>) {
    let context = context(names);
    let mut channels = [(); 2].map(|()| ChannelCls.communicator_in(&context));
    for (channel, mode) in channels.iter_mut().zip([Mode::Publish, Mode::Listen]) {
        channel.activate(ChannelClsMethod::ReadMulretMulmware, mode).unwrap();
    }
    let [here, there] = &channels;
    let (object, image, sound) = thread::scope(|scope| {
        let there = scope.spawn(|| there.read_mulret_mulmware(20, 10, 44_100, 8820, 1).unwrap());
        here.read_mulret_mulmware(20, 10, 44_100, 8820, 1).unwrap();
        there.join().unwrap()
    });
    (object, image.flatten(), sound.flatten())
}

#[test]
fn three_values_take_three_middlewares() {
    let (object, image, sound) = channelled(&["yarp", "ros2", "zeromq"]);
    let (image, sound) = (image.unwrap(), sound.unwrap());
    let arrays = [pixels(&image), samples(&sound)];
    assert_eq!(arrays.each_ref().map(Option::is_some), [true; 2]);
    assert_eq!(object, Some(Value::List(arrays.map(Value::from).to_vec())));
    assert_eq!(sound.frames, 8820);
}

#[test]
fn a_missing_middleware_leaves_its_value_out() {
    let (object, image, sound) = channelled(&["ros2", "zeromq"]);
    assert_eq!((object, image.is_some(), sound.is_some()), (None, true, true));
}

#[test]
fn properties_are_carried() {
    let context = context(&["ros2"]);
    let mut ends = [(); 2].map(|()| Settings { gain: 2.5 }.communicator_in(&context));
    for (end, mode) in ends.iter_mut().zip([Mode::Publish, Mode::Listen]) {
        end.activate(SettingsMethod::Settings, mode).unwrap();
    }
    let [here, there] = &ends;
    thread::scope(|scope| {
        let there = scope.spawn(|| there.settings().unwrap().unwrap());
        here.settings().unwrap();
        let gain = there.join().unwrap().get("gain").cloned();
        assert_eq!(gain, Some(ParameterValue::Double(2.5)));
    });
}

/// Text without what formatting may change.
fn bare(code: &str) -> String {
    let text: String = code.split_whitespace().collect();
    text.replace(",)", ")").replace(",]", "]").replace(",}", "}")
}

#[test]
fn the_guides_show_what_runs_here() {
    let guides = [
        include_str!("../../../docs/reference/communicator.md"),
        include_str!("../../../docs/rust.md"),
    ];
    let guides = guides.map(bare).concat();
    let mut count = 0;
    let sources = [
        include_str!("../src/bin/mirror.rs"),
        include_str!("../src/bin/read_msg.rs"),
        include_str!("main.rs"),
    ];
    for part in sources.iter().flat_map(|source| source.split("\n// Listing ").skip(1)) {
        let (listing, _) = part.split_once("\n// End\n").unwrap();
        let (number, code) = listing.split_once('\n').unwrap();
        assert!(guides.contains(&bare(code)), "listing {number} is another one in the guide");
        count += 1;
    }
    assert_eq!(count, 4);
}
