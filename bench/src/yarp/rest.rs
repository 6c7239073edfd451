//! Ports that are connected and silent: what they cost.
//!
//! ```text
//!   name server (the ordering process)      one process:  100 outputs ══ tcp ══▶ 100 inputs
//! ```

use std::io::Read as _;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use wrapyfi_yarp::port::{InputOptions, OutputOptions};

use super::{Server, network, runtime, task};
use crate::child::Child;
use crate::proc;
use crate::turn::Bench;
use crate::worker::say;

/// Pairs of ports.
const PAIRS: u32 = 100;
/// Pause between the last connection and the measurement.
const SETTLE: Duration = Duration::from_secs(2);

/// Figures of ports at rest.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Ports {
    /// Connected ports.
    pub(crate) ports: u32,
    /// Percent of one core that their process takes.
    #[serde(default)]
    pub(crate) share: f64,
    /// Duration of that measurement, in seconds.
    #[serde(default)]
    pub(crate) seconds: u32,
    /// Opening of all of them and connecting, in milliseconds.
    pub(crate) opening_ms: f64,
    /// Resident memory of their process, in MiB.
    #[serde(default)]
    pub(crate) rss_mib: f64,
}

impl Ports {
    /// Measures it for so many seconds.
    pub(crate) fn measure(bench: &Bench, seconds: u32) -> Result<Self> {
        let server = Server::start()?;
        let mut command = bench.command(&bench.own);
        command.args(["yarp-ports", "--names", &server.port.to_string()]);
        let mut child = Child::start("yarp-ports", command, &bench.folder)?;
        let opened: Self = child.answer()?;
        std::thread::sleep(SETTLE);
        let (before, start) = (proc::cpu_of(child.id()), Instant::now());
        std::thread::sleep(Duration::from_secs(u64::from(seconds)));
        let used = Duration::from_nanos(proc::cpu_of(child.id()).saturating_sub(before));
        let share = used.as_secs_f64() / start.elapsed().as_secs_f64() * 100.0;
        ensure!(child.runs(), "the process with the ports ended");
        Ok(Self { share, seconds, rss_mib: proc::rss_mib(child.id()), ..opened })
    }
}

/// Holds the ports until stdin ends.
pub(crate) fn ports(names: u16) -> Result<()> {
    let runtime = runtime(2)?;
    let start = Instant::now();
    let held = task(&runtime, async move {
        let network = network(names);
        let mut held = Vec::new();
        for pair in 0..PAIRS {
            let input =
                network.open_input(&format!("/in/{pair}"), &InputOptions::default()).await?;
            let out =
                network.open_output(&format!("/out/{pair}"), &OutputOptions::default()).await?;
            out.connect(&format!("tcp://in/{pair}")).await?;
            input.wait_for_inputs(1).await;
            out.wait_for_outputs(1).await;
            held.push((input, out));
        }
        Ok(held)
    })?;
    let opening_ms = start.elapsed().as_secs_f64() * 1e3;
    let ports = 2 * u32::try_from(held.len())?;
    say(&serde_json::to_value(Ports { ports, share: 0.0, seconds: 0, opening_ms, rss_mib: 0.0 })?)?;
    let _end = std::io::stdin().read(&mut [0; 1]);
    Ok(())
}
