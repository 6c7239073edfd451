//! The middleware of an installed ROS 2 where it cannot be used: a library that is not there or is none, security
//! without keys. Each ends with one clear line.

use wrapyfi_e2e::{Need, Process, RealRos2, Result, TestEnv, ros2, run};

const NEEDS: &[Need] = &[Need::Program, Need::Ros2, Need::Rmw];

/// A command that needs the graph, and ends with 2 and this in its words.
fn refused(env: &TestEnv, variables: &[(&str, &str)], words: &[&str]) -> Result {
    let ros = RealRos2::new(env, "rmw_fastrtps_cpp")?;
    for (name, value) in variables {
        env.set_variable(name, *value);
    }
    let mut echo = ros.wrapyfi(["echo", &ros2("/x"), "--type", "Text", "--timeout", "30"])?;
    echo.exits_with(2)?;
    let said = echo.stderr();
    for word in words {
        assert!(said.contains(word), "{word:?} in {said}");
    }
    one_line(&echo)
}

/// Beside what the middleware itself says, which is not ours.
fn one_line(process: &Process) -> Result {
    let said = process.stderr();
    assert_eq!(said.lines().filter(|line| line.starts_with("wrapyfi: ")).count(), 1, "{said}");
    Ok(())
}

#[test]
fn a_middleware_that_is_not_installed_is_named() -> Result {
    run("a_middleware_that_is_not_installed_is_named", NEEDS, |env| {
        let words = ["rmw_nowhere_cpp", "install the one that RMW_IMPLEMENTATION names"];
        refused(env, &[("RMW_IMPLEMENTATION", "rmw_nowhere_cpp")], &words)
    })
}

/// Lines that a middleware logs stand in our log, as in that of every node.
#[test]
fn what_the_middleware_logs_is_in_our_log() -> Result {
    run("what_the_middleware_logs_is_in_our_log", NEEDS, |env| {
        let ros = RealRos2::new(env, "rmw_fastrtps_cpp")?;
        env.set_variable("RMW_FASTRTPS_PUBLICATION_MODE", "bogus");
        let mut list = ros.wrapyfi(["list", "ros2"])?;
        list.exit_code()?;
        let (log, said) = (list.stderr(), "[WARN] [");
        let line = log.lines().find(|line| line.contains("RMW_FASTRTPS_PUBLICATION_MODE"));
        let is_ours = |line: &str| line.starts_with(said) && line.contains("logger=rmw_fastrtps");
        assert!(line.is_some_and(is_ours), "{log}");
        Ok(())
    })
}

/// It loads, and has not the functions that this program calls.
#[test]
fn a_library_of_another_interface_is_named() -> Result {
    run("a_library_of_another_interface_is_named", NEEDS, |env| {
        RealRos2::new(env, "rmw_fastrtps_cpp")?.copy("librmw.so", "librmw_other_cpp.so")?;
        let words = ["rmw_other_cpp", "rmw_get_implementation_identifier"];
        refused(env, &[("RMW_IMPLEMENTATION", "rmw_other_cpp")], &words)
    })
}

/// A program of one distribution where another one is sourced: structs would have other fields.
#[test]
fn another_distribution_is_named() -> Result {
    run("another_distribution_is_named", NEEDS, |env| {
        RealRos2::new(env, "rmw_fastrtps_cpp")?.copy("librmw.so", "librmw.so")?;
        let package = env.path("share/rmw");
        std::fs::create_dir_all(&package)?;
        std::fs::write(package.join("package.xml"), "<version>99.0.0</version>")?;
        let words = ["built with rmw", "has rmw 99.0.0", "source the ROS 2 that it was built with"];
        refused(env, &[], &words)
    })
}

/// As nodes of rclcpp do.
#[test]
fn security_that_is_enforced_without_keys_is_refused() -> Result {
    run("security_that_is_enforced_without_keys_is_refused", NEEDS, |env| {
        let nowhere = env.path("nowhere").display().to_string();
        let variables = [
            ("ROS_SECURITY_ENABLE", "true"),
            ("ROS_SECURITY_STRATEGY", "Enforce"),
            ("ROS_SECURITY_KEYSTORE", &nowhere),
        ];
        refused(env, &variables, &["ROS_SECURITY_ENABLE"])
    })
}

/// Keys as `ros2 security` makes them: who has them talks, who has none hears nothing.
fn keys_are_used(env: &TestEnv, rmw: &'static str) -> Result {
    let ros = RealRos2::new(env, rmw)?;
    let keys = env.path("keys").display().to_string();
    for args in [vec!["create_keystore", &keys], vec!["create_enclave", &keys, "/lab"]] {
        ros.ros2(&[&["security"], &args[..]].concat())?.exits_with(0)?;
    }
    for (name, value) in [
        ("ROS_SECURITY_ENABLE", "true"),
        ("ROS_SECURITY_STRATEGY", "Enforce"),
        ("ROS_SECURITY_KEYSTORE", &keys),
        ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/lab"),
    ] {
        env.set_variable(name, value);
    }
    let topic = env.topic("secret");
    let (endpoint, kind) = (ros2(&topic), "std_msgs/msg/String");
    let publish = ["pub", &endpoint, "--type", kind, "--value", r#"{"data": "x"}"#];
    let publisher = ros.wrapyfi([&publish[..], &["--rate", "10"]].concat())?;
    let mut echo = ros.ros2(&["topic", "echo", "--once", &topic, kind])?;
    echo.exits_with(0).map_err(|error| error.context(publisher.tail()))?;
    assert!(echo.stdout().starts_with("data: "), "{}", echo.stdout());
    env.set_variable("ROS_SECURITY_ENABLE", "false");
    let mut deaf =
        ros.wrapyfi(["echo", &endpoint, "--type", kind, "--count", "1", "--timeout", "5"])?;
    deaf.exits_with(3)
}

#[test]
fn keys_are_used_by_fast_dds() -> Result {
    let needs = [NEEDS, &[Need::Ros2Package("sros2"), Need::Ros2Package("rmw_fastrtps_cpp")]];
    run("keys_are_used_by_fast_dds", &needs.concat(), |env| keys_are_used(env, "rmw_fastrtps_cpp"))
}

#[test]
fn keys_are_used_by_cyclone() -> Result {
    let needs = [NEEDS, &[Need::Ros2Package("sros2"), Need::Ros2Package("rmw_cyclonedds_cpp")]];
    run("keys_are_used_by_cyclone", &needs.concat(), |env| keys_are_used(env, "rmw_cyclonedds_cpp"))
}

/// Its settings name an interface that this machine does not have: the library loads, and its participant cannot be.
#[test]
fn a_middleware_that_cannot_start_says_why() -> Result {
    run("a_middleware_that_cannot_start_says_why", NEEDS, |env| {
        let interface = r#"<NetworkInterface name="nowhere0"/>"#;
        let settings = format!(
            "<CycloneDDS><Domain><General><Interfaces>{interface}</Interfaces></General></Domain></CycloneDDS>"
        );
        let variables = [
            ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp"),
            ("WRAPYFI_ROS2_GRAPH", "rmw"),
            ("CYCLONEDDS_URI", &settings),
        ];
        refused(env, &variables, &["rmw_cyclonedds_cpp"])
    })
}
