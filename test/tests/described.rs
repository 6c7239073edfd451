//! Types that only one program has a definition of: its node describes them to all others.
//!
//! ```text
//!   wrapyfi pub|serve|action serve --definitions DIR ◀─ ~/get_type_description ─ wrapyfi echo|call|action send|why
//! ```

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Result, Route, TestEnv, ros1, ros2, run};

const NEEDS: &[Need] = &[Need::Program];
const FILES: &[(&str, &str)] = &[
    ("demo/msg/Pair.msg", "int32 number\nstring[] words\n"),
    ("demo/srv/Double.srv", "Pair pair\n---\nPair pair\nbool done\n"),
    ("demo/action/Count.action", "int32 to\n---\nint32 reached\n---\nint32 now\n"),
];

/// The only object that a command prints about, which ends well.
fn printed(env: &TestEnv, args: &[&str]) -> Result<Value> {
    let mut process = env.wrapyfi([args, &["--json", "--timeout", "100"]].concat())?;
    process.exits_with(0)?;
    process.wait_until("an object", |output| output.objects().next_back())
}

/// A cause that `why` finds, none where nothing is missing.
fn cause(env: &TestEnv, name: &str) -> Result<Value> {
    Ok(env.wrapyfi(["why", name, "--json"])?.objects(1)?.remove(0)["cause"].clone())
}

#[test]
fn a_node_of_the_library_describes_what_it_carries() -> Result {
    run("a_node_of_the_library_describes_what_it_carries", NEEDS, |env| {
        let folder = env.definitions(FILES)?;
        let [topic, service, action] =
            ["pair", "double", "count"].map(|name| ros2(&env.topic(name)));
        let defined = ["--definitions", &folder];
        let with = |args: &[&str]| env.wrapyfi([args, &defined].concat());
        let value = r#"{"number": 7, "words": ["a", "b"]}"#;
        let publish = ["pub", &topic, "--type", "demo/msg/Pair", "--value", value, "--rate", "20"];
        let publisher = with(&publish)?;
        let heard = printed(env, &["echo", &topic, "--count", "1"])?;
        assert_eq!(heard["value"], json!({"number": 7, "words": ["a", "b"]}));
        assert_ne!(cause(env, &topic)?, "definition");
        drop(publisher);

        let answer = r#"{"pair": {"number": 14}, "done": true}"#;
        let serve = ["serve", &service, "--type", "demo/srv/Double", "--value", answer];
        let server = with(&serve)?;
        let asked = ["call", &service, "--value", r#"{"pair": {"number": 7}}"#];
        let reply = printed(env, &asked)?;
        assert_eq!(reply["value"]["pair"]["number"], 14, "{reply}");
        assert_ne!(cause(env, &service)?, "definition");
        drop(server);

        let result = r#"{"reached": 3}"#;
        let _server =
            with(&["action", "serve", &action, "--type", "demo/action/Count", "--value", result])?;
        let end = printed(env, &["action", "send", &action, "--value", r#"{"to": 3}"#])?;
        assert_eq!(end["value"]["reached"], 3, "{end}");
        assert_ne!(cause(env, &action)?, "definition");
        Ok(())
    })
}

/// A service and an action of ROS 1 whose types are installed nowhere on ROS 2.
#[test]
fn a_bridge_describes_services_that_it_has_learned() -> Result {
    let needs = [Need::Program, Need::Ros1];
    run("a_bridge_describes_services_that_it_has_learned", &needs, |env| {
        let _roscore = env.roscore()?;
        let folder = env.definitions(FILES)?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let args = format!("serve --topic {there} --type demo/Double --definitions {folder}");
        let server = env.rospy(&args, Some(r#"{"done": "=request.pair.number == 7"}"#))?;
        server.event("ready")?;
        env.set_variable("ROS_PACKAGE_PATH", &folder);
        let bridge =
            env.bridge(&env.embedded().route(Route::untyped_service(&ros1(&there), &ros2(&here))))?;
        env.set_variable("ROS_PACKAGE_PATH", "");
        let asked = ["call", &ros2(&here), "--value", r#"{"pair": {"number": 7}}"#];
        let reply = printed(env, &asked).map_err(|error| error.context(bridge.tail()))?;
        assert_eq!(reply["value"]["done"], true, "{reply}");
        assert_ne!(cause(env, &ros2(&here))?, "definition");
        Ok(())
    })
}
