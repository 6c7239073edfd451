//! Programs of this machine that are not found: their process is stopped (Ctrl-Z, a debugger), or it is that of a bridge in
//! another domain.

use wrapyfi_endpoint::CauseCode;

use super::{Finding, Way};
use crate::exit::Failure;
use crate::processes::{Process, processes};

/// The bridge that was started with a file, any where that is `None`, if it is stopped, or by its environment not in the
/// `domain`, where one is told.
pub(super) fn bridge(file: Option<&str>, domain: Option<u32>) -> Option<Finding> {
    let file = file.map(std::fs::canonicalize).transpose().ok()?;
    processes().find_map(|process| {
        let words = process.command().filter(|words| Process::is_bridge(words))?;
        let mut files = words.iter().filter_map(|word| process.file(word));
        if !file.as_ref().is_none_or(|it| files.any(|one| one == *it)) {
            return None;
        }
        let (command, pid) = (words.join(" "), process.pid);
        if process.is_stopped() {
            let what = format!("`{command}` is stopped and does not answer: its routes rest");
            let remedy = format!("kill -CONT {pid}, or `fg` in its shell");
            return Some(Finding::new(CauseCode::NoBridge, what, "whoever stopped it", remedy));
        }
        let there = process.variable("ROS_DOMAIN_ID")?;
        let there = if there.is_empty() { "0" } else { &there };
        domain.filter(|domain| there != domain.to_string()).map(|domain| {
            let what = format!("`{command}` runs in domain {there} of ROS 2, and this shell looks in {domain}");
            let remedy = format!(
                "export ROS_DOMAIN_ID={there} in this shell, where that is the robot's; else end process {pid}, and start it \
                 with ROS_DOMAIN_ID={domain}"
            );
            let who = "this shell, or whoever starts the bridge";
            Finding::new(CauseCode::OtherDomain, what, who, remedy)
        })
    })
}

/// Programs of this machine that are stopped while they have connections, by process.
pub(super) fn programs() -> Vec<(u32, String)> {
    // Those of others cannot be read.
    let connected = processes().filter(|process| process.is_stopped() && process.has_sockets());
    connected.filter_map(|process| Some((process.pid, process.command()?.join(" ")))).collect()
}

/// The finding that no program is there, with the programs that may be and are stopped.
pub(super) fn with_stopped_programs(finding: Finding, way: &Way) -> Finding {
    use CauseCode::{Idle, NobodyListens, NobodyOffers, NobodyPublishes};
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
