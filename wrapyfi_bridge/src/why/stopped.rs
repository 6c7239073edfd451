//! A bridge of this machine whose process is stopped (Ctrl-Z, a debugger): nothing of it is found on the graph.

use std::fs;
use std::path::Path;

use super::{Cause, Finding};
use crate::exit::Failure;

/// The bridge that was started with a file, any where that is `None`, if it is stopped.
pub(super) fn bridge(file: Option<&str>) -> Option<Finding> {
    let file = file.map(fs::canonicalize).transpose().ok()?;
    let mut numbers =
        fs::read_dir("/proc").ok()?.filter_map(|it| it.ok()?.file_name().to_str()?.parse().ok());
    numbers.find_map(|pid: u32| {
        let folder = Path::new("/proc").join(pid.to_string());
        let text = |name| fs::read_to_string(folder.join(name));
        let (stat, line) = (text("stat").ok()?, text("cmdline").ok()?);
        let is_stopped = stat.rsplit(") ").next()?.starts_with(['T', 't']);
        let words: Vec<_> = line.split_terminator('\0').collect();
        let is_ours = words.first()?.ends_with("wrapyfi") && words.contains(&"bridge");
        let files = words.iter().map(|word| fs::canonicalize(folder.join("cwd").join(word)));
        let mut files = files.flatten();
        let is_it =
            is_stopped && is_ours && file.as_ref().is_none_or(|it| files.any(|one| one == *it));
        is_it.then(|| {
            let command = words.join(" ");
            let what = format!("`{command}` is stopped and does not answer: its routes rest");
            let remedy = format!("kill -CONT {pid}, or `fg` in its shell");
            Finding::new(Cause::NoBridge, what, "whoever stopped it", remedy)
        })
    })
}

/// Why no bridge has answered: one of this machine is stopped, or else the `failure`.
pub(crate) fn or(failure: Failure) -> Failure {
    let stopped = bridge(None).filter(|_| matches!(failure, Failure::TimedOut(_)));
    stopped.map_or(failure, |it| Failure::TimedOut(format!("{}: {}", it.what, it.remedy)))
}
