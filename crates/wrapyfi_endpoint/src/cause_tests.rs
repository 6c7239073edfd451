use super::*;
use crate::{EndpointAddress, StartError, WireType};

fn text(text: &str) -> String {
    text.to_owned()
}

fn publisher(name: &str) -> Absent {
    Absent::new(Role::Publisher, "a publisher of", "ros2", name)
}

fn subscriber(name: &str) -> Absent {
    Absent::new(Role::Listener, "a subscriber of", "ros2", name)
}

fn server(name: &str) -> Absent {
    Absent::new(Role::Server, "a server of", "ros2", name)
}

fn port() -> EndpointAddress {
    "yarp:/x".parse().unwrap()
}

fn pose(name: &str, checksum: &str) -> WireType {
    WireType { name: text(name), checksum: text(checksum) }
}

/// The sentence of each cause, and the parts that programs read.
#[test]
fn each_cause_has_its_sentence_and_its_parts() {
    use CauseCode as Code;
    let hop = |bridge: &str, from: &str, to: &str| CarriedBack {
        bridge: text(bridge),
        from: text(from),
        to: text(to),
    };
    let zeromq = "ros2:/x".parse::<EndpointAddress>().unwrap();
    let (ours, theirs) = (pose("demo/Pose", "12"), pose("demo/Twist", "34"));
    let unreadable = PeerFault::Unreadable {
        theirs: text("demo/Twist"),
        ours: text("demo/msg/Pose"),
        reason: text("no field fits"),
    };
    let unlike = PeerFault::Unlike { verb: "sends", theirs, ours: ours.clone() };
    let refuses = |theirs| PeerFault::Refuses { says: text("no"), theirs, ours: ours.clone() };
    let table: Vec<(Cause, Code, [&str; 3], &str)> = vec![
        (
            Cause::Nobody(publisher("/x")),
            Code::NobodyPublishes,
            ["ros2:/x", "", ""],
            "a publisher of /x",
        ),
        (
            Cause::Nobody(Absent::at(Role::Listener, &zeromq)),
            Code::NobodyListens,
            ["ros2:/x", "", ""],
            "a listener on ros2:/x",
        ),
        (
            Cause::Nobody(Absent::at(Role::Server, &zeromq)),
            Code::NobodyOffers,
            ["ros2:/x", "", ""],
            "a server of ros2:/x",
        ),
        (
            Cause::Nobody(Absent::new(Role::Client, "a client of the board", "yarp", "/x")),
            Code::NobodyCalls,
            ["yarp:/x", "", ""],
            "a client of the board /x",
        ),
        (
            Cause::Untyped(Absent::at(Role::Publisher, &zeromq)),
            Code::NobodyPublishes,
            ["ros2:/x", "", ""],
            "a publisher on ros2:/x, which tells the type",
        ),
        (
            Cause::PartsMissing { absent: server("/x"), parts: vec!["get_result", "status"] },
            Code::NotReady,
            ["ros2:/x", "", ""],
            "a server of /x with all parts of an action: get_result, status not found",
        ),
        (
            Cause::FoundByHalf(server("/x")),
            Code::NotReady,
            ["ros2:/x", "", ""],
            "a server of /x, found by half",
        ),
        (
            Cause::Type { absent: publisher("/x"), peer: None, theirs: text("B"), ours: text("A") },
            Code::Type,
            ["ros2:/x", "B", "A"],
            "a publisher of /x with type A (those there carry B)",
        ),
        (
            Cause::Type {
                absent: subscriber("/x"),
                peer: Some(text("/n")),
                theirs: text("B"),
                ours: text("A"),
            },
            Code::Type,
            ["/n", "B", "A"],
            "a subscriber of /x of A: /n wants B",
        ),
        (
            Cause::Type { absent: server("/x"), peer: None, theirs: text("B"), ours: text("A") },
            Code::Type,
            ["ros2:/x", "B", "A"],
            "a server of /x that is A; the one there is B",
        ),
        (
            Cause::OtherDefinition {
                absent: subscriber("/x"),
                peer: text("/n"),
                type_name: text("A"),
            },
            Code::OtherDefinition,
            ["/n", "A", "A"],
            "a subscriber of /x of A: /n wants A of another definition",
        ),
        (
            Cause::Qos {
                absent: publisher("/x"),
                peer: text("/n"),
                theirs: text("best effort"),
                ours: text("reliable"),
            },
            Code::Qos,
            ["/n", "best effort", "reliable"],
            "a publisher of /x that fits (/n offers best effort, the route asks for reliable)",
        ),
        (
            Cause::Qos {
                absent: subscriber("/x"),
                peer: text("/n"),
                theirs: text("reliable"),
                ours: text("best effort"),
            },
            Code::Qos,
            ["/n", "reliable", "best effort"],
            "a subscriber of /x that fits (/n asks for reliable, the route offers best effort)",
        ),
        (
            Cause::Policy { absent: publisher("/x"), policy: "ownership" },
            Code::Qos,
            ["ros2:/x", "", ""],
            "a publisher of /x whose ownership is compatible (see qos)",
        ),
        (
            Cause::ServiceMapping { absent: server("/x"), theirs: "rmw_a", ours: "rmw_b" },
            Code::ServiceMapping,
            ["ros2:/x", "rmw_a", "rmw_b"],
            "a server of /x that does not speak rmw_a",
        ),
        (
            Cause::NodeMapping { node: text("/n"), theirs: "rmw_a", ours: "rmw_b" },
            Code::ServiceMapping,
            ["/n", "rmw_a", "rmw_b"],
            "node /n to speak rmw_b: it runs rmw_a; set RMW_IMPLEMENTATION=rmw_a here, or rmw_b there",
        ),
        (
            Cause::UnresolvedHost { absent: publisher("/x"), why: text("the host \"h\"") },
            Code::UnresolvedHost,
            ["ros2:/x", "", ""],
            "a publisher of /x (the host \"h\")",
        ),
        (
            Cause::SeveralTypes { at: text("ros2:/x"), types: vec![text("A"), text("B")] },
            Code::TypeUnknown,
            ["ros2:/x", "", ""],
            "ros2:/x has several types: A, B; give `type`",
        ),
        (
            Cause::LoopbackAnnounced {
                awaited: Some(Box::new(Cause::Nobody(subscriber("/x")))),
                host: text("localhost"),
            },
            Code::LoopbackAddress,
            ["localhost", "", ""],
            "a subscriber of /x: the nodes of other machines do not reach ours, which is announced at localhost: set \
             ROS_IP, and no ROS_HOSTNAME, where it starts",
        ),
        (
            Cause::peer(Named::server("publisher", "h:1"), "", Some(unlike), ""),
            Code::Type,
            ["h:1", "demo/Twist", "demo/Pose"],
            "publisher h:1: it sends demo/Twist [34]; wanted is demo/Pose [12]: have both use the same definition",
        ),
        (
            Cause::peer(Named::server("publisher", "h:1"), "", Some(unreadable), ""),
            Code::Type,
            ["h:1", "demo/Twist", "demo/msg/Pose"],
            "publisher h:1: it sends demo/Twist, which cannot be received as demo/msg/Pose: no field fits",
        ),
        (
            Cause::peer(
                Named::server("publisher", "h:1"),
                "",
                Some(refuses(Some(text("demo/Twist")))),
                "",
            ),
            Code::RefusedByPeer,
            ["h:1", "demo/Twist", "demo/Pose"],
            "publisher h:1: it refuses: no; wanted is demo/Pose [12]: have both use the same definition",
        ),
        (
            Cause::peer(Named::endpoint("port", "yarp", "/x"), " to answer", None, ""),
            Code::NotReady,
            ["yarp:/x", "", ""],
            "port /x to answer",
        ),
        (
            Cause::peer(
                Named::endpoint("port", "yarp", "/x"),
                " to connect",
                Some(text("broken").into()),
                "",
            ),
            Code::PeerUnreachable,
            ["yarp:/x", "", ""],
            "port /x to connect: broken",
        ),
        (
            Cause::peer(
                Named::endpoint("port", "yarp", "/x"),
                " to connect",
                Some(text("broken").into()),
                "; set YARP_IP",
            ),
            Code::LoopbackAddress,
            ["yarp:/x", "", ""],
            "port /x to connect: broken; set YARP_IP",
        ),
        (
            Cause::ServerRefuses {
                server: Named::endpoint("the server of", "ros", "/x"),
                says: text("no"),
            },
            Code::RefusedByPeer,
            ["ros:/x", "", ""],
            "the server of /x, which refuses: no",
        ),
        (
            Cause::NotOpened(port()),
            Code::NotOpened,
            ["yarp:/x", "", ""],
            "port /x, which no program has opened",
        ),
        (
            Cause::NameTaken { port: port(), was_ours: false },
            Code::NameTaken,
            ["yarp:/x", "", ""],
            "the name /x, which another program's port has: end that one, or set option port",
        ),
        (
            Cause::NameTaken { port: port(), was_ours: true },
            Code::NameTaken,
            ["yarp:/x", "", ""],
            "the name /x, which another program took from us: end that one, or set option port",
        ),
        (
            Cause::PortShared(port()),
            Code::NameTaken,
            ["yarp:/x", "", ""],
            "port /x, which another publisher of this program has: give both the same to_peers, out_topic_connect and \
             type, or one of them another port",
        ),
        (
            Cause::NameServed {
                to: text("ros2:/x"),
                interaction: Interaction::Service,
                by: text("/n"),
            },
            Code::NameTaken,
            ["/n", "", ""],
            "the name ros2:/x, under which /n offers a service",
        ),
        (
            Cause::DestinationTaken { to: text("ros2:/x"), by: text("ros:/y") },
            Code::DestinationTaken,
            ["ros:/y", "", ""],
            "the name ros2:/x, to which ros:/y goes; write a route with another",
        ),
        (
            Cause::Leaving(text("ros2:/x")),
            Code::NameTaken,
            ["ros2:/x", "", ""],
            "ros2:/x, which another route is leaving",
        ),
        (
            Cause::OtherSource(text("ros2:/x")),
            Code::DestinationTaken,
            ["ros2:/x", "", ""],
            "ros2:/x to have no other source",
        ),
        (
            Cause::Carried { bridge: text("/b"), to: text("ros2:/x") },
            Code::Carried,
            ["/b", "", ""],
            "the bridge /b, which carries it to ros2:/x already",
        ),
        (
            Cause::BothSides { from: text("a:/x"), to: text("b:/x"), unmarked: text("a") },
            Code::BothSides,
            ["a", "", ""],
            "a decision: a:/x and b:/x both have publishers, and a does not tell which are bridges'; write a route for \
             it",
        ),
        (
            Cause::Stale { absent: publisher("/x"), age_s: 5 },
            Code::NotReady,
            ["ros2:/x", "", ""],
            "a publisher of /x: the last came more than 5 s ago, and movements are refused until one comes",
        ),
        (
            Cause::ServerAway {
                server: Named::server("the broker at", "tcp://h:1"),
                detail: text(": no"),
            },
            Code::ServerAway,
            ["tcp://h:1", "", ""],
            "the broker at tcp://h:1: no",
        ),
        (
            Cause::OtherServer { server: Named::server("a ZeroMQ broker at", "tcp://h:1") },
            Code::OtherServer,
            ["tcp://h:1", "", ""],
            "a ZeroMQ broker at tcp://h:1 (what answers there is not the matching side of one)",
        ),
        (
            Cause::Security {
                server: Named::server("the broker at", "tcp://h:1"),
                detail: text(": no keys"),
            },
            Code::Security,
            ["tcp://h:1", "", ""],
            "the broker at tcp://h:1: no keys",
        ),
        (
            Cause::Denied {
                server: Named::server("the broker at", "tcp://h:1"),
                rule: text("does not let us"),
            },
            Code::Denied,
            ["tcp://h:1", "", ""],
            "the broker at tcp://h:1, which does not let us",
        ),
        (
            Cause::Ended(text("YARP, which has ended")),
            Code::Middleware,
            ["", "", ""],
            "YARP, which has ended",
        ),
        (
            OpenError::transport("memory", "/x", text("no")).into(),
            Code::Transport,
            ["", "", ""],
            "memory could not open \"/x\": no",
        ),
        (
            OpenError::NotStarted { middleware: "memory", fault: StartError::Absent(text("no")) }
                .into(),
            Code::Middleware,
            ["memory", "", ""],
            "memory to start: no",
        ),
        (OpenError::NotLoopback(text("no")).into(), Code::Setting, ["", "", ""], "no"),
        (
            LearnError::Undefined { type_name: text("demo/A"), reason: text("no") }.into(),
            Code::Definition,
            ["demo/A", "", ""],
            "a definition of demo/A: no",
        ),
        (LearnError::Asked(text("/n")).into(), Code::NotReady, ["", "", ""], "/n to tell its type"),
        (
            DiscoverError::Unsupported(text("x")).into(),
            Code::Middleware,
            ["", "", ""],
            "x cannot tell which endpoints exist",
        ),
        (
            UnknownMiddleware { name: text("x"), available: vec![text("y")] }.into(),
            Code::Middleware,
            ["x", "", ""],
            "middleware \"x\" is not available here; available: y",
        ),
        (Cause::Starting("its first step"), Code::Starting, ["", "", ""], "its first step"),
        (Cause::Inactive, Code::Inactive, ["", "", ""], "the bridge to be activated"),
        (Cause::NoName, Code::NoName, ["", "", ""], "a name that matches"),
        (
            Cause::Limit { at: text("ros2:/*"), limit: 1, more: 2 },
            Code::Limit,
            ["ros2:/*", "2", "1"],
            "1 is the limit of routes (max_routes), 2 more names match",
        ),
        (
            Cause::Cycle {
                bridge: text("/3"),
                from: text("m:a"),
                to: text("m:b"),
                way: vec![hop("/1", "m:b", "m:c"), hop("/2", "m:c", "m:a")],
            },
            Code::Cycle,
            ["/1, /2", "", ""],
            "loop: what this route of bridge /3 sends to m:b comes back to m:a through bridge /1 (m:b -> m:c), then bridge /2 \
             (m:c -> m:a), and would go round for ever; leave one of the routes out, or write loop_guard: false here if that is \
             no circle",
        ),
        (
            Cause::Panic { what: text("a step panicked"), panic: text("on purpose") },
            Code::Panic,
            ["", "", ""],
            "a step panicked: on purpose",
        ),
        (
            Cause::Restarting(text("the task to begin again")),
            Code::Panic,
            ["", "", ""],
            "the task to begin again",
        ),
        (
            Cause::Blocked { from: text("a:/x"), to: text("b:/x"), seconds: 3 },
            Code::Blocked,
            ["b:/x", "", ""],
            "its step from a:/x to b:/x has blocked for 3 s",
        ),
        (
            Cause::Unacknowledged { reader: Some(text("/n")), bytes: 7, remedy: text("raise it") },
            Code::Unacknowledged,
            ["/n", "", ""],
            "/n runs Fast DDS and acknowledges nothing: it has ended without a word, stands still or is far too slow \
             for messages of 7 bytes; the other subscribers do not wait for it; end it or start it again, or raise it",
        ),
        (
            Cause::SlowReader { reader: Some(text("/n")), bytes: 7, remedy: text("raise it") },
            Code::Slow,
            ["/n", "", ""],
            "/n runs Fast DDS and takes longer for messages of 7 bytes than there is between two: the newest go, one \
             after the other; raise it",
        ),
        (
            Cause::Oversize { at: text("a:/x"), limit_mib: 64 },
            Code::Drops,
            ["a:/x", "", "64"],
            "a message on a:/x was larger than 64 MiB",
        ),
        (
            Cause::Undelivered { messages: 2, to: text("a:/x") },
            Code::Drops,
            ["a:/x", "", ""],
            "2 messages did not reach everybody who listens on a:/x",
        ),
        (
            Cause::Lost { reason: DropReason::Malformed, error: text("no") },
            Code::Drops,
            ["malformed", "", ""],
            "no",
        ),
        (Cause::Transport(text("no")), Code::Transport, ["", "", ""], "no"),
    ];
    for (cause, code, parts, sentence) in table {
        assert_eq!(cause.to_string(), sentence);
        assert_eq!(cause.code(), code, "{sentence}");
        assert_eq!([cause.subject(), cause.theirs(), cause.ours()], parts, "{sentence}");
    }
}

#[test]
fn a_code_has_one_word_in_messages_and_in_json() {
    for code in CauseCode::ALL {
        assert_eq!(serde_json::to_value(code).unwrap(), code.as_str());
        assert_eq!(CauseCode::from(code.as_str()), code);
    }
    assert_eq!(CauseCode::from("of a later version"), CauseCode::Other);
}

#[test]
fn a_cause_in_json_has_its_sentence_and_the_parts_that_it_has() {
    let cause = Cause::Limit { at: text("ros2:/*"), limit: 1, more: 2 };
    let wanted = serde_json::json!({
        "reason": "1 is the limit of routes (max_routes), 2 more names match",
        "cause": "limit", "cause_subject": "ros2:/*", "cause_theirs": "2", "cause_ours": "1",
    });
    assert_eq!(serde_json::to_value(&cause).unwrap(), wanted);
}
