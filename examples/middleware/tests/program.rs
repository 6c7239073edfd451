//! The `wrapyfi` command with the middleware: its configuration, its routes, its commands.

#![allow(clippy::unwrap_used, reason = "in a test a panic is the right answer")]

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use wrapyfi_conformance::{Reserved, reserve_domain, reserve_port};

/// A domain of ROS 2 and a page that no other test has, and a configuration. The group is the usual one: no other test is in
/// it, and commands know no other.
struct Place {
    domain: Reserved,
    page: Reserved,
    file: String,
}

/// A program that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        _ = self.0.kill();
        _ = self.0.wait();
    }
}

impl Place {
    fn new() -> Self {
        let file = std::env::temp_dir().join(format!("udp_{}.yaml", std::process::id()));
        let (domain, page) = (reserve_domain(), reserve_port());
        Self { domain, page, file: file.display().to_string() }
    }

    fn write(&self, port: &str, destinations: &[&str]) {
        let page = self.page.number;
        let route = |to: &&str| format!("  - {{ from: 'udp:/in', to: '{to}', type: Text }}\n");
        let routes: String = destinations.iter().map(route).collect();
        let text = format!(
            "endpoints: {{ udp: {{ port: {port} }} }}\npage: {{ port: {page} }}\nroutes:\n{routes}"
        );
        std::fs::write(&self.file, text).unwrap();
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_wrapyfi_example_middleware"));
        command.args(words).env("ROS_DOMAIN_ID", self.domain.number.to_string());
        command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
        command.stdin(Stdio::null());
        command
    }

    fn start(&self, words: &[&str]) -> Running {
        let mut command = self.command(words);
        Running(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    fn run(&self, words: &[&str]) -> Output {
        self.command(words).output().unwrap()
    }

    /// Runs a command until its output has all of `expected`.
    fn shows(&self, words: &[&str], expected: &[&str]) {
        until(expected, || text(&self.run(words).stdout));
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        _ = std::fs::remove_file(&self.file);
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Looks until it has seen all of `expected` at once.
fn until(expected: &[&str], mut look: impl FnMut() -> String) {
    let begin = Instant::now();
    loop {
        let seen = look();
        if expected.iter().all(|word| seen.contains(word)) {
            return;
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "not within 60 s: {expected:?}\n{seen}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn get(port: u16, path: &str) -> std::io::Result<String> {
    let (mut stream, mut answer) =
        (TcpStream::connect((Ipv4Addr::LOCALHOST, port))?, String::new());
    write!(stream, "GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n")?;
    stream.read_to_string(&mut answer)?;
    Ok(answer)
}

#[test]
fn the_command_knows_the_middleware() {
    let place = Place::new();
    let (file, port) = (place.file.as_str(), "7700");
    place.write("many", &["udp:/out"]);
    let refused = place.run(&["check", file]);
    let told = text(&refused.stderr);
    assert!(refused.status.code() == Some(2) && told.contains(".yaml:1:27: "), "{told}");
    assert!(told.contains("write for example `port: 7700`"), "{told}");
    place.write(port, &["udp:/out", "ros2:/seen"]);
    let checked = place.run(&["check", file]);
    assert!(text(&checked.stdout).contains("udp:/in -> udp:/out"), "{checked:?}");

    // Messages through a bridge, and what its commands and its page show of them.
    let hears = |name: &str| {
        let words = ["echo", name, "--type", "Text", "--count", "1", "--timeout", "60"];
        let heard = place.run(&words);
        assert!(heard.status.success() && text(&heard.stdout).contains("hello"), "{heard:?}");
    };
    let _bridge = place.start(&["bridge", "--config", file]);
    let words = ["pub", "udp:/in", "--type", "Text", "--value", "\"hello\"", "--rate", "10"];
    let _publisher = place.start(&words);
    hears("udp:/out");
    let _listener = place.start(&["echo", "udp:/out", "--type", "Text"]);
    place.shows(&["list", "udp"], &["/in", "/out"]);
    place.shows(&["why", "udp:/nowhere"], &["nobody publishes udp:/nowhere"]);
    place.shows(&["top", "--once"], &["udp:/in", "udp:/out", "active"]);
    let page = place.page.number;
    until(&["\"from\":\"udp:/in\"", "\"udp\":"], || get(page, "/routes.json").unwrap_or_default());

    // A changed file.
    place.write(port, &["udp:/out", "ros2:/seen", "udp:/later"]);
    hears("udp:/later");
}
