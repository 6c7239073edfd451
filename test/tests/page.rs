//! The live page of a bridge: what a browser, a program and Prometheus get, and what is refused.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use serde_json::Value;
use wrapyfi_e2e::{Need, Process, Result, Route, TestEnv, ros2, run, zeromq};

const NEEDS: &[Need] = &[Need::Program, Need::Python];
/// Longest wait for something that the page is to show.
const TIMEOUT: Duration = Duration::from_secs(40);

/// A bridge with a page at any port that is free, and that port.
fn bridge(env: &TestEnv, routes: Vec<Route>) -> Result<(Process, u16)> {
    let config = env.embedded().with("page", "{ port: 0 }");
    let bridge = env.bridge(&routes.into_iter().fold(config, wrapyfi_e2e::Config::route))?;
    let port = bridge.wait_until("the port of the page", |output| {
        let line = output.err.iter().find(|line| line.contains("the live page is at"))?;
        line.split("http://127.0.0.1:").nth(1)?.split('/').next()?.parse().ok()
    })?;
    Ok((bridge, port))
}

/// Status, head and body of the answer to a request that is written as it is.
fn ask(port: u16, request: &str) -> Result<(u16, String, String)> {
    let mut stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_read_timeout(Some(Duration::from_secs(10)))?;
    stream.write_all(request.as_bytes())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    let (head, body) = answer.split_once("\r\n\r\n").context("an answer without a head")?;
    let status = head.split(' ').nth(1).context("an answer without a status")?.parse()?;
    Ok((status, head.to_lowercase(), body.to_owned()))
}

fn request(method: &str, path: &str, host: &str) -> String {
    format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")
}

fn get(port: u16, path: &str) -> Result<String> {
    match ask(port, &request("GET", path, &format!("127.0.0.1:{port}")))? {
        (200, _, body) => Ok(body),
        (status, _, body) => bail!("{path}: {status}: {body}"),
    }
}

fn json(port: u16, path: &str) -> Result<Value> {
    Ok(serde_json::from_str(&get(port, path)?)?)
}

fn route(port: u16, name: &str) -> Result<Value> {
    let told = json(port, "/routes.json")?;
    let routes = told["routes"].as_array().into_iter().flatten();
    let mut named = routes.filter(|route| route["name"] == name);
    named.next().cloned().with_context(|| format!("no route {name} in {told}"))
}

