//! Every data type in every mode, the twin of `test/peers/pairs.py`: what `test/tests/pairs.rs` starts two
//! of.
//!
//! ```text
//!   pairs --mode transceive --kinds object,jpg --way-in /b --way-out /a
//!   {"event":"message","kind":"object","sent":{…},"received":{…}}      a line for each call
//! ```
//!
//! A request waits for its server for as long as a test waits: Python's starts late where the machine is busy.
//! One method for each kind on a topic of its own, called in turn. A body that was given something
//! returns it turned around, else a message that depends on a number that counts up.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

mod facts;
mod made;

use std::time::Duration;

use clap::Parser;
use serde_json::{Value as Json, json};
use wrapyfi_core::communicator::{CommunicatorContext, MethodError, Mode, communicator};
use wrapyfi_data::types::{AudioChunk, Image, Properties, RosMessage, Value};
use wrapyfi_interfaces::sensor_msgs::msg::JointState;
use wrapyfi_node::{args::RosArgs, read_params_file};

use facts::{described, described_jpeg};

/// One end of a pair.
#[derive(Parser)]
struct Options {
    /// publish, listen, …
    #[arg(long)]
    mode: Mode,
    /// Middleware
    #[arg(long, default_value = "zeromq")]
    mware: String,
    /// Methods: object, text, image, jpg, sound, twist, joints, properties
    #[arg(long, value_delimiter = ',', required = true)]
    kinds: Vec<Kind>,
    /// Topic from which messages come; the kind is put behind it
    #[arg(long)]
    way_in: String,
    /// Topic to which messages go; the kind is put behind it
    #[arg(long)]
    way_out: String,
    /// Arguments of ROS 2, behind `--`
    #[arg(last = true)]
    ros_args: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    Object,
    Text,
    Image,
    Jpg,
    Sound,
    Twist,
    Joints,
    Properties,
}

/// Messages that the body was given and made, as facts for the test.
#[derive(Default)]
struct Exchange {
    number: i64,
    given: Json,
    made: Json,
}

#[communicator]
impl Exchange {
    #[register(
        NativeObject,
        "$mware",
        "$way_in",
        timeout_ms = 100_000,
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn object(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        given: &Value,
        #[received] prev: Option<Value>,
    ) -> Value {
        _ = (mware, way_in, way_out);
        self.value(given, prev)
    }

    /// As Python Wrapyfi sends native objects over ROS 2.
    #[register(
        NativeObject,
        "$mware",
        "$way_in",
        message_type = "std_msgs/msg/String",
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn text(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        given: &Value,
        #[received] prev: Option<Value>,
    ) -> Value {
        _ = (mware, way_in, way_out);
        self.value(given, prev)
    }

    #[register(
        Image,
        "$mware",
        "$way_in",
        timeout_ms = 100_000,
        width = 64,
        height = 48,
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn image(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        given: &Value,
        #[received] prev: Option<Option<Image>>,
    ) -> Option<Image> {
        _ = (mware, way_in, way_out);
        self.was_given(given);
        self.given = described_or(prev.clone().flatten(), self.given.take());
        let image = match prev {
            Some(prev) => made::turned_image(&prev?),
            None => made::image(self.next()),
        };
        self.made = described_or(image.clone(), Json::Null);
        image
    }

    #[register(
        Image,
        "$mware",
        "$way_in",
        timeout_ms = 100_000,
        jpg = true,
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn jpg(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        given: &Value,
        #[received] prev: Option<Option<Image>>,
    ) -> Option<Image> {
        _ = (mware, way_in, way_out);
        self.was_given(given);
        let image = match prev {
            Some(prev) => {
                let prev = made::pixels(prev?)?;
                self.given = described_jpeg(&prev);
                made::turned_image(&prev)
            }
            None => made::plain_image(self.next()),
        };
        self.made = image.as_ref().map(described_jpeg).into();
        image
    }

    #[register(
        AudioChunk,
        "$mware",
        "$way_in",
        timeout_ms = 100_000,
        rate = 16000,
        channels = 2,
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn sound(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        given: &Value,
        #[received] prev: Option<Option<AudioChunk>>,
    ) -> Option<AudioChunk> {
        _ = (mware, way_in, way_out);
        self.was_given(given);
        self.given = described_or(prev.clone().flatten(), self.given.take());
        let sound = match prev {
            Some(prev) => made::turned_sound(&prev?),
            None => made::sound(self.next()),
        };
        self.made = described_or(sound.clone(), Json::Null);
        sound
    }

    /// A ROS message by name.
    #[register(
        RosMessage,
        "$mware",
        "$way_in",
        message_type = "geometry_msgs/msg/Twist",
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn twist(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        #[received] prev: Option<RosMessage>,
    ) -> RosMessage {
        _ = (mware, way_in, way_out);
        self.given = described_or(prev.clone(), Json::Null);
        let twist = made::twist(self.next(), prev);
        self.made = described(twist.clone());
        twist
    }

