//! Findings about the bridges that run a route or would, by what they tell of it.

use std::collections::BTreeMap;

use super::*;

#[test]
fn the_bridges_that_are_heard_say_whether_one_runs_the_route() {
    let beside = |others: &[(&str, &str)]| {
        let name = |(node, state): &(&str, &str)| {
            let status = BridgeStatus { state: (*state).to_owned(), ..BridgeStatus::default() };
            ((*node).to_owned(), status)
        };
        // Any other program that listens is no bridge.
        Way { others: Some(others.iter().map(name).collect()), ..whole() }
    };
    let found = |way: &Way| judge(way).finding.unwrap();
    for (others, what, remedy) in [
        (&[][..], "none is on the graph of ROS 2 (domain 3)", "wrapyfi bridge --config b.yaml"),
        (
            &[("/a", "active"), ("/b", "inactive")],
            "/a, /b (domain 3) has others",
            "--config b.yaml",
        ),
        (
            &[("/a", "unconfigured")],
            "/a",
            "; or ros2 lifecycle set /a configure && ros2 lifecycle set /a activate",
        ),
    ] {
        let found = found(&beside(others));
        assert_eq!(found.cause, CauseCode::NoBridge, "{found:?}");
        assert!(found.what.contains(what) && found.remedy.contains(remedy), "{found:?}");
    }
    // The one of the file's own node is not to be started once more, whatever is not there while it is unconfigured.
    let mut own = Way { node: "/a".to_owned(), ..beside(&[("/a", "unconfigured")]) };
    own.source.as_mut().unwrap().servers =
        vec![server_check(Server::Broker, "127.0.0.1", ConnectOutcome::Refused, true, true)];
    assert_eq!(found(&own).cause, CauseCode::State);
    assert_eq!(
        found(&own).remedy,
        "ros2 lifecycle set /a configure && ros2 lifecycle set /a activate"
    );
    let mut foreign = beside(&[("/a", "unconfigured")]);
    foreign.foreign.insert("/a".to_owned(), ServiceMapping::FastDds);
    let wanted = "; or RMW_IMPLEMENTATION=rmw_fastrtps_cpp ros2 lifecycle set /a configure";
    assert!(found(&foreign).remedy.contains(wanted), "{}", found(&foreign).remedy);
    let mut taken = beside(&[("/a", "active")]);
    let entry = "{from: \"ros2:/in\", to: \"ros:/out\"}".to_owned();
    taken.route.as_mut().unwrap().taken_from = Some(("/a".to_owned(), entry));
    let found = found(&taken);
    assert!(found.what.contains("it was taken out of /a"), "{found:?}");
    let wanted = "wrapyfi call ros2:/a/add_route --value '{\"route\":\"{from: \\\"ros2:/in\\\",";
    assert!(found.remedy.starts_with(wanted), "{found:?}");
}

#[test]
fn bridges_that_carry_the_same_route_are_named_before_their_names() {
    let of = |also: &[&str]| {
        let status = || Discovered::new("/one/status", Role::Publisher);
        let mut way = of_source(|it| it.found.extend([status(), status()]));
        (way.node, way.running) = ("/one".to_owned(), running("active", None, 40, 40));
        way.also = also.iter().map(|node| (*node).to_owned()).collect();
        judge(&way).finding.unwrap()
    };
    assert_eq!(of(&[]).cause, CauseCode::SameNode);
    let found = of(&["/one", "/two"]);
    assert_eq!(found.cause, CauseCode::SeveralBridges);
    let wanted = "3 bridges run the route, /one, /one, /two: each message comes 3 times";
    assert_eq!(found.what, wanted);
}

/// The publisher has gone, and the cause that is nearer hides that messages come twice when it is back.
#[test]
fn bridges_that_carry_the_same_route_are_named_also_while_it_waits() {
    let mut way = of_source(|it| it.found.retain(|one| one.role != Role::Publisher));
    (way.node, way.also) = ("/one".to_owned(), vec!["/two".to_owned()]);
    way.running = running("waiting", absent(Role::Publisher, "ros2:/in"), 40, 40);
    let told = judge(&way);
    assert_eq!(told.finding.unwrap().cause, CauseCode::NobodyPublishes);
    let wanted = "2 bridges run the route, /one, /two: each message comes 2 times; end all of them but one, or take the \
                  route out of their files";
    assert!(told.passed.iter().any(|one| one == wanted), "{:?}", told.passed);
}

