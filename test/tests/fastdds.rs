//! Our programs with a real Fast DDS at the other end: topics and the graph.

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use anyhow::bail;
use serde_json::{Value, json};
use wrapyfi_e2e::{
    Need, Output, Process, Result, Route, TIMEOUT, TestEnv, ros2, run, sha256, texts, zeromq,
};

pub(crate) const NEEDS: &[Need] = &[Need::Program, Need::FastDds];
pub(crate) const FAST: &str = "rmw_fastrtps_cpp";
pub(crate) const CYCLONE: &str = "rmw_cyclonedds_cpp";
const STRING: &str = "std_msgs/msg/String";
const STRING_HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
const IMAGE: &str = "sensor_msgs/msg/Image";
const IMAGE_HASH: &str = "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47";

/// CDR by hand, little endian: what is written begins at a multiple of its size after the header.
pub(crate) struct Cdr(pub(crate) Vec<u8>);

impl Cdr {
    pub(crate) fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn put(mut self, bytes: &[u8]) -> Self {
        while !(self.0.len() - 4).is_multiple_of(bytes.len()) {
            self.0.push(0);
        }
        self.0.extend(bytes);
        self
    }

    pub(crate) fn number(self, number: u32) -> Self {
        self.put(&number.to_le_bytes())
    }

    pub(crate) fn long(self, number: i64) -> Self {
        self.put(&number.to_le_bytes())
    }

    pub(crate) fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend(bytes);
        self
    }

    pub(crate) fn text(self, text: &str) -> Self {
        let bytes = [text.as_bytes(), &[0]].concat();
        self.number(u32::try_from(bytes.len()).unwrap_or(0)).bytes(&bytes)
    }

    pub(crate) fn hex(&self) -> String {
        self.0.iter().fold(String::new(), |mut text, byte| {
            // Writing to a String cannot fail.
            _ = write!(text, "{byte:02x}");
            text
        })
    }
}

pub(crate) fn unhex(text: &Value) -> Vec<u8> {
    let text = text.as_str().unwrap_or_default();
    (0..text.len() / 2)
        .filter_map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).ok())
        .collect()
}

/// Publishes again and again, until the other end has heard it, or where there is no `listener`, until the
/// sender has an answer: what is sent before the other end knows the sender is lost, on DDS as on a PUB
/// socket.
pub(crate) fn told_until<T>(
    publisher: &mut Process,
    message: &Cdr,
    listener: Option<&Process>,
    heard: impl Fn(&Output) -> Option<T>,
) -> Result<T> {
    let sent = |output: &Output| Some(output.events("sent").len());
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let before = publisher.wait_until("a number", sent)?;
        publisher.tell(&message.hex())?;
        publisher.wait_until("it to be sent", |o| sent(o).filter(|sent| *sent > before))?;
        let ear = listener.unwrap_or(publisher);
        if let Some(found) = ear.wait_until("a message or nothing", |o| Some(heard(o)))? {
            return Ok(found);
        }
        if Instant::now() > deadline {
            bail!("it is not heard\n{}\n{}", publisher.tail(), ear.tail());
        }
        std::thread::sleep(Duration::from_millis(20)); // the rate
    }
}

/// A red frame, three bytes a pixel.
fn red(encoding: &str) -> Cdr {
    let data = if encoding == "rgb8" { [255, 0, 0] } else { [0, 0, 255] }.repeat(64 * 48);
    Cdr::new()
        .number(7)
        .number(8)
        .text("camera")
        .number(48)
        .number(64)
        .text(encoding)
        .bytes(&[0])
        .number(64 * 3)
        .number(64 * 48 * 3)
        .bytes(&data)
}

/// Definitions of packages that are installed nowhere here.
pub(crate) const DEFINITIONS: &[(&str, &str)] = &[
    ("example_interfaces/srv/AddTwoInts.srv", "int64 a\nint64 b\n---\nint64 sum\n"),
    ("demo/msg/Pair.msg", "float64 a\nstring b\n"),
];

