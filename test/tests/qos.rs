//! Routes that follow the quality of service of other programs' endpoints.

use serde_json::Value;
use wrapyfi_e2e::{Need, Output, Process, Result, Route, ros2, run, texts, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const STRING: &str = "std_msgs/msg/String";

/// Waits until the bridge has an endpoint on the topic that fulfils `condition`.
fn endpoint(
    graph: &Process,
    role: &str,
    topic: &str,
    condition: impl Fn(&Value) -> bool,
) -> Result<Value> {
    let dds_topic = format!("rt{topic}");
    graph.wait_until(&format!("the {role} on {dds_topic}"), |output| {
        let mut all = output.events("endpoint").into_iter();
        all.find(|e| e["topic"] == *dds_topic && e["role"] == role && condition(e))
    })
}

fn has_logged(output: &Output, words: &str) -> bool {
    output.err.iter().any(|line| line.contains(words))
}

#[test]
fn a_route_hears_a_best_effort_publisher_and_then_a_reliable_one_too() -> Result {
    run("a_route_hears_a_best_effort_publisher_and_then_a_reliable_one_too", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let graph = env.graph()?;
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&ros2(&from), &zeromq(&to), STRING)))?;
        // No program is there: ROS 2's default profile.
        let first = endpoint(&graph, "reader", &from, |_| true)?;
        assert_eq!((&first["reliable"], &first["durability"]), (&true.into(), &"Volatile".into()));
        let listener = env.wrapyfi_listener(&to, "")?;
        let loose = env.dds_publisher(&from, STRING, "--flavour small --best-effort")?;
        listener.messages(1).map_err(|e| e.context(bridge.tail()))?;
        endpoint(&graph, "reader", &from, |e| e["reliable"] == false)?;
        bridge.wait_until("the announcement", |output| {
            has_logged(output, "quality of service changed").then_some(())
        })?;
        drop(loose);
        let reliable = env.dds_publisher(&from, STRING, "--flavour rich")?;
        let sent = reliable.messages(1)?;
        let wanted = texts(&sent, "sha256")[0].to_owned();
        listener.wait_until("the reliable publisher's messages", |output| {
            output.events("message").into_iter().find(|m| m["sha256"] == *wanted)
        })?;
        Ok(())
    })
}

#[test]
fn a_route_asks_for_what_was_sent_before_it_where_publishers_keep_it() -> Result {
    run("a_route_asks_for_what_was_sent_before_it_where_publishers_keep_it", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let graph = env.graph()?;
        let _publisher = env.dds_publisher(&from, STRING, "--transient-local")?;
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&ros2(&from), &zeromq(&to), STRING)))?;
        let listener = env.wrapyfi_listener(&to, "")?;
        endpoint(&graph, "reader", &from, |e| e["durability"] == "TransientLocal")?;
        listener.messages(2).map_err(|e| e.context(bridge.tail()))?;
        Ok(())
    })
}

#[test]
fn policies_of_a_route_are_announced_and_misfits_reported() -> Result {
    run("policies_of_a_route_are_announced_and_misfits_reported", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let strict = "{ deadline_ms: 100, lease_ms: 1500, liveliness: manual_by_topic, \
                      lifespan_ms: 2000, depth: 7 }";
        let config = env
            .embedded()
            .route(Route::new(&zeromq("/in"), &ros2(&to), STRING).with("qos", strict))
            .route(Route::new(&ros2(&from), &zeromq("/out"), STRING).with("qos", "default"));
        let graph = env.graph()?;
        let bridge = env.bridge(&config)?;
        let writer = endpoint(&graph, "writer", &to, |_| true)?;
        assert_eq!(writer["deadline_ms"], 100.0, "{writer}");
        assert_eq!(writer["lifespan_ms"], 2000.0, "{writer}");
        assert_eq!(writer["lease_ms"], 1500.0, "{writer}");
        assert_eq!(writer["liveliness"], "ManualByTopic", "{writer}");
        let _loose = env.dds_publisher(&from, STRING, "--flavour small --best-effort")?;
        bridge.wait_until("the report", |output| {
            let words = "offers best effort, the route asks for reliable; write qos: match";
            has_logged(output, words).then_some(())
        })?;
        Ok(())
    })
}

