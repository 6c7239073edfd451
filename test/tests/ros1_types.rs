//! Types that were not known when wrapyfi was built, through bridges: made up by the test itself, with
//! names of the moment. rospy makes its classes on the spot, the bridge learns them from the
//! connection.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher as _, Hasher as _};

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, Route, ServiceMapping, TestEnv, ros1, ros2, run, sha256};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1];
const SET: (&str, &str) =
    ("std_srvs/srv/SetBool.srv", "bool data\n---\nbool success\nstring message\n");
const ADD: (&str, &str) =
    ("example_interfaces/srv/AddTwoInts.srv", "int64 a\nint64 b\n---\nint64 sum\n");

/// A number that no other run has.
fn random() -> u64 {
    RandomState::new().build_hasher().finish()
}

/// A package with two messages and a service, its fields in an order of the moment.
struct Package {
    name: String,
    /// Definitions as ROS 1 has them, and as ROS 2 has them.
    ros1: [(String, String); 3],
    ros2: [(String, String); 3],
    /// All fields of the larger message; every number is one that 32-bit floats have, too.
    value: Value,
}

impl Package {
    fn new() -> Self {
        let seed = random();
        let name = format!("pkg_{seed:x}");
        let mut fields = [
            "bool flag",
            "int8 a",
            "uint8 b",
            "int16 c",
            "uint16 d",
            "int32 e",
            "uint32 f",
            "int64 g",
            "uint64 h",
            "float32 i",
            "float64 j",
            "string text",
            "time stamp",
            "duration pause",
            "uint8[] blob",
            "float64[3] triple",
            "string[] words",
            "int16[] list",
            "Part part",
            "Part[] parts",
            "Part[2] pair",
            "Header header",
        ];
        // Fisher and Yates, with what the seed gives.
        let mut state = seed;
        for at in (1..fields.len()).rev() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let other = usize::try_from(state >> 33).unwrap_or(0) % (at + 1);
            fields.swap(at, other);
        }
        let part = "string name\nfloat32[] values\nuint8 KIND=3\n".to_owned();
        let whole = fields.join("\n") + "\nint32 LIMIT=-5\nstring WORD=made # up\n";
        let service = "Part part\nint64 times\n---\nPart[] parts\n".to_owned();
        let in_ros2 = |text: &str| {
            let text = format!("\n{text}").replace("\nHeader ", "\nstd_msgs/Header ");
            let text = text.replace("\ntime ", "\nbuiltin_interfaces/Time ");
            let text = text.replace("\nduration ", "\nbuiltin_interfaces/Duration ");
            text.replace("string WORD=made # up", "string WORD=\"made # up\"")
        };
        let path = |file: &str| format!("{name}/{file}");
        let files = ["msg/Part.msg", "msg/Whole.msg", "srv/Repeat.srv"].map(path);
        let texts = [part, whole, service];
        let ros2 = std::array::from_fn(|at| (files[at].clone(), in_ros2(&texts[at])));
        let ros1 = std::array::from_fn(|at| (files[at].clone(), texts[at].clone()));
        let one = |name: &str| json!({"name": name, "values": [0.5, -1.25]});
        let value = json!({
            "flag": true, "a": -7, "b": 200, "c": -30000, "d": 60000, "e": -2_000_000_000,
            "f": 4_000_000_000_u32, "g": -9_000_000_000_000_i64, "h": 9_000_000_000_000_u64,
            "i": 0.75, "j": 0.1, "text": "gr\u{fc}n", "stamp": {"secs": 12, "nsecs": 34},
            "pause": {"secs": -3, "nsecs": 5}, "triple": [1.5, 2.5, 3.5], "words": ["x", "", "z"],
            "list": [1, -2, 3], "part": one("p"), "parts": [one("q"), one("r")],
            "pair": [one("s"), one("t")],
            "header": {"seq": 0, "stamp": {"secs": 7, "nsecs": 8}, "frame_id": "base"},
        });
        Self { name, ros1, ros2, value }
    }

    /// Writes what rospy is to read, away from where a bridge looks.
    fn for_rospy(&self, env: &TestEnv) -> Result<String> {
        for (file, text) in &self.ros1 {
            let path = env.path("ros1").join(file);
            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            std::fs::write(path, text)?;
        }
        Ok(env.path("ros1").display().to_string())
    }

    /// Writes what a bridge is to read that meets the types on ROS 2 only.
    fn for_ros2(&self, env: &TestEnv) -> Result<String> {
        let files = self.ros2.each_ref().map(|(file, text)| (file.as_str(), text.as_str()));
        env.definitions(&files)
    }
}

