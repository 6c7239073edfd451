use std::time::Duration;

use wrapyfi_endpoint::{
    Absent, AnnouncedQos, Cause, EndpointAddress, Named, Qos, QosPreset, Reliability, Traffic,
};
use wrapyfi_ros2::graph::ServiceMapping;

use wrapyfi_interfaces::wrapyfi_msgs::msg::{BridgeStatus, RouteInfo};

use wrapyfi_engine::LeftOut;

use super::super::Registered;
use super::super::server_check::ConnectOutcome;
use super::super::{RouteFacts, Unheard};
use super::*;
use crate::middlewares::{Reach, Server, ServerAddress};
use crate::on_graph::info::caused;
use crate::why::ServerCheck;

#[path = "judge_bridge_tests.rs"]
mod bridges;
#[path = "judge_route_tests.rs"]
mod routes;

fn address(text: &str) -> EndpointAddress {
    text.parse().unwrap()
}

fn endpoint(name: &str, role: Role, type_name: &str, qos: QosPreset) -> Discovered {
    Discovered {
        type_name: Some(type_name.to_owned()),
        qos: Some(Qos::from(qos).into()),
        node: Some(format!("/{role}_node")),
        ..Discovered::new(name, role)
    }
}

const TEXT: &str = "std_msgs/msg/String";

fn publisher(name: &str) -> Discovered {
    endpoint(name, Role::Publisher, TEXT, QosPreset::Default)
}

fn listener(name: &str) -> Discovered {
    endpoint(name, Role::Listener, TEXT, QosPreset::Default)
}

/// A route from ROS 2 to ROS 1 that lacks nothing: a bridge runs it.
fn whole() -> Way {
    let mut source = WayEnd::new(address("ros2:/in"));
    source.type_name = Some(TEXT.to_owned());
    source.graph = Some(Graph {
        domain_id: 3,
        range: "SUBNET",
        range_setting: "",
        widening: "export ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET",
        carried_by: "CycloneDDS inside".to_owned(),
        unresolved: vec![],
    });
    source.found = vec![publisher("/in"), listener("/in")];
    (source.silent, source.heard) = (Some(Duration::from_millis(600)), 4);
    let mut destination = WayEnd::new(address("ros:/out"));
    destination.type_name = Some(TEXT.to_owned());
    destination.servers = vec![master("127.0.0.1", ConnectOutcome::Open, true)];
    destination.found = vec![publisher("/out"), listener("/out")];
    Way {
        title: "talk".to_owned(),
        route: Some(RouteFacts { file: "b.yaml".to_owned(), ..RouteFacts::default() }),
        source: Some(source),
        destination: Some(destination),
        ..Way::default()
    }
}

fn server_check(
    server: Server,
    host: &str,
    answer: ConnectOutcome,
    is_here: bool,
    is_own: bool,
) -> ServerCheck {
    let (host, start) = (host.to_owned(), format!("start {server}"));
    let address =
        ServerAddress { server, host, port: 5555, is_own, start, reach: Reach::default() };
    ServerCheck { address, answer, is_here, greeting: None }
}

fn master(host: &str, answer: ConnectOutcome, is_here: bool) -> ServerCheck {
    server_check(Server::Master, host, answer, is_here, false)
}

fn of_source(change: impl FnOnce(&mut WayEnd)) -> Way {
    let mut way = whole();
    change(way.source.as_mut().unwrap());
    way
}

fn of_destination(change: impl FnOnce(&mut WayEnd)) -> Way {
    let mut way = whole();
    change(way.destination.as_mut().unwrap());
    way
}

fn of_route(change: impl FnOnce(&mut RouteFacts)) -> Way {
    let mut way = whole();
    change(way.route.as_mut().unwrap());
    way
}

fn registered(role: Role, host: &str, is_told_afar: bool, answer: ConnectOutcome) -> Registered {
    let (who, host) = ("/ear".to_owned(), host.to_owned());
    Registered { role, who, host, port: 4711, is_told_afar, answer }
}

fn elsewhere(cause: CauseCode, place: &str) -> Elsewhere {
    let remedy = "export ROS_DOMAIN_ID=4".to_owned();
    Elsewhere { cause, place: place.to_owned(), remedy, endpoint: publisher("/in") }
}

