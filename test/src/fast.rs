//! The peer on Fast DDS: compiled once from `test/peers/fast_peer`, then started like the others.
//!
//! ```text
//!   main.cpp, *.hpp ─ c++ ─▶ target/<profile>/fast_peer/<hash of them>   under a lock, once
//! ```

use std::fs::File;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context as _, bail};

use crate::{Result, repository, sha256};

/// A header that Fast DDS 2 has, and neither 1 nor 3.
const PROBE: &str = "#include <fastdds/dds/domain/DomainParticipant.hpp>\n\
                     #include <fastrtps/utils/IPLocator.h>\n";

/// Why there is no such program.
#[derive(Debug, Clone)]
pub(crate) enum Absent {
    /// This system has no Fast DDS 2 to compile it with.
    Library(String),
    /// It should be there and is not.
    Program(String),
}

/// The program.
pub(crate) fn program() -> std::result::Result<PathBuf, Absent> {
    static FOUND: OnceLock<std::result::Result<PathBuf, Absent>> = OnceLock::new();
    FOUND.get_or_init(find).clone()
}

fn compiler() -> Command {
    Command::new(std::env::var_os("CXX").unwrap_or_else(|| "c++".into()))
}

fn find() -> std::result::Result<PathBuf, Absent> {
    let wrong = |error: anyhow::Error| Absent::Program(format!("the Fast DDS peer: {error:#}"));
    let (source, program) = places().map_err(wrong)?;
    if program.is_file() {
        return Ok(program);
    }
    if !has_library(&program).map_err(wrong)? {
        let text = "no Fast DDS 2 for C++ (Debian 12: libfastrtps-dev, libfastcdr-dev); run \
                    `make test` where the system has it";
        return Err(Absent::Library(text.to_owned()));
    }
    compile(&source, &program).map_err(wrong)?;
    Ok(program)
}

/// The source, and the program made of it: another source is another program.
fn places() -> Result<(PathBuf, PathBuf)> {
    let sources = repository().join("test/peers/fast_peer");
    let mut text = Vec::new();
    for name in ["main.cpp", "discovery.hpp", "talk.hpp", "types.hpp"] {
        let file = sources.join(name);
        text.extend(std::fs::read(&file).with_context(|| format!("reading {}", file.display()))?);
    }
    let own = std::env::current_exe()?;
    let folder = own.ancestors().nth(2).context("the test runs outside a Cargo build folder")?;
    let folder = folder.join("fast_peer");
    std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
    let hash = sha256(&text);
    Ok((sources.join("main.cpp"), folder.join(hash.get(..16).unwrap_or(&hash))))
}

fn has_library(program: &std::path::Path) -> Result<bool> {
    let probe = program.with_extension(format!("{}.hpp", std::process::id()));
    std::fs::write(&probe, PROBE)?;
    let ran = compiler().args(["-x", "c++", "-E", "-o", "/dev/null"]).arg(&probe).output();
    std::fs::remove_file(&probe)?;
    Ok(ran.context("starting the C++ compiler")?.status.success())
}

/// Compiles it, unless another test does: the lock ends with the file.
fn compile(source: &std::path::Path, program: &std::path::Path) -> Result {
    let lock = File::create(program.with_extension("lock"))?;
    lock.lock().context("waiting for the test that compiles it")?;
    if program.is_file() {
        return Ok(());
    }
    let unfinished = program.with_extension("part");
    let mut command = compiler();
    command.args(["-std=c++17", "-O1", "-o"]).arg(&unfinished).arg(source);
    command.args(["-lfastrtps", "-lfastcdr", "-pthread"]);
    let ran = command.output().context("starting the C++ compiler")?;
    if !ran.status.success() {
        let said = String::from_utf8_lossy(&ran.stderr);
        bail!("{command:?} failed:\n{}", said.lines().take(20).collect::<Vec<_>>().join("\n"));
    }
    // Whole or not at all: a test that finds it starts it.
    std::fs::rename(&unfinished, program)?;
    Ok(())
}