#[test]
fn a_bridge_that_runs_the_route_is_not_to_be_started_for_its_broker() {
    let of = |running| {
        let own = || server_check(Server::Broker, "127.0.0.1", ConnectOutcome::Refused, true, true);
        let way = of_source(|it| it.servers = vec![own()]);
        judge(&Way { running, ..way }).finding.unwrap().remedy
    };
    assert!(of(None).starts_with("wrapyfi bridge --config b.yaml"));
    assert_eq!(of(running("waiting", away("the broker"), 0, 0)), "start ZeroMQ broker");
}

#[test]
fn a_broker_that_is_silent_in_a_stopped_bridge_is_not_to_be_looked_at() {
    let broker = || server_check(Server::Broker, "127.0.0.1", ConnectOutcome::Open, true, true);
    let way = of_source(|it| {
        (it.servers, it.away) = (vec![broker()], Some("no answer from the broker".to_owned()));
    });
    assert!(judge(&way).finding.unwrap().remedy.contains("look what runs on port 5555"));
    let what = "`wrapyfi bridge --config b.yaml` is stopped".to_owned();
    let stopped = Finding::new(CauseCode::NoBridge, what, "whoever stopped it", "kill -CONT 7");
    for route in [way.route.clone(), None] {
        let way = Way { route, stopped: Some(stopped.clone()), ..way.clone() };
        assert_eq!(judge(&way).finding, Some(stopped.clone()));
    }
}

#[test]
fn a_bridge_that_would_offer_a_name_says_why_it_does_not() {
    let of = |state: &str, cause: Option<Cause>| {
        let way = of_source(|it| it.found.clear());
        let (node, running) = ("/eye".to_owned(), running(state, cause, 0, 0));
        judge(&Way { route: None, destination: None, node, running, ..way }).finding.unwrap()
    };
    let found = of("waiting", Some(Cause::Inactive));
    assert!(found.what.contains("the bridge /eye is inactive"), "{found:?}");
    assert_eq!(found.remedy, "ros2 lifecycle set /eye activate");
    let way = Way { node: "/eye".to_owned(), ..whole() };
    let running = running("waiting", Some(Cause::Inactive), 0, 0);
    let foreign = [("/eye".to_owned(), ServiceMapping::FastDds)].into();
    let found = judge(&Way { running, foreign, ..way }).finding.unwrap();
    let wanted = "RMW_IMPLEMENTATION=rmw_fastrtps_cpp ros2 lifecycle set /eye activate";
    assert_eq!(found.remedy, wanted);
    let found = of("waiting", away("the broker at tcp://x"));
    assert!(found.what.contains("the route lamp of /eye waits for the broker"), "{found:?}");
    assert_eq!(of("active", None).cause, CauseCode::NobodyPublishes);
}

#[test]
fn what_passes_is_believed_before_the_list_of_a_master_that_was_restarted() {
    let of = |state: &str, sent: u64, change: &dyn Fn(&mut WayEnd)| {
        let mut way = of_destination(change);
        (way.node, way.running) = ("/eye".to_owned(), running(state, None, 40, sent));
        judge(&way)
    };
    let forgotten = |it: &mut WayEnd| it.found.retain(|one| one.role != Role::Listener);
    let passes = of("active", 40, &forgotten);
    assert_eq!(passes.finding, None, "{passes}");
    let said = passes.passed.join("\n");
    for words in ["40 in, 40 out", "nobody listens to ros:/out that the ROS 1 master knows"] {
        assert!(said.contains(words), "{words:?} is not in {said}");
    }
    let found = of("waiting", 40, &forgotten).finding.unwrap();
    assert_eq!(found.cause, CauseCode::NobodyListens, "{found:?}");
    let quiet = of("active", 0, &forgotten);
    assert_eq!(quiet.finding, None, "{quiet}");
    assert!(quiet.to_string().contains("the bridge /eye has it, but nobody listens"), "{quiet}");
    let slow = |it: &mut WayEnd| {
        forgotten(it);
        (it.away, it.slow) = (Some("no answer from broker".into()), Some(Duration::from_secs(2)));
    };
    assert_eq!(of("active", 40, &slow).finding, None);
    assert_eq!(of("active", 0, &slow).finding.unwrap().cause, CauseCode::Slow);
    let gone = |it: &mut WayEnd| {
        it.registered =
            vec![registered(Role::Listener, "127.0.0.1", false, ConnectOutcome::Refused)];
    };
    assert_eq!(of("active", 40, &gone).finding, None);
    assert_eq!(of("active", 0, &gone).finding.unwrap().cause, CauseCode::PeerUnreachable);
}