#[test]
fn nothing_is_missing_where_all_is_there() {
    let diagnosis = judge(&whole());
    assert_eq!(diagnosis.finding, None, "{diagnosis}");
    assert!(diagnosis.to_string().ends_with("nothing is missing"), "{diagnosis}");
    assert!(
        diagnosis.passed.iter().any(|step| step.contains("ros2:/in has 1 publisher")),
        "{diagnosis}"
    );
}

#[test]
fn a_publisher_that_is_not_the_bridge_is_heard_beside_a_route_that_is_not() {
    let way_of = |node: &str| {
        let mut way = of_source(|it| {
            it.found = vec![Discovered { node: Some(node.to_owned()), ..publisher("/in") }];
        });
        way.route.as_mut().unwrap().unheard = Some(Unheard {
            node: "/wrapyfi_bridge".to_owned(),
            text: "write a route from a to c".to_owned(),
            circle: Vec::new(),
        });
        way
    };
    let cause = |way: &Way| judge(way).finding.map(|found| found.cause);
    assert_eq!(cause(&way_of("/wrapyfi_bridge")), Some(CauseCode::OwnPublication));
    assert_eq!(cause(&way_of("/talker")), None);
}

#[test]
fn an_endpoint_that_no_route_of_the_file_means_lacks_a_route() {
    let way =
        Way { route: None, destination: None, without_route: Some("b.yaml".to_owned()), ..whole() };
    let found = judge(&way).finding.unwrap();
    assert_eq!(found.cause, CauseCode::NoRoute);
    assert!(found.what.contains("no route of b.yaml") && found.what.contains("ros2:/in"));
}

