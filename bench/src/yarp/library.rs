//! The ends of a ride over YARP's own library: a C++ program that is compiled for the installation that
//! is found.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use super::Place;

/// The program, and where it finds its name server.
pub(crate) struct Library {
    program: PathBuf,
    /// Folder of its `yarp.conf`.
    conf: PathBuf,
    /// Folder with the data of that installation.
    data: PathBuf,
}

impl Library {
    /// Compiles it.
    pub(crate) fn compile(repository: &Path, folder: &Path) -> Result<Self> {
        let prefix = prefix().context(
            "no YARP: no yarp on the PATH, and WRAPYFI_YARP_PREFIX says no folder of an installation",
        )?;
        let include = prefix.join("include");
        let header = include.join("yarp/os/all.h");
        ensure!(header.is_file(), "no YARP for C++: {} is not there", header.display());
        let (program, lib) = (folder.join("yarp_ports"), prefix.join("lib"));
        let mut command = Command::new(std::env::var_os("CXX").unwrap_or_else(|| "c++".into()));
        command.args(["-std=c++17", "-O2", "-pthread", "-o"]).arg(&program);
        command.arg(repository.join("bench/peers/yarp_ports.cpp"));
        command.arg("-isystem").arg(include).arg("-L").arg(&lib);
        command.arg(format!("-Wl,-rpath,{}", lib.display()));
        command.args(["-lYARP_sig", "-lYARP_init", "-lYARP_os"]);
        let ran = command.output().context("starting the C++ compiler")?;
        ensure!(ran.status.success(), "{command:?}: {}", String::from_utf8_lossy(&ran.stderr));
        let conf = folder.join("yarp");
        std::fs::create_dir_all(&conf)?;
        Ok(Self { program, conf, data: prefix.join("share/yarp") })
    }

    /// The command of one end, which asks the name server of its place.
    pub(super) fn command(&self, role: &str, place: Place) -> Result<Command> {
        let Place { ride, names, peer } = place;
        std::fs::write(self.conf.join("yarp.conf"), format!("127.0.0.1 {names} yarp\n"))?;
        let mut command = Command::new(&self.program);
        command.args([role, ride.load.name(), ride.way.carrier(), &peer.to_string()]);
        // The folder describes its plugins, its carriers among them.
        command.env("YARP_CONFIG_HOME", &self.conf).env("YARP_DATA_DIRS", &self.data);
        Ok(command)
    }
}

/// Folder in which YARP is installed.
fn prefix() -> Option<PathBuf> {
    if let Some(prefix) = std::env::var_os("WRAPYFI_YARP_PREFIX") {
        return Some(prefix.into());
    }
    let path = std::env::var_os("PATH")?;
    let tool = std::env::split_paths(&path).find(|folder| folder.join("yarp").is_file())?;
    tool.parent().map(Path::to_owned)
}