/// A server, and a publisher while no program listens, that the bridge has and a new list has not.
#[test]
fn what_a_bridge_has_is_believed_also_where_nothing_passes() {
    let of = |kind: &str, state: &str, has_source: bool| {
        let mut way = whole();
        let (source, destination) = (way.source.as_mut(), way.destination.as_mut());
        let (source, destination) = (source.unwrap(), destination.unwrap());
        std::mem::swap(source, destination);
        source.found.clear();
        destination.found.retain(|one| one.role == Role::Publisher);
        let info = running(state, absent(Role::Listener, "ros2:/in"), 0, 0).unwrap();
        way.running = Some(RouteInfo { kind: kind.to_owned(), has_source, ..info });
        way.interaction = kind.parse().unwrap();
        judge(&way)
    };
    let lamp = of("service", "active", true);
    assert_eq!(lamp.finding, None, "{lamp}");
    assert!(lamp.to_string().contains("has it, but nobody offers ros:/out that the"), "{lamp}");
    let unheard = of("topic", "waiting", true);
    assert!(unheard.to_string().contains("has it, but nobody publishes ros:/out"), "{unheard}");
    assert_eq!(unheard.finding.unwrap().cause, CauseCode::NobodyListens);
    let gone = of("service", "waiting", false);
    assert_eq!(gone.finding.unwrap().cause, CauseCode::NobodyOffers);
}

#[test]
fn a_mere_name_that_a_bridge_takes_is_there() {
    let of = |address: &str, has_source| {
        let mut way = of_destination(|it| it.found.clear());
        way.source = way.destination.take();
        let [source, destination, kind] = ["ros2:/x", "ros:/out", "service"].map(str::to_owned);
        let state = running("active", None, 0, 0).unwrap();
        let (resolved_source, resolved_destination) = (source.clone(), destination.clone());
        let state = RouteInfo { resolved_source, resolved_destination, ..state };
        way.running = Some(RouteInfo { source, destination, kind, has_source, ..state });
        (way.node, way.route, way.interaction) = ("/eye".to_owned(), None, Interaction::Service);
        way.source.as_mut().unwrap().address = self::address(address);
        judge(&way)
    };
    let lamp = of("ros:/out", true);
    assert_eq!(lamp.finding, None, "{lamp}");
    assert!(lamp.to_string().contains("the bridge /eye has it, but nobody offers"), "{lamp}");
    for (address, has_source) in [("ros:/out", false), ("ros:/other", true)] {
        assert_eq!(of(address, has_source).finding.unwrap().cause, CauseCode::NobodyOffers);
    }
}

/// A publisher there, as a remedy would have it, would speak into a robot's port.
#[test]
fn a_mere_name_to_which_a_bridge_brings_messages_lacks_no_publisher() {
    let of = |state: &str, cause: Option<Cause>| {
        let mut way = of_destination(|it| it.found.clear());
        way.source = way.destination.take();
        let [source, destination, kind] = ["ros2:/x", "ros:/out", "topic"].map(str::to_owned);
        let state = running(state, cause, 9, 9).unwrap();
        let (resolved_source, resolved_destination) = (source.clone(), destination.clone());
        let state = RouteInfo { resolved_source, resolved_destination, ..state };
        way.running = Some(RouteInfo { source, destination, kind, ..state });
        (way.node, way.route) = ("/eye".to_owned(), None);
        judge(&way)
    };
    let brought = of("active", None).to_string();
    assert!(brought.contains("the route lamp of /eye brings it"), "{brought}");
    let found = of("waiting", absent(Role::Publisher, "ros2:/x")).finding.unwrap();
    assert!(found.what.contains("the route lamp of /eye waits for a publisher"), "{found:?}");
}

