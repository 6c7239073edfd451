//! Patterns between two buses of one process.

use std::sync::Arc;

use super::super::{Available, Config, Engine, PatternCounts, Plan, RouteStatus};
use super::*;
use wrapyfi_data::types::{Map, MessageType, Payload, RosAction, RosType, ServiceKind, Value};
use wrapyfi_endpoint::memory::Memory;
use wrapyfi_endpoint::{
    ActionSpec, Context, Conventions, Discovered, LearnError, LearnResult, Learned, Listener,
    Middleware, Opened, Publisher, RoutingProperties, ServiceSpec, TopicSpec, topic_of_name,
};
use wrapyfi_interfaces::parser::{Dialect, TypeName};
use wrapyfi_interfaces::store::ResolvedType;

#[derive(Debug, Default, serde::Deserialize)]
struct NoEndpoints {}

const MS: Duration = Duration::from_millis(1);

/// Two buses, `a` and `b`, and the routes between them.
struct Bench {
    a: Arc<Memory>,
    b: Arc<Memory>,
    engine: Engine,
    now: Instant,
}

fn engine(
    a: &Arc<impl Middleware + 'static>,
    b: &Arc<impl Middleware + 'static>,
    routes: &[&str],
) -> Engine {
    let mut registry = Registry::new();
    registry.register(Arc::clone(a) as _);
    registry.register(Arc::clone(b) as _);
    let text: String = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect();
    let config: Config<NoEndpoints> =
        Config::from_yaml(&format!("routes:\n{text}"), "bridge.yaml").unwrap();
    let known = |name| {
        let conventions = Conventions {
            has_ros_names: name == "a",
            node_services: &[&["get_parameters"]],
            ..Conventions::NONE
        };
        let interactions = &Interaction::ALL;
        Available { name, conventions, interactions, ..Available::default() }
    };
    let mut types = TypeStore::generated();
    let plan = Plan::new(&config, &[known("a"), known("b")], &mut types, "bridge.yaml").unwrap();
    Engine::new(plan, &registry).with_types(TypeStore::generated())
}

impl Bench {
    fn new(routes: &[&str]) -> Self {
        let (a, b) = (Arc::new(Memory::new("a")), Arc::new(Memory::new("b")));
        let engine = engine(&a, &b, routes);
        Self { a, b, engine, now: Instant::now() }
    }

    /// Runs for `time`, in steps as a route takes them.
    fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.now += 100 * MS;
            self.engine.step(self.now);
        }
    }

    fn state(&self, name: &str) -> Option<String> {
        let status = self.engine.status();
        status.iter().find(|route| route.name == name).map(|route| route.state.to_string())
    }

    fn counts(&self) -> PatternCounts {
        self.engine.status().iter().find_map(|route| route.pattern).unwrap()
    }

    fn names(&self) -> Vec<String> {
        let status = self.engine.status();
        status.into_iter().filter(|it| it.pattern.is_none()).map(|it| it.name).collect()
    }
}

fn publisher(bus: &Memory, topic: &str, message_type: MessageType) -> Box<dyn Publisher> {
    bus.open_publisher(&TopicSpec::new(topic, message_type), &Context::default()).unwrap()
}

/// A type that the engine has no definition of.
fn unknown(name: &str) -> MessageType {
    let mut types = TypeStore::empty();
    types.add_definition(&TypeName::parse(Dialect::Ros2, name).unwrap(), "bool a").unwrap();
    MessageType::Ros(RosType::new(&types.resolve_name(name).unwrap()).unwrap())
}

fn listener(bus: &Memory, topic: &str) -> Box<dyn Listener> {
    let spec = TopicSpec::new(topic, MessageType::NativeObject);
    bus.open_listener(&spec, &Context::default()).unwrap()
}

fn number(n: i64) -> Payload {
    Payload::from(Value::Int(n))
}

const SECOND: Duration = Duration::from_secs(1);
const ALL: &str = "from: 'a:/(.*)', to: 'b:/from_a/$1'";

