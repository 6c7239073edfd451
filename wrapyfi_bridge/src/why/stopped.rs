//! A bridge of this machine whose process is stopped (Ctrl-Z, a debugger): nothing of it is found on the graph.

use std::fs;
use std::path::Path;

/// Number and command line of the stopped bridge that was started with a file.
pub(super) fn bridge_of(file: &str) -> Option<(u32, String)> {
    let (file, processes) = (fs::canonicalize(file).ok()?, fs::read_dir("/proc").ok()?.flatten());
    let mut numbers = processes.filter_map(|it| it.file_name().to_str()?.parse().ok());
    numbers.find_map(|pid: u32| {
        let folder = Path::new("/proc").join(pid.to_string());
        let text = |name| fs::read_to_string(folder.join(name));
        let (stat, line) = (text("stat").ok()?, text("cmdline").ok()?);
        let is_stopped = stat.rsplit(") ").next()?.starts_with(['T', 't']);
        let words: Vec<_> = line.split_terminator('\0').collect();
        let is_file =
            |word| fs::canonicalize(folder.join("cwd").join(word)).is_ok_and(|it| it == file);
        let is_it = is_stopped && words.contains(&"bridge") && words.iter().any(is_file);
        is_it.then(|| (pid, words.join(" ")))
    })
}
