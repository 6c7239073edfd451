//! Types that nodes show, as an interface package of ROS 2: from rospy and actionlib to colcon with Debian's rosidl.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;
use wrapyfi_e2e::{Need, Result, Route, TestEnv, repository, ros1, ros2, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros1];
const PACKAGE: &str = "my_robot_msgs";

/// A package as ROS 1 allows it, with names that ROS 2 forbids.
const FILES: &[(&str, &str)] = &[
    (
        "my_robot_msgs/msg/armState.msg",
        "# Of the left arm.\n\nuint8 maxJoints=7 # with the hand\nstring WORD=up and # down\nHeader header\n\
         # in radians\nfloat64[] jointAngles\nPart[] parts\ntime made\n",
    ),
    ("my_robot_msgs/msg/Part.msg", "string name\nbyte[4] K\nuint8 KIND=3\n"),
    ("my_robot_msgs/srv/Measure.srv", "string what # a name\n---\nPart[] parts\nbool done\n"),
];

/// Folders of packages of ROS 1 that hold these files.
fn packages(env: &TestEnv, folder: &str, files: &[(&str, &str)]) -> Result<String> {
    for (file, text) in files {
        let path = env.path(folder).join(file);
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(path, text)?;
    }
    Ok(env.path(folder).display().to_string())
}