#[test]
fn a_topic_that_comes_gets_a_route_that_opens_its_source_when_wanted() {
    let mut bench = Bench::new(&[ALL]);
    bench.run(SECOND);
    assert_eq!(bench.state("a:/(.*) -> b:/from_a/$1").unwrap(), "waiting for a name that matches");
    let mut source = publisher(&bench.a, "/x", MessageType::NativeObject);
    bench.run(3 * SECOND);
    let name = "a:/x -> b:/from_a/x";
    assert_eq!(bench.state(name).unwrap(), "waiting for a listener on b:/from_a/x");
    assert_eq!(bench.counts(), PatternCounts { routes: 1, made: 1, ..PatternCounts::default() });
    // It shows on the other side, and no program listens to the source.
    assert_eq!(source.link().peers, Some(0));
    let mut sink = listener(&bench.b, "/from_a/x");
    assert_eq!(sink.link().peers, Some(1));
    bench.run(SECOND);
    assert_eq!(source.link().peers, Some(1));
    source.publish(&number(7)).unwrap();
    bench.run(SECOND);
    assert_eq!(sink.take().unwrap().unwrap().payload, number(7));
    assert_eq!(bench.state(name).unwrap(), "active");
    drop(sink);
    bench.run(3 * SECOND);
    assert_eq!(source.link().peers, Some(0), "the source is let go");
}

/// A source that goes after a long calm has as much time to come back as any other.
#[test]
fn a_calm_shortens_no_time() {
    for calm in (10..20).map(|n| n * SECOND + 300 * MS) {
        let mut bench = Bench::new(&[ALL]);
        let source = publisher(&bench.a, "/x", MessageType::NativeObject);
        bench.run(3 * SECOND + calm);
        drop(source);
        bench.run(4 * SECOND);
        assert_eq!(bench.counts().routes, 1, "after {calm:?}");
        bench.run(3 * SECOND);
        assert_eq!(bench.counts().routes, 0, "after {calm:?}");
        // What comes is seen at once.
        bench.run(30 * SECOND);
        let _source = publisher(&bench.a, "/y", MessageType::NativeObject);
        bench.run(2 * SECOND);
        assert_eq!(bench.counts().routes, 1, "after {calm:?}");
    }
}

/// Two sources of one name get one route, also where the one that has it comes behind the other in
/// the alphabet.
#[test]
fn two_sources_of_one_name_get_one_route() {
    let mut bench = Bench::new(&["from: 'a:/(x|y)/(.*)', to: 'b:/$2'"]);
    let _first = publisher(&bench.a, "/y/joints", MessageType::NativeObject);
    bench.run(3 * SECOND);
    let _second = publisher(&bench.a, "/x/joints", MessageType::NativeObject);
    bench.run(3 * SECOND);
    assert_eq!(
        bench.state("a:/y/joints -> b:/joints").unwrap(),
        "waiting for a listener on b:/joints"
    );
    assert_eq!(
        bench.state("a:/x/joints -> b:/joints").unwrap(),
        "waiting for the name b:/joints, to which a:/y/joints goes; write a route with another"
    );
    assert_eq!(bench.counts().routes, 1);
}

/// Names of YARP become names of ROS by a slash for their colon.
#[test]
fn names_that_differ_by_a_colon_get_a_route_each_whichever_comes_first() {
    let routes = ["from: 'a:/([^:]*)', to: 'b:/$1'", "from: 'a:/([^:]*):(o|i)', to: 'b:/${1}/$2'"];
    let wanted = ["a:/x/y/o -> b:/x/y/o", "a:/x/y:o -> b:/x/y/o_"];
    for colon_first in [true, false] {
        let mut bench = Bench::new(&routes);
        let (first, second) = if colon_first { ("/x/y:o", "/x/y/o") } else { ("/x/y/o", "/x/y:o") };
        let _first = publisher(&bench.a, first, MessageType::NativeObject);
        bench.run(3 * SECOND);
        // Alone it needs no other name.
        let mut names = bench.names();
        assert!(names.len() == 1 && names[0].ends_with("-> b:/x/y/o"), "{names:?}");
        let _second = publisher(&bench.a, second, MessageType::NativeObject);
        bench.run(5 * SECOND);
        names = bench.names();
        names.sort();
        assert_eq!(names, wanted);
        for name in wanted {
            let (_, to) = name.split_once("-> ").unwrap();
            let waits = format!("waiting for a listener on {to}");
            assert_eq!(bench.state(name), Some(waits), "{colon_first}");
        }
    }
}

