//! Every message and service that Debian ships for ROS 1, there and back: random contents written by ROS
//! 1's own genpy, compared with CDR that rosbags wrote (`test/peers/ros1_vectors.py`).
//!
//! `WRAPYFI_ROS1_PREFIX` says where those packages are, `/usr` by default. Whatever other packages are
//! there is carried too, by the definitions in its folders: no program has to have it built in.
#![allow(clippy::unwrap_used, clippy::indexing_slicing, clippy::panic)]

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use wrapyfi_interfaces::ros1::{Definition, Options, PairPlan, Rules, Types};
use wrapyfi_interfaces::store::{ResolvedType, TypeStore};

/// Packages without which the test would show little. Their types are built in.
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

/// Packages of Debian that are built in as well.
const ALSO_BUILT_IN: [&str; 5] =
    ["map_msgs", "move_base_msgs", "pcl_msgs", "roscpp", "rosgraph_msgs"];

/// Folders that the test needs, or the name of the missing one.
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
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../.venv/bin/python");
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

/// True when this system has packages of ROS 1 at all.
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
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../test/peers/ros1_vectors.py");
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

/// Asserts that a publisher's definition of the type is the one that is known without it, and
/// returns the plan.
fn checks_of_a_message(types: &mut Types, vector: &Value) -> PairPlan {
    let (name, shown) = (text(vector, "type"), text(vector, "text"));
    // Found in the folder: the text is that of the files.
    let found = types.definition(name).unwrap();
    assert_eq!(
        (found.md5sum.as_str(), found.text.as_str()),
        (text(vector, "md5"), shown),
        "{name}"
    );
    // Shown by a peer.
    let header = Definition::from_header(name, shown).unwrap();
    assert_eq!(header, found);
    if PACKAGES.iter().chain(&ALSO_BUILT_IN).any(|one| name.split('/').next() == Some(one)) {
        // At hand without either.
        let mut bare = Types::new(Rules::built_in(), TypeStore::empty());
        assert_eq!(bare.definition(name).unwrap().md5sum, found.md5sum, "{name}");
    }
    let plan = types.plan(&header).unwrap();
    assert_eq!(plan.ros2_type().to_string(), text(vector, "ros2"));
    if let Some(hash) = vector["hash"].as_str() {
        assert_eq!(types.ros2_type(&header.resolved).unwrap().type_hash(), hash, "{name}");
    }
    plan
}

/// Prefix and interpreter; none where the test is skipped.
fn peer() -> Option<(PathBuf, PathBuf)> {
    match needs() {
        Ok(found) => Some(found),
        Err(reason) => {
            let required = std::env::var("WRAPYFI_REQUIRE_PEERS").is_ok_and(|value| value == "1");
            assert!(!required || !has_ros1(), "{reason}");
            // Written directly: the test runner hides what `println!` says when a test passes.
            let mut shown = std::io::stderr().lock();
            writeln!(shown, "SKIPPED a peer is missing: {reason}").unwrap();
            None
        }
    }
}

/// Carries every type of every package below the prefix; how many messages of which packages.
fn carry(prefix: &Path, python: &Path) -> BTreeMap<String, usize> {
    let seed = std::process::id();
    let vectors = written(prefix, python, seed);
    let mut types = Types::new(Rules::built_in(), TypeStore::empty());
    types.add_ros1_path(prefix.join("share").as_os_str());
    let options = Options::default();
    let mut carried = BTreeMap::new();
    for vector in &vectors {
        let name = text(vector, "type");
        let count: &mut usize =
            carried.entry(name.split('/').next().unwrap().to_owned()).or_default();
        let of_service = (text(vector, "kind") == "srv").then(|| {
            let definition = types.service_definition(name, None).unwrap();
            let ros2 = types.ros2_service(name, None).unwrap();
            let found = (definition.md5sum.as_str(), definition.text.as_str());
            assert_eq!(found, (text(vector, "md5"), text(vector, "text")), "{name}");
            let plan = |ros1: &ResolvedType, suffix| {
                PairPlan::compile(ros1, &ros2.part(suffix).unwrap(), types.rules()).unwrap()
            };
            [plan(&definition.request, "_Request"), plan(&definition.response, "_Response")]
        });
        let of_message = of_service.is_none().then(|| checks_of_a_message(&mut types, vector));
        for message in vector["messages"].as_array().unwrap() {
            let plan = match (&of_service, &of_message, text(message, "part")) {
                (Some([request, _]), _, "Request") => request,
                (Some([_, response]), ..) => response,
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
            *count += 1;
        }
    }
    carried
}

#[test]
fn every_message_of_debian_goes_to_ros2_and_back() {
    let Some((prefix, python)) = peer() else { return };
    let carried = carry(&prefix, &python);
    for package in PACKAGES {
        assert!(carried.contains_key(package), "{package} was not carried");
    }
    let count: usize = carried.values().sum();
    assert!(count > 500, "{count} messages only");
}

/// A package that is nowhere built in, such as Debian's actionlib, beside those that are.
#[test]
fn a_package_that_is_not_built_in_is_carried_by_its_folder() {
    let Some((prefix, python)) = peer() else { return };
    let mixed = tempfile::tempdir().unwrap();
    let share = mixed.path().join("share");
    std::fs::create_dir_all(share.join("extra_tests/msg")).unwrap();
    for package in ["std_msgs", "actionlib_msgs", "geometry_msgs"] {
        std::os::unix::fs::symlink(prefix.join("share").join(package), share.join(package))
            .unwrap();
    }
    std::os::unix::fs::symlink(prefix.join("lib"), mixed.path().join("lib")).unwrap();
    for (name, text) in [
        ("TestGoal", "int32 goal\ngeometry_msgs/Pose at\n"),
        ("TestActionGoal", "Header header\nactionlib_msgs/GoalID goal_id\nTestGoal goal\n"),
        ("TestAction", "TestActionGoal action_goal\nbool[] done\n"),
    ] {
        std::fs::write(share.join("extra_tests/msg").join(format!("{name}.msg")), text).unwrap();
    }
    let carried = carry(mixed.path(), &python);
    assert_eq!(carried.get("extra_tests"), Some(&12), "{carried:?}");
}
