//! A real installation of ROS 2 in one test: `ros2 …`, rclpy, and our programs in it.

use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::Command;

use anyhow::Context as _;

use crate::installation::Installation;
use crate::{Args, Process, Result, TestEnv, asked_until, programs, repository};

/// ROS 2 as it is installed, in one test and under one middleware. Our packages are found in it as if
/// they were installed, too.
#[derive(Debug)]
pub struct RealRos2<'w> {
    env: &'w TestEnv,
    rmw: &'static str,
    installation: &'static Installation,
}

impl<'w> RealRos2<'w> {
    /// The installation, for nodes on the middleware `rmw`.
    pub fn new(env: &'w TestEnv, rmw: &'static str) -> Result<Self> {
        let installation = Installation::find()?;
        overlay(env)?;
        Ok(Self { env, rmw, installation })
    }

    /// ROS 2 Kilted from its wheels, on Fast DDS 3.
    pub fn kilted(env: &'w TestEnv) -> Result<Self> {
        let installation = Installation::kilted()?;
        overlay(env)?;
        Ok(Self { env, rmw: "rmw_fastrtps_cpp", installation })
    }

    /// True where `ros2 topic info -v` names the node of our endpoints: Fast DDS 3, from Kilted on, names none on the CycloneDDS
    /// inside.
    pub fn names_our_endpoints(&self) -> bool {
        // Distributions are named in alphabetical order.
        let is_fast_dds_3 = self.rmw == "rmw_fastrtps_cpp"
            && self.installation.variable("ROS_DISTRO").as_os_str() > OsStr::new("jazzy");
        let is_inside = std::env::var_os("WRAPYFI_ROS2_GRAPH").is_none_or(|graph| graph != "rmw");
        !(is_fast_dds_3 && is_inside)
    }

    /// Starts `ros2` with these arguments.
    pub fn ros2(&self, args: &[&str]) -> Result<Process> {
        let tool = self.installation.tool.as_os_str();
        let mut command = self.command(&self.installation.python, std::iter::once(tool))?;
        command.args(args);
        Ok(self.env.start("ros2", command)?.ends_at_interrupt())
    }

    /// Output of `ros2`, once it is as wanted. Commands that look at the graph look for two
    /// seconds, without a daemon that would outlive the test.
    pub fn told(&self, args: &[&str], wanted: impl Fn(&str) -> bool) -> Result<String> {
        let mut last = String::new();
        let said = asked_until(&format!("ros2 {} to say it", args.join(" ")), || {
            let mut process = self.ros2(args)?;
            process.exit_code()?;
            let said = process.stdout();
            last = said.clone() + &process.stderr();
            Ok(wanted(&said).then_some(said))
        });
        said.map_err(|error| error.context(last))
    }

    /// As [`RealRos2::told`], for a command that looks at the graph.
    ///
    /// # Errors
    /// As [`RealRos2::told`].
    pub fn seen(&self, args: &[&str], wanted: impl Fn(&str) -> bool) -> Result<String> {
        self.told(&[args, &["--no-daemon", "--spin-time", "2"]].concat(), wanted)
    }

    /// Starts a node of rclpy from `test/peers/rclpy_peer.py`; `args` are split at blanks, `value` is its
    /// `--value` as it is.
    pub fn rclpy(&self, args: &str, value: Option<&str>) -> Result<Process> {
        self.peer("rclpy_peer.py", args, value)
    }

    /// Starts a server or a client of actions on rclpy: `test/peers/rclpy_actions.py`.
    pub fn rclpy_actions(&self, args: &str) -> Result<Process> {
        self.peer("rclpy_actions.py", args, None)
    }

    /// Starts a client of the parameters of a node on rclpy: `test/peers/rclpy_parameters.py`.
    pub fn rclpy_parameters(&self, args: &str, value: Option<&str>) -> Result<Process> {
        self.peer("rclpy_parameters.py", args, value)
    }

    fn peer(&self, script: &str, args: &str, value: Option<&str>) -> Result<Process> {
        let file = repository().join("test/peers").join(script).into_os_string();
        let split = args.split_whitespace().map(OsString::from);
        let value = value.into_iter().flat_map(|value| ["--value".into(), value.into()]);
        let all = std::iter::once(file).chain(split).chain(value);
        let command = self.command(&self.installation.python, all)?;
        self.env.start(script, command)
    }

    /// Starts `wrapyfi` where this ROS 2 is sourced.
    pub fn wrapyfi(&self, args: impl Args) -> Result<Process> {
        self.env.start("wrapyfi", self.command(&programs::program()?, args)?)
    }

