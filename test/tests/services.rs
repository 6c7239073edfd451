//! Services: `wrapyfi call` and `wrapyfi serve` with each other and with an independent node.

use serde_json::{Value, json};
use wrapyfi_e2e::{Need, Process, Result, ServiceMapping, TestEnv, rmw, run};

const NEEDS: &[Need] = &[Need::Program];
const FAST: &str = "rmw_fastrtps_cpp";
const CYCLONE: &str = "rmw_cyclonedds_cpp";
const ADD: &str = "example_interfaces/srv/AddTwoInts";

/// Definitions of packages that are installed nowhere here.
const DEFINITIONS: &[(&str, &str)] = &[
    ("example_interfaces/srv/AddTwoInts.srv", "int64 a\nint64 b\n---\nint64 sum\n"),
    ("std_srvs/srv/SetBool.srv", "bool data\n---\nbool success\nstring message\n"),
    ("demo/srv/Say.srv", "string text\nint32[] list\n---\nstring text\nint32[] list\nbool other\n"),
    ("demo/srv/Measure.srv", "---\nbool success\nstring message\nfloat64[] list\n"),
];

/// `wrapyfi COMMAND ros2:SERVICE` as a program of this RMW would run it.
fn start(env: &TestEnv, rmw: &str, command: &str, service: &str, more: &[&str]) -> Result<Process> {
    let (endpoint, folder) = (format!("ros2:{service}"), env.definitions(DEFINITIONS)?);
    let mut words = vec![command, &endpoint, "--definitions", &folder, "--json"];
    words.extend(more);
    env.wrapyfi_as(rmw, words)
}

fn call(env: &TestEnv, service: &str, more: &[&str]) -> Result<Process> {
    start(env, &rmw(), "call", service, more)
}

fn reply_as(env: &TestEnv, rmw: &str, service: &str, more: &[&str]) -> Result<Value> {
    let patient = [more, &["--timeout", "60"]].concat();
    let mut process = start(env, rmw, "call", service, &patient)?;
    process.exits_with(0)?;
    Ok(process.objects(1)?[0]["value"].clone())
}

fn reply(env: &TestEnv, service: &str, more: &[&str]) -> Result<Value> {
    reply_as(env, &rmw(), service, more)
}

fn serve(env: &TestEnv, service: &str, more: &[&str]) -> Result<Process> {
    start(env, &rmw(), "serve", service, more)
}

