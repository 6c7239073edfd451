//! Bags of ROS 1, written by rosbag, and recordings of ROS 2: what `wrapyfi convert` makes is read by the package rosbags, message by
//! message beside the bag.
//!
//! ```text
//!   rosbag ─▶ .bag ─┬─ wrapyfi convert ─▶ .mcap, folder ─┐
//!                   ├─ rosbags-convert ─▶ folder ────────┼─▶ rosbags: same times, same values, same bytes
//!                   └────────────────────────────────────┘
//! ```

use std::path::{Path, PathBuf};

use serde_json::Value;
use wrapyfi_e2e::{Need, RealRos2, Result, TestEnv, run};

pub(crate) const NEEDS: &[Need] = &[Need::Program, Need::Python, Need::Ros1];
/// Messages that `rosbag_write.py` writes of its own kinds.
const KINDS: u64 = 323;

/// Writes a bag, and returns its path.
pub(crate) fn bag(env: &TestEnv, name: &str, args: &str) -> Result<PathBuf> {
    let path = env.path(name);
    env.rosbag(&format!("{} {args}", path.display()))?.exits_with(0)?;
    Ok(path)
}

/// Runs `wrapyfi convert --json`, which ends with this code, and returns its report.
pub(crate) fn convert(
    env: &TestEnv,
    bag: &Path,
    out: &str,
    args: &[&str],
    code: i32,
) -> Result<Value> {
    let (bag, out) = (bag.display().to_string(), env.path(out).display().to_string());
    let words = ["convert", "--json", &bag, &out].into_iter().chain(args.iter().copied());
    let mut convert = env.wrapyfi(words)?;
    convert.exits_with(code)?;
    Ok(serde_json::from_str(&convert.stdout())?)
}

/// Compares a bag with a recording by rosbags; the number of messages that it has compared.
pub(crate) fn compared(env: &TestEnv, bag: &Path, recording: &str, more: &str) -> Result<u64> {
    let recording = env.path(recording);
    let args = format!("{} {} {more}", bag.display(), recording.display());
    let mut same = env.peer("rosbags_same.py", &args)?;
    same.exits_with(0)?;
    Ok(same.stdout().trim().parse()?)
}

/// The entry of a topic of the bag in a report.
fn topic<'r>(report: &'r Value, name: &str) -> &'r Value {
    let topics = report["topics"].as_array();
    let found = topics.and_then(|all| all.iter().find(|topic| topic["from"] == name));
    found.unwrap_or_else(|| panic!("{name} is not in {report}"))
}

#[test]
fn every_kind_of_field_and_compression_arrives_as_rosbags_reads_it() -> Result {
    run("bags_kinds", NEEDS, |env| {
        for (compression, ours) in [("none", "none"), ("bz2", "zstd"), ("lz4", "lz4")] {
            let name = format!("{compression}.bag");
            let bag = bag(env, &name, &format!("--compression {compression}"))?;
            // Into a folder, as of `ros2 bag`, and into one file.
            let report = convert(env, &bag, compression, &["--compression", ours], 0)?;
            assert_eq!((&report["messages"], &report["complete"]), (&KINDS.into(), &true.into()));
            let file = format!("{compression}.mcap");
            convert(env, &bag, &file, &["--compression", ours], 0)?;
            let theirs = env.path(&format!("{compression}_theirs"));
            let (from, to) = (bag.display().to_string(), theirs.display().to_string());
            let options = "--dst-storage mcap --dst-version 9 --dst-typestore ros2_jazzy";
            let words = ["-m", "rosbags.convert", "--src", &from, "--dst", &to];
            let words: Vec<&str> = words.into_iter().chain(options.split(' ')).collect();
            env.python(&words)?.exits_with(0)?;
            let more = format!("--converted {}", theirs.display());
            assert_eq!(compared(env, &bag, compression, &more)?, KINDS);
            assert_eq!(compared(env, &bag, &file, &more)?, KINDS);
            let metadata = std::fs::read_to_string(env.path(compression).join("metadata.yaml"))?;
            for line in
                ["version: 9", "storage_identifier: mcap", "message_count: 323", "ros_distro: \"\""]
            {
                assert!(metadata.contains(line), "{metadata}");
            }
        }
        Ok(())
    })
}

#[test]
fn the_report_has_names_types_and_what_latched() -> Result {
    run("bags_report", NEEDS, |env| {
        let bag = bag(env, "some.bag", "")?;
        let report = convert(env, &bag, "some", &[], 0)?;
        assert_eq!(topic(&report, "/robot-1/1st")["to"], "/robot_1/_1st");
        assert_eq!(topic(&report, "odd/names")["to"], "/odd/names");
        assert_eq!(topic(&report, "odd/names")["ros2_type"], "demo_msgs/msg/OddType");
        assert_eq!(topic(&report, "/tf")["ros2_type"], "tf2_msgs/msg/TFMessage");
        assert_eq!(topic(&report, "/clock")["ros2_type"], "rosgraph_msgs/msg/Clock");
        let metadata = std::fs::read_to_string(env.path("some").join("metadata.yaml"))?;
        let qos = |topic: &str| {
            let entries = metadata.split("- topic_metadata:").map(str::to_owned);
            let name = format!("name: \"{topic}\"");
            entries.into_iter().find(|entry| entry.contains(&name)).unwrap_or_default()
        };
        // rosbag for Python writes one publisher for each topic.
        let of_static = qos("/tf_static");
        assert!(of_static.contains("transient_local") && of_static.contains("depth: 1"));
        assert!(qos("/tf").contains("durability: volatile"), "{metadata}");
        let chosen = convert(env, &bag, "chosen.mcap", &["--topics", "/tf,/odd/names,/none"], 1)?;
        assert_eq!(chosen["topics"].as_array().map(Vec::len), Some(2), "{chosen}");
        assert_eq!(chosen["absent"][0], "/none");
        let nothing = ["convert", "some.bag", "nothing.mcap", "--topics", "/none"];
        let mut nothing = env.wrapyfi(nothing)?;
        nothing.exits_with(2)?;
        assert!(nothing.stderr().contains("has no topic /none; it has /"), "{}", nothing.stderr());
        assert!(!env.path("nothing.mcap").exists());
        // For a person, and no second time.
        let (bag, out) = (bag.display().to_string(), env.path("told").display().to_string());
        let mut told = env.wrapyfi(["convert", &bag, &out])?;
        told.exits_with(0)?;
        let text = told.stdout();
        assert!(text.contains("/robot-1/1st is /robot_1/_1st in ROS 2"), "{text}");
        assert!(text.contains("323 messages, "), "{text}");
        let mut again = env.wrapyfi(["convert", &bag, &out])?;
        again.exits_with(2)?;
        assert!(again.stderr().contains("is there already"), "{}", again.stderr());
        Ok(())
    })
}

