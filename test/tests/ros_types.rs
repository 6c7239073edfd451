//! Routes of ROS types that nothing here was built for.

use serde_json::json;
use wrapyfi_e2e::{Need, Result, Route, TestEnv, ros2, run, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];

const PAIR: (&str, &str) = ("demo/msg/Pair.msg", "string left\nfloat32[] right\nPart[] parts\n");
const PART: (&str, &str) = ("demo/msg/Part.msg", "int16 id\nbool on\n");

/// A bridge that finds the definitions of `demo`.
fn bridge(env: &TestEnv, route: Route) -> Result<wrapyfi_e2e::Process> {
    env.definitions(&[PAIR, PART])?;
    env.bridge(&env.embedded().with("definitions", "[interfaces]").route(route))
}

#[test]
fn a_ros_message_reaches_wrapyfi_as_a_dict() -> Result {
    run("a_ros_message_reaches_wrapyfi_as_a_dict", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &zeromq(&to), "sensor_msgs/msg/JointState");
        let _bridge = env.bridge(&env.embedded().route(route))?;
        let listener = env.wrapyfi_listener(&to, "--count 1")?;
        let _publisher = env.wrapyfi([
            "pub",
            &ros2(&from),
            "--type",
            "sensor_msgs/msg/JointState",
            "--value",
            r#"{"name": ["neck", "eye"], "position": [0.5, -1.5]}"#,
        ])?;
        let heard = &listener.messages(1)?[0]["value"];
        assert_eq!(heard["name"], json!(["neck", "eye"]));
        assert_eq!(heard["header"]["frame_id"], "");
        assert_eq!(heard["position"]["@array"]["shape"], json!([2]), "{heard}");
        Ok(())
    })
}

#[test]
fn a_dict_of_wrapyfi_becomes_a_ros_message() -> Result {
    run("a_dict_of_wrapyfi_becomes_a_ros_message", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&zeromq(&from), &ros2(&to), "geometry_msgs/msg/Twist");
        let _bridge = env.bridge(&env.embedded().route(route))?;
        let subscriber = env.dds_subscriber(&to, "geometry_msgs/msg/Twist", "--count 1")?;
        let _publisher = env.wrapyfi([
            "pub",
            &zeromq(&from),
            "--type",
            "NativeObject",
            "--rate",
            "20",
            "--value",
            r#"{"linear": {"x": 0.25}, "angular": {"z": -1}}"#,
        ])?;
        let heard = &subscriber.messages(1)?[0];
        assert_eq!(heard["fields"]["linear"]["x"], 0.25, "{heard}");
        assert_eq!(heard["fields"]["angular"]["z"], -1.0, "{heard}");
        Ok(())
    })
}

#[test]
fn a_type_of_the_users_own_goes_from_topic_to_topic() -> Result {
    run("a_type_of_the_users_own_goes_from_topic_to_topic", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &ros2(&to), "demo/msg/Pair");
        let bridge = bridge(env, route)?;
        let folder = env.definitions(&[PAIR, PART])?;
        let own = ["--type", "demo/msg/Pair", "--definitions", &folder];
        let (from, to) = (ros2(&from), ros2(&to));
        let echo = [&["echo", &to, "--count", "1", "--json"], &own[..]].concat();
        let listener = env.wrapyfi(echo)?;
        let value = r#"{"left": "a", "right": [1, 2.5], "parts": [{"id": 7, "on": true}]}"#;
        let publish = [&["pub", &from, "--value", value], &own[..]].concat();
        let _publisher = env.wrapyfi(publish)?;
        let heard = &listener.objects(1).map_err(|error| error.context(bridge.tail()))?[0];
        let fields = if heard["value"].is_object() { &heard["value"] } else { &heard["fields"] };
        assert_eq!(fields["right"], json!([1.0, 2.5]), "{heard}");
        assert_eq!(fields["parts"], json!([{"id": 7, "on": true}]), "{heard}");
        Ok(())
    })
}

#[test]
fn text_stays_text() -> Result {
    run("text_stays_text", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let _bridge =
            env.bridge(&env.embedded().route(Route::new(&zeromq(&from), &ros2(&to), "Text")))?;
        let subscriber = env.dds_subscriber(&to, "std_msgs/msg/String", "--count 1 --cdr")?;
        let _publisher = env.wrapyfi([
            "pub",
            &zeromq(&from),
            "--type",
            "NativeObject",
            "--rate",
            "20",
            "--value",
            r#""hello you""#,
        ])?;
        let heard = &subscriber.messages(1)?[0];
        assert!(heard.to_string().contains("hello you"), "{heard}");
        assert!(!heard.to_string().contains("\\\"hello"), "{heard}");
        Ok(())
    })
}

#[test]
fn a_type_that_is_defined_nowhere_is_refused_with_the_remedy() -> Result {
    run("a_type_that_is_defined_nowhere_is_refused_with_the_remedy", NEEDS, |env| {
        let route = Route::new("ros2:/a", "zeromq:/b", "demo/msg/Missing");
        let mut bridge = bridge(env, route)?;
        assert_eq!(bridge.exit_code()?, 2);
        let told = bridge.tail();
        assert!(told.contains("demo/msg/Missing is defined nowhere"), "{told}");
        Ok(())
    })
}