#[test]
fn what_keeps_a_route_that_runs_names_the_nearest_cause() {
    // A publisher of two is gone: messages of the other come.
    let both = [ConnectOutcome::Refused, ConnectOutcome::Open]
        .map(|answer| registered(Role::Listener, "127.0.0.1", false, answer));
    let way = of_destination(|it| it.registered = both.to_vec());
    let diagnosis = judge(&way);
    assert_eq!(diagnosis.finding, None, "{diagnosis}");
    assert!(diagnosis.to_string().contains("it was killed, and its name remains"), "{diagnosis}");
    // A limit is no reason for a name that no program has.
    let mut nobody = of_source(|it| it.found.clear());
    nobody.route.as_mut().unwrap().limit = Some((2, 9));
    assert_eq!(judge(&nobody).finding.unwrap().cause, CauseCode::NobodyPublishes);
    // The routes of a pattern are there, whatever a new list says.
    let mut pattern = of_source(|it| it.names = Some(0));
    (pattern.destination, pattern.node) = (None, "/eye".to_owned());
    assert!(judge(&pattern).finding.unwrap().what.contains("no name matches"));
    pattern.running = running("active", None, 9, 9);
    let diagnosis = judge(&pattern);
    assert_eq!(diagnosis.finding, None, "{diagnosis}");
    // No program has connected to our own broker, and a client speaks another mapping.
    let mut light = whole();
    light.interaction = Interaction::Service;
    light.source = Some(WayEnd { found: Vec::new(), ..WayEnd::new(address("zeromq:/light")) });
    let waiting = || running("waiting", absent(Role::Server, "zeromq:/light"), 0, 0).unwrap();
    light.running = Some(RouteInfo { kind: "service".to_owned(), ..waiting() });
    let found = judge(&light).finding.unwrap();
    assert_eq!(found.cause, CauseCode::NobodyOffers, "{found:?}");
    assert!(found.remedy.contains("wrapyfi serve zeromq:/light"), "{found:?}");
    let drop_reasons = vec![wrapyfi_endpoint::DropReason::ServiceMapping.to_string()];
    let mapped =
        RouteInfo { received: 3, dropped: 3, drop_reasons, drop_counts: vec![3], ..waiting() };
    light.running = Some(RouteInfo { kind: "service".to_owned(), ..mapped });
    assert_eq!(judge(&light).finding.unwrap().cause, CauseCode::ServiceMapping);
}

#[test]
fn a_publisher_that_the_bridge_alone_remembers_is_told_so() {
    let way = |is_unregistered| {
        let mut way = of_source(|it| {
            it.address = address("yarp:/in");
            it.servers = vec![server_check(
                Server::NameServer,
                "127.0.0.1",
                ConnectOutcome::Open,
                true,
                false,
            )];
            it.is_unregistered = is_unregistered;
        });
        way.running = running("active", None, 4, 4);
        judge(&way).to_string()
    };
    let said =
        "yarp:/in has 1 publisher (/publisher_node), but nobody publishes yarp:/in that the YARP";
    assert!(way(true).contains(said), "{}", way(true));
    assert!(!way(false).contains("but nobody"), "{}", way(false));
}

#[test]
fn a_client_of_another_mapping_than_the_bridge_is_named() {
    let of = |foreign, clients| {
        let mut way = of_destination(|it| {
            it.found = vec![endpoint("/out", Role::Client, TEXT, QosPreset::Default)];
            (it.foreign, it.clients) = (foreign, clients);
        });
        way.source.as_mut().unwrap().found =
            vec![endpoint("/in", Role::Server, TEXT, QosPreset::Default)];
        (way.interaction, way.running) = (Interaction::Service, running("active", None, 0, 0));
        judge(&way)
    };
    assert_eq!(of(None, None).finding, None);
    let foreign = Some((ServiceMapping::FastDds, ServiceMapping::Cyclone));
    let ours = of(foreign, None);
    assert_eq!(ours.finding, None);
    assert!(ours.to_string().contains("needs RMW_IMPLEMENTATION=rmw_fastrtps_cpp"), "{ours}");
    let clients = Some((ServiceMapping::Cyclone, ServiceMapping::FastDds));
    let found = of(foreign, clients).finding.unwrap();
    assert_eq!(found.cause, CauseCode::ServiceMapping);
    assert!(found.what.contains("/client_node speaks rmw_cyclonedds_cpp"), "{found:?}");
    assert!(found.remedy.contains("rmw_fastrtps_cpp where /client_node does"), "{found:?}");
    // A service that no route has.
    let bare = of_source(|it| {
        let with = |role| endpoint("/in", role, TEXT, QosPreset::Default);
        (it.found, it.clients) = ([Role::Server, Role::Client].map(with).into(), clients);
    });
    let bare = Way { interaction: Interaction::Service, route: None, destination: None, ..bare };
    let found = judge(&bare).finding.unwrap();
    assert_eq!(found.cause, CauseCode::ServiceMapping);
    assert!(found.remedy.contains("rmw_cyclonedds_cpp where the server starts"), "{found:?}");
}