#[test]
fn a_route_offers_what_a_node_of_another_make_asks_for() -> Result {
    run("a_route_offers_what_a_node_of_another_make_asks_for", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let graph = env.graph()?;
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&zeromq(&from), &ros2(&to), STRING)))?;
        endpoint(&graph, "writer", &to, |e| e["durability"] == "Volatile")?;
        let mut node = env.ros_node("asks")?;
        let heard = node.subscribe_kept::<String>(&to, STRING)?;
        endpoint(&graph, "writer", &to, |e| e["durability"] == "TransientLocal")?;
        let _publisher = env.wrapyfi_publisher(&from, "--no-broker")?;
        let text: String = heard.next().map_err(|e| e.context(bridge.tail()))?;
        assert!(text.contains("\"greeting\""), "{text}");
        bridge.wait_until("the announcement", |output| {
            // The node may tell its name after its subscription.
            let whos = ["/asks", "a subscriber of an unknown node"];
            let words = whos
                .map(|who| format!("quality of service changed: {who} asks for transient local"));
            words.iter().any(|words| has_logged(output, words)).then_some(())
        })?;
        Ok(())
    })
}

#[test]
fn a_node_with_another_definition_or_distribution_is_named() -> Result {
    run("a_node_with_another_definition_or_distribution_is_named", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&ros2(&from), &zeromq(&to), STRING)))?;
        let other = format!("RIHS01_{}", "0".repeat(64));
        let options = format!("--flavour small --humble-node elder --hash {other}");
        let _publisher = env.dds_publisher(&from, STRING, &options)?;
        bridge.wait_until("the report of the definition", |output| {
            let words = format!(
                "publisher on {from} of node /elder has another definition of {STRING}: its hash \
                 is {other}, here it is RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
            );
            has_logged(output, &words).then_some(())
        })?;
        bridge.wait_until("the report of the distribution", |output| {
            let words = "node /elder is of a ROS 2 distribution before Iron";
            has_logged(output, words).then_some(())
        })?;
        // It is told, and nothing is held back: here both definitions are the same after all.
        let listener = env.wrapyfi_listener(&to, "")?;
        listener.messages(1).map_err(|e| e.context(bridge.tail()))?;
        Ok(())
    })
}