#[test]
fn a_route_ends_a_while_after_its_source_and_counts_on_when_that_comes_back() {
    let mut bench = Bench::new(&["from: 'a:/(.*)', to: 'b:/$1', lazy: false"]);
    let sink = listener(&bench.b, "/x");
    for round in 1..=2 {
        let mut source = publisher(&bench.a, "/x", MessageType::NativeObject);
        bench.run(3 * SECOND);
        source.publish(&number(round)).unwrap();
        bench.run(SECOND);
        drop(source);
        bench.run(2 * SECOND);
        assert_eq!(bench.names(), ["a:/x -> b:/x"], "a publisher that restarts finds its route");
        let sent = bench.engine.status()[0].counters.sent;
        assert_eq!(sent, u64::try_from(round).unwrap());
        bench.run(5 * SECOND);
        assert_eq!(bench.names(), Vec::<String>::new());
        assert_eq!(sink.link().peers, Some(0));
    }
    let counts = bench.counts();
    assert_eq!((counts.made, counts.ended, counts.routes), (2, 2, 0));
}

#[test]
fn both_directions_of_all_do_not_feed_each_other() {
    let mut bench = Bench::new(&["from: 'a:/(.*)', to: 'b:/$1'", "from: 'b:/(.*)', to: 'a:/$1'"]);
    let _here = publisher(&bench.a, "/x", MessageType::NativeObject);
    let _there = publisher(&bench.b, "/y", MessageType::NativeObject);
    bench.run(10 * SECOND);
    let mut names = bench.names();
    names.sort();
    assert_eq!(names, ["a:/x -> b:/x", "b:/y -> a:/y"]);
}

/// Neither bus shows marks, so the second bridge cannot know whose a topic is, and leaves it alone.
#[test]
fn a_second_bridge_leaves_alone_what_is_on_both_sides() {
    let both = ["from: 'a:/(.*)', to: 'b:/$1'", "from: 'b:/(.*)', to: 'a:/$1'"];
    let mut bench = Bench::new(&both);
    let _here = publisher(&bench.a, "/x", MessageType::NativeObject);
    bench.run(3 * SECOND);
    assert_eq!(bench.names(), ["a:/x -> b:/x"]);
    bench.engine = {
        let first = std::mem::replace(&mut bench.engine, engine(&bench.a, &bench.b, &both));
        bench.run(5 * SECOND);
        let waits = bench.state("a:/x -> b:/x").unwrap();
        assert!(
            waits.contains("both have publishers") && waits.contains("write a route"),
            "{waits}"
        );
        assert!(bench.state("b:/x -> a:/x").unwrap().contains("both have publishers"));
        first
    };
}

#[test]
fn routes_of_the_configuration_come_before_patterns() {
    let mut bench = Bench::new(&[
        "from: 'a:/x', to: 'b:/other', type: NativeObject",
        "from: 'a:/y', to: 'b:/z', type: NativeObject",
        "from: 'a:/(.*)', to: 'b:/$1'",
        "from: 'b:/(.*)', to: 'a:/$1'",
    ]);
    let all = ["/x", "/y", "/z", "/free"];
    let _sources = all.map(|name| publisher(&bench.a, name, MessageType::NativeObject));
    bench.run(5 * SECOND);
    // /z would share its destination with /y.
    assert_eq!(bench.names(), ["a:/x -> b:/other", "a:/y -> b:/z", "a:/free -> b:/free"]);
}

#[test]
fn what_is_denied_is_left_out() {
    let mut bench = Bench::new(&["from: 'a:/(.*)', to: 'b:/$1', deny: ['cam/.*']"]);
    let all = ["/cam/left", "/rosout", "/_hidden", "/tf"];
    let _sources = all.map(|name| publisher(&bench.a, name, MessageType::NativeObject));
    bench.run(5 * SECOND);
    assert_eq!(bench.names(), ["a:/tf -> b:/tf"]);
}

/// The status of a bridge is no topic that another middleware has: a listener to it waits for the bridge.
#[test]
fn what_the_program_has_about_itself_gets_no_route() {
    let mut bench = Bench::new(&["from: 'a:/(.*)', to: 'b:/$1'", "from: 'b:/(.*)', to: 'a:/$1'"]);
    let own = ["b:/bridge/status".parse().unwrap()];
    bench.engine = bench.engine.with_own(own);
    let _here = ["/bridge/status", "/bridge/other"]
        .map(|name| publisher(&bench.a, name, MessageType::NativeObject));
    let _own = publisher(&bench.b, "/bridge/status", MessageType::NativeObject);
    bench.run(3 * SECOND);
    assert_eq!(bench.names(), ["a:/bridge/other -> b:/bridge/other"]);
}

