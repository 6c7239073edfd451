//! Programs of this machine that are not found: their process is stopped (Ctrl-Z, a debugger), or it is that of a bridge in
//! another domain.

use std::fs;
use std::path::{Path, PathBuf};

use super::{Cause, Finding, Way};
use crate::exit::Failure;

/// Processes of this machine, each with its folder.
fn processes() -> impl Iterator<Item = (u32, PathBuf)> {
    let folders = fs::read_dir("/proc").into_iter().flatten().flatten();
    folders.filter_map(|it| Some((it.file_name().to_str()?.parse().ok()?, it.path())))
}

/// True for a process that a signal or a debugger has stopped.
fn is_stopped(folder: &Path) -> bool {
    let stat = fs::read_to_string(folder.join("stat")).unwrap_or_default();
    stat.rsplit(") ").next().is_some_and(|state| state.starts_with(['T', 't']))
}

/// The bridge that was started with a file, any where that is `None`, if it is stopped, or by its environment not in the
/// `domain`, where one is told.
pub(super) fn bridge(file: Option<&str>, domain: Option<u32>) -> Option<Finding> {
    let file = file.map(fs::canonicalize).transpose().ok()?;
    processes().find_map(|(pid, folder)| {
        let text = |name| fs::read_to_string(folder.join(name));
        let line = text("cmdline").ok()?;
        let words: Vec<_> = line.split_terminator('\0').collect();
        let is_ours = words.first()?.ends_with("wrapyfi") && words.contains(&"bridge");
        let files = words.iter().map(|word| fs::canonicalize(folder.join("cwd").join(word)));
        let mut files = files.flatten();
        if !is_ours || !file.as_ref().is_none_or(|it| files.any(|one| one == *it)) {
            return None;
        }
        let command = words.join(" ");
        if is_stopped(&folder) {
            let what = format!("`{command}` is stopped and does not answer: its routes rest");
            let remedy = format!("kill -CONT {pid}, or `fg` in its shell");
            return Some(Finding::new(Cause::NoBridge, what, "whoever stopped it", remedy));
        }
        let environment = text("environ").ok()?;
        let mut variables = environment.split('\0');
        let there = variables.find_map(|one| one.strip_prefix("ROS_DOMAIN_ID=")).unwrap_or("0");
        domain.filter(|domain| there != domain.to_string()).map(|domain| {
            let what = format!("`{command}` runs in domain {there} of ROS 2, and this shell looks in {domain}");
            let remedy = format!(
                "export ROS_DOMAIN_ID={there} in this shell, where that is the robot's; else end process {pid}, and start it \
                 with ROS_DOMAIN_ID={domain}"
            );
            let who = "this shell, or whoever starts the bridge";
            Finding::new(Cause::OtherDomain, what, who, remedy)
        })
    })
}

/// Programs of this machine that are stopped while they have connections, by process.
pub(super) fn programs() -> Vec<(u32, String)> {
    let stopped = processes().filter(|(_, folder)| is_stopped(folder));
    let connected = stopped.filter_map(|(pid, folder)| {
        // Those of others cannot be read.
        let mut open = fs::read_dir(folder.join("fd")).ok()?.flatten();
        let is_socket = |path: &Path| path.to_string_lossy().starts_with("socket:");
        if !open.any(|file| fs::read_link(file.path()).is_ok_and(|to| is_socket(&to))) {
            return None;
        }
        let line = fs::read_to_string(folder.join("cmdline")).ok()?;
        Some((pid, line.replace('\0', " ").trim_end().to_owned()))
    });
    connected.collect()
}

/// The finding that nobody is there, with the programs that may be and are stopped.
pub(super) fn with_stopped_programs(finding: Finding, way: &Way) -> Finding {
    use Cause::{Idle, NobodyListens, NobodyOffers, NobodyPublishes};
    if !matches!(finding.cause, NobodyPublishes | NobodyOffers | NobodyListens | Idle) {
        return finding;
    }
    let stopped = way.stopped_programs.iter().map(|(pid, command)| {
        format!("; or `{command}`, which is stopped and goes on by kill -CONT {pid}")
    });
    Finding { who: finding.who + &stopped.collect::<String>(), ..finding }
}

/// Failure that no bridge has answered, with the cause: one of this machine is stopped, or is in another domain.
pub(crate) fn or(failure: Failure) -> Failure {
    let Failure::TimedOut(text) = failure else { return failure };
    let domain = std::env::var("ROS_DOMAIN_ID").ok().and_then(|it| it.parse().ok()).unwrap_or(0);
    let words = |it: Finding| format!("{}: {}", it.what, it.remedy);
    let stopped = bridge(None, None).map(words);
    let elsewhere = || bridge(None, Some(domain)).map(|it| format!("{text}. {}", words(it)));
    Failure::TimedOut(stopped.or_else(elsewhere).unwrap_or(text))
}
