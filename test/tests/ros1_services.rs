//! Services of ROS 1 from the command line and on routes, against rospy, `rosservice` and Wrapyfi.

use serde_json::json;
use wrapyfi_e2e::{Result, Route, ros1, ros2, run, until_route};

use super::ros1::{NEEDS, WITH_WRAPYFI, tells, told};

/// A service of any type: `rosservice` calls ours, ours calls rospy's.
#[test]
fn services_of_any_type_go_both_ways() -> Result {
    run("services_of_any_type_go_both_ways", NEEDS, |env| {
        const SET: (&str, &str) =
            ("std_srvs/srv/SetBool.srv", "bool data\n---\nbool success\nstring message\n");
        let _roscore = env.roscore()?;
        let folder = env.definitions(&[SET])?;
        let (there, here) = (env.topic("there"), env.topic("here"));
        let peer = env.rospy(&format!("serve --topic {there}"), None)?;
        peer.event("ready")?;
        let call = |asked: &str, kind: &[&str]| {
            let endpoint = ros1(&there);
            let args = ["call", &endpoint, "--args", asked, "--timeout", "60", "--json"];
            let folder = ["--definitions", &folder];
            let mut call = env.wrapyfi([&args, &folder[..], kind].concat())?;
            let got = call.objects(1)?.remove(0);
            call.exits_with(0)?;
            Ok::<_, anyhow::Error>(got["value"].clone())
        };
        let kind = ["--type", "std_srvs/srv/SetBool"];
        assert_eq!(call("[true]", &kind)?, json!({"success": true, "message": "so be it"}));
        // The server is asked for its type.
        assert_eq!(call("[false]", &[])?, json!({"success": false, "message": "no"}));

        let endpoint = ros1(&here);
        let _server = env.wrapyfi([
            "serve",
            &endpoint,
            "--type",
            "std_srvs/srv/SetBool",
            "--definitions",
            &folder,
            "--value",
            r#"{"success": true, "message": "done"}"#,
            "--json",
        ])?;
        tells(env, "rosservice", "list", |said| said.contains(&here))?;
        let kind = told(env, "rosservice", &format!("type {here}"))?;
        assert_eq!(kind.trim(), "std_srvs/SetBool");
        let said = told(env, "rosservice", &format!("call {here} true"))?;
        assert!(said.contains("success: True") && said.contains("done"), "{said}");
        Ok(())
    })
}

/// The real Wrapyfi calls on rospy; `wrapyfi serve --echo` returns its argument.
#[test]
fn wrapyfi_is_served_by_us() -> Result {
    run("wrapyfi_is_served_by_us", WITH_WRAPYFI, |env| {
        let _roscore = env.roscore()?;
        let service = env.topic("x");
        let args = ["serve", &ros1(&service), "--type", "NativeObject", "--echo", "--json"];
        let server = env.wrapyfi(args)?;
        tells(env, "rosservice", "list", |said| said.contains(&service))?;
        let client = env.peer(
            "wrapyfi_peer.py",
            &format!("request --mware ros --topic {service} --flavour small --count 2"),
        )?;
        let got = client.messages(2)?;
        let asked = server.objects(2)?;
        assert_eq!(got.len(), asked.len());
        Ok(())
    })
}

/// The state of a route says what is wrong with the server of its service, also of one that was killed, which stays
/// registered; and the route recovers.
#[test]
fn a_server_of_another_type_and_one_that_was_killed_are_told() -> Result {
    run("a_server_of_another_type_and_one_that_was_killed_are_told", NEEDS, |env| {
        const SET: (&str, &str) =
            ("std_srvs/srv/SetBool.srv", "bool data\n---\nbool success\nstring message\n");
        let _roscore = env.roscore()?;
        env.definitions(&[SET])?;
        let name = env.topic("set");
        let route =
            Route::service(&ros1(&name), "zeromq:/set", "std_srvs/srv/SetBool").with("name", "set");
        let config = env.embedded().with("definitions", "[interfaces]").requests(env).route(route);
        let bridge = env.bridge(&config)?;
        let says = |words: [&'static str; 2]| {
            until_route(&bridge, "set", move |route| {
                let text = route.map(ToString::to_string).unwrap_or_default();
                !text.contains("\"state\":\"active\"") && words.iter().all(|it| text.contains(it))
            })
        };
        let is_active =
            || until_route(&bridge, "set", |route| route.is_some_and(|it| it["state"] == "active"));
        let args = format!("serve --topic {name} --node server");
        let mut wrong = env.rospy(&format!("{args} --type std_srvs/Empty"), Some("{}"))?;
        says(["is std_srvs/Empty", "wanted is std_srvs/SetBool"])?;
        let file = env.path("bridge.yaml").display().to_string();
        let mut why = env.wrapyfi(["why", "set", "--config", &file])?;
        why.exits_with(1)?;
        let (is, wants) = ("has type std_srvs/srv/Empty", "the route has std_srvs/srv/SetBool");
        let said = why.stdout();
        assert!(said.contains(is) && said.contains(wants), "{said}");
        wrong.kill()?;
        let mut right = env.rospy(&args, None)?;
        is_active()?;
        right.kill()?;
        says(["the server of", "does not answer"])?;
        assert!(env.ros_books()?.entries_of("/server") > 0, "the master forgot it");
        let _again = env.rospy(&args, None)?;
        is_active()
    })
}

/// A route without a type has that of the server that is there; one that has come back is not blamed for the one before.
#[test]
fn a_service_route_learns_the_type_of_the_server_that_comes_next() -> Result {
    run("a_service_route_learns_the_type_of_the_server_that_comes_next", NEEDS, |env| {
        const SET: (&str, &str) =
            ("std_srvs/srv/SetBool.srv", "bool data\n---\nbool success\nstring message\n");
        const EMPTY: (&str, &str) = ("std_srvs/srv/Empty.srv", "---\n");
        let _roscore = env.roscore()?;
        env.definitions(&[SET, EMPTY])?;
        let name = env.topic("set");
        let text = format!(
            "definitions: [interfaces]\nroutes:\n  - {{ name: set, service: '{}', as: '{}' }}\n",
            ros1(&name),
            ros2(&name)
        );
        let file = env.write("bridge.yaml", text)?.display().to_string();
        let bridge = env.wrapyfi(["bridge", "--config", &file, "--json"])?.pillar();
        let has = |kind: &str| {
            until_route(&bridge, "set", |route| {
                route.is_some_and(|it| it["type"] == kind && it["state"] == "active")
            })
        };
        let args = format!("serve --topic {name} --node server");
        let mut first = env.rospy(&args, None)?;
        has("std_srvs/srv/SetBool")?;
        first.kill()?;
        let _second = env.rospy(&format!("{args} --type std_srvs/Empty"), Some("{}"))?;
        has("std_srvs/srv/Empty")
    })
}
