//! The examples do what their texts say, with real Python Wrapyfi on the other side. Those that show
//! nothing but one scheme are in `communicator.rs`.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, RealRos2, Result, TestEnv, run, sha256, texts};

/// Needs of a test in which the Python twin of an example takes part.
macro_rules! needs {
    ($name:literal) => {
        &[Need::Program, Need::Python, Need::Example($name)]
    };
}

/// The language of a program.
#[derive(Clone, Copy, PartialEq, Eq)]
enum In {
    Rust,
    Python,
}

/// Starts the example, or its twin, whose options have underscores.
fn start(env: &TestEnv, language: In, name: &str, args: &str) -> Result<Process> {
    match language {
        In::Rust => env.example(name, args),
        In::Python => env.peer(&format!("{name}.py"), args),
    }
}

/// A plug-in of a crate outside the core, and its Python twin: poses there and mirrored poses back.
#[test]
fn poses_go_through_a_plugin_of_the_users_own() -> Result {
    run("poses", &[Need::Program, Need::PoseMirror, Need::Python], |env| {
        let (there, back) = (env.topic("poses"), env.topic("mirrored"));
        let _broker = env.broker()?;
        let mirror = env.pose_mirror(&there, &back)?;
        let script = env.poses(&there, &back)?;
        let heard = script.wait_until("three mirrored poses", |output| {
            let poses = output.out.iter().filter(|line| line.starts_with("Pose Pose("));
            let poses: Vec<_> = poses.cloned().collect();
            (poses.len() >= 3).then_some(poses)
        })?;
        for line in &heard {
            let step = line.split(['=', '.']).nth(1).unwrap_or_default();
            let double = step.parse::<u32>()? * 2;
            let y = if double == 0 { "-0.0".to_owned() } else { format!("-{double}.0") };
            let expected = format!("Pose Pose(x_m={step}.0, y_m={y}, heading_rad=-0.1)");
            assert_eq!(*line, expected);
        }
        mirror.wait_until("the pose in Rust", |output| {
            output.out.iter().any(|line| line.starts_with("Pose2D { x_m: ")).then_some(())
        })
    })
}

/// Waits for a line on stdout.
fn prints(process: &Process, line: &str) -> Result {
    process.wait_until(line, |output| output.out.iter().any(|one| one == line).then_some(()))
}

/// Types of folders, as structs that a build script wrote: real nodes of ROS 2 read them, and a service and an action go there
/// and back.
#[test]
fn structs_of_a_build_script_meet_ros_2() -> Result {
    const NEEDS: &[Need] = &[Need::Program, Need::Example("zones"), Need::Python, Need::Kilted];
    run("structs_of_a_build_script_meet_ros_2", NEEDS, |env| {
        let ros = RealRos2::kilted(env)?;
        let of_zones = "--topic /zones/keep_out --type geometry_msgs/msg/PolygonStamped";
        {
            let _zones = env.example("zones", "publish")?;
            let hears = ros.rclpy(&format!("subscribe {of_zones}"), None)?;
            let zone = hears.event("message")?["value"].clone();
            assert_eq!(zone["header"]["frame_id"], "map");
            assert_eq!(zone["polygon"]["points"][2], json!({"x": 2.0, "y": 2.0, "z": 0.0}));
        }
        let listens = env.example("zones", "listen")?;
        let zone = r#"{"header": {"frame_id": "hall"}, "polygon": {"points": [{"x": 0.5}]}}"#;
        let _publisher = ros.rclpy(&format!("publish {of_zones}"), Some(zone))?;
        prints(&listens, "hall Some(Point32 { x: 0.5, y: 0.0, z: 0.0 })")?;

        let serves = env.example("zones", "serve")?;
        prints(&env.example("zones", "call")?, "3 left: kitchen was empty")?;
        prints(&serves, "Clear_Request { kind: 1, zone: \"kitchen\" }")?;
        let _patrols = env.example("zones", "patrol")?;
        let sends = env.example("zones", "send")?;
        prints(&sends, "corner 3")?;
        prints(&sends, "succeeded: 8 m")
    })
}

/// Three programs go through one pipeline; each step is done by one of them, and all get the same.
fn mirrors(test: &str, mware: &str, [senses, thinks, watches]: [In; 3]) -> Result {
    run(test, needs!("mirroring"), |env| {
        let _broker = env.broker()?;
        let config = env.write("modes.yaml", "Pipeline: { sense: listen, think: listen }\n")?;
        let mware = |args: &str| format!("{args} --mware {mware}");
        let watcher = mware(&format!("--config {}", config.display()));
        let watcher = start(env, watches, "mirroring", &watcher)?;
        let thinker = start(env, thinks, "mirroring", &mware("--here think"))?;
        let senser = start(env, senses, "mirroring", &mware("--here sense"))?;
        let thought = |process: &Process| process.objects(3);
        for mirror in [&senser, &watcher] {
            let results = thought(mirror)?;
            for result in &results {
                let number = result["number"].as_u64();
                assert_eq!(result["square"].as_u64(), number.map(|number| number * number));
            }
            thinker.wait_until("what its mirror got", |output| {
                let own: Vec<_> = output.objects().collect();
                results.iter().all(|result| own.contains(result)).then_some(())
            })?;
        }
        Ok(())
    })
}

