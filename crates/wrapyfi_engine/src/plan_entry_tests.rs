//! Plans with patterns, and their faults.

use serde::Deserialize;
use wrapyfi_interfaces::parser::{Dialect, TypeName};

use super::super::{Config, ConfigError, Plan};
use super::*;
use wrapyfi_data::types::Value;

#[derive(Debug, Default, Deserialize)]
struct NoEndpoints {}

fn plan(routes: &[&str]) -> Result<Plan, ConfigError> {
    let text: String = routes.iter().map(|route| format!("  - {{ {route} }}\n")).collect();
    let config: Config<NoEndpoints> =
        Config::from_yaml(&format!("routes:\n{text}"), "bridge.yaml")?;
    let no_blanks = |topic: &str| match topic.find(' ') {
        Some(at) => Err(format!("blank at {at}")),
        None => Ok(()),
    };
    let conventions = Conventions {
        has_text_type: true,
        node_services: &[&["get_loggers"]],
        ..Conventions::NONE
    };
    let check_option = |option: &str, value: &Value| match (option, value.as_str()) {
        ("carrier", Some("tcp")) | ("from_peers" | "to_peers", _) => Ok(()),
        _ => Err("option carrier must be tcp".to_owned()),
    };
    let known = |name, options| Available {
        name,
        check_topic: &no_blanks,
        options,
        check_option: &check_option,
        conventions,
        ..Available::default()
    };
    let middlewares =
        [known("ros", &["carrier", "from_peers", "to_peers"][..]), known("ros2", &["carrier"][..])];
    let mut types = TypeStore::generated();
    Plan::new(&config, &middlewares, &mut types, "bridge.yaml")
}

fn one(route: &str) -> Route {
    plan(&[route]).unwrap().routes.remove(0)
}

