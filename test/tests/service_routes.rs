//! Services that are offered on another middleware than their server's.

use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, until_route};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const ADD: (&str, &str) =
    ("example_interfaces/srv/AddTwoInts.srv", "int64 a\nint64 b\n---\nint64 sum\n");

/// A bridge of one service, with a broker of requests at this test's ports.
fn bridge(env: &TestEnv, service: &str, offered: &str, kind: &str) -> Result<Process> {
    env.definitions(&[ADD])?;
    let route = Route::service(service, offered, kind);
    env.bridge(&env.embedded().with("definitions", "[interfaces]").requests(env).route(route))
}

#[test]
fn a_function_of_python_is_a_ros_service() -> Result {
    run("a_function_of_python_is_a_ros_service", NEEDS, |env| {
        let name = env.topic("add");
        let bridge = bridge(env, "zeromq:/add", &ros2(&name), "NativeObject")?;
        let _server = env.wrapyfi_server("--no-broker")?;
        let endpoint = ros2(&name);
        let mut call = env.wrapyfi([
            "call",
            &endpoint,
            "--type",
            "NativeObject",
            "--args",
            "[3]",
            "--json",
            "--timeout",
            "30",
        ])?;
        call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        assert!(call.stdout().contains("hello"), "{}", call.tail());
        Ok(())
    })
}

#[test]
fn a_ros_service_of_any_type_is_called_from_zeromq() -> Result {
    run("a_ros_service_of_any_type_is_called_from_zeromq", NEEDS, |env| {
        let name = env.topic("add");
        let kind = "example_interfaces/srv/AddTwoInts";
        let bridge = bridge(env, &ros2(&name), "zeromq:/add", kind)?;
        let folder = env.definitions(&[ADD])?;
        let endpoint = ros2(&name);
        let _server = env.wrapyfi([
            "serve",
            &endpoint,
            "--type",
            kind,
            "--definitions",
            &folder,
            "--value",
            r#"{"sum": 42}"#,
            "--json",
        ])?;
        let ports = [env.rep_port().to_string(), env.req_port().to_string()];
        let mut call = env.wrapyfi([
            "call",
            "zeromq:/add",
            "--rep-port",
            &ports[0],
            "--req-port",
            &ports[1],
            "--args",
            "[40, 2]",
            "--json",
            "--timeout",
            "30",
        ])?;
        call.exits_with(0).map_err(|error| error.context(bridge.tail()))?;
        assert!(call.stdout().contains("42"), "{}", call.tail());
        Ok(())
    })
}

#[test]
fn a_service_route_is_checked_and_printed() -> Result {
    run("a_service_route_is_checked_and_printed", NEEDS, |env| {
        env.definitions(&[ADD])?;
        let check = |route: Route| -> Result<Process> {
            let config = env.embedded().with("definitions", "[interfaces]").route(route);
            let file = env.write("check.yaml", config.yaml())?;
            env.wrapyfi(["check", &file.display().to_string()])
        };
        let kind = "example_interfaces/srv/AddTwoInts";
        let mut good =
            check(Route::service("ros2:/a", "zeromq:/b", kind).with("timeout_ms", "900"))?;
        good.exits_with(0)?;
        let line = format!("zeromq:/b -> ros2:/a  service  {kind}  within 900 ms");
        assert!(good.stdout().contains(&line), "{}", good.stdout());
        for (key, value, words) in [
            ("qos", "sensor_data", "qos has no effect on a service"),
            ("from", "\"ros2:/c\"", "`from` stands beside a service"),
            ("timeout_ms", "0", "timeout_ms is 0, it must lie between 1 and 3600000"),
            ("options", "{ carrier: tcp }", "option carrier is unknown between"),
        ] {
            let mut bad = check(Route::service("ros2:/a", "zeromq:/b", kind).with(key, value))?;
            bad.exits_with(2)?;
            assert!(bad.stderr().contains(words), "{words}: {}", bad.stderr());
        }
        let mut bad = check(Route::service("ros2:/a", "zeromq:/b", "demo/srv/Missing"))?;
        bad.exits_with(2)?;
        assert!(bad.stderr().contains("demo/srv/Missing is defined nowhere"), "{}", bad.stderr());
        Ok(())
    })
}

/// The state of a route that calls a server of another type, in a mapping of services to DDS.
fn names_the_other_type(test: &str, rmw: &str) -> Result {
    run(test, &[Need::Program], |env| {
        env.set_variable("RMW_IMPLEMENTATION", rmw);
        let service = ros2(&env.topic("set"));
        let route = Route::service(&service, "zeromq:/set", "std_srvs/srv/SetBool");
        let config = env.embedded().requests(env).route(route.with("name", "set"));
        let bridge = env.bridge(&config)?;
        let serve = |kind| env.wrapyfi(["serve", &service, "--type", kind, "--echo"]);
        let other = serve("std_srvs/srv/Trigger")?;
        until_route(&bridge, "set", |route| {
            let reason = route.and_then(|it| it["reason"].as_str()).unwrap_or_default();
            reason.contains("is std_srvs/srv/SetBool; the one there is std_srvs/srv/Trigger")
        })?;
        drop(other);
        let _right = serve("std_srvs/srv/SetBool")?;
        until_route(&bridge, "set", |route| route.is_some_and(|it| it["state"] == "active"))
    })
}

#[test]
fn a_server_of_another_type_is_named_on_cyclone() -> Result {
    names_the_other_type("a_server_of_another_type_is_named_on_cyclone", "rmw_cyclonedds_cpp")
}

/// RustDDS matches endpoints whatever their type.
#[test]
fn a_server_of_another_type_is_named_in_the_mapping_of_fast_dds() -> Result {
    let test = "a_server_of_another_type_is_named_in_the_mapping_of_fast_dds";
    names_the_other_type(test, "rmw_fastrtps_cpp")
}