/// A bus on which listeners are there first, and which hides the program's own endpoints.
struct Ahead(Arc<Memory>);

impl Middleware for Ahead {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.0.open_listener(spec, context)
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.0.open_publisher(spec, context)
    }

    fn inner(&self) -> Option<&dyn Middleware> {
        Some(&*self.0)
    }

    fn routing_properties(&self) -> RoutingProperties {
        RoutingProperties { subscribes_first: true, tells_own: true, ..self.0.routing_properties() }
    }

    fn ahead_options(&self, _: &str) -> Option<Map> {
        Some(Map::default())
    }
}

/// A bus on which an action has a topic below its name.
struct Actionlib(Arc<Memory>);

impl Middleware for Actionlib {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.0.open_listener(spec, context)
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.0.open_publisher(spec, context)
    }

    fn inner(&self) -> Option<&dyn Middleware> {
        Some(&*self.0)
    }

    fn routing_properties(&self) -> RoutingProperties {
        RoutingProperties { action_topics: &["feedback"], ..self.0.routing_properties() }
    }
}

#[test]
fn a_topic_of_an_action_is_left_to_patterns_of_actions() {
    let name = TypeName::parse(Dialect::Ros2, "demo/action/Count").unwrap();
    let text = "int32 to\n---\nint32 reached\n---\nint32 at\n";
    let count = ResolvedType::from_text(Dialect::Ros2, &name, text).unwrap();
    let count = ActionSpec::new("/count", RosAction::new(&count).unwrap());
    let actions = "action: 'a:/(.*)', as: 'b:/$1'";
    for (routes, is_carried) in [(&[ALL][..], true), (&[ALL, actions], false)] {
        let [a, b] = ["a", "b"].map(|name| Arc::new(Actionlib(Arc::new(Memory::new(name)))));
        let engine = engine(&a, &b, routes);
        let mut bench = Bench { a: a.0.clone(), b: b.0.clone(), engine, now: Instant::now() };
        let _server = bench.a.open_action_server(&count, &Context::default()).unwrap();
        let _topics = ["/count/feedback", "/other/feedback"]
            .map(|name| publisher(&bench.a, name, MessageType::NativeObject));
        bench.run(3 * SECOND);
        let names = bench.names();
        let has = |name: &str| names.contains(&format!("a:/{name} -> b:/from_a/{name}"));
        assert_eq!((has("count/feedback"), has("other/feedback")), (is_carried, true), "{names:?}");
    }
}

#[test]
fn a_listener_to_what_the_program_has_about_itself_opens_nothing() {
    let [a, b] = ["a", "b"].map(|name| Arc::new(Ahead(Arc::new(Memory::new(name)))));
    let engine = engine(&a, &b, &["from: 'a:/(.*)', to: 'b:/$1'"]);
    let engine = engine.with_own(["b:/bridge/status".parse().unwrap()]);
    let (a, b) = (Arc::clone(&a.0), Arc::clone(&b.0));
    let mut bench = Bench { a, b, engine, now: Instant::now() };
    let _waiting = ["/bridge/status", "/x"].map(|name| listener(&bench.b, name));
    bench.run(3 * SECOND);
    assert_eq!(bench.names(), ["a:/x -> b:/x"]);
}

/// A name that ROS 2 lacks is meant by what it has instead, where listeners have one such name.
#[test]
fn a_destination_is_the_name_that_listeners_have() {
    let [a, b] = ["a", "b"].map(|name| Arc::new(Ahead(Arc::new(Memory::new(name)))));
    let engine = engine(&a, &b, &["from: 'a:/(.*)', to: 'b:/$1'"]);
    let (a, b) = (Arc::clone(&a.0), Arc::clone(&b.0));
    let mut bench = Bench { a, b, engine, now: Instant::now() };
    let first = listener(&bench.b, "/robot-1/1st");
    let _both = ["/two-names", "/two.names"].map(|name| listener(&bench.b, name));
    let names = ["/robot_1/_1st", "/two_names", "/fine_1"];
    let _sources = names.map(|name| publisher(&bench.a, name, MessageType::NativeObject));
    bench.run(5 * SECOND);
    let made = |bench: &Bench| {
        let names = bench.names().into_iter();
        let mut names: Vec<_> = names.filter(|name| names_of_ros(name)).collect();
        names.sort();
        names
    };
    let plain = ["a:/fine_1 -> b:/fine_1", "a:/two_names -> b:/two_names"];
    let meant = "a:/robot_1/_1st -> b:/robot-1/1st";
    assert_eq!(made(&bench), [plain[0], meant, plain[1]]);
    // While no program listens it stays, until a program has the very name.
    drop(first);
    bench.run(5 * SECOND);
    assert_eq!(made(&bench)[1], meant);
    let _exact = listener(&bench.b, "/robot_1/_1st");
    bench.run(5 * SECOND);
    assert_eq!(made(&bench)[1], "a:/robot_1/_1st -> b:/robot_1/_1st");
}

