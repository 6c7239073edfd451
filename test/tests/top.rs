//! `wrapyfi top`: the routes of a bridge that runs elsewhere on the graph.

use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, until_route, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
const NODE: &str = "/wrapyfi_bridge";

/// A bridge with a route that carries and one that waits for a publisher, and the ends of the first.
fn bridge(env: &TestEnv) -> Result<[Process; 3]> {
    let route = |name: &str| {
        let topic = env.topic(name);
        Route::new(&ros2(&topic), &zeromq(&topic), "Text").with("name", name)
    };
    let bridge = env.bridge(&env.embedded().route(route("talk")).route(route("waits")))?;
    until_route(&bridge, "talk", |route| route.is_some())?;
    let topic = env.topic("talk");
    let listener = env.wrapyfi(["echo", &zeromq(&topic), "--type", "NativeObject"])?;
    let talker = env.dds_publisher(&topic, "std_msgs/msg/String", "--text hello --rate 20")?;
    until_route(&bridge, "talk", |route| {
        route.is_some_and(|route| route["messages_per_s"].as_f64() > Some(10.0))
    })?;
    Ok([bridge, listener, talker])
}

/// Lines of one table that begin with the name of a route.
fn rows(env: &TestEnv, args: &[&str]) -> Result<Vec<Vec<String>>> {
    let mut top = env.wrapyfi(["top", "--once"].iter().chain(args))?;
    top.exits_with(0)?;
    let said = top.stdout();
    let named = said.lines().filter(|line| line.starts_with("talk") || line.starts_with("waits"));
    Ok(named.map(|line| line.split_whitespace().map(str::to_owned).collect()).collect())
}

#[test]
fn a_script_reads_one_table() -> Result {
    run("top_once", NEEDS, |env| {
        let _running = bridge(env)?;
        // Without a name, the only bridge that there is.
        for node in [&[][..], &[NODE]] {
            let rows = rows(env, node)?;
            assert_eq!(rows.len(), 2, "{rows:?}");
            assert_eq!(rows[0][..3], ["talk", "topic", "active"], "{rows:?}");
            assert!(rows[0][3].parse::<f64>()? > 1.0, "messages a second: {rows:?}");
            assert_eq!(rows[1][..4], ["waits", "topic", "waiting", "0.0"], "{rows:?}");
        }
        let sorted = rows(env, &["--sort", "state", "--filter", "zeromq:"])?;
        assert_eq!(sorted[0][0], "waits", "{sorted:?}");
        assert_eq!(rows(env, &["--filter", "WAITS"])?.len(), 1);
        let mut drawn = env.wrapyfi(["top"])?;
        drawn.exits_with(2)?;
        assert!(drawn.stderr().contains("--once"), "{}", drawn.stderr());
        let mut nobody = env.wrapyfi(["top", "/nobody", "--once"])?;
        nobody.exits_with(3)
    })
}

#[test]
fn a_terminal_shows_the_routes_until_q() -> Result {
    run("top_terminal", NEEDS, |env| {
        let _running = bridge(env)?;
        // `script` makes a terminal; what is drawn begins a line at each of its control sequences.
        let terminal = "set -o pipefail; export TERM=xterm; \
            script -qec \"stty rows 24 cols 100; exec $*\" /dev/null | stdbuf -o0 tr '\\033' '\\n'";
        let mut top = env.wrapyfi_by(terminal, &["top", NODE])?;
        let drawn = |words: &str| {
            top.wait_until(words, |output| {
                output.out.iter().any(|line| line.contains(words)).then_some(())
            })
        };
        // Word by word: blanks are not drawn on an empty screen.
        for word in ["routes,", "talk", "active", "waits", "waiting"] {
            drawn(word)?;
        }
        top.tell("q")?;
        top.exits_with(0)
    })
}

#[test]
fn two_bridges_of_one_node_name_are_told() -> Result {
    run("top_namesakes", &[Need::Program], |env| {
        let route = |name: &str| {
            let topic = env.topic(name);
            Route::new(&ros2(&topic), &zeromq(&topic), "Text").with("name", name)
        };
        let first = env.bridge_named("a.yaml", &env.embedded().route(route("one")))?;
        until_route(&first, "one", |route| route.is_some())?;
        let second = env.bridge_named("b.yaml", &env.foreign().route(route("two")))?;
        until_route(&second, "two", |route| route.is_some())?;
        let mut top = env.wrapyfi(["top", "--once"])?;
        top.exits_with(0)?;
        let said = top.stdout();
        assert!(said.contains("another bridge has the node name /wrapyfi_bridge"), "{said}");
        Ok(())
    })
}
