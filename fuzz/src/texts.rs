//! Targets of what people write: interface definitions, command lines, configuration.

use std::io;

use serde::Deserialize;
use wrapyfi_engine::{Available, Config, Plan};
use wrapyfi_interfaces::parser::{TypeName, parse_message};
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_node::args::RosArgs;
use wrapyfi_node::{NodeName, NodeOptions};

use crate::bounded;

/// Memory for each byte of text: a line of few characters becomes a field with its names.
const LINES: usize = 64;
/// Memory for each byte of YAML, whose events carry positions.
const YAML: usize = 1024;

/// The text of a `.msg` file.
pub fn msg_parser(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let name = TypeName::new("fuzz_msgs", "Fuzzed").expect("a valid name");
    match bounded(data.len(), LINES, || parse_message(&name, text)) {
        Ok(message) => {
            assert_eq!(message.name, name);
            let fields = message.fields.len() + message.constants.len();
            assert!(fields <= text.lines().count(), "one field or constant a line");
        }
        Err(error) => {
            assert!((1..=text.lines().count()).contains(&error.line), "line {}", error.line);
            assert!(!error.to_string().is_empty());
        }
    }
}

/// A command line: one argument a line. After a line `----` comes the content of every parameter
/// file.
pub fn ros_args(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let (line, file) = text.split_once("\n----\n").unwrap_or((&text, ""));
    let read = |path: &str| match path {
        "missing" => Err(io::ErrorKind::NotFound.into()),
        _ => Ok(file.as_bytes().to_vec()),
    };
    // The same file may be named many times over.
    let input = data.len() + file.len() * line.matches("--params-file").count();
    let args = match bounded(input, YAML, || RosArgs::parse(line.split('\n'), read)) {
        Ok(args) => args,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return;
        }
    };
    assert!(args.enclave.starts_with('/'));
    let name = args.node_name("talker");
    let namespace = args.namespace("/", &name);
    let Ok(node) = NodeName::new(&name, &namespace) else { return };
    assert!(node.fqn().starts_with('/') && !node.fqn().contains("//"), "{}", node.fqn());
    for topic in ["chatter", "~/private", "/absolute", "a/b"] {
        if let Ok(resolved) = args.resolve_topic(&node, topic) {
            assert!(resolved.starts_with('/') && !resolved.contains("//"), "{resolved}");
        }
        if let Ok(resolved) = args.resolve_service(&node, topic) {
            assert!(resolved.starts_with('/') && !resolved.contains("//"), "{resolved}");
        }
    }
    if let Ok(options) = NodeOptions::resolve("talker", "/", &args) {
        assert_eq!(options.name, node);
        assert!(options.parameters.keys().all(|name| !name.is_empty()), "a parameter has a name");
    }
}

/// A configuration file, up to the plan of its routes.
pub fn config(data: &[u8]) {
    #[derive(Debug, Default, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Endpoints {
        _zeromq: Option<u16>,
        _ros2: Option<String>,
    }
    let Ok(text) = std::str::from_utf8(data) else { return };
    let check = |topic: &str| if topic.is_empty() { Err("empty".to_owned()) } else { Ok(()) };
    let middlewares = ["zeromq", "ros2"].map(|name| Available {
        name,
        check_topic: &check,
        options: &["carrier"],
        ..Available::default()
    });
    let planned = bounded(data.len(), YAML, || {
        let config = Config::<Endpoints>::from_yaml(text, "fuzz.yaml")?;
        let routes = config.routes.len();
        let mut types = TypeStore::generated();
        Plan::new(&config, &middlewares, &mut types, "fuzz.yaml").map(|plan| (plan, routes))
    });
    match planned {
        Ok((plan, routes)) => {
            assert_eq!(plan.routes.len(), routes);
            for route in &plan.routes {
                assert!(
                    route.policy.queue.depth > 0 && route.policy.limits.message_bytes > 0,
                    "{route}"
                );
                assert!(route.policy.max_rate_hz.is_none_or(|hz| hz > 0.0), "{route}");
            }
        }
        Err(error) => assert!(error.to_string().starts_with("fuzz.yaml"), "{error}"),
    }
}
