//! Configurations that `wrapyfi check` accepts, warns of or refuses.

use std::path::Path;

use wrapyfi_e2e::{Result, Route, TestEnv, run};

use super::cli::{PROGRAM, complains, hold};

#[test]
fn every_configuration_that_comes_with_it_is_valid() -> Result {
    run("every_configuration_that_comes_with_it_is_valid", PROGRAM, |env| {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config");
        let mut count = 0;
        for entry in std::fs::read_dir(folder)? {
            let file = entry?.path();
            let mut check = env.wrapyfi(["check", &file.display().to_string()])?;
            check.exits_with(0)?;
            assert!(check.stdout().contains(" -> "), "{}: {}", file.display(), check.stdout());
            count += 1;
        }
        assert!(count >= 4, "{count} files in config/");
        Ok(())
    })
}

/// A configuration that must be refused, the line of the fault, and words of the complaint.
struct Bad {
    text: String,
    line: usize,
    words: &'static [&'static str],
}

/// The first line of `text` that contains `what`, counted from 1.
fn bad(text: &str, what: &str, words: &'static [&'static str]) -> Bad {
    let line = text.lines().position(|l| l.contains(what)).map_or(0, |index| index + 1);
    Bad { text: text.to_owned(), line, words }
}

fn bad_configurations(env: &TestEnv) -> Vec<Bad> {
    let good = env.embedded().route(Route::new("zeromq:/a", "ros2:/a", "Image")).yaml();
    let changed = |from: &str, to: &str, words| bad(&good.replace(from, to), to, words);
    vec![
        changed("    type:", "    typ:", &["typ", "type"]),
        changed("\"Image\"", "\"Imag\"", &["Imag", "Image"]),
        changed("\"Image\"", "\"sensor_msgs/msg/Imagee\"", &["sensor_msgs/msg/Image"]),
        changed("    pub_port:", "    pub_prot:", &["pub_prot", "pub_port"]),
        changed("routes:", "rotes:", &["rotes", "routes"]),
        changed("broker: embedded", "broker: embeded", &["embeded", "embedded"]),
        changed("zeromq:/a", "zeromqq:/a", &["zeromqq", "zeromq"]),
        changed("zeromq:/a", "nothing", &["nothing"]),
        changed("ros2:/a", "ros2:/a b", &["/a b"]),
        changed("zeromq:/a", "zeromq:/cam/*", &["write (.*) for any text"]),
        changed(&format!("pub_port: {}", env.pub_port()), "pub_port: 70000", &["70000"]),
        changed("    type:", "    queue_dept: 3\n    type:", &["queue_depth"]).at("queue_dept:"),
        changed("    type:", "    queue_depth: many\n    type:", &["queue_depth"])
            .at("queue_depth:"),
        changed("ip: 127.0.0.1", "ip: 0.0.0.0", &["0.0.0.0", "insecure"]),
    ]
}

impl Bad {
    fn at(mut self, what: &str) -> Self {
        self.line = self.text.lines().position(|l| l.contains(what)).map_or(0, |index| index + 1);
        self
    }
}

#[test]
fn bad_configurations_are_refused_with_line_and_suggestion() -> Result {
    run("bad_configurations_are_refused_with_line_and_suggestion", PROGRAM, |env| {
        for Bad { text, line, words } in bad_configurations(env) {
            let file = env.write("bad.yaml", &text)?.display().to_string();
            let mut check = env.wrapyfi(["check", &file])?;
            complains(&mut check, &[2], words).map_err(|e| e.context(text.clone()))?;
            let said = check.stderr();
            let names_line =
                said.contains(&format!(":{line}")) || said.contains(&format!("line {line}"));
            assert!(names_line, "line {line} is not named:\n{said}\n{text}");
            assert!(said.contains("bad.yaml"), "the file is not named:\n{said}");
        }
        Ok(())
    })
}

#[test]
fn a_bridge_refuses_what_check_refuses() -> Result {
    run("a_bridge_refuses_what_check_refuses", PROGRAM, |env| {
        for Bad { text, words, .. } in bad_configurations(env).into_iter().take(3) {
            let file = env.write("bad.yaml", &text)?.display().to_string();
            complains(&mut env.wrapyfi(["bridge", "--config", &file])?, &[2], words)?;
        }
        Ok(())
    })
}

#[test]
fn text_that_is_no_yaml_is_refused() -> Result {
    run("text_that_is_no_yaml_is_refused", PROGRAM, |env| {
        for text in
            ["routes: [", "- just\n- a list\n", "routes: {}\n", "\u{0}\u{1}", "a: &a [*a]\n"]
        {
            let file = env.write("bad.yaml", text)?.display().to_string();
            complains(&mut env.wrapyfi(["check", &file])?, &[2], &["bad.yaml"])?;
        }
        Ok(())
    })
}

