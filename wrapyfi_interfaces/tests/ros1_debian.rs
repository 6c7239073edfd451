//! Every message and service that Debian ships for ROS 1, there and back: random contents written by ROS
//! 1's own genpy, compared with CDR that rosbags wrote (`test/peers/ros1_vectors.py`).
//!
//! `WRAPYFI_ROS1_PREFIX` says where those packages are, `/usr` by default.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use wrapyfi_interfaces::ros1::{Definition, Options, Plan, Rules, Types};
use wrapyfi_interfaces::store::TypeStore;

/// Packages without which the test would show little.
const PACKAGES: [&str; 11] = [
    "actionlib_msgs",
    "diagnostic_msgs",
    "geometry_msgs",
    "nav_msgs",
    "sensor_msgs",
    "shape_msgs",
    "std_msgs",
    "stereo_msgs",
    "tf2_msgs",
    "trajectory_msgs",
    "visualization_msgs",
];

/// What the test needs, or what is missing.
fn needs() -> Result<(PathBuf, PathBuf), String> {
    let prefix =
        std::env::var_os("WRAPYFI_ROS1_PREFIX").map_or_else(|| "/usr".into(), PathBuf::from);
    for package in PACKAGES {
        let folder = prefix.join("share").join(package).join("msg");
        if !folder.is_dir() {
            let name = package.replace('_', "-");
            return Err(format!(
                "no {}: apt install ros-{name}, or set WRAPYFI_ROS1_PREFIX",
                folder.display()
            ));
        }
    }
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join("../.venv/bin/python");
    let python = std::env::var_os("WRAPYFI_PYTHON").map_or(usual, PathBuf::from);
    let packages = prefix.join("lib/python3/dist-packages");
    let probe = format!("import sys, rosbags; sys.path.append({packages:?}); import genpy, genmsg");
    match Command::new(&python).args(["-c", &probe]).env("PYTHONDONTWRITEBYTECODE", "1").output() {
        Ok(probe) if probe.status.success() => Ok((prefix, python)),
        Ok(probe) => Err(format!(
            "{} lacks rosbags, or {} lacks genpy; run `make test`: {}",
            python.display(),
            packages.display(),
            String::from_utf8_lossy(&probe.stderr).trim()
        )),
        Err(error) => Err(format!("{}: {error}; set WRAPYFI_PYTHON", python.display())),
    }
}

/// Whether this system has packages of ROS 1 at all.
fn has_ros1() -> bool {
    let asked = Command::new("apt-cache").args(["show", "ros-std-msgs"]).output();
    asked.is_ok_and(|asked| asked.status.success())
}

fn unhex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().as_chunks::<2>().0;
    digits
        .iter()
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}

fn text<'v>(value: &'v Value, key: &str) -> &'v str {
    value[key].as_str().unwrap_or_else(|| panic!("no {key} in {value}"))
}

/// Types with random messages.
fn written(prefix: &Path, python: &Path, seed: u32) -> Vec<Value> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../test/peers/ros1_vectors.py");
    let output = Command::new(python)
        .arg(script)
        .args(["--cases", "4", "--seed", &seed.to_string(), "--prefix"])
        .args([prefix, &prefix.join("share")])
        .env("PYTHONUTF8", "1")
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = output.stdout.split(|&byte| byte == b'\n').filter(|line| !line.is_empty());
    lines.map(|line| serde_json::from_slice(line).unwrap()).collect()
}

/// What a publisher of the type would show, and what we know without it.
fn checks_of_a_message(types: &mut Types, vector: &Value) -> Plan {
    let (name, shown) = (text(vector, "type"), text(vector, "text"));
    // Found in the folder: the text is that of the files.
    let found = types.definition(name).unwrap();
    assert_eq!((found.md5sum(), found.text()), (text(vector, "md5"), shown), "{name}");
    // Shown by a peer.
    let header = Definition::from_header(name, shown).unwrap();
    assert_eq!(header, found);
    // At hand without either.
    let mut bare = Types::new(Rules::built_in(), TypeStore::empty());
    assert_eq!(bare.definition(name).unwrap().md5sum(), found.md5sum(), "{name}");
    let plan = types.plan(&header).unwrap();
    assert_eq!(plan.ros2_type().to_string(), text(vector, "ros2"));
    if let Some(hash) = vector["hash"].as_str() {
        assert_eq!(types.ros2_type(header.resolved()).unwrap().type_hash(), hash, "{name}");
    }
    plan
}

#[test]
fn every_message_of_debian_goes_to_ros2_and_back() {
    let (prefix, python) = match needs() {
        Ok(found) => found,
        Err(reason) => {
            let required = std::env::var("WRAPYFI_REQUIRE_PEERS").is_ok_and(|value| value == "1");
            assert!(!required || !has_ros1(), "{reason}");
            // Written directly: the test runner hides what `println!` says when a test passes.
            writeln!(std::io::stderr(), "SKIPPED a peer is missing: {reason}").unwrap();
            return;
        }
    };
    let seed = std::process::id();
    let vectors = written(&prefix, &python, seed);
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    types.add_ros1_path(prefix.join("share").as_os_str());
    let options = Options::default();
    let mut packages = BTreeSet::new();
    let mut carried = 0;
    for vector in &vectors {
        let name = text(vector, "type");
        packages.insert(name.split('/').next().unwrap());
        let of_service = (text(vector, "kind") == "srv").then(|| {
            let plan = types.service_plan(name, None).unwrap();
            let found = (plan.definition.md5sum(), plan.definition.text());
            assert_eq!(found, (text(vector, "md5"), text(vector, "text")), "{name}");
            plan
        });
        let of_message = of_service.is_none().then(|| checks_of_a_message(&mut types, vector));
        for message in vector["messages"].as_array().unwrap() {
            let plan = match (&of_service, &of_message, text(message, "part")) {
                (Some(service), _, "Request") => &service.request,
                (Some(service), _, _) => &service.response,
                (None, plan, _) => plan.as_ref().unwrap(),
            };
            let bytes = unhex(text(message, "ros1"));
            let (mut cdr, mut ros1) = (Vec::new(), Vec::new());
            plan.to_cdr(&bytes, &options, &mut cdr).unwrap();
            assert_eq!(cdr, unhex(text(message, "cdr")), "{name}, seed {seed}");
            let seq = u32::try_from(message["seq"].as_u64().unwrap()).unwrap();
            plan.to_ros1(&cdr, seq, &options, &mut ros1).unwrap();
            let expected = message["back"].as_str().map_or(bytes, unhex);
            assert_eq!(ros1, expected, "{name}, seed {seed}");
            carried += 1;
        }
    }
    for package in PACKAGES {
        assert!(packages.contains(package), "{package} was not carried");
    }
    assert!(carried > 500, "{carried} messages only");
}
