//! Real installations of ROS 2 and YARP, where this machine has them.
//!
//! ```text
//!   sourced: ros2 on the PATH ────────┐
//!   /opt/ros/*/setup.bash ─ bash, env ┴─▶ environment ─▶ RealRos2: ros2 …, rclpy, our programs in it
//!   WRAPYFI_YARP_PREFIX, PATH ──────────▶ folder with yarp and yarpserver ─▶ TestEnv::yarp
//! ```

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context as _, bail};

use crate::{Process, Result, TestEnv, needs, repository};

/// An installation of ROS 2.
#[derive(Debug, Clone)]
pub(crate) struct Installation {
    /// Variables that the setup file of the installation sets.
    environment: BTreeMap<OsString, OsString>,
    /// The script `ros2`.
    tool: PathBuf,
    /// The interpreter that its packages are for.
    python: PathBuf,
    /// Prefixes of packages, the first goes first.
    prefixes: Vec<PathBuf>,
}

impl Installation {
    /// The installation that is sourced, else the newest in `/opt/ros`.
    pub(crate) fn find() -> Result<&'static Self> {
        static FOUND: OnceLock<std::result::Result<Installation, String>> = OnceLock::new();
        let found = FOUND.get_or_init(|| Self::look().map_err(|error| format!("{error:#}")));
        found.as_ref().map_err(|reason| anyhow::anyhow!("{reason}"))
    }

    fn look() -> Result<Self> {
        if std::env::var_os("AMENT_PREFIX_PATH").is_some()
            && let Some(tool) = on_path("ros2", std::env::var_os("PATH"))
        {
            return Self::of(BTreeMap::new(), tool);
        }
        let mut setups: Vec<_> = std::fs::read_dir("/opt/ros")
            .into_iter()
            .flatten()
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|prefix| prefix.join("bin/ros2").is_file())
            .flat_map(|prefix| ["setup.bash", "setup.sh"].map(|name| prefix.join(name)))
            .filter(|file| file.is_file())
            .collect();
        // Distributions are named in alphabetical order; of one, setup.sh is there in any case.
        setups.sort();
        let setup =
            setups.last().context("no ROS 2: none is sourced, and none is in /opt/ros")?.clone();
        let prefix = setup.parent().unwrap_or(&setup).to_owned();
        let ran = Command::new("bash")
            .args(["-c", ". \"$0\" && env -0"])
            .arg(&setup)
            // A workspace of something else must not come along.
            .env_remove("AMENT_PREFIX_PATH")
            .output()?;
        if !ran.status.success() {
            bail!("{}: {}", setup.display(), String::from_utf8_lossy(&ran.stderr));
        }
        let pairs = ran.stdout.split(|byte| *byte == 0).filter_map(|pair| {
            let at = pair.iter().position(|byte| *byte == b'=')?;
            let (name, value) = pair.split_at_checked(at)?;
            Some((OsStr::from_bytes(name).to_owned(), OsString::from_vec(value.get(1..)?.into())))
        });
        let changed = pairs.filter(|(name, value)| std::env::var_os(name).as_ref() != Some(value));
        Self::of(changed.collect(), prefix.join("bin/ros2"))
    }

    fn of(environment: BTreeMap<OsString, OsString>, tool: PathBuf) -> Result<Self> {
        let script = std::fs::read_to_string(&tool).with_context(|| tool.display().to_string())?;
        let shebang = script.lines().next().and_then(|line| line.strip_prefix("#!"));
        let python = match shebang.map(str::trim) {
            Some(path) if path.contains("python") && !path.contains(' ') => PathBuf::from(path),
            _ => PathBuf::from(needs::SYSTEM_PYTHON),
        };
        let path = environment.get(OsStr::new("AMENT_PREFIX_PATH")).cloned();
        let path = path.or_else(|| std::env::var_os("AMENT_PREFIX_PATH")).unwrap_or_default();
        let prefixes = std::env::split_paths(&path).collect();
        Ok(Self { environment, tool, python, prefixes })
    }

    /// True when a package is installed, by the ament index.
    pub(crate) fn has(&self, package: &str) -> bool {
        let entry = Path::new("share/ament_index/resource_index/packages").join(package);
        self.prefixes.iter().any(|prefix| prefix.join(&entry).exists())
    }

    /// Checks that rclpy works in another interpreter than its own, which has Wrapyfi.
    pub(crate) fn imports(&self, python: &Path) -> Result {
        let ran = Command::new(python)
            .args(["-c", "import wrapyfi, rclpy.node, std_msgs.msg, sensor_msgs.msg"])
            .envs(&self.environment)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .output()?;
        if !ran.status.success() {
            let said = String::from_utf8_lossy(&ran.stderr);
            bail!("{} has no rclpy: {}", python.display(), said.lines().last().unwrap_or_default());
        }
        Ok(())
    }

    fn variable(&self, name: &str) -> OsString {
        let own = self.environment.get(OsStr::new(name)).cloned();
        own.or_else(|| std::env::var_os(name)).unwrap_or_default()
    }
}