// Topics ----------------------------------------------------------------------------------------

#[test]
fn fast_dds_hears_what_we_publish() -> Result {
    run("fast_dds_hears_what_we_publish", NEEDS, |env| {
        let topic = env.topic("text");
        let subscriber = env.fast_peer(&format!(
            "subscribe --topic {topic} --type demo/msg/Pair --cdr --count 3"
        ))?;
        let folder = env.definitions(DEFINITIONS)?;
        let words = ["pub", &ros2(&topic), "--type", "demo/msg/Pair", "--definitions", &folder];
        let value = ["--value", r#"{"a": -1.25, "b": "grüß"}"#, "--rate", "20"];
        let publisher = env.wrapyfi([&words[..], &value].concat())?;
        let expected = Cdr::new().put(&(-1.25_f64).to_le_bytes()).text("grüß").hex();
        let heard = subscriber.messages(3).map_err(|e| e.context(publisher.tail()))?;
        // Cyclone fills the last word with zeros.
        for found in texts(&heard, "cdr") {
            assert_eq!(found.strip_prefix(&expected).map(|rest| rest.trim_matches('0')), Some(""));
        }
        Ok(())
    })
}

#[test]
fn we_hear_what_fast_dds_publishes() -> Result {
    run("we_hear_what_fast_dds_publishes", NEEDS, |env| {
        let topic = env.topic("text");
        let words = ["echo", &ros2(&topic), "--type", STRING, "--json"];
        let echo = env.wrapyfi(words)?;
        let mut publisher = env
            .fast_peer(&format!("publish --topic {topic} --type {STRING} --hash {STRING_HASH}"))?;
        publisher.event("matched").map_err(|e| e.context(echo.tail()))?;
        // Text that is JSON, as Wrapyfi's is.
        for text in [json!([1]), json!("два")] {
            told_until(
                &mut publisher,
                &Cdr::new().text(&text.to_string()),
                Some(&echo),
                |output| output.objects().any(|object| object["value"] == text).then_some(()),
            )?;
        }
        assert!(!echo.stderr().contains("another definition"), "{}", echo.stderr());
        Ok(())
    })
}

#[test]
fn a_late_node_on_fast_dds_gets_the_history_of_another() -> Result {
    run("a_late_node_on_fast_dds_gets_the_history_of_another", NEEDS, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let kind = format!("--type {STRING} --hash {STRING_HASH} --transient-local");
        let mut publisher = env.fast_peer(&format!("publish --topic {from} {kind}"))?;
        let messages = ["one", "two", "three"].map(|text| Cdr::new().text(text).hex());
        for message in &messages {
            publisher.tell(message)?;
        }
        publisher.wait_until("three messages sent", |output| {
            (output.events("sent").len() == 3).then_some(())
        })?;
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&ros2(&from), &ros2(&to), "Text")))?;
        bridge.wait_until("the route to have carried all", |output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            (report["routes"][0]["counters"]["sent"] == 3).then_some(())
        })?;
        let late = env.fast_peer(&format!("subscribe --topic {to} {kind} --cdr --count 3"))?;
        let heard = late.messages(3).map_err(|e| e.context(bridge.tail()))?;
        for (found, message) in texts(&heard, "cdr").iter().zip(&messages) {
            // Cyclone fills the last word with zeros.
            assert_eq!(found.strip_prefix(message).map(|rest| rest.trim_matches('0')), Some(""));
        }
        Ok(())
    })
}

