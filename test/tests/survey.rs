//! The report of a graph of ROS 1, and the routes to start from: a graph of rospy nodes, and a bridge that takes them.

use wrapyfi_e2e::{Need, Process, Result, TestEnv, ros2, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1];

fn publisher(env: &TestEnv, args: &str, value: &str) -> Result<Process> {
    let process = env.rospy(&format!("publish {args}"), Some(value))?;
    process.event("ready")?;
    Ok(process)
}

#[test]
fn a_survey_tells_what_a_move_has_to_heed_and_a_bridge_takes_its_routes() -> Result {
    run("a_survey_tells_what_a_move_has_to_heed_and_a_bridge_takes_its_routes", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let folder = env.definitions(&[
            ("odd_msgs/msg/Odd.msg", "int32 number\n"),
            // The name of the type is what a server is known by.
            ("dynamic_reconfigure/srv/Reconfigure.srv", "int32 config\n---\nint32 config\n"),
        ])?;
        let scan = env.topic("scan");
        let part = env.topic("1st/odd");
        let map = env.topic("map");
        let _scan = publisher(
            env,
            &format!("--topic {scan} --type sensor_msgs/LaserScan --node scanner"),
            r#"{"ranges": [0.5, 2.5]}"#,
        )?;
        let odd = format!("--topic {part} --type odd_msgs/Odd --node odd --definitions {folder}");
        let _odd = publisher(env, &odd, r#"{"number": 7}"#)?;
        let _map = publisher(
            env,
            &format!("--topic {map} --type std_msgs/String --node mapper --latch --count 1"),
            r#"{"data": "here"}"#,
        )?;
        let (lamp, gain) = (env.topic("lamp"), env.topic("gain"));
        let lamps = env.rospy(&format!("serve --topic {lamp} --node lamps"), None)?;
        lamps.event("ready")?;
        let set = env.topic("arm/set_parameters");
        let args = format!(
            "serve --topic {set} --type dynamic_reconfigure/Reconfigure --node arm --definitions {folder}"
        );
        let arm = env.rospy(&args, Some("{}"))?;
        arm.event("ready")?;
        let gains = env.rospy(&format!("param --topic {gain} --node gains"), Some("2.5"))?;
        gains.event("ready")?;

        let mut survey = env.wrapyfi(["survey", "ros:", "--seconds", "1"])?;
        survey.exits_with(0)?;
        let report = std::fs::read_to_string(env.path("survey.md"))?;
        let line = |words: &[&str]| {
            let found = report.lines().any(|line| words.iter().all(|word| line.contains(word)));
            assert!(found, "no line with {words:?}:\n{report}");
        };
        line(&[&format!("topic `{part}` is no name of ROS 2: it is `")]);
        line(&["package `odd_msgs` is not on ROS 2 here (odd_msgs/msg/Odd)"]);
        line(&[
            &scan,
            "sensor_msgs/LaserScan → sensor_msgs/msg/LaserScan",
            "/scanner",
            "sensor_data",
        ]);
        line(&[&map, "/mapper", "yes", "transient_local"]);
        line(&[&lamp, "std_srvs/SetBool → std_srvs/srv/SetBool", "/lamps"]);
        line(&["| /mapper |"]);
        line(&[&format!("| {} | /arm |", env.topic("arm"))]);
        line(&["`wrapyfi check survey.yaml`"]);
        let decide = report.split("## Topics").next().unwrap_or_default();
        for quiet in ["get_loggers", "dynamic_reconfigure", "/rosout", "geometry_msgs"] {
            assert!(!decide.contains(quiet), "{quiet}: {decide}");
        }
        let rate = report.lines().find(|line| line.starts_with(&format!("| {scan} |")));
        let rate = rate.and_then(|line| line.split(" | ").nth(4)?.parse::<f64>().ok());
        assert!(rate.is_some_and(|rate| rate > 0.0), "{rate:?}:\n{report}");

        let mut again = env.wrapyfi(["survey", "ros:", "--seconds", "0"])?;
        again.exits_with(2)?;
        assert!(again.stderr().contains("survey.md is there already"), "{}", again.tail());
        env.wrapyfi(["check", "survey.yaml"])?.exits_with(0)?;
        let bridge = env.wrapyfi(["bridge", "--config", "survey.yaml"])?.pillar();
        let heard = |topic: &str| {
            let args = ["echo", &ros2(topic), "--count", "1", "--json", "--timeout", "100"];
            let mut echo = env.wrapyfi(args)?;
            echo.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
            Ok::<_, anyhow::Error>(echo.objects(1)?.remove(0))
        };
        assert_eq!(heard(&part.replace("/1st/", "/_1st/"))?["value"]["number"], 7);
        heard(&scan)?;
        let call = ["call", &ros2(&lamp), "--value", r#"{"data": true}"#, "--timeout", "100"];
        env.wrapyfi(call)?.exits_with(0)?;
        // A bridge that runs is none of the robot's nodes.
        let again = ["survey", "--output", "again.md", "--seconds", "0"];
        env.wrapyfi(again)?.exits_with(0)?;
        let again = std::fs::read_to_string(env.path("again.md"))?;
        assert!(again.contains(&scan) && !again.contains("/wrapyfi_"), "{again}");
        let routes = |name: &str| -> Result<String> {
            let text = std::fs::read_to_string(env.path(name))?;
            Ok(text.split_once("routes:").map(|(_, routes)| routes.to_owned()).unwrap_or_default())
        };
        assert_eq!(routes("again.yaml")?, routes("survey.yaml")?);
        Ok(())
    })
}

#[test]
fn a_survey_without_a_master_says_so() -> Result {
    run("a_survey_without_a_master_says_so", &[Need::Program], |env| {
        let mut survey = env.wrapyfi(["survey", "ros:"])?;
        survey.exits_with(3)?;
        assert!(survey.stderr().contains("no answer from"), "{}", survey.tail());
        assert!(!env.path("survey.md").exists());
        for wrong in
            [["survey", "ros2:"], ["survey", "--output=x.yaml"], ["survey", "--output=no/x.md"]]
        {
            env.wrapyfi(wrong)?.exits_with(2)?;
        }
        Ok(())
    })
}
