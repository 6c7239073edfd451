//! The machine of a run, for the report.

use std::fs;

use chrono::{DateTime, Utc};

fn line(path: &str) -> String {
    fs::read_to_string(path).unwrap_or_default().trim().to_owned()
}

fn field(path: &str, name: &str) -> String {
    let text = fs::read_to_string(path).unwrap_or_default();
    let found =
        text.lines().find_map(|line| line.split_once(':').filter(|(k, _)| k.trim() == name));
    found.map_or_else(|| "unknown".to_owned(), |(_, value)| value.trim().to_owned())
}

/// Description of the machine: names and values.
pub(crate) fn describe() -> Vec<(&'static str, String)> {
    let date = DateTime::<Utc>::from(std::time::SystemTime::now());
    let governor = line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
    let (major, minor, patch) = zmq::version();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    vec![
        ("Date", date.format("%Y-%m-%d %H:%M UTC").to_string()),
        ("CPU", field("/proc/cpuinfo", "model name")),
        ("Cores", cores.to_string()),
        ("Memory", field("/proc/meminfo", "MemTotal")),
        ("Kernel", line("/proc/sys/kernel/osrelease")),
        ("Governor", if governor.is_empty() { "not told".to_owned() } else { governor }),
        ("Pinning", "none".to_owned()),
        ("net.core.rmem_max", line("/proc/sys/net/core/rmem_max")),
        ("libzmq", format!("{major}.{minor}.{patch}")),
    ]
}
