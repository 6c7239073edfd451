//! Calls of a registered method that returns an image: request and reply over ZeroMQ.
//!
//! ```text
//!   ours      our client ──▶ our broker ──▶ our server           pixels as they are
//!   python    Python's ────▶ Wrapyfi's ───▶ Python's             pixels as decimal text
//!   mixed     Python's ────▶ our broker ──▶ our server           pixels as decimal text
//! ```
//!
//! Client and server are processes of their own, and each server brings its broker, as it does by
//! itself. One call is under way at a time. A call is the whole of it, from arguments to an image that
//! can be used. What our server takes of a call is the CPU time of its process, broker included.

use std::io::{BufRead as _, Read as _};
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use wrapyfi_core::communicator::{MethodError, Mode, communicator};
use wrapyfi_core::types::{Image, Payload, Pixels};

use crate::child::Child;
use crate::clock;
use crate::payload::{Kind, Maker};
use crate::proc;
use crate::python;
use crate::trip::Leg;
use crate::turn::{Bench, Phase, ports};
use crate::worker::{Order, Report, micros, say};

/// Bytes of the image.
const PIXELS: usize = 640 * 480 * 3;
/// Calls that are made before anything is measured.
const WARM: u32 = 2;
/// Longest time to look for the server, in nanoseconds.
const OPENING: u64 = 20_000_000_000;

/// Pair of client and server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Asked {
    Ours,
    Python,
    Mixed,
}

/// Ports of a broker of requests.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(crate) struct Place {
    /// Port that clients connect to.
    #[arg(long)]
    rep_port: u16,
    /// Port that servers connect to.
    #[arg(long)]
    req_port: u16,
}

impl Asked {
    pub(crate) const ALL: [Self; 3] = [Self::Ours, Self::Python, Self::Mixed];

    /// Name in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Ours => "ask-ours/vga-rgb",
            Self::Python => "ask-python/vga-rgb",
            Self::Mixed => "ask-mixed/vga-rgb",
        }
    }

    /// Title of the pair, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Ours => "our client, our server",
            Self::Python => "Python Wrapyfi's client, its server",
            Self::Mixed => "Python Wrapyfi's client, our server",
        }
    }

    /// Calls of one turn: Python's take hundreds of milliseconds.
    fn count(self) -> u32 {
        if self == Self::Ours { 100 } else { 4 }
    }

    /// Measures it once.
    pub(crate) fn turn(self, bench: &Bench, repository: &Path) -> Result<Leg> {
        let (rep_port, req_port) = ports()?;
        let place = [("--rep-port", rep_port), ("--req-port", req_port)];
        let start = |name: &str, ours: bool, role: &str| {
            let mut command = if ours {
                bench.command(&bench.own)
            } else {
                let mut command = bench.command(&python::interpreter(repository)?);
                command.arg(repository.join("bench/peers/python_requests.py"));
                command
            };
            command.arg(role);
            for (key, port) in place {
                command.args([key, &port.to_string()]);
            }
            Child::start(name, command, &bench.folder)
        };
        let server = start("asked", self != Self::Python, "asked")?;
        let mut client = start("asker", self == Self::Ours, "asker")?;
        client.tell(&Order::Warm)?;
        let warm: Report = client.answer().context("warming up")?;
        ensure!(warm.received > 0, "no call was answered");
        let before = proc::cpu_ns(server.id());
        client.tell(&Order::Window { count: self.count(), inflight: 1 })?;
        let report: Report = client.answer()?;
        let used = proc::cpu_ns(server.id()).saturating_sub(before);
        let Report { sent, received, .. } = report;
        ensure!(sent == received, "{} of {sent} calls had no answer", sent - received);
        let middle_us = micros(used) / f64::from(sent.max(1));
        Ok(Leg { warm, calls: Phase { report, cpu_us: f64::NAN, middle_us } })
    }
}

struct Camera {
    frame: Image,
}

#[communicator]
impl Camera {
    /// A Python client names no ports.
    #[register(
        Image,
        "zeromq",
        "/asked/image",
        socket_rep_port = "$rep_port",
        socket_req_port = "$req_port",
        timeout_ms = 2000
    )]
    fn picture(&self, rep_port: Option<u16>, req_port: Option<u16>) -> Image {
        _ = (rep_port, req_port);
        self.frame.clone()
    }
}

fn camera(mode: Mode) -> Result<CameraCommunicator> {
    let Payload::Image(frame) = Maker::new(Kind::VgaRgb)?.payload(1) else {
        bail!("a frame is no image");
    };
    let mut camera = Camera { frame }.communicator();
    camera.activate(CameraMethod::Picture, mode)?;
    Ok(camera)
}

/// Runs the server until its stdin ends.
pub(crate) fn asked(place: Place) -> Result<()> {
    std::thread::spawn(|| {
        let _end = std::io::stdin().read(&mut [0; 1]);
        std::process::exit(0);
    });
    let camera = camera(Mode::Reply)?;
    loop {
        camera.picture(Some(place.rep_port), Some(place.req_port))?;
    }
}

/// Runs the client: obeys orders as a source does.
pub(crate) fn asker(place: Place) -> Result<()> {
    let camera = camera(Mode::Request)?;
    let start = clock::now();
    for line in std::io::stdin().lock().lines() {
        let report = match serde_json::from_str(&line?)? {
            Order::Warm => {
                // The server may not be there yet.
                while let Err(error) = call(&camera, place) {
                    ensure!(clock::now() < start + OPENING, "no answer within 20 s: {error:#}");
                }
                let opening_ns = clock::now() - start;
                Report { opening_ns, ..calls(&camera, place, WARM)? }
            }
            Order::Window { count, .. } | Order::Paced { count, .. } => {
                calls(&camera, place, count)?
            }
        };
        say(&serde_json::to_value(report)?)?;
    }
    Ok(())
}

fn calls(camera: &CameraCommunicator, place: Place, count: u32) -> Result<Report> {
    let mut report = Report::default();
    let begin = clock::now();
    for _ in 0..count {
        let start = clock::now();
        call(camera, place)?;
        report.latency_us.push(micros(clock::now() - start));
        report.sent += 1;
        report.received += 1;
    }
    report.span_ns = clock::now() - begin;
    Ok(report)
}

fn call(camera: &CameraCommunicator, place: Place) -> Result<()> {
    let answer: Result<Option<Image>, MethodError> =
        camera.picture(Some(place.rep_port), Some(place.req_port));
    match answer?.map(|image| image.pixels) {
        Some(Pixels::Raw(raw)) if raw.data.len() == PIXELS => Ok(()),
        other => {
            bail!("{} is no frame of 640x480", if other.is_some() { "this" } else { "nothing" })
        }
    }
}