/// A publisher of the arm, that waits for a subscriber.
fn arm(env: &TestEnv, folder: &str, topic: &str, node: &str) -> Result<wrapyfi_e2e::Process> {
    let args = format!(
        "publish --topic {topic} --type {PACKAGE}/armState --node {node} --definitions {folder}"
    );
    let process = env.rospy(&args, Some(r#"{"jointAngles": [0.5]}"#))?;
    process.event("ready")?;
    Ok(process)
}

/// Hash of the type by the name of each endpoint of ROS 2.
fn hashes(env: &TestEnv, names: &[&str]) -> Result<BTreeMap<String, String>> {
    let mut list = env.shell(&format!(
        "until wrapyfi list ros2 --json > listed; {}; do :; done; cat listed",
        names
            .iter()
            .map(|name| format!("grep -q '\"{name}\"' listed"))
            .collect::<Vec<_>>()
            .join(" && ")
    ))?;
    list.exits_with(0)?;
    let listed = list.stdout();
    let listed: Vec<Value> =
        listed.lines().map(serde_json::from_str).collect::<serde_json::Result<_>>()?;
    let pair = |one: &Value| {
        let text = |key: &str| Some(one[key].as_str()?.to_owned());
        Some((text("name")?, text("type_hash")?))
    };
    Ok(listed.iter().filter_map(pair).collect())
}

/// Stand-ins for what ROS 2 has and Debian's rosidl lacks.
fn stand_ins(env: &TestEnv) -> Result {
    let cmake = "foreach(package rosidl_cmake rosidl_generator_c rosidl_generator_cpp)\n  \
                 find_package(${package} REQUIRED)\nendforeach()\n";
    std::fs::create_dir_all(env.path("cmake"))?;
    env.write("cmake/rosidl_default_generatorsConfig.cmake", cmake)?;
    let like = repository().join("test/debian_interfaces/std_msgs");
    let interfaces = repository().join("crates/wrapyfi_interfaces/interfaces");
    for (package, files, needed) in [
        ("unique_identifier_msgs", &["msg/UUID.msg"][..], "builtin_interfaces"),
        (
            "action_msgs",
            &[
                "msg/GoalInfo.msg",
                "msg/GoalStatus.msg",
                "msg/GoalStatusArray.msg",
                "srv/CancelGoal.srv",
            ],
            "unique_identifier_msgs",
        ),
    ] {
        let folder = env.path("stand_ins").join(package);
        for file in files {
            let to = folder.join(file);
            to.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            std::fs::copy(interfaces.join(package).join(file), to)?;
        }
        for file in ["package.xml", "CMakeLists.txt"] {
            let mut text = std::fs::read_to_string(like.join(file))?;
            text = text.replace("std_msgs", package).replace("msg/Header.msg", &files.join(" "));
            if package == "action_msgs" {
                text = text.replace(
                    "find_package(builtin_interfaces REQUIRED)",
                    &format!(
                        "find_package(builtin_interfaces REQUIRED)\nfind_package({needed} REQUIRED)"
                    ),
                );
                text = text.replace(
                    "DEPENDENCIES builtin_interfaces",
                    &format!("DEPENDENCIES builtin_interfaces {needed}"),
                );
                text = text.replace(
                    "<depend>builtin_interfaces</depend>",
                    &format!("<depend>builtin_interfaces</depend>\n  <depend>{needed}</depend>"),
                );
            }
            std::fs::write(folder.join(file), text)?;
        }
    }
    Ok(())
}

#[test]
fn types_of_rospy_nodes_become_a_package_that_colcon_builds() -> Result {
    let needs = [NEEDS, &[Need::Actionlib]].concat();
    run("types_of_rospy_nodes_become_a_package_that_colcon_builds", &needs, |env| {
        let folder = packages(env, "ros1", FILES)?;
        let _roscore = env.roscore()?;
        let [state, measure, action] = ["state", "measure", "count"].map(|name| env.topic(name));
        let _arm = arm(env, &folder, &state, "arm")?;
        let args = format!(
            "serve --topic {measure} --type {PACKAGE}/Measure --node meter --definitions {folder}"
        );
        let meter = env.rospy(&args, Some(r#"{"done": "=True"}"#))?;
        meter.event("ready")?;
        let args = format!("serve --action {action} --type {PACKAGE}/Count");
        let counter = env.rospy_actions(&args)?;
        counter.event("ready")?;
        // The master is the only one who knows that a server of an action is whole: by its five topics.
        env.shell("until wrapyfi action list ros | grep -q 'action server'; do :; done")?
            .exits_with(0)?;

        env.set_variable("ROS_PACKAGE_PATH", &folder);
        let mut export =
            env.wrapyfi(["export", "ros:", "--package", PACKAGE, "--output", "src"])?;
        export.exits_with(0)?;
        let said = export.stdout();
        for line in [
            "src/my_robot_msgs: 2 messages, 1 service, 1 action; depends on action_msgs, builtin_interfaces, std_msgs",
            "my_robot_msgs/msg/ArmState was my_robot_msgs/armState in ROS 1",
            "my_robot_msgs/msg/ArmState: field joint_angles was jointAngles in ROS 1",
            "my_robot_msgs/msg/ArmState: constant MAX_JOINTS was maxJoints in ROS 1",
            "my_robot_msgs/msg/ArmState: constant WORD of ROS 1 is a comment now: # begins a comment on ROS 2",
            "my_robot_msgs/msg/Part: field k was K in ROS 1",
        ] {
            assert!(said.lines().any(|one| one == line), "{line}\n{said}");
        }
        let read = |file: &str| std::fs::read_to_string(env.path("src").join(PACKAGE).join(file));
        let arm_state = "# Of the left arm.\n\n# with the hand\nuint8 MAX_JOINTS=7\n# string WORD=up and # down\n\
             std_msgs/Header header\n# in radians\nfloat64[] joint_angles\nPart[] parts\n\
             builtin_interfaces/Time made\n";
        assert_eq!(read("msg/ArmState.msg")?, arm_state);
        assert_eq!(
            read("srv/Measure.srv")?,
            "\n# a name\nstring what\n---\nPart[] parts\nbool done\n"
        );
        assert_eq!(
            read("action/Count.action")?,
            "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n"
        );
        // Nothing that is there is overwritten.
        let mut again = env.wrapyfi(["export", "ros:", "--package", PACKAGE, "--output", "src"])?;
        again.exits_with(2)?;
        assert!(again.stderr().contains("is there already"), "{}", again.tail());

        let installed = built(env)?;
        let hash_of_bridge = {
            let there = |name: &str| format!("{name}_there");
            let route = |name: &str| Route::untyped(&ros1(name), &ros2(&there(name)));
            let config = env
                .embedded()
                .route(route(&state).with("lazy", "false"))
                .route(Route::untyped_service(&ros1(&measure), &ros2(&there(&measure))))
                .route(Route::action(&ros1(&action), &ros2(&there(&action))));
            let _bridge = env.bridge(&config)?;
            let names = [&state, &measure, &action].map(|name| there(name));
            hashes(env, &names.each_ref().map(String::as_str))?
        };
        env.set_variable("ROS_PACKAGE_PATH", "");
        env.set_variable("AMENT_PREFIX_PATH", installed);
        let [here, asked, aim] = ["here", "asked", "aim"].map(|name| env.topic(name));
        let kind = |kind: &str, name: &str| format!("{PACKAGE}/{kind}/{name}");
        let (message, service) = (kind("msg", "ArmState"), kind("srv", "Measure"));
        let _pub = env.wrapyfi(["pub", &ros2(&here), "--type", &message, "--value", "{}"])?;
        let _serve = env.wrapyfi(["serve", &ros2(&asked), "--type", &service, "--value", "{}"])?;
        let _action = env.wrapyfi([
            "action",
            "serve",
            &ros2(&aim),
            "--type",
            &kind("action", "Count"),
            "--value",
            "{}",
        ])?;
        let of_package = hashes(env, &[&here, &asked, &aim])?;
        for (there, here) in [(&state, &here), (&measure, &asked), (&action, &aim)] {
            assert_eq!(
                hash_of_bridge[&format!("{there}_there")],
                of_package[here],
                "{there}: {hash_of_bridge:?} {of_package:?}"
            );
        }
        Ok(())
    })
}

/// Builds what was exported, as a workspace of ROS 2 does it, and returns where it is installed.
fn built(env: &TestEnv) -> Result<String> {
    stand_ins(env)?;
    let debian = repository().join("test/debian_interfaces");
    let place = |name: &str| debian.join(name).display().to_string();
    let line = format!(
        "env -u AMENT_PREFIX_PATH colcon build --base-paths src stand_ins/* {} {} --event-handlers console_direct+ \
         --cmake-args --no-warn-unused-cli -DPython3_EXECUTABLE=/usr/bin/python3 \
         -Drosidl_default_generators_DIR=$PWD/cmake -DCMAKE_BUILD_TYPE=Debug -DCMAKE_C_FLAGS_DEBUG=-O0",
        place("builtin_interfaces"),
        place("std_msgs"),
    );
    let mut build = env.shell(&line)?;
    build.exits_with(0)?;
    let installed = env.path("install").join(PACKAGE);
    for file in ["share/my_robot_msgs/msg/ArmState.msg", "share/my_robot_msgs/action/Count.action"]
    {
        assert!(Path::new(&installed).join(file).exists(), "{file}");
    }
    Ok(installed.display().to_string())
}

#[test]
fn two_definitions_of_one_type_are_named_with_both_nodes() -> Result {
    run("two_definitions_of_one_type_are_named_with_both_nodes", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let [file, part, _] = FILES else { panic!() };
        let older = (part.0, "string name\nbyte[2] K\nuint8 KIND=3\n");
        let new = packages(env, "new", &[*file, *part])?;
        let old = packages(env, "old", &[*file, older])?;
        let (left, right) = (env.topic("left"), env.topic("right"));
        let _nodes = [arm(env, &new, &left, "new_arm")?, arm(env, &old, &right, "old_arm")?];
        let args = ["export", "ros:", "--package", PACKAGE, "--output"];
        let mut refused = env.wrapyfi(args.into_iter().chain(["none"]))?;
        refused.exits_with(1)?;
        let said = refused.stderr();
        for words in [
            "my_robot_msgs/msg/Part has 2 definitions".to_owned(),
            format!("/new_arm ({left}) has `byte[4] k`"),
            format!("/old_arm ({right}) has `byte[2] k`"),
            "--from /".to_owned(),
        ] {
            assert!(said.contains(&words), "{words}: {said}");
        }
        assert!(!env.path("none").exists(), "nothing is written by half");
        for (node, size) in [("/new_arm", 4), ("/old_arm", 2)] {
            let output = format!("of{size}");
            let chosen = ["--from", node];
            let mut export = env.wrapyfi(args.into_iter().chain([&*output]).chain(chosen))?;
            export.exits_with(0)?;
            let text = env.path(&output).join(PACKAGE).join("msg/Part.msg");
            let text = std::fs::read_to_string(text)?;
            assert!(text.contains(&format!("byte[{size}] k\n")), "{text}");
        }
        Ok(())
    })
}

#[test]
fn what_nobody_shows_is_said() -> Result {
    run("what_nobody_shows_is_said", NEEDS, |env| {
        let _roscore = env.roscore()?;
        let folder = packages(env, "ros1", FILES)?;
        let (state, wanted) = (env.topic("state"), env.topic("wanted"));
        let _arm = arm(env, &folder, &state, "arm")?;
        let args = format!(
            "subscribe --topic {wanted} --type {PACKAGE}/Part --node ear --definitions {folder}"
        );
        let ear = env.rospy(&args, None)?;
        ear.event("ready")?;
        let mut none = env.wrapyfi(["export", "ros:", "--package", "other_msgs"])?;
        none.exits_with(2)?;
        let said = none.stderr();
        assert!(said.contains("no node on ros: shows a type of other_msgs"), "{said}");
        assert!(said.contains("my_robot_msgs"), "{said}");
        // The publisher's type has the subscriber's inside.
        env.wrapyfi(["export", "ros:", "--package", PACKAGE])?.exits_with(0)?;
        let args = format!(
            "serve --topic {} --type {PACKAGE}/Measure --node meter --definitions {folder}",
            env.topic("measure")
        );
        let meter = env.rospy(&args, Some(r#"{"done": "=True"}"#))?;
        meter.event("ready")?;
        let mut partly =
            env.wrapyfi(["export", "ros:", "--package", PACKAGE, "--output", "partly"])?;
        partly.exits_with(1)?;
        let said = partly.stdout();
        assert!(said.contains("not learned: my_robot_msgs/Measure of "), "{said}");
        assert!(env.path("partly").join(PACKAGE).join("msg/ArmState.msg").exists());
        env.wrapyfi(["export", "yarp:", "--package", "x"])?.exits_with(2)
    })
}
