//! A bridge of this machine that is not found on the graph: its process is stopped (Ctrl-Z, a debugger), or it is in another
//! domain.

use std::fs;
use std::path::Path;

use super::{Cause, Finding};
use crate::exit::Failure;

/// The bridge that was started with a file, any where that is `None`, if it is stopped, or by its environment not in the
/// `domain`, where one is told.
pub(super) fn bridge(file: Option<&str>, domain: Option<u32>) -> Option<Finding> {
    let file = file.map(fs::canonicalize).transpose().ok()?;
    let mut numbers =
        fs::read_dir("/proc").ok()?.filter_map(|it| it.ok()?.file_name().to_str()?.parse().ok());
    numbers.find_map(|pid: u32| {
        let folder = Path::new("/proc").join(pid.to_string());
        let text = |name| fs::read_to_string(folder.join(name));
        let (stat, line) = (text("stat").ok()?, text("cmdline").ok()?);
        let words: Vec<_> = line.split_terminator('\0').collect();
        let is_ours = words.first()?.ends_with("wrapyfi") && words.contains(&"bridge");
        let files = words.iter().map(|word| fs::canonicalize(folder.join("cwd").join(word)));
        let mut files = files.flatten();
        if !is_ours || !file.as_ref().is_none_or(|it| files.any(|one| one == *it)) {
            return None;
        }
        let command = words.join(" ");
        if stat.rsplit(") ").next()?.starts_with(['T', 't']) {
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
    let folders = fs::read_dir("/proc").into_iter().flatten().flatten();
    let stopped = folders.filter_map(|folder| {
        let (pid, folder) = (folder.file_name().to_str()?.parse().ok()?, folder.path());
        let text = |name| fs::read_to_string(folder.join(name)).ok();
        if !text("stat")?.rsplit(") ").next()?.starts_with(['T', 't']) {
            return None;
        }
        // Those of others cannot be read.
        let mut open = fs::read_dir(folder.join("fd")).ok()?.flatten();
        let is_socket = |path: &Path| path.to_string_lossy().starts_with("socket:");
        open.any(|file| fs::read_link(file.path()).is_ok_and(|to| is_socket(&to)))
            .then_some((pid, text("cmdline")?.replace('\0', " ").trim_end().to_owned()))
    });
    stopped.collect()
}

/// Failure that no bridge has answered, with the cause: one of this machine is stopped, or is in another domain.
pub(crate) fn or(failure: Failure) -> Failure {
    let Failure::TimedOut(text) = failure else { return failure };
    let domain = std::env::var("ROS_DOMAIN_ID").ok().and_then(|it| it.parse().ok()).unwrap_or(0);
    let words = |it: Finding| format!("{}: {}", it.what, it.remedy);
    let stopped = bridge(None, None).map(words);
    let afar = || bridge(None, Some(domain)).map(|it| format!("{text}. {}", words(it)));
    Failure::TimedOut(stopped.or_else(afar).unwrap_or(text))
}