    /// Starts a node executable of ours where this ROS 2 is sourced, by its name. Not by `ros2 run`, whose
    /// end leaves the node alone.
    pub fn node(&self, name: &str, ros_args: &[&str]) -> Result<Process> {
        let program = self.env.path("overlay/lib/wrapyfi_bridge").join(name);
        let args = ["--ros-args"].iter().chain(ros_args);
        Ok(self.env.start(name, self.command(&program, args)?)?.pillar())
    }

    /// Starts a line of the shell, as a user types it who has sourced this ROS 2 with our packages.
    pub fn shell(&self, line: &str) -> Result<Process> {
        let command = self.command(Path::new("bash"), ["-c", line])?;
        Ok(self.env.start(line, command)?.ends_at_interrupt())
    }

    /// Starts a script with the interpreter that has Wrapyfi, where this ROS 2 is sourced.
    pub fn python(&self, args: &[&str]) -> Result<Process> {
        self.env.start("python", self.command(&programs::python()?, args)?)
    }

    /// Starts Wrapyfi's peer on the rclpy of this ROS 2; `args` are split at blanks.
    pub fn wrapyfi_peer(&self, args: &str) -> Result<Process> {
        let file = repository().join("test/peers/wrapyfi_peer.py").display().to_string();
        let args: Vec<&str> =
            std::iter::once(file.as_str()).chain(args.split_whitespace()).collect();
        self.python(&args)
    }

    /// Copies a library of the installation under another name, which programs find from now on.
    pub fn copy(&self, library: &str, name: &str) -> Result {
        let prefixes = self.installation.prefixes.iter();
        let mut found = prefixes.map(|prefix| prefix.join("lib").join(library));
        let found = found.find(|at| at.is_file());
        let folder = self.env.path("libraries");
        std::fs::create_dir_all(&folder)?;
        std::fs::copy(found.with_context(|| format!("no {library}"))?, folder.join(name))?;
        let others = self.installation.variable("LD_LIBRARY_PATH");
        let all = std::iter::once(folder).chain(std::env::split_paths(&others));
        self.env.set_variable("LD_LIBRARY_PATH", std::env::join_paths(all)?);
        Ok(())
    }

    fn command(&self, program: &Path, args: impl Args) -> Result<Command> {
        let mut command = self.env.command(program, args);
        command.envs(&self.installation.environment);
        for (name, value) in [
            ("RMW_IMPLEMENTATION", self.rmw),
            // Setup files set the subnet: Fast DDS would look for no peer by unicast.
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            ("PYTHONUNBUFFERED", "1"),
            ("PYTHONUTF8", "1"),
            ("PYTHONDONTWRITEBYTECODE", "1"),
            ("RCUTILS_COLORIZED_OUTPUT", "0"),
        ] {
            command.env(name, value);
        }
        let found = self.installation.variable("AMENT_PREFIX_PATH");
        let prefixes =
            std::iter::once(self.env.path("overlay")).chain(std::env::split_paths(&found));
        command.env("AMENT_PREFIX_PATH", std::env::join_paths(prefixes)?);
        command.env("PYTHONPATH", self.installation.variable("PYTHONPATH"));
        command.envs(&*self.env.variables());
        Ok(command)
    }
}

/// Lays our programs, launch files and configurations where `ros2 run` and `ros2 launch` find them.
fn overlay(env: &TestEnv) -> Result {
    let prefix = env.path("overlay");
    if prefix.exists() {
        return Ok(());
    }
    let index = prefix.join("share/ament_index/resource_index/packages");
    std::fs::create_dir_all(&index)?;
    for package in ["wrapyfi", "wrapyfi_bridge"] {
        std::fs::write(index.join(package), "")?;
        let share = prefix.join("share").join(package);
        std::fs::create_dir_all(&share)?;
        let description = repository().join(package).join("package.xml");
        std::fs::copy(description, share.join("package.xml"))?;
    }
    // Files, not folders: launch does not look through links to those.
    for folder in ["launch", "config"] {
        let place = prefix.join("share/wrapyfi").join(folder);
        std::fs::create_dir_all(&place)?;
        for entry in std::fs::read_dir(repository().join(folder))? {
            let entry = entry?;
            std::os::unix::fs::symlink(entry.path(), place.join(entry.file_name()))?;
        }
    }
    let programs = prefix.join("lib/wrapyfi_bridge");
    std::fs::create_dir_all(&programs)?;
    std::os::unix::fs::symlink(programs::program()?, programs.join("wrapyfi"))?;
    for name in programs::NODES {
        programs::node_in(&programs, name)?;
    }
    Ok(())
}