    /// A ROS message of a generated type.
    #[register(
        RosMessage,
        "$mware",
        "$way_in",
        listener_kwargs(in_topic = "$way_in"),
        publisher_kwargs(out_topic = "$way_out")
    )]
    fn joints(
        &mut self,
        mware: &str,
        way_in: &str,
        way_out: &str,
        #[received] prev: Option<JointState>,
    ) -> JointState {
        _ = (mware, way_in, way_out);
        self.given = prev.as_ref().and_then(made::payload).map(described).unwrap_or_default();
        let joints = made::joints(self.next(), prev);
        self.made = made::payload(&joints).map(described).unwrap_or_default();
        joints
    }

    /// The topic is the name of the node whose parameters are set or watched.
    #[register(Properties, "$mware", "$way_in")]
    fn properties(&mut self, mware: &str, way_in: &str) -> Properties {
        _ = (mware, way_in);
        let properties = made::properties(self.next());
        self.made = described(properties.clone());
        properties
    }
}

impl Exchange {
    fn next(&mut self) -> i64 {
        self.number += 1;
        self.number
    }

    fn was_given(&mut self, given: &Value) {
        if *given != Value::Null {
            self.given = described(given.clone());
        }
    }

    fn value(&mut self, given: &Value, prev: Option<Value>) -> Value {
        self.was_given(given);
        let value = match prev {
            Some(prev) => {
                self.given = described(prev.clone());
                made::turned_object(prev)
            }
            None => made::object(self.next()),
        };
        self.made = described(value.clone());
        value
    }
}

fn described_or<T: Into<wrapyfi_data::types::Payload>>(found: Option<T>, other: Json) -> Json {
    found.map_or(other, described)
}

fn main() -> anyhow::Result<()> {
    let filter = tracing_subscriber::EnvFilter::new("info");
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    let options = Options::parse();
    let mode = options.mode;
    let args = RosArgs::parse(options.ros_args.iter().cloned(), read_params_file)?;
    let context = CommunicatorContext::builder().ros_args(args).build();
    let mut exchange = Exchange::default().communicator_in(&context);
    for &method in <ExchangeMethod as wrapyfi_core::communicator::Method>::ALL {
        // Parameters have no second way.
        if method != ExchangeMethod::Properties || !mode.feeds_body() {
            exchange.activate(method, mode)?;
        }
    }
    loop {
        for &kind in &options.kinds {
            exchange.inner_mut().given = Json::Null;
            exchange.inner_mut().made = Json::Null;
            // A client's argument is its question; a server's own argument is not looked at.
            let asks = mode == Mode::Request;
            let given = if asks { made::object(exchange.inner_mut().next()) } else { Value::Null };
            let returned = call(&mut exchange, kind, &options, &given)?;
            let inner = exchange.inner_mut();
            let (made, was_given) = (inner.made.take(), inner.given.take());
            let (sent, received) = match mode {
                Mode::Request => (described(given), returned),
                Mode::Listen => (Json::Null, returned),
                Mode::Transceive => (made, returned),
                Mode::Receive => (Json::Null, was_given),
                _ => (made, was_given),
            };
            println!(
                "{}",
                json!({
                    "event": "message",
                    "kind": format!("{kind:?}").to_lowercase(),
                    "sent": sent,
                    "received": received,
                })
            );
        }
        if mode == Mode::Publish {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Calls the method, and describes the value that it returned.
fn call(
    exchange: &mut ExchangeCommunicator,
    kind: Kind,
    options: &Options,
    given: &Value,
) -> Result<Json, MethodError> {
    let Options { mware, way_in, way_out, .. } = options;
    let behind = |way: &str| format!("{way}/{}", format!("{kind:?}").to_lowercase());
    let (there, back) = (behind(way_in), behind(way_out));
    let (there, back) = (there.as_str(), back.as_str());
    Ok(match kind {
        Kind::Object => described_or(exchange.object(mware, there, back, given, None)?, Json::Null),
        Kind::Text => described_or(exchange.text(mware, there, back, given, None)?, Json::Null),
        Kind::Image => {
            let image = exchange.image(mware, there, back, given, None)?;
            described_or(image.flatten(), Json::Null)
        }
        Kind::Jpg => {
            let image = exchange.jpg(mware, there, back, given, None)?.flatten();
            image.and_then(made::pixels).as_ref().map(described_jpeg).into()
        }
        Kind::Sound => {
            let sound = exchange.sound(mware, there, back, given, None)?;
            described_or(sound.flatten(), Json::Null)
        }
        Kind::Twist => described_or(exchange.twist(mware, there, back, None)?, Json::Null),
        Kind::Joints => {
            let joints = exchange.joints(mware, there, back, None)?;
            described_or(joints.as_ref().and_then(made::payload), Json::Null)
        }
        // Not a topic but a node: nothing is put behind it.
        Kind::Properties => described_or(exchange.properties(mware, way_in)?, Json::Null),
    })
}
