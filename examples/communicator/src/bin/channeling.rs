//! Channeling: a method with three results, each on a middleware of its own. A receiver takes those
//! whose middleware it has; the others are `None`.
//!
//! ```text
//!                            ┌─ object ─▶ yarp    (None without a name server)
//!   read_mulret_mulmware() ──┼─ image ──▶ ros2    sensor_msgs/msg/Image
//!                            └─ sound ──▶ zeromq
//! ```
//!
//! `test/peers/channeling.py` is the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use clap::Parser;
use serde_json::json;
use wrapyfi_communicator_examples::{
    described_image, described_sound, image, log_to_stderr, pause, sound,
};
use wrapyfi_core::communicator::communicator;
use wrapyfi_core::types::{AudioChunk, Image, Map, Value};

/// Sends three kinds of data over three middlewares at once.
#[derive(Parser)]
struct Options {
    /// publish, listen, none or disable
    #[arg(long, default_value = "none")]
    mode: String,
    /// Middleware of the image; none unselects it
    #[arg(long, default_value = "ros2")]
    image_mware: String,
}

#[derive(Default)]
struct ChannelCls {
    calls: u8,
}

#[communicator]
impl ChannelCls {
    #[register(
        NativeObject,
        "yarp",
        "ChannelCls",
        "/example/native_yarp_msg",
        carrier = "mcast",
        should_wait = false
    )]
    #[register(
        Image,
        "$image_mware",
        "ChannelCls",
        "/example/image_ros_msg",
        carrier = "tcp",
        width = "$img_width",
        height = "$img_height",
        rgb = true,
        queue_size = 10,
        should_wait = false
    )]
    #[register(
        AudioChunk,
        "zeromq",
        "ChannelCls",
        "/example/audio_zmq_msg",
        carrier = "tcp",
        rate = "$aud_rate",
        chunk = "$aud_chunk",
        channels = "$aud_chann",
        should_wait = false
    )]
    fn read_mulret_mulmware(
        &mut self,
        image_mware: &str,
        img_width: u32,
        img_height: u32,
        aud_rate: u32,
        aud_chunk: u32,
        aud_chann: u8,
    ) -> (Value, Option<Image>, Option<AudioChunk>) {
        _ = image_mware; // for #[register]
        self.calls = self.calls.wrapping_add(1);
        let image = image(self.calls, img_width, img_height);
        let sound = sound(self.calls, aud_rate, aud_chunk, aud_chann);
        let object = Map::from([("call", Value::from(self.calls)), ("rate", aud_rate.into())]);
        (object.into(), image, sound)
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let options = Options::parse();
    let mut channels = ChannelCls::default().communicator();
    channels.activate(ChannelClsMethod::ReadMulretMulmware, options.mode.as_str())?;
    loop {
        let (object, image, sound) =
            channels.read_mulret_mulmware(&options.image_mware, 200, 100, 44_100, 8820, 1)?;
        // A message that a publisher chose not to send is no news either.
        let (image, sound) = (image.flatten(), sound.flatten());
        if object.is_some() || image.is_some() || sound.is_some() {
            let told = json!({
                "event": "message",
                "object": object,
                "image": image.as_ref().map(described_image),
                "sound": sound.as_ref().map(described_sound),
            });
            println!("{told}");
        }
        pause();
    }
}