#[test]
fn images_of_wrapyfi_reach_fast_dds_through_the_bridge() -> Result {
    let needs = [NEEDS, &[Need::Python]].concat();
    run("images_of_wrapyfi_reach_fast_dds_through_the_bridge", &needs, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&zeromq(&from), &ros2(&to), "Image")))?;
        let subscriber =
            env.fast_peer(&format!("subscribe --topic {to} --type {IMAGE} --cdr --count 2"))?;
        let publisher =
            env.wrapyfi_publisher(&from, "--type Image --flavour colour --no-broker")?;
        let heard = subscriber.messages(2).map_err(|e| e.context(bridge.tail()))?;
        // The pixels are the last bytes.
        let pixels = |message: &Value| {
            let cdr = unhex(&message["cdr"]);
            sha256(&cdr[cdr.len() - 64 * 48 * 3..])
        };
        publisher.sent_in_a_row("sha256", &heard.iter().map(pixels).collect::<Vec<_>>())
    })
}

#[test]
fn images_of_fast_dds_reach_wrapyfi_through_the_bridge() -> Result {
    let needs = [NEEDS, &[Need::Python]].concat();
    run("images_of_fast_dds_reach_wrapyfi_through_the_bridge", &needs, |env| {
        let (from, to) = (env.topic("from"), env.topic("to"));
        let bridge =
            env.bridge(&env.embedded().route(Route::new(&ros2(&from), &zeromq(&to), "Image")))?;
        let listener = env.wrapyfi_listener(&to, "--type Image --flavour red --count 1")?;
        let mut publisher = env.fast_peer(&format!("publish --topic {from} --type {IMAGE}"))?;
        publisher.event("matched").map_err(|e| e.context(bridge.tail()))?;
        let heard = told_until(&mut publisher, &red("rgb8"), Some(&listener), |output| {
            output.events("message").into_iter().next()
        })?;
        let pixels = sha256(&[0, 0, 255].repeat(64 * 48));
        assert_eq!(heard["sha256"], pixels, "{heard}");
        Ok(())
    })
}

// The graph -------------------------------------------------------------------------------------

#[test]
fn fast_dds_sees_our_node_its_types_and_its_end() -> Result {
    run("fast_dds_sees_our_node_its_types_and_its_end", NEEDS, |env| {
        let (there, back) = (env.topic("there"), env.topic("back"));
        let graph = env.fast_peer("graph")?;
        graph.event("ready")?;
        let config = env
            .embedded()
            .route(Route::new("zeromq:/a", &ros2(&there), "Image"))
            .route(Route::new(&ros2(&back), "zeromq:/b", STRING));
        let mut bridge = env.bridge(&config)?;
        let mut guids = Vec::new();
        for (role, list, topic, kind, hash) in [
            ("writer", "writers", &there, "sensor_msgs::msg::dds_::Image_", IMAGE_HASH),
            ("reader", "readers", &back, "std_msgs::msg::dds_::String_", STRING_HASH),
        ] {
            let name = format!("rt{topic}");
            let (found, node) = graph
                .wait_until(&format!("the {role} and its node"), |output| {
                    let mut all = output.events("endpoint").into_iter();
                    let found = all.find(|e| e["topic"] == *name && e["role"] == role)?;
                    let told = output.events("nodes");
                    let mut nodes =
                        told.iter().flat_map(|t| t["nodes"].as_array().into_iter().flatten());
                    let owns = |node: &&Value| {
                        node[list].as_array().is_some_and(|l| l.contains(&found["guid"]))
                    };
                    let node = nodes.find(owns)?.clone();
                    Some((found, node))
                })
                .map_err(|e| e.context(bridge.tail()))?;
            assert_eq!(found["type"], kind, "{found}");
            assert_eq!(found["hash"], hash, "{found}");
            assert_eq!(found["reliable"], true, "{found}");
            assert_eq!(node["name"], "/wrapyfi_bridge", "{node}");
            guids.push(found["guid"].clone());
        }
        let participant = graph.wait_until("the participant", |output| {
            output.events("participant").into_iter().next()
        })?;
        assert_eq!(participant["user_data"], "enclave=/;");
        bridge.terminate()?;
        bridge.exits_with(0)?;
        // A node that goes is gone at once, because it says so: a lease would end 10 s later. And
        // the last word of its process names no node.
        graph.wait_until("the end of both", |output| {
            let gone = output.events("gone");
            let all = guids.iter().all(|guid| gone.iter().any(|one| one["guid"] == *guid));
            let last = output.events("nodes").pop()?;
            (all && last["nodes"] == json!([])).then_some(())
        })
    })
}

