//! Keys, types and commands that the program has are in the example and in the reference.

use std::collections::BTreeSet;

use anyhow::Context as _;
use wrapyfi_e2e::{Result, TestEnv, repository, run};

use super::cli::PROGRAM;

fn read(path: &str) -> Result<String> {
    std::fs::read_to_string(repository().join(path)).with_context(|| format!("reading {path}"))
}

/// Words between `before` and the next `after` in what `wrapyfi check` says of a configuration.
fn complaint(env: &TestEnv, text: &str, before: &str, after: &str) -> Result<BTreeSet<String>> {
    let file = env.write("bad.yaml", text)?.display().to_string();
    let mut check = env.wrapyfi(["check", &file])?;
    check.exits_with(2)?;
    let said = check.stderr();
    let rest = said.split_once(before).with_context(|| said.clone())?.1;
    let words = rest.split_once(after).with_context(|| said.clone())?.0;
    Ok(words.split(", ").map(str::to_owned).collect())
}

#[test]
fn every_key_is_in_the_example() -> Result {
    run("every_key_is_in_the_example", PROGRAM, |env| {
        let example = read("config/example.yaml")?;
        let words: BTreeSet<&str> = example
            .split(|c: char| !(c.is_ascii_alphanumeric() || "_:".contains(c)))
            .filter_map(|word| word.strip_suffix(':'))
            .collect();
        let middlewares = complaint(env, "endpoints: { nope: 1 }", "keys here: ", ", in `")?;
        let sections =
            middlewares.iter().map(|name| format!("endpoints: {{ {name}: {{ nope: 1 }} }}"));
        let others = [
            "nope: 1",
            "defaults: { nope: 1 }",
            "endpoints: { yarp: { types: [{ nope: 1 }] } }",
            "endpoints: { zeromq: { curve: { nope: 1 } } }",
            "limits: { nope: 1 }",
            "page: { nope: 1 }",
            "routes: [{ nope: 1 }]",
            "routes: [{ qos: { nope: 1 } }]",
        ];
        let mut keys = middlewares.clone();
        for text in sections.chain(others.map(str::to_owned)) {
            keys.extend(complaint(env, &text, "keys here: ", ", in `")?);
        }
        assert!(keys.len() > 60, "{keys:?}");
        let missing: Vec<_> = keys.iter().filter(|key| !words.contains(key.as_str())).collect();
        assert!(missing.is_empty(), "config/example.yaml lacks {missing:?}");
        Ok(())
    })
}

#[test]
fn every_type_is_in_the_example() -> Result {
    run("every_type_is_in_the_example", PROGRAM, |env| {
        let route = "routes: [{ from: 'zeromq:/a', to: 'ros2:/a', type: Nope }]";
        let types = complaint(env, route, "accepted are ", ", and every")?;
        assert!(types.len() > 8, "{types:?}");
        let example = read("config/example.yaml")?;
        let missing: Vec<_> =
            types.iter().filter(|name| !example.contains(name.as_str())).collect();
        assert!(missing.is_empty(), "config/example.yaml lacks {missing:?}");
        Ok(())
    })
}

#[test]
fn every_command_is_in_the_reference() -> Result {
    run("every_command_is_in_the_reference", PROGRAM, |env| {
        let mut help = env.wrapyfi(["--help"])?;
        help.exits_with(0)?;
        let help = help.stdout();
        let list = help.split_once("Commands:\n").context("no commands")?.1;
        let list = list.split_once("\n\n").context("no end of the commands")?.0;
        // A name stands two spaces from the edge, what continues the line above stands further in.
        let names = list.lines().filter_map(|line| line.strip_prefix("  "));
        let names = names.filter(|line| !line.starts_with(' ') && !line.starts_with("help "));
        let names: Vec<&str> = names.filter_map(|line| line.split(' ').next()).collect();
        assert!(names.len() > 10, "{names:?}");
        let page = read("docs/reference/command-line.md")?;
        let is_there = |name: &str| {
            let start = format!("`wrapyfi {name}");
            page.split(&start).skip(1).any(|rest| rest.starts_with(['`', ' ']))
        };
        let missing: Vec<_> = names.iter().filter(|name| !is_there(name)).collect();
        assert!(missing.is_empty(), "docs/reference/command-line.md lacks {missing:?}");
        Ok(())
    })
}

/// `bloom` reads the changelog of a package as reStructuredText with a list below each version.
#[test]
fn the_changelog_has_a_form_for_the_tools_of_ros() -> Result {
    run("the_changelog_has_a_form_for_the_tools_of_ros", PROGRAM, |env| {
        let script = repository().join("scripts/changelog.py");
        let mut made = env.shell(&format!("python3 {} wrapyfi_bridge", script.display()))?;
        made.exits_with(0)?;
        let text = made.stdout();
        let mut lines = text.lines();
        let title = "Changelog for package wrapyfi_bridge";
        let line = "^".repeat(title.len());
        assert_eq!(
            [lines.next(), lines.next(), lines.next()],
            [Some(&*line), Some(title), Some(&*line)]
        );
        let items = text.lines().filter(|line| line.starts_with("* ")).count();
        let written = read("CHANGELOG.md")?;
        assert_eq!(items, written.lines().filter(|line| line.starts_with("- ")).count());
        assert!(!text.contains("]("), "links are words: {text}");
        Ok(())
    })
}
