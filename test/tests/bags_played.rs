//! Recordings that are played and recorded: what `wrapyfi play` publishes on each side is what was recorded, and what `wrapyfi record`
//! writes of it is the same again.

use serde_json::Value;
use wrapyfi_e2e::{Guide, Process, Result, TestEnv, run};

use super::bags::{NEEDS, bag, compared, convert};

/// Waits for a listener of each topic; a test without one fails by its own time.
const WAIT: &str = "600";

/// Plays what is at `path` once, from when there is a listener of each topic.
fn played(env: &TestEnv, path: &str, args: &str) -> Result<Process> {
    let path = env.path(path).display().to_string();
    let words = ["play", &path, "--wait", WAIT].into_iter();
    env.wrapyfi(words.chain(args.split_whitespace()))
}

/// Values of messages that `wrapyfi echo` hears.
fn heard(env: &TestEnv, args: &str) -> Result<Process> {
    env.wrapyfi(["echo", "--json"].into_iter().chain(args.split_whitespace()))
}

#[test]
fn what_is_played_is_recorded_again() -> Result {
    run("bags_recorded", NEEDS, |env| {
        let bag = bag(env, "some.bag", "")?;
        convert(env, &bag, "some", &[], 0)?;
        let again = env.path("again").display().to_string();
        let [camera, tf] = ["ros2:/camera/camera_info", "ros2:/tf"];
        let mut record = env.wrapyfi(["record", camera, tf, "--output", &again])?;
        let mut play = played(env, "some", "--topics /camera/camera_info,/tf")?;
        play.exits_with(0)?;
        assert!(play.stderr().contains("played 80 messages of 2 topics"), "{}", play.stderr());
        record.interrupt()?;
        record.exits_with(0)?;
        assert_eq!(compared(env, &bag, "again", "--played")?, 80);
        // What nobody publishes leaves no recording.
        let nothing = ["record", "ros2:/nothing", "--output", "none", "--seconds", "0.5"];
        let mut nothing = env.wrapyfi(nothing)?;
        nothing.exits_with(1)?;
        assert!(nothing.stderr().contains("no recording is left"), "{}", nothing.stderr());
        assert!(!env.path("none").exists());
        // A topic that the recording has not.
        let mut missing = played(env, "some", "--topics /nothing")?;
        missing.exits_with(2)?;
        assert!(missing.stderr().contains("has no topic /nothing"), "{}", missing.stderr());
        Ok(())
    })
}

#[test]
fn latched_topics_and_the_clock_are_there_for_those_who_come_late() -> Result {
    run("bags_latched", NEEDS, |env| {
        let bag = bag(env, "some.bag", "")?;
        convert(env, &bag, "some", &[], 0)?;
        let path = env.path("some").display().to_string();
        let play = env.wrapyfi(["play", &path, "--loop", "--clock", "50"])?.pillar();
        let text = heard(env, "ros2:/map_name --qos latched --count 1")?.objects(1)?.remove(0);
        assert!(text.to_string().contains("the first floor"), "{text}");
        let clock =
            heard(env, "ros2:/clock --type rosgraph_msgs/msg/Clock --count 3")?.objects(3)?;
        let seconds = |one: &Value| one["value"]["clock"]["sec"].as_i64().unwrap_or(0);
        assert!(clock.iter().all(|one| (1_700_000_000..1_700_000_005).contains(&seconds(one))));
        drop(play);
        Ok(())
    })
}

#[test]
fn a_bag_of_ros_1_is_played_on_every_side() -> Result {
    run("bags_sides", NEEDS, |env| {
        bag(env, "some.bag", "")?;
        let _roscore = env.roscore()?;
        let _broker = env.broker()?;
        let picture = "--type Image --count 3";
        let echo = heard(env, &format!("zeromq:/camera/image_raw {picture}"))?;
        played(env, "some.bag", "--to zeromq: --topics /camera/image_raw")?.exits_with(0)?;
        let on_zeromq = echo.objects(3)?;
        let echo = heard(env, &format!("ros:/again/camera/image_raw {picture}"))?;
        played(env, "some.bag", "--to ros:/again --topics /camera/image_raw --rate 4")?
            .exits_with(0)?;
        let on_ros1 = echo.objects(3)?;
        let digests =
            |all: &[Value]| all.iter().map(|one| one["sha256"].clone()).collect::<Vec<_>>();
        assert_eq!(digests(&on_zeromq), digests(&on_ros1));
        assert_eq!(on_ros1[0]["shape"], on_zeromq[0]["shape"], "{on_ros1:?}");
        Ok(())
    })
}

#[test]
fn the_guide() -> Result {
    run("bags_guide", NEEDS, |env| {
        let guide = Guide::read("docs/bags.md")?;
        bag(env, "robot.bag", "")?;
        let done = |command: &str| env.shell(command)?.exits_with(0);
        for line in guide.lines::<3>("wrapyfi convert")? {
            done(&line.command)?;
        }
        let [play, slow, scripts] = guide.lines("wrapyfi play")?;
        done(&play.command)?;
        let slow = env.shell(&slow.command)?;
        heard(env, "ros2:/clock --type rosgraph_msgs/msg/Clock --count 1")?.objects(1)?;
        drop(slow);
        let (_broker, _roscore) = (env.broker()?, env.roscore()?);
        let echo = heard(env, "zeromq:/camera/image_raw --type Image --count 1")?;
        let playing = env.shell(&format!("{} --loop", scripts.command))?;
        echo.objects(1)?;
        drop(playing);
        let [topics, _] = guide.lines("wrapyfi record")?;
        let mut record = env.shell(&topics.command)?;
        let value = r#"{"data": "a scan"}"#;
        let _scanner = env.rospy("publish --topic /scan --type std_msgs/String", Some(value))?;
        let session = env.path("session");
        record.wait_until("the topic", |output| {
            output.err.iter().any(|line| line.contains("records ros:/scan")).then_some(())
        })?;
        // The file has its first chunk when the recording ends.
        heard(env, "ros:/scan --count 2")?.objects(2)?;
        record.interrupt()?;
        record.exits_with(0)?;
        let metadata = std::fs::read_to_string(session.join("metadata.yaml"))?;
        assert!(metadata.contains("name: \"/scan\""), "{metadata}");
        guide.is_done()
    })
}