/// A shell may have another mapping than the bridge that runs the route.
#[test]
fn a_server_is_judged_by_the_mapping_of_the_bridge_that_runs_the_route() {
    const CYCLONE: &str = "export RMW_IMPLEMENTATION=rmw_cyclonedds_cpp where the bridge starts";
    let mappings = [ServiceMapping::Cyclone, ServiceMapping::FastDds];
    let of = |foreign: Option<ServiceMapping>, running| {
        let mut way = of_source(|it| {
            it.found = vec![endpoint("/in", Role::Server, TEXT, QosPreset::Default)];
            it.foreign = Some((mappings[0], mappings[1]));
        });
        (way.interaction, way.running) = (Interaction::Service, running);
        way.node = "/eye".to_owned();
        way.foreign = foreign.map(|it| ("/eye".to_owned(), it)).into_iter().collect();
        way
    };
    let well = || running("active", None, 1, 1);
    assert_eq!(judge(&of(Some(mappings[0]), well())).finding, None);
    for way in [of(None, well()), of(Some(mappings[0]), None)] {
        let found = judge(&way).finding.unwrap();
        assert_eq!(found.cause, CauseCode::ServiceMapping);
        assert!(found.remedy.starts_with(CYCLONE), "{found:?}");
    }
    // The shell and the server have the same one, and the bridge has not.
    let server = Absent::new(Role::Server, "a server of", "ros2", "/in");
    let [theirs, ours] = ["rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"];
    let cause = Cause::ServiceMapping { absent: server, theirs, ours };
    let mut way = of(Some(mappings[1]), running("waiting", Some(cause), 0, 0));
    way.source.as_mut().unwrap().foreign = None;
    let [kind, to] = ["service", "ros2:/in"].map(str::to_owned);
    let status = way.running.take().unwrap();
    way.running =
        Some(RouteInfo { kind, destination: to.clone(), resolved_destination: to, ..status });
    let bare = Way { route: None, destination: None, ..way.clone() };
    for way in [way, bare] {
        let found = judge(&way).finding.unwrap();
        assert_eq!(found.cause, CauseCode::ServiceMapping);
        assert!(found.remedy.starts_with(CYCLONE), "{found:?}");
        assert!(found.what.contains("in the way of rmw_fastrtps_cpp in the bridge"), "{found:?}");
    }
}

/// The program that listens in its place has the port itself.
#[test]
fn an_input_port_that_nobody_has_opened_is_opened_by_what_is_to_be_tried() {
    let of = |found: Vec<Discovered>| {
        let mut way = of_destination(|it| {
            (it.address, it.type_name) = (address("yarp:/robot/in"), Some("Text".to_owned()));
            (it.servers, it.found) = (Vec::new(), found);
        });
        let status =
            running("waiting", Some(Cause::NotOpened(address("yarp:/robot/in"))), 0, 0).unwrap();
        let [source, destination] = ["ros2:/in", "yarp:/robot/in"].map(str::to_owned);
        way.running = Some(RouteInfo { source, destination, ..status });
        judge(&way).finding.unwrap()
    };
    let told = Discovered::new("/robot/in", Role::Listener);
    for (found, cause) in
        [(of(Vec::new()), CauseCode::NobodyListens), (of(vec![told]), CauseCode::State)]
    {
        assert_eq!(found.cause, cause, "{found:?}");
        let wanted = "wrapyfi echo yarp:/robot/in --type Text --option port=/robot/in";
        assert!(found.remedy.ends_with(wanted), "{found:?}");
    }
}

#[test]
fn two_bridges_of_one_node_name_are_named() {
    let with = |bridges: usize, running: bool, is_own: bool| {
        let status = || Discovered::new("/wrapyfi_bridge/status", Role::Publisher);
        let mut way = of_source(|it| it.found.extend((0..bridges).map(|_| status())));
        way.running = running.then(RouteInfo::default);
        way.node = "/wrapyfi_bridge".to_owned();
        way.route.as_mut().unwrap().is_own = is_own;
        judge(&way).finding
    };
    for running in [false, true] {
        let of_command = |bridges| with(bridges, running, false);
        let one = [of_command(0), of_command(1)];
        assert_eq!(one, [None, None], "a command sees the one bridge that there is");
        assert!(of_command(2).is_some());
    }
    assert_eq!(with(0, true, true), None);
    let found = with(1, true, true).unwrap();
    assert_eq!(found.cause, CauseCode::SameNode);
    assert!(found.what.contains("/wrapyfi_bridge") && found.remedy.contains("__node:="));
}

