//! A bridge whose configuration changes while it runs.

#![allow(clippy::indexing_slicing, reason = "in a test a panic is the right answer")]

use wrapyfi_e2e::{Need, Process, Result, Route, World, ros2, run, until_route, zeromq};

const FILE: &str = "reload.yaml";

fn named(world: &World, name: &str) -> Route {
    let topic = world.topic(name);
    Route::new(&zeromq(&topic), &ros2(&topic), "NativeObject").with("name", name)
}

/// The text of a configuration with these routes.
fn text(world: &World, names: &[&str]) -> String {
    let begin = world.embedded();
    names.iter().fold(begin, |config, name| config.route(named(world, name))).yaml()
}

fn there(bridge: &Process, name: &str) -> Result {
    until_route(bridge, name, |route| route.is_some())
}

/// The file is written anew, another takes its place, half of it is there, and it is gone.
#[test]
fn a_bridge_turns_to_its_changed_file_and_refuses_a_wrong_one() -> Result {
    run("reload_file", &[Need::Program], |world| {
        let config = ["stays", "goes"]
            .iter()
            .fold(world.embedded(), |it, name| it.route(named(world, name)));
        let bridge = world.bridge_named(FILE, &config)?;
        there(&bridge, "goes")?;
        world.write(FILE, text(world, &["stays", "comes"]))?;
        there(&bridge, "comes")?;
        until_route(&bridge, "goes", |route| route.is_none())?;
        // An editor that writes beside, and takes the name.
        let beside = world.write("beside.yaml", text(world, &["stays", "renamed"]))?;
        std::fs::rename(beside, world.path(FILE))?;
        there(&bridge, "renamed")?;
        // Half a file, and what needs a start.
        let half = format!("{}  - {{ from: 'zeromq:/hal", text(world, &["stays"]));
        world.write(FILE, half)?;
        let told = |what: &'static str| {
            bridge.wait_until(what, move |output| {
                output.err.iter().any(|line| line.contains(what)).then_some(())
            })
        };
        told("the routes stay as they are")?;
        world.write(FILE, format!("hosts: {{ robot: 10.0.0.9 }}\n{}", text(world, &["stays"])))?;
        told("hosts.robot was left out at the start and is 10.0.0.9 now: start the program anew")?;
        std::fs::remove_file(world.path(FILE))?;
        told("is gone: the routes stay as they are")?;
        there(&bridge, "renamed")?;
        world.write(FILE, text(world, &["stays", "last"]))?;
        there(&bridge, "last")?;
        until_route(&bridge, "renamed", |route| route.is_none())
    })
}

/// The service tells what has changed, or why nothing has; `check --against` tells it before.
#[test]
fn a_reload_by_the_service_tells_the_difference() -> Result {
    run("reload_service", &[Need::Program], |world| {
        let config = world.embedded().route(named(world, "stays"));
        let bridge = world.bridge_named(FILE, &config)?;
        there(&bridge, "stays")?;
        let new = world.write("new.yaml", text(world, &["stays", "comes"]))?;
        let against = ["check", &new.display().to_string(), "--against"].map(str::to_owned);
        let old = world.path(FILE).display().to_string();
        let mut check = world.wrapyfi(against.into_iter().chain([old]))?;
        check.exits_with(0)?;
        let told = check.stdout();
        assert!(told.contains("+ zeromq:") && told.contains("1 added, 0 removed"), "{told}");
        std::fs::rename(new, world.path(FILE))?;
        let call = || {
            let service = ros2("/wrapyfi_bridge/reload");
            let mut call =
                world.wrapyfi(["call", &service, "--type", "std_srvs/srv/Trigger", "--json"])?;
            call.exits_with(0)?;
            Result::Ok(call.stdout())
        };
        // The file may have been read already because it is another.
        let told = call()?;
        assert!(told.contains("true") && told.contains("removed"), "{told}");
        there(&bridge, "comes")?;
        world.write(FILE, "routes: [")?;
        let told = call()?;
        assert!(told.contains("false") && told.contains("reload.yaml"), "{told}");
        there(&bridge, "comes")
    })
}
