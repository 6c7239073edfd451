//! Every data type, one method each: what a program of one's own looks like that speaks with
//! `test/peers/wrapyfi_peer.py` or any other Wrapyfi script.
//!
//! `exchange --type Image --mode listen --topic /camera` prints a line of JSON for each frame.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use clap::Parser;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use wrapyfi_communicator_examples::{
    described_image, described_sound, image, log_to_stderr, pause, sound,
};
use wrapyfi_core::communicator::{Mode, communicator};
use wrapyfi_core::types::{AudioChunk, DataType, Image, Map, Properties, Tensor, Value};

/// Publishes or receives one data type.
#[derive(Parser)]
struct Options {
    /// NativeObject, Image, AudioChunk or Properties
    #[arg(long = "type", default_value = "NativeObject")]
    data_type: DataType,
    /// publish, listen, …
    #[arg(long)]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
    /// Topic; for Properties on ROS 2 the name of a node
    #[arg(long)]
    topic: String,
    /// JPEG files instead of pixels
    #[arg(long)]
    jpg: bool,
    /// The same, of this quality, from 0 to 100
    #[arg(long)]
    quality: Option<u8>,
    /// Address of the broker of objects; a publisher runs the broker there if it is one of this machine
    #[arg(long)]
    socket_ip: Option<String>,
    /// That broker may be reached by other machines
    #[arg(long)]
    insecure: bool,
}

/// The option `jpg`, which Wrapyfi writes in two ways.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(untagged)]
enum Jpg {
    Is(bool),
    Of { quality: u8 },
}

struct Exchange {
    calls: u8,
}

#[communicator]
impl Exchange {
    #[register(NativeObject, "$mware", "$topic", socket_ip = "$socket_ip", insecure = "$insecure")]
    fn object(
        &mut self,
        mware: &str,
        topic: &str,
        socket_ip: &Option<String>,
        insecure: bool,
    ) -> Value {
        _ = (mware, topic, socket_ip, insecure);
        self.calls = self.calls.wrapping_add(1);
        let ramp: Vec<f32> = (0..=self.calls).map(f32::from).collect();
        let ramp = Tensor::from_elements(&[usize::from(self.calls) + 1], ramp);
        let pair = Value::Tuple(vec![self.calls.into(), "b".into()]);
        let entries = [("seq", self.calls.into()), ("pair", pair), ("ramp", ramp.ok().into())];
        Map::from(entries).into()
    }

    #[register(Image, "$mware", "$topic", jpg = "$jpg")]
    fn image(&mut self, mware: &str, topic: &str, jpg: Jpg) -> Option<Image> {
        _ = (mware, topic, jpg);
        self.calls = self.calls.wrapping_add(1);
        image(self.calls, 64, 48)
    }

    #[register(AudioChunk, "$mware", "$topic")]
    fn sound(&mut self, mware: &str, topic: &str) -> Option<AudioChunk> {
        _ = (mware, topic);
        self.calls = self.calls.wrapping_add(1);
        sound(self.calls, 16_000, 441, 1)
    }

    #[register(Properties, "$mware", "$topic")]
    fn properties(&mut self, mware: &str, topic: &str) -> Properties {
        _ = (mware, topic);
        self.calls = self.calls.wrapping_add(1);
        Properties::from([("gain", f64::from(self.calls) + 0.5)])
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let options = Options::parse();
    let Options { data_type, mode, mware, topic, socket_ip, insecure, .. } = options;
    let jpg = options.quality.map_or(Jpg::Is(options.jpg), |quality| Jpg::Of { quality });
    let mut exchange = Exchange { calls: 0 }.communicator();
    for method in ["object", "image", "sound", "properties"] {
        exchange.activate(method, mode)?;
    }
    loop {
        let told = match data_type {
            DataType::Image => {
                exchange.image(&mware, &topic, jpg)?.flatten().as_ref().map(described_image)
            }
            DataType::AudioChunk => {
                exchange.sound(&mware, &topic)?.flatten().as_ref().map(described_sound)
            }
            DataType::Properties => exchange
                .properties(&mware, &topic)?
                .map(|properties| json!({ "value": properties.to_value() })),
            _ => exchange
                .object(&mware, &topic, &socket_ip, insecure)?
                .as_ref()
                .map(described_object),
        };
        if let Some(Json::Object(mut told)) = told {
            told.insert("event".to_owned(), "message".into());
            println!("{}", Json::Object(told));
        }
        if mode == Mode::Publish {
            pause();
        }
    }
}

/// Facts that tell one object from another.
fn described_object(object: &Value) -> Json {
    let ramp = object.get("ramp").and_then(Value::as_tensor);
    json!({
        "seq": object.get("seq").and_then(Value::as_i64),
        "pair": object.get("pair").map(Value::kind),
        "ramp": ramp.map(|ramp| ramp.shape().to_vec()),
        "greeting": object.get("greeting").and_then(Value::as_str),
    })
}