#[test]
fn a_pipeline_is_mirrored_between_rust_programs() -> Result {
    mirrors("a_pipeline_is_mirrored_between_rust_programs", "zeromq", [In::Rust; 3])
}

#[test]
fn a_pipeline_is_mirrored_over_ros2() -> Result {
    mirrors("a_pipeline_is_mirrored_over_ros2", "ros2", [In::Rust; 3])
}

#[test]
fn python_thinks_in_a_pipeline() -> Result {
    mirrors("python_thinks_in_a_pipeline", "zeromq", [In::Rust, In::Python, In::Rust])
}

#[test]
fn python_senses_and_watches_a_pipeline() -> Result {
    let languages = [In::Python, In::Rust, In::Python];
    mirrors("python_senses_and_watches_a_pipeline", "zeromq", languages)
}

/// A client is told what its arguments ask for.
fn asked(test: &str, mware: &str, server: In, client: In) -> Result {
    run(test, needs!("request_reply"), |env| {
        let _broker = env.broker()?;
        let server = start(env, server, "request_reply", &format!("--mode reply --mware {mware}"))?;
        let args = format!("--mode request --mware {mware} --scale 2 1 2 6");
        let mut client = start(env, client, "request_reply", &args)?;
        let told: Vec<Value> =
            client.messages(3)?.into_iter().map(|message| message["value"].clone()).collect();
        let expected = [(1, 2.0), (2, 3.0), (3, 6.0)];
        assert_eq!(told, expected.map(|(count, mean)| json!({ "count": count, "mean": mean })));
        client.exits_with(0)?;
        server.messages(3).map(drop)
    })
}

#[test]
fn rust_describes_for_python() -> Result {
    asked("rust_describes_for_python", "zeromq", In::Rust, In::Python)
}

#[test]
fn python_describes_for_rust() -> Result {
    asked("python_describes_for_rust", "zeromq", In::Python, In::Rust)
}

#[test]
fn rust_describes_for_rust_over_ros2() -> Result {
    asked("rust_describes_for_rust_over_ros2", "ros2", In::Rust, In::Rust)
}

/// A client asks for pictures, which differ by its arguments.
fn pictured(test: &str, mware: &str, server: In, client: In) -> Result {
    run(test, needs!("request_reply"), |env| {
        let _broker = env.broker()?;
        let args = format!("--picture --mware {mware}");
        let _server = start(env, server, "request_reply", &format!("--mode reply {args}"))?;
        let client = start(env, client, "request_reply", &format!("--mode request {args}"))?;
        for (number, message) in (1_u8..).zip(client.messages(3)?) {
            let expected: Vec<u8> = (0..24 * 32 * 3_u32)
                .map(|place| u8::try_from(place % 251).unwrap_or_default().wrapping_add(number))
                .collect();
            assert_eq!(message["value"]["shape"], json!([24, 32, 3]));
            assert_eq!(message["value"]["sha256"], sha256(&expected));
        }
        Ok(())
    })
}

#[test]
fn rust_draws_for_python() -> Result {
    pictured("rust_draws_for_python", "zeromq", In::Rust, In::Python)
}

#[test]
fn python_draws_for_rust() -> Result {
    pictured("python_draws_for_rust", "zeromq", In::Python, In::Rust)
}

#[test]
fn rust_draws_for_rust_over_ros2() -> Result {
    pictured("rust_draws_for_rust_over_ros2", "ros2", In::Rust, In::Rust)
}

/// Words of one program come back as the other's answer; both see the same answers.
fn both_ways(test: &str, mware: &str, transceives: In, reemits: In) -> Result {
    run(test, needs!("transceive_reemit"), |env| {
        let _broker = env.broker()?;
        let name = "transceive_reemit";
        let answerer = start(env, reemits, name, &format!("--mode reemit --mware {mware}"))?;
        let speaker = start(env, transceives, name, &format!("--mode transceive --mware {mware}"))?;
        let back: Vec<Value> =
            speaker.messages(3)?.into_iter().map(|message| message["note"].clone()).collect();
        for pair in back.windows(2) {
            let answers = pair.iter().map(|note| note["answers"].as_u64());
            assert!(answers.is_sorted(), "in the order in which they were said: {back:?}");
        }
        for note in &back {
            assert_eq!(note["by"], "reemit");
        }
        answerer.wait_until("the notes that came back", |output| {
            let said = output.events("message");
            back.iter().all(|note| said.iter().any(|own| own["note"] == *note)).then_some(())
        })
    })
}

#[test]
fn rust_answers_rust() -> Result {
    both_ways("rust_answers_rust", "zeromq", In::Rust, In::Rust)
}

#[test]
fn rust_answers_rust_over_ros2() -> Result {
    both_ways("rust_answers_rust_over_ros2", "ros2", In::Rust, In::Rust)
}

#[test]
fn python_answers_rust() -> Result {
    both_ways("python_answers_rust", "zeromq", In::Rust, In::Python)
}