#[test]
fn routes_of_parameters_are_mended_by_parameters() {
    let node = "/ros1_bridge".to_owned();
    let left_out = Some(("ros:/raw".to_owned(), LeftOut::Denied("raw".to_owned())));
    let denied = RouteFacts { left_out, ..RouteFacts::default() };
    let denied = Way { route: Some(denied), ..Way::default() };
    let unknown = Way { destination: None, without_route: Some("x".to_owned()), ..whole() };
    let broken = Way { running: running("error", Some(Cause::NoName), 0, 0), ..whole() };
    let other_type = of_source(|it| it.type_name = Some("std_msgs/msg/Int32".to_owned()));
    let other_type = judge(&Way { is_of_parameters: true, ..other_type }).finding.unwrap();
    assert_eq!(other_type.cause, CauseCode::Type);
    assert!(other_type.remedy.contains("needs a file (-p config_file:=FILE)"), "{other_type:?}");
    for (way, parameter) in [(denied, "`deny`"), (unknown, "`prefix`"), (broken, "`deny`")] {
        let of = |is_of_parameters| {
            let way = Way { node: node.clone(), is_of_parameters, ..way.clone() };
            judge(&way).finding.unwrap()
        };
        let (file, parameters) = (of(false), of(true));
        assert!(!file.remedy.contains("config_file"), "{file:?}");
        assert!(parameters.remedy.contains(parameter), "{parameters:?}");
        assert!(parameters.remedy.contains("config_file"), "{parameters:?}");
        assert_eq!(parameters.who, "whoever starts /ros1_bridge");
    }
}

#[test]
fn a_program_that_hangs_is_named_once_nothing_comes_of_it() {
    let of = |messages_per_s| {
        let mut way = of_source(|it| {
            it.address = address("ros:/in");
            it.registered =
                vec![registered(Role::Publisher, "10.0.0.2", false, ConnectOutcome::AcceptsOnly)];
        });
        let running = running("active", None, 40, 40).unwrap();
        way.running = Some(RouteInfo { messages_per_s, ..running });
        judge(&way)
    };
    let found = of(0.0).finding.unwrap();
    assert_eq!(found.cause, CauseCode::PeerUnreachable);
    assert!(found.what.contains("/ear has registered ros:/in at 10.0.0.2:4711"), "{found:?}");
    assert!(
        found.what.contains("nobody answers") && found.remedy.contains("kill -CONT"),
        "{found:?}"
    );
    assert!(of(10.0).passed.iter().any(|step| step.contains("messages pass all the same")));
}

#[test]
fn a_look_that_ended_early_denies_no_listener_where_messages_pass() {
    let of = |is_cut, messages_per_s| {
        let mut way = of_destination(|it| {
            (it.address, it.servers) = (address("ros2:/out"), vec![]);
            it.found.retain(|one| one.role != Role::Listener);
            it.is_cut = is_cut;
        });
        let running = running("active", None, 40, 40).unwrap();
        way.running = Some(RouteInfo { messages_per_s, ..running });
        judge(&way).finding.map(|found| found.cause)
    };
    assert_eq!(of(true, 10.0), None);
    // What has passed before, and a look that saw everything, tell of a listener that has left.
    assert_eq!(of(true, 0.0), Some(CauseCode::NobodyListens));
    assert_eq!(of(false, 10.0), Some(CauseCode::NobodyListens));
}

/// A mere name, of which no bridge has a route.
fn bare() -> Way {
    Way { route: None, destination: None, ..whole() }
}

#[test]
fn a_killed_listener_of_a_mere_name_is_none() {
    let mut way = bare();
    let dead = registered(Role::Listener, "10.0.0.2", false, ConnectOutcome::Refused);
    let source = way.source.as_mut().unwrap();
    (source.address, source.registered) = (address("ros:/in"), vec![dead]);
    let found = judge(&way).finding.unwrap();
    assert_eq!(found.cause, CauseCode::PeerUnreachable);
    assert!(found.what.contains("it was killed, and its name remains"), "{found:?}");
    let there = registered(Role::Listener, "10.0.0.2", false, ConnectOutcome::Open);
    way.source.as_mut().unwrap().registered.push(there);
    assert_eq!(judge(&way).finding, None);
}