#[test]
fn parameters_lay_down_what_peers_do_not_change() -> Result {
    let needs = &[Need::Program, Need::Python];
    run("parameters_lay_down_what_peers_do_not_change", needs, |env| {
        let (from, cam, front) = (env.topic("from"), env.topic("cam"), env.topic("front"));
        let graph = env.graph()?;
        // Asks for reliable and gets nothing; a route that follows its peers would give in.
        let _strict = env.dds_subscriber(&front, STRING, "--transient-local")?;
        let routes = vec![
            Route::new(&zeromq("/in"), &ros2(&cam), STRING),
            Route::new(&ros2(&from), &zeromq("/out"), STRING).with("qos", "latched"),
        ];
        // By the name that the topic has after remapping.
        let publisher = format!("qos_overrides.{front}.publisher");
        let reliability = format!("{publisher}.reliability:=best_effort");
        let deadline = format!("{publisher}.deadline:=250000000");
        let depth = format!("qos_overrides.{from}.subscription.depth:=3");
        let durability = format!("qos_overrides.{from}.subscription.durability:=volatile");
        let remap = format!("{cam}:={front}");
        let node = env.node_with(
            routes,
            &["-r", &remap, "-p", &reliability, "-p", &deadline, "-p", &depth, "-p", &durability],
        )?;
        let has = |e: &Value| e["reliable"] == false && e["deadline_ms"] == 250.0;
        let writer = endpoint(&graph, "writer", &front, has).map_err(|e| e.context(node.tail()))?;
        // The rest follows the subscriber.
        endpoint(&graph, "writer", &front, |e| has(e) && e["durability"] == "TransientLocal")
            .map_err(|e| e.context(format!("{writer}\n{}", node.tail())))?;
        endpoint(&graph, "reader", &from, |e| {
            e["durability"] == "Volatile" && e["reliable"] == true
        })?;
        node.wait_until("the report", |output| {
            let words = "the parameters qos_overrides lay that down";
            has_logged(output, words).then_some(())
        })?;
        let request = format!(r#"{{"names": ["{publisher}.reliability", "{publisher}.depth"]}}"#);
        let endpoint = "ros2:/wrapyfi_bridge/get_parameters";
        let mut call =
            env.wrapyfi(["call", endpoint, "--value", &request, "--json", "--timeout", "60"])?;
        call.exits_with(0)?;
        let values = call.objects(1)?[0]["value"]["values"].clone();
        assert_eq!(values[0]["string_value"], "best_effort", "{values}");
        assert_eq!(values[1]["integer_value"], 10, "{values}");
        Ok(())
    })
}

#[test]
fn a_policy_that_there_is_not_ends_the_start() -> Result {
    run("a_policy_that_there_is_not_ends_the_start", &[Need::Program], |env| {
        let topic = env.topic("to");
        for (policy, value, said) in [
            ("reliabilty", "best_effort", "no policy \"reliabilty\" to override; it has"),
            ("reliability", "best", "policy reliability of the publisher of"),
            ("reliability", "best", "it can be system_default, reliable, best_effort"),
            ("depth", "-1", "an integer from 0"),
        ] {
            let parameter = format!("qos_overrides.{topic}.publisher.{policy}:={value}");
            let routes = vec![Route::new(&zeromq("/in"), &ros2(&topic), STRING)];
            let mut node = env.node_with(routes, &["-p", &parameter])?;
            node.exits_with(2)?;
            let text = node.stderr();
            assert!(text.contains(said) && text.contains(&topic), "{text}");
            let (name, _) = parameter.split_once(":=").unwrap_or_default();
            assert!(text.contains(name), "{text}");
        }
        Ok(())
    })
}

/// Numbers in the texts that a subscriber has heard.
fn numbers(messages: &[Value]) -> Vec<u64> {
    let texts = messages.iter().filter_map(|message| message["fields"]["data"].as_str());
    texts.filter_map(|text| text.parse().ok()).collect()
}

#[test]
fn a_late_subscriber_gets_the_history_of_a_source_that_keeps_one() -> Result {
    run("a_late_subscriber_gets_the_history_of_a_source_that_keeps_one", NEEDS, |env| {
        for (depth, kept) in [(50, 0..8), (3, 5..8), (1, 7..8)] {
            let topic = |name: &str| env.topic(&format!("{name}_{depth}"));
            let (from, to) = (topic("from"), topic("to"));
            // All is published before the bridge is there: it has what the publisher keeps.
            let _witness = env.dds_subscriber(&from, STRING, "--plain")?;
            let options = format!("--transient-local --depth {depth} --count 8 --text {{n}}");
            let publisher = env.dds_publisher(&from, STRING, &options)?;
            publisher.event("done")?;
            let count = kept.end - kept.start;
            let mut bridge = env.bridge_named(
                &format!("{depth}.yaml"),
                &env.embedded().route(Route::new(&ros2(&from), &ros2(&to), "Text")),
            )?;
            bridge.wait_until("the route to have carried all", |output| {
                let report = output.objects().rev().find(|it| it["routes"].is_array())?;
                (report["routes"][0]["counters"]["sent"] == count).then_some(())
            })?;
            let options = format!("--transient-local --depth 50 --plain --count {count}");
            let late = env.dds_subscriber(&to, STRING, &options)?;
            let heard = late.messages(usize::try_from(count)?);
            let heard = heard.map_err(|e| e.context(bridge.tail()))?;
            assert_eq!(numbers(&heard), kept.collect::<Vec<u64>>(), "depth {depth}");
            bridge.terminate()?;
            bridge.exits_with(0)?;
        }
        Ok(())
    })
}

#[test]
fn what_dds_loses_is_counted_and_shown() -> Result {
    run("what_dds_loses_is_counted_and_shown", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let route = Route::new(&ros2(&from), &zeromq(&to), "Text").with("qos", "sensor_data");
        let bridge = env.bridge(&env.embedded().route(route.with("queue_depth", "1000")))?;
        let endpoint = ros2(&from);
        let words = ["echo", &endpoint, "--qos", "sensor_data", "--count", "100"];
        let mut echo = env.wrapyfi([&words[..], &["--json", "--timeout", "110"]].concat())?;
        // One packet of ten, announcements among them, which are therefore repeated often.
        let options = "--best-effort --lose 100 --rate 100 --text {n}";
        let publisher = env.dds_publisher(&from, STRING, options)?;
        echo.exits_with(0).map_err(|e| e.context(publisher.tail()))?;
        let heard: Vec<u64> = echo
            .objects(100)?
            .iter()
            .filter_map(|object| object["value"]["data"].as_str()?.parse().ok())
            .collect();
        let missing = heard[99] + 1 - heard[0] - 100;
        assert!(missing > 0, "a peer that drops one packet of ten dropped none: {heard:?}");
        let said = echo.stderr();
        assert!(
            said.contains("messages were lost between their publisher and this node"),
            "{said}"
        );
        // A gap behind the last message that is printed may be seen before the end.
        let words = " messages dropped: lost_upstream";
        let counted =
            said.split_once(words).and_then(|(before, _)| before.split([' ', '\n']).next_back());
        let counted: Option<u64> = counted.and_then(|number| number.parse().ok());
        assert!(counted >= Some(missing), "{missing} missing: {said}");
        bridge.wait_until("the loss in the counters", |output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            let counters = &report["routes"][0]["counters"];
            counters["drops"]["lost_upstream"].as_u64().filter(|lost| *lost > 0)
        })?;
        let loss = "messages were lost between their publisher and this node";
        bridge.wait_until("the loss in the log", |output| has_logged(output, loss).then_some(()))
    })
}
