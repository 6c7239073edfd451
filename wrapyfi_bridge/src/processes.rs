//! Processes of this machine, as `/proc` shows them.

use std::fs;
use std::path::{Path, PathBuf};

/// A process.
pub struct Process {
    /// Number of the process.
    pub pid: u32,
    folder: PathBuf,
}

/// Processes of this machine.
pub fn processes() -> impl Iterator<Item = Process> {
    let folders = fs::read_dir("/proc").into_iter().flatten().flatten();
    folders.filter_map(|it| {
        Some(Process { pid: it.file_name().to_str()?.parse().ok()?, folder: it.path() })
    })
}

impl Process {
    /// True where a signal or a debugger has stopped it.
    pub fn is_stopped(&self) -> bool {
        let stat = fs::read_to_string(self.folder.join("stat")).unwrap_or_default();
        stat.rsplit(") ").next().is_some_and(|state| state.starts_with(['T', 't']))
    }

    /// Words of the command with which it was started; `None` where they cannot be read.
    pub fn command(&self) -> Option<Vec<String>> {
        let line = fs::read_to_string(self.folder.join("cmdline")).ok()?;
        Some(line.split_terminator('\0').map(str::to_owned).collect())
    }

    /// True for a bridge of this program that was started with `command`.
    pub fn is_bridge(command: &[String]) -> bool {
        let program = command.first().is_some_and(|it| it.ends_with("wrapyfi"));
        program && command.iter().any(|word| word == "bridge")
    }

    /// File that a word of its command names, seen from its working directory.
    pub fn file(&self, word: &str) -> Option<PathBuf> {
        fs::canonicalize(self.folder.join("cwd").join(word)).ok()
    }

    /// Value of a variable of its environment, empty where it is not set; `None` where the environment cannot be read.
    pub fn variable(&self, name: &str) -> Option<String> {
        let environment = fs::read_to_string(self.folder.join("environ")).ok()?;
        let value = |one: &str| Some(one.strip_prefix(name)?.strip_prefix('=')?.to_owned());
        Some(environment.split('\0').find_map(value).unwrap_or_default())
    }

    /// True where it has sockets open; false also where that cannot be seen.
    pub fn has_sockets(&self) -> bool {
        let is_socket = |path: &Path| path.to_string_lossy().starts_with("socket:");
        let open = fs::read_dir(self.folder.join("fd")).into_iter().flatten().flatten();
        open.into_iter().any(|file| fs::read_link(file.path()).is_ok_and(|to| is_socket(&to)))
    }
}