/// Fast DDS tells a new reader the names of its nodes once, mostly too early, and then every 3 s.
#[test]
fn the_name_of_a_node_on_fast_dds_is_there_at_once() -> Result {
    run("the_name_of_a_node_on_fast_dds_is_there_at_once", NEEDS, |env| {
        let topic = env.topic("cam");
        let subscribe = format!("subscribe --topic {topic} --type {IMAGE} --hash {IMAGE_HASH}");
        let peer = env.fast_peer(&format!("{subscribe} --node /lab/viewer"))?;
        peer.event("ready")?;
        for _ in 0..5 {
            let mut list = env.wrapyfi(["list", "ros2", "--json"])?;
            list.exits_with(0)?;
            let found = list.wait_until("the topic", |output| {
                output.objects().find(|one| one["name"] == *topic)
            })?;
            assert_eq!(found["node"], "/lab/viewer", "{found}");
        }
        Ok(())
    })
}

/// Lists until `wanted` is satisfied: discovery takes as long as it takes.
fn list(env: &TestEnv, wanted: impl Fn(&[Value]) -> bool) -> Result<Vec<Value>> {
    let mut last = Vec::new();
    for _ in 0..20 {
        let mut list = env.wrapyfi(["list", "ros2", "--json", "--wait", "3"])?;
        list.exits_with(0)?;
        last = list.wait_until("its output", |output| Some(output.objects().collect()))?;
        if wanted(&last) {
            return Ok(last);
        }
    }
    anyhow::bail!("what was wanted is not among {last:#?}")
}

#[test]
fn list_shows_a_node_on_fast_dds_until_it_goes() -> Result {
    run("list_shows_a_node_on_fast_dds_until_it_goes", NEEDS, |env| {
        let topic = env.topic("cam");
        let mut peer = env.fast_peer(&format!(
            "subscribe --topic {topic} --type {IMAGE} --hash {IMAGE_HASH} --best-effort \
             --node /lab/viewer"
        ))?;
        peer.event("ready")?;
        let find = |found: &[Value]| found.iter().find(|one| one["name"] == *topic).cloned();
        let named = |found: &[Value]| find(found).is_some_and(|one| one["node"] == "/lab/viewer");
        let found = find(&list(env, named)?).unwrap_or_default();
        assert_eq!((&found["role"], &found["type"]), (&json!("listener"), &json!(IMAGE)));
        assert_eq!(found["type_hash"], IMAGE_HASH);
        assert_eq!(found["qos"]["reliability"], "best_effort");
        assert_eq!(found["qos"]["durability"], "volatile");
        peer.close_stdin();
        peer.exits_with(0)?;
        list(env, |found| find(found).is_none()).map(drop)
    })
}

// Large messages --------------------------------------------------------------------------------

/// Starts `wrapyfi pub` of a message of `bytes` on a topic, `rate` times a second.
fn publish_large(env: &TestEnv, topic: &str, bytes: usize, rate: &str) -> Result<Process> {
    let value = json!({"a": 1.0, "b": "x".repeat(bytes)}).to_string();
    let name = format!("{bytes}.json");
    let (file, folder) = (env.write(&name, value)?, env.definitions(DEFINITIONS)?);
    let words = ["pub", &ros2(topic), "--type", "demo/msg/Pair", "--definitions", &folder];
    let more = ["--file", &file.display().to_string(), "--rate", rate];
    env.wrapyfi([&words[..], &more].concat())
}

/// Waits for a line of the log that has all these words.
fn warns(program: &Process, words: &[&str]) -> Result {
    program.wait_until("the warning", |output| {
        let has_all = |line: &String| words.iter().all(|word| line.contains(word));
        output.err.iter().any(has_all).then_some(())
    })
}

