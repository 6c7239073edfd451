//! ROS 1 against nodes that answer with nonsense or never end, and a master that goes in the middle of
//! a call: others are served, and the link says why one is not.

use crate::common;

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use crate::common::{Master, RawPublisher, framed, greet, node, plain, read_framed, said};
use wrapyfi_conformance::{ClientEnd, ServerEnd, Sink, Source, reserve_port, wait_until};
use wrapyfi_data::types::{MessageType, RosType, ServiceKind, Value as Object};
use wrapyfi_endpoint::{
    Discovered, LearnError, Learned, Middleware as _, Role, ServiceSpec, TopicSpec, Wake,
};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_ros1::header::Header;
use wrapyfi_ros1::xmlrpc::{Value, text};

/// A port that reads what comes and answers every connection with `answer`, or with its last byte
/// again and again.
fn answers(answer: &str, endless: bool) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (port, answer) = (listener.local_addr().unwrap().port(), answer.to_owned());
    std::thread::spawn(move || {
        for mut stream in listener.incoming().map_while(Result::ok) {
            let answer = answer.clone();
            std::thread::spawn(move || {
                let _read = stream.read(&mut [0; 4096]);
                // The other end hangs up when it has had enough.
                let mut sent = stream.write_all(answer.as_bytes());
                let more = [*answer.as_bytes().last().unwrap(); 65536];
                while endless && sent.is_ok() {
                    sent = stream.write_all(&more);
                }
            });
        }
    });
    port
}

fn http(body: &str) -> String {
    let length = body.len();
    format!("HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {length}\r\n\r\n{body}")
}

/// Puts a node into the master's books that publishes the topic, as it says.
fn claim(master: &Master, node: &str, topic: &str, port: u16) {
    let uri = text(format!("http://127.0.0.1:{port}/"));
    master.ask("registerPublisher", vec![text(node), text(topic), text("std_msgs/String"), uri]);
}

/// Whatever publishers answer, it is the reason why they are not heard, and the others are.
#[test]
fn hostile_answers_are_a_reason_and_others_are_heard() {
    let deep = "<value><array><data>".repeat(10_000);
    let bomb = "<!DOCTYPE x [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;\">]>\
                <methodResponse><params><param><value>&b;</value></param></params></methodResponse>";
    let numbers = "<value><int>1</int></value>".repeat(3);
    let no_way = format!(
        "<methodResponse><params><param><value><array><data>{numbers}</data></array></value>\
         </param></params></methodResponse>"
    );
    let endless = "HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\n\r\n<";
    for (answer, is_endless, words) in [
        (http(&deep), false, "nests deeper than 64"),
        (http(bomb), false, "document type"),
        (http(&no_way), false, "the answer is no [status, text, value]"),
        (http("\u{0}\u{1}"), false, "this is no XML-RPC"),
        ("SSH-2.0-OpenSSH_9.2\r\n".to_owned(), false, "did not answer as HTTP"),
        (endless.to_owned(), true, "broke off"),
        ("HTTP/1.1 200 OK\r\nX-Long: x".to_owned(), true, "did not answer as HTTP"),
    ] {
        let master = Master::start();
        let near = node(&master, "near");
        let port = answers(&answer, is_endless);
        claim(&master, "/hostile", "/x", port);
        let mut sink = Sink::open(&near, &plain("/x"));
        let far = node(&master, "far");
        let mut source = Source::open(&far, &plain("/x"));
        source.wait_for_listener();
        source.send(&said("heard"));
        assert_eq!(sink.receive(), said("heard"));
        // The only one left is the hostile one: its reason shows.
        drop(source);
        sink.wait_for(words, |link| {
            link.waiting_for.as_ref().is_some_and(|why| why.to_string().contains(words))
        });
    }
}

/// A header that begins and never ends holds up no other program, and is cut off.
#[test]
fn an_endless_header_is_cut_off_and_others_are_served() {
    let master = Master::start();
    let near = node(&master, "near");
    let mut source = Source::open(&near, &plain("/x"));
    let (asked, tcpros) = ("requestTopic", Value::Array(vec![text("TCPROS")]));
    let params = vec![text("/raw"), text("/x"), Value::Array(vec![tcpros])];
    let reply = common::call(&near.api_uri(), asked, params).unwrap();
    let Value::Array(way) = reply.value else { panic!("no way") };
    let [_, Value::String(host), Value::Integer(port)] = way.as_slice() else { panic!("{way:?}") };
    let port = format!("{host}:{port}");
    let mut slow: Vec<TcpStream> = (0..20).map(|_| TcpStream::connect(&port).unwrap()).collect();
    for stream in &mut slow {
        // As long as it may be; and a piece of it.
        stream.write_all(&(1_u32 << 20).to_le_bytes()).unwrap();
        stream.write_all(&[0; 100]).unwrap();
    }
    let own = Header::new().with("callerid", "/raw").with("topic", "/x");
    let own = own.with("type", "std_msgs/String").with("md5sum", "*");
    let (mut stream, _header) = greet(&port, &own);
    source.wait_for_listener();
    source.send(&said("served"));
    assert_eq!(read_framed(&mut stream).unwrap(), framed(b"served"));
    for mut stream in slow {
        let refusal = Header::decode(&read_framed(&mut stream).unwrap()).unwrap();
        let error = refusal.get("error").unwrap();
        assert!(error.contains("no connection header came within 10 s"), "{error}");
    }
    source.send(&said("as ever"));
    assert_eq!(read_framed(&mut stream).unwrap(), framed(b"as ever"));
}