/// Asks until the answer is as it is to be.
fn until<T>(
    bridge: &Process,
    what: &str,
    mut look: impl FnMut() -> Result<Option<T>>,
) -> Result<T> {
    let begin = Instant::now();
    loop {
        if let Some(found) = look()? {
            return Ok(found);
        }
        if begin.elapsed() > TIMEOUT {
            bail!("not within {TIMEOUT:?}: {what}\n{}", bridge.tail());
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// The message of the route that the page shows.
fn preview(bridge: &Process, port: u16, name: &str) -> Result<Value> {
    let id = route(port, name)?["id"].as_str().context("a route without a number")?.to_owned();
    until(bridge, &format!("a message of {name}"), || {
        let shown = json(port, &format!("/previews.json?id={id}"))?[&id].clone();
        Ok((!shown.is_null()).then_some(shown))
    })
}

#[test]
fn numbers_and_messages_are_on_the_page_while_they_flow() -> Result {
    run("page_numbers", NEEDS, |env| {
        let kinds = [
            ("image", "Image"),
            ("sound", "AudioChunk"),
            ("object", "NativeObject"),
            ("waits", "Text"),
        ];
        let routes = kinds.map(|(name, kind)| {
            let topic = env.topic(name);
            Route::new(&zeromq(&topic), &ros2(&topic), kind).with("name", name)
        });
        let (bridge, port) = bridge(env, routes.into())?;
        let listen = |name: &str, kind: &str| env.dds_subscriber(&env.topic(name), kind, "");
        let _listeners = [
            listen("image", "sensor_msgs/msg/Image")?,
            listen("sound", "wrapyfi_msgs/msg/AudioChunk")?,
            listen("object", "wrapyfi_msgs/msg/NativeObject")?,
        ];
        let publish = |name: &str, args: &str| {
            env.wrapyfi_publisher(&env.topic(name), &format!("{args} --no-broker"))
        };
        let _publishers = [
            publish("image", "--type Image --flavour colour")?,
            publish("sound", "--type AudioChunk --flavour stereo")?,
            publish("object", "--flavour small")?,
        ];
        let sent = || -> Result<u64> {
            Ok(route(port, "image")?["counters"]["sent"].as_u64().unwrap_or_default())
        };
        let some = until(&bridge, "images", || Ok(Some(sent()?).filter(|sent| *sent > 5)))?;
        until(&bridge, "more images", || Ok((sent()? > some).then_some(())))?;
        until(&bridge, "a rate", || {
            Ok(route(port, "image")?["messages_per_s"].as_f64().filter(|rate| *rate > 1.0))
        })?;
        let metric = || -> Result<u64> {
            let all = get(port, "/metrics")?;
            let is_meant = |line: &&str| {
                line.starts_with("wrapyfi_route_sent_messages_total{route=\"image\",")
            };
            let line = all.lines().find(is_meant).with_context(|| format!("no metric in {all}"))?;
            Ok(line.rsplit(' ').next().unwrap_or_default().parse()?)
        };
        let before = metric()?;
        assert!(before > 5, "{before}");
        until(&bridge, "a metric that counts", || Ok((metric()? > before).then_some(())))?;

        let image = preview(&bridge, port, "image")?;
        assert_eq!((&image["kind"], &image["what"]), (&"image".into(), &"64 x 48 bgr8".into()));
        assert!(image["png"].as_str().is_some_and(|png| png.starts_with("iVBORw0KGgo")), "{image}");
        let sound = preview(&bridge, port, "sound")?;
        assert_eq!(sound["kind"], "sound", "{sound}");
        assert!(sound["wave"].as_array().is_some_and(|wave| wave.len() > 50), "{sound}");
        let object = preview(&bridge, port, "object")?;
        assert_eq!(object["kind"], "value", "{object}");
        // Others come as time goes on.
        let other =
            |now: &Value| Ok(Some(preview(&bridge, port, "object")?).filter(|it| it != now));
        until(&bridge, "another object", || other(&object))?;

        let waits = route(port, "waits")?;
        assert_eq!(waits["state"], "waiting", "{waits}");
        let id = waits["id"].as_str().unwrap_or_default();
        let why = json(port, &format!("/why.json?id={id}"))?;
        let what = why["what"].as_str().unwrap_or_default();
        assert!(what.contains(&env.topic("waits")), "{why}");
        assert!(!why["remedy"].as_str().unwrap_or_default().is_empty(), "{why}");
        Ok(())
    })
}

#[test]
fn only_this_machine_reads_the_page_and_nobody_holds_it_up() -> Result {
    run("page_doors", &[Need::Program], |env| {
        let topic = env.topic("x");
        let hostile = r#"'"} 1 <img src=x onerror=alert(1)>'"#;
        let one = Route::new(&zeromq(&topic), &ros2(&topic), "Text").with("name", hostile);
        let (_bridge, port) = bridge(env, vec![one])?;
        let own = format!("127.0.0.1:{port}");
        let status = |method: &str, path: &str, host: &str| -> Result<u16> {
            Ok(ask(port, &request(method, path, host))?.0)
        };
        // A page of another site, whose name was made to lead here.
        for host in ["evil.example", &format!("evil.example:{port}"), ""] {
            for path in ["/", "/routes.json", "/metrics"] {
                assert_eq!(status("GET", path, host)?, 421, "{host} {path}");
            }
        }
        assert_eq!(status("GET", "/", &format!("localhost:{port}"))?, 200);
        for method in ["POST", "PUT", "OPTIONS", "HEAD"] {
            assert_eq!(status(method, "/routes.json", &own)?, 405, "{method}");
        }
        assert_eq!(status("GET", "/../etc/passwd", &own)?, 404);
        let long = ask(port, &request("GET", &format!("/{}", "a".repeat(70_000)), &own));
        assert!(
            long.map_or(true, |(status, ..)| status >= 400),
            "a request without end is refused"
        );
        let (_, head, page) = ask(port, &request("GET", "/", &own))?;
        assert!(page.len() < 200_000, "{} bytes", page.len());
        for told in ["content-security-policy: default-src 'none'", "nosniff", "no-store"] {
            assert!(head.contains(told), "{head}");
        }
        assert!(!head.contains("access-control"), "{head}");
        assert!(!page.contains("onerror"), "names are in no page that is served");
        // What is quoted stays within its quotes.
        let metrics = get(port, "/metrics")?;
        let escaped = r#"{route="\"} 1 <img src=x onerror=alert(1)>","#;
        assert!(metrics.contains(escaped), "{metrics}");
        assert!(metrics.lines().all(|line| line.starts_with(['#', 'w'])), "{metrics}");

        // Half a request on each of more connections than there may be.
        let half = || -> Result<TcpStream> {
            let mut stream = TcpStream::connect(("127.0.0.1", port))?;
            stream.write_all(b"GET / HTTP/1.1\r\nHo")?;
            Ok(stream)
        };
        let mut held = Vec::new();
        for _ in 0..100 {
            held.push(half()?);
        }
        let begin = Instant::now();
        assert!(get(port, "/routes.json")?.contains("\"routes\""));
        // Before the halves are given up, after five seconds.
        assert!(begin.elapsed() < Duration::from_secs(4), "{:?}", begin.elapsed());
        // The last of them is closed too, in time.
        let last = held.last_mut().context("there are a hundred")?;
        last.set_read_timeout(Some(Duration::from_secs(20)))?;
        let mut rest = Vec::new();
        assert!(
            !matches!(last.read_to_end(&mut rest), Err(error) if error.kind() == std::io::ErrorKind::WouldBlock)
        );
        Ok(())
    })
}

#[test]
fn a_bridge_without_the_key_has_no_page_and_one_whose_port_is_taken_goes_on() -> Result {
    run("page_off", &[Need::Program], |env| {
        let topic = env.topic("x");
        let config = env.embedded().route(Route::new(&zeromq(&topic), &ros2(&topic), "Text"));
        let runs = |bridge: &Process| {
            bridge.wait_until("a status", |output| output.objects().next().map(|_| ()))
        };
        let bridge = env.bridge(&config)?;
        runs(&bridge)?;
        assert!(!bridge.stderr().contains("live page"), "{}", bridge.stderr());
        bridge.terminate()?;
        let taken = std::net::TcpListener::bind("127.0.0.1:0")?;
        let port = taken.local_addr()?.port();
        let bridge = env.bridge(&config.with("page", &format!("{{ port: {port} }}")))?;
        runs(&bridge)?;
        let told = bridge.stderr();
        assert!(told.contains("there is no live page at") && told.contains("page_port"), "{told}");
        Ok(())
    })
}

/// Text that is markup where a browser takes it for some: it would leave a mark on the page's root.
const MARKUP: &str = "<img src=x onerror=\\\"document.documentElement.dataset.pwned=1\\\">";

#[test]
fn a_browser_shows_hostile_names_and_messages_as_text() -> Result {
    run("page_browser", &[Need::Program, Need::Chromium], |env| {
        let topic = env.topic("<svg onload=document.documentElement.dataset.pwned=1>");
        let there = env.topic("there");
        let one = Route::new(&zeromq(&topic), &zeromq(&there), "NativeObject")
            .with("name", &format!("\"</script><script>{MARKUP}\""));
        let (bridge, port) = bridge(env, vec![one])?;
        let _listener = env.wrapyfi(["echo", &zeromq(&there), "--type", "NativeObject"])?;
        let value = format!("{{\"said\": \"{MARKUP}\"}}");
        let _publisher = env.wrapyfi([
            "pub",
            &zeromq(&topic),
            "--type",
            "NativeObject",
            "--value",
            &value,
            "--rate",
            "20",
        ])?;
        until(&bridge, "messages", || {
            let told = json(port, "/routes.json")?;
            Ok(told["routes"][0]["messages_per_s"].as_f64().filter(|rate| *rate > 1.0))
        })?;
        let picture = env.path("page.png");
        let mut browser = env.chromium(&[
            "--window-size=1280,900",
            "--virtual-time-budget=8000",
            &format!("--screenshot={}", picture.display()),
            "--dump-dom",
            &format!("http://127.0.0.1:{port}/"),
        ])?;
        browser.exits_with(0)?;
        let dom = browser.stdout();
        assert!(
            dom.contains("&lt;/script&gt;&lt;script&gt;&lt;img src=x"),
            "the name as text: {dom}"
        );
        assert!(dom.contains("&lt;svg onload"), "the topic as text: {dom}");
        let value = dom.split("class=\"value\"").nth(1).unwrap_or_default();
        assert!(value.contains("&lt;img src=x onerror"), "the message as text: {dom}");
        assert!(dom.contains("data-theme="), "the script has run: {dom}");
        assert!(!dom.contains("data-pwned"), "{dom}");
        let drawn = std::fs::read(&picture).context("the screenshot")?;
        assert!(drawn.starts_with(b"\x89PNG") && drawn.len() > 20_000, "{} bytes", drawn.len());
        Ok(())
    })
}