#[test]
fn bridges_that_carry_a_mere_name_twice_are_named() {
    let (also, node) = (vec!["/two".to_owned()], "/one".to_owned());
    let way = Way { running: running("active", None, 40, 40), also, node, ..bare() };
    let found = judge(&way).finding.unwrap();
    assert_eq!(found.cause, CauseCode::SeveralBridges);
    assert!(found.what.starts_with("2 bridges run the route lamp, /one, /two"), "{found:?}");
}

#[test]
fn a_bridge_of_another_domain_is_not_to_be_started_once_more() {
    let other_domain = Some((7, "/lab/bridge".to_owned()));
    let way = Way { other_domain, others: Some(BTreeMap::new()), ..whole() };
    let found = judge(&way).finding.unwrap();
    assert_eq!(found.cause, CauseCode::OtherDomain);
    let wanted = "no bridge runs the route here (domain 3): /lab/bridge does in domain 7 of ROS 2";
    assert_eq!(found.what, wanted);
    assert!(found.remedy.starts_with("export ROS_DOMAIN_ID=7 in this shell"), "{found:?}");
}

/// Of what is in another domain than the bridge nothing here tells.
#[test]
fn another_domain_comes_before_what_is_not_here() {
    let mut way = Way { other_domain: Some((7, "/lab/bridge".to_owned())), ..whole() };
    way.source.as_mut().unwrap().found.clear();
    assert_eq!(judge(&way).finding.unwrap().cause, CauseCode::OtherDomain);
    way.other_domain = None;
    assert_eq!(judge(&way).finding.unwrap().cause, CauseCode::NobodyPublishes);
    let there = |cause| Finding::new(cause, "`wrapyfi bridge`".to_owned(), "", "");
    way.stopped = Some(there(CauseCode::OtherDomain));
    assert_eq!(judge(&way).finding, way.stopped);
    way.stopped = Some(there(CauseCode::NoBridge));
    assert_eq!(judge(&way).finding.unwrap().cause, CauseCode::NobodyPublishes);
}

/// A broker of others does not tell who listens.
#[test]
fn a_listener_on_zeromq_is_known_to_the_bridge() {
    let mut way = Way { running: running("active", None, 40, 40), ..whole() };
    let destination = way.destination.as_mut().unwrap();
    (destination.address, destination.found) = (address("zeromq:/out"), Vec::new());
    assert_eq!(judge(&way).finding, None);
    way.running = running("waiting", absent(Role::Listener, "ros2:/out"), 40, 0);
    assert_eq!(judge(&way).finding.unwrap().cause, CauseCode::NobodyListens);
}

/// Only the bridge can listen to a publisher of ROS 1 unannounced.
#[test]
fn a_publisher_of_ros_1_from_which_nothing_came_is_idle() {
    let of = |received: u64, rate: f64| {
        let mut way = Way { running: running("active", None, received, received), ..whole() };
        let source = way.source.as_mut().unwrap();
        (source.address, source.silent, source.heard) = (address("ros:/in"), None, 0);
        let running = way.running.as_mut().unwrap();
        (running.resolved_source, running.messages_per_s) = ("ros:/in".to_owned(), rate);
        judge(&way)
    };
    assert_eq!(of(0, 0.0).finding.unwrap().cause, CauseCode::Idle);
    let rests = of(40, 0.0);
    assert_eq!(rests.finding, None);
    assert!(rests.passed.iter().any(|it| it.ends_with("in the last second")), "{rests:?}");
    assert!(!of(40, 9.0).passed.iter().any(|it| it.ends_with("in the last second")));
}

#[test]
fn a_bridge_on_another_master_is_told_where_the_master_of_the_shell_lacks_it() {
    let of = |state: &str, resolved_destination: &str, found: Vec<Discovered>| {
        let mut way = of_destination(|it| it.found = found);
        let running = running(state, None, 40, 40).unwrap();
        let resolved_destination = resolved_destination.to_owned();
        way.running = Some(RouteInfo { resolved_destination, ..running });
        way.node = "/eye".to_owned();
        judge(&way).finding
    };
    let found = of("active", "ros:/out", vec![listener("/out")]).unwrap();
    assert_eq!(found.cause, CauseCode::OtherMaster, "{found:?}");
    for words in ["has no publication of ros:/out", "the route lamp of /eye is active"] {
        assert!(found.what.contains(words), "{found:?}");
    }
    assert!(found.remedy.contains("set ROS_MASTER_URI in this shell"), "{found:?}");
    let both = || vec![publisher("/out"), listener("/out")];
    assert_eq!(of("active", "ros:/out", both()), None);
    assert_eq!(of("active", "ros:/other", vec![listener("/out")]), None);
}

