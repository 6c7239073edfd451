//! `pose_mirror FROM TO`: reads poses from one ZeroMQ topic and sends them mirrored to another, in
//! the place of a Python Wrapyfi script. The broker is found as every Wrapyfi program finds it
//! (`WRAPYFI_ZEROMQ_SOCKET_*`).

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program for the terminal")]

use std::time::Duration;

use anyhow::{Context as _, bail};
use wrapyfi_core::endpoint::{Context, Middleware as _, PublishError, TopicSpec};
use wrapyfi_core::middleware::zeromq::BrokerMode;
use wrapyfi_core::plugin::standard;
use wrapyfi_core::types::{ForeignObject, MessageType, Payload, Value};
use wrapyfi_pose_plugin::{Pose2D, PosePlugin};

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(from), Some(to)) = (arguments.next(), arguments.next()) else {
        bail!("usage: pose_mirror FROM_TOPIC TO_TOPIC");
    };
    let zeromq = wrapyfi_core::zeromq().with(|settings| settings.broker = BrokerMode::Foreign);
    let zeromq = zeromq.start().context("starting ZeroMQ")?;
    let context = Context::default();
    let topic = |name: String| TopicSpec {
        plugins: standard().with(PosePlugin),
        ..TopicSpec::new(name, MessageType::NativeObject)
    };
    let mut listener = zeromq.open_listener(&topic(from), &context)?;
    let mut publisher = zeromq.open_publisher(&topic(to), &context)?;
    loop {
        match listener.take() {
            Ok(Some(sample)) => {
                let Payload::NativeObject(object) = sample.payload else { continue };
                let Some(pose) = object.as_object::<Pose2D>() else {
                    eprintln!("no pose but {object:?}");
                    continue;
                };
                println!("{pose:?}");
                let mirrored = ForeignObject::new(pose.mirrored());
                match publisher.publish(&Payload::from(Value::from(mirrored))) {
                    Ok(_) | Err(PublishError::NoConsumer(_)) => {}
                    Err(error) => eprintln!("{error}"),
                }
            }
            Ok(None) => _ = context.wake.wait(Duration::from_secs(1)),
            Err(error) => eprintln!("{error}"),
        }
    }
}
