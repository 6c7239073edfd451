//! Threads of this process, and how to have them to oneself.

use std::collections::BTreeMap;
use std::process::Command;

/// Set in a process that runs one test only.
const ALONE: &str = "WRAPYFI_CONFORMANCE_ALONE";

/// Runs `test` in a process in which no other test runs: this one under nextest, else a child.
pub(crate) fn run_alone(test: impl FnOnce()) {
    let thread = std::thread::current();
    let name = match thread.name() {
        Some(name) if name != "main" => name,
        _ => return test(),
    };
    if std::env::var_os("NEXTEST").is_some() || std::env::var_os(ALONE).is_some() {
        return test();
    }
    let program = std::env::current_exe().unwrap();
    let output = Command::new(program)
        .args(["--exact", name, "--nocapture"])
        .env(ALONE, "1")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "alone in a process, {name} fails:\n{text}");
}

/// The threads of this process: their ids and names.
pub(crate) fn threads() -> BTreeMap<String, String> {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return BTreeMap::new() };
    tasks
        .filter_map(Result::ok)
        .filter_map(|task| {
            // A thread may end while it is looked at.
            let name = std::fs::read_to_string(task.path().join("comm")).ok()?;
            Some((task.file_name().to_string_lossy().into_owned(), name.trim().to_owned()))
        })
        .collect()
}