/// A message without the number that each publisher gives its headers.
fn unnumbered(mut message: Value) -> Value {
    if let Some(header) = message["header"].as_object_mut() {
        header.remove("seq");
    }
    message
}

/// ROS 1 to ROS 2 by what the publisher shows, and back to ROS 1 for a node that insists on its
/// checksum.
#[test]
fn a_type_made_a_moment_ago_crosses_ros_2_and_comes_back() -> Result {
    run("a_type_made_a_moment_ago_crosses_ros_2_and_comes_back", NEEDS, |env| {
        let package = Package::new();
        let (folder, _) = (package.for_rospy(env)?, package.for_ros2(env)?);
        let _roscore = env.roscore()?;
        let [from, middle, to] = ["from", "middle", "to"].map(|name| env.topic(name));
        let kind = format!("{}/msg/Whole", package.name);
        // This one has no definition but the publisher's.
        let there = env.embedded().route(Route::new(&ros1(&from), &ros2(&middle), &kind));
        let again = env.foreign().with("definitions", "[interfaces]");
        let again = again.route(Route::new(&ros2(&middle), &ros1(&to), &kind));
        let again = env.bridge_named("again.yaml", &again)?;

        let rospy = |role: &str, topic: &str, value: Option<&str>| {
            let kind = format!("{}/Whole", package.name);
            let args = format!(
                "{role} --topic {topic} --type {kind} --node {role}_node --definitions {folder}"
            );
            env.rospy(&args, value)
        };
        let ear = rospy("subscribe", &to, None)?;
        let mut value = package.value.clone();
        value["blob"] = json!([1, 2, 253]);
        let talker = rospy("publish", &from, Some(&value.to_string()))?;
        talker.event("ready")?;
        let there = env.bridge_named("there.yaml", &there)?;
        let heard = ear.messages(3).map_err(|error| {
            error.context(format!("{}\n{}\n{}", there.tail(), again.tail(), talker.tail()))
        })?;
        let mut sent = talker.messages(1)?.remove(0);
        // The received blob is bytes.
        sent["value"]["blob"] = json!({"sha256": sha256(&[1, 2, 253]), "size": 3});
        for one in heard {
            assert_eq!(unnumbered(one["value"].clone()), unnumbered(sent["value"].clone()));
        }
        Ok(())
    })
}

#[test]
fn a_type_that_nobody_shows_is_refused_with_the_remedy() -> Result {
    run("a_type_that_nobody_shows_is_refused_with_the_remedy", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (from, kind) = (env.topic("from"), format!("pkg_{:x}/msg/Whole", random()));
        let config = env.embedded().route(Route::new(&ros1(&from), &ros2(&from), &kind));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        let mut bridge = env.wrapyfi(["bridge", "--config", &file])?;
        bridge.exits_with(2)?;
        let said = bridge.stderr();
        for words in [
            "nobody publishes it; start the publisher first, or give a folder with the definition",
            &format!("{kind} is defined nowhere"),
        ] {
            assert!(said.contains(words), "{words}: {said}");
        }
        Ok(())
    })
}

/// A service route, with the definitions at hand.
fn joined(env: &TestEnv, service: &str, offered: &str, kind: &str) -> Result<Process> {
    env.definitions(&[SET, ADD])?;
    let route = Route::service(service, offered, kind);
    env.bridge(&env.embedded().with("definitions", "[interfaces]").route(route))
}

