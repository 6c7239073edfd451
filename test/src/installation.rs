//! Installations of ROS 2 and YARP that this machine has.
//!
//! ```text
//!   sourced: ros2 on the PATH ────────┐
//!   /opt/ros/*/setup.bash ─ bash, env ┼─▶ Installation
//!   .venv-kilted: wheels, no ros2 ────┘
//!   WRAPYFI_YARP_PREFIX, PATH ──────────▶ folder with yarp and yarpserver
//! ```

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context as _, bail};

use crate::programs::SYSTEM_PYTHON;
use crate::{Result, repository};

/// An installation of ROS 2.
#[derive(Debug, Clone)]
pub(crate) struct Installation {
    /// Variables that the setup file of the installation sets.
    pub(crate) environment: BTreeMap<OsString, OsString>,
    /// The script `ros2`, of which the wheels of Kilted have none.
    pub(crate) tool: PathBuf,
    /// The interpreter that its packages are for.
    pub(crate) python: PathBuf,
    /// Prefixes of packages, the first goes first.
    pub(crate) prefixes: Vec<PathBuf>,
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

    /// ROS 2 Kilted from the wheels that `make test` installs.
    pub(crate) fn kilted() -> Result<&'static Self> {
        static FOUND: OnceLock<std::result::Result<Installation, String>> = OnceLock::new();
        let found = FOUND.get_or_init(|| Self::wheels().map_err(|error| format!("{error:#}")));
        found.as_ref().map_err(|reason| anyhow::anyhow!("{reason}"))
    }

    /// True where there are such wheels: for one Python on one processor.
    pub(crate) fn has_wheels() -> bool {
        let version = Command::new(SYSTEM_PYTHON).arg("--version").output();
        cfg!(target_arch = "x86_64")
            && version.is_ok_and(|version| version.stdout.starts_with(b"Python 3.11."))
    }

    /// Nothing to source: the environment is the prefix, and each wheel has libraries in a folder of its own.
    fn wheels() -> Result<Self> {
        let prefix = repository().join(".venv-kilted");
        let packages = &prefix.join("lib/python3.11/site-packages");
        let none = "no ROS 2 Kilted in .venv-kilted: run `make test` on x86_64 with Python 3.11";
        let mut libraries = vec![prefix.join("lib")];
        for entry in std::fs::read_dir(packages).context(none)? {
            let path = entry?.path();
            if path.extension().is_some_and(|extension| extension == "libs") {
                libraries.push(path);
            }
        }
        let environment = BTreeMap::from([
            ("AMENT_PREFIX_PATH".into(), prefix.clone().into_os_string()),
            ("LD_LIBRARY_PATH".into(), std::env::join_paths(libraries)?),
            // Not those of another one, which may be sourced; for the interpreter that has Wrapyfi.
            ("PYTHONPATH".into(), packages.clone().into_os_string()),
            ("ROS_DISTRO".into(), "kilted".into()),
            ("ROS_PYTHON_VERSION".into(), "3".into()),
            ("ROS_VERSION".into(), "2".into()),
        ]);
        let (tool, python) = (prefix.join("bin/ros2"), prefix.join("bin/python"));
        Ok(Self { environment, tool, python, prefixes: vec![prefix] })
    }

    fn of(environment: BTreeMap<OsString, OsString>, tool: PathBuf) -> Result<Self> {
        let script = std::fs::read_to_string(&tool).with_context(|| tool.display().to_string())?;
        let shebang = script.lines().next().and_then(|line| line.strip_prefix("#!"));
        let python = match shebang.map(str::trim) {
            Some(path) if path.contains("python") && !path.contains(' ') => PathBuf::from(path),
            _ => PathBuf::from(SYSTEM_PYTHON),
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

    pub(crate) fn variable(&self, name: &str) -> OsString {
        let own = self.environment.get(OsStr::new(name)).cloned();
        own.or_else(|| std::env::var_os(name)).unwrap_or_default()
    }
}

/// File `name` on a `PATH`.
pub(crate) fn on_path(name: &str, path: Option<OsString>) -> Option<PathBuf> {
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

/// Folder of YARP's bindings for Python, beside its tools.
pub(crate) fn yarp_for_python() -> Result<PathBuf> {
    let libraries = yarp_tools()?.join("../lib");
    let folders = ["python3/dist-packages", "python3.11/site-packages"].into_iter();
    let mut folders = folders.map(|folder| libraries.join(folder));
    let found = folders.find(|folder| folder.join("yarp.py").is_file());
    found.with_context(|| format!("no bindings for Python below {}", libraries.display()))
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