/// Each situation, its cause, words of what is said, words of the remedy.
#[test]
fn the_first_thing_that_is_missing_is_named_with_its_remedy() {
    let best_effort = |role| Discovered {
        qos: Some(AnnouncedQos {
            reliability: Reliability::BestEffort,
            ..AnnouncedQos::from(Qos::default())
        }),
        ..endpoint("/in", role, TEXT, QosPreset::Default)
    };
    let unresolved =
        || ConnectOutcome::Unresolved("host name \"robot\" does not resolve".to_owned());
    let nobody = |end: &mut WayEnd| end.found.retain(|one| one.role != Role::Publisher);
    let heard = Unheard {
        node: "/wrapyfi_bridge".to_owned(),
        text: "write a route from a to c".to_owned(),
        circle: Vec::new(),
    };
    let circle = Unheard {
        circle: vec!["ros2:/in".into(), "zeromq:/x".into(), "ros2:/in".into()],
        ..heard.clone()
    };
    for (way, cause, what, remedy) in [
        (
            of_route(|it| it.undefined = Some(("demo/msg/Odd".into(), "not found".into()))),
            CauseCode::Definition,
            "demo/msg/Odd",
            "definitions: [DIR]",
        ),
        (
            of_route(|it| it.left_out = Some(("ros:/raw".into(), LeftOut::Denied("raw".into())))),
            CauseCode::LeftOut,
            "left out by deny",
            "take \"raw\" out of `deny` in b.yaml",
        ),
        (
            of_route(|it| it.left_out = Some(("a -> b".into(), LeftOut::Written("cam".into())))),
            CauseCode::LeftOut,
            "the route cam has one of its ends",
            "wrapyfi why \"cam\" --config b.yaml",
        ),
        (
            of_route(|it| it.left_out = Some(("ros:/_x".into(), LeftOut::ByDefault))),
            CauseCode::LeftOut,
            "by default",
            "default_deny: false",
        ),
        (
            of_route(|it| it.limit = Some((2, 9))),
            CauseCode::Limit,
            "9 names match",
            "max_routes: 9",
        ),
        (
            of_source(|it| {
                it.servers =
                    vec![server_check(Server::Broker, "robot", unresolved(), false, false)];
            }),
            CauseCode::UnresolvedHost,
            "does not resolve",
            "hosts: { robot: ADDRESS }",
        ),
        (
            of_source(|it| {
                nobody(it);
                it.graph.as_mut().unwrap().unresolved =
                    vec!["the host \"robot\" is unknown".into()];
            }),
            CauseCode::UnresolvedHost,
            "nobody publishes ros2:/in, and the host \"robot\" is unknown",
            "/etc/hosts",
        ),
        (
            of_source(|it| {
                it.servers = vec![server_check(
                    Server::Broker,
                    "127.0.0.1",
                    ConnectOutcome::Refused,
                    true,
                    true,
                )];
            }),
            CauseCode::ServerAway,
            "nothing listens on port 5555",
            "wrapyfi bridge --config b.yaml",
        ),
        (
            of_source(|it| {
                it.servers = vec![server_check(
                    Server::Broker,
                    "10.0.0.2",
                    ConnectOutcome::Refused,
                    false,
                    false,
                )];
            }),
            CauseCode::LoopbackElsewhere,
            "listens on 127.0.0.1 of that machine alone",
            "on 10.0.0.2: start ZeroMQ broker",
        ),
        (
            of_destination(|it| {
                it.servers = vec![master("127.0.0.1", ConnectOutcome::Refused, true)];
            }),
            CauseCode::ServerAway,
            "ROS 1 master 127.0.0.1:5555 does not answer",
            "start ROS 1 master",
        ),
        (
            Way {
                route: None,
                ..of_destination(|it| {
                    it.servers = vec![master("127.0.0.1", ConnectOutcome::Refused, true)];
                })
            },
            CauseCode::ServerAway,
            "ROS 1 master 127.0.0.1:5555 does not answer",
            "a name of ROS 2 is written ros2:/",
        ),
        (
            of_destination(|it| {
                it.servers = vec![master("10.0.0.2", ConnectOutcome::Silent, false)];
            }),
            CauseCode::ServerAway,
            "a firewall is between",
            "ping 10.0.0.2",
        ),
        (
            of_destination(|it| it.away = Some("no answer from master".into())),
            CauseCode::Middleware,
            "ros does not work: no answer from master",
            "it has to be a ROS 1 master",
        ),
        (
            of_destination(|it| {
                (it.away, it.is_told) = (Some("no answer from broker".into()), true);
                it.slow = Some(Duration::from_millis(1800));
            }),
            CauseCode::Slow,
            "greets as a ZeroMQ broker does, and had no time for us in 1800 ms",
            "ask again",
        ),
        (
            of_destination(|it| {
                (it.away, it.is_told) = (Some("no answer from broker: keys".into()), true);
            }),
            CauseCode::Middleware,
            "no answer from broker: keys",
            "do what the reason says",
        ),
        (
            of_source(nobody),
            CauseCode::NobodyPublishes,
            "nobody publishes ros2:/in",
            "wrapyfi pub ros2:/in --type Text --value '\"hello\"'",
        ),
        (
            of_source(|it| {
                nobody(it);
                it.found.push(publisher("/In"));
            }),
            CauseCode::OtherName,
            "ros2:/In has 1 publisher (/publisher_node): the name differs by capital letters",
            "write ros2:/In instead of ros2:/in",
        ),
        (
            of_source(|it| {
                nobody(it);
                it.found.push(publisher("/lab/in"));
            }),
            CauseCode::OtherName,
            "the name differs by its namespace",
            "ros2:/lab/in",
        ),
        (
            of_source(|it| {
                nobody(it);
                it.elsewhere = vec![elsewhere(CauseCode::OtherDomain, "domain 4")];
            }),
            CauseCode::OtherDomain,
            "here (domain 3); in domain 4 there is 1 publisher",
            "ROS_DOMAIN_ID=4",
        ),
        (
            of_source(|it| {
                nobody(it);
                it.elsewhere = {
                    let place = "the same domain on another machine";
                    vec![elsewhere(CauseCode::DiscoveryRange, place)]
                };
            }),
            CauseCode::DiscoveryRange,
            "on another machine there is 1 publisher",
            "export",
        ),
        (
            of_source(|it| {
                nobody(it);
                let graph = it.graph.as_mut().unwrap();
                (graph.range, graph.range_setting) = ("OFF", "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF");
            }),
            CauseCode::DiscoveryRange,
            "nobody but itself (ROS_AUTOMATIC_DISCOVERY_RANGE=OFF)",
            "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET",
        ),
        (
            {
                let mut way = of_source(nobody);
                way.route.as_mut().unwrap().unheard = Some(heard);
                way
            },
            CauseCode::OwnPublication,
            "but this bridge, which ignores its own publications",
            "write a route from a to c",
        ),
        (
            {
                let mut way = of_source(nobody);
                way.route.as_mut().unwrap().unheard = Some(circle);
                way
            },
            CauseCode::Cycle,
            "a circle: ros2:/in -> zeromq:/x -> ros2:/in",
            "write a route from a to c",
        ),
        (
            of_destination(|it| {
                let answer = ConnectOutcome::Refused;
                it.registered = vec![registered(Role::Listener, "127.0.0.1", true, answer)];
            }),
            CauseCode::LoopbackAddress,
            "/ear has registered ros:/out at 127.0.0.1:4711, an address of its own machine alone",
            "export ROS_IP=ADDRESS where /ear runs",
        ),
        (
            of_destination(|it| {
                it.registered = vec![registered(Role::Listener, "arm", true, unresolved())];
            }),
            CauseCode::UnresolvedHost,
            "/ear has registered ros:/out at arm:4711",
            "hosts: { arm: ADDRESS }",
        ),
        (
            of_destination(|it| {
                let answer = ConnectOutcome::Refused;
                it.registered = vec![registered(Role::Listener, "127.0.0.1", false, answer)];
            }),
            CauseCode::PeerUnreachable,
            "it was killed, and its name remains",
            "rosnode cleanup",
        ),
        (
            of_source(|it| it.type_name = Some("std_msgs/msg/Int32".into())),
            CauseCode::Type,
            "/publisher_node on ros2:/in has type std_msgs/msg/String, the route has std_msgs/msg/Int32",
            "write `type: std_msgs/msg/String` on the route in b.yaml",
        ),
        (
            {
                let mut way = whole();
                way.interaction = Interaction::Service;
                let source = way.source.as_mut().unwrap();
                source.found = vec![endpoint("/in", Role::Server, TEXT, QosPreset::Default)];
                source.foreign = Some((ServiceMapping::FastDds, ServiceMapping::Cyclone));
                way
            },
            CauseCode::ServiceMapping,
            "/server_node speaks rmw_fastrtps_cpp",
            "export RMW_IMPLEMENTATION=rmw_fastrtps_cpp where the bridge starts",
        ),
        (
            of_source(|it| it.undefined = Some(("demo/msg/Odd".into(), "not found".into()))),
            CauseCode::Definition,
            "nobody here has a definition of demo/msg/Odd",
            "--definitions DIR",
        ),
        (
            of_source(|it| {
                nobody(it);
                it.found.push(best_effort(Role::Publisher));
                it.qos = Some(Qos::default());
            }),
            CauseCode::Qos,
            "/publisher_node of ros2:/in offers best effort, the route asks for reliable",
            "leave out `qos` on the route, or make the publisher reliable",
        ),
        (
            {
                let mut way = of_source(|it| it.found = vec![publisher("/in")]);
                way.destination.as_mut().unwrap().found = vec![listener("/out")];
                way
            },
            CauseCode::NoBridge,
            "no bridge runs the route",
            "wrapyfi bridge --config b.yaml",
        ),
        (
            {
                // A pattern.
                let way = of_source(|it| it.names = Some(1));
                Way { destination: None, others: Some(std::collections::BTreeMap::new()), ..way }
            },
            CauseCode::NoBridge,
            "no bridge runs the route: none is on the graph of ROS 2",
            "wrapyfi bridge --config b.yaml",
        ),
        (
            of_destination(|it| it.found.retain(|one| one.role != Role::Listener)),
            CauseCode::NobodyListens,
            "nobody listens to ros:/out",
            "wrapyfi echo ros:/out --type std_msgs/msg/String",
        ),
        (
            of_source(|it| {
                it.heard = 0;
                for one in &mut it.found {
                    one.traffic = Some(Traffic { messages: 0, bytes: 0, not_taken: 8 });
                }
            }),
            CauseCode::Drops,
            "the broker did not take 8 messages on ros2:/in",
            "max_message_mib",
        ),
        (
            of_source(|it| it.heard = 0),
            CauseCode::Idle,
            "no message came on ros2:/in within 600 ms: the connection is open and idle",
            "wrapyfi echo ros2:/in",
        ),
    ] {
        let diagnosis = judge(&way);
        let found = diagnosis.finding.clone().unwrap_or_else(|| panic!("{cause:?} is not found"));
        assert_eq!(found.cause, cause, "{diagnosis}");
        assert!(found.what.contains(what), "{what:?} is not in {diagnosis}");
        assert!(found.remedy.contains(remedy), "{remedy:?} is not in {diagnosis}");
        assert!(!found.who.is_empty(), "{diagnosis}");
    }
}