/// Definitions that no message can have: the reason names what is wrong with them.
#[test]
fn definitions_that_recurse_or_lack_a_part_are_refused() {
    let mut store = TypeStore::empty();
    let name = TypeName::parse(Dialect::Ros2, "demo/msg/Pair").unwrap();
    store.add_definition(&name, "int32 a\nint32 b\n").unwrap();
    let kind = MessageType::Ros(RosType::new(&store.resolve(&name).unwrap()).unwrap());
    let line = "=".repeat(80);
    let md5 = "0123456789abcdef0123456789abcdef";
    for (definition, words) in [
        ("int32 a\nPair next\n".to_owned(), "contains itself"),
        (format!("Part part\n{line}\nMSG: demo/Part\nPair back\n"), "contains itself"),
        ("int32 a\nPart part\n".to_owned(), "demo/msg/Part, which demo/msg/Pair has a field of"),
        ("int32 a\nint32 b\n".to_owned(), md5),
        ("int32[ a\n".to_owned(), "int32["),
    ] {
        let master = Master::start();
        let near = node(&master, "near");
        let fields = Header::new().with("type", "demo/Pair").with("md5sum", md5);
        let fields = fields.with("message_definition", &definition);
        let raw = RawPublisher::start(&master, "/raw", "/x", &fields);
        let sink = Sink::open(&near, &TopicSpec::new("/x", kind));
        sink.wait_for("the reason", |link| {
            let reason = link.waiting_for.as_ref().map(ToString::to_string).unwrap_or_default();
            reason.contains("cannot be received as demo/msg/Pair") && reason.contains(words)
        });
        assert_eq!(sink.counters().received, 0);
        drop(raw);
    }
}