/// True for a route whose source has a name of ROS.
fn names_of_ros(route: &str) -> bool {
    let from = route.split(" -> ").next().unwrap_or_default().trim_start_matches("a:");
    wrapyfi_endpoint::pattern::ros_name(from) == from
}

#[test]
fn types_are_learned_and_those_unknown_say_so() {
    let mut bench = Bench::new(&[ALL]);
    let _image = publisher(&bench.a, "/cam", MessageType::Image);
    bench.run(5 * SECOND);
    let status = bench.engine.status();
    assert_eq!(status[0].message_type, "sensor_msgs/msg/Image");
    let _odd = publisher(&bench.a, "/odd", unknown("demo/msg/None"));
    bench.run(3 * SECOND);
    let state = bench.state("a:/odd -> b:/from_a/odd").unwrap();
    assert!(state.contains("a definition of demo/msg/None: "), "{state}");
    assert_eq!((bench.counts().routes, bench.counts().waiting), (1, 1));
}

#[test]
fn one_topic_whose_type_nobody_tells_yet_waits_for_it() {
    let mut bench = Bench::new(&["from: 'a:/x', to: 'b:/y'"]);
    bench.run(2 * SECOND);
    let state = bench.state("a:/x -> b:/y").unwrap();
    assert_eq!(state, "waiting for a publisher on a:/x, which tells the type");
    // A listener at the other end tells it as well.
    let _sink = listener(&bench.b, "/y");
    bench.run(2 * SECOND);
    assert_eq!(bench.state("a:/x -> b:/y").unwrap(), "waiting for a publisher on a:/x");
    assert_eq!(bench.engine.status().len(), 1);
}

#[test]
fn a_source_that_comes_back_with_another_type_gets_another_route() {
    for written in [ALL, "from: 'a:/x', to: 'b:/from_a/x'"] {
        let mut bench = Bench::new(&[written]);
        let route = "a:/x -> b:/from_a/x";
        let label = |bench: &Bench| {
            let status = bench.engine.status();
            let found = status.into_iter().find(|it| it.name == route && it.pattern.is_none());
            found.map(|it| it.message_type)
        };
        let before = publisher(&bench.a, "/x", MessageType::Image);
        bench.run(2 * SECOND);
        assert!(label(&bench).is_some_and(|it| it.ends_with("Image")), "{written}");
        drop(before);
        bench.run(2 * SECOND);
        let _after = publisher(&bench.a, "/x", MessageType::AudioChunk);
        bench.run(2 * SECOND);
        assert!(label(&bench).is_some_and(|it| it.ends_with("AudioChunk")), "{written}");
    }
}

/// A bus whose publishers are asked for their types, as ports of YARP.
struct Asked {
    bus: Arc<Memory>,
    answer: std::sync::Mutex<LearnResult<&'static str>>,
}

impl Middleware for Asked {
    fn name(&self) -> &str {
        self.bus.name()
    }

