//! Our client, our name server and our ports together, over real sockets on the loopback interface.

use std::sync::Arc;
use std::time::Duration;

use crate::input::{Connections, input};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use wrapyfi_yarp::Value;
use wrapyfi_yarp::name::events::NameEvents;
use wrapyfi_yarp::name::registrar::RegistrarOptions;
use wrapyfi_yarp::name::{NameClient, NameError, NameEvent, NameServerConf, Registrar};
use wrapyfi_yarp::port::names::{NameRequest, Names};
use wrapyfi_yarp::port::{AdminError, Network, NetworkOptions, PortOptions};
use wrapyfi_yarp::server::{NameServer, NameServerLimits, NameServerOptions};

const TIMEOUT: Duration = Duration::from_secs(20);

async fn server_on(port: u16) -> NameServer {
    NameServer::start(NameServerOptions { port, ..NameServerOptions::default() }).await.unwrap()
}

async fn server() -> NameServer {
    server_on(0).await
}

/// A name server whose numbers are none that the operating system gives to a port of its own choice:
/// those begin at 32768.
async fn server_below_ephemeral_numbers() -> NameServer {
    for port in (12_000..20_000).step_by(97) {
        let options = NameServerOptions { port, ..NameServerOptions::default() };
        if let Ok(server) = NameServer::start(options).await {
            return server;
        }
    }
    panic!("no free port from 12000 to 20000");
}

fn named(name: &str) -> NameRequest {
    NameRequest { name: name.to_owned(), ..NameRequest::default() }
}