#[test]
fn two_programs_at_one_topic_are_compared_with_each_other() {
    let way = |change: &dyn Fn(&mut WayEnd)| {
        let mut way = of_source(|it| it.type_name = None);
        change(way.source.as_mut().unwrap());
        Way { route: None, destination: None, ..way }
    };
    assert_eq!(judge(&way(&|_| {})).finding, None);
    let other_type = judge(&way(&|it| {
        it.found =
            vec![publisher("/in"), endpoint("/in", Role::Listener, "a/msg/B", QosPreset::Default)];
    }));
    let found = other_type.finding.unwrap();
    assert_eq!(found.cause, CauseCode::Type);
    assert!(
        found.what.contains("has type std_msgs/msg/String, /listener_node wants a/msg/B"),
        "{found:?}"
    );
    let quality = judge(&way(&|it| {
        let latched = endpoint("/in", Role::Listener, TEXT, QosPreset::Latched);
        it.found = vec![publisher("/in"), latched];
    }));
    let found = quality.finding.unwrap();
    assert_eq!(found.cause, CauseCode::Qos);
    assert!(
        found.what.contains("offers volatile, /listener_node asks for transient local"),
        "{found:?}"
    );
    let wanted = "make the publisher transient local, or make the subscriber volatile";
    assert_eq!(found.remedy, wanted);
    let alone = judge(&way(&|it| it.found = vec![publisher("/in")]));
    assert_eq!(alone.finding.unwrap().cause, CauseCode::NobodyListens);
}

