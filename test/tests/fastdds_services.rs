//! Services of our programs with a real Fast DDS at the other end, and of a bridge that runs its mapping.

use std::time::Duration;

use serde_json::{Value, json};
use wrapyfi_e2e::{Output, Process, Result, Route, TestEnv, ros2, run, texts, zeromq};

use crate::fastdds::{CYCLONE, Cdr, DEFINITIONS, FAST, NEEDS, told_until, unhex};

const ADD: &str = "example_interfaces/srv/AddTwoInts";
const SET_BOOL: &str = "std_srvs/srv/SetBool";

/// `wrapyfi COMMAND ros2:SERVICE` as a program of this RMW would run it.
fn start(env: &TestEnv, rmw: &str, command: &str, service: &str, more: &[&str]) -> Result<Process> {
    let (endpoint, folder) = (ros2(service), env.definitions(DEFINITIONS)?);
    let words = [command, &endpoint, "--type", ADD, "--definitions", &folder, "--json"];
    env.wrapyfi_as(rmw, [&words[..], more].concat())
}

#[test]
fn a_server_on_fast_dds_answers_the_first_call_of_ours() -> Result {
    run("a_server_on_fast_dds_answers_the_first_call_of_ours", NEEDS, |env| {
        let service = env.topic("sums");
        let server = env.fast_peer(&format!("server --topic {service} --type {ADD}"))?;
        server.event("ready")?;
        for a in 0..4 {
            let value = format!(r#"{{"a": {a}, "b": 1099511627776}}"#);
            let more = ["--value", &value, "--timeout", "60"];
            let mut call = start(env, FAST, "call", &service, &more)?;
            call.exits_with(0).map_err(|e| e.context(server.tail()))?;
            let sum = call.objects(1)?[0]["value"]["sum"].clone();
            assert_eq!(sum, json!(a + 1_099_511_627_776_i64));
        }
        // One request each, named as rmw_fastrtps names its own.
        let asked = server.wait_until("four requests", |output| {
            let asked = output.events("request");
            (asked.len() >= 4).then_some(asked)
        })?;
        let expected: Vec<_> =
            (0..4).map(|a| Cdr::new().long(a).long(1_099_511_627_776).hex()).collect();
        assert_eq!(texts(&asked, "cdr"), expected);
        assert!(asked.iter().all(|one| one["named"] == true), "{asked:?}");
        Ok(())
    })
}

#[test]
fn our_server_answers_the_first_call_of_a_client_on_fast_dds() -> Result {
    run("our_server_answers_the_first_call_of_a_client_on_fast_dds", NEEDS, |env| {
        let service = env.topic("sums");
        let server = start(env, FAST, "serve", &service, &["--value", r#"{"sum": 42}"#])?;
        let mut client = env.fast_peer(&format!("client --topic {service} --type {ADD}"))?;
        // As `wait_for_service`: both endpoints.
        client.wait_until("both matches", |output| {
            let mut with = texts(&output.events("matched"), "with");
            with.dedup();
            (with.len() >= 2).then_some(())
        })?;
        for a in 0..20 {
            client.tell(&Cdr::new().long(a).long(3).hex())?;
        }
        let replies = client
            .wait_until("twenty replies", |output| {
                let replies = output.events("reply");
                (replies.len() >= 20).then_some(replies)
            })
            .map_err(|e| e.context(server.tail()))?;
        let expected = Cdr::new().long(42).hex();
        for (index, reply) in (1..).zip(&replies) {
            let found = (&reply["cdr"], &reply["mine"], &reply["number"]);
            assert_eq!(found, (&json!(expected), &json!(true), &json!(index)));
        }
        let last = json!({"a": 19, "b": 3});
        server.wait_until("the last request", |output| {
            output.objects().any(|asked| asked["value"] == last).then_some(())
        })
    })
}

/// A process that is stopped and goes on, as with Ctrl-Z and `fg`.
#[test]
fn a_server_that_was_stopped_and_goes_on_answers_fast_dds_again() -> Result {
    run("a_server_that_was_stopped_and_goes_on_answers_fast_dds_again", NEEDS, |env| {
        let service = env.topic("sums");
        let server = start(env, FAST, "serve", &service, &["--value", r#"{"sum": 42}"#])?;
        let mut client = env.fast_peer(&format!("client --topic {service} --type {ADD}"))?;
        for round in 0..3 {
            let answers = |output: &Output| output.events("reply").len();
            let before = client.wait_until("a number", |output| Some(answers(output)))?;
            let more = |output: &Output| (answers(output) > before + 2).then_some(());
            told_until(&mut client, &Cdr::new().long(round).long(3), None, more)
                .map_err(|e| e.context(server.tail()))?;
            server.pause()?;
            std::thread::sleep(Duration::from_millis(300)); // the time for which it stands still
            server.resume()?;
        }
        Ok(())
    })
}

#[test]
fn without_a_choice_a_service_is_in_both_mappings() -> Result {
    run("without_a_choice_a_service_is_in_both_mappings", NEEDS, |env| {
        let service = env.topic("sums");
        let server = start(env, "", "serve", &service, &["--value", r#"{"sum": 42}"#])?;
        for rmw in [FAST, CYCLONE, ""] {
            let mut call = start(env, rmw, "call", &service, &["--timeout", "60"])?;
            call.exits_with(0).map_err(|e| e.context(server.tail()))?;
        }
        assert_eq!(server.objects(3)?.len(), 3, "each request is given once");
        let mut list = env.wrapyfi(["list", "ros2"])?;
        list.exits_with(0)?;
        let listed = list.tail();
        assert_eq!(listed.matches(&service).count(), 1, "a service is one: {listed}");
        let mut client = env.fast_peer(&format!("client --topic {service} --type {ADD}"))?;
        let replies = |output: &Output| output.events("reply").pop();
        let reply = told_until(&mut client, &Cdr::new().long(1).long(3), None, replies)
            .map_err(|e| e.context(server.tail()))?;
        assert_eq!(reply["cdr"], json!(Cdr::new().long(42).hex()));
        Ok(())
    })
}

#[test]
fn a_call_in_the_wrong_mapping_says_what_to_set() -> Result {
    run("a_call_in_the_wrong_mapping_says_what_to_set", NEEDS, |env| {
        let service = env.topic("sums");
        let server = env.fast_peer(&format!("server --topic {service} --type {ADD}"))?;
        server.event("ready")?;
        let mut call = start(env, CYCLONE, "call", &service, &["--timeout", "10"])?;
        call.exits_with(3)?;
        let told = call.stderr();
        let words = "the other end runs rmw_fastrtps_cpp, whose services do not understand those \
                     of rmw_cyclonedds_cpp: set RMW_IMPLEMENTATION=rmw_fastrtps_cpp here";
        assert!(told.contains(words), "{told}");
        Ok(())
    })
}

/// Our services of Fast DDS's mapping are on RustDDS, whose programs may speak either.
#[test]
fn our_server_of_the_other_mapping_is_known_for_what_it_is() -> Result {
    run("our_server_of_the_other_mapping_is_known_for_what_it_is", NEEDS, |env| {
        let service = env.topic("sums");
        let server = start(env, FAST, "serve", &service, &["--value", r#"{"sum": 42}"#])?;
        let mut call = start(env, FAST, "call", &service, &["--timeout", "60"])?;
        call.exits_with(0).map_err(|e| e.context(server.tail()))?;
        let mut call = start(env, CYCLONE, "call", &service, &["--timeout", "10"])?;
        call.exits_with(3)?;
        let told = call.stderr();
        assert!(told.contains("the other end runs rmw_fastrtps_cpp"), "{told}");
        let mut why = env.wrapyfi_as(CYCLONE, ["why", &ros2(&service), "--json"])?;
        why.exits_with(1)?;
        let told: Value = serde_json::from_str(why.stdout().trim())?;
        assert_eq!(told["cause"], "service_mapping", "{told}");
        Ok(())
    })
}

#[test]
fn a_bridge_that_was_called_in_the_other_mapping_says_what_to_set() -> Result {
    run("a_bridge_that_was_called_in_the_other_mapping_says_what_to_set", NEEDS, |env| {
        let service = env.topic("light");
        let route = Route::service(&zeromq("/light"), &ros2(&service), SET_BOOL);
        let config = env.embedded().route(route.with("name", "light"));
        let bridge = env.bridge(&config)?;
        let mut client = env.fast_peer(&format!("client --topic {service} --type {SET_BOOL}"))?;
        let counted = |output: &Output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            report["routes"][0]["counters"]["drops"]["service_mapping"].as_u64()
        };
        told_until(&mut client, &Cdr::new().bytes(&[1]), Some(&bridge), counted)?;
        let file = env.write("again.yaml", config.yaml())?.display().to_string();
        let mut why = env.wrapyfi(["why", "light", "--config", &file, "--json"])?;
        why.exits_with(1)?;
        let told: Value = serde_json::from_str(why.stdout().trim())?;
        assert_eq!(told["cause"], "service_mapping", "{told}");
        assert!(told["remedy"].to_string().contains("RMW_IMPLEMENTATION"), "{told}");
        Ok(())
    })
}

#[test]
fn a_client_on_fast_dds_reads_the_parameters_of_the_node() -> Result {
    run("a_client_on_fast_dds_reads_the_parameters_of_the_node", NEEDS, |env| {
        let namespace = env.topic("lab");
        let route = Route::new("zeromq:/a", "ros2:cam", "Image");
        let file = env.write("bridge.yaml", env.embedded().route(route).yaml())?;
        let (parameter, ns) =
            (format!("config_file:={}", file.display()), format!("__ns:={namespace}"));
        let args = ["--ros-args", "-p", &parameter, "-r", &ns, "-r", "__node:=eye"];
        let node = env.node_as(FAST, args)?;
        let mut client = env.fast_peer(&format!(
            "client --topic {namespace}/eye/get_parameters --type rcl_interfaces/srv/GetParameters"
        ))?;
        client
            .wait_until("both matches", |output| {
                let mut with = texts(&output.events("matched"), "with");
                with.dedup();
                (with.len() >= 2).then_some(())
            })
            .map_err(|e| e.context(node.tail()))?;
        let request = Cdr::new().number(1).text("config_file");
        let answer = |output: &Output| output.events("reply").into_iter().next();
        let reply = told_until(&mut client, &request, None, answer);
        let reply = unhex(&reply.map_err(|e| e.context(node.tail()))?["cdr"]);
        // One value, its type a text, the numbers before it zero, and the path.
        let expected =
            Cdr::new().number(1).bytes(&[4, 0]).long(0).long(0).text(&file.display().to_string());
        assert!(reply.starts_with(&expected.0), "{reply:?}\n{:?}", expected.0);
        Ok(())
    })
}

/// Fast DDS hears nothing of the end of an endpoint on RustDDS, only of that of a participant.
#[test]
fn a_service_of_a_bridge_that_is_deactivated_goes_at_once() -> Result {
    run("a_service_of_a_bridge_that_is_deactivated_goes_at_once", NEEDS, |env| {
        let service = env.topic("light");
        let route = Route::service(&zeromq("/light"), &ros2(&service), SET_BOOL);
        let config = env.embedded().route(route.with("name", "light"));
        let file = env.write("bridge.yaml", config.yaml())?.display().to_string();
        let bridge = env.wrapyfi_as(FAST, ["bridge", "--config", &file, "--json"])?;
        let serves = |graph: &Process, service: &str| {
            let requests = format!("rq{service}Request");
            graph.wait_until("the service", |output| {
                let is_it = |one: &Value| one["topic"] == *requests && one["role"] == "reader";
                let found = output.events("endpoint").into_iter().find(is_it)?;
                found["guid"].as_str().map(str::to_owned)
            })
        };
        let graph = env.fast_peer("graph")?;
        let guid = serves(&graph, &service).map_err(|e| e.context(bridge.tail()))?;
        let (participant, _) = guid.split_at(24);
        let transition = json!({"transition": {"label": "deactivate"}}).to_string();
        let change = "ros2:/wrapyfi_bridge/change_state";
        let mut call = env.wrapyfi_as(FAST, ["call", change, "--value", &transition])?;
        call.exits_with(0).map_err(|e| e.context(bridge.tail()))?;
        graph.wait_until("its end", |output| {
            let is_it =
                |one: &Value| one["guid"].as_str().is_some_and(|it| it.starts_with(participant));
            output.events("gone").iter().any(is_it).then_some(())
        })?;
        let late = env.fast_peer("graph")?;
        serves(&late, "/wrapyfi_bridge/change_state")?;
        assert!(!late.stdout().contains(&guid), "{}", late.stdout());
        let mut why = env.wrapyfi_as(FAST, ["why", "light", "--config", &file])?;
        why.exits_with(1)?;
        let said = why.stdout();
        assert!(said.contains("ros2 lifecycle set /wrapyfi_bridge activate"), "{said}");
        Ok(())
    })
}

/// A client that calls the bridge's own services in the other mapping hears nothing; the bridge's log and `why` say it.
#[test]
fn a_request_to_the_bridge_itself_in_the_other_mapping_is_named() -> Result {
    run("a_request_to_the_bridge_itself_in_the_other_mapping_is_named", NEEDS, |env| {
        let service = "/wrapyfi_bridge/reload";
        let route = Route::new(&zeromq("/in"), &ros2(&env.topic("out")), "Text");
        let bridge = env.bridge(&env.embedded().route(route))?;
        let words = format!("client --topic {service} --type std_srvs/srv/Trigger");
        let mut client = env.fast_peer(&words)?;
        let is_told = |output: &Output| {
            let mut lines = output.err.iter();
            lines.any(|line| line.contains("reload\" came from rmw_fastrtps_cpp")).then_some(())
        };
        told_until(&mut client, &Cdr::new().bytes(&[0]), Some(&bridge), is_told)?;
        let mut why = env.wrapyfi_as(CYCLONE, ["why", &ros2(service), "--json"])?;
        why.exits_with(1)?;
        let told: Value = serde_json::from_str(why.stdout().trim())?;
        assert_eq!(told["cause"], "service_mapping", "{told}");
        let remedy = "export RMW_IMPLEMENTATION=rmw_fastrtps_cpp where the server starts";
        assert!(told["remedy"].to_string().contains(remedy), "{told}");
        Ok(())
    })
}
