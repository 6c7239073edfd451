//! A node's parameters, asked for by a program that shares no code with ours: CycloneDDS from
//! Python, with types written by hand (`test/peers/param_peer.py`).

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::{Value, json};
use wrapyfi_ros2::CycloneConfig;

use crate::common::{domain, name};
use crate::node_common::Offering;

/// Python with `cyclonedds`, or why there is none.
fn python() -> Result<PathBuf, String> {
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../.venv/bin/python");
    let path = std::env::var_os("WRAPYFI_PYTHON").map_or(usual, PathBuf::from);
    let probe = Command::new(&path).args(["-c", "import cyclonedds"]).output();
    match probe {
        Ok(probe) if probe.status.success() => Ok(path),
        Ok(_) => Err(format!("{} lacks cyclonedds; run `make test`", path.display())),
        Err(error) => Err(format!("{}: {error}; set WRAPYFI_PYTHON", path.display())),
    }
}

/// Ends its process, also when a test fails.
struct Peer(Option<Child>);

impl Peer {
    /// Events that the peer prints until it ends.
    fn events(mut self) -> Vec<Value> {
        let output = self.0.take().unwrap().wait_with_output().unwrap();
        let faults = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{faults}");
        let lines = output.stdout.split(|&byte| byte == b'\n').filter(|line| !line.is_empty());
        lines.map(|line| serde_json::from_slice(line).unwrap()).collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        if let Some(peer) = &mut self.0 {
            peer.kill().unwrap();
            peer.wait().unwrap();
        }
    }
}

#[test]
fn parameters_are_given_to_an_independent_client() {
    let python = match python() {
        Ok(python) => python,
        Err(reason) => {
            let required = std::env::var("WRAPYFI_REQUIRE_PEERS").is_ok_and(|value| value == "1");
            assert!(!required, "{reason}");
            // Written directly: the test runner hides what `println!` says when a test passes.
            writeln!(std::io::stderr(), "SKIPPED a peer is missing: {reason}").unwrap();
            return;
        }
    };
    // The peer knows no domain tag; runs at the same time differ by name.
    let node = name("camera");
    let (asked, domain) = (node.fqn(), domain());
    let offering = Offering::new(&CycloneConfig::loopback(node, domain));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../test/peers/param_peer.py");
    let mut command = Command::new(python);
    command
        .arg(script)
        .args(["--node", &asked, "--client", "17279655951921914625"])
        .args(["rate", "lens.label", ",", "rate", "nothing", ",", "serial"])
        .env("ROS_DOMAIN_ID", domain.to_string())
        .env("PYTHONUTF8", "1")
        .env("PYTHONDONTWRITEBYTECODE", "1")
        // Its end tells the peer to leave: it stays open as long as the peer is waited for.
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let stdin = child.stdin.take();
    let events = Peer(Some(child)).events();
    drop(stdin);
    let value = |kind: u8, integer: i64, text: &str| json!({"type": kind, "integer_value": integer, "string_value": text});
    let replies: Vec<_> = events.iter().filter(|event| event["event"] == "reply").collect();
    let values: Vec<_> = replies.iter().map(|reply| reply["values"].clone()).collect();
    assert_eq!(
        values,
        [json!([value(2, 10, ""), value(4, 0, "left")]), json!([]), json!([value(4, 0, "A1")])],
        "{events:?}"
    );
    assert_eq!(offering.node.handle().refused_requests(), 0);
}
