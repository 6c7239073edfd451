//! Shared harness of the end-to-end tests.
//!
//! A test asks for a [`TestEnv`] by [`run`]: a DDS domain, two ZeroMQ ports, topic names and a folder
//! that no other test has. In it, it starts the program under test and real peers as [`Process`]es,
//! which end with the test, and waits for what they print. Nothing sleeps for a fixed time, and no
//! verdict depends on how long something took: [`TIMEOUT`] only ends a test that would hang.
//!
//! | environment | meaning |
//! | --- | --- |
//! | `WRAPYFI_BIN` | the `wrapyfi` program; default: beside the test's own build folder |
//! | `WRAPYFI_POSE_MIRROR_BIN` | the example `pose_mirror`; default: beside `wrapyfi` |
//! | `WRAPYFI_<NAME>_BIN` | a program of `examples/communicator`, for instance `WRAPYFI_FORWARDING_BIN`; default: beside `wrapyfi` |
//! | `WRAPYFI_PYTHON` | interpreter with the Python peers; default: `.venv/bin/python` in the repository |
//! | `WRAPYFI_REQUIRE_PEERS=1` | a missing peer fails the test instead of skipping it; not Fast DDS, ROS 1, roscpp and the wheels of ROS 2 Kilted, which some systems lack, and no installation of ROS 2 or YARP |
//! | `WRAPYFI_REQUIRE_ROS2=1` | the same for ROS 2: sourced, else the newest in `/opt/ros` |
//! | `WRAPYFI_REQUIRE_YARP=1` | the same for YARP's tools |
//! | `WRAPYFI_YARP_PREFIX` | where YARP is installed; default: where the `PATH` has `yarp` |
//! | `CXX` | compiler of the peers on Fast DDS and roscpp; default: `c++` |

mod config;
mod cpp;
mod guide;
mod hosts;
mod installation;
mod master;
mod needs;
mod process;
mod programs;
mod real;
mod reserve;
mod ros_node;
mod ros_service;
mod route_state;
mod scenes;
mod test_env;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub use config::{Config, Route};
pub use guide::{Guide, Line, same_but_times};
pub use hosts::Host;
pub use master::{Books, Owners};
pub use needs::{Need, run};
pub use process::{Output, Process};
pub use real::RealRos2;
pub use ros_node::{AtWork, RosImage, RosNode};
pub use ros_service::Asker;
pub use ros2_client::ServiceMapping;
pub use route_state::{route_status, until_route};
pub use scenes::Scenes;
pub use test_env::{Args, TestEnv, rmw};

/// Time that anything may take before a test gives up: far beyond what a loaded machine needs.
pub const TIMEOUT: Duration = Duration::from_secs(120);

/// Asks again and again until there is an answer, or [`TIMEOUT`] is over: how often that is depends on the machine.
pub fn asked_until<T>(what: &str, mut ask: impl FnMut() -> Result<Option<T>>) -> Result<T> {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        match ask()? {
            Some(answer) => return Ok(answer),
            None if Instant::now() < deadline => {}
            None => anyhow::bail!("waiting for {what}: the time is over"),
        }
    }
}

/// Result of a test.
pub type Result<T = ()> = anyhow::Result<T>;

/// Root of the repository.
pub fn repository() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here).to_owned()
}

/// The endpoint of a topic or a node on ROS 2.
pub fn ros2(name: &str) -> String {
    format!("ros2:{name}")
}

/// The endpoint of a topic on ZeroMQ.
pub fn zeromq(topic: &str) -> String {
    format!("zeromq:{topic}")
}

/// The endpoint of a topic on ROS 1.
pub fn ros1(topic: &str) -> String {
    format!("ros:{topic}")
}

/// The endpoint of a port of YARP.
pub fn yarp(port: &str) -> String {
    format!("yarp:{port}")
}

/// Hex SHA-256.
pub fn sha256(bytes: &[u8]) -> String {
    use sha2::Digest as _;
    sha2::Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The text at `key` of each object.
pub fn texts(objects: &[serde_json::Value], key: &str) -> Vec<String> {
    objects
        .iter()
        .map(|object| object.get(key).and_then(|v| v.as_str()).unwrap_or("(absent)").to_owned())
        .collect()
}