    fn open_listener(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Listener> {
        self.bus.open_listener(spec, context)
    }

    fn open_publisher(&self, spec: &TopicSpec, context: &Context) -> Opened<dyn Publisher> {
        self.bus.open_publisher(spec, context)
    }

    fn inner(&self) -> Option<&dyn Middleware> {
        Some(&*self.bus)
    }

    fn routing_properties(&self) -> RoutingProperties {
        RoutingProperties { untyped: true, ..self.bus.routing_properties() }
    }

    fn learn_topic(&self, found: &Discovered, types: &mut TypeStore) -> LearnResult<Learned> {
        let told = self.answer.lock().unwrap().clone()?.to_owned();
        topic_of_name("a", &Discovered { type_name: Some(told), ..found.clone() }, types)
    }
}

/// The type that listeners want holds only until the source has shown a type that cannot be read so.
#[test]
fn what_a_source_shows_goes_before_what_listeners_want() {
    const OBJECT: &str = "wrapyfi_msgs/msg/NativeObject";
    let name = "/x".to_owned();
    let asked = LearnError::Asked(name.clone());
    let silent = LearnError::Silent { name, reason: "it has sent nothing yet".to_owned() };
    for written in [ALL, "from: 'a:/x', to: 'b:/from_a/x'"] {
        let bus = Arc::new(Memory::new("a"));
        let answer = std::sync::Mutex::new(Err(asked.clone()));
        let (a, b) =
            (Arc::new(Asked { bus: Arc::clone(&bus), answer }), Arc::new(Memory::new("b")));
        let (mut engine, mut now) = (engine(&a, &b, &[written]), Instant::now());
        let mut after = |answer: LearnResult<&'static str>| {
            *a.answer.lock().unwrap() = answer;
            (0..30).for_each(|_| {
                now += 100 * MS;
                engine.step(now);
            });
            let status = engine.status();
            let found = status.into_iter().find(|it| it.name == "a:/x -> b:/from_a/x").unwrap();
            (found.message_type, found.state.to_string())
        };
        let _old = listener(&b, "/from_a/x");
        let source = publisher(&bus, "/x", MessageType::Image);
        let (_, state) = after(Err(asked.clone()));
        assert_eq!(state, "waiting for a:/x to tell its type".replace("a:", ""), "{written}");
        assert_eq!(after(Err(silent.clone())).0, OBJECT, "{written}");
        // Bottles of YARP are read as what has fields; pictures are none of them.
        assert_eq!(after(Ok("std_msgs/msg/Float64MultiArray")).0, OBJECT, "{written}");
        assert_eq!(after(Ok("Image")).0, "sensor_msgs/msg/Image", "{written}");
        assert_eq!(after(Ok("NativeObject")).0, OBJECT, "{written}");
        drop(source);
    }
}

/// A listener of before does not bring the type back that the publishers have left.
#[test]
fn what_a_source_shows_now_goes_before_what_listeners_of_before_want() {
    const VECTOR: &str = "std_msgs/msg/Float64MultiArray";
    for written in [ALL, "from: 'a:/x', to: 'b:/from_a/x'"] {
        let buses = ["a", "b"].map(|name| Arc::new(Memory::new(name)));
        let [a, b] = buses.clone().map(|bus| {
            let answer = std::sync::Mutex::new(Ok(VECTOR));
            Arc::new(Asked { bus, answer })
        });
        let (mut engine, mut now) = (engine(&a, &b, &[written]), Instant::now());
        let mut after = |shown: &'static str| {
            *a.answer.lock().unwrap() = Ok(shown);
            (0..60).for_each(|_| {
                now += 100 * MS;
                engine.step(now);
            });
            let status = engine.status();
            status.into_iter().find(|it| it.name == "a:/x -> b:/from_a/x").unwrap().message_type
        };
        let _source = publisher(&buses[0], "/x", MessageType::Image);
        let _of_before = listener(&buses[1], "/from_a/x");
        assert_eq!(after(VECTOR), VECTOR, "{written}");
        assert_eq!(after("NativeObject"), "wrapyfi_msgs/msg/NativeObject", "{written}");
        assert_eq!(after(VECTOR), VECTOR, "{written}");
    }
}

#[test]
fn the_number_of_routes_is_limited_and_the_rest_counted() {
    let mut bench = Bench::new(&["from: 'a:/(.*)', to: 'b:/$1', max_routes: 3"]);
    let names: Vec<String> = (0..5).map(|n| format!("/t{n}")).collect();
    let _sources: Vec<_> =
        names.iter().map(|name| publisher(&bench.a, name, MessageType::NativeObject)).collect();
    bench.run(4 * SECOND);
    let counts = bench.counts();
    assert_eq!((counts.routes, counts.over_limit), (3, 2));
    let state = bench.state("a:/(.*) -> b:/$1").unwrap();
    assert!(state.contains("3 is the limit of routes (max_routes), 2 more"), "{state}");
}

