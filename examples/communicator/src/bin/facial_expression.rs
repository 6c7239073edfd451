//! Imitation of facial expressions, the first use case of Wrapyfi's paper: forwarding between two
//! robots, each on its own middleware, and a recogniser that both share.
//!
//! ```text
//!   --role pepper (ros2)                --role recogniser                 --role icub (zeromq)
//!   acquire() ─▶ /pepper/image ───────▶ acquire(), recognise
//!   express() ◀─ /pepper/expression ◀── express()
//!    colours                            then the other robot
//!                                       acquire(), recognise ◀── /icub/image ◀──── acquire()
//!                                       express() ─────▶ /icub/expression ───────▶ express()
//!                                                                                   a face
//! ```
//!
//! THE RECOGNISER IS A STAND-IN: it names frames by their brightness and knows nothing about faces. The
//! module `face` says how, and every message of it says so too.
//!
//! `test/peers/facial_expression.py` is the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::path::{Path, PathBuf};

use clap::{Parser, ValueEnum};
use serde_json::json;
use wrapyfi_communicator_examples::camera::Camera;
use wrapyfi_communicator_examples::face::{self, Recognised};
use wrapyfi_communicator_examples::{log_to_stderr, pause, picture};
use wrapyfi_core::communicator::{Mode, communicator};
use wrapyfi_core::types::Image;

/// Sees a face and shows its expression, or recognises it for others.
#[derive(Parser)]
struct Options {
    /// Place in the chain
    #[arg(long)]
    role: Role,
    /// Middleware of Pepper
    #[arg(long, default_value = "ros2")]
    pepper_mware: String,
    /// Middleware of iCub
    #[arg(long, default_value = "zeromq")]
    icub_mware: String,
    /// A robot's eyes: folder of PNG files, or a device; left out, all shades of grey
    #[arg(long)]
    source: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Role {
    Pepper,
    Icub,
    Recogniser,
}

/// A robot, here or far away.
#[derive(Default)]
struct Robot {
    eyes: Option<Camera>,
    fault: Option<anyhow::Error>,
}

#[communicator]
impl Robot {
    // Only the newest frame is worth recognising.
    #[register(Image, "$mware", "Robot", "$topic", rgb = true, queue_size = 1, should_wait = false)]
    fn acquire(&mut self, mware: &str, topic: &str) -> Option<Image> {
        _ = (mware, topic); // for #[register]
        match self.eyes.as_mut()?.frame() {
            Ok(frame) => frame.map(picture::taken_now),
            Err(fault) => {
                self.fault = Some(fault);
                None
            }
        }
    }

    #[register(NativeObject, "$mware", "Robot", "$topic", should_wait = false)]
    fn express(&self, mware: &str, topic: &str, seen: Option<Recognised>) -> Option<Recognised> {
        _ = (mware, topic);
        seen
    }
}

/// Properties in which the robots differ: name, middleware, topics.
struct Place {
    name: &'static str,
    mware: String,
    image: &'static str,
    expression: &'static str,
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let Options { role, pepper_mware, icub_mware, source } = Options::parse();
    let pepper = Place {
        name: "pepper",
        mware: pepper_mware,
        image: "/pepper/image",
        expression: "/pepper/expression",
    };
    let icub = Place {
        name: "icub",
        mware: icub_mware,
        image: "/icub/image",
        expression: "/icub/expression",
    };
    match role {
        Role::Recogniser => recognise(&[pepper, icub]),
        Role::Pepper => imitate(&pepper, eyes(source.as_deref())?),
        Role::Icub => imitate(&icub, eyes(source.as_deref())?),
    }
}

fn eyes(source: Option<&Path>) -> anyhow::Result<Camera> {
    match source {
        Some(_) => Camera::open(source, true, 640, 480),
        None => Ok(Camera::shades(64, 48)),
    }
}

/// Role in the middle: looks through one robot's camera after the other and tells each what to
/// show.
fn recognise(places: &[Place]) -> anyhow::Result<()> {
    let mut robots = Vec::new();
    for place in places {
        let mut robot = Robot::default().communicator();
        robot.activate(RobotMethod::Acquire, Mode::Listen)?;
        robot.activate(RobotMethod::Express, Mode::Publish)?;
        robots.push((place, robot));
    }
    loop {
        for (place, robot) in &mut robots {
            let Some(frame) = robot.acquire(&place.mware, place.image)?.flatten() else {
                continue;
            };
            let seen = match picture::pixels(&frame) {
                Ok(pixels) => face::stand_in(&pixels),
                // One robot's broken frame must not end the other's imitation.
                Err(reason) => {
                    tracing::warn!("a frame of {} is passed over: {reason:#}", place.name);
                    continue;
                }
            };
            if let Some(seen) = robot.express(&place.mware, place.expression, seen)?.flatten() {
                println!("{}", json!({ "event": "message", "robot": place.name, "seen": seen }));
            }
        }
        pause();
    }
}

/// Role on a robot: sends its pictures and shows the expressions that come back.
fn imitate(place: &Place, eyes: Camera) -> anyhow::Result<()> {
    let mut robot = Robot { eyes: Some(eyes), fault: None }.communicator();
    robot.activate(RobotMethod::Acquire, Mode::Publish)?;
    robot.activate(RobotMethod::Express, Mode::Listen)?;
    loop {
        robot.acquire(&place.mware, place.image)?;
        if let Some(fault) = robot.inner_mut().fault.take() {
            return Err(fault);
        }
        if let Some(seen) = robot.express(&place.mware, place.expression, None)?.flatten() {
            let shown = match place.name {
                "pepper" => json!(face::colour(&seen.expression)),
                _ => json!(face::face(&seen.expression)),
            };
            let told =
                json!({ "event": "message", "robot": place.name, "seen": seen, "shows": shown });
            println!("{told}");
        }
        // A camera of about 20 frames a second.
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}
