//! Recordings in which the name server speaks first: it tells changes, and it makes persistent
//! connections. The other side is played from the recording, its bytes are compared.

use std::time::Duration;

use serde_json::Value as Json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use wrapyfi_yarp::port::names::NameRequest;
use wrapyfi_yarp::server::{NameServer, NameServerOptions};
use wrapyfi_yarp::{Bottle, Value};

const TIMEOUT: Duration = Duration::from_secs(20);

fn golden(file: &str) -> Json {
    let path = format!("{}/tests/golden/{file}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn bytes(step: &Json) -> Option<Vec<u8>> {
    let hex = step["hex"].as_str()?.as_bytes();
    let pairs = hex.chunks(2).map(|pair| std::str::from_utf8(pair).unwrap());
    Some(pairs.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect())
}

async fn server() -> NameServer {
    NameServer::start(NameServerOptions { port: 0, ..NameServerOptions::default() }).await.unwrap()
}

/// Registers a name at a socket of ours.
async fn listen(server: &NameServer, name: &str) -> TcpListener {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let request = NameRequest {
        name: name.to_owned(),
        carrier: Some("tcp".to_owned()),
        host: Some("127.0.0.1".to_owned()),
        port: Some(listener.local_addr().unwrap().port()),
    };
    server.client().register(&request).await.unwrap();
    listener
}

/// Expects exactly these bytes.
async fn expect(stream: &mut TcpStream, expected: &[u8], what: &str) {
    let mut got = vec![0; expected.len()];
    let read = tokio::time::timeout(TIMEOUT, stream.read_exact(&mut got)).await;
    assert!(matches!(read, Ok(Ok(_))), "{what}: {read:?} instead of {expected:02x?}");
    assert_eq!(String::from_utf8_lossy(&got), String::from_utf8_lossy(expected), "{what}");
    assert_eq!(got, expected, "{what}");
}

/// Plays the side that was connected to: compares what comes, and answers.
async fn play(stream: &mut TcpStream, steps: &[Json], what: &str) {
    for step in steps {
        match (bytes(step), step["dir"] == "c2s") {
            (Some(bytes), true) => expect(stream, &bytes, what).await,
            (Some(bytes), false) => stream.write_all(&bytes).await.unwrap(),
            (None, true) => {
                let mut rest = vec![];
                let end = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut rest)).await;
                assert!(matches!(end, Ok(Ok(0))), "{what}: {rest:02x?} instead of the end");
            }
            (None, false) => stream.shutdown().await.unwrap(),
        }
    }
}

async fn accept(listener: &TcpListener, what: &str) -> TcpStream {
    let accepted = tokio::time::timeout(TIMEOUT, listener.accept()).await;
    accepted.unwrap_or_else(|_| panic!("{what}: nobody connects")).unwrap().0
}

/// An administrative request to the name server itself.
async fn admin(server: &NameServer, request: &str) -> String {
    let mut stream = TcpStream::connect(server.address()).await.unwrap();
    stream.write_all(b"CONNACK admin\r\n").await.unwrap();
    stream.write_all(format!("a\r\n{request}\r\nq\r\n").as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    answer
}

#[tokio::test]
async fn changes_are_told_as_in_ns_event_stream() {
    let recorded = golden("ns_event_stream");
    let steps = recorded["stream"].as_array().unwrap();
    let server = server().await;
    let reader = listen(&server, "/golden/reader").await;
    let client = server.client();
    let events = async {
        let answer = admin(&server, "[add] \"tcp://golden/reader\"").await;
        let expected = "0 \"Added connection from /root to tcp://golden/reader\\r\\n\"";
        assert!(answer.contains(expected), "{answer}");
        let listed = admin(&server, "[list] [out]").await;
        assert!(listed.contains("\"/golden/reader\"\r\n<ACK>"), "{listed}");
        // Multicast groups are not told.
        let group = NameRequest {
            name: "/golden/group".to_owned(),
            carrier: Some("mcast".to_owned()),
            ..NameRequest::default()
        };
        client.register(&group).await.unwrap();
        let name = NameRequest { name: "/golden/ev1".to_owned(), ..NameRequest::default() };
        client.register(&name).await.unwrap();
        client.unregister("/golden/ev1").await.unwrap();
        let answer = admin(&server, "[del] \"/golden/reader\"").await;
        assert!(answer.contains("0 \"Removed connection from /root to /golden/reader"), "{answer}");
    };
    let plays = async {
        let mut stream = accept(&reader, "ns_event_stream").await;
        play(&mut stream, steps, "ns_event_stream").await;
    };
    tokio::join!(events, plays);
    server.stop().await;
}

/// The connections that the name server opened to a port, in order.
fn to_port(recorded: &Json, port: &str) -> Vec<Vec<Json>> {
    let talks = recorded["connections"].as_array().unwrap().iter();
    let ours = talks.filter(|talk| talk["server"].as_str().unwrap().ends_with(port));
    ours.map(|talk| talk["stream"].as_array().unwrap().clone()).collect()
}

#[tokio::test]
async fn persistent_connections_are_made_as_recorded() {
    for (file, port, src, dest, src_named, dest_named) in [
        (
            "scenario_persistent_connection",
            ":10003",
            "/golden/src",
            "/golden/dst",
            "/golden/src",
            "tcp://golden/dst",
        ),
        (
            "scenario_wrapyfi_native",
            ":10002",
            "/wf/native",
            "/wf/native:in36114",
            "tcp://wf/native",
            "tcp://wf/native:in36114",
        ),
    ] {
        let server = server().await;
        let client = server.client();
        let (sender, _receiver) = (listen(&server, src).await, listen(&server, dest).await);
        client.announce(dest, true).await.unwrap();
        if file == "scenario_wrapyfi_native" {
            // Announced both, subscribed last.
            client.announce(src, true).await.unwrap();
        } else {
            client.unregister(src).await.unwrap();
        }
        let words = ["subscribe", src_named, dest_named].map(Value::from);
        let answer = client.ask(Bottle::from_iter(words)).await.unwrap();
        assert!(answer.get(0).unwrap().is_word("ok"), "{answer:?}");
        if file == "scenario_persistent_connection" {
            // The sender opens last.
            let request = NameRequest {
                name: src.to_owned(),
                carrier: Some("tcp".to_owned()),
                host: Some("127.0.0.1".to_owned()),
                port: Some(sender.local_addr().unwrap().port()),
            };
            client.register(&request).await.unwrap();
            client.announce(src, true).await.unwrap();
        }
        let talks: Vec<_> = to_port(&golden(file), port)
            .into_iter()
            .filter(|steps| {
                let sent: Vec<u8> = steps
                    .iter()
                    .filter(|step| step["dir"] == "c2s")
                    .filter_map(bytes)
                    .flatten()
                    .collect();
                let sent = String::from_utf8_lossy(&sent).into_owned();
                // Not those of the tools: the listener looked, and disconnected in the end.
                sent.contains("[list]") || sent.contains("[add]")
            })
            .take(3)
            .collect();
        assert_eq!(talks.len(), 3, "{file}");
        for steps in &talks {
            let mut stream = accept(&sender, file).await;
            play(&mut stream, steps, file).await;
        }
        while !server.status().counts.contains_key("link_made") {
            tokio::task::yield_now().await;
        }
        server.stop().await;
    }
}