#[test]
fn a_call_comes_back_with_what_the_server_says() -> Result {
    run("a_call_comes_back_with_what_the_server_says", NEEDS, |env| {
        let (say, set) = (env.topic("say"), env.topic("set"));
        // Begun before there is a server.
        let early = ["--type", "demo/srv/Say", "--value", r#"{"text": "früh", "list": [1, 2]}"#];
        let mut early = call(env, &say, &[&early[..], &["--timeout", "60"]].concat())?;
        let mut echo = serve(env, &say, &["--type", "demo/srv/Say", "--echo", "--count", "2"])?;
        early.exits_with(0)?;
        let echoed = json!({"text": "früh", "list": [1, 2], "other": false});
        assert_eq!(early.objects(1)?[0], json!({"type": "demo/srv/Say_Response", "value": echoed}));
        // The type is what the server announces.
        let late = reply(env, &say, &["--value", r#"{"text": "late"}"#])?;
        assert_eq!(late, json!({"text": "late", "list": [], "other": false}));
        echo.exits_with(0)?;
        let asked: Vec<Value> =
            echo.objects(2)?.iter().map(|o| o["value"]["text"].clone()).collect();
        assert_eq!(asked, ["früh", "late"]);

        let value = r#"{"success": true, "message": "done"}"#;
        let server = serve(env, &set, &["--type", "std_srvs/srv/SetBool", "--value", value])?;
        let done = reply(env, &set, &["--value", r#"{"data": true}"#])?;
        assert_eq!(done, json!({"success": true, "message": "done"}));
        assert_eq!(server.objects(1)?[0]["value"], json!({"data": true}));
        server.terminate()
    })
}

#[test]
fn functions_of_wrapyfi_are_services() -> Result {
    run("functions_of_wrapyfi_are_services", NEEDS, |env| {
        for name in ["NativeObject", "wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService"] {
            let function = env.topic(if name == "NativeObject" { "ours" } else { "upstream" });
            let server = serve(env, &function, &["--type", name, "--echo"])?;
            let words = ["--args", r#"[{"pose": [0.5, 1], "name": "arm"}]"#, "--kwargs", "{}"];
            let returned = reply(env, &function, &words)?;
            assert_eq!(returned, json!({"pose": [0.5, 1], "name": "arm"}));
            let asked = &server.objects(1)?[0];
            assert_eq!(asked["args"][0]["name"], "arm", "{asked}");
            server.terminate()?;
        }
        Ok(())
    })
}

#[test]
fn what_a_function_returns_is_printed_in_words() -> Result {
    run("what_a_function_returns_is_printed_in_words", NEEDS, |env| {
        for (name, kind) in [
            ("ours", "NativeObject"),
            ("upstream", "wrapyfi_ros2_interfaces/srv/ROS2NativeObjectService"),
        ] {
            let endpoint = format!("ros2:{}", env.topic(name));
            let words = ["serve", &endpoint, "--type", kind, "--echo", "--count", "1"];
            let mut server = env.wrapyfi(words)?;
            let value = ["--args", r#"[{"name": "Jörg"}]"#];
            let words = ["call", &endpoint, "--timeout", "60", value[0], value[1]];
            let mut call = env.wrapyfi(words)?;
            call.exits_with(0)?;
            assert_eq!(call.stdout().trim(), r#"{"name":"Jörg"}"#);
            server.exits_with(0)?;
        }
        Ok(())
    })
}

#[test]
fn the_common_types_need_no_definitions() -> Result {
    run("the_common_types_need_no_definitions", NEEDS, |env| {
        for (name, kind, reply) in [
            ("set", "std_srvs/srv/SetBool", json!({"success": true, "message": ""})),
            ("object", "NativeObject", json!([])),
        ] {
            let endpoint = format!("ros2:{}", env.topic(name));
            let words = ["serve", &endpoint, "--type", kind, "--echo", "--count", "1"];
            let mut server = env.wrapyfi(words)?;
            let words = ["call", &endpoint, "--type", kind, "--json", "--timeout", "60"];
            let mut call = env.wrapyfi(words)?;
            call.exits_with(0)?;
            assert_eq!(call.objects(1)?[0]["value"], reply);
            server.exits_with(0)?;
        }
        Ok(())
    })
}

/// Each call is the first one of a new process.
fn calls_of_a_server(env: &TestEnv, rmw: &str, mapping: ServiceMapping) -> Result {
    let sums = env.topic("sums");
    let mut node = env.ros_node("adder")?;
    let _server = node.serve_sums(&sums, mapping)?;
    for a in 0..5 {
        let value = format!(r#"{{"a": {a}, "b": 1099511627776}}"#);
        let sum = reply_as(env, rmw, &sums, &["--value", &value])?;
        assert_eq!(sum, json!({"sum": a + 1_099_511_627_776_i64}));
    }
    Ok(())
}

fn requests_of_a_client(env: &TestEnv, rmw: &str, mapping: ServiceMapping) -> Result {
    let sums = env.topic("sums");
    let answer = ["--type", ADD, "--value", r#"{"sum": 42}"#];
    let server = start(env, rmw, "serve", &sums, &answer)?;
    let mut node = env.ros_node("asker")?;
    let client = node.ask_for_sums(&sums, mapping)?;
    assert_eq!(client.first(1, 2)?, 42);
    for a in 0..50 {
        assert_eq!(client.next(a, 3)?, 42);
    }
    let last = json!({"a": 49, "b": 3});
    server.wait_until("the last request", |output| {
        output.objects().any(|asked| asked["value"] == last).then_some(())
    })
}

#[test]
fn an_independent_server_answers_our_calls() -> Result {
    run("an_independent_server_answers_our_calls", NEEDS, |env| {
        calls_of_a_server(env, CYCLONE, ServiceMapping::Cyclone)
    })
}

#[test]
fn an_independent_server_of_fast_dds_answers_our_calls() -> Result {
    run("an_independent_server_of_fast_dds_answers_our_calls", NEEDS, |env| {
        calls_of_a_server(env, FAST, ServiceMapping::Enhanced)
    })
}

#[test]
fn our_server_answers_an_independent_client() -> Result {
    run("our_server_answers_an_independent_client", NEEDS, |env| {
        requests_of_a_client(env, CYCLONE, ServiceMapping::Cyclone)
    })
}

#[test]
fn our_server_answers_an_independent_client_of_fast_dds() -> Result {
    run("our_server_answers_an_independent_client_of_fast_dds", NEEDS, |env| {
        requests_of_a_client(env, FAST, ServiceMapping::Enhanced)
    })
}

#[test]
fn both_mappings_have_the_same_features() -> Result {
    run("both_mappings_have_the_same_features", NEEDS, |env| {
        let say = env.topic("say");
        let early = ["--type", "demo/srv/Say", "--value", r#"{"text": "a"}"#, "--timeout", "60"];
        let mut early = start(env, FAST, "call", &say, &early)?;
        let server = start(env, FAST, "serve", &say, &["--type", "demo/srv/Say", "--echo"])?;
        early.exits_with(0)?;
        let late = reply_as(env, FAST, &say, &["--value", r#"{"text": "b", "list": [3]}"#])?;
        assert_eq!(late, json!({"text": "b", "list": [3], "other": false}));
        // The other mapping is told apart and told so.
        let foreign = ["--type", "demo/srv/Say", "--timeout", "3"];
        let mut foreign = call(env, &say, &foreign)?;
        foreign.exits_with(3)?;
        server.terminate()?;

        let cyclone = env.topic("cyclone");
        let _server = serve(env, &cyclone, &["--type", "demo/srv/Say", "--echo"])?;
        let mut foreign = start(env, FAST, "call", &cyclone, &["--timeout", "10"])?;
        foreign.exits_with(3)?;
        let told = foreign.stderr();
        let words = "the other end runs rmw_cyclonedds_cpp, whose services do not understand those \
                     of rmw_fastrtps_cpp: set RMW_IMPLEMENTATION=rmw_cyclonedds_cpp here";
        assert!(told.contains(words), "{told}");
        Ok(())
    })
}

/// Under Fast DDS's mapping a reply beyond its limit is refused. Its client is told, and the next
/// one is served.
#[test]
fn a_reply_that_cannot_be_sent_does_not_end_its_server() -> Result {
    run("a_reply_that_cannot_be_sent_does_not_end_its_server", NEEDS, |env| {
        let measure = env.topic("measure");
        let value = format!(r#"{{"success": true, "list": [{}0]}}"#, "0,".repeat(19_999));
        let words = ["--type", "demo/srv/Measure", "--value", &value, "--count", "2"];
        let mut server = start(env, FAST, "serve", &measure, &words)?;
        for _ in 0..2 {
            let told = reply_as(env, FAST, &measure, &["--type", "demo/srv/Measure"])?;
            assert_eq!(told["success"], json!(false));
            let reason = told["message"].as_str().unwrap_or_default();
            assert!(reason.contains("a reply of 160020 bytes is over the limit"), "{reason}");
        }
        server.exits_with(0)?;
        // At once, or after it was kept for a client that did not hear yet.
        let told = server.stderr();
        assert!(told.contains("writing failed on") && told.contains("160020 bytes"), "{told}");
        Ok(())
    })
}

/// Replies that do not fit one datagram go in several.
#[test]
fn a_large_reply_of_fast_ddss_mapping_arrives() -> Result {
    run("a_large_reply_of_fast_ddss_mapping_arrives", NEEDS, |env| {
        let set = env.topic("set");
        let text = "x".repeat(70_000);
        let value = format!(r#"{{"success": true, "message": "{text}"}}"#);
        let words = ["--type", "std_srvs/srv/SetBool", "--value", &value];
        let server = start(env, FAST, "serve", &set, &words)?;
        for _ in 0..3 {
            let reply = reply_as(env, FAST, &set, &["--type", "std_srvs/srv/SetBool"])?;
            assert_eq!(reply, json!({"success": true, "message": text}));
        }
        server.terminate()
    })
}

#[test]
fn a_request_comes_from_a_file() -> Result {
    run("a_request_comes_from_a_file", NEEDS, |env| {
        let set = env.topic("set");
        let server = serve(env, &set, &["--type", "std_srvs/srv/SetBool", "--echo"])?;
        let file = env.write("on.json", r#"{"data": true}"#)?.display().to_string();
        reply(env, &set, &["--file", &file])?;
        assert_eq!(server.objects(1)?[0]["value"], json!({"data": true}));
        let file = env.write("wrong.json", r#"{"dat": true}"#)?.display().to_string();
        let mut wrong = call(env, &set, &["--type", "std_srvs/srv/SetBool", "--file", &file])?;
        wrong.exits_with(2)?;
        assert!(wrong.stderr().contains("did you mean \"data\"?"), "{}", wrong.stderr());
        server.terminate()
    })
}

/// The last reply arrives though its server ends at once.
#[test]
fn a_reply_of_any_type_comes_from_a_file() -> Result {
    run("a_reply_of_any_type_comes_from_a_file", NEEDS, |env| {
        let (set, measure) = (env.topic("set"), env.topic("measure"));
        let file = |name: &str, text: &str| -> Result<String> {
            Ok(env.write(name, text)?.display().to_string())
        };
        let on = file("on.json", r#"{"success": true, "message": "on"}"#)?;
        let _set = serve(env, &set, &["--type", "std_srvs/srv/SetBool", "--file", &on])?;
        assert_eq!(reply(env, &set, &[])?, json!({"success": true, "message": "on"}));
        let list = file("list.json", r#"{"list": [1.5, 2]}"#)?;
        let _measure = serve(env, &measure, &["--type", "demo/srv/Measure", "--file", &list])?;
        assert_eq!(reply(env, &measure, &[])?["list"], json!([1.5, 2.0]));
        let wrong = file("wrong.json", r#"{"successful": true}"#)?;
        let image = file("image.png", "no picture")?;
        for (file, words) in [
            (&wrong, "wrong.json is no reply of std_srvs/srv/SetBool"),
            (&image, "image.png is no .json file; a reply of std_srvs/srv/SetBool is a .json file"),
        ] {
            let mut server = serve(env, &set, &["--type", "std_srvs/srv/SetBool", "--file", file])?;
            server.exits_with(2)?;
            assert!(server.stderr().contains(words), "{}", server.stderr());
        }
        Ok(())
    })
}

#[test]
fn a_server_that_ends_has_answered() -> Result {
    run("a_server_that_ends_has_answered", NEEDS, |env| {
        for (n, rmw) in [FAST, CYCLONE].into_iter().cycle().take(16).enumerate() {
            let set = env.topic(&format!("set_{n}"));
            let once = ["--type", "std_srvs/srv/SetBool", "--echo", "--count", "1"];
            let mut server = start(env, rmw, "serve", &set, &once)?;
            let reply = reply_as(env, rmw, &set, &["--type", "std_srvs/srv/SetBool"])?;
            assert_eq!(reply["success"], json!(true));
            server.exits_with(0)?;
        }
        Ok(())
    })
}

#[test]
fn calls_that_cannot_be_end_with_a_reason() -> Result {
    run("calls_that_cannot_be_end_with_a_reason", NEEDS, |env| {
        let none = env.topic("none");
        for (more, code, words) in [
            (vec!["--type", ADD, "--timeout", "0.5"], 3, "no node offers it"),
            (vec!["--timeout", "0.5"], 3, "no node offers it: start one, or see"),
            (vec!["--type", ADD, "--timeout", "2"], 3, "waiting for a server of"),
            (vec!["--timeout", "2"], 3, "waiting for a node that offers it"),
            (
                vec!["--type", ADD, "--value", r#"{"c": 1}"#],
                2,
                "is no request of example_interfaces",
            ),
            (vec!["--type", ADD, "--value", "{"], 2, "--value: malformed JSON"),
            (vec!["--type", "nowhere/srv/Nothing"], 2, "nowhere/srv/Nothing"),
            (vec!["--type", ADD, "--args", "[1, 2, 3]"], 2, "has 2: leave out 1"),
            (
                vec!["--type", "nowhere/msg/Nothing"],
                2,
                "accepted are NativeObject, Image, CompressedImage, AudioChunk",
            ),
        ] {
            let mut process = call(env, &none, &more)?;
            process.exits_with(code)?;
            assert!(process.stderr().contains(words), "{more:?}: {}", process.stderr());
        }
        for name in ["ros2:/1st", "ros2:/chatter/"] {
            let mut echo = env.wrapyfi(["echo", name])?;
            echo.exits_with(2)?;
            assert!(echo.stderr().contains(name), "{}", echo.stderr());
        }
        let mut zeromq = env.wrapyfi(["call", "zeromq:/x", "--type", ADD])?;
        zeromq.exits_with(2)?;
        assert!(
            zeromq.stderr().contains("is no function of Wrapyfi; accepted are NativeObject"),
            "{}",
            zeromq.stderr()
        );
        Ok(())
    })
}
