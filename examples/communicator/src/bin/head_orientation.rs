//! Imitation of a head's orientation, the second use case of Wrapyfi's paper: channeling. One method
//! returns what two sensors measure, each on a middleware of its own; a robot selects the one it follows.
//!
//! ```text
//!   --role sensors                                  --role robot --source worn | seen | both
//!   orientations() ─┬─ worn: eye tracker, IMU ─▶ zeromq ─┐
//!                   └─ seen: pose in a frame ──▶ ros2 ───┴─▶ orientations() ─▶ neck and eyes follow
//!                                                            what is not selected is None
//! ```
//!
//! BOTH SENSORS ARE STAND-INS, a circle and the middle of a frame's brightness: the module `head` says how.
//!
//! `test/peers/head_orientation.py` is the same program in Python.

#![allow(clippy::print_stdout, reason = "a program for the terminal")]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use serde_json::json;
use wrapyfi_communicator_examples::camera::Camera;
use wrapyfi_communicator_examples::head::{self, Choice, Head, Orientation};
use wrapyfi_communicator_examples::{log_to_stderr, pause};
use wrapyfi_core::communicator::{Mode, communicator};

/// Measures where a head points, or follows it.
#[derive(Parser)]
struct Options {
    /// Place in the scene
    #[arg(long)]
    role: Role,
    /// Source that the robot follows; of both, the worn one where it is there
    #[arg(long, default_value = "both")]
    source: Source,
    /// Middleware of the eye tracker
    #[arg(long, default_value = "zeromq")]
    worn_mware: String,
    /// Middleware of the camera
    #[arg(long, default_value = "ros2")]
    seen_mware: String,
    /// Frames of the camera: folder of PNG files, or a device; left out, they are drawn
    #[arg(long)]
    frames: Option<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Role {
    Sensors,
    Robot,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Source {
    Worn,
    Seen,
    Both,
}

#[derive(Default)]
struct Imitation {
    camera: Option<Camera>,
    fault: Option<anyhow::Error>,
    measured: u32,
}

#[communicator]
impl Imitation {
    // A middleware of "none" leaves a value out.
    #[register(
        NativeObject,
        "$worn_mware",
        "Imitation",
        "/head/worn",
        queue_size = 1,
        should_wait = false
    )]
    #[register(
        NativeObject,
        "$seen_mware",
        "Imitation",
        "/head/seen",
        queue_size = 1,
        should_wait = false
    )]
    fn orientations(
        &mut self,
        worn_mware: &str,
        seen_mware: &str,
    ) -> (Option<Orientation>, Option<Orientation>) {
        _ = (worn_mware, seen_mware); // for #[register]
        self.measured = self.measured.wrapping_add(1);
        let seen = match self.camera.as_mut().map(Camera::frame) {
            Some(Ok(Some(frame))) => head::seen_stand_in(self.measured, &frame),
            Some(Err(fault)) => {
                self.fault = Some(fault);
                None
            }
            _ => None,
        };
        (Some(head::worn_stand_in(self.measured)), seen)
    }
}

fn main() -> anyhow::Result<()> {
    log_to_stderr();
    let options = Options::parse();
    match options.role {
        Role::Sensors => measure(&options),
        Role::Robot => follow(&options),
    }
}

fn measure(options: &Options) -> anyhow::Result<()> {
    let camera = Camera::open(options.frames.as_deref(), true, 64, 48)?;
    let sensors = Imitation { camera: Some(camera), ..Imitation::default() };
    let mut sensors = sensors.communicator();
    sensors.activate(ImitationMethod::Orientations, Mode::Publish)?;
    loop {
        let (worn, seen) = sensors.orientations(&options.worn_mware, &options.seen_mware)?;
        if let Some(fault) = sensors.inner_mut().fault.take() {
            return Err(fault);
        }
        for orientation in [worn, seen].into_iter().flatten().flatten() {
            println!("{}", json!({ "event": "message", "orientation": orientation }));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn follow(options: &Options) -> anyhow::Result<()> {
    let selected = |source, mware| match options.source {
        Source::Both => mware,
        one if one == source => mware,
        _ => "none",
    };
    let worn_mware = selected(Source::Worn, options.worn_mware.as_str());
    let seen_mware = selected(Source::Seen, options.seen_mware.as_str());
    let mut imitation = Imitation::default().communicator();
    imitation.activate(ImitationMethod::Orientations, Mode::Listen)?;
    let (mut robot, mut choice) = (Head::default(), Choice::default());
    loop {
        let (worn, seen) = imitation.orientations(worn_mware, seen_mware)?;
        let chosen = choice.choose(Instant::now(), worn.flatten(), seen.flatten());
        if let Some(orientation) = chosen {
            robot.follow(&orientation);
            let told = json!({ "event": "message", "orientation": orientation, "head": robot });
            println!("{told}");
        }
        pause();
    }
}