#[test]
fn rust_answers_python() -> Result {
    both_ways("rust_answers_python", "zeromq", In::Python, In::Rust)
}

/// Chain of the first use case: each robot shows what the recogniser calls its own frames, and nothing of
/// the other's.
fn imitated(test: &str, pepper_mware: &str, [pepper, icub, recogniser]: [In; 3]) -> Result {
    run(test, needs!("facial_expression"), |env| {
        let _broker = env.broker()?;
        let scenes = env.scenes()?;
        let name = "facial_expression";
        let role = |language: In, role: &str, source: &str| {
            // Without ROS 2 in Python both robots are on ZeroMQ there.
            let option = if language == In::Rust { "pepper-mware" } else { "pepper_mware" };
            let source = match source {
                "" => String::new(),
                folder => format!("--source {}", scenes.folder.join(folder).display()),
            };
            let args = format!("--role {role} --{option} {pepper_mware} {source}");
            start(env, language, name, &args)
        };
        let recogniser = role(recogniser, "recogniser", "")?;
        let robots = [role(pepper, "pepper", "sad")?, role(icub, "icub", "happy")?];
        let expected = [
            ("pepper", "sadness", 140, json!([0, 0, 255])),
            ("icub", "happiness", 250, json!(":D")),
        ];
        for (robot, (name, expression, brightness, shows)) in robots.iter().zip(expected) {
            for message in robot.messages(3)? {
                assert_eq!(message["robot"], name);
                assert_eq!(message["shows"], shows);
                let seen = json!({
                    "expression": expression,
                    "brightness": brightness,
                    "recogniser": "stand-in: mean brightness",
                });
                assert_eq!(message["seen"], seen);
            }
        }
        recogniser.wait_until("both robots", |output| {
            let robots: BTreeSet<_> =
                texts(&output.events("message"), "robot").into_iter().collect();
            (robots.len() == 2).then_some(())
        })
    })
}

#[test]
fn expressions_are_imitated_on_two_middlewares() -> Result {
    imitated("expressions_are_imitated_on_two_middlewares", "ros2", [In::Rust; 3])
}

#[test]
fn expressions_of_a_python_robot_are_imitated() -> Result {
    let languages = [In::Rust, In::Python, In::Rust];
    imitated("expressions_of_a_python_robot_are_imitated", "ros2", languages)
}

#[test]
fn python_recognises_expressions() -> Result {
    let languages = [In::Rust, In::Rust, In::Python];
    imitated("python_recognises_expressions", "zeromq", languages)
}

/// The robot of the second use case follows the source it selects, and none else.
fn followed(test: &str, seen_mware: &str, sensors: In, robot: In, source: &str) -> Result {
    run(test, needs!("head_orientation"), |env| {
        let _broker = env.broker()?;
        let frames = env.scenes()?.folder.join("corner");
        let name = "head_orientation";
        let mware = |language| match language {
            In::Rust => format!("--seen-mware {seen_mware}"),
            In::Python => format!("--seen_mware {seen_mware}"),
        };
        let args = format!("--role sensors --frames {} {}", frames.display(), mware(sensors));
        let sensors = start(env, sensors, name, &args)?;
        let args = format!("--role robot --source {source} {}", mware(robot));
        let robot = start(env, robot, name, &args)?;
        let heard = robot.messages(3)?;
        for message in &heard {
            let (orientation, head) = (&message["orientation"], &message["head"]);
            assert_eq!(orientation["source"], source);
            let yaw = orientation["yaw_deg"].as_f64().map(|yaw| yaw.clamp(-50.0, 50.0));
            assert_eq!(head["neck_deg"][2].as_f64(), yaw, "{message}");
            if source == "seen" {
                // The bright corner is on the upper left.
                assert_eq!(head["neck_deg"], json!([30.0, 0.0, 50.0]));
                assert_eq!(head["eyes_deg"], json!([0.0, 0.0]));
            }
        }
        sensors.wait_until("what the robot heard", |output| {
            let sent = output.events("message");
            let has =
                |one: &Value| sent.iter().any(|sent| sent["orientation"] == one["orientation"]);
            heard.iter().all(has).then_some(())
        })
    })
}

#[test]
fn a_robot_follows_what_is_worn() -> Result {
    followed("a_robot_follows_what_is_worn", "ros2", In::Rust, In::Rust, "worn")
}

#[test]
fn a_robot_follows_what_is_seen_over_ros2() -> Result {
    followed("a_robot_follows_what_is_seen_over_ros2", "ros2", In::Rust, In::Rust, "seen")
}

#[test]
fn a_python_robot_follows_rust_sensors() -> Result {
    followed("a_python_robot_follows_rust_sensors", "zeromq", In::Rust, In::Python, "seen")
}

#[test]
fn a_rust_robot_follows_python_sensors() -> Result {
    followed("a_rust_robot_follows_python_sensors", "zeromq", In::Python, In::Rust, "seen")
}

#[test]
fn a_rust_robot_follows_a_python_eye_tracker() -> Result {
    followed("a_rust_robot_follows_a_python_eye_tracker", "zeromq", In::Python, In::Rust, "worn")
}
