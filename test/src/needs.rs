//! Needs of a test, and the consequence where one is missing.

use std::io::Write as _;
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context as _, bail};

use crate::installation::{self, Installation};
use crate::programs::{SYSTEM_PYTHON, chromium, executable, program, python};
use crate::{Result, TestEnv, cpp, hosts};

/// Something a test cannot do without.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// The `wrapyfi` program.
    Program,
    /// The example program `pose_mirror`.
    PoseMirror,
    /// This program of `examples/communicator`.
    Example(&'static str),
    /// Python with Wrapyfi, pyzmq, cyclonedds and rosbags.
    Python,
    /// A package that the interpreter must have besides, by the name it is imported under.
    Package(&'static str),
    /// Fast DDS 2 for C++. Some systems have none: tests that need it are skipped there, whatever
    /// `WRAPYFI_REQUIRE_PEERS` says.
    FastDds,
    /// ROS 1 as Debian has it: rosmaster, rospy and the tools. Some systems have none: tests that need
    /// it are skipped there, whatever `WRAPYFI_REQUIRE_PEERS` says.
    Ros1,
    /// actionlib in Python beside that. Some systems have none: tests that need it are skipped there, whatever
    /// `WRAPYFI_REQUIRE_PEERS` says.
    Actionlib,
    /// dynamic_reconfigure in Python beside that. Some systems have none: tests that need it are skipped there, whatever
    /// `WRAPYFI_REQUIRE_PEERS` says.
    Reconfigure,
    /// A compiler and actionlib in C++. Some systems have none: tests that need it are skipped there, whatever
    /// `WRAPYFI_REQUIRE_PEERS` says.
    ActionlibCpp,
    /// Network namespaces that can be joined, as root may make them. The test is skipped if they cannot
    /// be made, whatever `WRAPYFI_REQUIRE_PEERS` says.
    Hosts,
    /// A compiler and roscpp. Some systems have none: tests that need it are skipped there, whatever
    /// `WRAPYFI_REQUIRE_PEERS` says.
    Roscpp,
    /// ROS 2 as it is installed: its tools and rclpy.
    Ros2,
    /// ROS 2 Kilted with rclpy on Fast DDS 3, from wheels. Where there are none for the machine the test is
    /// skipped, whatever `WRAPYFI_REQUIRE_PEERS` says.
    Kilted,
    /// Programs of ours that speak through the rmw of that ROS 2: `scripts/test-rmw.sh` has them.
    Rmw,
    /// This package of that installation, for instance a middleware. Those that are not installed are
    /// skipped, whatever is required.
    Ros2Package(&'static str),
    /// Python Wrapyfi that runs on its rclpy: the interpreter that has it is the one of that ROS 2.
    WrapyfiOnRos2,
    /// Chromium, whose pictures need no screen. The test is skipped if there is none, whatever
    /// `WRAPYFI_REQUIRE_PEERS` says.
    Chromium,
    /// YARP's tools.
    Yarp,
    /// A compiler and YARP for C++. The test is skipped without, whatever is required.
    YarpCpp,
    /// Its bindings for Python. The test is skipped without, whatever is required.
    YarpPython,
    /// This device of that YARP. Those that are not built are skipped, whatever is required.
    YarpDevice(&'static str),
}

/// Runs a test in an environment of its own, or skips it with the reason where something it needs is missing.
///
/// # Errors
/// The test's own; and a missing need where `WRAPYFI_REQUIRE_PEERS` is `1`.
pub fn run(test: &str, needs: &[Need], body: impl FnOnce(&TestEnv) -> Result) -> Result {
    for need in needs {
        if let Err(reason) = check(*need) {
            let is_required = match need {
                Need::FastDds => !cpp::FAST_DDS.lacks_library(),
                Need::Ros1 => has_package("python3-rospy"),
                Need::Actionlib => has_package("python3-actionlib"),
                Need::Reconfigure => has_package("python3-dynamic-reconfigure"),
                Need::ActionlibCpp => {
                    !cpp::ACTIONLIB.lacks_library() || has_package("libactionlib-dev")
                }
                Need::Roscpp => !cpp::ROSCPP.lacks_library() || has_package("libroscpp-dev"),
                Need::Kilted => Installation::has_wheels(),
                Need::Hosts | Need::Chromium | Need::Rmw => false,
                Need::Ros2Package(_) | Need::WrapyfiOnRos2 => false,
                Need::YarpCpp | Need::YarpPython | Need::YarpDevice(_) => false,
                _ => true,
            };
            let variable = match need {
                Need::Ros2 => "WRAPYFI_REQUIRE_ROS2",
                Need::Yarp => "WRAPYFI_REQUIRE_YARP",
                _ => "WRAPYFI_REQUIRE_PEERS",
            };
            if is_required && std::env::var(variable).is_ok_and(|value| value == "1") {
                return Err(reason).with_context(|| format!("{test} needs a peer that is missing"));
            }
            // Written directly: the test runner hides what `println!` says when a test passes.
            writeln!(std::io::stderr(), "SKIPPED {test}: {reason:#}")?;
            return Ok(());
        }
    }
    body(&TestEnv::new(test)?)
}

fn check(need: Need) -> Result {
    match need {
        Need::Program => program().map(drop),
        Need::PoseMirror => executable("pose_mirror").map(drop),
        Need::Example(name) => executable(name).map(drop),
        Need::Python => python().map(drop),
        Need::Package(name) => package(name),
        Need::Ros1 => ros1(),
        Need::Actionlib => imports("actionlib.msg", "python3-actionlib"),
        Need::Reconfigure => imports("dynamic_reconfigure.cfg", "python3-dynamic-reconfigure"),
        Need::ActionlibCpp => cpp::ACTIONLIB.or_why_not().map(drop),
        Need::Hosts => hosts::or_why_not(),
        Need::Chromium => chromium().map(drop),
        Need::FastDds => cpp::FAST_DDS.or_why_not().map(drop),
        Need::Roscpp => cpp::ROSCPP.or_why_not().map(drop),
        Need::Ros2 => Installation::find().map(drop),
        Need::Kilted => Installation::kilted().map(drop),
        Need::Rmw if std::env::var_os("WRAPYFI_TEST_RMW").is_some() => Ok(()),
        Need::Rmw => bail!("our programs have no rmw: scripts/test-rmw.sh runs them with one"),
        Need::Ros2Package(name) if Installation::find()?.has(name) => Ok(()),
        Need::Ros2Package(name) => bail!("this ROS 2 has no package {name}"),
        Need::WrapyfiOnRos2 => Installation::find()?.imports(&python()?),
        Need::Yarp => installation::yarp_tools().map(drop),
        Need::YarpCpp => cpp::YARP.or_why_not().map(drop),
        Need::YarpPython => installation::yarp_for_python().map(drop),
        Need::YarpDevice(name) => installation::yarp_device(name),
    }
}

fn package(name: &str) -> Result {
    let python = python()?;
    let probe = format!("import importlib.util as u, sys; sys.exit(not u.find_spec({name:?}))");
    let ran = Command::new(&python).args(["-c", &probe]).output()?;
    if !ran.status.success() {
        bail!("{} lacks the Python package {name}; run `make test`", python.display());
    }
    Ok(())
}

/// True when the distribution has such a package, installed or not.
fn has_package(name: &str) -> bool {
    let shown = Command::new("apt-cache").args(["show", name]).output();
    shown.is_ok_and(|shown| shown.status.success() && !shown.stdout.is_empty())
}

fn ros1() -> Result {
    static FOUND: OnceLock<std::result::Result<(), String>> = OnceLock::new();
    FOUND.get_or_init(find_ros1).clone().map_err(anyhow::Error::msg)
}

/// Fails where the system's Python lacks a module, which a package has.
fn imports(module: &str, package: &str) -> Result {
    let import = format!("import {module}");
    let ran = Command::new(SYSTEM_PYTHON).args(["-c", &import]).output()?;
    if !ran.status.success() {
        bail!("no {module} (Debian 12: {package}); run `make test` where the system has it");
    }
    Ok(())
}

fn find_ros1() -> std::result::Result<(), String> {
    let probe = "import importlib.util as u, sys\n\
                 sys.exit(' '.join(m for m in ('rosbag', 'rosmaster', 'rospy', 'rostopic', 'rosnode', 'std_srvs', 'sensor_msgs') if not u.find_spec(m)) or 0)";
    let ran = Command::new(SYSTEM_PYTHON)
        .args(["-c", probe])
        .output()
        .map_err(|error| format!("no ROS 1 peers: {SYSTEM_PYTHON}: {error}"))?;
    if ran.status.success() {
        return Ok(());
    }
    let missing = String::from_utf8_lossy(&ran.stderr);
    Err(format!("{SYSTEM_PYTHON} lacks the packages of ROS 1: {}; run `make test`", missing.trim()))
}