/// A type that this node does not know is what its publisher shows, also beside publishers that show nonsense.
#[test]
fn a_type_is_learned_from_its_publisher() {
    let master = Master::start();
    let near = node(&master, "near");
    let mut discovery = near.discover().unwrap();
    let mut types = TypeStore::generated();
    // The type that one publisher has told, when it has answered.
    let mut learned = |node: &str| {
        let deadline = Instant::now() + wrapyfi_conformance::TIMEOUT;
        loop {
            let found = discovery.endpoints().unwrap();
            let one = found.iter().find(|one| one.node.as_deref() == Some(node));
            match one.map(|one| near.learn_topic(one, &mut types)) {
                None | Some(Err(LearnError::Asked(_))) => {}
                Some(answer) => return answer,
            }
            assert!(Instant::now() < deadline, "{node} never answered: {found:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    let ros_type = |learned: Result<Learned, LearnError>| match learned {
        Ok(Learned::Ros(ros_type)) => ros_type,
        other => panic!("no type of ROS: {other:?}"),
    };
    let line = "=".repeat(80);
    let text = format!("Inner[] parts\ntime at\n{line}\nMSG: made_up/Inner\nfloat32 x\n");
    let fields = |kind: &str, text: &str| {
        let fields = Header::new().with("type", kind).with("md5sum", "*");
        fields.with("message_definition", text)
    };
    claim(&master, "/hostile", "/y", answers("SSH-2.0\r\n", false));
    let other = fields("std_msgs/String", "string data\n");
    let _other = RawPublisher::start(&master, "/other", "/x", &other);
    assert_eq!(ros_type(learned("/other")).name(), "std_msgs/msg/String");
    let _raw = RawPublisher::start(&master, "/raw", "/x", &fields("made_up/Outer", &text));
    let found = ros_type(learned("/raw"));
    assert_eq!(found.name(), "made_up/msg/Outer");
    let resolved = found.resolved();
    let names: Vec<String> = resolved.definitions().keys().map(ToString::to_string).collect();
    assert!(names.iter().any(|name| name == "made_up/msg/Inner"), "{names:?}");
    assert!(names.iter().any(|name| name == "builtin_interfaces/msg/Time"), "{names:?}");
    let name = TypeName::parse(Dialect::Ros2, "made_up/msg/Outer").unwrap();
    assert_eq!(near.type_named(&name).unwrap().name(), &name);
    let _unread = RawPublisher::start(&master, "/unread", "/z", &fields("made_up/Bad", "???! a\n"));
    let said = learned("/unread").err().map(|error| error.to_string()).unwrap_or_default();
    assert!(
        said.contains("a definition of made_up/Bad: /unread: ") && said.contains("???!"),
        "{said}"
    );
    // The master's type is all there is of a publisher that shows nonsense.
    assert_eq!(ros_type(learned("/hostile")).name(), "std_msgs/msg/String");
}

/// A publisher that accepts and says nothing, and one whose machine is gone, are waited for beside the
/// others.
#[test]
fn a_silent_publisher_delays_nobody() {
    let master = Master::start();
    let near = node(&master, "near");
    let held = TcpListener::bind("127.0.0.1:0").unwrap();
    claim(&master, "/silent", "/x", held.local_addr().unwrap().port());
    for n in 1..=8 {
        let uri = text(format!("http://192.0.2.{n}:11411/"));
        let kind = text("std_msgs/String");
        master.ask("registerPublisher", vec![text(format!("/far{n}")), text("/x"), kind, uri]);
    }
    let raw = RawPublisher::start(
        &master,
        "/raw",
        "/x",
        &Header::new()
            .with("type", "std_msgs/String")
            .with("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1"),
    );
    let mut sink = Sink::open(&near, &plain("/x"));
    wait_until(&sink.context.wake, "the subscriber", || raw.subscribers() == 1);
    for n in 0..100 {
        raw.send(&framed(&framed(n.to_string().as_bytes())));
        assert_eq!(sink.receive(), said(&n.to_string()));
    }
    assert_eq!(sink.listener.link().peers, Some(1));
}

/// The master ends while a call is under way: the call ends well, and the next one is made when it is
/// back.
#[test]
fn a_call_outlives_the_master() {
    let master = Master::start();
    let port = master.port();
    let (near, far) = (node(&master, "near"), node(&master, "far"));
    let spec = ServiceSpec::new("/add", ServiceKind::NativeObject);
    let mut server_end = ServerEnd::open(&far, &spec);
    let mut client_end = ClientEnd::open(&near, &spec);
    client_end.ready();
    let ticket = client_end.ask([Object::from(1)]);
    let request = server_end.receive();
    drop(master);
    server_end.answer(request.id, Object::from("without a master"));
    server_end.server.flush();
    assert_eq!(client_end.await_with(ticket, || ()), Ok(said("without a master")));
    let master = Master::at(port);
    let wake = client_end.context.wake.clone();
    wait_until(&wake, "the service to be registered again", || {
        std::thread::sleep(Duration::from_millis(10));
        let found = master.ask("lookupService", vec![text("/raw"), text("/add")]);
        matches!(found.value, Value::String(_))
    });
    let ticket = client_end.ask([Object::from(2)]);
    let echoed = client_end.await_echo(ticket, &mut server_end);
    assert!(echoed.is_ok(), "{echoed:?}");
    drop((client_end, server_end, near, far));
    let state = master.ask("getSystemState", vec![text("/raw")]);
    assert_eq!(state.value, Value::Array(vec![Value::Array(vec![]); 3]), "nothing is left");
}

/// A publisher latches only once it has said so.
#[test]
fn a_publisher_that_could_not_be_asked_is_not_taken_for_one_that_does_not_latch() {
    let master = Master::start();
    let node = node(&master, "near");
    // Registered, and dead.
    let port = reserve_port();
    let uri = format!("http://127.0.0.1:{}/", port.number);
    let entry = ["/late", "/x", "std_msgs/String", &uri].map(text);
    master.ask("registerPublisher", entry.to_vec());
    let found =
        Discovered { node: Some("/late".to_owned()), ..Discovered::new("/x", Role::Publisher) };
    let (mut types, wake) = (TypeStore::generated(), Wake::new());
    wait_until(&wake, "its silence", || {
        assert_eq!(node.keeps_last(&found), None);
        matches!(node.learn_topic(&found, &mut types), Err(LearnError::Silent { .. }))
    });
    assert_eq!(node.keeps_last(&found), None);
    let fields = Header::new()
        .with("type", "std_msgs/String")
        .with("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1")
        .with("latching", "1");
    let _publisher = RawPublisher::start(&master, "/late", "/x", &fields);
    wait_until(&wake, "its word", || {
        let keeps = node.keeps_last(&found);
        assert_ne!(keeps, Some(false));
        keeps == Some(true)
    });
}