/// A message of 0.9 MB has fifteen fragments and one of 6.2 MB a hundred, and the socket of a Fast DDS node holds
/// three: the next one is not begun before the reader has all of them.
#[test]
fn large_messages_reach_fast_dds_without_a_gap() -> Result {
    run("large_messages_reach_fast_dds_without_a_gap", NEEDS, |env| {
        for (bytes, messages) in [(921_600, 30), (6_220_800, 6)] {
            let topic = env.topic(&format!("big_{bytes}"));
            // A reader on a busy machine may come late to take what has arrived.
            let subscribe = format!("subscribe --topic {topic} --type demo/msg/Pair --depth 50");
            let subscriber = env.fast_peer(&format!("{subscribe} --node /lab/viewer"))?;
            let publisher = publish_large(env, &topic, bytes, "30")?;
            let heard = subscriber
                .wait_until("its messages", |output| {
                    let all = output.events("message");
                    (all.len() >= messages).then_some(all)
                })
                .map_err(|e| e.context(publisher.tail()))?;
            let numbers: Vec<_> = heard.iter().filter_map(|one| one["number"].as_u64()).collect();
            assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{numbers:?}");
            let size = u64::try_from(bytes)?;
            assert!(heard.iter().all(|one| one["bytes"].as_u64() >= Some(size)), "{:?}", heard[0]);
        }
        Ok(())
    })
}

#[test]
fn a_best_effort_reader_on_fast_dds_is_named() -> Result {
    run("a_best_effort_reader_on_fast_dds_is_named", NEEDS, |env| {
        let topic = env.topic("big");
        let subscribe = format!("subscribe --topic {topic} --type demo/msg/Pair --best-effort");
        let _subscriber = env.fast_peer(&format!("{subscribe} --node /lab/viewer"))?;
        let publisher = publish_large(env, &topic, 921_600, "10")?;
        warns(&publisher, &["/lab/viewer on ", "are lost to it", "net.core.rmem_default="])
    })
}

/// A reader that stands still holds up large messages, which is said and counted, and is waited for no longer
/// than it takes: the others on the topic get some.
#[test]
fn a_reader_on_fast_dds_that_stands_still_is_named_and_what_it_costs_is_counted() -> Result {
    let needs = [NEEDS, &[Need::Python]].concat();
    let name = "a_reader_on_fast_dds_that_stands_still_is_named_and_what_it_costs_is_counted";
    run(name, &needs, |env| {
        let (from, topic) = (env.topic("from"), env.topic("big"));
        let route = Route::new(&zeromq(&from), &ros2(&topic), STRING);
        let bridge = env.bridge(&env.embedded().route(route))?;
        let subscribe = format!("subscribe --topic {topic} --type {STRING} --node /lab/viewer");
        let viewer = env.fast_peer(&subscribe)?;
        let other = env.dds_subscriber(&topic, STRING, "--plain")?;
        let file = env.write("big.json", json!("x".repeat(400_000)).to_string())?;
        let words = ["pub", &zeromq(&from), "--type", "NativeObject", "--rate", "20", "--file"];
        let _source = env.wrapyfi([&words[..], &[&file.display().to_string()]].concat())?;
        let first = |output: &Output| output.events("message").into_iter().next();
        viewer.wait_until("a message", first).map_err(|e| e.context(bridge.tail()))?;
        other.wait_until("a message", first).map_err(|e| e.context(bridge.tail()))?;
        viewer.pause()?;
        let report = |output: &Output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            Some(report["routes"][0].clone())
        };
        let told = bridge.wait_until("the reason and the drops", |output| {
            let route = report(output)?;
            let drops = route["counters"]["drops"].as_object()?;
            let lost = ["queue_full", "send_queue_full"].iter().any(|why| drops.contains_key(*why));
            let said = route["reason"].as_str()?.to_owned();
            (lost && route["state"] == "degraded" && said.contains("Fast DDS")).then_some(said)
        })?;
        assert!(told.contains("net.core.rmem_default="), "{told}");
        let before = other.wait_until("a number", |output| Some(output.events("message").len()))?;
        other.wait_until("more at the other reader", |output| {
            (output.events("message").len() > before + 2).then_some(())
        })?;
        viewer.resume()?;
        let before = viewer.wait_until("a number", |o| Some(o.events("message").len()))?;
        viewer.wait_until("more at the reader", |output| {
            (output.events("message").len() > before + 10).then_some(())
        })?;
        bridge.wait_until("the end of the trouble", |output| {
            (report(output)?["state"] == "active").then_some(())
        })
    })
}

