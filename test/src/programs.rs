//! Programs that the tests start: ours, the examples, and interpreters that have the peers.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context as _, bail};

use crate::installation::on_path;
use crate::{Result, repository};

/// The interpreter that the distribution's packages are for.
pub(crate) const SYSTEM_PYTHON: &str = "/usr/bin/python3";

/// The `wrapyfi` program.
pub(crate) fn program() -> Result<PathBuf> {
    built("wrapyfi", "WRAPYFI_BIN")
}

/// Node executables.
pub(crate) const NODES: [&str; 4] = ["bridge", "ros1_bridge", "yarp_bridge", "zeromq_bridge"];

/// A node executable in this folder, a link to the program as it is installed.
pub(crate) fn node_in(folder: &Path, name: &str) -> Result<PathBuf> {
    let link = folder.join(name);
    match std::os::unix::fs::symlink(program()?, &link) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => {
            Err(error).with_context(|| format!("making {}", link.display()))
        }
        _ => Ok(link),
    }
}

/// A program of the examples.
pub(crate) fn executable(name: &str) -> Result<PathBuf> {
    built(name, &format!("WRAPYFI_{}_BIN", name.to_uppercase()))
}

/// Chromium by one of its names.
pub(crate) fn chromium() -> Result<PathBuf> {
    let mut names = ["chromium", "chromium-browser", "google-chrome"].into_iter();
    let found = names.find_map(|name| on_path(name, std::env::var_os("PATH")));
    found.context("there is no Chromium on the PATH: apt-get install chromium")
}

/// A folder below this one where Python finds the package `wrapyfi_rs`, as a wheel has it, and begins with what its
/// `.pth` file says.
pub(crate) fn python_package(folder: &Path) -> Result<PathBuf> {
    let (all, sources) = (folder.join("python"), repository().join("wrapyfi_rs/python/wrapyfi_rs"));
    let package = all.join("wrapyfi_rs");
    if package.exists() {
        return Ok(all);
    }
    std::fs::create_dir_all(&package)?;
    let beside = repository().join("wrapyfi_rs/wrapyfi_rs.data/purelib");
    let site = format!("import site; site.addsitedir({:?})\n", beside.display().to_string());
    std::fs::write(all.join("sitecustomize.py"), site)?;
    let library = built("libwrapyfi_python.so", "WRAPYFI_PYTHON_LIBRARY")?;
    std::os::unix::fs::symlink(library, package.join("_native.abi3.so"))?;
    for entry in std::fs::read_dir(&sources)? {
        let entry = entry?;
        std::os::unix::fs::symlink(entry.path(), package.join(entry.file_name()))?;
    }
    Ok(all)
}

fn built(name: &str, variable: &str) -> Result<PathBuf> {
    let path = match std::env::var_os(variable) {
        Some(path) => PathBuf::from(path),
        // target/<profile>/deps/<test>: the programs lie one folder up.
        None => std::env::current_exe()?
            .ancestors()
            .nth(2)
            .context("the test runs outside a Cargo build folder")?
            .join(name),
    };
    if !path.is_file() {
        bail!(
            "no program at {}: build it with `cargo build --workspace`, or set {variable}",
            path.display()
        );
    }
    Ok(path)
}

/// An interpreter that has every Python peer.
pub(crate) fn python() -> Result<PathBuf> {
    static FOUND: OnceLock<std::result::Result<PathBuf, String>> = OnceLock::new();
    FOUND.get_or_init(find_python).clone().map_err(anyhow::Error::msg)
}

fn find_python() -> std::result::Result<PathBuf, String> {
    let path = std::env::var_os("WRAPYFI_PYTHON")
        .map_or_else(|| repository().join(".venv/bin/python"), PathBuf::from);
    let probe = "import importlib.util as u, sys\n\
                 sys.exit(' '.join(m for m in ('wrapyfi', 'zmq', 'cv2', 'cyclonedds', 'rosbags') if not u.find_spec(m)) or 0)";
    let ran = Command::new(&path).args(["-c", probe]).output().map_err(|e| {
        format!("no Python peers: {}: {e}; run `make test`, or set WRAPYFI_PYTHON", path.display())
    })?;
    if ran.status.success() {
        Ok(path)
    } else {
        let missing = String::from_utf8_lossy(&ran.stderr);
        Err(format!("{} lacks the Python packages: {}", path.display(), missing.trim()))
    }
}