/// A survey of a bag names types, latched topics and what is to be decided; a bridge takes its routes.
#[test]
fn a_survey_of_a_bag_needs_no_roscore() -> Result {
    run("bags_survey", NEEDS, |env| {
        let bag = bag(env, "some.bag", "")?;
        let survey = ["survey", "--bag", "some.bag", "--output", "bag.md"];
        env.wrapyfi(survey)?.exits_with(0)?;
        let report = std::fs::read_to_string(env.path("bag.md"))?;
        for line in [
            "topic `/robot-1/1st` is no name of ROS 2: it is `/robot_1/_1st` there",
            "package `demo_msgs` is not on ROS 2 here (demo_msgs/msg/All, demo_msgs/msg/OddType)",
            "| /tf_static | tf2_msgs/TFMessage → tf2_msgs/msg/TFMessage | /lidar_driver |",
            "| /odd/names | demo_msgs/odd_type → demo_msgs/msg/OddType (not on ROS 2 here) |",
            "Rates and sizes are those of the bag, of 3.9 s",
        ] {
            assert!(report.contains(line), "{line}:\n{report}");
        }
        for word in ["## Services", "Subscribers", "Hears", "parameters of"] {
            assert!(!report.contains(word), "{word}: {report}");
        }
        env.wrapyfi(["check", "bag.yaml"])?.exits_with(0)?;
        // What cannot be read is told.
        let size = std::fs::metadata(&bag)?.len();
        std::fs::OpenOptions::new().write(true).open(&bag)?.set_len(size / 2)?;
        let mut cut = env.wrapyfi(["survey", "--bag", "some.bag", "--output", "cut.md"])?;
        cut.exits_with(1)?;
        assert!(cut.stdout().contains("bytes too early"), "{}", cut.tail());
        Ok(())
    })
}

#[test]
fn bags_that_are_cut_or_were_killed_give_what_is_whole() -> Result {
    run("bags_cut", NEEDS, |env| {
        let whole = bag(env, "whole.bag", "")?;
        let size = std::fs::metadata(&whole)?.len();
        for compression in ["none", "bz2", "lz4"] {
            let name = format!("killed_{compression}.bag");
            let killed = bag(env, &name, &format!("--compression {compression} --unfinished"))?;
            let report = convert(
                env,
                &killed,
                &format!("killed_{compression}"),
                &[],
                if compression == "none" { 0 } else { 1 },
            )?;
            let messages = report["messages"].as_u64().unwrap_or(0);
            assert!(messages >= 200, "{compression}: {report}");
            if compression == "none" {
                assert_eq!(messages, KINDS, "{report}");
            }
        }
        let cut = bag(env, "cut.bag", &format!("--cut {}", size / 2))?;
        let report = convert(env, &cut, "cut", &[], 1)?;
        let messages = report["messages"].as_u64().unwrap_or(0);
        assert!((100..KINDS).contains(&messages), "{report}");
        assert_eq!(report["damage"]["count"], 1, "{report}");
        // No bag at all.
        let mut nothing = env.wrapyfi(["convert", "/bin/sh", "out.mcap"])?;
        nothing.exits_with(2)?;
        assert!(nothing.stderr().contains("it is no bag of ROS 1"), "{}", nothing.stderr());
        Ok(())
    })
}

/// A real ROS 2 lists what is in a folder and in a file of ours.
#[test]
fn ros2_bag_opens_what_was_converted() -> Result {
    let rmw = "rmw_fastrtps_cpp";
    let ros2 = [Need::Ros2, Need::Ros2Package(rmw), Need::Ros2Package("rosbag2_storage_mcap")];
    run("bags_ros2", &[NEEDS, &ros2].concat(), |env| {
        let bag = bag(env, "some.bag", "")?;
        let ros = RealRos2::new(env, rmw)?;
        for out in ["some", "some.mcap"] {
            convert(env, &bag, out, &[], 0)?;
            let path = env.path(out).display().to_string();
            let mut info = ros.ros2(&["bag", "info", &path])?;
            info.exits_with(0)?;
            let text = info.stdout();
            for words in ["Storage id:", "mcap", "323", "/tf_static", "demo_msgs/msg/OddType"] {
                assert!(text.contains(words), "{words}: {text}");
            }
        }
        Ok(())
    })
}