/// File `name` on a `PATH`.
fn on_path(name: &str, path: Option<OsString>) -> Option<PathBuf> {
    std::env::split_paths(&path?).map(|folder| folder.join(name)).find(|file| file.is_file())
}

/// The folder of YARP's tools: below `WRAPYFI_YARP_PREFIX`, else on the `PATH`.
pub(crate) fn yarp_tools() -> Result<PathBuf> {
    let place = match std::env::var_os("WRAPYFI_YARP_PREFIX") {
        Some(prefix) => PathBuf::from(prefix).join("bin"),
        None => on_path("yarp", std::env::var_os("PATH"))
            .and_then(|tool| tool.parent().map(Path::to_owned))
            .context("no YARP: no yarp on the PATH, and WRAPYFI_YARP_PREFIX is not set")?,
    };
    for tool in ["yarp", "yarpserver"] {
        if !place.join(tool).is_file() {
            bail!("no YARP: {} has no {tool}", place.display());
        }
    }
    Ok(place)
}

/// Folder in which YARP's programs find their data: as set, else beside the tools.
pub(crate) fn yarp_data() -> Result<PathBuf> {
    match std::env::var_os("YARP_DATA_DIRS") {
        Some(folders) if !folders.is_empty() => Ok(folders.into()),
        _ => Ok(yarp_tools()?.join("../share/yarp")),
    }
}

/// Checks that `yarpdev` has this device.
pub(crate) fn yarp_device(name: &str) -> Result {
    let plugin = yarp_data()?.join(format!("plugins/{name}.ini"));
    if yarp_tools()?.join("yarpdev").is_file() && plugin.is_file() {
        return Ok(());
    }
    bail!("this YARP has no device {name}")
}

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
        let mut said = String::new();
        for _ in 0..20 {
            let mut process = self.ros2(args)?;
            process.exit_code()?;
            said = process.stdout();
            if wanted(&said) {
                return Ok(said);
            }
            said.push_str(&process.stderr());
        }
        bail!("ros2 {} never said what it should, last:\n{said}", args.join(" "))
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
        let file = repository().join("test/peers/rclpy_peer.py").into_os_string();
        let split = args.split_whitespace().map(OsString::from);
        let value = value.into_iter().flat_map(|value| ["--value".into(), value.into()]);
        let all = std::iter::once(file).chain(split).chain(value);
        let command = self.command(&self.installation.python, all)?;
        self.env.start("rclpy_peer.py", command)
    }

    /// Starts `wrapyfi` where this ROS 2 is sourced.
    pub fn wrapyfi<A: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = A>) -> Result<Process> {
        self.env.start("wrapyfi", self.command(&needs::program()?, args)?)
    }

    /// Starts a node executable of ours where this ROS 2 is sourced, by its name. Not by `ros2 run`, whose
    /// end leaves the node alone.
    pub fn node(&self, name: &str, ros_args: &[&str]) -> Result<Process> {
        let program = self.env.path("overlay/lib/wrapyfi_bridge").join(name);
        let args = ["--ros-args"].iter().chain(ros_args);
        Ok(self.env.start(name, self.command(&program, args)?)?.pillar())
    }

    /// Starts a line of the shell, as somebody types it who has sourced this ROS 2 with our packages.
    pub fn shell(&self, line: &str) -> Result<Process> {
        let command = self.command(Path::new("bash"), ["-c", line])?;
        Ok(self.env.start(line, command)?.ends_at_interrupt())
    }

    /// Starts a script with the interpreter that has Wrapyfi, where this ROS 2 is sourced.
    pub fn python(&self, args: &[&str]) -> Result<Process> {
        self.env.start("python", self.command(&needs::python()?, args)?)
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

    fn command<A: AsRef<OsStr>>(
        &self,
        program: &Path,
        args: impl IntoIterator<Item = A>,
    ) -> Result<Command> {
        let mut command = self.env.command(program, args);
        command.envs(&self.installation.environment);
        for (name, value) in [
            ("RMW_IMPLEMENTATION", self.rmw),
            // Setup files set the subnet: Fast DDS would look for nobody by unicast.
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
    std::os::unix::fs::symlink(needs::program()?, programs.join("wrapyfi"))?;
    std::os::unix::fs::symlink(needs::node()?, programs.join("bridge"))?;
    for name in ["ros1_bridge", "yarp_bridge", "zeromq_bridge"] {
        std::os::unix::fs::symlink(needs::executable(name)?, programs.join(name))?;
    }
    Ok(())
}