#[test]
fn check_prints_the_plan() -> Result {
    run("check_prints_the_plan", PROGRAM, |env| {
        let config = env
            .embedded()
            .route(Route::new("zeromq:/camera/left", "ros2:/left/image_raw", "Image"))
            .route(Route::new("ros2:/chatter", "zeromq:/words", "std_msgs/msg/String"));
        let file = env.write("good.yaml", config.yaml())?.display().to_string();
        let mut check = env.wrapyfi(["check", &file])?;
        check.exits_with(0)?;
        let plan = check.stdout();
        for endpoint in
            ["zeromq:/camera/left", "ros2:/left/image_raw", "ros2:/chatter", "zeromq:/words"]
        {
            assert!(plan.contains(endpoint), "the plan does not name {endpoint}:\n{plan}");
        }
        // It runs nothing: the broker's ports are free all the time.
        let _free = (hold(env.pub_port())?, hold(env.sub_port())?);
        env.wrapyfi(["check", &file])?.exits_with(0)
    })
}

#[test]
fn configurations_that_the_pages_show_are_valid() -> Result {
    run("configurations_that_the_pages_show_are_valid", PROGRAM, |env| {
        let mut count = 0;
        for folder in ["", "docs", "docs/reference"] {
            for entry in std::fs::read_dir(wrapyfi_e2e::repository().join(folder))? {
                let page = entry?.path();
                if page.extension().is_none_or(|kind| kind != "md") {
                    continue;
                }
                let text = std::fs::read_to_string(&page)?;
                for block in
                    text.split("```yaml\n").skip(1).filter_map(|rest| rest.split("```").next())
                {
                    if block.starts_with("routes:") {
                        let file = env.write("shown.yaml", block)?.display().to_string();
                        let mut check = env.wrapyfi(["check", &file])?;
                        let code = check.exit_code()?;
                        assert_eq!(code, 0, "{}:\n{block}\n{}", page.display(), check.stderr());
                        count += 1;
                    }
                }
            }
        }
        assert!(count >= 5, "{count} configurations in the pages");
        Ok(())
    })
}

#[test]
fn check_warns_of_routes_that_do_not_hear_each_other() -> Result {
    run("check_warns_of_routes_that_do_not_hear_each_other", PROGRAM, |env| {
        let config = env
            .embedded()
            .route(Route::new("zeromq:/a", "ros2:middle", "Text"))
            .route(Route::new("ros2:/middle", "zeromq:/b", "Text"));
        let file = env.write("chain.yaml", config.yaml())?.display().to_string();
        let words = "does not hear what route \"zeromq:/a -> ros2:middle\" publishes on ros2:/middle: \
                     a bridge ignores its own publications; write a route from zeromq:/a to zeromq:/b";
        let text = config.yaml();
        let first = text.lines().position(|line| line.contains("zeromq:/a")).unwrap() + 1;
        let second = text.lines().position(|line| line.contains("ros2:/middle")).unwrap() + 1;
        let lines = format!("lines {first} and {second}: route ");
        complains(&mut env.wrapyfi(["check", &file])?, &[0], &[words, &lines])?;
        let bridge = env.bridge(&config)?;
        bridge.wait_until("the warning", |output| {
            output.err.iter().any(|line| line.contains(words)).then_some(())
        })
    })
}

#[test]
fn check_warns_of_routes_in_a_circle() -> Result {
    run("check_warns_of_routes_in_a_circle", PROGRAM, |env| {
        let text = "routes:\n  - { from: 'zeromq:/x', to: 'ros2:x', type: Text }\n\
                    \x20 - { from: 'zeromq:/y', to: 'ros2:y', type: Text }\n\
                    \x20 - { from: 'ros2:/x', to: 'zeromq:/x', type: Text }\n";
        let file = env.write("circle.yaml", text)?.display().to_string();
        let words =
            "lines 2 and 4: the routes lead in a circle, zeromq:/x -> ros2:/x -> zeromq:/x: ";
        complains(&mut env.wrapyfi(["check", &file])?, &[0], &[words])?;
        let file = env.write("chain.yaml", text.replace("to: 'zeromq:/x'", "to: 'zeromq:/z'"))?;
        let mut check = env.wrapyfi(["check", &file.display().to_string()])?;
        check.exits_with(0)?;
        assert!(!check.stderr().contains("circle"), "{}", check.stderr());
        Ok(())
    })
}