/// A status of the route in a bridge.
fn running(state: &str, cause: Option<Cause>, received: u64, sent: u64) -> Option<RouteInfo> {
    let (key, state) = ("lamp".to_owned(), state.to_owned());
    let info = RouteInfo { key, state, received, sent, ..RouteInfo::default() };
    Some(match cause {
        Some(cause) => caused(info, Some(&cause)),
        None => info,
    })
}

/// Cause that no program is there in a role at an address.
fn absent(role: Role, at: &str) -> Option<Cause> {
    Some(Absent::at(role, &address(at)).into())
}

/// Cause that a server does not answer.
fn away(server: &str) -> Option<Cause> {
    Some(Cause::ServerAway {
        server: Named { words: server.to_owned(), address: String::new() },
        detail: String::new(),
    })
}

#[test]
fn a_server_that_accepts_and_does_not_answer_is_not_said_to() {
    let way = of_destination(|it| it.away = Some("no answer from master".to_owned()));
    let passed = judge(&way).passed.join("\n");
    assert!(
        passed.contains("5555 accepts a connection") && !passed.contains("answers"),
        "{passed}"
    );
}

#[test]
fn who_sees_this_machine_alone_is_told_the_variable_that_counts() {
    let way = of_source(|it| {
        it.found.clear();
        let graph = it.graph.as_mut().unwrap();
        (graph.range, graph.range_setting) = ("LOCALHOST", "ROS_LOCALHOST_ONLY=1");
        graph.widening = "unset ROS_LOCALHOST_ONLY";
    });
    let found = judge(&way).finding.unwrap();
    assert!(found.remedy.ends_with("; or unset ROS_LOCALHOST_ONLY at both ends"), "{found:?}");
}

#[test]
fn a_zenoh_router_that_is_missing_is_the_finding() {
    let found = of_source(|end| {
        end.servers =
            vec![server_check(Server::Router, "localhost", ConnectOutcome::Refused, true, false)];
    });
    let found = judge(&found).finding.unwrap();
    assert_eq!(found.cause, CauseCode::ServerAway);
    let what =
        "Zenoh router localhost:5555 does not answer: nothing listens on port 5555 of this machine";
    assert_eq!((found.what.as_str(), found.remedy.as_str()), (what, "start Zenoh router"));
}