/// Waits until something holds, and fails after a time.
async fn until(what: &str, mut holds: impl AsyncFnMut() -> bool) {
    let waited = tokio::time::timeout(TIMEOUT, async {
        while !holds().await {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    });
    assert!(waited.await.is_ok(), "never: {what}");
}

#[tokio::test]
async fn a_client_does_everything() {
    let server = server().await;
    let client = server.client();
    let a = client.register(&named("/a")).await.unwrap();
    assert_eq!((a.host.as_str(), a.carrier.as_str()), ("127.0.0.1", "tcp"));
    assert_eq!(client.query("/a").await.unwrap(), Some(a.clone()));
    assert_eq!(client.query("/b").await.unwrap(), None);
    let unnamed = client.register(&named("...")).await.unwrap();
    assert_eq!(unnamed.name, "/tmp/port/1");
    let below = client.register(&named("/a/image")).await.unwrap();
    let listed = client.list("/a").await.unwrap();
    assert_eq!(listed, [a.clone(), below]);
    assert!(client.list("").await.unwrap().len() >= 5);

    let values = ["red", "/x", "two words"].map(Value::from);
    assert!(client.set("/a", "color", &values).await.unwrap().is_some());
    assert_eq!(client.get("/a", "color").await.unwrap().to_text(), "\"/x\" red (two words)");
    assert_eq!(client.set("/b", "color", &values).await.unwrap(), None);

    client.subscribe("/a", "tcp://b").await.unwrap();
    let ending = ["subscribe", "/a", "/c", "to"].map(Value::from);
    client.ask(ending.into_iter().collect()).await.unwrap();
    let kept = client.subscriptions(None).await.unwrap();
    // The connection that should end with /c, which is not there, has ended.
    assert_eq!(kept.iter().map(|kept| kept.dest.as_str()).collect::<Vec<_>>(), ["tcp://b"]);
    client.unsubscribe("/a", "/b").await.unwrap();
    assert!(client.subscriptions(Some("/a")).await.unwrap().is_empty());

    client.announce("/a", true).await.unwrap();
    client.announce("/a", false).await.unwrap();
    client.unregister("/a").await.unwrap();
    client.unregister("/a").await.unwrap();
    assert_eq!(client.query("/a").await.unwrap(), None);
    for name in ["", "a", "/a b", "/a\nunregister /b", "/\""] {
        assert!(matches!(client.query(name).await, Err(NameError::BadName { .. })), "{name:?}");
    }
    server.stop().await;
}

#[tokio::test]
async fn what_is_refused_is_told_and_counted() {
    let limits = NameServerLimits { max_names: 4, ..NameServerLimits::default() };
    let options = NameServerOptions { port: 0, limits, ..NameServerOptions::default() };
    let server = NameServer::start(options).await.unwrap();
    let client = server.client();
    // Its own name and that of the group are two.
    client.register(&named("/a")).await.unwrap();
    client.register(&named("/b")).await.unwrap();
    let error = client.register(&named("/c")).await.unwrap_err();
    assert!(error.to_string().contains("4 names are registered"), "{error}");
    client.register(&named("/a")).await.unwrap();
    let error = client.register(&named("/root")).await.unwrap_err();
    assert!(error.to_string().contains("/root is the name server itself"), "{error}");
    let error = client.unregister("/root").await.unwrap_err();
    assert!(matches!(error, NameError::Refused { .. }), "{error}");
    let error = client.set("/a", "host", &["8.8.8.8".into()]).await.unwrap_err();
    assert!(error.to_string().contains("register the port again"), "{error}");
    assert_eq!(server.status().counts.get("refused"), Some(&4));
    server.stop().await;
}

#[tokio::test]
async fn changes_are_heard_on_a_connection_of_ours() {
    let server = server().await;
    let client = server.client();
    let mut events = NameEvents::open(&client).await.unwrap();
    until("the reader is there", async || server.status().readers == 1).await;
    client.register(&named("/a")).await.unwrap();
    client.register(&named("/a")).await.unwrap();
    client.unregister("/a").await.unwrap();
    let (add, del) = (NameEvent::Added("/a".into()), NameEvent::Removed("/a".into()));
    for expected in [&add, &del, &add, &del] {
        let event = tokio::time::timeout(TIMEOUT, events.next()).await.unwrap().unwrap();
        assert_eq!(&event, expected);
    }
    server.stop().await;
    let end = tokio::time::timeout(TIMEOUT, events.next()).await.unwrap();
    assert!(end.is_err(), "{end:?}");
}

/// Programs that listen call themselves the same, and none may end the others.
#[tokio::test]
async fn many_hear_changes_at_once() {
    let server = server().await;
    let client = server.client();
    let mut all = Vec::new();
    for readers in 1..=3 {
        all.push(NameEvents::open(&client).await.unwrap());
        until("the reader", async || server.status().readers == readers).await;
    }
    client.register(&named("/heard")).await.unwrap();
    for events in &mut all {
        let heard = tokio::time::timeout(TIMEOUT, events.next()).await.expect("an event");
        assert_eq!(heard.unwrap(), NameEvent::Added("/heard".to_owned()));
    }
    drop(all);
    server.stop().await;
}

#[tokio::test]
async fn a_thousand_ports_have_numbers_of_their_own() {
    let server = server().await;
    let client = server.client();
    let mut waiting = tokio::task::JoinSet::new();
    for at in 0..1000 {
        let client = client.clone();
        waiting.spawn(async move { client.register(&named(&format!("/many/{at}"))).await });
        if waiting.len() >= 50 {
            waiting.join_next().await.unwrap().unwrap().unwrap();
        }
    }
    while let Some(registered) = waiting.join_next().await {
        registered.unwrap().unwrap();
    }
    let listed = client.list("/many").await.unwrap();
    let numbers: std::collections::BTreeSet<_> = listed.iter().map(|port| port.port).collect();
    assert_eq!((listed.len(), numbers.len()), (1000, 1000));
    server.stop().await;
}

#[tokio::test]
async fn ports_come_back_when_the_name_server_does() {
    let server = server().await;
    let port = server.address().port();
    let options = RegistrarOptions {
        retry_from: Duration::from_millis(5),
        check_every: Duration::from_millis(50),
    };
    let registrar = Registrar::start(server.client(), options);
    let at = registrar.register(&named("/kept")).await.unwrap();
    registrar.set("/kept", "color", &["red".to_owned()]).await.unwrap();
    registrar.announce("/kept", true).await.unwrap();
    registrar.register(&named("/other")).await.unwrap();
    let mut status = registrar.status();
    status.wait_for(|status| status.connected).await.unwrap();

    // It ends, and another one begins that knows nothing.
    server.stop().await;
    status.wait_for(|status| !status.connected).await.unwrap();
    let server = server_on(port).await;
    let renewed = status.wait_for(|status| status.renewed >= 2 && status.connected);
    tokio::time::timeout(TIMEOUT, renewed).await.unwrap().unwrap();
    let client = server.client();
    assert_eq!(client.query("/kept").await.unwrap(), Some(at.clone()));
    assert_eq!(client.get("/kept", "color").await.unwrap().to_text(), "red");

    // The name server forgets us: the question that comes in turn finds out.
    client.unregister("/kept").await.unwrap();
    until("/kept is registered again", async || {
        client.query("/kept").await.unwrap() == Some(at.clone())
    })
    .await;

    // The address of a program that was killed is told for it: the name is ours all the same.
    let other = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
    let number = other.local_addr().unwrap().port();
    drop(other);
    let placed =
        NameRequest { host: Some("127.0.0.1".into()), port: Some(number), ..named("/kept") };
    client.register(&placed).await.unwrap();
    until("/kept is taken over", async || client.query("/kept").await.unwrap() == Some(at.clone()))
        .await;
    assert!(status.borrow().taken.is_empty());

    // A program takes the name, and is there: the name is that program's.
    let other = TcpListener::bind(("127.0.0.1", number)).await.unwrap();
    let accepting = tokio::spawn(async move { while other.accept().await.is_ok() {} });
    client.register(&placed).await.unwrap();
    let told = status.wait_for(|status| status.taken == ["/kept"]);
    tokio::time::timeout(TIMEOUT, told).await.unwrap().unwrap();
    registrar.unregister("/kept").await.unwrap();
    assert_eq!(client.query("/kept").await.unwrap().unwrap().port, number);
    accepting.abort();
    // The program that opens it anew is not told of that.
    assert!(status.borrow().taken.is_empty());

    registrar.unregister("/other").await.unwrap();
    assert_eq!(client.query("/other").await.unwrap(), None);
    server.stop().await;
}

/// A change that the name server tells is looked at, however long the registrar waits between its own questions.
#[tokio::test]
async fn a_name_that_changes_hands_is_noticed_when_it_is_told() {
    let server = server().await;
    let client = server.client();
    let patient =
        RegistrarOptions { check_every: Duration::from_secs(1000), ..RegistrarOptions::default() };
    let registrar = Registrar::start(client.clone(), patient);
    let at = registrar.register(&named("/kept")).await.unwrap();
    registrar.status().wait_for(|status| status.connected).await.unwrap();
    client.unregister("/kept").await.unwrap();
    registrar.verify("/others");
    registrar.verify("/kept");
    until("/kept is registered again", async || {
        client.query("/kept").await.unwrap() == Some(at.clone())
    })
    .await;
    assert_eq!(client.query("/others").await.unwrap(), None);
    server.stop().await;
}

fn network(client: NameClient) -> Network {
    Network::new(NetworkOptions { names: Arc::new(client), ..NetworkOptions::default() })
}

#[tokio::test]
async fn ports_take_no_number_that_the_name_server_gives_away() {
    let server = server_below_ephemeral_numbers().await;
    let client = server.client();
    let first = client.register(&named("/first")).await.unwrap().port;
    let network = network(client.clone());
    let output = network.open_output("/cam", &PortOptions::default()).await.unwrap();
    let registered = client.query("/cam").await.unwrap().unwrap();
    assert_eq!(registered.port, output.address().port());
    assert_eq!(client.register(&named("/second")).await.unwrap().port, first + 1);
    assert_ne!(registered.port, first + 1);
    output.close().await;
    server.stop().await;
}

/// A port that is opened again while the name server is away has another number: that is the one to
/// register.
#[tokio::test]
async fn a_port_that_was_opened_again_meanwhile_is_not_held_to_be_taken() {
    let server = server().await;
    let port = server.address().port();
    let options = RegistrarOptions {
        retry_from: Duration::from_millis(5),
        check_every: Duration::from_millis(20),
    };
    let registrar = Registrar::start(server.client(), options);
    for at in 0..40 {
        registrar.register(&named(&format!("/many/{at}"))).await.unwrap();
    }
    let mut status = registrar.status();
    status.wait_for(|status| status.connected).await.unwrap();
    server.stop().await;
    let server = server_on(port).await;
    // All of them are opened anew, at other numbers, while the registrar brings the old ones back.
    let mut now = Vec::new();
    for at in 0..40 {
        let number = 40_000 + at;
        let request = NameRequest {
            host: Some("127.0.0.1".into()),
            port: Some(number),
            ..named(&format!("/many/{at}"))
        };
        now.push(registrar.register(&request).await.unwrap());
    }
    let settled = status.wait_for(|status| status.connected);
    tokio::time::timeout(TIMEOUT, settled).await.unwrap().unwrap();
    let client = server.client();
    for (at, kept) in now.iter().enumerate() {
        until("the new number", async || {
            let found = client.query(&format!("/many/{at}")).await.unwrap();
            found.as_ref() == Some(kept)
        })
        .await;
    }
    assert_eq!(status.borrow().taken, Vec::<String>::new());
    server.stop().await;
}

#[tokio::test]
async fn persistent_connections_join_our_ports_whoever_comes_first() {
    let server = server().await;
    let client = server.client();
    let network = network(client.clone());
    client.subscribe("/talk/out", "fast_tcp://talk/in").await.unwrap();
    for turn in 0..2 {
        let input = input(&network, "/talk/in", 4).await;
        let output = network.open_output("/talk/out", &PortOptions::default()).await.unwrap();
        tokio::time::timeout(TIMEOUT, output.wait_for_outputs(1)).await.unwrap();
        output.write_bottle(&wrapyfi_yarp::Bottle::from(vec![turn.into()])).unwrap();
        let message = tokio::time::timeout(TIMEOUT, input.recv()).await.unwrap().unwrap();
        assert_eq!(message.bottle().unwrap().to_text(), turn.to_string());
        // Both close, in either order, and come again.
        if turn == 0 {
            input.close().await;
            output.close().await;
        } else {
            output.close().await;
            input.close().await;
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn ports_are_connected_looked_at_and_disconnected_from_outside() {
    let server = server().await;
    let client = server.client();
    let network = network(client.clone());
    let input = input(&network, "/view", 4).await;
    let output = network.open_output("/cam", &PortOptions::default()).await.unwrap();
    assert!(network.exists("/cam").await);
    assert!(network.exists("/root").await, "the name server is a port, too");
    assert!(!network.exists("/nobody").await);

    network.connect("/cam", "/view", None).await.unwrap();
    tokio::time::timeout(TIMEOUT, output.wait_for_outputs(1)).await.unwrap();
    // The connection of the program that connected them may still be there.
    let carrier = || -> Vec<_> {
        let data = output.status().into_iter().filter(|one| one.name != "admin");
        data.map(|one| (one.name, one.carrier)).collect()
    };
    let joined = |carrier: &str| vec![("/view".to_owned(), carrier.to_owned())];
    assert_eq!(carrier(), joined("tcp"));
    // Another carrier takes the place of the first.
    network.connect("/cam", "/view", Some("fast_tcp")).await.unwrap();
    assert_eq!(carrier(), joined("fast_tcp"));
    network.disconnect("/cam", "/view").await.unwrap();
    let error = network.disconnect("/cam", "/view").await.unwrap_err();
    assert!(matches!(error, AdminError::Refused { .. }), "{error}");
    let error = network.connect("/cam", "/nobody", None).await.unwrap_err();
    assert!(matches!(error, AdminError::Unknown(_)), "{error}");

    // A port that died without saying so.
    let dead = NameRequest { host: Some("127.0.0.1".into()), port: Some(9), ..named("/dead") };
    client.register(&dead).await.unwrap();
    assert!(!network.exists("/dead").await);
    let error = network.connect("/cam", "/dead", None).await.unwrap_err();
    assert!(error.to_string().contains("Cannot connect to tcp://dead"), "{error}");
    output.close().await;
    input.close().await;
    server.stop().await;
}

#[tokio::test]
async fn a_name_server_that_answers_nonsense_is_named() {
    for (answer, says) in [
        (&b"HTTP/1.1 400 Bad Request\r\n\r\n*** end of message\r\n"[..], "makes no sense"),
        (b"registration name /a ip 127.0.0.1 port 99999 type tcp\r\n*** end\r\n", "makes no sense"),
        (b"[fail]\r\n", "makes no sense"),
        (b"registration name /a ip 1.2.3.4 port", "closed the connection"),
        (b"", "closed the connection"),
        (b"\xff\xfe\xff\r\n*** end\r\n", "makes no sense"),
    ] {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let client = NameClient::new(NameServerConf { host: "127.0.0.1".into(), port });
        let answers = async {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut request = [0; 64];
            assert!(stream.read(&mut request).await.unwrap() > 0);
            stream.write_all(answer).await.unwrap();
        };
        let (error, ()) = tokio::join!(client.query("/a"), answers);
        let error = error.unwrap_err().to_string();
        assert!(error.contains(says), "{}: {error}", String::from_utf8_lossy(answer));
    }
}

#[tokio::test]
async fn a_port_that_the_name_server_keeps_elsewhere_is_an_error() {
    let listener = TcpListener::bind(("127.0.0.1", 0)).await.unwrap();
    let client = NameClient::new(NameServerConf {
        host: "127.0.0.1".into(),
        port: listener.local_addr().unwrap().port(),
    });
    let served = tokio::spawn(async move {
        let mut asked = Vec::new();
        for _ in 0..3 {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut line = vec![0; 200];
            let length = stream.read(&mut line).await.unwrap();
            asked.push(String::from_utf8_lossy(&line[..length]).trim().to_owned());
            let answer =
                b"registration name /a ip 127.0.0.1 port 10002 type tcp\n*** end of message\n";
            stream.write_all(answer).await.unwrap();
        }
        asked
    });
    let request = NameRequest { host: Some("127.0.0.1".into()), port: Some(10_444), ..named("/a") };
    let error = client.register(&request).await.unwrap_err();
    assert!(matches!(&error, NameError::Elsewhere { wanted: 10_444, .. }), "{error}");
    let again = "NAME_SERVER register /a ... 127.0.0.1 10444";
    assert_eq!(served.await.unwrap(), [again, "NAME_SERVER unregister /a", again]);
}

#[tokio::test]
async fn a_name_server_that_never_ends_or_never_begins_is_given_up() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let limits = wrapyfi_yarp::WireLimits {
        max_message_bytes: 64 * 1024,
        max_line_bytes: 1024,
        ..wrapyfi_yarp::WireLimits::default()
    };
    let client = NameClient::new(NameServerConf { host: "127.0.0.1".into(), port })
        .with_limits(limits)
        .with_timeout(Duration::from_secs(5));
    for line in [&b"registration name /a ip 1.2.3.4 port 5 type tcp\r\n"[..], b"endless "] {
        let floods = async {
            let (mut stream, _) = listener.accept().await.unwrap();
            while stream.write_all(line).await.is_ok() {}
        };
        let (error, ()) = tokio::join!(client.list(""), floods);
        let error = error.unwrap_err().to_string();
        let limits = ["allowed are 65536", "more than 1024 bytes"];
        assert!(limits.iter().any(|limit| error.contains(limit)), "{error}");
    }
    // Silence: the connection waits in the backlog, no program accepts.
    let client = client.with_timeout(Duration::from_millis(50));
    let error = client.query("/a").await.unwrap_err().to_string();
    assert!(error.contains("no answer within 50ms"), "{error}");
    drop(listener);
    let error = client.query("/a").await.unwrap_err().to_string();
    assert!(error.contains("cannot connect to"), "{error}");
}

#[tokio::test]
async fn bad_peers_do_not_disturb_the_server() {
    let limits = NameServerLimits {
        max_connections: 8,
        max_command_bytes: 256,
        ..NameServerLimits::default()
    };
    let options = NameServerOptions {
        port: 0,
        limits,
        wire: wrapyfi_yarp::WireLimits {
            max_line_bytes: 4096,
            ..wrapyfi_yarp::WireLimits::default()
        },
        handshake_timeout: Duration::from_secs(1),
        idle_timeout: Duration::from_millis(200),
        ..NameServerOptions::default()
    };
    let server = NameServer::start(options).await.unwrap();
    let open = async || TcpStream::connect(server.address()).await.unwrap();
    let count = |reason: &str| server.status().counts.get(reason).copied().unwrap_or(0);

    // A line without an end, a long command, a bottle bomb.
    let mut endless = open().await;
    let line = [b"NAME_SERVER ".as_slice(), &[b'x'; 8192]].concat();
    // It may be cut off before all of it is written.
    endless.write_all(&line).await.unwrap_or_default();
    until("the endless line is counted", async || count("line_too_long") == 1).await;
    let mut long = open().await;
    long.write_all(format!("NAME_SERVER query /{}\n", "x".repeat(300)).as_bytes()).await.unwrap();
    let mut answer = vec![0; 200];
    let read = long.read(&mut answer).await.unwrap();
    let answer = String::from_utf8_lossy(&answer[..read]).into_owned();
    assert!(answer.starts_with("refused: the command has 307 bytes, the limit is 256"), "{answer}");
    assert!(answer.ends_with("*** end of message\r\n"), "{answer}");
    let mut bomb = open().await;
    bomb.write_all(format!("NAME_SERVER {}\n", "(".repeat(240)).as_bytes()).await.unwrap();
    let read = bomb.read(&mut [0; 200]).await.unwrap();
    assert!(read > 0);

    // Half-open sockets: no header, and a one-line connection that says nothing more.
    let mut silent = open().await;
    let mut idle = open().await;
    idle.write_all(b"NAME_SERVER list\n").await.unwrap();
    for stream in [&mut silent, &mut idle] {
        let mut all = vec![];
        let end = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut all)).await;
        assert!(end.is_ok(), "it stays open");
    }
    assert!(count("handshake_timeout") >= 1 && count("idle") >= 1);

    // More connections than allowed: the surplus is closed, and the server goes on.
    let mut held = vec![];
    for _ in 0..8 {
        let mut stream = open().await;
        stream.write_all(b"CONNACK held\r\n").await.unwrap();
        held.push(stream);
    }
    let mut surplus = open().await;
    until("the surplus is counted", async || {
        surplus.write_all(b"x").await.unwrap_or_default();
        if count("too_many_connections") == 0 {
            surplus = open().await;
        }
        count("too_many_connections") > 0
    })
    .await;
    drop((held, surplus));
    let client = server.client();
    until("there is room again", async || client.query("/root").await.is_ok()).await;
    server.stop().await;
}

#[tokio::test]
async fn a_server_is_not_for_other_machines_unless_that_is_said() {
    let open = NameServerOptions {
        ip: "0.0.0.0".parse().unwrap(),
        port: 0,
        ..NameServerOptions::default()
    };
    let error = NameServer::start(open.clone()).await.unwrap_err().to_string();
    assert!(error.contains("insecure: true"), "{error}");
    let server = NameServer::start(NameServerOptions { insecure: true, ..open }).await.unwrap();
    assert_ne!(server.registration().host, "0.0.0.0");
    let port = server.address().port();
    let taken = NameServerOptions { port, ..NameServerOptions::default() };
    let error = NameServer::start(taken.clone()).await.unwrap_err().to_string();
    assert!(error.contains("is taken"), "{error}");
    server.stop().await;
    // The port is free as soon as it has stopped.
    NameServer::start(taken).await.unwrap().stop().await;
    let bad =
        NameServerOptions { port: 0, namespace: "root".into(), ..NameServerOptions::default() };
    let error = NameServer::start(bad).await.unwrap_err().to_string();
    assert!(error.contains("does not begin with a slash"), "{error}");
}

#[tokio::test]
async fn a_browser_sees_ports_and_changes_nothing() {
    let server = server().await;
    server.client().register(&named("/cam")).await.unwrap();
    let get = async |request: &str| {
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        stream.write_all(request.as_bytes()).await.unwrap();
        let mut page = String::new();
        stream.read_to_string(&mut page).await.unwrap();
        page
    };
    let page = get("GET /data=list HTTP/1.1\r\nHost: x\r\n\r\n").await;
    assert!(page.contains("\">/cam</A>"), "{page}");
    let body = "data=unregister+/cam";
    let post = format!("POST /form HTTP/1.1\r\nContent-Length: {}\r\n\r\n{body}", body.len());
    let page = get(&post).await;
    assert!(page.contains("only these commands are done here"), "{page}");
    assert!(server.client().query("/cam").await.unwrap().is_some());
    server.stop().await;
}

#[tokio::test]
async fn a_server_is_found_by_multicast() {
    use wrapyfi_yarp::name::multicast::{NameServerSearch, discover};

    // Any UDP port that is free: no other program hears us there.
    let free = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let options =
        NameServerOptions { port: 0, discovery_port: Some(free), ..NameServerOptions::default() };
    let server = NameServer::start(options).await.unwrap();
    let asked = NameServerSearch {
        port: free,
        interface: std::net::Ipv4Addr::LOCALHOST,
        wait: TIMEOUT / 3,
        ..NameServerSearch::default()
    };
    let found = discover(&asked).await.unwrap().expect("nobody answers");
    assert_eq!(&found, server.registration());
    let other = NameServerSearch {
        namespace: "/elsewhere".to_owned(),
        tries: 1,
        wait: Duration::from_millis(200),
        ..asked
    };
    assert_eq!(discover(&other).await.unwrap(), None);
    server.stop().await;
}