#[test]
fn a_service_of_ros_1_is_called_from_ros_2() -> Result {
    run("a_service_of_ros_1_is_called_from_ros_2", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let bridge = joined(env, &ros1(&there), &ros2(&here), "std_srvs/srv/SetBool")?;
        let _server = env.rospy(&format!("serve --topic {there}"), None)?;
        let (folder, endpoint) = (env.definitions(&[SET])?, ros2(&here));
        for (asked, answer) in [
            (r#"{"data": true}"#, json!({"success": true, "message": "so be it"})),
            (r#"{"data": false}"#, json!({"success": false, "message": "no"})),
        ] {
            let kind = ["--type", "std_srvs/srv/SetBool", "--definitions", &folder];
            let args = ["call", &endpoint, "--value", asked, "--json", "--timeout", "60"];
            let mut call = env.wrapyfi(args.into_iter().chain(kind))?;
            call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
            assert_eq!(call.objects(1)?[0]["value"], answer);
        }
        Ok(())
    })
}

#[test]
fn a_service_of_ros_2_is_called_from_ros_1() -> Result {
    run("a_service_of_ros_2_is_called_from_ros_1", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let bridge = joined(env, &ros2(&there), &ros1(&here), "std_srvs/srv/SetBool")?;
        let (folder, endpoint) = (env.definitions(&[SET])?, ros2(&there));
        let answer = r#"{"success": true, "message": "from ROS 2"}"#;
        let args = ["serve", &endpoint, "--type", "std_srvs/srv/SetBool", "--value", answer];
        let server = env.wrapyfi(args.into_iter().chain(["--definitions", &folder, "--json"]))?;
        let client = env.rospy(
            &format!("call --topic {here} --type std_srvs/SetBool --count 3"),
            Some(r#"{"data": true}"#),
        )?;
        client.event("done").map_err(|error| error.context(bridge.tail()))?;
        for reply in client.wait_until("the replies", |output| Some(output.events("reply")))? {
            let expected = json!({"success": true, "message": "from ROS 2"});
            assert_eq!(reply["value"], expected, "{reply}");
        }
        assert_eq!(server.objects(3)?[2]["value"]["data"], true);
        Ok(())
    })
}

/// Both ways at once with an independent node of ROS 2.
#[test]
fn sums_are_made_on_the_other_side() -> Result {
    run("sums_are_made_on_the_other_side", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let [there, here, back, front] = ["a", "b", "c", "d"].map(|name| env.topic(name));
        let folder = env.definitions(&[ADD])?;
        let kind = "example_interfaces/srv/AddTwoInts";
        let config = env.embedded().with("definitions", "[interfaces]");
        let config = config.route(Route::service(&ros1(&there), &ros2(&here), kind));
        let config = config.route(Route::service(&ros2(&back), &ros1(&front), kind));
        let bridge = env.bridge(&config)?;
        let of = |role: &str, topic: &str, value: &str| {
            let args = format!(
                "{role} --topic {topic} --type example_interfaces/AddTwoInts --node {role}_node \
                 --count 2 --definitions {folder}"
            );
            env.rospy(&args, Some(value))
        };
        let _server = of("serve", &there, r#"{"sum": "=request.a + request.b"}"#)?;
        let mut node = env.ros_node("sums")?;
        let asker = node.ask_for_sums(&here, ServiceMapping::Cyclone)?;
        assert_eq!(asker.first(40, 2).map_err(|error| error.context(bridge.tail()))?, 42);
        assert_eq!(asker.next(-1, i64::MAX)?, i64::MAX - 1);

        let _adder = node.serve_sums(&back, ServiceMapping::Cyclone)?;
        let client = of("call", &front, r#"{"a": 3, "b": -5}"#)?;
        client.event("done").map_err(|error| error.context(bridge.tail()))?;
        let replies = client.wait_until("the replies", |output| Some(output.events("reply")))?;
        assert_eq!(replies.last().map(|reply| reply["value"].clone()), Some(json!({"sum": -2})));
        Ok(())
    })
}

/// A service with messages inside, made up a moment ago, from ROS 2 to a server on ROS 1.
#[test]
fn a_service_made_a_moment_ago_crosses() -> Result {
    run("a_service_made_a_moment_ago_crosses", NEEDS, |env| {
        let package = Package::new();
        let (rospy, folder) = (package.for_rospy(env)?, package.for_ros2(env)?);
        let _roscore = env.roscore()?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let kind = format!("{}/srv/Repeat", package.name);
        let bridge = joined(env, &ros1(&there), &ros2(&here), &kind)?;
        let args =
            format!("serve --topic {there} --type {}/Repeat --definitions {rospy}", package.name);
        let server = env.rospy(&args, Some(r#"{"parts": "=[request.part] * request.times"}"#))?;
        let endpoint = ros2(&here);
        let asked = r#"{"part": {"name": "p", "values": [0.5]}, "times": 2}"#;
        let args = ["call", &endpoint, "--type", &kind, "--value", asked, "--json"];
        let mut call =
            env.wrapyfi(args.into_iter().chain(["--definitions", &folder, "--timeout", "60"]))?;
        call.exits_with(0).map_err(|error| error.context(bridge.tail()).context(server.tail()))?;
        let part = json!({"name": "p", "values": [0.5]});
        assert_eq!(call.objects(1)?[0]["value"], json!({"parts": [part, part]}));
        Ok(())
    })
}

/// Two routes took turns: each ended the other, and messages of both were lost.
#[test]
fn topics_of_two_versions_of_a_type_are_carried_side_by_side() -> Result {
    run("topics_of_two_versions_of_a_type_are_carried_side_by_side", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let versions = [
            ("older", "int32 code\n", json!({"code": 1})),
            ("newer", "int32 code\nstring text\n", json!({"code": 2, "text": "two"})),
        ];
        let mut routes = "routes:\n".to_owned();
        let mut nodes = Vec::new();
        for (name, definition, value) in &versions {
            let (folder, topic) = (env.path(name), env.topic(name));
            std::fs::create_dir_all(folder.join("acme_msgs/msg"))?;
            std::fs::write(folder.join("acme_msgs/msg/Status.msg"), definition)?;
            let args = format!(
                "publish --topic {topic} --type acme_msgs/Status --node {name} --definitions {}",
                folder.display()
            );
            let node = env.rospy(&args, Some(&value.to_string()))?;
            node.event("ready")?;
            nodes.push(node);
            routes += &format!("  - {{ from: 'ros:{topic}', to: 'ros2:{topic}' }}\n");
        }
        env.write("bridge.yaml", routes)?;
        let bridge = env.wrapyfi(["bridge", "--config", "bridge.yaml"])?.pillar();
        let echo = |name: &str| {
            let topic = ros2(&env.topic(name));
            env.wrapyfi(["echo", &topic, "--count", "30", "--json", "--timeout", "100"])
        };
        let echoes = [echo("older")?, echo("newer")?];
        for (echo, (_, _, value)) in echoes.into_iter().zip(&versions) {
            let heard = echo.objects(30).map_err(|error| error.context(bridge.tail()))?;
            assert!(heard.iter().all(|one| one["value"] == *value), "{heard:?}");
        }
        let said = bridge.stderr();
        assert!(!said.contains("another definition"), "{said}");
        Ok(())
    })
}

/// Writes definitions into a folder, which nodes of rospy read.
fn folder_of(env: &TestEnv, name: &str, files: &[(&str, &str)]) -> Result<String> {
    let folder = env.path(name);
    for (file, text) in files {
        let path = folder.join(file);
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(path, text)?;
    }
    Ok(folder.display().to_string())
}

/// On the way back it had the name of ROS 2, and a checksum of its fields there, which no node of ROS 1 takes.
#[test]
fn a_type_whose_name_ros_2_forbids_comes_back_under_its_own() -> Result {
    run("a_type_whose_name_ros_2_forbids_comes_back_under_its_own", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let [from, to] = ["from", "to"].map(|name| env.topic(name));
        let files = [
            ("My_msgs/msg/foo_msg.msg", "int32 frameId\nfoo_part part\n"),
            ("My_msgs/msg/foo_part.msg", "float64[2] K\n"),
        ];
        let folder = folder_of(env, "ros1", &files)?;
        let rospy = |role: &str, topic: &str, value: Option<&str>| {
            let args = format!(
                "{role} --topic {topic} --type My_msgs/foo_msg --node {role}_node --definitions {folder}"
            );
            env.rospy(&args, value)
        };
        let ear = rospy("subscribe", &to, None)?;
        let talker = rospy("publish", &from, Some(r#"{"frameId": 5, "part": {"K": [0.5, 2]}}"#))?;
        talker.event("ready")?;
        let config = env.embedded().route(Route::untyped(&ros1(&from), &ros2(&from)));
        let bridge = env.bridge(&config.route(Route::untyped(&ros2(&to), &ros1(&to))))?;
        let value = json!({"frame_id": 5, "part": {"k": [0.5, 2.0]}});
        let echo =
            env.wrapyfi(["echo", &ros2(&from), "--count", "1", "--json", "--timeout", "100"])?;
        let heard = echo.objects(1).map_err(|error| error.context(bridge.tail()))?.remove(0);
        assert_eq!((&heard["type"], &heard["value"]), (&json!("my_msgs/msg/FooMsg"), &value));

        let files = [
            ("my_msgs/msg/FooMsg.msg", "int32 frame_id\nFooPart part\n"),
            ("my_msgs/msg/FooPart.msg", "float64[2] k\n"),
        ];
        let (folder, back, value) = (env.definitions(&files)?, ros2(&to), value.to_string());
        let args = ["pub", &back, "--type", "my_msgs/msg/FooMsg", "--definitions", &folder];
        let more = ["--value", &value, "--rate", "20", "--count", "100000"];
        let publisher = env.wrapyfi(args.into_iter().chain(more))?;
        let heard = ear
            .messages(3)
            .map_err(|error| error.context(format!("{}\n{}", bridge.tail(), publisher.tail())))?;
        assert_eq!(heard[2]["value"], json!({"frameId": 5, "part": {"K": [0.5, 2.0]}}));
        Ok(())
    })
}

/// Servers tell the checksum of their service alone: both were called by the definition that was shown last.
#[test]
fn servers_of_two_versions_of_a_type_are_called_side_by_side() -> Result {
    run("servers_of_two_versions_of_a_type_are_called_side_by_side", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let ask = ("acme_msgs/srv/Ask.srv", "int32 code\n---\nStatus status\n");
        let versions = [
            ("older", "int32 code\n", json!({"code": 1})),
            ("newer", "int32 code\nstring text\n", json!({"code": 2, "text": "two"})),
        ];
        let mut config = env.embedded();
        let mut nodes = Vec::new();
        let mut folders = Vec::new();
        for (name, definition, value) in &versions {
            let status = ("acme_msgs/msg/Status.msg", *definition);
            let folder = folder_of(env, name, &[ask, status])?;
            let (topic, there) = (env.topic(name), env.topic(&format!("{name}_there")));
            let of = |role: &str, topic: &str, kind: &str| {
                format!(
                    "{role} --topic {topic} --type acme_msgs/{kind} --node {name}_{role} --definitions {folder}"
                )
            };
            nodes.push(env.rospy(&of("publish", &topic, "Status"), Some(&value.to_string()))?);
            let answer = json!({ "status": value }).to_string();
            nodes.push(env.rospy(&of("serve", &there, "Ask"), Some(&answer))?);
            let here = ros1(&env.topic(&format!("{name}_here")));
            config = config.route(Route::untyped(&ros1(&topic), &ros2(&topic)));
            config = config.route(Route::untyped_service(&ros1(&there), &here));
            folders.push(folder);
        }
        for node in &nodes {
            node.event("ready")?;
        }
        // The types inside it are those that publishers show.
        env.set_variable("ROS_PACKAGE_PATH", folder_of(env, "services", &[ask])?);
        let bridge = env.bridge(&config)?;
        env.set_variable("ROS_PACKAGE_PATH", "");
        for ((name, _, value), folder) in versions.iter().zip(&folders) {
            let args = format!(
                "call --topic {} --type acme_msgs/Ask --node {name}_call --count 2 --definitions {folder}",
                env.topic(&format!("{name}_here"))
            );
            let client = env.rospy(&args, Some(r#"{"code": 7}"#))?;
            client.event("done").map_err(|error| error.context(bridge.tail()))?;
            let replies = client.wait_until("replies", |output| Some(output.events("reply")))?;
            assert_eq!(
                replies[1]["value"],
                json!({ "status": value }),
                "{name}: {}",
                bridge.tail()
            );
        }
        Ok(())
    })
}
