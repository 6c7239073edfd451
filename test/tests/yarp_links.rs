//! Cables that are pulled out between ports of YARP: both ends notice, and go on when the cable is back.

use wrapyfi_e2e::{Host, Need, Process, Result, World, run};

const NEEDS: &[Need] = &[Need::Program, Need::Hosts];

/// The carriers over TCP, whose ends learn nothing when a machine is gone.
const CARRIERS: [&str; 4] = ["tcp", "fast_tcp", "text", "text_ack"];

/// A name server on the first machine, which both know.
fn name_server(world: &World, robot: &Host<'_>) -> Result<Process> {
    let port = world.yarp_port().to_string();
    world.write("yarp.conf", format!("{} {port} yarp\n", robot.ip()))?;
    let args = ["yarpserver", "--ip", robot.ip(), "--port", &port, "--no-discovery", "--insecure"];
    let server = robot.wrapyfi(args)?;
    server.wait_until("the name server", |output| {
        output.err.iter().any(|line| line.contains("name server /root on")).then_some(())
    })?;
    Ok(server)
}

/// Lines in which a process says what it waits for.
fn words(process: &Process) -> usize {
    process.stderr().lines().filter(|line| line.contains("waiting for")).count()
}

/// Waits until a reader says again what it waits for.
fn waits(echo: &Process, before: usize) -> Result {
    echo.wait_until("a word about the dead link", |output| {
        let said = output.err.iter().filter(|line| line.contains("waiting for")).count();
        (said > before).then_some(())
    })
}

/// Asks a port for its outputs, in turns, until it has none.
const ASK: &str = r#"
import re, socket, sys, time
host, server, name = sys.argv[1], int(sys.argv[2]), sys.argv[3]
def ask(port, text):
    with socket.create_connection((host, port)) as s:
        s.sendall(text)
        s.shutdown(socket.SHUT_WR)
        return s.makefile().read()
number = int(re.search(r"port (\d+)", ask(server, b"NAME_SERVER query " + name.encode() + b"\n")).group(1))
while "output connection" in ask(number, b"CONNECT ask\r\n*\r\nq\r\n"):
    time.sleep(0.1)
"#;

/// Waits until a publisher has no reader left.
fn has_no_reader(world: &World, robot: &Host<'_>, name: &str) -> Result {
    let file = world.write("ask.py", ASK)?.display().to_string();
    let args = format!("{file} {} {} {name}", robot.ip(), world.yarp_port());
    robot.program("/usr/bin/python3", &args)?.exits_with(0)
}

#[test]
fn a_dead_link_is_noticed_at_both_ends_and_recovers() -> Result {
    run("a_dead_link_is_noticed_at_both_ends_and_recovers", NEEDS, |world| {
        let [robot, laptop] = world.hosts(["robot", "laptop"])?;
        let robot = robot.with("WRAPYFI_YARP_INSECURE", "1");
        let laptop = laptop.with("WRAPYFI_YARP_INSECURE", "1");
        let _server = name_server(world, &robot)?;
        let mut pairs = Vec::new();
        for carrier in CARRIERS {
            let endpoint = format!("yarp:/{carrier}");
            let publish =
                ["pub", &endpoint, "--type", "NativeObject", "--value", "1", "--rate", "20"];
            let option = format!("carrier={carrier}");
            let echo = ["echo", &endpoint, "--type", "NativeObject", "--json", "--option", &option];
            pairs.push((carrier, robot.wrapyfi(publish)?, laptop.wrapyfi(echo)?));
        }
        for (carrier, _, echo) in &pairs {
            echo.objects(3).map_err(|error| error.context(*carrier))?;
        }
        let before: Vec<usize> = pairs.iter().map(|(_, _, echo)| words(echo)).collect();
        // The writer's machine still has its link: only silence tells.
        laptop.plug(false)?;
        for ((carrier, _, echo), before) in pairs.iter().zip(before) {
            has_no_reader(world, &robot, &format!("/{carrier}"))
                .map_err(|error| error.context(format!("{carrier}, the writer")))?;
            waits(echo, before).map_err(|error| error.context(format!("{carrier}, the reader")))?;
        }
        let heard: Vec<usize> =
            pairs.iter().map(|(_, _, echo)| echo.stdout().lines().count()).collect();
        laptop.plug(true)?;
        for ((carrier, _, echo), heard) in pairs.iter().zip(heard) {
            echo.objects(heard + 3).map_err(|error| error.context(*carrier))?;
        }
        Ok(())
    })
}

#[test]
fn an_idle_link_that_is_dead_is_noticed() -> Result {
    run("an_idle_link_that_is_dead_is_noticed", NEEDS, |world| {
        let [robot, laptop] = world.hosts(["robot", "laptop"])?;
        let robot = robot.with("WRAPYFI_YARP_INSECURE", "1");
        let laptop = laptop.with("WRAPYFI_YARP_INSECURE", "1");
        let _server = name_server(world, &robot)?;
        // One message, and silence.
        let publish =
            ["pub", "yarp:/x", "--type", "Text", "--value", "\"hello\"", "--rate", "0.001"];
        let _publisher = robot.wrapyfi(publish)?;
        let echo = laptop.wrapyfi(["echo", "yarp:/x", "--type", "Text", "--json"])?;
        echo.objects(1)?;
        let before = words(&echo);
        laptop.plug(false)?;
        has_no_reader(world, &robot, "/x")?;
        waits(&echo, before)
    })
}