fn wrong(route: &str) -> String {
    let text = plan(&[route]).unwrap_err().to_string();
    assert!(text.starts_with("bridge.yaml:2:"), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

#[test]
fn options_of_the_other_direction_are_refused() {
    let check_option = |_: &str, _: &Value| Ok(());
    let yarp = Available {
        name: "yarp",
        options: &["base", "carrier", "sensor"],
        check_option: &check_option,
        source_options: &["sensor"],
        destination_options: &["base"],
        ..Available::default()
    };
    let events = &["introspection"][..];
    let ros2 = Available {
        name: "ros2",
        options: events,
        check_option: &check_option,
        source_options: events,
        destination_options: events,
        ..Available::default()
    };
    let read = |route: &str| {
        let text = format!("routes:\n  - {{ {route} }}\n");
        let config: Config<NoEndpoints> = Config::from_yaml(&text, "bridge.yaml").unwrap();
        let plan = Plan::new(&config, &[yarp, ros2], &mut TypeStore::generated(), "bridge.yaml");
        plan.map(drop).map_err(|error| error.to_string())
    };
    let inward = |options: &str| {
        read(&format!("from: 'yarp:/a', to: 'ros2:/b', type: Image, options: {{ {options} }}"))
    };
    let outward = |options: &str| {
        read(&format!("from: 'ros2:/b', to: 'yarp:/a', type: Image, options: {{ {options} }}"))
    };
    assert_eq!(
        (inward("sensor: 1, carrier: tcp"), outward("base: velocity, carrier: tcp")),
        (Ok(()), Ok(()))
    );
    let text = inward("base: velocity").unwrap_err();
    assert!(
        text.contains("option base is about what is sent to yarp, which is the source"),
        "{text}"
    );
    let text = outward("sensor: 1").unwrap_err();
    assert!(
        text.contains(
            "option sensor is about what is received from yarp, which is the destination"
        ),
        "{text}"
    );
    for text in [inward("introspection: metadata"), outward("introspection: metadata")] {
        let text = text.unwrap_err();
        assert!(text.contains("option introspection has no effect on a topic"), "{text}");
    }
    assert_eq!(
        read("service: 'yarp:/a', as: 'ros2:/b', options: { introspection: metadata }"),
        Ok(())
    );
}

#[test]
fn a_pattern_goes_to_one_name_where_it_says_that_it_merges() {
    let joints = "from: 'ros:/(?:.*/)?state', to: 'ros2:/joint_states'";
    assert!(wrong(joints).contains("all that the pattern means would go to one name"));
    let merged = one(&format!("{joints}, merge: true"));
    for name in ["/state", "/left/arm/state"] {
        assert_eq!(merged.target(name).unwrap().to_string(), "ros2:/joint_states");
    }
    assert!(
        wrong(&format!("{}, merge: true", joints.replace("states", "$1")))
            .contains("$1 is no group")
    );
}

#[test]
fn lists_of_peers_stand_where_somebody_keeps_them() {
    let route = one("from: 'ros:/x', to: 'ros2:/x', options: { from_peers: [/a, '10.0.0.*'] }");
    assert!(route.policy.options.get("from_peers").is_some());
    for (options, said) in [
        ("to_peers: [/a]", "connections of ros2 do not show whose they are, as those of ros do"),
        ("from_peers: /a", "option from_peers must be a list of names"),
        ("from_peers: []", "1 to 256 of them"),
        ("from_peers: [robot]", "addresses (192.168.1.7"),
    ] {
        let text = wrong(&format!("from: 'ros:/x', to: 'ros2:/x', options: {{ {options} }}"));
        assert!(text.contains(said), "{text}");
    }
    let text = wrong("service: 'ros:/x', as: 'ros2:/x', options: { from_peers: [/a] }");
    assert!(text.contains("no effect on a service"), "{text}");
}

#[test]
fn the_loop_guard_of_a_route_may_be_off() {
    assert!(one("from: 'ros:/x', to: 'ros2:/x'").policy.loop_guard);
    let off = one("from: 'ros:/x', to: 'ros2:/x', type: Text, loop_guard: false");
    assert!(!off.policy.loop_guard && off.to_string().contains("no loop guard"), "{off}");
    let text = wrong("service: 'ros:/x', as: 'ros2:/x', loop_guard: false");
    assert!(text.contains("loop_guard has no effect on a service"), "{text}");
}

fn target(pattern: &Route, name: &str) -> Option<String> {
    pattern.target(name).map(|to| to.to_string())
}

#[test]
fn a_pattern_names_what_it_takes_and_where_that_goes() {
    let pattern = one("from: 'ros:/(.*)', to: 'ros2:/ros1/$1', allow: ['camera/.*', '/map'], \
                       deny: ['.*/compressedDepth'], queue_depth: 3");
    assert_eq!(target(&pattern, "/camera/left").as_deref(), Some("ros2:/ros1/camera/left"));
    assert_eq!(target(&pattern, "/map").as_deref(), Some("ros2:/ros1/map"));
    // Fast DDS and Zenoh of ROS 2 Lyrical have such topics beside those of images.
    let buffers = ["/camera/left/_buf_cpu", "/camera/left/_buf/010f3412"];
    let others = ["/camera/depth/compressedDepth", "/other", "/camera/_hidden", "camera/left"];
    for name in buffers.into_iter().chain(others) {
        assert_eq!(target(&pattern, name), None, "{name}");
    }
    assert_eq!(pattern.typing, Typing::Learned);
    assert!(pattern.policy.lazy && pattern.policy.queue.depth == 3);
    assert_eq!(pattern.max_routes(), MAX_PATTERN_ROUTES);
    let shown = pattern.to_string();
    assert!(
        shown.starts_with("ros:/(.*) -> ros2:/ros1/$1  topic  type learned  allow camera/.* /map")
    );
}

#[test]
fn the_default_list_can_be_switched_off() {
    let all = one("from: 'ros:/(.*)', to: 'ros2:/$1'");
    assert_eq!(target(&all, "/rosout"), None);
    let all = one("from: 'ros:/(.*)', to: 'ros2:/$1', default_deny: false, lazy: false");
    assert_eq!(target(&all, "/rosout").as_deref(), Some("ros2:/rosout"));
    assert!(!all.policy.lazy);
}

#[test]
fn one_topic_without_a_type_is_no_pattern_and_not_lazy() {
    let route = one("from: 'ros:/chatter', to: 'ros2:/chatter'");
    assert!(!route.is_many());
    assert_eq!(target(&route, "/chatter").as_deref(), Some("ros2:/chatter"));
    assert_eq!(target(&route, "/chatter2"), None);
    assert!(!route.policy.lazy);
    assert_eq!(route.to_string(), "ros:/chatter -> ros2:/chatter  topic  type learned");
}

#[test]
fn types_may_be_given_to_a_pattern_or_stand_in() {
    let typed = one("from: 'ros:/cam/(.*)', to: 'ros2:/cam/$1', type: Image");
    assert_eq!((typed.typing, typed.message_types()), (Typing::Given, MessageType::Image.into()));
    let else_ = one("from: 'ros:/(.*)', to: 'ros2:/$1', type_if_unknown: Text");
    assert_eq!(
        (else_.typing, else_.message_types()),
        (Typing::LearnedIfTold, MessageType::Text.into())
    );
    let service = one("service: 'ros:/(.*)', as: 'ros2:/$1', timeout_ms: 700");
    assert_eq!(service.interaction(), Interaction::Service);
    assert_eq!(target(&service, "/talker/get_loggers"), None);
    assert_eq!(
        (service.typing, service.policy.answer_within().as_millis()),
        (Typing::Learned, 700)
    );
}

#[test]
fn every_mistake_is_refused_with_its_line_and_a_remedy() {
    for (route, why) in [
        ("from: 'ros:/(.*', to: 'ros2:/$1'", "no regular expression"),
        ("from: 'ros:/cam/*', to: 'ros2:/cam'", "write (.*) for any text"),
        ("from: 'ros:/(*)', to: 'ros2:/$1'", "write (.*) for any text"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', deny: ['cam/*']", "deny \"cam/*\" is a glob"),
        ("from: 'ros:/cam/.*', to: 'ros2:/$1'", "parentheses: \"/cam/(.*)\""),
        ("from: 'ros:/(.*)', to: 'ros2:/$2'", "$2 is no group"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1_raw'", "write ${1}_raw"),
        ("from: 'ros:/(.*)', to: 'ros2:/all'", "it has no $1"),
        ("from: 'ros:/(.*)', to: 'ros2:/(.*)'", "only from is one"),
        ("from: 'ros:/x', to: 'ros2:/$1'", "which only `from`"),
        ("from: 'ros:/x', to: 'ros2:/(.*)', type: Image", "which only `from`"),
        ("from: 'rso:/(.*)', to: 'ros2:/$1'", "did you mean `ros`"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', allow: ['(']", "allow \"(\" is no regular"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', deny: ['[']", "deny \"[\" is no regular"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', max_routes: 0", "between 1 and 10000"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', from_type: Image", "from_type needs a type"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', queue_depth: 0", "queue_depth is 0"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', type: Imge", "no message type"),
        ("from: 'ros:/(.*)', to: 'ros2:/$1', type_if_unknown: Imge", "no message type"),
        ("from: 'ros:/(.*)', to: 'ros:/$1'", "would go to itself"),
        ("from: 'ros:/a', to: 'ros2:/a', type: Image, allow: ['a']", "allow has no effect"),
        ("from: 'ros:/a', to: 'ros2:/a', deny: ['a']", "deny has no effect"),
        ("from: 'ros:/a', to: 'ros2:/a', max_routes: 3", "max_routes has no effect"),
        ("from: 'ros:/a', to: 'ros2:/a', type: Image, type_if_unknown: Text", "type is given"),
        ("from: 'ros2:/a', to: 'ros2:/a'", "loop"),
        ("from: 'ros:/a', to: 'ros2:/a', options: { carrier: tpc }", "carrier must be tcp"),
        ("service: 'ros:/a', as: 'ros2:/a', options: { carrier: tpc }", "carrier must be tcp"),
        ("from: 'ros:/a', to: 'ros2:/a', type: std_srvs/srv/SetBool", "is no message"),
        ("service: 'ros:/a', as: 'ros2:/a', type: std_msgs/msg/String", "is no service"),
        ("from: 'ros:/a', to: 'ros2:/a', type: Text, encoding: bgr8", "encoding has no effect"),
        ("from: 'ros:/(.*)'", "`to` is missing"),
        ("service: 'ros:/(.*)', as: 'ros2:/$1', lazy: true", "lazy has no effect on a service"),
        ("service: 'ros:/(.*)', as: 'ros2:/$3'", "$3 is no group"),
    ] {
        let text = wrong(route);
        assert!(text.contains(why), "{route}: {text}");
    }
    let twice = "from: 'ros:/(.*)', to: 'ros2:/$1'";
    let text = plan(&[twice, twice]).unwrap_err().to_string();
    assert!(text.contains("bridge.yaml:3:") && text.contains("stands already in line 2"), "{text}");
}

#[test]
fn an_action_goes_where_there_are_actions_and_comes_from_functions_too() {
    let known = |name, interactions| Available { name, interactions, ..Available::default() };
    let no_blank = |topic: &str| match topic.contains(' ') {
        true => Err(format!("{topic:?} has a blank")),
        false => Ok(()),
    };
    let zeromq = known("zeromq", Interaction::TOPICS_AND_SERVICES);
    let available = [
        known("ros", &Interaction::ALL[..]),
        known("ros2", &Interaction::ALL),
        Available { check_topic: &no_blank, ..zeromq },
        known("mine", &[Interaction::Topic]),
    ];
    let mut types = TypeStore::generated();
    let name = TypeName::parse(Dialect::Ros2, "demo/action/Count").unwrap();
    types
        .add_definition(&name, "int32 to\n---\nint32 reached\n---\nint32 at\nbool done\n")
        .unwrap();
    let mut read = |route: &str| {
        let text = format!("routes:\n  - {{ {route} }}\n");
        let config: Config<NoEndpoints> = Config::from_yaml(&text, "bridge.yaml").unwrap();
        let plan = Plan::new(&config, &available, &mut types, "bridge.yaml");
        plan.map(|plan| plan.routes[0].to_string()).map_err(|error| error.to_string())
    };
    let learned = read("action: 'ros:/move_base', as: 'ros2:/move_base'").unwrap();
    assert_eq!(learned, "ros2:/move_base -> ros:/move_base  action  type learned");
    assert!(read("action: 'ros:/(.*)', as: 'ros2:/$1'").is_ok());
    let given = "type: demo/action/Count";
    let function = read(&format!("action: 'zeromq:/count', as: 'ros2:/count', {given}")).unwrap();
    assert_eq!(function, "ros2:/count -> zeromq:/count  action  demo/action/Count");
    let options = "options: { feedback: /progress, poll_ms: 50 }";
    assert!(read(&format!("action: 'zeromq:/a', as: 'ros2:/a', {given}, {options}")).is_ok());
    let until = "options: { poll: state, until: done }";
    assert!(read(&format!("action: 'zeromq:/a', as: 'ros2:/a', {given}, {until}")).is_ok());
    let timed = format!("action: 'zeromq:/a', as: 'ros2:/a', {given}, timeout_ms: 60000");
    assert!(read(&timed).unwrap().ends_with("demo/action/Count  within 60000 ms"));
    let function_of = format!("action: 'zeromq:/a', as: 'ros2:/a', {given}");
    for (route, why) in [
        (
            "action: 'zeromq:/a', as: 'ros2:/a'".to_owned(),
            "a function on zeromq does not tell the type of an action: give `type`",
        ),
        (
            "action: 'ros:/a', as: 'ros2:/a', timeout_ms: 60000".to_owned(),
            "timeout_ms has no effect on an action whose server is one",
        ),
        (
            format!("action: 'ros2:/a', as: 'zeromq:/a', {given}"),
            "zeromq carries topics and services;",
        ),
        (format!("action: 'mine:/a', as: 'ros2:/a', {given}"), "mine carries topics;"),
        ("action: 'ros2:/a', as: 'rose2:/a'".to_owned(), "\"rose2\" is not available"),
        (
            format!("action: 'ros:/a', as: 'ros2:/a', {given}, {options}"),
            "option feedback is unknown",
        ),
        (
            format!("action: 'zeromq:/a', as: 'ros2:/a', {given}, options: {{ feedback: 3 }}"),
            "option feedback must be the name of a topic",
        ),
        (
            format!("{function_of}, options: {{ feedback: '/no name' }}"),
            "option feedback: \"/no name\" has a blank",
        ),
        (
            format!("{function_of}, options: {{ feedbak: /progress }}"),
            "option feedbak is unknown between zeromq and ros2; did you mean `feedback`",
        ),
        (
            format!("{function_of}, options: {{ poll: state, poll_ms: 0 }}"),
            "option poll_ms must lie between 10 and 3600000",
        ),
        (
            format!("{function_of}, options: {{ poll: state, until: at }}"),
            "option until is at: fields of demo/action/Count_Feedback that are true or false: done",
        ),
        (
            format!("{function_of}, options: {{ until: done }}"),
            "option until is about feedback: give the option feedback or poll, too",
        ),
        ("action: 'ros:/a', as: 'ros2:/a', type: demo/msg/Count".to_owned(), "demo/msg/Count"),
        (format!("action: 'ros:/a', as: 'ros2:/a', {given}, qos: sensor_data"), "an action"),
    ] {
        let error = read(&route).unwrap_err();
        assert!(error.contains(why), "{route}: {error}");
        assert!(error.starts_with("bridge.yaml:2:"), "{route}: {error}");
    }
}

#[test]
fn a_service_is_refused_where_there_are_topics_alone() {
    let known = |name, interactions| Available { name, interactions, ..Available::default() };
    let available =
        [known("mine", &[Interaction::Topic][..]), known("ros2", Interaction::TOPICS_AND_SERVICES)];
    let read = |route: &str| {
        let text = format!("routes:\n  - {{ {route} }}\n");
        let config: Config<NoEndpoints> = Config::from_yaml(&text, "bridge.yaml").unwrap();
        let plan = Plan::new(&config, &available, &mut TypeStore::generated(), "bridge.yaml");
        plan.map(drop).map_err(|error| error.to_string())
    };
    let error = read("service: 'ros2:/x', as: 'mine:/x'").unwrap_err();
    assert!(
        error.contains("no route of services is possible here: mine carries topics;"),
        "{error}"
    );
    assert_eq!(read("from: 'ros2:/x', to: 'mine:/x', type: Text"), Ok(()));
}