#[test]
fn a_destination_belongs_to_one_source() {
    let mut bench = Bench::new(&["from: 'a:/[xy]/(.*)', to: 'b:/$1'"]);
    let _sources =
        ["/x/t", "/y/t"].map(|name| publisher(&bench.a, name, MessageType::NativeObject));
    bench.run(4 * SECOND);
    assert_eq!(bench.state("a:/x/t -> b:/t").unwrap(), "waiting for a listener on b:/t");
    let state = bench.state("a:/y/t -> b:/t").unwrap();
    assert_eq!(
        state,
        "waiting for the name b:/t, to which a:/x/t goes; write a route with another"
    );
}

#[test]
fn services_are_offered_on_the_other_side_and_taken_away_again() {
    let mut bench = Bench::new(&["service: 'a:/(.*)', as: 'b:/$1'"]);
    let spec = |name: &str| ServiceSpec::new(name, ServiceKind::NativeObject);
    let server = bench.a.open_server(&spec("/light"), &Context::default()).unwrap();
    let _own = bench.a.open_server(&spec("/n/get_parameters"), &Context::default()).unwrap();
    bench.run(3 * SECOND);
    assert_eq!(bench.state("b:/light -> a:/light").unwrap(), "active");
    assert_eq!(bench.counts().routes, 1);
    let client = bench.b.open_client(&spec("/light"), &Context::default()).unwrap();
    assert_eq!(client.link().peers, Some(1));
    drop(server);
    bench.run(7 * SECOND);
    assert_eq!(client.link().peers, Some(0));
}

#[test]
fn a_name_that_somebody_offers_is_not_taken_from_them() {
    let mut bench = Bench::new(&["service: 'a:/(.*)', as: 'b:/$1'"]);
    let spec = ServiceSpec::new("/light", ServiceKind::NativeObject);
    let _there = bench.b.open_server(&spec, &Context::default()).unwrap();
    let _here = bench.a.open_server(&spec, &Context::default()).unwrap();
    bench.run(3 * SECOND);
    let state = bench.state("b:/light -> a:/light").unwrap();
    assert_eq!(
        state,
        "waiting for the name b:/light, under which another program offers a service"
    );
}

#[test]
fn threads_make_and_end_routes_too() {
    let (a, b) = (Arc::new(Memory::new("a")), Arc::new(Memory::new("b")));
    let running = engine(&a, &b, &[ALL]).start().unwrap();
    let until = |what: &dyn Fn(&[RouteStatus]) -> bool| {
        let deadline = Instant::now() + 60 * SECOND;
        while !what(&running.status()) {
            assert!(Instant::now() < deadline, "{:?}", running.status());
            std::thread::sleep(10 * MS);
        }
    };
    let mut source = publisher(&a, "/x", MessageType::NativeObject);
    let mut sink = listener(&b, "/from_a/x");
    until(&|all| {
        all.iter().any(|route| route.state == RouteState::Active && route.pattern.is_none())
    });
    source.publish(&number(3)).unwrap();
    until(&|all| all.iter().any(|route| route.counters.sent == 1));
    assert_eq!(sink.take().unwrap().unwrap().payload, number(3));
    drop(source);
    until(&|all| all.iter().any(|route| route.pattern.is_some_and(|it| it.ended == 1)));
    assert_eq!(running.stop().len(), 1);
}

#[test]
fn a_server_of_another_type_gets_a_route_of_that_type() {
    let mut bench = Bench::new(&["name: it, service: 'a:/real', as: 'b:/shown'"]);
    let server = |bench: &Bench, kind| {
        bench.a.open_server(&ServiceSpec::new("/real", kind), &Context::default()).unwrap()
    };
    let kind = |bench: &Bench| {
        let status = bench.engine.status();
        status.iter().find(|it| it.name == "it").map(|it| it.message_type)
    };
    let first = server(&bench, ServiceKind::NativeObject);
    bench.run(3 * SECOND);
    let before = kind(&bench);
    drop(first);
    bench.run(SECOND);
    let second = server(&bench, ServiceKind::Image);
    bench.run(3 * SECOND);
    assert_ne!(kind(&bench), before);
    assert_eq!(bench.state("it").unwrap(), "active");
    drop(second);
    bench.run(9 * SECOND);
    assert_eq!(bench.state("it").unwrap(), "waiting for a server of a:/real");
}