#[test]
fn a_pattern_that_would_bring_a_name_is_named_with_its_source() {
    let pattern = |key: &str, source: &str, destination: &str| {
        let [key, source, destination] = [key, source, destination].map(str::to_owned);
        RouteInfo { key, source, destination, kind: "topic".to_owned(), ..RouteInfo::default() }
    };
    let routes = vec![
        pattern("there", "ros2:/(.*)", "ros:/$1"),
        pattern("back", "ros:/(.*)", "ros2:/robot/$1"),
        pattern("ports", "ros2:/(.*)", "yarp:/$1"),
    ];
    let status = BridgeStatus { routes, ..BridgeStatus::default() };
    let all = [("/eye".to_owned(), status)].into();
    let to = |text: &str| super::super::super::bridges::pattern_to(&address(text), &all);
    assert_eq!(to("ros2:/raw"), None);
    assert_eq!(to("yarp:/head/command:i").unwrap().2, address("ros2:/head/command/i"));
    let found = to("ros2:/robot/raw").unwrap();
    assert_eq!(found, ("/eye".to_owned(), "back".to_owned(), address("ros:/raw")));
    let mut way = of_source(|it| it.found.clear());
    (way.route, way.destination, way.brought_by_pattern) = (None, None, Some(found));
    let found = judge(&way).finding.unwrap();
    assert_eq!(found.cause, CauseCode::NobodyPublishes);
    assert!(found.what.contains("the pattern back of /eye makes no route to it"), "{found:?}");
    assert!(found.remedy.starts_with("`wrapyfi why ros:/raw --node /eye`"), "{found:?}");
}

#[test]
fn on_zeromq_a_route_that_runs_tells_nothing_of_a_publisher() {
    let of = |received: u64, others: &[&str]| {
        let mut way = of_source(|it| {
            it.address = address("zeromq:/in");
            (it.graph, it.silent, it.heard) = (None, None, 0);
            let named = |name: &&str| Discovered::new(*name, Role::Publisher);
            it.found = others.iter().map(named).collect();
        });
        let running = running("active", None, received, received).unwrap();
        let resolved_source = "zeromq:/in".to_owned();
        way.running = Some(RouteInfo { resolved_source, ..running });
        judge(&way).finding
    };
    let nobody = of(0, &[]).unwrap();
    assert_eq!(nobody.cause, CauseCode::NobodyPublishes, "{nobody:?}");
    assert!(nobody.what.contains("nobody publishes it, or is silent"), "{nobody:?}");
    let slash = of(0, &["in"]).unwrap();
    assert_eq!(slash.cause, CauseCode::OtherName, "{slash:?}");
    assert!(slash.what.contains("zeromq:in has 1 publisher: the name differs by a slash"));
    assert_eq!(of(5, &[]), None, "a publisher that has ended, or is silent");
}

#[test]
fn another_program_at_one_port_of_a_broker_is_named_before_the_port_that_nobody_has() {
    let rep = || ConnectOutcome::Foreign("a ZeroMQ socket of type REP".to_owned());
    let checks = [ConnectOutcome::Refused, rep()];
    let checks = checks.map(|it| server_check(Server::Broker, "127.0.0.1", it, true, true));
    let found = judge(&of_source(|it| it.servers = checks.to_vec())).finding.unwrap();
    assert!(found.what.contains("a ZeroMQ socket of type REP has port 5555"), "{found:?}");
    assert!(found.remedy.contains("end that program"), "{found:?}");
}

#[test]
fn a_mere_name_whose_route_waits_is_not_called_idle() {
    let way = of_source(|it| (it.silent, it.heard) = (None, 0));
    let running = running("waiting", absent(Role::Listener, "ros:/out"), 9, 0).unwrap();
    let running = RouteInfo { has_source: true, resolved_source: "ros2:/in".to_owned(), ..running };
    let way = Way { route: None, destination: None, running: Some(running), ..way };
    let found = judge(&way).finding.unwrap();
    assert!(found.what.contains("waits for a listener on ros:/out"), "{found:?}");
}