/// A reader that was killed is known until its lease ends, after 20 s: the others wait for it once.
#[test]
fn a_reader_on_fast_dds_that_was_killed_does_not_hold_up_the_others() -> Result {
    run("a_reader_on_fast_dds_that_was_killed_does_not_hold_up_the_others", NEEDS, |env| {
        let (from, topic) = (env.topic("from"), env.topic("big"));
        let route = Route::new(&zeromq(&from), &ros2(&topic), STRING);
        let bridge = env.bridge(&env.embedded().route(route))?;
        let subscribe = |node: &str| {
            env.fast_peer(&format!("subscribe --topic {topic} --type {STRING} --node /lab/{node}"))
        };
        let (mut killed, other) = (subscribe("killed")?, subscribe("other")?);
        let file = env.write("big.json", json!("x".repeat(300_000)).to_string())?;
        let words = ["pub", &zeromq(&from), "--type", "NativeObject", "--rate", "10", "--file"];
        let _source = env.wrapyfi([&words[..], &[&file.display().to_string()]].concat())?;
        let count = |output: &Output| output.events("message").len();
        // At ten a second, the killed one lives for two of the announcements that Fast DDS makes every three seconds: the
        // name of a node that dies before cannot be known.
        for reader in [&killed, &other] {
            let some = |output: &Output| (count(output) > 70).then_some(());
            reader.wait_until("messages", some).map_err(|e| e.context(bridge.tail()))?;
        }
        killed.kill()?;
        let (begin, before) = (Instant::now(), other.wait_until("a number", |o| Some(count(o)))?);
        other.wait_until("more at the other reader", |output| {
            (count(output) > before + 50).then_some(())
        })?;
        // At two a second, as where each message waits for the dead one, it would be 20 s.
        assert!(begin.elapsed() < Duration::from_secs(14), "{:?}", begin.elapsed());
        bridge.wait_until("the name of the dead one", |output| {
            let report = output.objects().rev().find(|it| it["routes"].is_array())?;
            let route = &report["routes"][0];
            let said = route["reason"].as_str()?;
            let is_it = said.contains("/lab/killed") && said.contains("acknowledges nothing");
            (route["state"] == "degraded" && is_it).then_some(())
        })
    })
}

/// Readers on CycloneDDS wait for no other reader.
#[test]
fn large_messages_to_cyclonedds_are_not_held_up() -> Result {
    let needs = [NEEDS, &[Need::Python]].concat();
    run("large_messages_to_cyclonedds_are_not_held_up", &needs, |env| {
        let (topic, other) = (env.topic("big"), env.topic("other"));
        let elsewhere = env.fast_peer(&format!("subscribe --topic {other} --type {STRING}"))?;
        elsewhere.event("ready")?;
        let file = env.write("big.json", json!("x".repeat(400_000)).to_string())?;
        let words = ["pub", &ros2(&topic), "--type", STRING, "--rate", "20", "--file"];
        let publisher = env.wrapyfi([&words[..], &[&file.display().to_string()]].concat())?;
        let subscriber = env.dds_subscriber(&topic, STRING, "--count 40")?;
        subscriber.messages(40).map_err(|e| e.context(publisher.tail()))?;
        assert!(!publisher.stderr().contains("Fast DDS"), "{}", publisher.stderr());
        Ok(())
    })
}
