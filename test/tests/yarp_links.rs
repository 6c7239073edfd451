//! Cables that are pulled out between ports of YARP: both ends notice, and go on when the cable is back.

use wrapyfi_e2e::{Host, Need, Process, Result, TestEnv, run};

const NEEDS: &[Need] = &[Need::Program, Need::Hosts];

/// The carriers over TCP, whose ends learn nothing when a machine is gone.
const CARRIERS: [&str; 4] = ["tcp", "fast_tcp", "text", "text_ack"];

/// A name server on the first machine, which both know.
fn name_server(env: &TestEnv, robot: &Host<'_>) -> Result<Process> {
    let port = env.yarp_port().to_string();
    env.write("yarp.conf", format!("{} {port} yarp\n", robot.ip()))?;
    env.write("ask.py", ASK)?;
    let args = ["yarpserver", "--ip", robot.ip(), "--port", &port, "--no-discovery", "--insecure"];
    let server = robot.wrapyfi(args)?;
    server.wait_until("the name server", |output| {
        output.err.iter().any(|line| line.contains("name server /root on")).then_some(())
    })?;
    Ok(server)
}

/// Waits until a port says that it has a connection of a kind, and then until it has none.
const ASK: &str = r#"
import re, socket, sys, time
server, number, name, words = sys.argv[1], int(sys.argv[2]), sys.argv[3], " ".join(sys.argv[4:])
def ask(address, text):
    with socket.create_connection(address) as s:
        s.sendall(text)
        s.shutdown(socket.SHUT_WR)
        return s.makefile().read()
def port():
    while True:
        told = ask((server, number), b"NAME_SERVER query " + name.encode() + b"\n")
        found = re.search(r"ip (\S+) port (\d+)", told)
        if found:
            return found.group(1), int(found.group(2))
        time.sleep(0.1)
there = port()
is_connected = lambda: words in ask(there, b"CONNECT ask\r\n*\r\nq\r\n")
while not is_connected():
    time.sleep(0.1)
print("connected", flush=True)
while is_connected():
    time.sleep(0.1)
"#;

/// Asks a port on its own machine; returns when it has the connection.
fn ask(env: &TestEnv, robot: &Host<'_>, at: &Host<'_>, port: &str, words: &str) -> Result<Process> {
    let args = format!("ask.py {} {} {port} {words}", robot.ip(), env.yarp_port());
    let asked = at.program("/usr/bin/python3", &args)?;
    asked.wait_until(words, |output| {
        output.out.iter().any(|line| line == "connected").then_some(())
    })?;
    Ok(asked)
}

/// A pair of ports between two machines, and those who ask them.
struct Pair {
    carrier: &'static str,
    _publisher: Process,
    echo: Process,
    writer: Process,
    reader: Process,
}

impl Pair {
    /// Connects; `rate` is in messages a second.
    fn new(
        env: &TestEnv,
        robot: &Host<'_>,
        laptop: &Host<'_>,
        carrier: &'static str,
        rate: &str,
    ) -> Result<Self> {
        let (port, ear) = (format!("/{carrier}"), format!("/ear/{carrier}"));
        let endpoint = format!("yarp:{port}");
        let text = ["--type", "Text", "--value", "\"hello\"", "--rate", rate];
        let publisher = robot.wrapyfi([&["pub", &endpoint], &text[..]].concat())?;
        let (carried, named) = (format!("carrier={carrier}"), format!("port={ear}"));
        let options = ["--option", &carried, "--option", &named];
        let echo = ["echo", &endpoint, "--type", "Text", "--json"];
        let echo = laptop.wrapyfi([&echo, &options[..]].concat())?;
        let writer = ask(env, robot, robot, &port, &format!("output connection from {port} to"))?;
        let words = format!("input connection from {port} to");
        let reader = ask(env, robot, laptop, &ear, &words)?;
        echo.objects(1)?;
        Ok(Self { carrier, _publisher: publisher, echo, writer, reader })
    }

    /// Waits until both ends have noticed.
    fn is_noticed(&mut self) -> Result {
        let at = |end: &str| format!("{}, the {end}", self.carrier);
        let (writer, reader) = (at("writer"), at("reader"));
        self.writer.exits_with(0).map_err(|error| error.context(writer))?;
        self.reader.exits_with(0).map_err(|error| error.context(reader))
    }
}

#[test]
fn a_dead_link_is_noticed_at_both_ends_and_recovers() -> Result {
    run("a_dead_link_is_noticed_at_both_ends_and_recovers", NEEDS, |env| {
        let [robot, laptop] = env.hosts(["robot", "laptop"])?;
        let robot = robot.with("WRAPYFI_YARP_INSECURE", "1");
        let laptop = laptop.with("WRAPYFI_YARP_INSECURE", "1");
        let _server = name_server(env, &robot)?;
        let mut pairs = Vec::new();
        for carrier in CARRIERS {
            // So seldom that no queue fills before the link is given up.
            pairs.push(Pair::new(env, &robot, &laptop, carrier, "1")?);
        }
        // The writer's machine still has its link: only silence tells.
        laptop.plug(false)?;
        for pair in &mut pairs {
            pair.is_noticed()?;
        }
        let heard: Vec<usize> =
            pairs.iter().map(|pair| pair.echo.stdout().lines().count()).collect();
        laptop.plug(true)?;
        for (pair, heard) in pairs.iter().zip(heard) {
            pair.echo.objects(heard + 3).map_err(|error| error.context(pair.carrier))?;
        }
        Ok(())
    })
}

#[test]
fn an_idle_link_that_is_dead_is_noticed() -> Result {
    run("an_idle_link_that_is_dead_is_noticed", NEEDS, |env| {
        let [robot, laptop] = env.hosts(["robot", "laptop"])?;
        let robot = robot.with("WRAPYFI_YARP_INSECURE", "1");
        let laptop = laptop.with("WRAPYFI_YARP_INSECURE", "1");
        let _server = name_server(env, &robot)?;
        // One message, and silence.
        let mut pair = Pair::new(env, &robot, &laptop, "fast_tcp", "0.001")?;
        laptop.plug(false)?;
        pair.is_noticed()
    })
}
